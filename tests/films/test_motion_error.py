"""Chosen motion segments: the path stays within ``motion_error`` pixels of the motion on screen."""

from __future__ import annotations

import numpy as np
import pytest

from mbinterval.errors import UsageError
from mbinterval.exposure.asked import Asked
from mbinterval.exposure.exposure import expose
from mbinterval.exposure.shutter_times import Window
from mbinterval.exposure.true_motion import world_positions
from mbinterval.rendering.describe import describe
from mbinterval.rendering.renderer import render
from mbinterval.scene.formats.load import load
from mbinterval.scene.model import Camera, Mesh, Scene, Shutter
from mbinterval.scene.tracks import Track
from mbinterval.scene.transforms import Transform
from mbinterval.settings.settings import Settings

WIDTH, HEIGHT = 640, 480
CAMERA = Camera(position=(0, 0, 10), look_at=(0, 0, 0), fov=40)
FACES = [[0, 1, 2]]


def keyed(*pairs, **options):
    frames, values = zip(*pairs, strict=True)
    return Track(np.array(frames, float), np.array(values, float), **options)


def turning(degrees):
    """Turned about z by ``degrees`` within a shutter from frame 0 to 1."""
    return Transform(rotation=keyed((0, (0, 0, 0)), (1, (0, 0, degrees)), euler="xyz"))


def disc(radius=3.0, points=24, **fields):
    angle = 2 * np.pi * np.arange(points) / points
    rim = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle], axis=1)
    faces = [[0, 1 + i, 1 + (i + 1) % points] for i in range(points)]
    return Mesh(np.append([[0, 0, 0]], rim, axis=0), faces, shading="unlit", **fields)


def exposed(*meshes, camera=CAMERA, frame=0.0, error=0.1, shutter=None, segments=None):
    scene = Scene(meshes, camera, shutter=shutter or Shutter(0.0, 1.0))
    return expose(
        scene, frame, WIDTH / HEIGHT, Asked(segments=segments, error=error), height=HEIGHT
    )


def pixels(points, poses, time):
    """Twin of the projection: homogeneous pixels of world points ``(n, 3)``."""
    x, y, z = np.diag([HEIGHT, -HEIGHT, -1]) @ poses.view[time] @ (points - poses.eye[time]).T
    return np.stack([x + WIDTH / 2 * z, y + HEIGHT / 2 * z, z], 1)


def dense_error(exposure, mesh, places, frame=0.0, steps=997):
    """Greatest deviation in pixels of vertices on screen, at ``steps`` times of the shutter.

    ``places(frame)`` is the true motion ``(n, 3)`` in the world.
    """
    from mbinterval.exposure.poses import camera_poses

    count, worst = max(mesh.segments, 1), 0.0
    world = np.broadcast_to(mesh.positions, (count + 1, *mesh.positions.shape[1:]))
    nodes = [
        pixels(points, mesh.poses, min(k, len(mesh.poses.eye) - 1))
        for k, points in enumerate(world)
    ]
    shutter = exposure.shutter
    for t in (np.arange(steps) + 0.5) / steps:
        k = min(int(np.searchsorted(mesh.knots, t, side="right")) - 1, count - 1)
        part = (t - mesh.knots[k]) / (mesh.knots[k + 1] - mesh.knots[k])
        path = (1 - part) * nodes[k] + part * nodes[k + 1]
        now = frame + shutter.open + t * (shutter.close - shutter.open)
        poses = camera_poses(exposure.camera, np.array([now]), WIDTH / HEIGHT)
        true = pixels(places(now), poses, 0)
        seen = (true[:, 2] > 0) & (path[:, 2] > 0)
        a, b = (p[seen, :2] / p[seen, 2:] for p in (true, path))
        inside = ((a > 0) & (a < [WIDTH, HEIGHT])).all(axis=1)
        worst = max(worst, np.linalg.norm(a - b, axis=1)[inside].max(initial=0.0))
    return worst


def rotated(mesh, degrees):
    angle = np.radians(degrees)
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    return mesh.positions @ turn.T


