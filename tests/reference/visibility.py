"""Which interval is seen when, decided directly and without sorting.

With a mask of n bits, bit i stands for [i/n, (i+1)/n) and is set in an interval when its centre
(i + 0.5)/n lies in [t0, t1); at each bit the interval of least depth at the bit's centre is seen,
ties by path index. Without a mask, time is cut at all ends of intervals and at all crossings of
two depths; between two cuts the order is constant, and is read off in the middle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .paths import Intervals
from .samples import expand


@dataclass(frozen=True, eq=False)
class Spans:
    """Visible pieces of intervals, sorted by sample and time.

    Attributes
    ----------
    interval
        ``(J,)`` index into the intervals that were given.
    t
        ``(J, 2)`` the time range of one contiguous run, within [t0, t1) of its interval.
    weight
        ``(J,)`` share of the shutter: bits / n, or the length of the range.
    """

    interval: np.ndarray
    t: np.ndarray
    weight: np.ndarray


def nearest(cell: np.ndarray, path: np.ndarray, w: np.ndarray, count: int) -> np.ndarray:
    """Index of the entry seen in each of ``count`` cells: least w, then least path; -1 if none."""
    least = np.full(count, np.inf)
    np.minimum.at(least, cell, w)
    front = np.flatnonzero(w == least[cell])
    front = front[np.lexsort((path[front], cell[front]))]
    front = front[np.diff(cell[front], prepend=-1) > 0]
    seen = np.full(count, -1)
    seen[cell[front]] = front
    return seen


def masked(intervals: Intervals, bits: int, samples: int) -> Spans:
    """Visible spans with a mask of ``bits`` bits; depth is linear along each interval."""
    first, last = (np.ceil(t * bits - 0.5).astype(np.int64) for t in intervals.t.T)
    index, bit = expand(first, last)
    w = intervals.depth(index, (bit + 0.5) / bits)
    cell = intervals.sample[index] * bits + bit
    seen = nearest(cell, intervals.path[index], w, samples * bits)
    grid = np.where(seen >= 0, index[seen], -1) if len(index) else seen
    grid = grid.reshape(samples, bits)
    ends = np.ones((samples, bits + 1), dtype=bool)
    ends[:, 1:-1] = grid[:, 1:] != grid[:, :-1]
    row, begin = np.nonzero(ends[:, :-1])
    _, end = np.nonzero(ends[:, 1:])
    owner = grid[row, begin]
    keep = owner >= 0
    owner, begin, end = owner[keep], begin[keep], end[keep] + 1
    t = np.stack([begin, end], axis=1) / bits
    t = np.clip(t, intervals.t[owner, :1], intervals.t[owner, 1:])
    return Spans(owner, t, (end - begin) / bits)


def limited(intervals: Intervals, count: int | None) -> Intervals:
    """The ``count`` intervals of least minimum depth on every sample; None keeps all.

    Ties go to the lower path index, then to the earlier start.
    """
    if count is None:
        return intervals
    least = intervals.w.min(axis=1)
    order = np.lexsort((intervals.t[:, 0], intervals.path, least, intervals.sample))
    sample = intervals.sample[order]
    begins = np.flatnonzero(np.diff(sample, prepend=-1))
    rank = np.arange(len(order)) - np.repeat(begins, np.diff(begins, append=len(order)))
    return intervals[np.sort(order[rank < count])]


def overlapping(intervals: Intervals) -> tuple[np.ndarray, np.ndarray]:
    """All pairs of intervals on one sample whose times overlap."""
    order = np.lexsort((intervals.t[:, 0], intervals.sample))
    key = 2.0 * intervals.sample[order] + intervals.t[order, 0]
    until = 2.0 * intervals.sample[order] + intervals.t[order, 1]
    last = np.searchsorted(key, until + 1e-9 * (1.0 + until))
    i, j = expand(np.arange(len(order)) + 1, last)
    i, j = order[i], order[j]
    overlap = np.minimum(intervals.t[i, 1], intervals.t[j, 1]) > intervals.t[j, 0]
    overlap &= intervals.sample[i] == intervals.sample[j]
    return i[overlap], j[overlap]


def exact(intervals: Intervals) -> Spans:
    """Visible spans, exact in time: the front envelope of all depths, by brute force.

    Depth is what the intervals say: linear, or rational for those of ``exact.py``. Neighbouring
    spans of one interval are joined.
    """
    if not len(intervals):
        return Spans(np.zeros(0, dtype=np.int64), np.zeros((0, 2)), np.zeros(0))
    index, slab, cut, w = slabs(intervals)
    seen = nearest(slab, intervals.path[index], w, len(cut))
    slab = np.flatnonzero(seen >= 0)
    owner = index[seen[slab]]
    new = (np.diff(owner, prepend=-1) != 0) | (np.diff(slab, prepend=-2) != 1)
    start = np.flatnonzero(new)
    stop = np.append(start[1:], len(slab)) - 1
    t = np.stack([cut[slab[start]], cut[slab[stop] + 1]], axis=1)
    return Spans(owner[start], t, t[:, 1] - t[:, 0])


def slabs(intervals: Intervals) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """All pairs of an interval and a slab of time that it covers, in which no depth order changes.

    Interval, slab, times between which each slab lies (``cut[s]`` and ``cut[s + 1]``), and depths
    in the slabs' middles.
    """
    i, j = overlapping(intervals)
    pair, time = intervals.crossings(i, j)
    sample, cut = _cuts(intervals, intervals.sample[i[pair]], time)
    # Slab s runs from cut s to cut s + 1; those between two samples are never asked for.
    begin = _find(sample, cut, intervals.sample, intervals.t[:, 0])
    end = _find(sample, cut, intervals.sample, intervals.t[:, 1])
    index, slab = expand(begin, end)
    return index, slab, cut, intervals.depth(index, 0.5 * (cut[slab] + cut[slab + 1]))


def _cuts(
    intervals: Intervals, sample: np.ndarray, time: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """All different times at which the order may change, sorted by sample and time."""
    sample = np.concatenate([intervals.sample, intervals.sample, sample])
    time = np.concatenate([intervals.t[:, 0], intervals.t[:, 1], time])
    order = np.lexsort((time, sample))
    sample, time = sample[order], time[order]
    new = (np.diff(sample, prepend=-1) != 0) | (np.diff(time, prepend=-1.0) != 0)
    return sample[new], time[new]


def _find(sample: np.ndarray, cut: np.ndarray, wanted: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Place of (wanted, time) among the cuts, in which it occurs."""
    every = np.concatenate([wanted, sample])
    order = np.lexsort((np.r_[np.ones(len(wanted)), np.zeros(len(cut))], np.r_[time, cut], every))
    place = np.cumsum(order >= len(wanted)) - 1
    result = np.empty(len(order), dtype=np.int64)
    result[order] = place
    return result[: len(wanted)]
