"""Tails of the distributions of Student and Fisher, and Holm's correction: statistics in NumPy.

``compare`` is part of the core installation, which has no SciPy (100 MB); tests compare.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]

_TINY = 1e-300


def student_two_sided(t: Float64, degrees: int) -> Float64:
    """Probability of Student's t beyond ``t`` on either side, for whole ``degrees`` of freedom.

    Abramowitz & Stegun 1964, 26.7.3 and 26.7.4: a finite sum, good to about 1e-15.
    """
    angle = np.arctan(np.abs(t) / math.sqrt(degrees))
    sine, squared = np.sin(angle), np.cos(angle) ** 2
    odd = degrees % 2
    term = np.cos(angle) if odd else np.ones_like(angle)
    total = np.zeros_like(angle)
    for power in range(1 if odd else 0, degrees - 1, 2):
        total += term
        term = term * squared * ((power + 1) / (power + 2))
    inside = (angle + sine * total) * (2.0 / math.pi) if odd else sine * total
    return np.clip(1.0 - inside, 0.0, 1.0)


def student_quantile(probability: float, degrees: int) -> float:
    """The t that is exceeded, on either side, with ``probability``; at most 1e8."""
    low, high = 0.0, 1e8
    for _ in range(80):
        middle = 0.5 * (low + high)
        above = float(student_two_sided(np.array(middle), degrees)) > probability
        low, high = (middle, high) if above else (low, middle)
    return high


def fisher_above(value: float, first: float, second: float) -> float:
    """Probability that F of ``first`` and ``second`` degrees of freedom is above ``value``.

    Abramowitz & Stegun 1964, 26.6.2.
    """
    return _beta(second / (second + first * value), 0.5 * second, 0.5 * first)


def _beta(x: float, a: float, b: float) -> float:
    """Regularized incomplete beta function, Abramowitz & Stegun 1964, 26.5.8, after Lentz 1976."""
    if x <= 0.0 or x >= 1.0:
        return min(max(x, 0.0), 1.0)
    if x > (a + 1.0) / (a + b + 2.0):
        return 1.0 - _beta(1.0 - x, b, a)
    log_front = math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b)
    front = math.exp(log_front + a * math.log(x) + b * math.log1p(-x)) / a
    fraction, c, d = 1.0, math.inf, 1.0
    # About sqrt(a + b) steps bring it to rounding.
    for step in range(1, 100 + 10 * math.isqrt(int(a + b))):
        m = step // 2
        if step % 2:
            term = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1))
        else:
            term = m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m))
        d = 1.0 / _away(1.0 + term * d)
        c = _away(1.0 + term / c)
        fraction *= c * d
        if abs(c * d - 1.0) < 1e-15:
            break
    return front * fraction


def _away(value: float) -> float:
    return value if abs(value) > _TINY else _TINY


def holm(p_values: Float64) -> Float64:
    """P-values ``(n,)`` corrected for their number (Holm 1979): reject where at most the level."""
    order = np.argsort(p_values, kind="stable")
    scaled = p_values[order] * np.arange(len(p_values), 0, -1)
    adjusted = np.empty_like(p_values)
    adjusted[order] = np.minimum(np.maximum.accumulate(scaled), 1.0)
    return adjusted
