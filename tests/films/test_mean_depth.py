"""The film's depth is the mean of what is visible, weighted as the shutter is, in all methods."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.nightly import nightly, nightly_but

import mbinterval as mb
from mbinterval.scene.model import Camera, Material, Mesh, Scene, Shutter, Texture

UNLIT = Material(shading="unlit")
FACES = [[0, 1, 2], [0, 2, 3]]
CURVES = {
    "box": ("box", [(0, 1), (1, 1)]),
    "table": ((0.2, 3.0, 0.0, 1.0, 1.0), [(0, 0.2), (0.25, 3), (0.5, 0), (0.75, 1), (1, 1)]),
    "triangle": ("triangle", [(0, 0), (0.5, 1), (1, 0)]),
}
METHODS = {
    "exact": {},
    "triangulated": {"paths": "triangulated", "occlusion": "exact"},
    "mask": {"occlusion": 64},
}


def openness(name: str, t: np.ndarray) -> np.ndarray:
    return np.interp(t, *np.array(CURVES[name][1], float).T)


def wall(near: float, far: float, **given: object) -> Mesh:
    """All that is seen, at depths from ``near`` to ``far`` while the shutter is open."""
    corners = 40.0 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    ends = np.stack([corners - [0, 0, near], corners - [0, 0, far]])
    return Mesh(ends, FACES, **({"material": UNLIT} | given))


def depths(*meshes: Mesh, curve: str = "box", shutter: Shutter | None = None, **settings: object):
    shutter = shutter or Shutter(0.0, 1.0, curve=CURVES[curve][0])
    scene = Scene(meshes, Camera(fov=40.0), shutter=shutter)
    chosen = mb.Settings(**({"samples": 1} | settings))
    film = mb.render(scene, frame=0.0, width=8, height=6, settings=chosen)
    return film.depth.astype(float)


def average(depth: np.ndarray, curve: str = "box", t: np.ndarray | None = None) -> float:
    """Mean of depths at the middles of as many equal parts of the shutter, or at times t."""
    t = (np.arange(len(depth)) + 0.5) / len(depth) if t is None else t
    light = openness(curve, t)
    return float(np.sum(light * depth) / np.sum(light))


T = (np.arange(200_000) + 0.5) / 200_000


@pytest.mark.parametrize("curve", nightly_but(CURVES, "box", "table"))
@pytest.mark.parametrize("method", nightly_but(METHODS, "exact", "triangulated"))
def test_a_wall_that_recedes_has_its_mean_depth(method, curve):
    found = depths(wall(2.0, 12.0), curve=curve, **METHODS[method])
    within = 2e-2 if method == "mask" and curve != "box" else 1e-6
    assert found == pytest.approx(average(2.0 + 10.0 * T, curve), rel=within)
    assert curve == "box" or abs(average(2.0 + 10.0 * T, curve) - 7.0) > 0.5 or curve == "triangle"


COLUMN, RIGHT = 4, 0.5 / 3.0 * np.tan(np.radians(20.0))
"""A column of pixels, and x of the rays (x, y, -1) through their centres."""


def swinging(short: float) -> np.ndarray:
    """Corners ``(2, 4, 3)`` of a wall that swings about its left edge, at both ends of its motion.

    At last the rays of `COLUMN` run along it, but for the share ``short`` of their x.
    """
    reach, hinge = 20.0 / short, -0.1
    way = np.array([RIGHT * (1.0 + short), -1.0])
    start = np.array([[hinge, -reach, -6], [reach, -reach, -6], [reach, reach, -6],
                      [hinge, reach, -6.0]])  # fmt: skip
    end = start.copy()
    end[1:3, [0, 2]] = [hinge, -6.0] + reach * way
    return np.stack([start, end])


def planes_depth(ends: np.ndarray, t: np.ndarray, x: float, y: float) -> np.ndarray:
    """Depth at which the ray through (x, y, -1) meets the first face's plane, at times t."""
    p = ends[0][:3] + t[:, None, None] * (ends[1] - ends[0])[:3]
    n = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    return np.einsum("ti,ti->t", n, p[:, 0]) / (n @ [x, y, -1.0])


