"""Stage "bin" of point sampling: tiles list what is seen in them, through any point of the lens."""

from __future__ import annotations

import numpy as np
import pytest
from reference.rays import at_time
from support.kernels import options, run
from support.stage_triangles import Triangles, bounds_of, circles, draw, points_on, tables

from mbinterval.device import records
from mbinterval.rendering.shared_steps import list_grid

COUNT = 1024
TILE, EDGE = 16, 8
"""Pixels of a tile, and tiles along an edge of the frame."""

CORNERS = [(0, 0), (2000, 1072)]


def listed(of: Triangles, circle: np.ndarray, corner: tuple[int, int], chunk: int) -> np.ndarray:
    """Whether each tile ``(64,)`` lists each path; in the order given."""
    vertices, paths, meshes, _ = tables(of)
    vertices["circle"] = circle.swapaxes(0, 1).ravel()
    count, tiles, chunks = len(paths), EDGE * EDGE, -(-len(paths) // chunk)
    order = np.random.default_rng(3).permutation(count).astype(np.uint32)
    grid = list_grid((*corner, EDGE, EDGE), TILE, count, chunk, (0.0, 1.0, 0.0, 1.0))
    given = [vertices, paths, bounds_of(of, circle), meshes, np.zeros(1, records.CAMERA), order,
             grid]  # fmt: skip
    counts = np.zeros(tiles * chunks, np.uint32)
    file, defines = "stochastic/bin.cl", options("LENS", TILE=None, LAYERS=None, MASK_BITS=None)
    counts = run(file, "bin_count", [*given, counts], defines, chunks)[-1]
    scan = [np.uint32(tiles), np.uint32(chunks), counts, np.zeros(tiles + 1, np.uint32)]
    counts, starts = run("shared/scan.cl", "bin_scan", scan)
    entries = np.zeros(starts[-1], np.uint32)
    entries = run(file, "bin_file", [*given, counts, entries], defines, chunks)[-1]
    place = np.argsort(order)
    result = np.zeros((tiles, count), bool)
    for tile, members in enumerate(np.split(entries, starts[1:-1])):
        assert np.all(np.diff(place[members]) > 0)
        result[tile, members] = True
    return result


@pytest.mark.parametrize("corner", CORNERS)
def test_tiles_list_all_that_is_seen_in_them(corner):
    of = draw(corner[0] + 9, COUNT, (corner[0] + 56, corner[1] + 56), segments=True)
    circle = circles(of, 1)
    found = listed(of, circle, corner, 100)
    path, tau, share = points_on(of, 2)
    now = at_time(of.points[path], tau)
    x, y, w = np.einsum("mv,mva->am", share, now)
    part = tau[:, None]
    blur = (share * ((1 - part) * circle[path, 0] + part * circle[path, 1])).sum(axis=1)
    rng = np.random.default_rng(2)
    angle, far = rng.uniform(0, 2 * np.pi, len(path)), rng.choice([0.0, 0.7, 1.0], len(path))
    ahead = w > 1e-9
    place = np.stack([x + far * np.cos(angle) * blur, y + far * np.sin(angle) * blur])
    column, row = np.floor((place / w - np.array(corner)[:, None]) / TILE)
    inside = ahead & (column >= 0) & (column < EDGE) & (row >= 0) & (row < EDGE)
    inside &= (bounds_of(of, circle)["flags"][path] & 1) == 0
    tile = (row * EDGE + column)[inside].astype(int)
    assert np.all(found[tile, path[inside]])
    touched = np.zeros_like(found)
    touched[tile, path[inside]] = True
    # Not by listing everything everywhere.
    close = (of.points[..., 2] > 0.1).all(axis=(1, 2))
    assert found[:, close].sum() < 6 * touched[:, close].sum()
    assert touched.sum() > 2000


def test_how_paths_are_shared_out_changes_nothing():
    of = draw(4, COUNT, (56, 56))
    circle = circles(of, 4)
    want = listed(of, circle, (0, 0), 64)
    for chunk in (1, 333, 5000):
        assert np.array_equal(listed(of, circle, (0, 0), chunk), want)
