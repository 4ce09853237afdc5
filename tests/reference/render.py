"""Whole images from the twin, in bands of rows; every method gives the same record."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from mbinterval.exposure.exposure import Exposure

from . import exact, triangulated
from .hits import Samples, static_intervals
from .paths import Intervals, Paths, concatenate, paths_of
from .samples import Grid
from .shading import Shader
from .visibility import Spans, limited, masked
from .visibility import exact as envelope

CENTRE = np.array([[0.5, 0.5]])
BAND = 16384
"""Samples that are worked on at once."""

Crop = tuple[int, int, int, int]


@dataclass(frozen=True, eq=False)
class Image:
    """A frame or a crop of it, float64.

    Attributes
    ----------
    rgba
        ``(H, W, 4)`` premultiplied, over the background; alpha is coverage.
    depth
        ``(H, W)`` mean of visible w, weighted by coverage; infinity where nothing is.
    intervals
        ``(H, W)`` intervals, static ones included, summed over the samples.
    """

    rgba: np.ndarray
    depth: np.ndarray
    intervals: np.ndarray


Solve = Callable[[Paths, Samples], tuple[Intervals, Spans]]
"""From paths and samples to all intervals and the visible spans."""

Shade = Callable[[Intervals, Spans, Grid], np.ndarray]
"""Average colour ``(J, 3)`` of each span."""


def triangulated_solver(
    paths: Paths, bits: int | None = 128, pairing: str = "time", max_intervals: int | None = None
) -> Solve:
    """Triangulated paths with a mask of ``bits`` bits; None decides visibility exactly in time.

    ``max_intervals`` applies to moving paths; the nearest static triangle is never lost.
    """
    shape = triangulated.surface(paths)

    def solve(paths: Paths, samples: Samples) -> tuple[Intervals, Spans]:
        found = triangulated.intervals(paths, samples, pairing, shape)
        found = limited(found, max_intervals)
        found = concatenate([found, static_intervals(paths, samples)])
        return found, envelope(found) if bits is None else masked(found, bits, samples.count)

    return solve


def exact_solver(bits: int | None = None) -> Solve:
    """Exact paths with exact visibility, or with a mask of ``bits`` bits."""

    def solve(paths: Paths, samples: Samples) -> tuple[Intervals, Spans]:
        found = exact.intervals(paths, samples)
        return found, envelope(found) if bits is None else masked(found, bits, samples.count)

    return solve


def render(
    exposure: Exposure,
    width: int,
    height: int,
    offsets: np.ndarray = CENTRE,
    crop: Crop | None = None,
    transparent: bool = False,
    paths: str = "triangulated",
    texture_samples: int = 16,
    **options: object,
) -> Image:
    """Render; ``options`` go to ``triangulated_solver``, or ``exact_solver`` (``bits``).

    ``offsets`` ``(N, 2)`` are the samples' places in each pixel, from its upper left corner;
    ``crop`` is x, y, width, height in pixels.
    """
    moving = paths_of(exposure, width, height)
    solve = (
        triangulated_solver(moving, **options)
        if paths == "triangulated"
        else exact_solver(**options)
    )
    background = background_of(exposure, (width, height), crop) * (not transparent)
    shade = Shader(exposure, moving, (width, height), texture_samples)
    return integrate(moving, solve, shade, (width, height), background, offsets, crop)


def background_of(exposure: Exposure, size: tuple[int, int], crop: Crop | None) -> np.ndarray:
    """Background colour ``(h, w, 3)`` of the pixels of ``crop``; an image must fit the frame."""
    x, y, width, height = crop or (0, 0, *size)
    value = np.asarray(exposure.background, dtype=np.float64)
    if value.ndim == 3 and value.shape[:2] != size[::-1]:
        raise ValueError(f"the twin takes a background image of the frame's size, {size}")
    return np.broadcast_to(value, (size[1], size[0], 3))[y : y + height, x : x + width]


def integrate(
    paths: Paths,
    solve: Solve,
    shade: Shade,
    size: tuple[int, int],
    background: np.ndarray,
    offsets: np.ndarray = CENTRE,
    crop: Crop | None = None,
) -> Image:
    """Mean over the samples of every pixel of sum(colour * weight) + background * free time."""
    x, y, width, height = crop or (0, 0, *size)
    total = np.zeros((height * width, 6))  # colour, coverage, coverage * depth, intervals
    rows = max(BAND // max(width, 1), 1)
    for offset in np.asarray(offsets, dtype=np.float64):
        parts: Iterable[Grid] = Grid(x, y, width, height, tuple(offset)).bands(rows)
        total += np.concatenate([_sums(paths, solve, shade, band) for band in parts])
    total = (total / [*[len(offsets)] * 5, 1]).reshape(height, width, 6)
    color, cover = total[..., :3], total[..., 3]
    color = color + background * (1.0 - cover[..., None])
    depth = np.where(cover > 0, total[..., 4] / np.where(cover > 0, cover, 1.0), np.inf)
    return Image(np.dstack([color, cover]), depth, np.rint(total[..., 5]).astype(np.int64))


def _sums(paths: Paths, solve: Solve, shade: Shade, grid: Grid) -> np.ndarray:
    intervals, spans = solve(paths, grid)
    sample = intervals.sample[spans.interval]
    w = intervals.mean_depth(spans.interval, spans.t)
    columns = [*shade(intervals, spans, grid).T, np.ones(len(sample)), w]
    sums = [np.bincount(sample, spans.weight * c, grid.count) for c in columns]
    sums.append(np.bincount(intervals.sample, minlength=grid.count).astype(np.float64))
    return np.stack(sums, axis=1)