@pytest.mark.parametrize("short", [0.1, 1e-3, nightly(1e-5)])
@pytest.mark.parametrize("curve", nightly_but(CURVES, "table"))
def test_a_wall_that_swings_nearly_through_the_eye_has_its_mean_depth(curve, short):
    """Its depth goes from 6 to 6 / short, most of it at last."""
    ends = swinging(short)
    found = depths(Mesh(ends, FACES, material=UNLIT, motion_segments=1), curve=curve)
    cuts = np.concatenate([np.linspace(0, 1, 101)[:-1], 1 - 2.0 ** -np.arange(7, 50), [1]])
    places, weights = np.polynomial.legendre.leggauss(12)
    t = (cuts[:-1, None] + np.diff(cuts)[:, None] * (0.5 + 0.5 * places)).ravel()
    light = (np.diff(cuts)[:, None] * weights).ravel() * openness(curve, t)
    w = planes_depth(ends, t, RIGHT, 0.0)
    assert w.max() > 3.0 / short
    want = np.sum(light * w) / np.sum(light)
    assert found[:, COLUMN] == pytest.approx(want, rel=1e-6)
    assert abs(planes_depth(ends, np.array([0.5]), RIGHT, 0.0)[0] / want - 1.0) > 0.02


def test_lines_of_a_rolling_shutter_have_the_mean_of_their_own_time():
    shutter = Shutter(0.0, rolling="down", line_offset=0.1 / 24, line_exposure=0.4 / 24,
                      curve=CURVES["table"][0])  # fmt: skip
    found = depths(wall(2.0, 12.0), shutter=shutter)
    for row in range(6):
        want = average(2.0 + 10.0 * (0.1 * row + 0.4 * T) / 0.9, "table")
        assert found[row] == pytest.approx(want, rel=1e-6)


@pytest.mark.parametrize("curve", ["box", nightly("table")])
def test_layers_of_a_stack_have_their_mean_depths(curve):
    pane = replace(UNLIT, opacity=0.3)
    found = depths(wall(2.0, 12.0, material=pane), wall(30.0, 14.0), curve=curve)
    want = average(0.3 * (2.0 + 10.0 * T) + 0.7 * (30.0 - 16.0 * T), curve)
    assert found == pytest.approx(want, rel=1e-6)


@pytest.mark.parametrize("curve", ["table", nightly("box")])
def test_depth_that_changes_with_alpha_is_their_common_mean(curve):
    """Alpha grows with time, as vertices say: what is near counts less than what is far."""
    clear, dense = (np.tile([1.0, 1, 1, a], (4, 1)) for a in (0.1, 0.9))
    pane = replace(UNLIT, alpha_mode="blend")
    front = wall(2.0, 12.0, material=pane, color=np.stack([clear, dense]), color_domain="vertex")
    found = depths(front, wall(30.0, 14.0), curve=curve, shading_error=1e-4)
    alpha = 0.1 + 0.8 * T
    want = average(alpha * (2.0 + 10.0 * T) + (1.0 - alpha) * (30.0 - 16.0 * T), curve)
    # Corners of the curve cost alpha some of its exactness, and depth with it.
    assert found == pytest.approx(want, rel=2e-5 if curve == "box" else 1e-3)
    apart = average(alpha, curve) * average(2.0 + 10.0 * T, curve)
    apart += (1.0 - average(alpha, curve)) * average(30.0 - 16.0 * T, curve)
    assert abs(apart / want - 1.0) > 0.02


def test_alpha_of_a_texture_leaves_depth_as_exact_as_it_is():
    image = np.ones((4, 4, 4))
    image[..., 3] = 0.25
    pane = replace(UNLIT, alpha_mode="blend", texture=Texture(image))
    front = wall(2.0, 12.0, material=pane, uv=[[0, 0], [1, 0], [1, 1], [0, 1]])
    found = depths(front, wall(30.0, 14.0), curve="table")
    want = average(0.25 * (2.0 + 10.0 * T) + 0.75 * (30.0 - 16.0 * T), "table")
    assert found == pytest.approx(want, rel=1e-6)


def test_a_mirror_has_its_own_mean_depth():
    """Behind what moves; whatever it shows is as far away as the mirror."""
    glass = Material(shading="unlit", reflectivity=0.5)
    still = Mesh(40.0 * np.array([[-1, -1, -0.2], [1, -1, -0.2], [1, 1, -0.2], [-1, 1, -0.2]]),
                 FACES, material=glass)  # fmt: skip
    pane = replace(UNLIT, opacity=0.3)
    found = depths(still, wall(2.0, 6.0, material=pane), curve="table")
    want = average(0.3 * (2.0 + 4.0 * T) + 0.7 * 8.0, "table")
    assert found == pytest.approx(want, rel=1e-6)


@pytest.mark.parametrize(
    "settings",
    [{"method": "stochastic", "samples": 1024}, {"method": "accumulation", "slices": 512}],
    ids=["point samples", "slices"],
)
def test_samples_in_time_come_to_the_same(settings):
    found = depths(wall(2.0, 12.0), curve="table", **({"samples": 1} | settings))
    assert found.mean() == pytest.approx(average(2.0 + 10.0 * T, "table"), rel=2e-3)
