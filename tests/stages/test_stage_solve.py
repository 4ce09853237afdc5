"""Stage "solve": when moving triangles cover samples, against triangles at single moments."""

from __future__ import annotations

import numpy as np
import pytest
from reference.rays import at_time, is_front, see, see_clearly, see_nudged
from support.adversarial_paths import KINDS, SAMPLES, draw
from support.kernels import one_material, options, paths_of_points, run, shapes_of

from mbinterval.device import records

COUNT = 16
"""Paths of each kind, with eight samples each: 1,664 pairs."""

TIMES = 40
SLACK = 1e-6
"""Of times, within which nothing may change at a moment that is looked at."""


def solved(
    points: np.ndarray, samples: np.ndarray, one_by_one: bool, flags: int
) -> tuple[np.ndarray, np.ndarray]:
    """Pair and visit of each interval that the kernel finds."""
    vertices, paths = paths_of_points(points)
    shapes, count, capacity = shapes_of(vertices, paths, flags), len(points), 10 * samples.size
    pairs = count * SAMPLES
    arrays = [
        vertices, paths, shapes, *one_material(flags), np.uint32(count),
        samples.astype(np.float32), np.uint32(one_by_one), np.uint32(capacity),
        np.zeros(capacity, records.VISIT), *np.zeros((2, pairs), np.int32),
        np.zeros(pairs, np.uint32), np.zeros(2, np.uint32),
    ]  # fmt: skip
    defines = options("EXACT", "MOVING", "SINGLE_SIDED")
    *_, visits, heads, _, met, (done, total) = run("solve.cl", "solve_pairs", arrays, defines)
    assert done
    owner = np.full(total, -1)
    pair, node = np.arange(pairs), heads
    while len(node):
        pair, node = pair[node >= 0], node[node >= 0]
        assert np.all(owner[node] == -1)
        owner[node] = pair
        node = visits["next"][node]
    assert np.array_equal(np.bincount(owner, minlength=pairs), met)
    return owner, visits[:total]


def drawn(kinds: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(17)
    parts = [draw(rng, kind, COUNT) for kind in kinds]
    points, samples = (np.concatenate(part) for part in zip(*parts, strict=True))
    return points, samples


def held(owner: np.ndarray, visits: np.ndarray, pair: np.ndarray, t: np.ndarray) -> np.ndarray:
    """How many intervals of pairs hold times ``t``."""
    begins, ends = (np.sort(2.0 * owner + visits[name].astype(np.float64)) for name in ("t0", "t1"))
    return np.searchsorted(begins, 2.0 * pair + t, "right") - np.searchsorted(
        ends, 2.0 * pair + t, "right"
    )


@pytest.mark.parametrize("one_by_one", [False, True])
@pytest.mark.parametrize("flags", [0, records.MATERIAL_SINGLE_SIDED])
def test_intervals_hold_the_moments_at_which_the_triangle_is_seen(one_by_one, flags):
    points, samples = drawn(KINDS)
    owner, visits = solved(points, samples, one_by_one, flags)
    rng = np.random.default_rng(3)
    pairs = len(points) * SAMPLES
    t = rng.random((pairs, TIMES))
    t[:, :4] = [2 * SLACK, 1 - 2 * SLACK, 0.5, 1e-4]
    middle = 0.5 * (visits["t0"].astype(np.float64) + visits["t1"])
    pair = np.concatenate([np.repeat(np.arange(pairs), TIMES), owner])
    t = np.concatenate([t.ravel(), np.clip(middle, SLACK, 1 - SLACK)])
    x, y = samples.reshape(-1, 2)[pair].T
    seen, sure = [], np.ones(len(t), bool)
    for shift in (-SLACK, 0.0, SLACK):
        now = at_time(points[pair // SAMPLES], t + shift)
        _, there, certain = see_clearly(now, x, y)
        there &= is_front(now) | (flags == 0)
        seen.append(there)
        sure &= certain & (held(owner, visits, pair, t + shift) == held(owner, visits, pair, t))
    sure &= (seen[0] == seen[1]) & (seen[1] == seen[2])
    ours = held(owner, visits, pair, t)
    wrong = np.flatnonzero(sure & (ours != seen[1]))
    assert not len(wrong)
    kinds = np.bincount(pair[sure & (ours > 0)] // SAMPLES // COUNT, minlength=len(KINDS))
    assert np.all(kinds > 20)
    assert np.mean(sure) > 0.95


def test_samples_on_edges_that_rest_belong_to_the_side_right_of_and_below_them():
    """Whole numbers, and times of few bits: an edge stays on a sample and shares are exact."""
    rng = np.random.default_rng(8)
    count, step = 300, 1 / 64
    screen = rng.integers(-3, 4, (count, 2, 3, 2)).astype(float)
    screen[:, 0, 0] = screen[:, 1, 0] = 0.0  # a corner rests on the samples
    level = rng.random(count) < 0.5  # or an edge does
    screen[level, :, 1, 1] = 0.0
    w = np.where(rng.random((count, 1, 1)) < 0.5, 1.0, 2.0 ** rng.integers(-1, 2, (count, 2, 3)))
    points = np.concatenate([screen * w[..., None], w[..., None]], axis=-1)
    points += 8.0 * w[..., None] * [1, 1, 0]
    samples = np.full((count, SAMPLES, 2), 8.0)
    samples[:, 4:, 0] += rng.integers(-1, 2, (count, 4))
    owner, visits = solved(points, samples, False, 0)
    t = np.tile(np.arange(1, 16) / 16, count * SAMPLES)
    pair = np.repeat(np.arange(count * SAMPLES), 15)
    x, y = samples.reshape(-1, 2)[pair].T
    on, ours = [], []
    for shift in (-step, 0.0, step):
        now = at_time(points[pair // SAMPLES], t + shift)
        on.append(np.abs(see(now, x, y)[1]) < 1e-12)
        ours.append(held(owner, visits, pair, t + shift))
    _, seen, sure = see_nudged(at_time(points[pair // SAMPLES], t), x, y)
    sure &= (ours[0] == ours[1]) & (ours[1] == ours[2])
    sure &= ((on[0] == on[1]) & (on[1] == on[2])).all(axis=1)
    assert np.array_equal(ours[1][sure], seen[sure])
    told = sure & on[1].any(axis=1)
    assert np.count_nonzero(told & seen) > 1000
    assert np.count_nonzero(told & ~seen) > 1000


def test_depths_lie_within_the_bounds_of_their_interval():
    points, samples = drawn(KINDS)
    owner, visits = solved(points, samples, False, 0)
    part = np.random.default_rng(4).random(len(visits))
    t = visits["t0"] + part * (visits["t1"].astype(np.float64) - visits["t0"])
    x, y = samples.reshape(-1, 2)[owner].T
    depth, seen, sure = see_clearly(at_time(points[owner // SAMPLES], t), x, y)
    told = seen & sure
    assert np.all(visits["near"][told] <= depth[told])
    assert np.all(depth[told] <= visits["far"][told])
    assert np.count_nonzero(told) > 700
    assert np.median(visits["far"][told] / np.maximum(depth[told], 1e-9)) < 4.0
