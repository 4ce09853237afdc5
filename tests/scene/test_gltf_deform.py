"""Skins and morph targets of glTF files, against closed forms and against VTK's reader."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.gltf_files import Gltf
from support.nightly import nightly
from support.vtk_gltf import vtk_positions

from mbinterval.errors import SceneError, UsageError
from mbinterval.exposure.asked import Asked
from mbinterval.exposure.exposure import expose
from mbinterval.exposure.shutter_times import Window
from mbinterval.exposure.true_motion import world_positions
from mbinterval.scene.formats.gltf.gltf import read_gltf
from mbinterval.scene.formats.load import load
from mbinterval.scene.model import Scene, Shutter
from mbinterval.scene.transforms import Transform

FOX = Path(__file__).parents[2] / "scenes" / "assets" / "Fox.glb"
HALF = np.sqrt(0.5)
GRID = np.random.default_rng(7).uniform(-1, 1, (60, 3))
FACES = np.arange(60).reshape(20, 3)


def placed(meshes, seconds):
    """World positions of every mesh at ``seconds``; frames are seconds."""
    window, moment = Window(seconds, 0.0, 1.0), np.array([0.0])
    return [world_positions(mesh, window, moment)[0] for mesh in meshes]


def evaluated(path, seconds, clip=None):
    return placed(read_gltf(path, 1.0, clip).meshes, seconds)


def assert_like_vtk(path, *times, clip=0, tolerance=1e-6):
    meshes = read_gltf(path, 1.0, clip).meshes
    for seconds in times:
        ours, theirs = (
            sorted(found, key=lambda points: (len(points), float(points.sum())))
            for found in (placed(meshes, seconds), vtk_positions(path, seconds, clip))
        )
        assert [len(points) for points in ours] == [len(points) for points in theirs]
        for mine, other in zip(ours, theirs, strict=True):
            np.testing.assert_allclose(mine, other, atol=tolerance * np.ptp(other))


@pytest.mark.parametrize("clip", [0, 1, 2])
@pytest.mark.parametrize("seconds", [0.0, 0.137, 0.61, 9.0])
def test_the_fox_moves_as_vtk_has_it(clip, seconds):
    assert_like_vtk(FOX, seconds, clip=clip)


def test_the_comparison_with_vtk_tells_a_hundredth_of_a_second():
    with pytest.raises(AssertionError, match="Not equal to tolerance"):
        np.testing.assert_allclose(
            evaluated(FOX, 0.31, 1)[0], vtk_positions(FOX, 0.30, 1)[0], atol=1e-2
        )


@pytest.mark.parametrize(
    ("name", "clips", "tolerance"),
    [
        ("animated_morph_cube/AnimatedMorphCube.gltf", [0], 1e-6),
        ("animated_morph_sphere/AnimatedMorphSphere.gltf", [0], 1e-6),
        ("cesium_milk_truck/CesiumMilkTruck.glb", [0], 1e-6),
        ("godot_robot/robot.glb", range(8), 1e-6),
        ("mannequiny/mannequiny.glb", [3], 1e-6),
        nightly("mannequiny/mannequiny.glb", range(10), 1e-6),
        ("simple_skin/SimpleSkin.gltf", [0], 1e-4),  # its quaternions have lengths of 1 + 1e-4
    ],
)
def test_other_models_move_as_vtk_has_them(name, clips, tolerance, shared_file):
    path = shared_file(f"assets/{name}")
    for clip in clips:
        assert_like_vtk(path, 0.0, 0.137, 0.61, 2.3, clip=clip, tolerance=tolerance)


def skinned(gltf, sets=1, code="f", **more):
    """Random points on a chain of three joints that turn: nodes 1 to 3; node 0 has the mesh."""
    random = np.random.default_rng(3)
    attributes = {"POSITION": gltf.accessor(GRID)}
    weights = random.uniform(0.0, 1.0, (60, 4 * sets))
    weights /= weights.sum(axis=1, keepdims=True)
    for number in range(sets):
        part = weights[:, 4 * number : 4 * number + 4]
        if code != "f":
            part = np.rint(part * np.iinfo(np.dtype(code)).max)
        joints = random.integers(0, 3, (60, 4))
        attributes[f"JOINTS_{number}"] = gltf.accessor(joints, "B")
        normalized = {} if code == "f" else {"normalized": True}
        attributes[f"WEIGHTS_{number}"] = gltf.accessor(part, code, **normalized)
    gltf.mesh({"attributes": attributes | more})
    gltf.json["scenes"][0]["nodes"] = [0, 1]
    gltf.node(mesh=0, translation=[50, 60, 70])  # of no account: joints place a skin
    gltf.node(children=[2], translation=[0, 1, 0])
    gltf.node(children=[3], translation=[0.5, 0, 0], scale=[1, 2, 1])
    gltf.node(translation=[0, 0, 0.25])
    inverse = np.tile(np.eye(4), (3, 1, 1))
    inverse[:, :3, 3] = random.uniform(-1, 1, (3, 3))
    gltf.json["nodes"][0]["skin"] = gltf.skin([1, 2, 3], inverse)
    gltf.animate(1, "rotation", [0, 1], [[0, 0, 0, 1], [0, 0, HALF, HALF]])
    gltf.animate(2, "translation", [0, 2], [[0.5, 0, 0], [0, 3, 0]], "STEP")
    return gltf


@pytest.mark.parametrize("code", "fBH")
@pytest.mark.parametrize("seconds", [0.0, 0.3, 1.0, 2.5])
def test_weights_of_every_kind_are_as_vtk_has_them(tmp_path, code, seconds):
    path = skinned(Gltf(), code=code).write(tmp_path / "a.glb")
    assert_like_vtk(path, seconds, tolerance=1e-6 if code == "f" else 1e-2)
    weights = read_gltf(path, 1.0).meshes[0].deformer.skin.weights
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=1e-12)


def test_two_sets_of_joints_are_one_weighted_mean(tmp_path):
    """Against the formula of the specification; VTK reads one set only."""
    gltf = skinned(Gltf(), sets=2)
    mesh = read_gltf(gltf.write(tmp_path / "a.glb"), 1.0).meshes[0]
    skin = mesh.deformer.skin
    assert skin.weights.shape == (60, 8)
    matrices = skin.joints.at(0.4)
    points = np.append(GRID.astype(np.float32), np.ones((60, 1)), axis=1)
    expected = [
        sum(w * matrices[j] for w, j in zip(skin.weights[i], skin.indices[i], strict=True))
        @ points[i]
        for i in range(60)
    ]
    found = evaluated(tmp_path / "a.glb", 0.4)[0]
    np.testing.assert_allclose(found, np.array(expected)[:, :3], rtol=1e-12, atol=1e-12)
    # The second set counts: without it the vertices are elsewhere.
    kept = skin.weights[:, :4] / skin.weights[:, :4].sum(axis=1, keepdims=True)
    first = np.einsum("ni,nixy,ny->nx", kept, matrices[skin.indices[:, :4]], points)[:, :3]
    assert np.abs(first - found).max() > 0.1


def test_a_joint_turns_on_its_arc_between_keys(tmp_path):
    """A point one unit from a joint that turns by 90 degrees stays one unit away."""
    gltf = Gltf()
    attributes = {
        "POSITION": gltf.accessor([[1, 0, 0], [2, 0, 0], [1, 0, 1]]),
        "JOINTS_0": gltf.accessor([[0, 0, 0, 0]] * 3, "B"),
        "WEIGHTS_0": gltf.accessor([[1, 0, 0, 0]] * 3),
    }
    gltf.mesh({"attributes": attributes})
    gltf.json["scenes"][0]["nodes"] = [0, 1]
    gltf.node(mesh=0, skin=gltf.skin([1]))
    gltf.node()
    gltf.animate(1, "rotation", [0, 1], [[0, 0, 0, 1], [0, 0, HALF, HALF]])
    scene = load(gltf.write(tmp_path / "a.glb"), fps=1.0)
    mesh = expose(Scene(scene.meshes, shutter=Shutter(0, 1)), 0.0, 1.0, Asked(segments=8)).meshes[0]
    angle = np.radians(90) * np.arange(9) / 8
    expected = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    np.testing.assert_allclose(mesh.positions[:, 0], expected, atol=1e-7)


def test_normals_of_a_skin_stand_on_its_surface(tmp_path):
    """A scaled and mirrored joint: the shading normal is that of the moved triangle's front."""
    for scale in ([1, 1, 1], [3, 1, 0.5], [-1, 1, 2], [-1, -1, -1]):
        gltf = Gltf()
        corners = np.array([[0, 0, 0], [1, 0, 1], [0, 1, 0]])
        attributes = {
            "POSITION": gltf.accessor(corners),
            "NORMAL": gltf.accessor([np.cross(corners[1], corners[2])] * 3),
            "JOINTS_0": gltf.accessor([[0, 0, 0, 0]] * 3, "B"),
            "WEIGHTS_0": gltf.accessor([[1, 0, 0, 0]] * 3),
        }
        gltf.mesh({"attributes": attributes})
        gltf.json["scenes"][0]["nodes"] = [0, 1]
        gltf.node(mesh=0, skin=gltf.skin([1]))
        gltf.node(scale=scale, rotation=[0.1, 0.2, 0.3, 0.9])
        mesh = expose(load(gltf.write(tmp_path / "a.glb")), 0.0, 1.0).meshes[0]
        a, b, c = mesh.positions[0][mesh.mesh.faces[0]]
        front = np.cross(b - a, c - a)
        cosine = front @ mesh.normals[0, 0]
        cosine /= np.linalg.norm(front) * np.linalg.norm(mesh.normals[0, 0])
        assert cosine == pytest.approx(1.0, abs=1e-6)


