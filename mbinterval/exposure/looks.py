"""Times at which a motion is looked at, so that chords can be held against it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mbinterval.exposure.shutter_times import Stretch, Window

Float64 = NDArray[np.float64]
Bools = NDArray[np.bool_]

_MOST = 16384
"""Times in a stretch, at most: who moves so often is past any number of knots."""


class Looked(Protocol):
    """What tells at which frames it has to be looked at (`mbinterval.scene.transforms.Mover`)."""

    def keys(self, first: float, last: float) -> Float64:
        """Frames at which the motion may bend."""

    def samples(self, first: float, last: float) -> Float64:
        """Frames that tell the motion between them, keys among them."""


def look_times(
    window: Window,
    stretch: Stretch,
    movers: Iterable[Looked],
    scale: float,
    bends: Iterable[float],
    others: Iterable[float],
    least: int,
) -> tuple[Float64, Bools]:
    """Return times of the shutter in ``stretch``, ascending, and whether motion may bend there.

    Times are such as float32 holds, as the kernels have them. ``movers`` have a shutter of
    their own, so many times as long. What else moves may bend at ``bends``; ``others`` are among
    the times too. There are ``least`` at least, and one between any two bends.
    """
    first, last = np.sort(window.frames(np.array([0.0, 1.0]), scale))
    keys, found = [np.asarray(list(bends))], [np.asarray(list(others))]
    for mover in movers:
        keys.append(window.times(mover.keys(first, last), scale))
        found.append(window.times(mover.samples(first, last), scale))
    corners = _in(stretch, keys)
    times = _in(stretch, [corners, *found, stretch.at(np.linspace(0.0, 1.0, least))])
    if len(times) > _MOST:
        times = np.union1d(times[:: len(times) // _MOST + 1], times[[0, -1]])
    ends = np.union1d(np.intersect1d(corners, times), times[[0, -1]])
    lone = np.diff(np.searchsorted(times, ends)) == 1
    times = np.union1d(times, _rounded(0.5 * (ends[:-1] + ends[1:])[lone]))
    return times, np.isin(times, corners)


_FINE = 64.0
"""Samples are as near to each other as leaves so small a part of the limit between them."""


def finer(times: Float64, between: Float64, limit: float) -> Float64:
    """Return ``times`` with others between them, where motion is off by too much of ``limit``.

    ``between`` ``(S-1,)`` is what motion may be off from each time to the next.
    """
    parts = np.ceil(np.sqrt(_FINE * between / limit))
    parts = np.clip(parts, 1, max(_MOST // len(times), 1)).astype(int)
    if (parts == 1).all():
        return times
    steps = np.concatenate([np.arange(count) / count for count in parts])
    starts, lengths = np.repeat(times[:-1], parts), np.repeat(np.diff(times), parts)
    return np.union1d(times, _rounded(starts + steps * lengths))


def _in(stretch: Stretch, parts: Iterable[Float64]) -> Float64:
    """All times of ``parts`` in the stretch, rounded, and its ends."""
    times = _rounded(np.concatenate([[stretch.open, stretch.close], *parts]))
    return np.unique(times[(times >= stretch.open) & (times <= stretch.close)])


def _rounded(times: Float64) -> Float64:
    return np.asarray(times, np.float32).astype(np.float64)
