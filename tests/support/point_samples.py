"""Samples that the stochastic kernels draw, and pictures that the float64 twin makes of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from reference.paths import needs_attributes
from reference.point_samples import Drawn, nearest_paths

from mbinterval.exposure.exposure import Exposure
from mbinterval.plan.plan import sampling_numbers, shutter_keys
from mbinterval.plan.sampling import filter_of, sample_count, slots_of
from support.kernels import numbers, run

TILE = 16


def drawn_in_tile(plan: Any, exposure: Exposure, x: int, y: int) -> Drawn:
    """All samples of the tile at pixel (x, y): each array ``(N, 16, 16)``, row by row of pixels."""
    count = sample_count(plan.settings)
    shape = filter_of(plan.settings)
    table = np.zeros(1) if shape is None else shape.table
    arrays = [np.zeros(count * TILE * TILE, np.float32) for _ in range(6)]
    given = [slots_of(plan.settings), table.astype(np.float32), shutter_keys(exposure.shutter)]
    sampled = sampling_numbers(exposure, plan.settings, plan.width, plan.height)
    told = [numbers(**dict(plan.numbers) | sampled | {"layers": count}), np.int32(x), np.int32(y)]
    owners = np.zeros(count * TILE * TILE, np.uint32)
    options = [*plan.options, "-DMOST_SLABS=1024"]
    found = run("scatter.cl", "scatter_tile", [*given, *told, *arrays, owners], options)
    xs, ys, ts, us, vs = (by_pixel(values) for values in found[3:8])
    return Drawn(xs + (x + 8.0), ys + (y + 8.0), ts, us, vs)


def by_pixel(values: np.ndarray) -> np.ndarray:
    """From blocks of 4 x 4 pixels, the kernels' order, to ``(N, 16, 16)`` float64."""
    blocks = values.astype(np.float64).reshape(-1, 4, 4, 4, 4)
    return blocks.transpose(0, 1, 3, 2, 4).reshape(-1, TILE, TILE)


def drawn_in_frame(plan: Any, exposure: Exposure, width: int, height: int) -> Drawn:
    """All samples of a frame, each array ``(N, height, width)``."""
    rows = []
    for y in range(0, height, TILE):
        tiles = [drawn_in_tile(plan, exposure, x, y) for x in range(0, width, TILE)]
        rows.append([np.concatenate(part, axis=2) for part in zip(*tiles, strict=True)])
    whole = [np.concatenate(part, axis=1) for part in zip(*rows, strict=True)]
    return Drawn(*(part[:, :height, :width] for part in whole))


def twin_film(plan: Any, exposure: Exposure, width: int, height: int) -> tuple[np.ndarray, Drawn]:
    """RGBA ``(H, W, 4)`` of unlit, untextured paths by brute force in float64, and the samples."""
    assert not any(map(needs_attributes, exposure.meshes))
    drawn = drawn_in_frame(plan, exposure, width, height)
    path, colors, _ = nearest_paths(exposure, width, height, drawn)
    seen = path >= 0
    color = np.where(seen[..., None], colors[path], 0.0).mean(axis=0)
    alpha = seen.mean(axis=0)[..., None]
    rgb = color + (1.0 - alpha) * np.asarray(exposure.background, dtype=np.float64)
    return np.concatenate([rgb, alpha], axis=-1), drawn