def test_the_file_s_place_in_the_scene_moves_its_skins(tmp_path):
    path = skinned(Gltf()).write(tmp_path / "a.glb")
    root = Transform(translation=(10.0, 0.0, 0.0), scale=(2.0, 2.0, 2.0))
    here, there = (read_gltf(path, 1.0, None, r).meshes[0] for r in (None, root))
    np.testing.assert_allclose(
        there.deformer.positions(0.5), 2.0 * here.deformer.positions(0.5) + [10, 0, 0], rtol=1e-12
    )


def morphed(gltf, *, weights=None, node_weights=None, normals=False):
    random = np.random.default_rng(5)
    targets = [{"POSITION": gltf.accessor(random.normal(0, 1, (60, 3)))} for _ in range(3)]
    attributes = {"POSITION": gltf.accessor(GRID)}
    if normals:
        attributes["NORMAL"] = gltf.accessor(np.tile([0, 0, 1], (60, 1)))
        targets[1]["NORMAL"] = gltf.accessor(np.tile([1, 0, 0], (60, 1)))
    gltf.mesh({"attributes": attributes, "targets": targets})
    if weights is not None:
        gltf.json["meshes"][0]["weights"] = weights
    gltf.node(mesh=0, **({} if node_weights is None else {"weights": node_weights}))
    return gltf


