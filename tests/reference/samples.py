"""Where samples lie, and which items may cover which of them.

A *sample set* offers ``count``, ``positions(index) -> (X, Y)`` in pixels (x right, y down, centre
of pixel (i, j) at (i + 0.5, j + 0.5)), and ``candidates(points) -> (item, sample)``: flat arrays
of pairs that hold every pair that can be a hit. Candidates are conservative; whoever asks decides.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

SLACK = 1e-6
"""Pixels by which candidate rows and columns are widened; exact tests follow."""

NEAR = 1e-4
"""Points whose least w is below this part of their greatest are candidates everywhere."""


@dataclass(frozen=True)
class Points:
    """Arbitrary samples, ``xy`` of shape (S, 2); every item is a candidate at every sample."""

    xy: np.ndarray

    @property
    def count(self) -> int:
        return len(self.xy)

    def positions(self, sample: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.xy[sample, 0], self.xy[sample, 1]

    def candidates(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        item, sample = np.indices((len(points), len(self.xy))).reshape(2, -1)
        return item, sample


@dataclass(frozen=True)
class Grid:
    """One sample per pixel of a rectangle of pixels, at ``offset`` from each pixel's corner.

    Sample ``(j - y0) * width + (i - x0)`` lies at ``(i + offset[0], j + offset[1])``.
    """

    x0: int
    y0: int
    width: int
    height: int
    offset: tuple[float, float] = (0.5, 0.5)

    @property
    def count(self) -> int:
        return self.width * self.height

    def bands(self, rows: int) -> Iterator[Grid]:
        """Cut into bands of ``rows`` rows, from the top."""
        for y in range(self.y0, self.y0 + self.height, rows):
            height = min(rows, self.y0 + self.height - y)
            yield Grid(self.x0, y, self.width, height, self.offset)

    def positions(self, sample: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        row, column = np.divmod(sample, self.width)
        return self.x0 + column + self.offset[0], self.y0 + row + self.offset[1]

    def candidates(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pairs (item, sample) inside the screen hull of each item's points, ``(M, k, 3)``.

        The hull of points with w > 0 is cut by a row between the least and the greatest x at
        which the row meets a segment between any two of them. Items that come near w = 0 or
        behind it are candidates at every sample.
        """
        w = points[..., 2]
        size = np.abs(w).max(axis=1)
        finite = (w.min(axis=1) > NEAR * size) & (size > 0)
        ahead = np.flatnonzero(finite)
        near = np.flatnonzero(~finite & (w.max(axis=1) > 0))
        item, sample = self._walk(points[ahead, :, :2] / w[ahead, :, None])
        everywhere, anywhere = np.indices((len(near), self.count)).reshape(2, -1)
        item = np.concatenate([ahead[item], near[everywhere]])
        return item, np.concatenate([sample, anywhere])

    def _walk(self, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Row by row through the hulls of screen points ``(M, k, 2)``."""
        y = xy[..., 1]
        first, last = _lattice(y.min(1), y.max(1), self.y0 + self.offset[1], self.height)
        item, row = expand(first, last)
        low, high = _cut(xy[item], self.y0 + self.offset[1] + row)
        first, last = _lattice(low, high, self.x0 + self.offset[0], self.width)
        line, column = expand(first, last)
        return item[line], row[line] * self.width + column


def expand(first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All pairs (i, v) with first[i] <= v < last[i], as two flat arrays."""
    count = np.maximum(last - first, 0)
    owner = np.repeat(np.arange(len(count)), count)
    value = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count - first, count)
    return owner, value


def _lattice(
    low: np.ndarray, high: np.ndarray, origin: float, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Indices [first, last) of the points origin + i, i < count, within [low, high] + slack."""
    first = np.clip(np.ceil(low - origin - SLACK), 0, count).astype(np.int64)
    last = np.clip(np.floor(high - origin + SLACK) + 1, 0, count).astype(np.int64)
    return first, last


def _cut(xy: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest x at which each hull ``(R, k, 2)`` meets its row ``(R,)``."""
    low, high = np.full(len(xy), np.inf), np.full(len(xy), -np.inf)
    for p in range(xy.shape[1]):
        touches = np.abs(xy[:, p, 1] - height) <= SLACK
        low = np.where(touches, np.minimum(low, xy[:, p, 0]), low)
        high = np.where(touches, np.maximum(high, xy[:, p, 0]), high)
    for p, q in combinations(range(xy.shape[1]), 2):
        below, above = xy[:, p, 1] - height, xy[:, q, 1] - height
        crosses = (below < 0) != (above < 0)
        part = below / np.where(crosses, below - above, 1.0)
        x = xy[:, p, 0] + part * (xy[:, q, 0] - xy[:, p, 0])
        low = np.where(crosses, np.minimum(low, x), low)
        high = np.where(crosses, np.maximum(high, x), high)
    return np.where(low <= high, low, 1.0), np.where(low <= high, high, -1.0)
