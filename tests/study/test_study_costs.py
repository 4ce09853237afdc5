"""Changed scenes of a study: what a curve varies and an effect that is off are what they say."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from support.nightly import nightly_but

import mbinterval as mb
from mbinterval.bench.cases import make_case
from mbinterval.bench.meter import MeteredRuntime
from mbinterval.device.choose import choose_device
from mbinterval.scene.generators import fast_cubes
from mbinterval.study.costs import (
    CURVES,
    METHODS,
    active_effects,
    at_speed,
    curve,
    effects,
    split_in_four,
)
from mbinterval.study.switches import SWITCHES

SCENES = Path(__file__).parents[2] / "scenes"
FILES = sorted(SCENES.glob("*.toml"))


def picture(scene, frame=1.0, **settings):
    return mb.render(
        scene, frame=frame, width=64, height=48, settings=mb.Settings(**settings)
    ).rgba[..., :3]


def rms(difference):
    return float(np.sqrt(np.mean(np.square(difference, dtype=float))))


@pytest.fixture(scope="module")
def meter():
    return MeteredRuntime(choose_device())


def test_splitting_triangles_leaves_the_picture_as_it_was():
    scene = fast_cubes(30)
    finer = split_in_four(split_in_four(scene))
    assert len(finer.meshes[0].faces) == 16 * len(scene.meshes[0].faces)
    assert rms(picture(finer) - picture(scene)) < 1e-6


@pytest.mark.parametrize("name", ["rolling_wheel", "milk_truck"])
def test_attributes_are_split_too(name):
    """Textures, normals and colours are linear over triangles, but for the normals' lengths."""
    case = make_case(str(SCENES / f"{name}.toml"), width=64, height=48)
    before = picture(case.scene, case.frame)
    assert rms(picture(split_in_four(case.scene), case.frame) - before) < 2e-3


def test_speed_scales_motion_about_the_middle_of_the_shutter():
    scene = fast_cubes(5)
    first = scene.meshes[0].positions
    fast = at_speed(scene, 3.0).meshes[0].positions
    assert np.allclose(fast[1] - fast[0], 3.0 * (first[1] - first[0]))
    assert np.allclose(fast.mean(axis=0), first.mean(axis=0))
    shutter = at_speed(scene, 3.0).shutter
    assert (shutter.open, shutter.close) == (-0.75, 0.75)


@pytest.mark.parametrize(
    "name",
    nightly_but((path.stem for path in FILES), "propeller", "rolling_wheel", "slab_behind_slit"),
)
def test_no_motion_is_a_picture_that_does_not_depend_on_the_shutter(name):
    case = make_case(str(SCENES / f"{name}.toml"), width=64, height=48)
    if name == "rolling_wheel":  # it begins outside of the picture
        case = dataclasses.replace(case, frame=12.0)
    still = SWITCHES["motion"][1](case.scene, case.frame)
    first = picture(still, case.frame)
    longer = dataclasses.replace(still, shutter=mb.Shutter(open=-0.1, close=0.7))
    assert rms(picture(longer, case.frame) - first) < 1e-6
    assert rms(picture(case.scene, case.frame) - first) > 1e-4


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_an_effect_that_is_switched_off_is_off(path, meter):
    case = make_case(str(path), width=32, height=24)
    active = {effect.name for effect in active_effects(case)}
    for name in active & SWITCHES.keys():
        scene = SWITCHES[name][1](case.scene, case.frame)
        left = active_effects(dataclasses.replace(case, scene=scene))
        assert name not in {effect.name for effect in left}


def test_lens_and_shutter_are_switched_off_too():
    shutter = mb.Shutter(curve="triangle", rolling="down", line_offset=1e-4, line_exposure=0.01)
    camera = mb.Camera(position=(0, 0, 9), f_stop=2.0, focus_distance=9.0, sharp_range=(8, 10))
    scene = dataclasses.replace(fast_cubes(5), camera=camera, shutter=shutter)
    assert SWITCHES["lens"][1](scene, 1.0).camera.f_stop is None
    assert SWITCHES["shutter curve"][1](scene, 1.0).shutter.curve == "box"
    plain = SWITCHES["rolling shutter"][1](scene, 1.0).shutter
    assert plain.rolling is None
    assert plain.close - plain.open == pytest.approx(0.24)  # 0.01 s of 24 frames a second


def test_effects_are_measured_one_by_one(meter):
    case = make_case("fast_cubes:20", width=32, height=24)
    found = effects(case, 1, meter)
    assert [one["effect"] for one in found] == ["", "motion", "single-sided"]
    for one in found:
        assert [row["name"] for row in one["rows"]] == list(METHODS)
        assert all(row["median"] > 0 for row in one["rows"])


@pytest.mark.parametrize("name", ["cubes", "speed", "triangles"])
def test_a_curve_has_points_that_rise(name, meter, monkeypatch):
    from mbinterval.study import costs

    monkeypatch.setattr(costs, "_CUBES", (10, 20))
    monkeypatch.setattr(costs, "_MOST_TRIANGLES", 4000)
    case = make_case("fast_cubes:20", width=32, height=24)
    found = curve(name, case, 1, meter)
    across = [point["x"] for point in found["points"]]
    assert len(across) >= 2
    assert across == sorted(across)
    counts = [point["triangles"] for point in found["points"]]
    expected = {"cubes": [120, 240], "speed": [240] * 5, "triangles": [240, 960, 3840]}
    assert counts == expected[name]
    assert set(CURVES) == {"cubes", "speed", "triangles"}
