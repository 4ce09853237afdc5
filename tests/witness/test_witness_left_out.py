"""What the random scenes leave out, because it is known to be wrong: each must fail today.

They are strict: what mends one takes its mark away, and a value of ``scenes.AXES`` comes in. What
is the case at one moment only, or needs a scene of its own, is in ``test_witness_cases.py``.
"""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from reference.witness import gltf
from reference.witness.compare import compare
from reference.witness.film import Asked
from reference.witness.product import Camera, Mesh, Scene, Track, Transform, load
from reference.witness.scenes import Case, Effects, Recipe, build
from support.gltf_files import Gltf

CENTRE = {"samples": 1, "pattern": "fixed", "shading_error": 5e-4}
ASKED = Asked(strata=16, repeats=16, centre=True)


def known(reason: str) -> Any:
    return pytest.mark.xfail(strict=True, raises=AssertionError, reason=reason)


def all_agree(effects: Effects, seeds: range) -> bool:
    return all(compare(build(Recipe(effects, seed))).agrees for seed in seeds)


@pytest.mark.parametrize("camera", ["still", "moving"])
def test_keys_inside_the_shutter_of_slow_motion_are_met_by_many_segments(camera):
    assert all_agree(Effects(keys="inside", sampling="centre", camera=camera), range(4))


@known("issue 19: keys are not knots")
def test_a_fast_turn_late_in_the_shutter():
    """``key_inside_shutter.toml`` of ``shared/cases/motion``, seen from a little nearer."""
    keys = Track([-0.25, 0.225, 0.25], [[-1.5, 0, 0], [1.5, 0, 0], [-1.5, 0.1, 0]])
    corners = [[-0.2, -0.2, 0], [0.2, -0.2, 0], [0.2, 0.2, 0], [-0.2, 0.2, 0]]
    square = Mesh(
        corners, [[0, 1, 2], [0, 2, 3]], shading="unlit", transform=Transform(translation=keys)
    )
    scene = Scene([square], Camera(position=(0, 0, 4), fov=40.0))
    asked = Asked(strata=64, repeats=16, centre=True)
    result = compare(Case(scene, 0.0, CENTRE, 1, asked, 5e-4, Effects()), size=(96, 72))
    assert result.agrees, result


@known("a light that moves stands where it is at the frame")
@pytest.mark.parametrize("shadows", ["", "shadows"])
def test_lights_that_move(shadows):
    effects = Effects(lights="moving", shading="phong", shadows=shadows, sampling="centre")
    assert all_agree(effects, range(3))


def test_lights_that_rest_where_a_transform_takes_them():
    for lights in ("lamps", "spots"):
        effects = Effects(lights=lights, shading="phong", sampling="centre")
        cases = [build(Recipe(effects, seed)) for seed in range(4)]
        assert any(light.transform for case in cases for light in case.scene.lights)
        assert all(compare(case).agrees for case in cases)


@known("a light that moves stands where it is at the frame")
def test_a_light_of_a_gltf_file_that_moves(tmp_path: Path):
    file = Gltf()
    corners = [[-2, -1, 0], [2, -1, 0], [2, 1, 0], [-2, 1, 0]]
    part = {
        "attributes": {"POSITION": file.accessor(corners)},
        "indices": file.accessor([0, 1, 2, 0, 2, 3], "H"),
    }
    file.json["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}]
    lamp = {"KHR_lights_punctual": {"light": 0}}
    nodes = [
        file.node(mesh=file.mesh(part)),
        file.node(camera=0, translation=[0, 0, 4]),
        file.node(extensions=lamp, translation=[0, 0, 1]),
    ]
    file.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    file.json["extensionsUsed"] = ["KHR_lights_punctual"]
    file.json["scenes"] = [{"nodes": nodes}]
    file.animate(nodes[2], "translation", [11 / 24, 13 / 24], [[-6, 0, 1], [6, 0, 1]])
    path = file.write(tmp_path / "lamp.gltf")
    scene, read = load(path, fps=24), gltf.read(path, 24)
    assert compare(Case(scene, 12.0, CENTRE, 1, ASKED, 1e-3, Effects(), read=read)).agrees


def turned(keys: list[list[float]], order: str) -> Case:
    """A plate by Euler keys a frame before and after, as both sides have it."""
    plate = {"positions": [[-0.9, -0.6, 0], [0.9, -0.6, 0], [0.9, 0.6, 0], [-0.9, 0.6, 0]],
             "faces": [[0, 1, 2], [0, 2, 3]], "material": {"shading": "unlit"}}  # fmt: skip
    given = {
        "camera": {"position": [0, 0, 4], "fov": 40},
        "background": [0.1, 0.2, 0.3],
        "objects": [plate | {"transform": {
            "euler_order": order,
            "keys": [{"frame": f, "euler": e} for f, e in zip((-1, 1), keys, strict=True)],
        }}],
    }  # fmt: skip
    scene = load(given)
    mesh = {name: getattr(scene.meshes[0], name) for name in
            ("positions", "faces", "normals", "uv", "color", "color_domain", "material", "visible",
             "motion_blur", "shutter_scale", "deformer", "name", "reflections")}  # fmt: skip
    node = SimpleNamespace(
        translation=(0, 0, 0), scale=(1, 1, 1), matrix=None, parent=None,
        euler=Track([-1.0, 1.0], keys), euler_order=order,
    )  # fmt: skip
    fields = {name: getattr(scene, name) for name in
              ("camera", "lights", "background", "environment", "shutter", "fps")}  # fmt: skip
    read = SimpleNamespace(meshes=[SimpleNamespace(**mesh, transform=node)], **fields)
    return Case(scene, 0.0, CENTRE, 1, ASKED, 5e-4, Effects(), read=read)


@pytest.mark.parametrize("keys", [[[0, 0, -50], [0, 0, 95]], [[0, 30, 0], [0, -100, 0]]])
def test_euler_keys_of_one_angle(keys):
    assert compare(turned(keys, "xyz")).agrees


def test_euler_angles_that_rest_turn_in_their_order():
    for order in ("xyz", "zyx", "yzx"):
        assert compare(turned([[40, -30, 25]] * 2, order)).agrees


@known("issue 19: Euler keys are slerped")
@pytest.mark.parametrize("order", ["xyz", "zxy"])
def test_euler_keys_of_several_angles(order):
    assert compare(turned([[0, 0, 0], [80, 90, 60]], order)).agrees
