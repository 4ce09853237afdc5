"""Translucent scenes, by brute force: in every slab of time in which no order changes all that is
there is sorted by depth, and blended front to back down to the first that is opaque.

Slabs that follow each other and show the same are one, so that what varies over a surface is
evaluated at the same times as elsewhere: the middles of n equal parts.
"""

from __future__ import annotations

from itertools import groupby

import numpy as np

from mbinterval.exposure.exposure import Exposure

from . import exact
from .paths import Intervals, Paths, paths_of
from .render import BAND, CENTRE, Crop, Image, background_of
from .samples import Grid
from .shading import Shader
from .visibility import Spans, slabs


def stacks(intervals: Intervals, paths: Paths) -> tuple[Spans, np.ndarray]:
    """Spans of all layers, stack after stack and front to back, and where each stack begins."""
    index, slab, cut, w = slabs(intervals)
    order = np.lexsort((intervals.path[index], w, slab))
    layers: list[list[int]] = []
    ends: list[list[float]] = []
    before: tuple[float, list[int]] = (-1.0, [])
    for number, entries in groupby(order, key=lambda k: slab[k]):
        seen: list[int] = []
        for k in entries:
            seen.append(int(index[k]))
            if paths.opaque[intervals.path[index[k]]]:
                break
        if (cut[number], seen) == before:
            ends[-1][1] = cut[number + 1]
        else:
            layers.append(seen)
            ends.append([cut[number], cut[number + 1]])
        before = (cut[number + 1], seen)
    flat = np.array([k for seen in layers for k in seen], dtype=np.int64)
    sizes = np.array([len(seen) for seen in layers])
    t = np.repeat(np.array(ends).reshape(-1, 2), sizes, axis=0)
    return Spans(flat, t, t[:, 1] - t[:, 0]), np.cumsum(sizes) - sizes


def blend(
    shade: Shader, intervals: Intervals, spans: Spans, starts: np.ndarray, grid: Grid
) -> np.ndarray:
    """Average of each layer over its stack's time: what it adds of colour, alpha and depth.

    Depth is the mean depth times alpha, and what the places tell of how both change together.
    """
    count = len(spans.interval)
    result, by_rule = np.zeros((count, 5)), np.zeros(count)
    mesh = shade.paths.mesh[intervals.path[spans.interval]]
    places = (np.arange(shade.count) + 0.5) / shade.count
    first = np.repeat(starts, np.diff(np.append(starts, count)))
    for part in places:
        color, alpha = shade.paths.color[intervals.path[spans.interval]], np.ones(count)
        for number in np.unique(mesh):
            own = np.flatnonzero(mesh == number)
            one = Spans(spans.interval[own], spans.t[own], spans.weight[own])
            level = shade._level(number, intervals, one)
            if shade.paths.attributes.shape[-1]:
                color[own] = shade._at(number, intervals, one, part, level, grid, color[own])
            alpha[own] = shade.alpha_at(number, intervals, one, part, level)
        rest = np.ones(count)
        for k in range(1, count):
            rest[k] = 1.0 if first[k] == k else rest[k - 1] * (1.0 - alpha[k - 1])
        result[:, 3] += rest * alpha / shade.count
        result[:, :3] += (rest * alpha)[:, None] * color / shade.count
        w = intervals.depth(spans.interval, spans.t[:, 0] + part * np.diff(spans.t)[:, 0])
        result[:, 4] += rest * alpha * w / shade.count
        by_rule += w / shade.count
    mean = intervals.mean_depth(spans.interval, spans.t)
    result[:, 4] += result[:, 3] * (mean - by_rule)
    return result


def render_stacks(
    exposure: Exposure,
    width: int,
    height: int,
    offsets: np.ndarray = CENTRE,
    crop: Crop | None = None,
    texture_samples: int = 16,
) -> Image:
    """Render with exact paths; as ``render.render`` otherwise."""
    paths = paths_of(exposure, width, height)
    shade = Shader(exposure, paths, (width, height), texture_samples)
    background = background_of(exposure, (width, height), crop)
    x, y, columns, lines = crop or (0, 0, width, height)
    total = np.zeros((lines * columns, 6))
    for offset in np.asarray(offsets, dtype=np.float64):
        bands = Grid(x, y, columns, lines, tuple(offset)).bands(max(BAND // columns, 1))
        total += np.concatenate([_sums(paths, shade, band) for band in bands])
    total = (total / [*[len(offsets)] * 5, 1]).reshape(lines, columns, 6)
    cover = total[..., 3]
    color = total[..., :3] + background * (1.0 - cover[..., None])
    depth = np.where(cover > 0, total[..., 4] / np.where(cover > 0, cover, 1.0), np.inf)
    return Image(np.dstack([color, cover]), depth, np.rint(total[..., 5]).astype(np.int64))


def _sums(paths: Paths, shade: Shader, grid: Grid) -> np.ndarray:
    intervals = exact.intervals(paths, grid)
    if not len(intervals):
        return np.zeros((grid.count, 6))
    spans, starts = stacks(intervals, paths)
    parts = blend(shade, intervals, spans, starts, grid)
    sample = intervals.sample[spans.interval]
    sums = [np.bincount(sample, spans.weight * c, grid.count) for c in parts.T]
    sums.append(np.bincount(intervals.sample, minlength=grid.count).astype(np.float64))
    return np.stack(sums, axis=1)
