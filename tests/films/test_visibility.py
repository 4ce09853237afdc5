"""Objects that appear, vanish or jump while the shutter is open: exact in time."""

from __future__ import annotations

import numpy as np
import pytest
from reference import render as twin

from mbinterval.errors import SceneError
from mbinterval.exposure.asked import Asked
from mbinterval.exposure.exposure import expose
from mbinterval.rendering.renderer import render
from mbinterval.scene.formats.load import load
from mbinterval.scene.model import Camera, Light, Material, Mesh, Scene, Shutter
from mbinterval.scene.tracks import Track
from mbinterval.scene.transforms import Transform
from mbinterval.settings.settings import Settings

WIDTH, HEIGHT = 48, 32
CAMERA = Camera(position=(0, 0, 10), look_at=(0, 0, 0), fov=40)
SQUARE = [[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]]
FACES = [[0, 1, 2], [0, 2, 3]]
METHODS = [
    Settings(samples=1),
    Settings(samples=1, occlusion=1024, partial_bits=True),
    Settings(samples=1, paths="triangulated"),
]


def keyed(*pairs, **options):
    frames, values = zip(*pairs, strict=True)
    return Track(np.array(frames, float), np.array(values, float), **options)


def stepped(*pairs):
    return keyed(*pairs, interpolation="step")


def square(**fields):
    return Mesh(SQUARE, FACES, **({"shading": "unlit"} | fields))


def filmed(*meshes, camera=CAMERA, settings=METHODS[0], **scene):
    scene = Scene(meshes, camera, shutter=Shutter(0.0, 1.0), **scene)
    return render(scene, frame=0, width=WIDTH, height=HEIGHT, settings=settings)


@pytest.mark.parametrize("settings", METHODS, ids=["exact", "mask", "triangulated"])
@pytest.mark.parametrize(
    ("keys", "share"),
    [
        ([(0.0, 0), (0.3, 1)], 0.7),
        ([(0.0, 1), (0.3, 0)], 0.3),
        ([(0.0, 1), (0.2, 0), (0.55, 1), (0.8, 0), (0.9, 1)], 0.2 + 0.25 + 0.1),
        ([(-5.0, 0), (7.0, 1)], 0.0),
        ([(-5.0, 0), (0.0, 1)], 1.0),
        ([(-5.0, 1), (1.0, 0)], 1.0),
    ],
)
def test_coverage_is_the_share_of_the_shutter(keys, share, settings):
    alpha = filmed(square(visible=stepped(*keys)), settings=settings).rgba[..., 3]
    np.testing.assert_allclose(alpha, share, atol=2e-6)


def test_it_hides_what_is_behind_for_just_as_long():
    front = square(visible=stepped((0, 0), (0.25, 1), (0.75, 0)), color=(1, 0, 0))
    behind = square(color=(0, 1, 0), transform=Transform(translation=(0, 0, -1)))
    rgba = filmed(front, behind).rgba
    np.testing.assert_allclose(rgba, np.broadcast_to([0.5, 0.5, 0, 1], rgba.shape), atol=1e-6)


def test_without_keys_in_the_shutter_nothing_is_split():
    still = square(visible=stepped((-9, 0), (-3, 1), (5, 0)))
    exposure = expose(Scene([still], CAMERA), 0.0, 1.5)
    assert [(m.segments, m.open, m.close) for m in exposure.meshes] == [(0, 0.0, 1.0)]


MOVING = Transform(
    translation=keyed((0, (-4, 0, 0)), (1, (4, 1, 2))),
    rotation=keyed((0, (0, 0, 0, 1)), (1, (0, 0, 0.6, 0.8)), quaternion=True),
)


@pytest.mark.parametrize("segments", [1, 3])
@pytest.mark.parametrize("shading", ["unlit", "phong"])
@pytest.mark.parametrize("paths", ["exact", "triangulated"])
def test_moving_attributes_and_cameras_are_as_the_twin_has_them(segments, shading, paths):
    """Colours, normals and poses belong to the stretch's own segments."""
    random = np.random.default_rng(2)
    points = random.uniform(-2, 2, (12, 3))
    mesh = Mesh(
        points,
        np.arange(12).reshape(4, 3),
        color=random.uniform(0, 1, (12, 3)),
        color_domain="vertex",
        normals=random.normal(size=(12, 3)),
        material=Material(shading=shading),
        transform=MOVING,
        visible=stepped((0, 1), (0.15, 0), (0.4, 1), (0.85, 0)),
        motion_segments=segments,
    )
    other = Mesh(random.uniform(-2, 2, (6, 3)), [[0, 1, 2], [3, 4, 5]], motion_segments=2)
    camera = Camera(position=keyed((0, (0, 0, 10)), (1, (1, 2, 9))), look_at=(0, 0, 0), fov=40)
    lights = [Light("point", position=(3, 3, 6), intensity=20.0), Light("ambient", intensity=0.2)]
    scene = Scene([mesh, other], camera, lights=lights, shutter=Shutter(0.0, 1.0))
    exposure = expose(scene, 0.0, WIDTH / HEIGHT)
    assert [(m.segments, round(m.open, 6), round(m.close, 6)) for m in exposure.meshes] == [
        (segments, 0.0, 0.15),
        (segments, 0.4, 0.85),
        (2, 0.0, 1.0),
    ]
    settings = Settings(samples=1, paths=paths, motion_segments=1)
    film = render(scene, frame=0, width=WIDTH, height=HEIGHT, settings=settings)
    options = {"bits": None}
    expected = twin.render(exposure, WIDTH, HEIGHT, paths=paths, **options)
    error = np.sqrt(np.mean((film.rgba - expected.rgba) ** 2))
    assert error < 1e-4
    assert np.abs(film.rgba[..., 3]).max() > 0.3