MORPH_KEYS = np.array([[0, 0, 1], [1, 0.5, 0], [0, 1, 0.25]])


@pytest.mark.parametrize("interpolation", ["LINEAR", "STEP", "CUBICSPLINE"])
@pytest.mark.parametrize("seconds", [0.0, 0.4, 1.0, 1.7, 5.0])
def test_animated_morph_weights_are_as_vtk_has_them(tmp_path, interpolation, seconds):
    values = MORPH_KEYS
    if interpolation == "CUBICSPLINE":
        values = np.stack([MORPH_KEYS - 1, MORPH_KEYS, MORPH_KEYS / 2 + 0.1], axis=1)
    gltf = morphed(Gltf(), weights=[0, 0, 0])  # VTK counts these
    gltf.animate(0, "weights", [0, 1, 2], values.ravel(), interpolation)
    path = gltf.write(tmp_path / "a.glb")
    assert_like_vtk(path, seconds, tolerance=3e-6)
    if interpolation != "CUBICSPLINE":
        wanted = [np.interp(seconds, [0, 1, 2], column) for column in MORPH_KEYS.T]
        if interpolation == "STEP":
            wanted = MORPH_KEYS[min(int(seconds), 2)]
        targets = read_gltf(path, 1.0).meshes[0].deformer.morph.positions
        expected = GRID.astype(np.float32) + np.tensordot(wanted, targets, 1)
        np.testing.assert_allclose(evaluated(path, seconds)[0], expected, atol=1e-12)


@pytest.mark.parametrize(
    ("weights", "node_weights", "wanted"),
    [(None, None, [0, 0, 0]), ([1, 0, 0.5], None, [1, 0, 0.5]), ([1, 0, 0], [0, 2, 0], [0, 2, 0])],
)
def test_weights_at_rest_are_the_node_s_then_the_mesh_s(tmp_path, weights, node_weights, wanted):
    path = morphed(Gltf(), weights=weights, node_weights=node_weights).write(tmp_path / "a.glb")
    targets = read_gltf(path, 1.0).meshes[0].deformer.morph.positions
    expected = GRID.astype(np.float32) + np.tensordot(wanted, targets, 1)
    np.testing.assert_allclose(evaluated(path, 0.0)[0], expected, atol=1e-12)


def test_normals_are_morphed_too(tmp_path):
    path = morphed(Gltf(), weights=[0, 0.5, 1], normals=True).write(tmp_path / "a.glb")
    normals = expose(load(path), 0.0, 1.0).meshes[0].normals
    np.testing.assert_allclose(normals[0], np.tile([0.5, 0, 1], (60, 1)))


def test_a_morphed_skin_is_morphed_first(tmp_path):
    gltf = skinned(Gltf())
    target = gltf.accessor(np.random.default_rng(1).normal(0, 1, (60, 3)))
    gltf.json["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": target}]
    gltf.json["meshes"][0]["weights"] = [0.0]
    gltf.animate(0, "weights", [0, 1], [0.0, 1.0])
    for seconds in (0.0, 0.6):
        assert_like_vtk(gltf.write(tmp_path / "a.glb"), seconds)


