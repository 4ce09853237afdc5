"""Flat normals of what deforms are those of the moment: closed forms, in all methods."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.nightly import nightly_but

import mbinterval as mb
from mbinterval.plan.prepare import prepare
from mbinterval.scene.deform import Morph, MorphedSkin, NodeJoints, Skin
from mbinterval.scene.model import Camera, Light, Material, Mesh, Scene, Shutter
from mbinterval.scene.tracks import Track, Transform

START = np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0.0]])
WAY = np.array([[0, 0, 1.5], [0, 0, -1.5], [0, 0, 0]])
"""How far the vertices go while the shutter is open: the face turns by 56 degrees."""
HERE, FAR = np.zeros(3), np.array([148376.0, 1234.0, -223423.0])
SUN = np.array([-1, 0, -1]) / np.sqrt(2.0)
MATTE = Material(specular=(0.0, 0.0, 0.0))
METHODS = {
    "exact": {"samples": 1, "shading_error": 1e-4},
    "triangulated": {"paths": "triangulated", "occlusion": "exact", "samples": 1,
                     "texture_samples": 64},
    "point samples": {"method": "stochastic", "samples": 256},
    "slices": {"method": "accumulation", "slices": 128, "samples": 1},
}  # fmt: skip


def normals(t: np.ndarray) -> np.ndarray:
    """Unit normals ``(T, 3)`` at times of the shutter."""
    p = START + np.asarray(t)[:, None, None] * WAY
    n = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def track(values: object) -> Track:
    return Track([0.0, 1.0], values)


def arrays() -> Mesh:
    return Mesh(np.stack([START, START + WAY]), [[0, 1, 2]])


def morphed() -> Mesh:
    morph = Morph(WAY[None], None, track([[0.0], [1.0]]))
    return Mesh(START, [[0, 1, 2]], deformer=MorphedSkin(START, None, morph))


def skinned() -> Mesh:
    """Every vertex has a bone of its own."""
    bones = tuple(Transform(translation=track([[0, 0, 0], way])) for way in WAY)
    joints = NodeJoints(bones, np.tile(np.eye(4), (3, 1, 1)))
    skin = Skin(joints, np.arange(3)[:, None], np.ones((3, 1)))
    return Mesh(START, [[0, 1, 2]], deformer=MorphedSkin(START, None, skin=skin))


def scaled() -> Mesh:
    scale = track([[1, 1, 0.0], [1, 1, 1]])
    return Mesh(START + WAY, [[0, 1, 2]], transform=Transform(scale=scale))


KINDS = {"arrays": arrays, "morphed": morphed, "skinned": skinned, "scaled": scaled}


def moved(mesh: Mesh, size: float, by: np.ndarray) -> Mesh:
    """``mesh``, made smaller and put elsewhere."""
    place = Transform(translation=tuple(by), scale=(size,) * 3)
    return replace(mesh, transform=replace(mesh.transform or Transform(), parent=place))


def lit(mesh: Mesh, at: np.ndarray = HERE, size: float = 1.0, **given: object) -> Scene:
    """The mesh, seen from the front and lit by one sun."""
    camera = Camera(position=tuple(at + [0, 0, 4 * size]), look_at=tuple(at), fov=40.0)
    given = {"camera": camera, "shutter": Shutter(0.0, 1.0)} | given
    mesh = moved(replace(mesh, material=MATTE), size, at)
    return Scene([mesh], lights=[Light("directional", direction=tuple(SUN))], **given)


def middle(of: Scene, **settings: object) -> mb.Film:
    """The pixel in the middle, which the face covers all the time."""
    chosen = mb.Settings(**settings)
    return mb.render(of, frame=0.0, width=9, height=9, settings=chosen, crop=(4, 4, 1, 1))


@pytest.mark.parametrize(("size", "at"), [(1.0, HERE), (0.01, FAR)], ids=["near", "far"])
@pytest.mark.parametrize("method", list(METHODS))
def test_a_face_that_bends_is_as_bright_as_its_normal_says_at_each_moment(method, size, at):
    t = (np.arange(100_000) + 0.5) / 100_000
    want = np.maximum(normals(t) @ -SUN, 0.0).mean()
    found = middle(lit(arrays(), at, size), **METHODS[method]).rgba[0, 0]
    assert found == pytest.approx([want] * 3 + [1.0], abs=3e-4)
    first, last = normals(np.array([0.0, 1.0]))
    blended = (1 - t)[:, None] * first + t[:, None] * last
    blended /= np.linalg.norm(blended, axis=1, keepdims=True)
    assert abs(np.maximum(blended @ -SUN, 0.0).mean() - want) > 0.01


@pytest.mark.parametrize("kind", nightly_but(KINDS, "skinned"))
def test_whatever_deforms_it_the_face_is_as_bright(kind):
    want = middle(lit(arrays()), **METHODS["exact"]).rgba[0, 0]
    assert middle(lit(KINDS[kind]()), **METHODS["exact"]).rgba[0, 0] == pytest.approx(
        want, abs=1e-6
    )


@pytest.mark.parametrize("paths", ["exact", "triangulated"])
def test_the_layer_has_the_normal_of_the_moment(paths):
    occlusion = "exact"
    for size, at in ((1.0, HERE), (0.01, FAR)):
        for t in (0.0, 0.2, 0.5, 0.95):
            found = middle(lit(arrays(), at, size), aovs=("normal",), aov_time=t, samples=1,
                           paths=paths, occlusion=occlusion)  # fmt: skip
            assert found.layers["normal"][0, 0] == pytest.approx(normals([t])[0], abs=1e-6)


def test_a_camera_that_turns_changes_no_normal():
    turn = [[0, np.sin(a), 0, np.cos(a)] for a in np.radians([-4.0, 4.0])]
    place = Transform(translation=(0, 0, 4), rotation=Track([0.0, 1.0], turn, "linear", True))
    scene = lit(arrays(), camera=Camera(transform=place, fov=40.0))
    for segments in (1, 3):
        for t in (0.2, 0.5):
            found = middle(scene, aovs=("normal",), aov_time=t, samples=1, motion_segments=segments)
            assert found.layers["normal"][0, 0] == pytest.approx(normals([t])[0], abs=1e-6)


def test_only_faces_that_turn_ask_for_it():
    def asks(mesh: Mesh, material: Material = MATTE, **settings: object) -> bool:
        scene = Scene([replace(mesh, material=material)], shutter=Shutter(0.0, 1.0))
        return "FACES_TURN" in prepare(scene, 0.0, 8, 8, mb.Settings(**settings)).plan.active

    still = Mesh(START, [[0, 1, 2]])
    slides = replace(still, transform=Transform(translation=track([FAR, FAR + 0.3])))
    unlit = Material(shading="unlit")
    assert asks(arrays())
    assert asks(replace(still, transform=Transform(rotation=Track(
        [0.0, 1.0], [[0, 0, 0, 1], [0, 0.6, 0, 0.8]], "linear", True))))  # fmt: skip
    assert asks(arrays(), unlit, aovs=("normal",))
    assert not asks(arrays(), unlit)
    assert not asks(replace(arrays(), normals=[[0, 0, 1.0]] * 3))
    assert not asks(still)
    assert not asks(slides)
