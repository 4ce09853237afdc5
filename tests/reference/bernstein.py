"""Polynomials on [0, 1] by their Bernstein coefficients ``(..., n + 1)``, in float64."""

from __future__ import annotations

from math import comb

import numpy as np


def evaluate(c: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Value at ``t``, by de Casteljau's algorithm; coefficients ``(..., n + 1)``, t ``(...)``."""
    t = np.asarray(t)[..., None]
    while c.shape[-1] > 1:
        c = (1.0 - t) * c[..., :-1] + t * c[..., 1:]
    return np.broadcast_to(c[..., 0], np.broadcast_shapes(c.shape[:-1], t.shape[:-1]))


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Coefficients of the product, of degree m + n."""
    m, n = a.shape[-1] - 1, b.shape[-1] - 1
    shape = (*np.broadcast_shapes(a.shape[:-1], b.shape[:-1]), m + n + 1)
    result = np.zeros(shape)
    for i in range(m + 1):
        for j in range(n + 1):
            scale = comb(m, i) * comb(n, j) / comb(m + n, i + j)
            result[..., i + j] += scale * a[..., i] * b[..., j]
    return result


def restrict(c: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Coefficients of c(low + s (high - low)), s in [0, 1]; low and high ``(...)``."""
    n = c.shape[-1] - 1
    ends = np.stack([low, high], axis=-1)
    columns = []
    for k in range(n + 1):  # blossom: n - k times low, k times high
        b = c
        for step in range(n):
            t = ends[..., 1 if step < k else 0, None]
            b = (1.0 - t) * b[..., :-1] + t * b[..., 1:]
        columns.append(b[..., 0])
    return np.stack(columns, axis=-1)


def roots(c: np.ndarray) -> np.ndarray:
    """Roots in [0, 1] of ``(M, n + 1)``, sorted, ``(M, n)``, the unused places filled with NaN.

    Between the roots of its derivative a polynomial is monotone: a piece whose ends differ in
    sign holds one root, which bisection finds to the last bit. A root where the sign does not
    change may or may not be reported, and a root between two pieces twice.
    """
    n = c.shape[-1] - 1
    if n == 0:
        return np.zeros((len(c), 0))
    turning = roots(n * np.diff(c, axis=-1))
    turning = np.sort(np.where(np.isnan(turning), 1.0, turning), axis=1)
    ends = np.concatenate([np.zeros((len(c), 1)), turning, np.ones((len(c), 1))], axis=1)
    value = evaluate(c[:, None], ends).copy()
    value[:, 0], value[:, -1] = c[:, 0], c[:, -1]
    crossing = (value[:, :-1] * np.sign(value[:, 1:]) <= 0) & (value[:, :-1] != value[:, 1:])
    row, piece = np.nonzero(crossing)
    result = np.full((len(c), n), np.nan)
    result[row, piece] = _bisect(
        c[row], ends[row, piece], ends[row, piece + 1], value[row, piece], value[row, piece + 1]
    )
    return np.sort(result, axis=1)


def _bisect(
    c: np.ndarray, low: np.ndarray, high: np.ndarray, first: np.ndarray, last: np.ndarray
) -> np.ndarray:
    """The root in each bracket [low, high], at whose ends c has the values first and last."""
    low, high = np.where(last == 0, high, low), np.where(first == 0, low, high)
    rising = (first < 0) | (last > 0)
    for _ in range(60):
        middle = 0.5 * (low + high)
        right = (evaluate(c, middle) < 0) == rising
        low, high = np.where(right, middle, low), np.where(right, high, middle)
    return 0.5 * (low + high)


def quadratic_roots(c: np.ndarray) -> np.ndarray:
    """Roots in [0, 1] of ``(M, 3)``, unsorted, ``(M, 2)``, NaN where none.

    Citardauq's form: of A t^2 + 2 B t + C with A = c0 - 2 c1 + c2, B = c1 - c0, C = c0 the
    roots are q / A and C / q with q = -(B + sign(B) sqrt(c1^2 - c0 c2)).
    """
    c0, c1, c2 = c.T
    inner = c1 * c1 - c0 * c2
    half = c1 - c0
    with np.errstate(divide="ignore", invalid="ignore"):
        q = -(half + np.copysign(np.sqrt(inner), half))
        result = np.stack([q / ((c0 - c1) + (c2 - c1)), c0 / q], axis=1)
        result[~((result >= 0) & (result <= 1))] = np.nan
    return result
