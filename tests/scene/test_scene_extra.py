"""Models and benchmarks of ../shared, which are no part of the repository: each is read, and seen.

What they check is covered by files that the other tests make.
"""

from __future__ import annotations

import numpy as np
import pytest

import mbinterval as mb
from mbinterval.exposure.exposure import expose
from mbinterval.scene.formats.load import load

MODELS = (
    "animated_morph_cube/AnimatedMorphCube.gltf",
    "animated_morph_sphere/AnimatedMorphSphere.gltf",
    "cesium_milk_truck/CesiumMilkTruck.glb",
    "flight_helmet/FlightHelmet.gltf",
    "fox/Fox.glb",
    "godot_robot/robot.glb",
    "mannequiny/mannequiny.glb",
    "simple_skin/SimpleSkin.gltf",
    "spot/spot.obj",
    "suzanne/suzanne.obj",
    "teapot/teapot.obj",
    "usd_animatedcube/AnimatedCube.usdz",
    "usd_boxanimated/BoxAnimated.usdz",
    "usd_chess_bishop/Bishop_geom.ply",
    "usd_chess_bishop/Bishop_geom.usd",
    "usd_chess_knight/Knight_geom.ply",
    "usd_chess_knight/Knight_geom.usd",
    "usd_chess_pawn/Pawn_geom.ply",
    "usd_chess_pawn/Pawn_geom.usd",
    "usd_chess_queen/Queen_geom.ply",
    "usd_chess_queen/Queen_geom.usd",
    "usd_fancy_teapot/FancyTeapot.ply",
    "usd_fancy_teapot/FancyTeapot.usd",
    "usd_interpolationtest/InterpolationTest.usdz",
    "usd_openusd_blendshapes/blendshapes.usda",
    "usd_openusd_velocities/computeAtTime.usda",
    "usd_riggedfigure/RiggedFigure.usdz",
    "usd_riggedsimple/RiggedSimple.usdz",
    "usd_spinning_pyramids/Creases_SpinningPyramids.usda",
    "usd_utah_teapot/UtahTeapot.usd",
)
REFUSED = {"usd_openusd_velocities/computeAtTime.usda": "holds no mesh, only Cube"}
FRAMES = {"usd_openusd_blendshapes/blendshapes.usda": 20.0}  # flat, and edge-on until it turns


@pytest.mark.parametrize("name", MODELS)
def test_model(name, shared_file):
    """Every model is rendered as ``mbinterval render MODEL`` would, or says why not."""
    path = shared_file(f"assets/{name}")
    if name in REFUSED:
        with pytest.raises(mb.SceneError, match=REFUSED[name]):
            mb.load(path)
        return
    scene = mb.load(path)
    frame = FRAMES.get(name, 3.0)
    exposure = expose(scene, frame, 4 / 3)
    assert exposure.meshes
    assert any(np.ptp(mesh.positions) > 0 for mesh in exposure.meshes)
    film = mb.render(scene, frame=frame, width=64, height=48, settings=mb.Settings(samples=1))
    assert np.isfinite(film.rgba).all()
    assert film.rgba[..., 3].max() > 0.0


@pytest.mark.parametrize("name", ["cubes1000", "cubes2000", "sphere82k", "wheel"])
def test_benchmark(name, shared_file):
    path = shared_file(f"benchmark/{name}.npz")
    (mesh,) = expose(load(path), 0.0, 4 / 3).meshes
    with np.load(path) as stored:
        np.testing.assert_array_equal(mesh.positions[0], stored["V0"])
        np.testing.assert_array_equal(mesh.positions[1], stored["V1"])
        np.testing.assert_array_equal(mesh.face_color, stored["C"])
