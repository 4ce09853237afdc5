"""Stage "shadow_map": the least depth that lights see, against rays through each triangle."""

from __future__ import annotations

import numpy as np
import pytest
from reference.rays import meet
from support.kernels import numbers, options, run
from support.stage_triangles import Triangles, draw, tables

from mbinterval.device import records
from mbinterval.rendering.shadow_tree import tree_of

COUNT, SIZE, STRATA = 96, 20, 3
TEXELS = SIZE * SIZE * STRATA
"""Of each of two views: more than a thousand, in rows that sixteen lanes do not fill."""


def mixed(x: np.ndarray) -> np.ndarray:
    """Wellons' hash of whole numbers, lowbias32."""
    x = x.astype(np.uint64)
    for shift, factor in ((16, 0x7FEB352D), (15, 0x846CA68B), (16, 1)):
        x = ((x ^ (x >> np.uint64(shift))) * np.uint64(factor)) & np.uint64(0xFFFFFFFF)
    return x


def jitter(own: np.ndarray, what: int) -> np.ndarray:
    step = mixed(np.array([(what + 0x9E3779B9) & 0xFFFFFFFF]))
    return (mixed(own ^ step) >> np.uint64(8)) * 2.0**-24


def views() -> np.ndarray:
    """One that looks along parallel rays, one from a point; x and y are texels."""
    table = np.zeros(2, records.VIEW_RAYS)
    step = 16.0 / SIZE
    # Depth runs along w; the world is homogeneous pixel space.
    table["from"][0] = [0, 0, -1, step, 0, 0, 0, step, 0]
    table["way"][0] = [0.1, 0.2, 1, 0, 0, 0, 0, 0, 0]
    table["from"][1] = [8, 8, -2, 0, 0, 0, 0, 0, 0]
    table["way"][1] = [-4, -4, 1, 8.0 / SIZE, 0, 0, 0, 8.0 / SIZE, 0]
    table["depth"] = [0.5, 0.0]
    return table


def mapped(of: Triangles, alpha: np.ndarray, seed: int) -> np.ndarray:
    """Depths by view, stratum, row and column."""
    vertices, paths, _, _ = tables(of)
    paths["alpha"] = alpha
    places = np.stack([vertices[name] for name in "xyw"], axis=1)
    nodes, leaves = tree_of(paths, places)
    told = numbers(shadow_size=SIZE, shadow_strata=STRATA, seed=seed, leaf_nodes=len(nodes) // 2)
    given = [told, vertices, paths, nodes, leaves, views(), np.zeros(2 * TEXELS, np.float32)]
    defines = options("STOCHASTIC", TILE=None, LAYERS=None, MASK_BITS=None)
    file = "stochastic/shadow_map.cl"
    found = run(file, "shadow_map", given, defines, 2 * STRATA * SIZE)[-1]
    return found.reshape(2, STRATA, SIZE, SIZE)


def truth(of: Triangles, alpha: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """The same, every triangle by itself; and whether it is sure."""
    index = np.indices((2, STRATA, SIZE, SIZE)).reshape(4, -1)
    view, stratum, row, column = index
    item = (view * STRATA + stratum) * SIZE + row
    own = mixed(np.uint64(seed) ^ mixed(item * SIZE + column))
    places = column + jitter(own, 0), row + jitter(own, 1), stratum + jitter(own, 2)
    x, y, t = (place.astype(np.float32).astype(np.float64) for place in places)
    t = (np.float32(t) * np.float32(1 / STRATA)).astype(np.float64)
    rays = [views()[name][view].reshape(-1, 3, 3) for name in ("from", "way")]
    start, way = (r[:, 0] + x[:, None] * r[:, 1] + y[:, None] * r[:, 2] for r in rays)
    depth, doubt = np.full(len(t), np.inf), np.full(len(t), np.inf)
    for path in range(len(of.points)):
        if alpha[path] == 0.0:
            continue
        one = np.full(len(t), path)
        there = of.there(one, t)
        found, share, _ = meet(of.at(one, t), start, way)
        inside = share.min(axis=1)
        ahead = there & (found > 0)
        depth = np.where(ahead & (inside > 0), np.minimum(depth, found), depth)
        doubt = np.where(ahead & (np.abs(inside) < 1e-5), np.minimum(doubt, found), doubt)
    return views()["depth"][view] + depth, doubt > depth


@pytest.mark.parametrize("seed", [1, 7])
def test_texels_hold_the_least_depth_along_their_ray_at_its_time(seed):
    of = draw(seed, COUNT, (0, 0), segments=True)
    alpha = np.random.default_rng(seed).choice([1.0, 0.5, 0.0], COUNT)
    ours = mapped(of, alpha, seed).ravel()
    want, sure = truth(of, alpha, seed)
    assert np.mean(sure) > 0.8
    assert np.array_equal(np.isinf(ours)[sure], np.isinf(want)[sure])
    told = sure & np.isfinite(want)
    assert ours[told] == pytest.approx(want[told], rel=1e-5, abs=1e-6)
    assert 0.1 < np.mean(told) < 0.999
    other, _ = truth(of, alpha, seed + 1)
    assert np.mean(np.isclose(ours[told], other[told], rtol=1e-5)) < 0.9
