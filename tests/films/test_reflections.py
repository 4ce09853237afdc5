"""Time-dependent environment cube maps: what moving objects mirror of what moves around them.

Against rays that are traced to panels far away, and the methods against each other.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from support.nightly import nightly

import mbinterval as mb
from mbinterval.device.runtime import runtime
from mbinterval.exposure.exposure import expose, reflecting
from mbinterval.plan.prepare import prepare
from mbinterval.rendering.analytic import render_analytic
from mbinterval.rendering.cube_maps import directions
from mbinterval.rendering.reflections import _part_of_curve, surroundings
from mbinterval.scene.primitives import PRIMITIVES

SIZE = (36, 24)
FAR = 80.0
RADIUS = 0.9
BEHIND = (0.05, 0.1, 0.05)
CHROME = mb.Material("chrome", shading="metallic_roughness", metallic=1.0, roughness=0.0)
PATH = np.array([[-0.3, 0.0, 0.0], [0.3, 0.0, 0.0]])
# Panels: the axis that they face and where, bounds along the next two axes at the start, by how
# much they move, colour.
PANELS = (
    (2, FAR, (-80.0, -20.0), (-50.0, 50.0), (80.0, 0.0), (0.9, 0.5, 0.1)),
    (0, FAR, (-50.0, 40.0), (-80.0, 10.0), (0.0, 40.0), (0.1, 0.4, 0.8)),
)


def panel(axis: int, at: float, first: tuple, second: tuple, move: tuple, color: tuple) -> mb.Mesh:
    corners = np.zeros((4, 3))
    corners[:, axis] = at
    corners[:, (axis + 1) % 3] = np.array(first)[[0, 1, 1, 0]]
    corners[:, (axis + 2) % 3] = np.array(second)[[0, 0, 1, 1]]
    step = np.zeros(3)
    step[[(axis + 1) % 3, (axis + 2) % 3]] = move
    return mb.Mesh(positions=np.stack([corners, corners + step]), faces=[[0, 1, 2], [0, 2, 3]],
                   color=color, shading="unlit")  # fmt: skip


def ball(**asked: int) -> mb.Mesh:
    path = mb.Track(np.array([-0.5, 0.5]), PATH)
    asked = {"size": 32, "times": 8} | asked
    return replace(
        PRIMITIVES["sphere"](radius=RADIUS, segments=64),
        material=CHROME,
        transform=mb.Transform(translation=path),
        reflections=mb.Reflections(**asked),
    )


def scene(chrome: mb.Mesh | None = None) -> mb.Scene:
    return mb.Scene(
        meshes=[chrome or ball(), *(panel(*item) for item in PANELS)],
        camera=mb.Camera(position=(0, 0, 5), look_at=(0, 0, 0), fov=30),
        background=BEHIND,
        lights=[mb.Light("ambient", intensity=0.0)],
        shutter=mb.Shutter(-0.5, 0.5),
    )


def film(of: mb.Scene, **values: object) -> np.ndarray:
    settings = mb.Settings(**{"samples": 16, "pattern": "sobol"} | values)
    rgba = mb.render(of, frame=0, width=SIZE[0], height=SIZE[1], settings=settings).rgba
    return np.asarray(rgba, np.float64)


def seen(places: np.ndarray, ways: np.ndarray, t: np.ndarray) -> np.ndarray:
    """What rays from ``places`` (..., 3) meet at times t."""
    color = np.broadcast_to(BEHIND, ways.shape).copy()
    for axis, at, first, second, move, paint in PANELS:
        with np.errstate(divide="ignore", invalid="ignore"):
            along = (at - places[..., axis]) / ways[..., axis]
            met = places + along[..., None] * ways
        there = along > 0.0
        for k, bounds in enumerate((first, second)):
            place = met[..., (axis + 1 + k) % 3] - move[k] * t
            there &= (bounds[0] <= place) & (place < bounds[1])
        color[there] = paint
    return color


def traced(count: int, late: float = 0.0) -> np.ndarray:
    """Rays through random places of pixels at random times, mirrored by the ball."""
    rng, total = np.random.default_rng(0), np.zeros((SIZE[1], SIZE[0], 3))
    height = 2.0 * np.tan(np.radians(15.0))
    for k in range(count):
        t = (k + rng.random(total.shape[:2])) / count
        x = (np.arange(SIZE[0]) + rng.random(t.shape) - SIZE[0] / 2) / SIZE[1] * height
        y = -(np.arange(SIZE[1])[:, None] + rng.random(t.shape) - SIZE[1] / 2) / SIZE[1] * height
        way = np.stack([x, y, -np.ones_like(x)], axis=-1)
        way /= np.linalg.norm(way, axis=-1, keepdims=True)
        middle = PATH[0] + t[..., None] * (PATH[1] - PATH[0])
        from_middle = [0.0, 0.0, 5.0] - middle
        half = (from_middle * way).sum(axis=-1)
        square = half**2 - (from_middle**2).sum(axis=-1) + RADIUS**2
        place = [0.0, 0.0, 5.0] + (-half - np.sqrt(np.maximum(square, 0.0)))[..., None] * way
        normal = (place - middle) / RADIUS
        mirrored = way - 2.0 * (way * normal).sum(axis=-1, keepdims=True) * normal
        light = seen(place, mirrored, t + late)
        total += np.where((square > 0.0)[..., None], light, BEHIND)
    return total / count


def rmse(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.sqrt(np.mean((a[..., :3] - b[..., :3]) ** 2)))


@pytest.fixture(scope="module")
def exact() -> np.ndarray:
    return film(scene())


def test_a_moving_mirror_shows_what_moves_as_traced_rays_do(exact):
    """But for parallax, a hundredth of the distance, and texels as wide as three degrees."""
    truth = traced(400)
    assert truth[..., 0].max() > 0.1
    assert rmse(exact, truth) < 3e-3
    assert rmse(exact, traced(100, late=0.1)) > 5e-3
    assert rmse(film(scene(ball(times=1))), truth) > 1e-2


@pytest.mark.parametrize(
    "values",
    [
        {"method": "stochastic", "samples": 256},
        nightly({"method": "accumulation", "slices": 64, "samples": 4, "pattern": "fixed"}),
    ],
    ids=["stochastic", "accumulation"],
)
def test_point_samples_agree_with_exact_time(values, exact):
    assert rmse(film(scene(), **values), exact) < 2.5e-3


def test_a_shutter_that_rolls_and_has_a_curve_is_cut_into_parts_too(exact):
    of = replace(scene(), shutter=mb.Shutter(-0.5, 0.5, rolling="right", curve="trapezoid",
                                             line_offset=6e-4, line_exposure=0.02))  # fmt: skip
    found = film(of)
    assert rmse(found, film(of, method="stochastic", samples=256)) < 2.5e-3
    assert rmse(found, exact) > 0.02


def test_a_render_and_a_part_of_it_have_the_same_bytes_every_time(exact):
    assert np.array_equal(film(scene()), exact)
    settings = mb.Settings(samples=16, pattern="sobol")
    part = mb.render(scene(), frame=0, width=SIZE[0], height=SIZE[1], settings=settings,
                     crop=(9, 5, 14, 11))  # fmt: skip
    assert np.array_equal(part.rgba, exact[5:16, 9:23].astype(np.float32))
    assert part.timings["cube_map"] > 0.0


def test_reflections_of_what_mirrors_nothing_are_noted():
    clay = replace(ball(), material=mb.Material("clay"), name="clay")
    notes = expose(scene(clay), 0, 1.5).notes
    assert notes == ("mesh 'clay': reflections need shading 'metallic_roughness'",)
    assert expose(scene(), 0, 1.5).notes == ()


def pictures(of: mb.Scene) -> np.ndarray:
    ready, on = prepare(of, 0, *SIZE, mb.Settings(samples=16)), runtime()
    found = surroundings(on, of, ready, partial(render_analytic, on))
    assert len(found) == len(reflecting(ready.exposure))
    return found[0]


def test_pictures_are_averages_over_their_parts_of_the_shutter():
    """Each texel of each part against rays from the middle, at the places that it averages over."""
    found = pictures(scene(ball(size=24, times=4)))
    assert found.shape == (4, 6, 25, 25, 3)
    flat = directions(24)
    rng, total = np.random.default_rng(1), np.zeros(found.shape)
    for part in range(4):
        for _ in range(200):
            t = (part + rng.random(flat.shape[:-1])) / 4
            jitter = (rng.random(flat.shape) - 0.5) * 2 / 24
            ways = flat / np.abs(flat).max(axis=-1, keepdims=True)
            ways = ways + np.where(np.abs(ways) == 1.0, 0.0, jitter)
            total[part] += seen(PATH[0] + t[..., None] * (PATH[1] - PATH[0]), ways, t)
    inner = np.s_[:, :, 1:-1, 1:-1]
    assert rmse(found[inner], total[inner] / 200) < 0.01
    assert rmse(found[inner], np.roll(total, 1, axis=0)[inner] / 200) > 0.05
    # Faces that meet in an edge share its texels.
    ways = directions(24).reshape(-1, 3).round(6)
    for a, b in ((4, 0), (4, 2), (0, 2)):
        first, second = ways.reshape(6, -1, 3)[[a, b]]
        same = (first[:, None] == second[None]).all(axis=-1)
        assert same.sum() == 25
        colors = found[0].reshape(6, -1, 3)[[a, b]]
        rows, columns = np.nonzero(same)
        assert np.abs(colors[0][rows] - colors[1][columns]).mean() < 0.02


def test_where_nothing_moves_there_is_one_picture():
    of = scene(replace(ball(size=16), transform=None))
    of = replace(of, meshes=[replace(m, positions=m.positions[-1]) if m.times > 1 else m
                             for m in of.meshes])  # fmt: skip
    assert pictures(of).shape == (1, 6, 17, 17, 3)


def test_a_mirror_at_rest_shows_what_moves():
    still = replace(ball(), transform=None)
    found, first = film(scene(still)), film(scene(replace(still, reflections=None)))
    assert rmse(found, first) > 0.03
    points = film(scene(still), method="stochastic", samples=256)
    assert rmse(found, points) < 2.5e-3


def test_meshes_of_one_object_share_a_map_and_do_not_see_each_other():
    asked = mb.Reflections(size=16, times=1)
    left, right = (
        replace(ball(), reflections=asked, transform=mb.Transform(translation=(x, 0, 0)))
        for x in (-0.7, 0.7)
    )
    exposure = expose(replace(scene(), meshes=[left, right]), 0, 1.5)
    assert [len(meshes) for meshes in reflecting(exposure).values()] == [2]
    found = pictures(replace(scene(), meshes=[left, right]))
    assert np.abs(found - BEHIND).max() < 1e-6
    alone = replace(right, reflections=mb.Reflections(size=16, times=1))
    exposure = expose(replace(scene(), meshes=[left, alone]), 0, 1.5)
    assert [len(meshes) for meshes in reflecting(exposure).values()] == [1, 1]


def test_a_curve_is_cut_into_the_parts_of_the_shutter():
    shutter = mb.Shutter(curve="triangle")
    first, second = (np.array(_part_of_curve(shutter, part, 2)) for part in (0, 1))
    assert first == pytest.approx(np.linspace(0.0, 1.0, len(first)))
    assert second == pytest.approx(first[::-1])
    assert _part_of_curve(mb.Shutter(), 0, 2) == "box"
    assert _part_of_curve(mb.Shutter(curve=(0.0, 0.0, 0.0, 0.0, 1.0)), 0, 4) == "box"


def test_a_scene_file_asks_for_reflections_and_mistakes_are_told():
    item = {"primitive": {"kind": "sphere"}, "reflections": {"size": 64}}
    found = mb.load({"objects": [item]}).meshes[0].reflections
    assert (found.size, found.times) == (64, 4)
    for wrong, message in (
        ({"size": 4}, r"objects\[0\]\.reflections\.size"),
        ({"times": 0}, r"objects\[0\]\.reflections\.times"),
        ({"texels": 64}, r"objects\[0\]\.reflections\.texels"),
    ):
        with pytest.raises(mb.SceneError, match=message):
            mb.load({"objects": [item | {"reflections": wrong}]})
    with pytest.raises(mb.SceneError, match="reflections: size"):
        mb.Reflections(size=2048)
    with pytest.raises(mb.UsageError, match="reflections of surroundings need paths='exact'"):
        film(scene(), paths="triangulated", pattern="fixed")