@pytest.mark.parametrize("settings", METHODS, ids=["exact", "mask", "triangulated"])
def test_a_stepped_key_jumps_and_leaves_no_streak(settings):
    """A small square is here for 0.4 of the shutter and there for the rest, and never between."""
    small = Mesh(
        np.array(SQUARE) / 9,
        FACES,
        shading="unlit",
        transform=Transform(translation=stepped((0, (-3, 0, 0)), (0.4, (3, 0, 0)))),
    )
    alpha = filmed(small, settings=settings).rgba[..., 3]
    values = np.unique(np.round(alpha, 4))
    np.testing.assert_allclose(values, [0.0, 0.4, 0.6], atol=2e-4)
    assert alpha[:, : WIDTH // 2].max() == pytest.approx(0.4, abs=1e-5)
    assert alpha[HEIGHT // 2, WIDTH // 2] == 0.0


def test_a_jump_as_the_shutter_closes_is_not_seen():
    small = Mesh(
        np.array(SQUARE) / 9,
        FACES,
        shading="unlit",
        transform=Transform(translation=stepped((0, (-3, 0, 0)), (1.0, (3, 0, 0)))),
    )
    alpha = filmed(small).rgba[..., 3]
    assert np.unique(alpha).tolist() == [0.0, 1.0]
    assert alpha[:, WIDTH // 2 :].max() == 0.0


def test_a_cut_between_cameras_within_the_shutter():
    camera = Camera(position=stepped((0, (0, 0, 10)), (0.25, (100, 0, 10))), fov=40)
    alpha = filmed(square(), camera=camera).rgba[..., 3]
    np.testing.assert_allclose(alpha, 0.25, atol=1e-6)


def test_keys_in_a_scene_file():
    table = {
        "shutter": {"open": 0.0, "close": 1.0},
        "camera": {"position": [0, 0, 10], "look_at": [0, 0, 0], "fov": 40},
        "objects": [
            {
                "positions": SQUARE,
                "faces": FACES,
                "material": {"shading": "unlit"},
                "visibility": [{"frame": 3, "visible": False}, {"frame": 5.75, "visible": True}],
            }
        ],
    }
    film = render(load(table), frame=5, width=WIDTH, height=HEIGHT)
    np.testing.assert_allclose(film.rgba[..., 3], 0.25, atol=1e-6)


def test_positions_per_time_in_a_part_of_the_shutter_keep_their_corner():
    """Three positions, out and back again: seen from 0.3 on, the corner at 0.5 is kept."""
    there = np.array(SQUARE) / 9
    mesh = Mesh(
        np.stack([there, there + [2, 0, 0], there]),
        FACES,
        shading="unlit",
        visible=stepped((0, 0), (0.3, 1)),
    )
    scene = Scene([mesh], CAMERA, shutter=Shutter(0.0, 1.0))
    found = expose(scene, 0.0, WIDTH / HEIGHT, Asked(error=0.1), height=HEIGHT).meshes[0]
    times = found.open + np.arange(found.segments + 1) / found.segments * (1.0 - found.open)
    path = np.interp(np.linspace(0.3, 1.0, 999), times, found.positions[:, 0, 0])
    true = there[0, 0] + 2 * (1 - np.abs(2 * np.linspace(0.3, 1.0, 999) - 1))
    pixels = 0.5 / np.tan(np.radians(20)) * HEIGHT / 10
    assert np.abs(path - true).max() * pixels <= 0.1
    assert found.segments > 2


@pytest.mark.parametrize("visible", [0.5, "no", keyed((0, 0), (1, 1)), stepped((0, (0, 1)))])
def test_a_wrong_visibility_is_a_scene_error(visible):
    with pytest.raises(SceneError, match="visible"):
        square(visible=visible)
