"""An exposure freezes every source of motion at K+1 times of the shutter."""

from __future__ import annotations

import numpy as np
import pytest

from mbinterval.errors import SceneError
from mbinterval.exposure.asked import Asked
from mbinterval.exposure.exposure import expose
from mbinterval.scene.model import Camera, Light, Material, Mesh, Scene, Shutter
from mbinterval.scene.tracks import Track
from mbinterval.scene.transforms import Transform

TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
FACES = np.array([[0, 1, 2]])
CAMERA = Camera(position=(0, 0, 5), look_at=(0, 0, 0))


def mesh(**fields):
    return Mesh(**({"positions": TRIANGLE, "faces": FACES, "shading": "unlit"} | fields))


def exposed(*meshes, frame=0.0, camera=CAMERA, motion_segments=None, **scene):
    return expose(Scene(meshes, camera, **scene), frame, 1.5, Asked(segments=motion_segments))


def keyed(*pairs, **options):
    frames, values = zip(*pairs, strict=True)
    return Track(np.array(frames, float), np.array(values, float), **options)


MOVING = Transform(translation=keyed((0, (0, 0, 0)), (10, (10, 20, 0))))


@pytest.mark.parametrize("segments", [1, 2, 5])
def test_keys_are_sampled_at_the_ends_of_the_segments(segments):
    shutter = Shutter(-0.5, 1.0)
    result = exposed(
        mesh(transform=MOVING), frame=3, shutter=shutter, motion_segments=segments
    ).meshes[0]
    times = 3 - 0.5 + 1.5 * result.knots
    expected = TRIANGLE + times[:, None, None] * (1, 2, 0)
    assert result.segments == segments
    np.testing.assert_allclose(result.knots, np.arange(segments + 1) / segments, atol=1e-7)
    np.testing.assert_allclose(result.positions, expected, rtol=1e-15)
    late = exposed(mesh(transform=MOVING), frame=3.01, shutter=shutter, motion_segments=segments)
    assert np.abs(late.meshes[0].positions - expected).min(axis=(1, 2))[0] == 0
    assert np.abs(late.meshes[0].positions - expected)[..., 0].min() > 0.009


def test_a_mesh_s_own_segments_win_over_the_setting():
    meshes = [mesh(transform=MOVING, motion_segments=3), mesh(transform=MOVING)]
    result = exposed(*meshes, motion_segments=2)
    assert [m.segments for m in result.meshes] == [3, 2]
    assert [len(m.poses.eye) for m in result.meshes] == [4, 3]


def test_what_does_not_move_has_no_segments_and_one_time():
    meshes = [
        mesh(),
        mesh(transform=Transform(translation=keyed((0, (1, 2, 3))))),
        mesh(positions=np.stack([TRIANGLE] * 3)),
        mesh(transform=MOVING),
    ]
    result = exposed(*meshes, frame=5, motion_segments=2)
    assert [m.segments for m in result.meshes] == [0, 0, 0, 2]
    assert [len(m.positions) for m in result.meshes] == [1, 1, 1, 3]
    # After its last key the fourth mesh stands still as well.
    assert exposed(*meshes, frame=50).meshes[3].segments == 0
    assert not result.path.moves


@pytest.mark.parametrize(
    "camera",
    [
        Camera(position=keyed((0, (0, 0, 5)), (1, (1, 0, 5))), look_at=(0, 0, 0)),
        Camera(position=(0, 0, 5), look_at=keyed((0, (0, 0, 0)), (1, (1, 0, 0)))),
        Camera(position=(0, 0, 5), fov=keyed((0, 30), (1, 60))),
        Camera(
            transform=Transform(
                rotation=keyed((0, (0, 0, 0, 1)), (1, (0, 1, 0, 1)), quaternion=True)
            )
        ),
    ],
    ids=["position", "look_at", "fov", "transform"],
)
def test_a_moving_camera_gives_static_meshes_segments(camera):
    result = exposed(mesh(), mesh(transform=MOVING), frame=0.5, camera=camera, motion_segments=4)
    assert result.path.moves
    assert [m.segments for m in result.meshes] == [4, 4]
    assert [len(m.positions) for m in result.meshes] == [1, 5]
    still = exposed(mesh(), frame=5.0, camera=camera)
    assert not still.path.moves
    assert still.meshes[0].segments == 0


def test_camera_poses_are_those_of_their_time():
    camera = Camera(
        position=keyed((0, (0, 0, 0)), (2, (2, 0, 0))),
        look_at=(0, 0, -1e9),
        fov=keyed((0, 90), (2, 60)),
    )
    poses = exposed(camera=camera, frame=1, shutter=Shutter(-1, 1), motion_segments=2)
    ends = poses.path.ends
    np.testing.assert_array_equal([end.eye[0, 0] for end in ends], [0, 2])
    focal = 0.5 / np.tan(np.radians([90, 60]) / 2)
    np.testing.assert_allclose([end.focal[0] for end in ends], focal)
    np.testing.assert_allclose(ends[0].rotation[0], np.eye(3), atol=1e-8)


def test_a_camera_transform_is_the_pose_whatever_its_scale():
    half = np.sqrt(0.5)
    transform = Transform((1, 2, 3), (0, half, 0, half), (5, 5, 5))  # looks along -x
    poses = exposed(camera=Camera(transform=transform)).path.opening
    np.testing.assert_array_equal(poses.eye, [[1, 2, 3]])
    np.testing.assert_allclose(poses.rotation[0] @ [-1, 0, 0], [0, 0, -1], atol=1e-15)


