"""Exact intervals of one path on one sample in rational arithmetic, for spot checks.

Slow, and independent of ``exact.py``: coefficients and signs are exact fractions, and roots are
bisected to 2^-80.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import numpy as np

Polynomial = list[Fraction]
"""Coefficients of 1, t, t^2, ..."""

PRECISION = Fraction(1, 2**80)


def value(p: Polynomial, t: Fraction) -> Fraction:
    result = Fraction(0)
    for c in reversed(p):
        result = result * t + c
    return result


def multiply(a: Polynomial, b: Polynomial) -> Polynomial:
    result = [Fraction(0)] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            result[i + j] += x * y
    return result


def add(a: Polynomial, b: Polynomial, scale: int = 1) -> Polynomial:
    n = max(len(a), len(b))
    a, b = a + [Fraction(0)] * (n - len(a)), b + [Fraction(0)] * (n - len(b))
    return [x + scale * y for x, y in zip(a, b, strict=True)]


def sign_changes(p: Polynomial, low: Fraction, high: Fraction) -> list[Fraction]:
    """Places in [low, high] where p changes sign or is found to be 0, within ``PRECISION``."""
    if len(p) == 1:
        return []
    derivative = [k * c for k, c in enumerate(p)][1:]
    stops = sorted({low, high, *sign_changes(derivative, low, high)})
    found = {stop for stop in stops if value(p, stop) == 0}
    for a, b in pairwise(stops):
        if value(p, a) * value(p, b) < 0:
            rising = value(p, b) > 0
            while b - a > PRECISION:
                middle = (a + b) / 2
                if (value(p, middle) < 0) == rising:
                    a = middle
                else:
                    b = middle
            found.add((a + b) / 2)
    return sorted(found)


def covered(
    points: np.ndarray, x: float, y: float, single_sided: bool = False
) -> list[tuple[Fraction, Fraction, int]]:
    """Local times (t0, t1, side) at which ``points`` ``(2, 3, 3)`` cover the sample (x, y).

    ``side`` is the sign of the edge functions, -1 for the front.
    """
    vertices = [_shifted(points[:, k], Fraction(x), Fraction(y)) for k in range(3)]
    pairs = [(vertices[(k + 1) % 3], vertices[(k + 2) % 3]) for k in range(3)]
    decided = [
        next((p for p in (_cross(a, b, i, j) for i, j in ((0, 1), (1, 2), (2, 0))) if any(p)), [0])
        for a, b in pairs
    ]
    d, total = _depth(points, Fraction(x), Fraction(y))
    stops = {Fraction(0), Fraction(1)}
    for p in (*decided, d):
        stops.update(sign_changes([Fraction(c) for c in p], Fraction(0), Fraction(1)))
    found: list[tuple[Fraction, Fraction, int]] = []
    for low, high in pairwise(sorted(stops)):
        middle = (low + high) / 2
        signs = {(v > 0) - (v < 0) for v in (value(p, middle) for p in decided)}
        side = signs.pop()
        ahead = value(d, middle) * value(total, middle) > 0
        if signs or not side or not ahead or (single_sided and side > 0):
            continue
        if found and found[-1][1] == low and found[-1][2] == side:
            found[-1] = (found[-1][0], high, side)
        else:
            found.append((low, high, side))
    return found


def depth_crossings(a: np.ndarray, b: np.ndarray, x: float, y: float) -> list[Fraction]:
    """Local times in [0, 1] at which two paths ``(2, 3, 3)`` are equally deep on the sample.

    Roots of d_a E_b - d_b E_a, wherever the paths are; whether they cover it is not asked.
    """
    (d_a, e_a), (d_b, e_b) = (_depth(points, Fraction(x), Fraction(y)) for points in (a, b))
    return sign_changes(add(multiply(d_a, e_b), multiply(d_b, e_a), -1), Fraction(0), Fraction(1))


def _depth(points: np.ndarray, x: Fraction, y: Fraction) -> tuple[Polynomial, Polynomial]:
    """d = sum e_i w_i and E = sum e_i; the depth is d / E."""
    vertices = [_shifted(points[:, k], x, y) for k in range(3)]
    d, total = [Fraction(0)], [Fraction(0)]
    for k, vertex in enumerate(vertices):
        e = _cross(vertices[(k + 1) % 3], vertices[(k + 2) % 3], 0, 1)
        d, total = add(d, multiply(e, vertex[2])), add(total, e)
    return d, total


def _shifted(ends: np.ndarray, x: Fraction, y: Fraction) -> list[Polynomial]:
    """The vertex's x, y and w relative to the sample, linear polynomials."""
    first, last = ([Fraction(float(c)) for c in end] for end in ends)
    first, last = ([p[0] - x * p[2], p[1] - y * p[2], p[2]] for p in (first, last))
    return [[a, b - a] for a, b in zip(first, last, strict=True)]


def _cross(a: list[Polynomial], b: list[Polynomial], i: int, j: int) -> Polynomial:
    return add(multiply(a[i], b[j]), multiply(a[j], b[i]), -1)
