"""Stage "nearest": the nearest of what rests at every sample, against each triangle alone."""

from __future__ import annotations

import numpy as np
import pytest
from reference.rays import see, see_nudged
from support.kernels import options, run, slots_at
from support.stage_triangles import TILE, Triangles, draw, nearest_of, tables

from mbinterval.device import records

COUNT = 256
OFFSETS = np.array([[0.5, 0.5], [0.0, 0.0], [0.25, 0.75], [1.0 - 2.0**-24, 0.03125]])
"""Places of four samples of a pixel."""

CORNERS = [(0, 0), (256, 16), (4080, 2160), (16368, 0)]


def shapes_of(of: Triangles) -> np.ndarray:
    vertices, paths, meshes, materials = tables(of)
    made = [np.zeros(len(paths), record) for record in (records.SHAPE, records.DEPTH)]
    given = [vertices, paths, np.uint32(len(paths)), meshes, materials, *made]
    return run("analytic/paths.cl", "paths", given, options("EXACT"), -(-len(paths) // 256))[-2]


def seen(of: Triangles, corner: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Path ``(layers * 256,)`` at each sample, -1 for none, and its depth."""
    vertices, paths, meshes, materials = tables(of)
    shapes = shapes_of(of)
    # Stage "paths" leaves out what turns its back; this stage must see that for itself.
    kept = np.flatnonzero((shapes["flags"] & 1 == 0) | (of.points[:, 0, :, 2] > 0).all(axis=1))
    members = kept[np.lexsort((-kept, shapes["near"][kept]))].astype(np.uint32)
    samples = len(OFFSETS) * TILE * TILE
    arrays = [
        vertices, paths, shapes, meshes, materials, slots_at(OFFSETS), members,
        np.uint32(len(members)), *np.int32(corner), np.zeros(samples), np.zeros(samples, np.uint32),
    ]  # fmt: skip
    defines = options("STATIC", "SINGLE_SIDED", LAYERS=len(OFFSETS), TILE=TILE, MASK_BITS=None)
    *_, depth, part = run("nearest.cl", "nearest_tile", arrays, defines)
    path = (part >> records.PART_BITS).astype(int)
    return np.where(np.isfinite(depth), path, -1), depth


def samples_at(corner: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Places of the tile's samples, as float32 has them."""
    row, column = np.divmod(np.arange(TILE * TILE), TILE)
    places = [
        (np.float32(c) + whole.astype(np.float32)) + offset.astype(np.float32)
        for c, whole, offset in zip(corner, (column, row), OFFSETS.T[:, :, None], strict=True)
    ]
    return tuple(place.astype(np.float64).ravel() for place in places)


@pytest.mark.parametrize("corner", CORNERS)
def test_samples_see_the_nearest_that_covers_them(corner):
    of = draw(corner[0] + 1, COUNT, corner, rests=True)
    ours, depth = seen(of, corner)
    x, y = samples_at(corner)
    path, w, sure = nearest_of(of, x, y, np.zeros(len(x)))
    assert np.mean(sure) > 0.8
    assert np.array_equal((ours >= 0)[sure], (path >= 0)[sure])
    hit = np.flatnonzero(sure & (path >= 0))
    assert depth[hit] == pytest.approx(w[hit], rel=1e-6)
    # Where two are equally near, as far as rounding goes, either is seen.
    own, own_seen, _ = of.seen(ours[hit], x[hit], y[hit], np.zeros(len(hit)))
    assert np.all(own_seen)
    assert own == pytest.approx(w[hit], rel=1e-6)
    assert np.mean(ours[hit] == path[hit]) > 0.99
    assert np.array_equal(of.first[ours[hit]], ours[hit])
    assert len(np.unique(ours[hit])) > 5


def test_samples_on_edges_and_corners_belong_to_the_side_right_of_and_below_them():
    """One triangle of whole numbers at a time, and samples on whole numbers."""
    rng = np.random.default_rng(5)
    hits = misses = 0
    x, y = np.tile(np.indices((TILE, TILE))[::-1].reshape(2, -1), len(OFFSETS)).astype(float)
    layer = np.repeat(np.arange(len(OFFSETS)), TILE * TILE) == 1  # at (0, 0)
    for _ in range(40):
        corners = rng.integers(1, TILE - 1, (1, 1, 3, 2)).astype(float)
        w = 2.0 ** rng.integers(-1, 2, (1, 1, 3))
        points = np.concatenate([corners * w[..., None], w[..., None]], axis=-1)
        points = np.repeat(points, 2, axis=1)
        of = Triangles(points, np.array([[0.0, 1.0]]), np.array([False]), np.array([0]))
        if np.linalg.det(points[0, 0]) == 0.0:
            continue
        ours, _ = seen(of, (0, 0))
        now = np.repeat(points[:, 0], len(x), axis=0)
        _, there, sure = see_nudged(now, x, y)
        on = layer & sure & (np.abs(see(now, x, y)[1]) < 1e-12).any(axis=1)
        assert np.array_equal((ours >= 0)[on], there[on])
        hits, misses = hits + np.count_nonzero(on & there), misses + np.count_nonzero(on & ~there)
    assert min(hits, misses) > 50
