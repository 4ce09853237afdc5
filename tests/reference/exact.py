"""When a moving triangle covers a sample, exactly: roots of time-dependent edge functions.

With vertices shifted to the sample and linear in tau, the edge through a and b is the quadratic
e(tau) = x_a y_b - x_b y_a with Bernstein coefficients [q_a q_b], ([q_a r_b] + [r_a q_b]) / 2 and
[r_a r_b], q at tau = 0 and r at tau = 1. A sample is covered while all three e have one sign and
d = sum e_i w_i has it too; then w = d / sum e_i > 0. Time is cut at every root of the e, and of
the cubic d where a vertex comes behind the eye, and each piece is judged in its middle. An e that
is 0 for all time is replaced by its derivative for a sample at (X + eps, Y + eps^2): shared edges
and vertices that rest on a sample belong to exactly one triangle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .bernstein import evaluate, product, quadratic_roots, restrict, roots
from .hits import Samples, shifted, static_intervals
from .paths import Intervals, Paths, concatenate

SHARE = 65536
"""Pairs of path and sample that are solved at once."""


@dataclass(frozen=True, eq=False)
class ExactIntervals(Intervals):
    """Intervals along which depth and attributes are the rational functions that they are."""

    paths: Paths
    x: np.ndarray
    y: np.ndarray

    @classmethod
    def of(cls, intervals: Intervals, paths: Paths, samples: Samples) -> ExactIntervals:
        """The same intervals, with what it takes to evaluate them."""
        values = (getattr(intervals, name) for name in Intervals.__dataclass_fields__)
        return cls(*values, paths, *samples.positions(intervals.sample))

    def weights(self, index: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Barycentric weights ``(M, 3)`` of the hits, and depths of the vertices ``(M, 3)``."""
        path = self.path[index]
        return weights(self.paths, path, self.x[index], self.y[index], self.paths.local(path, t))

    def depth(self, index: np.ndarray, t: np.ndarray) -> np.ndarray:
        """w = sum e_i w_i / sum e_i."""
        weight, w = self.weights(index, t)
        return (weight * w).sum(axis=1)

    def values(self, index: np.ndarray, t: np.ndarray) -> np.ndarray:
        """sum e_i a_i / sum e_i, the attributes a_i of the vertices being linear in time."""
        path = self.path[index]
        tau = self.paths.local(path, t)[:, None, None]
        first, last = self.paths.attributes[path].transpose(1, 0, 2, 3)
        weight, _ = self.weights(index, t)
        return np.einsum("mv,mva->ma", weight, (1.0 - tau) * first + tau * last)

    def crossings(self, i: np.ndarray, j: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Roots of d_i E_j - d_j E_i, of degree five, over the common time of i and j."""
        least, most = self._range()
        pair = np.flatnonzero((least[i] <= most[j]) & (least[j] <= most[i]))
        i, j = i[pair], j[pair]
        low = np.maximum(self.t[i, 0], self.t[j, 0])
        high = np.minimum(self.t[i, 1], self.t[j, 1])
        (d_i, e_i), (d_j, e_j) = self._fractions(i, low, high), self._fractions(j, low, high)
        c = product(d_i, e_j) - product(d_j, e_i)
        mixed = np.flatnonzero((c.min(axis=1) <= 0) & (c.max(axis=1) >= 0))
        root = roots(c[mixed])
        row, column = np.nonzero(~np.isnan(root))
        pair, low, high = pair[mixed[row]], low[mixed[row]], high[mixed[row]]
        return pair, low + root[row, column] * (high - low)

    def _range(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of the depth of each interval: those of the vertices at its ends."""
        tau = self.paths.local(self.path[:, None], self.t)[..., None]
        first, last = (self.paths.points[self.path, end, :, 2][:, None] for end in (0, 1))
        w = ((1.0 - tau) * first + tau * last).reshape(-1, 6)
        return w.min(axis=1), w.max(axis=1)

    def _fractions(
        self, index: np.ndarray, low: np.ndarray, high: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients of d ``(M, 4)`` and E ``(M, 3)`` over global times [low, high]."""
        path = self.path[index]
        low, high = self.paths.local(path, low), self.paths.local(path, high)
        v = shifted(self.paths.points[path], self.x[index], self.y[index])
        e = edges(v, 0, 1)
        return restrict(facing_sum(e, v), low, high), restrict(e.sum(axis=1), low, high)


def edges(v: np.ndarray, i: int, j: int) -> np.ndarray:
    """Coefficients ``(M, 3, 3)`` of a_i b_j - a_j b_i over the edge a b opposite each vertex.

    ``v`` is ``(M, 2, 3, 3)``: end, vertex, (x, y, w); columns 0, 1 give the edge functions.
    """

    def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return a[..., i] * b[..., j] - a[..., j] * b[..., i]

    a, b = np.roll(v, -1, axis=2), np.roll(v, -2, axis=2)
    middle = 0.5 * (cross(a[:, 0], b[:, 1]) + cross(a[:, 1], b[:, 0]))
    return np.stack([cross(a[:, 0], b[:, 0]), middle, cross(a[:, 1], b[:, 1])], axis=2)


def facing_sum(e: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Coefficients ``(M, 4)`` of d = sum e_i w_i."""
    return product(e, v[..., 2].transpose(0, 2, 1)).sum(axis=1)


def decided(e: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Edge coefficients with those that are 0 for all time replaced by the perturbation's."""
    for columns in ((1, 2), (2, 0)):
        zero = ~e.any(axis=2)
        if not zero.any():
            break
        e = np.where(zero[..., None], edges(v, *columns), e)
    return e


def weights(
    paths: Paths, path: np.ndarray, x: np.ndarray, y: np.ndarray, tau: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Barycentric weights ``(M, 3)`` at local times ``tau``, and w of the vertices ``(M, 3)``."""
    part = tau[:, None, None]
    v = (1.0 - part) * paths.points[path, 0] + part * paths.points[path, 1]
    v = shifted(v, x, y)
    a, b = np.roll(v, -1, axis=1), np.roll(v, -2, axis=1)
    e = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        return e / e.sum(axis=1, keepdims=True), v[..., 2]


def solve_pairs(
    paths: Paths, path: np.ndarray, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Local times ``(I, 2)`` at which each pair is covered, and the pair's index ``(I,)``.

    A change of orientation ends an interval; of single-sided paths only the front counts.
    """
    v = shifted(paths.points[path], x, y)
    e = decided(edges(v, 0, 1), v)
    one_sign = np.where((e > 0).all(axis=2), 1, 0) - np.where((e < 0).all(axis=2), 1, 0)
    outside = (one_sign == 1).any(axis=1) & (one_sign == -1).any(axis=1)
    outside |= paths.single_sided[path] & (one_sign == 1).any(axis=1)
    pair = np.flatnonzero(~outside)
    v, e = v[pair], e[pair]
    cuts = [quadratic_roots(e[:, side]) for side in range(3)]
    behind = (v[..., 2] <= 0).any(axis=(1, 2))
    if behind.any():
        through = np.full((len(v), 3), np.nan)
        through[behind] = roots(facing_sum(edges(v[behind], 0, 1), v[behind]))
        cuts.append(through)
    ends = np.broadcast_to([0.0, 1.0], (len(v), 2))
    cut = np.sort(np.nan_to_num(np.concatenate([*cuts, ends], axis=1), nan=1.0), axis=1)
    side = _side(e, v, 0.5 * (cut[:, 1:] + cut[:, :-1]))
    side *= (side < 0) | ~paths.single_sided[path[pair], None]
    row, piece = np.nonzero((side != 0) & (cut[:, 1:] > cut[:, :-1]))
    t = np.stack([cut[row, piece], cut[row, piece + 1]], axis=1)
    return _joined(t, pair[row], side[row, piece])


def _side(e: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Sign of the three edges where they agree and the hit is ahead of the eye, else 0."""
    signs = np.sign(evaluate(e[:, None], tau[..., None]))
    agree = (signs == signs[..., :1]).all(axis=2)
    true = edges(v, 0, 1)
    d, total = evaluate(facing_sum(true, v)[:, None], tau), evaluate(true.sum(1)[:, None], tau)
    return np.where(agree & (d * total > 0), signs[..., 0], 0.0)


def _joined(t: np.ndarray, pair: np.ndarray, side: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Join pieces that follow on each other with the same orientation."""
    if not len(pair):
        return t, pair
    follows = (pair[1:] == pair[:-1]) & (side[1:] == side[:-1]) & (t[1:, 0] == t[:-1, 1])
    first = np.flatnonzero(np.append(True, ~follows))
    last = np.append(first[1:], len(pair)) - 1
    return np.stack([t[first, 0], t[last, 1]], axis=1), pair[first]


def intervals(paths: Paths, samples: Samples) -> ExactIntervals:
    """Exact intervals of all paths, static ones by their nearest triangle alone."""
    moving = np.flatnonzero(paths.segments > 0)
    item, sample = samples.candidates(paths.points[moving].reshape(-1, 6, 3))
    order = np.lexsort((item, sample))
    path, sample = moving[item[order]], sample[order]
    x, y = samples.positions(sample)
    parts = []
    for begin in range(0, len(path), SHARE):
        share = slice(begin, begin + SHARE)
        tau, pair = solve_pairs(paths, path[share], x[share], y[share])
        parts.append((tau, pair + begin))
    tau = np.concatenate([part[0] for part in parts] or [np.zeros((0, 2))])
    pair = np.concatenate([part[1] for part in parts] or [np.zeros(0, dtype=np.int64)])
    path, sample, x, y = path[pair], sample[pair], x[pair], y[pair]
    found = Intervals(
        sample=sample,
        path=path,
        t=paths.time(path[:, None], tau),
        w=np.stack([_end_depth(paths, path, x, y, tau, end) for end in (0, 1)], axis=1),
        attributes=np.zeros((len(path), 2, paths.attributes.shape[-1])),
    )
    found = concatenate([found, static_intervals(paths, samples)])
    return ExactIntervals.of(found, paths, samples)


def _end_depth(
    paths: Paths, path: np.ndarray, x: np.ndarray, y: np.ndarray, tau: np.ndarray, end: int
) -> np.ndarray:
    """Depth at one end of intervals; just inside where the triangle is seen edge-on there."""
    weight, w = weights(paths, path, x, y, tau[:, end])
    inside = tau[:, end] + 1e-6 * (tau[:, 1 - end] - tau[:, end])
    nearby, near_w = weights(paths, path, x, y, inside)
    plain = np.isfinite(weight).all(axis=1, keepdims=True)
    return (np.where(plain, weight, nearby) * np.where(plain, w, near_w)).sum(axis=1)
