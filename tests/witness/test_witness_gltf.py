"""glTF files that are written at random, and shipped ones, against the witness's own reader.

Everything on the way from the bytes of a file to its film is looked at: types of arrays, nodes,
animation, skins, morph targets, materials, textures, cameras and lights.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from reference.witness import gltf, gltf_scenes
from reference.witness.compare import compare
from reference.witness.film import Asked
from reference.witness.product import Camera, Light, load
from reference.witness.scenes import Case, Effects
from support.nightly import nightly

ASSETS = Path(__file__).parents[2] / "scenes" / "assets"
CENTRE = {"samples": 1, "pattern": "fixed", "shading_error": 5e-4}
POINTS = {"method": "stochastic", "samples": 32, "pattern": "sobol"}


def case(path: Path, frame: float, clip: int = 0) -> Case:
    """A file as both sides read it, looked at by pixels' centres."""
    asked = Asked(strata=16, repeats=16, centre=True)
    return Case(
        load(path, fps=gltf_scenes.FPS, clip=clip), frame, CENTRE, 1, asked, 5e-4, Effects(),
        read=gltf.read(path, gltf_scenes.FPS, clip),
    )  # fmt: skip


@pytest.mark.parametrize("count", [8, nightly(200)])
@pytest.mark.parametrize("ending", [".gltf", ".glb"])
@pytest.mark.parametrize("lit", [False, True])
def test_random_files_are_what_the_witness_reads(tmp_path, lit, ending, count):
    for seed in range(count):
        path = tmp_path / f"scene{ending}"
        frame = gltf_scenes.write(path, seed, lit, blend=ending == ".glb")
        result = compare(case(path, frame))
        assert result.agrees, (seed, result)


def test_a_file_that_is_read_a_little_late_is_told(tmp_path):
    path = tmp_path / "scene.glb"
    frame = gltf_scenes.write(path, 3, True, False)
    asked = case(path, frame)
    late = replace(asked, scene=load(path, fps=gltf_scenes.FPS * 1.01))
    assert compare(asked).agrees
    assert not compare(late).agrees


CAMERA = Camera(position=(130.0, 60.0, 80.0), look_at=(0.0, 35.0, 0.0), fov=50.0)
LIGHTS = (Light("ambient", intensity=0.3), Light("directional", direction=(-1, -1, -2)))


def shipped(
    path: Path, frame: float, camera: Camera, settings: dict[str, Any], clip: int = 0
) -> Case:
    """A model with a camera and lights of the test's."""
    asked = case(path, frame, clip)
    scene, read = replace(asked.scene, camera=camera, lights=LIGHTS), asked.read
    read.camera, read.lights = camera, LIGHTS
    points = settings is not CENTRE
    return replace(
        asked, scene=scene, settings=settings, repeats=8 if points else 1,
        asked=replace(asked.asked, centre=not points, strata=8, repeats=12),
        allowed=0.01,
    )  # fmt: skip


@pytest.mark.parametrize("settings", [CENTRE, nightly(POINTS)], ids=["analytic", "points"])
def test_the_fox_is_what_the_witness_reads(settings):
    """It runs: a skin of 24 joints, with a texture of which a pixel has many texels."""
    result = compare(shipped(ASSETS / "Fox.glb", 5.0, CAMERA, settings, clip=2))
    assert result.agrees, result


SMALL = {
    "simple_skin/SimpleSkin.gltf": ((0.2, 0.9, 4.0), (0, 1, 0)),
    "animated_morph_cube/AnimatedMorphCube.gltf": ((2.0, 3.0, 5.0), (0, 0, 0)),
}


@pytest.mark.parametrize("name", SMALL)
def test_small_models_are_what_the_witness_reads(shared_file, name):
    place, target = SMALL[name]
    camera = Camera(position=place, look_at=target, fov=45.0)
    result = compare(shipped(shared_file(f"assets/{name}"), 12.0, camera, CENTRE))
    assert result.agrees, result
