"""Where, when and through which point of the lens samples look."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from reference.point_samples import Drawn
from support.culling_scenes import random_scene, same
from support.hard_cases import CASES
from support.kernels import ready_for, run
from support.lens_scenes import with_lens
from support.nightly import nightly
from support.point_samples import drawn_in_frame

import mbinterval as mb
from mbinterval.exposure.exposure import expose
from mbinterval.plan.sampling import filter_of, slots_of
from mbinterval.scene.model import Scene, Shutter

SIZE = (48, 32)
PIXELS = np.stack(np.meshgrid(np.arange(48.0), np.arange(32.0)))


def moving() -> Scene:
    return CASES["interpenetrating meshes"].make()


def drawn(of: Scene | None = None, **values: object) -> Drawn:
    of = moving() if of is None else of
    settings = mb.Settings(method=values.pop("method", "stochastic"), **values)
    ready = ready_for(of, settings, *SIZE)
    exposure, plan = ready.exposure, ready.plan
    if of.shutter.rolling:
        exposure = expose(of, 1.0, SIZE[0] / SIZE[1], lines=SIZE[1])
    return drawn_in_frame(plan, exposure, *SIZE)


def in_pixel(of: Drawn) -> tuple[np.ndarray, np.ndarray]:
    return of.x - PIXELS[0], of.y - PIXELS[1]


def unmapped(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """From the unit disc back to the unit square (Shirley & Chiu 1997)."""
    radius, angle = np.hypot(u, v), np.arctan2(v, u)
    angle = np.where(angle < -np.pi / 4, angle + 2 * np.pi, angle)
    quarter = np.floor((angle + np.pi / 4) / (np.pi / 2))
    within = (angle - quarter * np.pi / 2) / (np.pi / 4)
    x = np.select([quarter == 0, quarter == 1, quarter == 2],
                  [radius, -radius * within, -radius], radius * within)  # fmt: skip
    y = np.select([quarter == 0, quarter == 1, quarter == 2],
                  [radius * within, radius, -radius * within], -radius)  # fmt: skip
    return (x + 1) / 2, (y + 1) / 2


def are_nets(*places: np.ndarray) -> float:
    """Part of the pixels in which of N = 2^m points each elementary box of volume 1/N holds one.

    A point next to a box's border may have been rounded across it.
    """
    bits = int(np.log2(len(places[0])))
    good = np.full(places[0].shape[1:], True)
    for parts in product(range(bits + 1), repeat=len(places)):
        if sum(parts) != bits:
            continue
        cell = np.zeros(places[0].shape, dtype=int)
        for place, part in zip(places, parts, strict=True):
            cell = (cell << part) + np.clip(np.floor(place * 2**part), 0, 2**part - 1).astype(int)
        good &= (np.sort(cell, axis=0) == np.arange(2**bits)[:, None, None]).all(axis=0)
    return float(good.mean())


def test_sobol_samples_are_nets_in_time_and_place():
    for seed in (0, 1):
        for count in (4, 64):
            of = drawn(samples=count, seed=seed)
            assert are_nets(of.t, *in_pixel(of)) > 0.995
    of = drawn(samples=64, pattern="jittered")
    assert are_nets(of.t, *in_pixel(of)) < 0.01


def test_with_a_lens_sobol_samples_are_nets_in_time_and_on_the_lens():
    of = drawn(with_lens(moving()), samples=64)
    square = unmapped(of.u, of.v)
    share = [np.floor(c * 8).astype(int) for c in square]
    cell = 8 * share[0] + share[1]
    counts = np.stack([np.sort(cell, axis=0)[k] for k in range(64)])
    assert (counts == np.arange(64)[:, None, None]).mean() > 0.99  # but for rounding of the map
    quarter = 16 * np.floor(of.t * 4) + 4 * np.floor(square[0] * 4) + np.floor(square[1] * 4)
    assert (np.sort(quarter, axis=0) == np.arange(64)[:, None, None]).mean() > 0.99
    assert (of.u**2 + of.v**2).max() <= 1.0 + 1e-6


def test_a_lens_of_four_blades_is_a_square():
    of = with_lens(moving())
    square = replace(of, camera=replace(of.camera, blades=4, blade_rotation=45.0))
    points = drawn(square, samples=16)
    half = np.sqrt(0.5)
    for place in (points.u, points.v):
        assert np.abs(place).max() <= half + 1e-6
        counts = np.histogram(place, 8, (-half, half))[0]
        assert counts == pytest.approx(place.size / 8, rel=0.03)
    assert abs(np.corrcoef(points.u.ravel(), points.v.ravel())[0, 1]) < 0.02
    assert np.abs(drawn(of, samples=16).u).max() > 0.99


@pytest.mark.parametrize(
    ("pattern", "count"),
    [
        *(("sobol", 1), ("sobol", 100), ("jittered", 1), ("jittered", 5), ("jittered", 16)),
        *(("jittered", 100), ("fixed", 1), ("fixed", 5), ("fixed", 100)),
        *(("interleave_uvt", 1), ("interleave_uvt", 5), ("interleave_uvt", 100)),
    ],
)
def test_times_are_stratified_in_each_pixel(pattern, count):
    of = drawn(samples=count, pattern=pattern)
    stratum = np.sort(np.floor(of.t * count), axis=0)
    assert (stratum == np.arange(count)[:, None, None]).mean() > 0.9999  # but for rounding
    within = np.unique(of.t * count % 1.0)
    assert abs(within.mean() - 0.5) < 4 * np.sqrt(1 / 12 / len(within))


@pytest.mark.parametrize("pattern", ["sobol", "jittered", "random"])
def test_samples_are_uniform_and_pixels_independent(pattern):
    of = drawn(with_lens(moving()), samples=16, pattern=pattern)
    places = (*in_pixel(of), of.t, *unmapped(of.u, of.v))
    for place in places:
        assert place.min() >= 0.0
        assert place.max() <= 1.0
        assert abs(place.mean() - 0.5) < 5 * np.sqrt(1 / 12 / place.size)
        assert abs(place.var() - 1 / 12) < 2e-3
    for a in range(5):
        for b in range(a):  # of effects
            assert abs(np.corrcoef(places[a].ravel(), places[b].ravel())[0, 1]) < 0.04
        first = np.sort(places[a], axis=0)[3]
        assert abs(np.corrcoef(first[:, :-1].ravel(), first[:, 1:].ravel())[0, 1]) < 0.1


def test_fixed_places_are_those_of_the_analytic_method_in_any_order():
    of = drawn(samples=9, pattern="fixed")
    x, y = in_pixel(of)
    slots = mb.Settings(samples=9)

    want = {(float(s["x_low"]), float(s["y_low"])) for s in slots_of(slots)}
    for row, column in ((0, 0), (17, 30)):
        found = set(zip(x[:, row, column].tolist(), y[:, row, column].tolist(), strict=True))
        assert {(round(a, 6), round(b, 6)) for a, b in found} == {
            (round(a, 6), round(b, 6)) for a, b in want
        }
    order = np.argsort(of.t, axis=0)
    assert (np.take_along_axis(x, order, 0) != np.take_along_axis(x, order, 0)[:, :1, :1]).any()


def test_interleaved_pixels_share_the_times_of_the_frame():
    of = drawn(with_lens(moving()), samples=8, pattern="interleave_uvt")
    quads = of.t.reshape(8, 16, 2, 24, 2).transpose(1, 3, 0, 2, 4).reshape(16 * 24, 32)
    times = np.unique(quads)
    assert len(times) == 32
    assert (np.sort(quads, axis=1) == times).all()
    assert len(np.unique(np.stack([of.t, of.u, of.v], -1).reshape(-1, 3), axis=0)) == 32
    assert len(np.unique(of.t[:, ::2, ::2])) == 32  # one pixel of the four has now these, now those


def test_the_rotated_grid_gives_eight_times_in_rows_and_columns_of_their_own():
    of = drawn(samples=4, pattern="rgss")
    x, y = in_pixel(of)
    columns, rows = np.floor(x * 4).astype(int), np.floor(y * 4).astype(int)
    assert (np.sort(columns, axis=0) == np.arange(4)[:, None, None]).all()
    assert (np.sort(rows, axis=0) == np.arange(4)[:, None, None]).all()
    quarter = np.floor(of.t * 4).astype(int)
    assert (quarter == np.arange(4)[:, None, None]).all()
    for i, j in product(range(1, 31), range(1, 47)):
        own = [
            (of.t[k, i, j], k, 4 * j + columns[k, i, j], 4 * i + rows[k, i, j]) for k in range(4)
        ]
        others = []
        for di, dj in ((0, -1), (0, 1), (-1, 0), (1, 0)):
            a, b = i + di, j + dj
            away = np.hypot(of.x[:, a, b] - (j + 0.5), of.y[:, a, b] - (i + 0.5))
            k = int(np.argmin(away))
            others.append((of.t[k, a, b], k, 4 * b + columns[k, a, b], 4 * a + rows[k, a, b]))
        assert sorted(o[1] for o in others) == [0, 1, 2, 3]
        assert sorted(np.floor(np.array([s[0] for s in own + others]) * 8).astype(int)) == list(
            range(8)
        )
        for t, k, column, row in others:
            assert t != own[k][0]
            assert column != own[k][2]
            assert row != own[k][3]
    # 2 x 2 pixels share each time.
    for k, (dx, dy) in enumerate(((0, 0), (1, 0), (0, 1), (1, 1))):
        t = of.t[k, dy : 30 + dy, dx : 46 + dx]
        assert (t.reshape(15, 2, 23, 2) == t.reshape(15, 2, 23, 2)[:, :1, :, :1]).all()


def test_slices_share_time_and_lens_over_the_frame():
    of = drawn(with_lens(moving()), method="accumulation", slices=8, samples=3)
    for part in (of.t, of.u, of.v):
        assert (part == part[:, :1, :1]).all()
        assert len(np.unique(part)) == 8
    assert np.sort(of.t[:, 0, 0])[::3] == pytest.approx((np.arange(8) + 0.5) / 8)
    jittered = drawn(method="accumulation", slices=8, slice_times="jittered")
    at = np.sort(jittered.t[:, 0, 0])[::4]
    assert np.array_equal(np.floor(at * 8), np.arange(8))
    assert np.abs(at * 8 % 1 - 0.5).max() > 0.05


LINES = {"method": "accumulation", "slice_lens": "line"}


@pytest.mark.parametrize("blades", [0, 6])
@pytest.mark.parametrize("times", ["uniform", "stochastic"])
def test_each_slice_looks_through_a_line_across_the_lens(blades, times):
    of = with_lens(moving())
    of = replace(of, camera=replace(of.camera, blades=blades))
    found = drawn(of, slices=8, samples=4, slice_times=times, **LINES)
    angle = np.mod(np.arctan2(found.v, found.u), np.pi)
    lines = np.unique(np.round(angle[np.hypot(found.u, found.v) > 0.05], 3) % 3.141)
    assert len(lines) == 8  # through the middle, the same in all pixels
    if not blades:  # in eighths of all directions
        assert np.sort(np.floor(lines / np.pi * 8)).tolist() == list(range(8))
    nearest = np.abs(np.sin(angle[..., None] - lines)).argmin(axis=-1)
    times_of = [found.t[nearest == k] for k in range(8)]
    for at in times_of:  # a slice's part of the shutter
        assert np.ptp(at) <= 1 / 8 if times == "stochastic" else np.unique(at).size == 1
    # Each pixel has places of its own, half of them on each side of the middle.
    for k in range(8):
        along = found.u * np.cos(lines[k]) + found.v * np.sin(lines[k])
        along = np.where(nearest == k, along, np.nan)
        rank = np.sort(along.reshape(32, -1), axis=0)[:4]
        assert ((rank > 0.0).sum(axis=0) == 2).mean() > 0.98
        assert np.ptp(rank[0]) > 0.2
    point = drawn(of, slices=8, samples=4, slice_times=times, method="accumulation")
    angle = np.mod(np.arctan2(point.v, point.u), np.pi)
    assert times == "stochastic" or len(np.unique(np.hypot(point.u, point.v))) == 8
    assert times == "uniform" or len(np.unique(np.round(angle, 3))) > 1000


@pytest.mark.parametrize("blades", [0, 5, nightly(3), nightly(6)])
def test_lines_together_cover_the_lens_evenly(blades):
    """As evenly as a finite number of lines can: a sector may have a 64th more than its part."""
    of = with_lens(moving())
    of = replace(of, camera=replace(of.camera, blades=blades, blade_rotation=10.0))
    parts = [drawn(of, slices=64, samples=4, seed=seed, **LINES) for seed in range(4)]
    uv = np.concatenate([np.stack([p.u, p.v], -1).reshape(-1, 2) for p in parts])
    if blades == 0:
        outer, second = np.hypot(*uv.T), 0.5
        assert np.histogram(np.arctan2(*uv.T), 8)[0] / len(uv) == pytest.approx(
            np.full(8, 1 / 8), abs=0.004
        )
    else:
        step = 2 * np.pi / blades
        normals = np.radians(10.0) + step * (np.arange(blades) + 0.5)
        outward = uv @ np.stack([np.cos(normals), np.sin(normals)]) / np.cos(np.pi / blades)
        outer, second = outward.max(axis=1), (2 + np.cos(step)) / 6
        sectors = np.bincount(np.argmax(outward, axis=1)) / len(uv)
        assert sectors == pytest.approx(np.full(blades, 1 / blades), abs=1 / 128)
    assert outer.max() <= 1 + 1e-6
    for part in (0.25, 0.5, 0.75):
        assert np.mean(outer < part) == pytest.approx(part**2, abs=0.004)
    assert uv.mean(axis=0) == pytest.approx([0, 0], abs=0.004)
    assert (uv**2).sum(axis=1).mean() == pytest.approx(second, rel=0.005)


def test_frameless_pixels_see_their_own_part_of_the_shutter():
    of = drawn(frameless=4, samples=16)
    part = np.floor(of.t * 4 * (1 - 1e-6))
    assert (part == part[:1]).all()
    assert np.bincount(part[0].astype(int).ravel()).tolist() == [48 * 32 // 4] * 4
    assert np.sort(np.floor(of.t * 64 % 16), axis=0)[:, 3, 5].tolist() == list(range(16))


def test_the_shutter_curve_and_rolling_lines_place_samples_in_time():
    triangle = replace(moving(), shutter=Shutter(curve="triangle"))
    of = drawn(triangle, samples=64)
    share = np.where(of.t < 0.5, 2 * of.t**2, 1 - 2 * (1 - of.t) ** 2)  # light that has passed
    assert (
        np.sort(np.floor(share * 64 * (1 - 1e-5)), axis=0) == np.arange(64)[:, None, None]
    ).mean() > 0.98
    rolling = replace(
        moving(), shutter=Shutter(rolling="down", line_offset=0.001, line_exposure=0.01)
    )
    of = drawn(rolling, samples=16)
    roll = expose(rolling, 1.0, 1.5, lines=SIZE[1]).roll
    assert roll is not None
    opened = roll.start + roll.step * np.arange(32)[None, :, None]
    assert (of.t >= opened - 1e-6).all()
    assert (of.t <= opened + roll.length + 1e-6).all()
    assert len(np.unique(np.floor((of.t - opened) / roll.length * 16 * (1 - 1e-4))[:, 9, 9])) == 16


def test_filters_place_samples():
    for values in ({"filter": "gaussian"}, {"filter": "triangle", "filter_radius": 2.0}):
        of = drawn(samples=64, **values)
        x, y = in_pixel(of)
        shape = filter_of(mb.Settings(**values))
        for place in (x, y):
            share = np.interp(place, shape.table, np.linspace(0, 1, len(shape.table)))
            assert (np.sort(np.floor(share * 64), 0) == np.arange(64)[:, None, None]).mean() > 0.98


def test_crops_are_parts_of_the_frame_and_seeds_change_it():
    of = with_lens(random_scene(0))
    for values in ({"samples": 16}, {"samples": 100, "pattern": "random"}):
        settings = mb.Settings(method="stochastic", **values)
        whole = mb.render(of, width=48, height=32, settings=settings)
        crop = mb.render(of, width=48, height=32, settings=settings, crop=(5, 3, 30, 20))
        assert np.array_equal(crop.rgba, whole.rgba[3:23, 5:35])
        assert same(mb.render(of, width=48, height=32, settings=settings), whole)
        other = mb.render(of, width=48, height=32, settings=replace(settings, seed=1))
        assert not np.array_equal(other.rgba, whole.rgba)
    settings = mb.Settings(method="stochastic", pattern="rgss")
    whole = mb.render(random_scene(0), width=48, height=32, settings=settings)
    crop = mb.render(random_scene(0), width=48, height=32, settings=settings, crop=(5, 3, 30, 20))
    assert np.array_equal(crop.rgba, whole.rgba[3:23, 5:35])


def order(seeds: np.ndarray, count: int) -> np.ndarray:
    """Places ``(count, S)`` of 0 ... count - 1 in the orders of ``seeds``, after Kensler 2013."""
    mask = np.uint32((1 << int(count - 1).bit_length()) - 1)
    places = np.arange(count, dtype=np.uint32)[:, None] + np.zeros_like(seeds)
    again = np.ones(places.shape, bool)
    while again.any():
        x = places.copy()
        x ^= seeds
        x *= np.uint32(0xE170893D)
        x ^= seeds >> np.uint32(16)
        x ^= (x & mask) >> np.uint32(4)
        x ^= seeds >> np.uint32(8)
        x *= np.uint32(0x0929EB3F)
        x ^= seeds >> np.uint32(23)
        x ^= (x & mask) >> np.uint32(1)
        x *= np.uint32(1) | seeds >> np.uint32(27)
        for factor, shift in ((0x6935FA69, 11), (0x74DCB303, 2), (0x9E501CC3, 2)):
            x *= np.uint32(factor)
            x ^= (x & mask) >> np.uint32(shift)
        x *= np.uint32(0xC860A3DF)
        x &= mask
        x ^= x >> np.uint32(5)
        places = np.where(again, x, places)
        again = places >= count
    return (places + seeds) % np.uint32(count)


@pytest.mark.parametrize("count", [1, 2, 7, 64, 100, 1000])
def test_random_orders_are_kenslers_whatever_the_seed(count):
    """Seeds next to 2^32 too, where a place and the seed together overflow."""
    rng = np.random.default_rng(count)
    ends = np.array([0, 1, count, *range(2**32 - 6, 2**32)], np.uint32)
    seeds = np.append(ends, rng.integers(0, 2**32, 16 - len(ends), np.uint32))
    plan = ready_for(moving(), mb.Settings(method="stochastic", pattern="jittered"), *SIZE).plan
    places = np.zeros((count, 16), np.uint32)
    *_, places = run("scatter.cl", "orders", [seeds, np.uint32(count), places], plan.options)
    assert np.array_equal(places, order(seeds, count))
    whole = np.sort(places[:, :3], axis=0) == np.arange(count)[:, None]
    assert whole.all()