def test_apertures():
    for fields, focal in [
        ({"focal_length": 35.0, "vertical_aperture": 20.0}, 35 / 20),
        ({"focal_length": 36.0}, 36 / 24),
        ({"focal_length": 35.0, "horizontal_aperture": 36.0}, 35 / (36 / 1.5)),
        ({"fov": 90.0}, 0.5),
    ]:
        assert exposed(camera=Camera(**fields)).path.opening.focal[0] == pytest.approx(focal)


def test_attributes_may_be_given_per_time():
    times = np.arange(3.0)[:, None, None]
    result = exposed(
        mesh(
            positions=TRIANGLE + times,
            normals=np.broadcast_to((0, 0, 1), (3, 3, 3)) + times,
            uv=np.zeros((3, 3, 2)) + times,
            color=np.zeros((3, 3, 3)) + times / 10,
            motion_segments=4,
        )
    ).meshes[0]
    assert result.segments == 4
    steps = np.arange(5) / 2
    np.testing.assert_allclose(result.positions[:, 0, 0], steps)
    np.testing.assert_allclose(result.normals[:, 0, 0], steps)
    np.testing.assert_allclose(result.uv[:, 0, 0], steps)
    np.testing.assert_allclose(result.color[:, 0, 0], steps / 10, rtol=1e-6)


def test_changing_colour_alone_is_motion_too():
    color = np.zeros((2, 3, 3))
    color[1] = 1
    result = exposed(mesh(positions=np.stack([TRIANGLE] * 2), color=color)).meshes[0]
    assert result.segments == 1
    assert [len(a) for a in (result.positions, result.color)] == [1, 2]


def test_positions_per_time_hold_for_every_frame_and_may_be_transformed():
    moving = mesh(positions=np.stack([TRIANGLE, TRIANGLE + 1]), transform=MOVING)
    for frame in (2.0, 7.0):
        result = exposed(moving, frame=frame).meshes[0].positions
        shift = np.array([frame - 0.25, frame + 0.25])[:, None, None] * (1, 2, 0)
        np.testing.assert_allclose(result, np.stack([TRIANGLE, TRIANGLE + 1]) + shift, rtol=1e-15)


def test_normals_stand_upright_on_scaled_and_mirrored_surfaces():
    points = np.array([[0.0, 0, 0], [1, 0, 1], [0, 1, 0]])
    normal = np.cross(points[1], points[2])
    for scale in [(1, 1, 1), (3, 0.5, 2), (-2, 1, 1), (-1, -1, -1), (1, 1, 0)]:
        transform = Transform(scale=scale, rotation=(0.1, 0.2, 0.3, 0.9))
        result = exposed(mesh(positions=points, normals=[normal] * 3, transform=transform)).meshes[
            0
        ]
        a, b, c = result.positions[0][result.mesh.faces[0]]
        front = np.cross(b - a, c - a)
        cosine = front @ result.normals[0, 0]
        cosine /= np.linalg.norm(front) * np.linalg.norm(result.normals[0, 0])
        assert cosine == pytest.approx(1.0, abs=1e-12)


def test_far_positions_keep_double_precision():
    far = (148376.125, 1234.0, -223423.0)
    moved = Transform(translation=keyed((0, far), (1, (far[0] + 2**-20, far[1], far[2]))))
    result = exposed(mesh(transform=moved), frame=0.5, shutter=Shutter(-0.5, 0.5)).meshes[0]
    np.testing.assert_array_equal(result.positions[1, :, 0] - result.positions[0, :, 0], 2**-20)
    assert np.float32(far[0] + 2**-20) == np.float32(far[0])  # float32 would have lost it


def test_invisible_and_empty_meshes_are_left_out():
    empty = mesh(faces=np.zeros((0, 3), int))
    assert exposed(mesh(visible=False), empty).meshes == ()


def test_an_empty_scene_can_be_exposed():
    result = expose(Scene(meshes=[]), 1.0, 1.5)
    assert result.meshes == ()
    assert not result.path.moves


def test_a_missing_camera_frames_the_scene_and_says_so():
    far = np.array([[100.0, 0, 0], [104, 0, 0], [100, 3, 0]])
    result = exposed(mesh(positions=far), camera=None)
    assert "no camera: one that frames the scene was made" in result.notes
    poses = result.path.opening
    seen = (far - poses.eye[0]) @ poses.rotation[0].T
    assert (seen[:, 2] < 0).all()
    assert np.abs(seen[:, :2] / seen[:, 2:] * poses.focal[0]).max() < 0.5


def test_a_headlight_only_where_something_is_lit():
    lit, unlit = mesh(shading=None, material=Material()), mesh()
    assert len(exposed(lit).lights) == 2
    assert exposed(unlit).lights == ()
    given = Light("ambient")
    assert exposed(lit, lights=[given]).lights == (given,)


def test_broken_transforms_are_scene_errors():
    huge = None
    for _ in range(9):
        huge = Transform(scale=(1e38, 1, 1), parent=huge)
    with pytest.raises(SceneError, match="mesh 'm': its transform"):
        exposed(mesh(name="m", transform=huge))
    with pytest.raises(SceneError, match="same point"):
        exposed(mesh(), camera=Camera(position=(1, 1, 1), look_at=(1, 1, 1)))
    with pytest.raises(SceneError, match="up is parallel"):
        exposed(mesh(), camera=Camera(position=(0, 1, 0), look_at=(0, 0, 0)))
    with pytest.raises(SceneError, match="singular"):
        exposed(mesh(), camera=Camera(transform=Transform(scale=(0, 1, 1))))
