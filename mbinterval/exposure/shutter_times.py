"""Times of one exposure: the shutter on the time line, and the stretches of it without a jump.

Something that jumps (a stepped key, a cut between cameras) or that appears or vanishes while the
shutter is open is exposed in stretches, each by itself, so that no motion segment leads over it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]

_NEAR = 1e-7
"""How far from a jump there is nothing of it, in frames: next to no motion, clear of rounding."""


@dataclass(frozen=True)
class Window:
    """The shutter on the time line: ``frame``, and ``open`` and ``close`` relative to it."""

    frame: float
    open: float
    close: float

    def frames(self, times: Float64, scale: float = 1.0) -> Float64:
        """Frames of ``times`` of the shutter, 0 where it opens and 1 where it closes.

        ``scale`` shortens or lengthens the shutter around the frame.
        """
        return np.asarray(self.frame + scale * (self.open + times * (self.close - self.open)))

    @property
    def instant(self) -> bool:
        """Whether the shutter is open for no time at all: all that it sees is one moment."""
        return self.open == self.close

    def times(self, frames: Float64, scale: float = 1.0) -> Float64:
        """Times of the shutter at which what is scaled so is at ``frames``."""
        length = self.close - self.open
        return np.asarray(((frames - self.frame) / scale - self.open) / length)

    def scaled(self, times: Float64, scale: float) -> Float64:
        """Times of the shutter at which something is evaluated whose shutter is scaled so."""
        length = self.close - self.open
        if self.instant:
            return times
        return np.asarray((scale * (self.open + times * length) - self.open) / length)

    def unscaled(self, times: Float64, scale: float) -> Float64:
        """Times of the shutter at which something whose shutter is scaled so is at ``times``."""
        length = self.close - self.open
        return np.asarray(((self.open + times * length) / scale - self.open) / length)

    def times_of(self, frames: Iterable[float], scale: float = 1.0) -> list[float]:
        """Times in [0, 1], ascending, at which what is scaled so is at one of ``frames``.

        They are rounded to float32, in which the kernels have them, so that none are too near.
        """
        if scale == 0.0 or self.instant:
            return []
        times = self.times(np.array(list(frames)), scale)
        times = np.unique(np.where(np.abs(times) < 1e-7, 0.0, times).astype(np.float32))
        return [float(time) for time in times if 0.0 <= time <= 1.0]


@dataclass(frozen=True)
class Stretch:
    """A part of the shutter, from ``open`` to ``close`` in [0, 1], in which nothing jumps.

    ``after`` and ``before`` say that something jumps at its beginning and at its end.
    """

    open: float = 0.0
    close: float = 1.0
    after: bool = False
    before: bool = False

    def ends(self, segments: int) -> Float64:
        """``(segments + 1,)`` times of the shutter at the ends of equal motion segments."""
        return self.at(np.arange(segments + 1) / segments)

    def knots(self, segments: int) -> Float64:
        """``(segments + 1,)``: `ends`, such as float32 holds, as the kernels have them."""
        return self.ends(segments).astype(np.float32).astype(np.float64)

    def at(self, parts: Float64) -> Float64:
        """Times of the shutter at ``parts`` of the stretch, from 0 to 1."""
        if self == WHOLE:
            return parts
        return np.asarray(self.open + parts * (self.close - self.open))

    def inside(self, times: Float64, window: Window) -> Float64:
        """``times``, moved off the jumps at the ends, so that the stretch's own values are met."""
        length = window.close - window.open
        if window.instant:
            return times
        near = _NEAR * max(1.0, abs(window.frame), length) / length
        low = self.open + near if self.after else -np.inf
        return np.clip(times, low, self.close - near if self.before else np.inf)


WHOLE = Stretch()


def stretches(jumps: Iterable[float], visible: Iterable[tuple[float, float]]) -> list[Stretch]:
    """Stretches of the ``visible`` parts of the shutter between ``jumps``, all times in [0, 1]."""
    found = []
    cuts = sorted(set(jumps))
    for first, last in visible:
        inner = [cut for cut in cuts if first < cut < last]
        for open_, close in zip([first, *inner], [*inner, last], strict=True):
            found.append(Stretch(open_, close, open_ in cuts, close in cuts))
    return found
