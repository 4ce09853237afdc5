"""Where a motion is cut into linear segments: its knots.

Between two knots what moves goes along a chord. *Deviation* is how far that is from the motion, in
pixels, at points that are followed through samples of it: times close enough that the motion from
one to the next is linear, or smooth and nearly a parabola. It is exact at the samples; between two
of them it can be more by what the second derivative allows, an eighth of the second difference.
Knots are samples: as few as keep the deviation within a limit, at uneven times, each as far from
the last as it can be.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Bools = NDArray[np.bool_]

_SAME = 1e-6
"""Pixels off the chord below which a moment needs no knot of its own."""


Measure = Callable[[slice, Float64], Float64]
"""Of samples in a slice, and how far ``values`` are off there: pixels, one for each sample."""


@dataclass(frozen=True, eq=False)
class Followed:
    """A motion at samples of it.

    Attributes
    ----------
    times
        ``(S,)`` ascending.
    values
        ``(S, ...)``: what is linear in time along a chord.
    corners
        ``(S,)``: whether the motion may bend at the sample, at a key.
    measure
        Pixels that an error of the values makes.
    """

    times: Float64
    values: Float64
    corners: Bools
    measure: Measure

    def deviation(self, first: int, last: int) -> float:
        """Greatest deviation, in pixels and at samples, of the chord from ``first`` to ``last``."""
        inner = slice(first + 1, last)
        if inner.start == inner.stop:
            return 0.0
        return float(
            self.measure(inner, self.values[inner] - self._chord(first, inner, last)).max()
        )

    def off(self, first: int, sample: int, last: int) -> float:
        """Deviation of the chord from ``first`` to ``last`` at one ``sample``, in pixels."""
        here = slice(sample, sample + 1)
        return float(self.measure(here, self.values[here] - self._chord(first, here, last)).max())

    def _chord(self, first: int, inner: slice, last: int) -> Float64:
        times = self.times
        share = (times[inner] - times[first]) / (times[last] - times[first])
        share = share.reshape(-1, *(1,) * (self.values.ndim - 1))
        return np.asarray((1.0 - share) * self.values[first] + share * self.values[last])

    def between(self) -> Float64:
        """``(S - 1,)``: what the motion from each sample to the next may be off, in pixels."""
        steps = np.diff(self.times)
        found = np.zeros(len(steps))
        if len(steps) < 2:
            return found
        wide = steps.reshape(-1, *(1,) * (self.values.ndim - 1))
        bends = np.diff(np.diff(self.values, axis=0) / wide, axis=0) * 2.0 / (wide[1:] + wide[:-1])
        sizes = self.measure(slice(1, len(steps)), bends)
        sizes[self.corners[1:-1]] = 0.0  # no derivative there
        np.maximum(found[1:], sizes, out=found[1:])
        np.maximum(found[:-1], sizes, out=found[:-1])
        return np.asarray(found * steps**2 / 8.0)


@dataclass(frozen=True, eq=False)
class Chosen:
    """Knots, places ``(K+1,)`` among the samples, and the deviation that they leave, in pixels."""

    knots: NDArray[np.intp]
    deviation: float


def choose_knots(
    followed: Followed,
    fixed: Iterable[int],
    wanted: Iterable[int],
    limit: float,
    most: int,
    allowed: Callable[[int, int], bool] = lambda first, last: True,
) -> Chosen:
    """Choose the fewest knots that keep the deviation of ``followed`` within ``limit`` pixels.

    ``fixed`` samples are knots in any case, the first and the last among them. ``wanted`` ones are
    where the motion is to be met exactly: knots, unless they are on a chord. Where more than
    ``most`` segments would be needed, there are that many, and the deviation says what is left.
    A chord that is not ``allowed`` is as one that is off without end.
    """
    between = followed.between()

    def bound(first: int, last: int) -> float:
        if last > first + 1 and not allowed(first, last):
            return np.inf
        return followed.deviation(first, last) + float(between[first:last].max(initial=0.0))

    ends = sorted(set(fixed))
    knots = [ends[0]]
    for first, last in itertools.pairwise(ends):
        if len(knots) <= most:
            knots += _reach(bound, followed.times, first, last, limit, most)
        else:
            knots.append(last)
    if len(knots) - 1 > max(most, len(ends) - 1):
        knots = _equal(followed.times, ends, most)
    for sample in wanted:
        after = int(np.searchsorted(knots, sample))
        if knots[after] != sample and followed.off(knots[after - 1], sample, knots[after]) > _SAME:
            knots.insert(after, sample)
    left = max(map(bound, knots[:-1], knots[1:]), default=0.0)
    return Chosen(np.array(knots), left)


def _reach(
    bound: Callable[[int, int], float],
    times: Float64,
    first: int,
    last: int,
    limit: float,
    most: int,
) -> list[int]:
    """Knots after ``first`` up to ``last``: each as far as the limit allows, then spread evenly."""
    found: list[int] = []
    start, stride = first, 1
    while start < last and len(found) <= most:
        near, far = start + 1, last
        if bound(start, last) > limit:
            near, far = _bracket(bound, limit, start, stride, last)
            while far - near > 1:
                middle = (near + far) // 2
                near, far = (middle, far) if bound(start, middle) <= limit else (near, middle)
            far = near
        stride, start = far - start, far
        found.append(start)
    if found[-1] != last or len(found) < 2:
        return found
    even = _equal(times, [first, last], len(found))
    if len(even) == len(found) + 1 and max(map(bound, even[:-1], even[1:])) <= limit:
        return even[1:]
    return found


def _bracket(
    bound: Callable[[int, int], float], limit: float, start: int, stride: int, last: int
) -> tuple[int, int]:
    """A sample that the ``limit`` lets reach, or the next one, and a later one that it doesn't.

    The search begins a ``stride`` after ``start``: motion is much the same from knot to knot.
    """
    near, far = start + 1, min(start + stride, last)
    step = 1
    while far < last and bound(start, far) <= limit:
        near, far, step = far, min(far + step, last), 2 * step
    step = 1
    while far - step > near:
        if bound(start, far - step) <= limit:
            return far - step, far
        far, step = far - step, 2 * step
    return near, far


def _equal(times: Float64, ends: list[int], count: int) -> list[int]:
    """About ``count`` segments of equal length, and those that begin and end at ``ends``."""
    wanted = np.linspace(times[ends[0]], times[ends[-1]], count + 1)
    after = np.clip(np.searchsorted(times, wanted), 1, len(times) - 1)
    nearer = np.where(wanted - times[after - 1] < times[after] - wanted, after - 1, after)
    return sorted({int(place) for place in nearer} | set(ends))
