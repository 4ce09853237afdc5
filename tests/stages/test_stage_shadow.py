"""Stage "shadow": when spans are lit, against rays to the lights at single moments."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from reference.rays import at_time, is_front, meet, see
from support.adversarial_paths import SHAPES
from support.kernels import one_material, options, run, shapes_and_depths, vertices_of
from support.stage_lists import LAYERS, SAMPLES, TILE, around, times_within

from mbinterval.device import records

KINDS = ("generic", "translated", "pivoting", "turning over", "turning over twice", "collapsing",
         "needles", "small and fast", "nearly resting")  # fmt: skip
EACH = 4
VECTOR, PLACE = np.array([0.24, -0.32, -0.9165151389911681]), np.array([0.3, -0.2, -0.5])
"""Towards the light that is infinitely far; where the other one is. Casters lie between."""

ROOM = 1 << 17


@dataclass(frozen=True, eq=False)
class Case:
    """Samples ``xy``, each with a receiver, a path before those of the casters; two spans each."""

    xy: np.ndarray
    points: np.ndarray
    window: np.ndarray
    alpha: np.ndarray
    flat: np.ndarray
    spans: np.ndarray


def drawn(seed: int) -> Case:
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-1, 1, (SAMPLES, 2)).astype(np.float32).astype(np.float64)
    w = rng.uniform(4, 6, (SAMPLES, 2, 3))
    w[rng.random(SAMPLES) < 0.3] = 5.0
    rests = rng.random(SAMPLES) < 0.2
    w[rests, 1] = w[rests, 0]
    receivers = around(rng, xy, w, rests)
    casters = [SHAPES[kind](rng, EACH) for kind in KINDS]
    screen, w = (np.concatenate(part) for part in zip(*casters, strict=True))
    screen = 0.15 * screen + rng.uniform(-0.5, 0.5, (len(screen), 1, 1, 2))
    w = rng.uniform(1, 3, (len(w), 1, 1)) * w / w.max(axis=(1, 2), keepdims=True)
    casters = np.concatenate([screen * w[..., None], w[..., None]], axis=-1)
    count = SAMPLES + len(casters)
    window = np.tile([0.0, 1.0], (count, 1))
    part = np.arange(SAMPLES, count)[rng.random(len(casters)) < 0.3]
    window[part] = np.array([[0.0, 0.25], [0.25, 0.5], [0.5, 1.0]])[rng.integers(0, 3, len(part))]
    alpha = np.ones(count)
    alpha[SAMPLES:] = rng.choice([1.0, 0.5, 0.25, 0.0], len(casters))
    spans = times_within(rng, np.tile([0.0, 1.0], (2 * SAMPLES, 1))).reshape(SAMPLES, 2, 2)
    return Case(xy, np.concatenate([receivers, casters]), window, alpha,
                rng.random(SAMPLES) < 0.3, spans.astype(np.float64))  # fmt: skip


def lit(case: Case, capacity: int = ROOM) -> tuple[list[list[np.ndarray]], bool]:
    """Steps of both lights, of each span of each sample."""
    count = len(case.points)
    paths = np.zeros(count, records.PATH)
    for corner, name in enumerate("abc"):
        paths[name] = 6 * np.arange(count) + corner
    paths["step"], paths["alpha"] = 3, case.alpha
    paths["open"], paths["close"] = case.window.T
    vertices = vertices_of(case.points)
    shapes, depths = shapes_and_depths(vertices, paths)
    paths["mesh"][:SAMPLES] = case.flat
    mesh, material = one_material(records.MATERIAL_PHONG)
    meshes = np.concatenate([mesh, mesh])
    meshes["normal"] = 0, records.NONE
    places = np.zeros(SAMPLES, records.PLACE)
    places["x"], places["y"] = case.xy.T
    lights = np.zeros(2, records.SHADOW_LIGHT)
    lights["vector"][0], lights["origin"][1] = VECTOR, PLACE
    lights["finite"], lights["view"], lights["views"] = [0, 1], [0, 1], 1
    # A view of 2 x 2 tiles: every caster may lie in each.
    views = np.zeros(2, records.LIGHT_VIEW)
    views["matrix"] = [0.1, 0, 0, 1, 0, 0.1, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0]
    views["size"], views["starts"], views["paths"] = 2, [0, 5], 0
    casters = np.arange(SAMPLES, count)
    outlines = np.zeros(count, records.OUTLINE)
    outlines["c"] = 1.0
    starts = np.tile(np.arange(5) * len(casters), 2)
    spans = np.zeros((SAMPLES, 2), records.SHADED_SPAN)
    spans["t0"], spans["t1"] = case.spans.transpose(2, 0, 1)
    spans["source"] = np.arange(SAMPLES)[:, None]
    runs = np.zeros(SAMPLES, records.RUN)
    runs["start"], runs["count"] = 2 * np.arange(SAMPLES), 2
    steps = np.zeros(capacity + 8, records.STEP)
    steps["passed"] = -1.0
    arrays = [
        vertices, paths, shapes, depths, meshes, material, places, lights, views,
        starts.astype(np.uint32), np.tile(casters, 4).astype(np.uint32), outlines,
        np.zeros(count, np.uint32), np.uint32(capacity), steps, spans.view(np.float32), runs,
        np.zeros(2, np.uint32),
    ]  # fmt: skip
    defines = options("EXACT", "MOVING", "PLACED", "PHONG", "TRANSLUCENT", "SHADOWS",
                      SHADOW_LIGHTS=2, TILE=TILE, LAYERS=LAYERS, MASK_BITS=None)  # fmt: skip
    *_, steps, spans, _, (done, total) = run("shadow.cl", "shadow_tile", arrays, defines)
    assert np.all(steps["passed"][capacity:] == -1.0)
    if not done:
        return [], False
    steps = steps[:total]
    ends = np.flatnonzero(np.isinf(steps["t"]))
    assert len(ends) == 4 * SAMPLES
    first = np.append(0, ends[:-1] + 1)
    assert np.array_equal(spans.view(records.SHADED_SPAN)["steps"].ravel(), first[::2])
    return [
        [steps[a:b] for a, b in zip(first[i::2], ends[i::2], strict=True)] for i in (0, 1)
    ], True


def passed(case: Case, sample: np.ndarray, t: np.ndarray, light: int):
    """Share of the light that reaches samples at times, and whether that is sure."""
    now = at_time(case.points[sample], t)
    depth, _, _ = see(now, *case.xy[sample].T)
    point = depth[:, None] * np.column_stack([case.xy[sample], np.ones(len(t))])
    way = PLACE - point if light else np.broadcast_to(VECTOR, point.shape)
    share, sure = np.ones(len(t)), np.ones(len(t), bool)
    for caster in range(SAMPLES, len(case.points)):
        low, high = case.window[caster]
        part = np.clip((t - low) / (high - low), 0, 1)
        there = at_time(np.broadcast_to(case.points[caster], (len(t), 2, 3, 3)), part)
        distance, shares, _ = meet(there, point, way)
        inside = shares.min(axis=1)
        between = (distance > 0) & ((distance < 1) | (light == 0)) & (low <= t) & (t < high)
        share *= np.where(between & (inside > 0), 1.0 - case.alpha[caster], 1.0)
        sure &= ~between | (np.abs(inside) > 1e-6)
        sure &= (np.abs(t - low) > 1e-6) & (np.abs(t - high) > 1e-6)
    normal = np.cross(now[:, 1] - now[:, 0], now[:, 2] - now[:, 0])
    return share, sure, ((normal * way).sum(1) > 0) == is_front(now)


@pytest.mark.parametrize("seed", [0])
def test_steps_say_at_any_moment_what_passes_all_that_stands_in_the_light(seed):
    case = drawn(seed)
    lists, done = lit(case)
    assert done
    rng = np.random.default_rng(seed)
    times = 4
    whose = np.repeat(np.arange(2 * SAMPLES), times)
    t0, t1 = case.spans.reshape(-1, 2)[whose].T
    t = t0 + rng.random(len(whose)) * (t1 - t0)
    for light in (0, 1):
        begins = lists[light]
        assert all(s["t"][0] == np.float32(e) for s, e in
                   zip(begins, case.spans[..., 0].ravel(), strict=True))  # fmt: skip
        assert all(np.all(np.diff(s["t"]) > 0) for s in begins)
        place = [np.searchsorted(begins[k]["t"], now, "right") - 1
                 for k, now in zip(whose, t, strict=True)]  # fmt: skip
        ours = np.array([begins[k]["passed"][p] for k, p in zip(whose, place, strict=True)])
        near = np.array([np.abs(begins[k]["t"][1:] - now).min(initial=1.0)
                         for k, now in zip(whose, t, strict=True)])  # fmt: skip
        truth, sure, faces = passed(case, whose // 2, t, light)
        sure &= (near > 1e-6) & (t1 - t0 > 1e-5)
        flat = case.flat[whose // 2]
        always = np.array([len(s) == 1 and s["passed"][0] == 1.0 for s in begins])[whose]
        # What is flat and turned away is not lit, whatever stands in the light.
        told = sure & ~(flat & ~faces & always)
        assert ours[told] == pytest.approx(truth[told], abs=1e-6)
        assert np.mean(told) > 0.7
        assert np.count_nonzero(truth[told] < 1) > 1000
        assert light or np.any(flat & ~faces & always & (truth < 1))


def test_a_full_pool_is_reported_and_nothing_is_written_beyond_it():
    case = drawn(5)
    lists, _ = lit(case)
    count = sum(len(steps) + 1 for each in lists for steps in each)
    assert lit(case, count + 2)[1]  # a caster may add two steps, and asks for them beforehand
    assert not lit(case, count - 1)[1]
    assert not lit(case, 2)[1]
