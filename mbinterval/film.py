"""The result of a render: pixels, per-pixel measures, timings, and how they are written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Film:
    """A rendered frame, or a crop of one.

    Attributes
    ----------
    rgba
        ``(H, W, 4)`` float32, scene-linear, premultiplied; alpha is coverage over pixel and
        shutter. Colour lies over the background unless it was rendered ``transparent``.
    depth
        ``(H, W)`` float32: mean distance along the view axis of what is visible, weighted by
        coverage; infinity where nothing is.
    intervals
        ``(H, W)`` uint32: time intervals met in the pixel, summed over its samples.
    timings
        Seconds by stage, in the order in which the stages run. Not written to files.
    resolution
        Width and height of the whole frame in pixels.
    origin
        Column and row of the film's first pixel in the whole frame.
    metadata
        What is written into files: frame, shutter, camera, settings, version.
    """

    rgba: NDArray[np.float32]
    depth: NDArray[np.float32]
    intervals: NDArray[np.uint32]
    timings: Mapping[str, float]
    resolution: tuple[int, int]
    origin: tuple[int, int] = (0, 0)
    metadata: Mapping[str, str | int | float | tuple[float, ...]] = field(default_factory=dict)

    def write(self, path: str | Path) -> Path:
        """Write an EXR or a PNG, by the ending of ``path``; all of it or nothing."""
        raise NotImplementedError
