"""Stage "moment": what pixels' centres see at one moment, against each triangle alone."""

from __future__ import annotations

import numpy as np
import pytest
from reference.rays import is_front, see
from support.kernels import numbers, options, run
from support.stage_triangles import TILE, draw, nearest_of, tables

from mbinterval.device import records
from mbinterval.film.aovs import FLOWS, MACROS, MOMENTARY, plane_sizes, split_planes

COUNT = 256
CASES = [((0, 0), 0.0), ((256, 16), 0.25), ((2000, 1072), 0.3), ((48, 0), 1.0)]
"""Corners of tiles, and moments: also those at which a motion segment ends and the next begins."""


def flat_normal(corners: np.ndarray) -> np.ndarray:
    """Normals ``(M, 3)``, of any length, of triangles ``(M, 3, 3)``."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


@pytest.mark.parametrize(("corner", "moment"), CASES)
def test_the_layers_are_those_of_the_nearest_triangle_at_the_moment(corner, moment):
    of = draw(corner[0] + 5, COUNT, corner, segments=True)
    vertices, paths, meshes, materials = tables(of)
    rng = np.random.default_rng(corner[0])
    many = 3 * COUNT
    # Mesh 0 has normals and uv that change with time, mesh 1 neither.
    uv = rng.uniform(-4, 4, (2, many, 2)).astype(np.float32)
    normal = rng.normal(0, 1, (2, many, 3)).astype(np.float32)
    meshes["uv"][0], meshes["uv_step"][0] = 0, 1
    meshes["normal"][0], meshes["normal_step"][0] = 0, 1
    elsewhere = {
        name: np.column_stack([rng.uniform(-50, 50, (many, 2)), rng.uniform(0.1, 2, many)])
        for name in FLOWS
    }
    camera = np.zeros(2, records.CAMERA)
    camera["inverse"] = np.eye(3).ravel()  # the world is homogeneous pixel space
    low = of.points[..., 2].min(axis=(1, 2))
    shapes = np.zeros(COUNT, records.SHAPE)
    shapes["near"] = np.maximum(low, 0) * (1 - 1e-6)
    shapes["flags"] = np.where(low <= 0, 2, 0)
    x0, y0 = corner
    frame = records.pack("Frame", x=x0 + 3, y=y0, width=9, height=14, background=(0, 0, 0))
    row, column = np.divmod(np.arange(9 * 14), 9)
    told = numbers(moment=moment, samples=1, width=4096, height=2160)
    members = np.lexsort((-np.arange(COUNT), shapes["near"])).astype(np.uint32)
    sizes = plane_sizes(MOMENTARY)
    arrays = [
        told, frame, vertices, paths, shapes, meshes, materials, uv, normal, camera, members,
        np.uint32(COUNT), *np.int32(corner), *elsewhere.values(), np.zeros(TILE * TILE),
        np.zeros(TILE * TILE, np.uint32), np.zeros((sizes["PLANES"], 14, 9), np.uint32),
    ]  # fmt: skip
    asked = [MACROS[name] for name in MOMENTARY]
    effects = "MOVING", "EXACT", "MOMENTARY", "SINGLE_SIDED", "FACES_TURN", *asked
    planes = run("moment.cl", "moment_tile", arrays, options(*effects, MASK_BITS=None, **sizes))[-1]
    found = {
        name: pixels.reshape(len(row), *pixels.shape[2:])
        for name, pixels in split_planes(MOMENTARY, planes).items()
    }
    x, y = column + (x0 + 3.5), row + (y0 + 0.5)
    t = np.full(len(x), min(np.float32(moment), np.float32(1 - 2.0**-24)), np.float64)
    path, w, sure = nearest_of(of, x, y, t)
    assert np.mean(sure) > 0.8
    nothing = sure & (path < 0)
    assert np.all(found["object"][nothing] == 0)
    assert np.all(np.isinf(found["depth"][nothing]))
    hit = np.flatnonzero(sure & (path >= 0))
    path, t, x, y = path[hit], t[hit], x[hit], y[hit]
    assert len(np.unique(path)) > 2
    assert found["depth"][hit] == pytest.approx(w[hit], rel=1e-6)
    assert np.array_equal(found["object"][hit], of.single_sided[path] + 1)
    now = of.at(path, t)
    _, share, _ = see(now, x, y)
    low, high = of.window[path].T
    tau = ((t - low) / (high - low))[:, None]
    corners = 3 * path[:, None] + np.arange(3)

    def mean(values: np.ndarray) -> np.ndarray:
        here = (1 - tau)[..., None] * values[0][corners] + tau[..., None] * values[1][corners]
        return np.einsum("mv,mva->ma", share, here)

    smooth = ~of.single_sided[path]
    size = 1e-6 * np.abs(share).max(axis=1) + 1e-5
    assert np.all(np.abs(found["uv"][hit] - mean(uv) * smooth[:, None]).max(axis=1) < 4 * size)
    want = np.where(smooth[:, None], mean(normal), flat_normal(now))
    along = np.einsum("mx,mx->m", want, np.stack([x, y, np.ones(len(x))], axis=1))
    turned = (along > 0.0) & smooth
    want *= np.where(turned, -1.0, 1.0)[:, None]
    length = np.linalg.norm(want, axis=1)
    told = ~smooth | ((length > 1e-3) & (np.abs(along) > 1e-4 * length * x))
    assert found["normal"][hit][told] == pytest.approx((want / length[:, None])[told], abs=1e-4)
    assert turned.any()
    assert np.any(turned != (~is_front(now) & smooth))  # not by the winding
    for name, places in elsewhere.items():
        there = np.einsum("mv,mva->ma", share, places[corners])
        way = there[:, :2] / there[:, 2:] - np.stack([x, y], 1)
        assert found[name][hit] == pytest.approx(way, rel=1e-4)