@pytest.mark.parametrize("error", [1.0, 0.1, 0.03])
@pytest.mark.parametrize("degrees", [5.0, 90.0, 180.0])
def test_a_turning_wheel_is_round(degrees, error):
    """Against the closed form, at 997 times; the sagitta of chords says how many it takes."""
    mesh = disc(transform=turning(degrees))
    exposure = exposed(mesh, error=error)
    result = exposure.meshes[0]
    assert dense_error(exposure, result, lambda t: rotated(mesh, degrees * t)) <= error
    radius = 3.0 / 10.0 * exposure.path.opening.focal[0] * HEIGHT
    fewest = int(np.ceil(np.radians(degrees) / 2 / np.arccos(1 - error / radius)))
    assert fewest <= result.segments <= np.ceil(1.15 * fewest)


def test_half_a_turn_without_segments_is_not_round():
    """The negative control: one segment takes the rim through the hub."""
    mesh = disc(transform=turning(180.0))
    exposure = exposed(mesh, segments=1)
    assert dense_error(exposure, exposure.meshes[0], lambda t: rotated(mesh, 180 * t)) > 100


@pytest.mark.parametrize("turns", [1, 2, 4, 8])
def test_full_turns_are_not_taken_for_rest(turns):
    result = exposed(disc(radius=0.2, transform=turning(360.0 * turns))).meshes[0]
    assert result.segments >= 8 * turns


def test_a_half_turn_within_the_shutter_covers_a_full_disc():
    """A spoke that sweeps half a disc within the shutter: its film is that of the closed form.

    Coverage at a place of the half disc is the spoke's opening angle over 180 degrees.
    """
    angle = np.radians(20.0)
    spoke = Mesh(
        [[0, 0, 0], [3, 0, 0], [3 * np.cos(angle), 3 * np.sin(angle), 0]],
        FACES,
        shading="unlit",
        transform=turning(180.0),
    )
    scene = Scene([spoke], CAMERA, shutter=Shutter(0.0, 1.0))
    film = render(scene, frame=0, width=WIDTH, height=HEIGHT, settings=Settings(samples=1))
    focal = 0.5 / np.tan(np.radians(20)) * HEIGHT
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    right, up = (x - WIDTH / 2) * 10 / focal, (HEIGHT / 2 - y) * 10 / focal
    radius, place = np.hypot(right, up), np.degrees(np.arctan2(up, right))
    inner = 3.0 * np.cos(angle / 2)
    swept = (radius > 0.3) & (radius < inner - 0.05) & (place > 21) & (place < 179)
    assert np.abs(film.rgba[..., 3] - 20 / 180)[swept].max() < 2e-3
    assert film.rgba[..., 3][(radius > 3.02)].max() == 0.0


@pytest.mark.parametrize(
    "transform",
    [
        Transform(translation=keyed((0, (0, 0, 0)), (1, (2, 1, 0)))),
        Transform(translation=keyed((0, (0, 0, 0)), (1, (2, 1, 5)))),  # towards the eye
        Transform(scale=keyed((0, (1, 1, 1)), (1, (2, 1, 1)))),
    ],
    ids=["across", "towards", "scale"],
)
def test_what_moves_straight_in_homogeneous_space_gets_one_segment(transform):
    assert exposed(disc(transform=transform)).meshes[0].segments == 1


def test_what_does_not_move_has_none_and_explicit_numbers_win():
    still, free, own = (
        disc(),
        disc(transform=turning(90)),
        disc(transform=turning(90), motion_segments=3),
    )
    assert [m.segments for m in exposed(still, free, own).meshes][::2] == [0, 3]
    assert [m.segments for m in exposed(still, free, own, segments=5).meshes] == [0, 5, 3]
    assert exposed(free).meshes[0].segments > 5


