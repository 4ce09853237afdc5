"""A scene of an environment alone: its shutter's curve and the lines of one that rolls.

Against the closed form of what passes: stripes around the horizon, while the camera turns evenly.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.environments import environment, stripes
from support.nightly import nightly

import mbinterval as mb
from mbinterval.plan.prepare import prepare

SIZE = (24, 16)
FOV = 40.0
TURN = 60.0
"""Degrees in the frame's exposure, the first half of them before the frame."""
METHODS = {
    "analytic": ({"samples": 1}, 2e-3),
    "stochastic": ({"samples": 1024, "filter_radius": 0.01}, 4e-3),
    "accumulation": ({"samples": 1, "slices": 256}, 2e-3),
}
CURVES = {
    "box": {},
    "triangle": {"curve": "triangle"},
    "trapezoid": {"curve": "trapezoid", "opening": 0.1, "closing": 0.7},
    "table": {"curve": (0.2, 0.0, 0.0, 1.0, 0.5)},
}
EXPOSURE = 0.3 / 24  # seconds of a line, with lines over 0.7 of the frame's


def rolling(way: str) -> dict[str, object]:
    lines = SIZE[0] if way in ("left", "right") else SIZE[1]
    return {"rolling": way, "line_offset": 0.7 / 24 / lines, "line_exposure": EXPOSURE}


def scene(**shutter: object) -> mb.Scene:
    frames = np.linspace(-0.5, 0.5, 61)
    turn = np.radians(TURN) * frames
    aims = np.stack([np.sin(turn), 0.0 * turn, -np.cos(turn)], axis=1)
    return mb.Scene(
        meshes=[], camera=mb.Camera(look_at=mb.Track(frames, aims), fov=FOV),
        environment=environment(stripes, 256), shutter=mb.Shutter(-0.5, 0.5, **shutter),
    )  # fmt: skip


def film(of: mb.Scene, method: str) -> np.ndarray:
    settings = mb.Settings(method=method, motion_error=0.01, **METHODS[method][0])
    return mb.render(of, frame=0, width=SIZE[0], height=SIZE[1], settings=settings).rgba


def openness(shutter: mb.Shutter, count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Times of a line's exposure, from 0 to 1, and the light that passes at each."""
    t = (np.arange(count) + 0.5) / count
    corners = {
        "box": [(0, 1), (1, 1)],
        "triangle": [(0, 0), (0.5, 1), (1, 0)],
        "trapezoid": [(0, 0), (shutter.opening, 1), (1 - shutter.closing, 1), (1, 0)],
    }
    if isinstance(shutter.curve, str):
        x, y = np.transpose(corners[shutter.curve])
    else:
        x, y = np.linspace(0, 1, len(shutter.curve)), np.array(shutter.curve)
    light = np.interp(t, x, y)
    return t, light / light.sum()


def begins(shutter: mb.Shutter) -> np.ndarray:
    """When each pixel's line begins to be exposed, in frames after the shutter opens ``(h, w)``."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    place = {"down": y, "up": SIZE[1] - 1 - y, "right": x, "left": SIZE[0] - 1 - x}
    if shutter.rolling is None:
        return np.zeros((SIZE[1], SIZE[0]))
    return place[shutter.rolling] * shutter.line_offset * 24.0


def expected(of: mb.Scene, late: float = 0.0) -> np.ndarray:
    """``(h, w, 3)``: the mean of what passes each pixel's centre, so many frames too late."""
    shutter = of.shutter
    t, light = openness(shutter)
    length = 1.0 if shutter.rolling is None else EXPOSURE * 24.0
    x = (np.arange(SIZE[0]) + 0.5 - SIZE[0] / 2) / SIZE[1] * 2.0 * np.tan(np.radians(FOV / 2))
    after = begins(shutter)[..., None] + length * t - 0.5 + late
    longitude = np.arctan(x)[None, :, None] + np.radians(TURN) * after
    ways = np.stack([np.sin(longitude), 0.0 * longitude, -np.cos(longitude)], axis=-1)
    return np.einsum("t,hwtc->hwc", light, stripes(ways))


@pytest.mark.parametrize(
    ("method", "shutter"),
    [
        *[("analytic", CURVES[name]) for name in CURVES],
        ("stochastic", CURVES["table"]),
        ("accumulation", CURVES["table"]),
        *[("analytic", rolling(way)) for way in ("down", "up", "right", "left")],
        ("analytic", rolling("up") | CURVES["trapezoid"]),
        nightly("analytic", rolling("left") | CURVES["table"]),
        *[(m, rolling(way)) for m in ("stochastic", "accumulation") for way in ("up", "right")],
        *[nightly(m, rolling(way)) for m in ("stochastic", "accumulation")
          for way in ("down", "left")],
        nightly("stochastic", rolling("left") | CURVES["triangle"]),
    ],
)  # fmt: skip
def test_it_is_the_mean_of_what_passes_while_the_shutter_is_open(method, shutter):
    of, allowed = scene(**shutter), METHODS[method][1]
    found = film(of, method)
    assert np.abs(found[..., :3] - expected(of)).max() < allowed
    assert np.abs(found[..., :3] - expected(of, late=0.02)).max() > 2 * allowed
    assert (found[..., 3] == 0.0).all()


def test_no_mesh_changes_what_is_seen_of_it():
    """One out of sight has motion paths, which the shutter used to need."""
    of = scene(**rolling("down"), curve="triangle")
    behind = mb.Mesh(positions=np.eye(3) + [0, 0, 900.0], faces=[[0, 1, 2]], material=None)
    alone, other = film(of, "analytic"), film(replace(of, meshes=[behind]), "analytic")
    assert np.abs(alone - other).max() < 1e-6


def macros(of: mb.Scene, **settings: object) -> frozenset[str]:
    wanted = mb.Settings(**settings)
    return prepare(of, 0.0, *SIZE, wanted).plan.active & {"SHUTTER_CURVE", "ROLLING"}


@pytest.mark.parametrize("method", ["analytic", "stochastic", "accumulation"])
def test_what_stays_the_same_all_the_time_calls_for_no_code_of_a_shutter(method):
    of = scene(**rolling("down"), curve="triangle")
    both = {"SHUTTER_CURVE", "ROLLING"}
    assert macros(of, method=method) == both
    assert not macros(of, method=method, transparent=True)
    assert not macros(replace(of, environment=None), method=method)
    still = mb.Camera(look_at=(0, 0, -1), fov=FOV)
    assert not macros(replace(of, camera=still), method=method)
    flies = mb.Camera(position=mb.Track([-0.5, 0.5], [[0, 0, 0], [9, 9, 9]]),
                      look_at=mb.Track([-0.5, 0.5], [[0, 0, -1], [9, 9, 8]]), fov=FOV)  # fmt: skip
    assert not macros(replace(of, camera=flies), method=method)
    zooms = replace(still, fov=mb.Track([-0.5, 0.5], [40.0, 50.0]))
    assert macros(replace(of, camera=zooms), method=method) == both
    assert not macros(replace(of, camera=zooms, environment=replace(of.environment,
                      background=False)), method=method)  # fmt: skip
