"""The accumulation buffer: point samples in time at the centres of n slices, and a z-buffer.

Within a motion segment vertices are linear in homogeneous pixel space, as for the other methods,
so that what differs from them is the sampling in time alone.
"""

from __future__ import annotations

import numpy as np

from mbinterval.exposure.exposure import Exposure

from .hits import Samples, barycentrics
from .paths import Paths, paths_of
from .render import CENTRE, Crop, Image, background_of
from .samples import Grid
from .visibility import nearest


def slice_hits(paths: Paths, samples: Samples, t: float) -> tuple[np.ndarray, np.ndarray]:
    """Path ``(S,)`` seen by each sample at global time ``t`` in [0, 1), -1 if none, and its w."""
    every = np.arange(len(paths))
    there = (paths.time(every, 0.0) <= t) & (t < paths.time(every, 1.0))
    now = np.flatnonzero(there | (paths.segments == 0))
    tau = paths.local(now, np.full(len(now), t))[:, None, None]
    points = (1.0 - tau) * paths.points[now, 0] + tau * paths.points[now, 1]
    front = ~paths.single_sided[now]
    front[~front] = np.linalg.det(points[~front]) < 0
    now, points = now[front], points[front]
    item, sample = samples.candidates(points)
    hit, _, w = barycentrics(points[item], *samples.positions(sample))
    path, sample = now[item[hit]], sample[hit]
    seen = nearest(sample, path, w, samples.count)
    if not len(path):
        return seen, np.full(samples.count, np.inf)
    return np.where(seen >= 0, path[seen], -1), np.where(seen >= 0, w[seen], np.inf)


def render(
    exposure: Exposure,
    width: int,
    height: int,
    slices: int,
    offsets: np.ndarray = CENTRE,
    crop: Crop | None = None,
) -> Image:
    """Mean of ``slices`` sharp images of flat colours, every one with all of ``offsets``."""
    paths = paths_of(exposure, width, height, attributes=False)
    x, y, columns, rows = crop or (0, 0, width, height)
    color = np.concatenate([paths.color, np.zeros((1, 3))])  # -1 finds the last row
    total = np.zeros((rows * columns, 5))
    for offset in np.asarray(offsets, dtype=np.float64):
        grid = Grid(x, y, columns, rows, tuple(offset))
        for index in range(slices):
            path, w = slice_hits(paths, grid, (index + 0.5) / slices)
            total[:, :3] += color[path]
            total[:, 3] += path >= 0
            total[:, 4] += np.where(path >= 0, w, 0.0)
    total = (total / (slices * len(offsets))).reshape(rows, columns, 5)
    cover = total[..., 3]
    background = background_of(exposure, (width, height), crop)
    rgb = total[..., :3] + background * (1.0 - cover[..., None])
    depth = np.where(cover > 0, total[..., 4] / np.where(cover > 0, cover, 1.0), np.inf)
    return Image(np.dstack([rgb, cover]), depth, np.zeros(cover.shape, dtype=np.int64))