@pytest.mark.parametrize(
    "camera",
    [
        Camera(transform=Transform((0, 0, 10), parent=Transform(
            rotation=keyed((0, (0, 0, 0)), (1, (0, 70, 0)), euler="xyz")))),
        Camera(position=(0, 0, 10), look_at=keyed((0, (-3, 0, 0)), (1, (3, 1, 0))), fov=40),
        Camera(position=(0, 0, 10), look_at=(0, 0, 0), fov=keyed((0, 20), (1, 60))),
    ],
    ids=["orbit", "pan", "zoom"],
)  # fmt: skip
def test_camera_motion_counts_too(camera):
    mesh = disc()
    exposure = exposed(mesh, camera=camera)
    result = exposure.meshes[0]
    assert result.segments > 1
    assert dense_error(exposure, result, lambda _: mesh.positions) <= 0.1


def test_large_faces_that_are_seen_in_their_middle_only_count():
    """No vertex of the floor is on screen while the camera turns above it."""
    size = 500.0
    floor = Mesh([[-size, -1, size], [size, -1, size], [0, -1, -size]], FACES, shading="unlit")
    camera = Camera(position=(0, 3, 0), look_at=keyed((0, (-1, 1, -5)), (1, (1, 1, -5))), fov=30.0)
    assert exposed(floor, camera=camera).meshes[0].segments > 1


def test_skins_are_followed_on_their_arcs(tmp_path):
    scene = load("scenes/assets/Fox.glb", clip="Run", fps=24)
    scene = Scene(
        scene.meshes, Camera(position=(200, 50, 0), look_at=(0, 40, 0)), shutter=Shutter(-0.5, 0.5)
    )
    exposure = expose(scene, 7.0, WIDTH / HEIGHT, Asked(error=0.1), height=HEIGHT)
    result, mesh = exposure.meshes[0], scene.meshes[0]
    assert result.segments > 1
    assert dense_error(exposure, result, mesh.deformer.positions, 7.0, steps=101) <= 0.1


def test_positions_per_time_keep_their_times():
    """Three given positions under a transform that turns: knots at their times, and others."""
    mesh = disc()
    moving = np.stack([mesh.positions, mesh.positions * [1, 0.5, 1], mesh.positions])
    still = Mesh(moving, mesh.faces, shading="unlit")
    assert exposed(still).meshes[0].knots.tolist() == [0, 0.5, 1]
    turned = exposed(Mesh(moving, mesh.faces, shading="unlit", transform=turning(60))).meshes[0]
    assert turned.segments > 2
    assert 0.5 in turned.knots


def test_the_most_segments_are_said(capsys):
    mesh = disc(transform=turning(360 * 8), name="fan")
    scene = Scene([mesh], CAMERA, shutter=Shutter(0.0, 1.0))
    text = describe(scene, 0, WIDTH, HEIGHT, Settings())
    assert "128 motion segments: off by" in text
    assert "more than motion_error=0.1, with most_segments=128" in text
    few = describe(
        Scene([disc(transform=turning(20))], CAMERA, shutter=Shutter(0, 1)), 0, 64, 48, Settings()
    )
    assert "segments: off by 0.0" in few
    assert "most_segments" not in few


def test_the_number_of_segments_is_small_where_the_image_is():
    mesh = disc(transform=turning(90))
    scene = Scene([mesh], CAMERA, shutter=Shutter(0.0, 1.0))
    counts = [
        expose(scene, 0, 1.5, Asked(error=0.1), height=height).meshes[0].segments
        for height in (24, 480, 2160)
    ]
    assert counts == sorted(counts)
    assert counts[0] < counts[1] < counts[2]


@pytest.mark.parametrize("value", [0, -1.0, float("nan"), float("inf"), "x", None, True])
def test_the_error_must_be_a_number_above_zero(value):
    with pytest.raises(UsageError, match="motion_error="):
        Settings(motion_error=value)


def test_own_times_are_those_of_the_shutter():
    window = Window(3.0, -0.25, 0.25)
    mesh = disc(transform=Transform(translation=keyed((0, (0, 0, 0)), (10, (10, 0, 0)))))
    found = world_positions(mesh, window, np.array([0.0, 1.0]))[:, 0, 0]
    np.testing.assert_allclose(found, [2.75, 3.25])
