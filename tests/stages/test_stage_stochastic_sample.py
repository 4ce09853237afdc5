"""Stage "sample": which path each point sample sees, with the culling methods, path by path."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from reference.rays import is_front, see
from support.kernels import POINT_SIZES, numbers, options, run
from support.nightly import nightly_but
from support.stage_triangles import TILE, Triangles, bounds_of, circles, draw, tables

from mbinterval.device import records

COUNT, SLABS = 192, 4
SAMPLES = SLABS * TILE * TILE
CULLS = ["bbox", "hull", "obb", "pixar", "dual_space", "clip_space", "trim", "zmax", "zmax_strata",
         "zmin", "zmin_strata", "best"]  # fmt: skip
SIZES = {**POINT_SIZES, "STRATA": 2 * 2 * 4}
CORNERS = [(0, 0), (2000, 1072)]
NUDGE = 4e-3
"""Pixels by which a sample may move without a change, where what it sees is sure; float32."""


def samples(seed: int) -> np.ndarray:
    """x and y from the tile's middle, t, u, v ``(5, slabs, 16, 16)``, float32; by blocks of 4."""
    rng = np.random.default_rng(seed)
    block, lane = np.indices((16, 16))
    x = block % 4 * 4 + lane % 4 - 8.0
    y = block // 4 * 4 + lane // 4 - 8.0
    inside = rng.choice([0.0, 0.5, 0.96875], (2, SLABS, 16, 16))
    inside = np.where(rng.random(inside.shape) < 2 / 3, inside, rng.random(inside.shape))
    # Slabs are stretches of the shutter.
    t = rng.choice([0.0, 0.25, 0.999], (SLABS, 16, 16))
    t = np.where(rng.random(t.shape) < 2 / 3, t, rng.random(t.shape))
    t = (np.arange(SLABS)[:, None, None] + t) / SLABS
    radius, angle = rng.choice([0.0, 1.0, 0.6], t.shape), rng.uniform(0, 2 * np.pi, t.shape)
    lens = radius * np.cos(angle), radius * np.sin(angle)
    return np.stack([x + inside[0], y + inside[1], t, *lens]).astype(np.float32)


def sampled(
    of: Triangles, circle: np.ndarray, corner: tuple[int, int], drawn: np.ndarray, cull: str
) -> tuple[np.ndarray, np.ndarray]:
    """Path ``(samples,)`` that each sample sees, -1 for none, and its depth."""
    vertices, paths, meshes, materials = tables(of)
    vertices["circle"] = circle.swapaxes(0, 1).ravel()
    bounds = bounds_of(of, circle)
    kept = np.flatnonzero(bounds["flags"] & 1 == 0)
    members = kept[np.lexsort((-kept, bounds["near"][kept]))].astype(np.uint32)
    ends = [f(axis=(2, 3)) for f in (drawn[2:].min, drawn[2:].max)]
    bound = np.stack(ends, axis=-1).transpose(1, 0, 2).astype(np.float32)
    told = numbers(samples=SLABS, layers=SLABS, width=4096, height=2160, seed=1, reach_high=1.0,
                   strata_lens=2, strata_time=4)  # fmt: skip
    arrays = [told, vertices, paths, bounds, meshes, materials, members, np.uint32(len(members)),
              *np.int32(corner), bound, *drawn, np.full(SAMPLES, np.inf, np.float32),
              np.full(SAMPLES, records.NONE, np.uint32)]  # fmt: skip
    defines = options("STOCHASTIC", "MOVING", "LENS", "SINGLE_SIDED", "PATTERN_SOBOL", "REORDERED",
                      f"CULL_{cull.upper()}", **SIZES)  # fmt: skip
    *_, depth, owner = run("sample.cl", "sample_tile", arrays, defines)
    return np.where(owner == records.NONE, -1, owner.astype(np.int64)), depth


def truth(
    of: Triangles, circle: np.ndarray, corner: tuple[int, int], drawn: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same in float64, each triangle by itself, and whether it is sure."""
    x, y, t, u, v = (part.ravel().astype(np.float64) for part in drawn)
    x, y = x + (corner[0] + 8), y + (corner[1] + 8)
    best, depth, doubt = np.full(len(x), -1), np.full(len(x), np.inf), np.full(len(x), np.inf)
    for path in range(len(of.points)):
        low, high = of.window[path]
        there = np.flatnonzero((low <= t) & ((t < high) | (high >= 1.0)))
        part = ((t[there] - low) / (high - low))[:, None, None]
        now = (1 - part) * of.points[path, 0] + part * of.points[path, 1]
        blur = (1 - part[..., 0]) * circle[path, 0] + part[..., 0] * circle[path, 1]
        now[..., 0] += u[there, None] * blur
        now[..., 1] += v[there, None] * blur
        seen, answers = [], []
        for dx, dy in ((0, 0), (NUDGE, 0), (-NUDGE, 0), (0, NUDGE), (0, -NUDGE)):
            w, _, hit = see(now, x[there] + dx, y[there] + dy)
            answers.append(np.where(hit & (is_front(now) | ~of.single_sided[path]), w, np.inf))
        seen = np.stack(answers)
        w = seen[0]
        least = seen.min(axis=0)
        sure = np.isinf(seen).all(axis=0) | (np.ptp(np.where(np.isinf(seen), 1e9, seen), axis=0)
                                             < 1e-2 * np.abs(w))  # fmt: skip
        doubt[there] = np.where(sure, doubt[there], np.minimum(doubt[there], least))
        nearer = w < depth[there]
        best[there] = np.where(nearer, path, best[there])
        depth[there] = np.where(nearer, w, depth[there])
    return best, depth, doubt > depth * 1.01


@lru_cache
def case(corner: tuple[int, int]) -> tuple:
    """Triangles, their circles, samples, and what these see."""
    of = draw(corner[0] + 3, COUNT, corner, segments=True)
    circle, drawn = 0.1 * circles(of, 3)[of.first], samples(corner[0])
    return of, circle, drawn, truth(of, circle, corner, drawn)


@pytest.mark.parametrize("cull", nightly_but(CULLS, "bbox", "best"))
@pytest.mark.parametrize("corner", CORNERS)
def test_samples_see_the_nearest_that_covers_them_at_their_time(corner, cull):
    of, circle, drawn, (path, w, sure) = case(corner)
    ours, depth = sampled(of, circle, corner, drawn, cull)
    assert np.mean(sure) > 0.7
    assert np.array_equal((ours >= 0)[sure], (path >= 0)[sure])
    hit = np.flatnonzero(sure & (path >= 0))
    assert depth[hit] == pytest.approx(w[hit], rel=1e-3)
    assert np.mean(ours[hit] == path[hit]) > 0.99
    assert np.array_equal(of.first[ours[hit]], ours[hit])
    assert len(np.unique(ours[hit])) > 5
    assert np.any(np.isin(ours[hit], of.first[of.first != np.arange(COUNT)]))  # of two the first