@pytest.mark.parametrize("interpolation", ["LINEAR", "CUBICSPLINE"])
def test_rotations_of_joints_are_as_vtk_has_them(tmp_path, interpolation):
    gltf = skinned(Gltf())
    keys = np.array([[0, 0, 0, 1], [0.5, 0.5, 0.5, 0.5], [0, 1, 0, 0]])
    if interpolation == "CUBICSPLINE":
        keys = np.stack([0 * keys, keys, np.roll(keys, 1, axis=1)], axis=1).reshape(-1, 4)
    gltf.animate(3, "rotation", [0, 0.5, 2], keys, interpolation)
    path = gltf.write(tmp_path / "a.glb")
    for seconds in (0.2, 0.9, 1.5):
        assert_like_vtk(path, seconds, tolerance=3e-6)


def test_a_vertex_without_weights_follows_its_first_joint(tmp_path):
    gltf = Gltf()
    attributes = {
        "POSITION": gltf.accessor([[1, 0, 0], [2, 0, 0], [1, 0, 1]]),
        "JOINTS_0": gltf.accessor([[0, 0, 0, 0]] * 3, "B"),
        "WEIGHTS_0": gltf.accessor(np.zeros((3, 4))),
    }
    gltf.mesh({"attributes": attributes})
    gltf.json["scenes"][0]["nodes"] = [0, 1]
    gltf.node(mesh=0, skin=gltf.skin([1]))
    gltf.node(translation=[0, 5, 0])
    points = evaluated(gltf.write(tmp_path / "a.glb"), 0.0)[0]
    np.testing.assert_allclose(points, [[1, 5, 0], [2, 5, 0], [1, 5, 1]])


def damage_joint(gltf):
    gltf.json["skins"][0]["joints"][1] = 77


def damage_index(gltf):
    gltf.json["skins"][0]["joints"] = [1]
    gltf.json["skins"][0].pop("inverseBindMatrices")


def damage_target(gltf):
    few = gltf.accessor([[0, 0, 0]])
    gltf.json["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": few}]


def damage_weights(gltf):
    target = gltf.accessor(np.zeros((60, 3)))
    gltf.json["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": target}]
    gltf.json["meshes"][0]["weights"] = [1, 2]


def damage_track(gltf):
    gltf.animate(0, "weights", [0, 1], [1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (damage_joint, "joint node 77 is not in the scene"),
        (damage_index, r"vertex \d+ follows joint 2 of 1"),
        (damage_target, "a morph target has 1 vertices for 60"),
        (damage_weights, "2 morph weights for 1 targets"),
        (damage_track, "a weights channel has 2 times and 3 numbers"),
    ],
)
def test_damaged_skins_and_morphs_are_scene_errors(tmp_path, damage, said):
    gltf = skinned(Gltf())
    damage(gltf)
    with pytest.raises(SceneError, match=rf"a\.glb: .*{said}"):
        read_gltf(gltf.write(tmp_path / "a.glb"), 1.0)


def test_a_model_alone_takes_clip_and_frames_per_second():
    walk, run = (load(FOX, clip=clip, fps=30) for clip in ("Walk", 2))
    assert walk.animation == pytest.approx((0.0, 30 * 0.708333), abs=1e-4)
    assert run.animation == pytest.approx((0.0, 30 * 1.158333), abs=1e-4)
    assert walk.fps == 30
    with pytest.raises(SceneError, match="no clip 'Fly'; the file has: Survey, Walk, Run"):
        load(FOX, clip="Fly")
    with pytest.raises(UsageError, match="fps=0"):
        load(FOX, fps=0)
    with pytest.raises(UsageError, match="scene file has them per object"):
        load({"objects": []}, clip="Walk")


def test_frames_outside_the_animation_are_said():
    scene = load(FOX, clip="Walk")
    assert not any("outside" in note for note in expose(scene, 17.0, 1.0).notes)
    assert (
        "frame 18 is outside the animation that was read, frames 0 to 17"
        in expose(scene, 18.0, 1.0).notes
    )


def test_the_framing_camera_sees_the_whole_animation(tmp_path):
    gltf = Gltf()
    gltf.triangle()
    gltf.node(mesh=0)
    gltf.animate(0, "translation", [0, 1], [[0, 0, 0], [40, 0, 0]])
    scene = load(gltf.write(tmp_path / "a.glb"))
    for frame in (0.0, 12.0, 24.0):
        exposure = expose(scene, frame, 1.5)
        poses = exposure.path.opening
        seen = (exposure.meshes[0].positions[0] - poses.eye[0]) @ poses.rotation[0].T
        assert (np.abs(seen[:, :2] / -seen[:, 2:] * poses.focal[0]) < [0.75, 0.5]).all()
