"""Where the product and the witness, or a closed form, are known to differ: each must fail today.

They are strict: what mends one takes its mark away, and what `scenes` leaves out for it comes back.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from reference.witness import film as witness
from reference.witness import moment as moments
from reference.witness.product import (
    Camera,
    Environment,
    Light,
    Material,
    Mesh,
    Scene,
    Settings,
    Shutter,
    Texture,
    Track,
    Transform,
    render,
)

SIZE = (32, 24)
FACES = [[0, 1, 2], [0, 2, 3]]
STILL = Camera(position=(0, 0, 4), look_at=(0, 0, 0), fov=40.0)
ONE = Settings(samples=1)
UNLIT = Material(shading="unlit")


def wrong(reason: str) -> Any:
    return pytest.mark.xfail(strict=True, raises=AssertionError, reason=reason)


def quad(left: float, right: float, z: float = 0.0, high: float = 9.0, **given: Any) -> Mesh:
    corners = [[left, -high, z], [right, -high, z], [right, high, z], [left, high, z]]
    return Mesh(corners, FACES, **({"material": UNLIT} | given))


def shown(scene: Scene, settings: Settings = ONE, size: tuple[int, int] = SIZE) -> np.ndarray:
    return render(scene, frame=0.0, width=size[0], height=size[1], settings=settings).rgba


def seen(scene: Scene, size: tuple[int, int] = SIZE, **asked: Any) -> np.ndarray:
    given = {"strata": 64, "repeats": 8, "centre": True} | asked
    return witness.film(scene, 0.0, size, witness.Asked(**given)).rgba.mean(axis=0)


# Environments


@wrong("issue 18: a background is blurred by texels, however wide these are")
def test_a_background_is_as_sharp_as_its_texels():
    image = np.zeros((64, 128, 3), np.float32)
    image[:, (np.arange(128) // 2) % 2 == 1] = 1.0
    camera = Camera(look_at=(0.3, 0, -1), fov=np.degrees(2 * np.arctan(12 * 2 * np.pi / 128)))
    scene = Scene([], camera, environment=Environment(image))
    away = shown(scene, size=(64, 48)) - seen(scene, (64, 48), strata=1, repeats=1)
    assert np.abs(away[..., :3]).max() < 0.02


HALF_BRIGHT = np.zeros((64, 128, 3), np.float32)
HALF_BRIGHT[:, 32:96] = 1.0


@pytest.mark.parametrize(
    "shutter",
    [
        pytest.param({"curve": (0.0, 0.0, 1.0)}, id="curve"),
        pytest.param(
            {"rolling": "down", "line_offset": 0.01 / 24, "line_exposure": 0.002}, id="rolling"
        ),
    ],
)
@wrong("issue 18: a scene of an environment alone loses the shutter's curve and its rolling")
def test_a_scene_of_an_environment_alone_keeps_its_shutter(shutter):
    turns = [[0, np.sin(a), 0, np.cos(a)] for a in np.radians([-35.0, -55.0])]
    place = Transform(rotation=Track([-0.25, 0.25], turns, "linear", True))
    scene = Scene(
        [], Camera(transform=place, fov=40.0), environment=Environment(HALF_BRIGHT),
        shutter=Shutter(**shutter),
    )  # fmt: skip
    assert np.abs(shown(scene) - seen(scene))[..., 0].max() < 0.15


@pytest.mark.parametrize(("roughness", "metallic"), [(0.3, 1.0), (0.1, 1.0), (0.6, 0.0)])
def test_rough_surfaces_reflect_uniform_light_at_grazing_angles(roughness, metallic):
    metal = Material(shading="metallic_roughness", metallic=metallic, roughness=roughness)
    far = 1e5
    ground = Mesh(
        [[-far, 0, 1e3], [far, 0, 1e3], [far, 0, -far], [-far, 0, -far]], FACES,
        normals=[[0, 1, 0]] * 4, material=metal,
    )  # fmt: skip
    camera = Camera(position=(0, 1, 0), look_at=(0, 0.98, -1), fov=12.0)
    white = Environment(np.ones((8, 16, 3), np.float32))
    scene = Scene([ground], camera, environment=white)
    horizon = int((0.5 - 0.02 / (2 * np.tan(np.radians(6.0)))) * 240)
    right = seen(scene, (8, 240), strata=4, repeats=1)
    away = np.abs(shown(scene, size=(8, 240)) - right)[horizon + 4 :, 4, 0]
    assert away.max() < 1e-3


# The shutter, filters and masks


@pytest.mark.parametrize(("opening", "closing"), [(0, 0.5), (0, 0), (0, 1), (0.5, 0), (1, 0)])
def test_a_trapezoid_that_opens_or_closes_at_once_is_the_curves_limit(opening, closing):
    square = quad(-0.5, 0.5, high=0.5)
    keys = Track([0.0, 1.0], [[-1.5, 0, 0], [1.5, 0, 0]])
    scene = Scene(
        [replace(square, transform=Transform(translation=keys))], STILL,
        shutter=Shutter(0.0, 1.0, curve="trapezoid", opening=opening, closing=closing),
    )  # fmt: skip
    right = seen(scene, strata=128)[..., 3]
    points = {"method": "stochastic", "samples": 2048, "filter_radius": 0.01}
    slices = {"method": "accumulation", "slices": 1024, "samples": 1}
    for given in ({"samples": 1}, points, slices):
        assert np.abs(shown(scene, Settings(**given))[..., 3] - right).max() < 0.02, given


def test_mitchells_filter_is_symmetric_with_the_fixed_pattern():
    scene = Scene([quad(0.0, 9.0)], STILL)
    alpha = shown(scene, Settings(samples=64, filter="mitchell"), (24, 18))[9, :, 3]
    assert alpha.sum() == pytest.approx(12.0, abs=2e-3)


@pytest.mark.parametrize("paths", ["exact", "triangulated"])
@pytest.mark.parametrize(
    "shutter",
    [{}, {"curve": "triangle"}, {"rolling": "down", "line_offset": 1e-3, "line_exposure": 0.02}],
    ids=lambda given: next(iter(given), "box"),
)
def test_masks_with_partial_bits_lose_no_light(paths, shutter):
    moving = Camera(position=Track([-0.5, 0.5], [[-0.5, 0, 6], [0.5, 0.2, 5.6]]), fov=45.0)
    settings = Settings(samples=1, occlusion=32, partial_bits=True, paths=paths)
    for segments in (64, 100, 500):
        wall = quad(-30, 30, -5.0, high=30, motion_segments=segments)
        scene = Scene([wall], moving, shutter=Shutter(-0.5, 0.5, **shutter))
        alpha = shown(scene, settings, (8, 6))[..., 3]
        assert np.abs(alpha - 1.0).max() < 1e-5, segments


def test_light_between_bits_does_not_depend_on_the_number_of_segments():
    """A gap that moves by, a third of a bit wide: its times are those of the closed form."""
    settings = Settings(samples=1, occlusion=32, partial_bits=True)
    keys = Track([-0.25, 0.25], [[-1.0, 0, 0], [1.0, 0, 0]])
    for segments in (1, 64, 100):
        given = {"transform": Transform(translation=keys), "motion_segments": segments}
        scene = Scene([quad(-9, 0, **given), quad(0.02, 9, **given)], STILL)
        alpha = shown(scene, settings)[..., 3]
        assert np.abs(alpha[:, 8:24] - 0.99).max() < 1e-5, segments


# The lens


@pytest.mark.parametrize("limit", [{"sharp_range": (4.0, 9.0)}, {"foreground_blur": 0.01}])
@wrong("issue 18: limits bend the circle of confusion at vertices only")
def test_what_is_in_focus_does_not_depend_on_how_a_mesh_is_cut(limit):
    road = Mesh(
        [[-0.4, -0.8, -2], [0.4, -0.8, -2], [0.4, -0.8, -20], [-0.4, -0.8, -20]], FACES,
        material=UNLIT,
    )  # fmt: skip
    camera = Camera(fov=50.0, f_stop=1.0, focus_distance=6.0, meters_per_unit=0.03, **limit)
    scene = Scene([road], camera)
    given = shown(scene, Settings(samples=256, pattern="sobol"), (48, 36))
    away = given - seen(scene, (48, 36), strata=512, repeats=1, centre=False)
    assert np.abs(away)[..., 3].max() < 0.03


@wrong("issue 19: a focus pull is left out of motion_error")
def test_a_focus_pull_counts_in_motion_error():
    pull = Camera(
        position=(0, 0, 4), fov=40.0, f_stop=0.3, meters_per_unit=0.04,
        focus_distance=Track([-0.25, 0.25], [1.5, 8.0]),
    )  # fmt: skip
    scene = Scene([quad(-0.5, 0.5, high=0.5)], pull)
    given = [
        shown(scene, Settings(samples=256, pattern="sobol", seed=k, motion_error=1e-3))
        for k in range(4)
    ]
    away = np.mean(given, axis=0) - seen(scene, strata=512, repeats=4, centre=False)
    assert np.abs(away)[..., 3].max() < 0.02


# Motion


@wrong("issue 19: chords of one rigid motion differ between meshes")
def test_a_decal_on_a_turning_body_is_all_seen():
    turn = [[0, 0, 0, 1], [0, np.sin(np.pi / 12), 0, np.cos(np.pi / 12)]]
    place = Transform(rotation=Track([-0.25, 0.25], turn, "linear", True))
    body = quad(-1.5, 1.5, high=1.0, transform=place)
    decal = quad(0.9, 1.3, 0.001, high=0.2, transform=place, color=(1.0, 0.0, 0.0))
    scene = Scene([body, decal], STILL)
    given, right = (film[..., 1:2].sum() for film in (shown(scene), seen(scene)))
    alpha = seen(scene)[..., 3].sum()
    assert alpha - given == pytest.approx(alpha - right, rel=0.05)


@wrong("issue 19: keys are not knots: what moves between other times is not seen")
def test_motion_between_the_ends_of_the_shutter_is_seen():
    keys = Track([-0.185, -0.1575, -0.13], [[0, 0, 0], [1.0, 0, 0], [0, 0, 0]])
    square = quad(-0.5, 0.5, high=0.5, transform=Transform(translation=keys))
    assert np.abs(shown(Scene([square], STILL)) - seen(Scene([square], STILL))).max() < 0.05


@wrong("issue 19: the winding that counts as front is that at the opening")
def test_a_scale_through_zero_turns_fronts_where_its_sign_does():
    scale = Track([-0.25, 0.25], [[1.0, 1, 1], [-1.0, 1, 1]])
    front = Material(shading="unlit", double_sided=False)
    scene = Scene([quad(-1, 1, material=front, transform=Transform(scale=scale))], STILL)
    assert np.abs(shown(scene) - seen(scene))[..., 3].max() < 0.05


@wrong("issue 19: a mirrored camera shows the backs")
def test_a_mirrored_camera_mirrors_the_picture():
    camera = Camera(transform=Transform(translation=(0, 0, 4), scale=(-1, 1, 1)), fov=40.0)
    front = Material(shading="unlit", double_sided=False)
    scene = Scene([quad(0.2, 1.0, material=front)], camera)
    assert np.abs(shown(scene) - seen(scene))[..., 3].max() < 0.05


# Found by the witness


@wrong("flat normals are blended between the ends of motion segments, which are few")
def test_flat_normals_of_what_deforms_are_those_of_the_moment():
    start = np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0.0]])
    end = np.array([[-1, -1, 1.5], [1, -1, -1.5], [0, 1, 0.0]])
    mesh = Mesh(np.stack([start, end]), [[0, 1, 2]], material=Material())
    scene = Scene([mesh], STILL, lights=[Light("directional", direction=(-1, 0, -1))])
    for method in ("analytic", "stochastic"):
        settings = Settings(method=method, samples=1 if method == "analytic" else 256)
        away = shown(scene, settings) - seen(scene, centre=method == "analytic")
        assert np.abs(away[12, 16]).max() < 5e-3


@wrong("film.depth takes each span's depth in its middle")
def test_the_films_depth_is_the_mean_of_what_is_visible():
    near = Track([-0.25, 0.25], [[0, 0, 2.0], [0, 0, -8.0]])
    wall = quad(-20, 20, high=20, transform=Transform(translation=near))
    scene = Scene([wall], STILL, shutter=Shutter(curve=(0.0, 1.0)))
    film = render(scene, frame=0.0, width=8, height=6, settings=Settings(samples=1))
    right = witness.film(scene, 0.0, (8, 6), witness.Asked(64, 4, centre=True)).depth.mean(axis=0)
    assert np.abs(film.depth - right).max() < 0.01


@wrong('layer "normal" turns by the winding, shading by the view')
def test_the_layer_of_normals_is_what_shading_has():
    """A mesh whose normals are on the side of its faces' backs, as many exporters leave them."""
    mesh = quad(-1, 1, material=Material(), normals=[[0, 0.3, -1.0]] * 4)
    scene = Scene([mesh], STILL)
    film = render(scene, frame=0.0, width=8, height=6, settings=Settings(aovs=("normal",)))
    right = moments.layers(scene, 0.0, (8, 6), 0.5)["normal"]
    assert np.abs(film.layers["normal"] - right).max() < 1e-3


@wrong("what appears while the shutter is open shades itself in mirrors, at some times")
def test_what_appears_is_lit_in_a_mirror():
    flag = Mesh(
        [[0.58, 0.53, 0], [-0.58, 0.53, 0.08], [0, 0, 0.42]], [[0, 1, 2]], material=Material(),
        transform=Transform(
            translation=Track([-1.0, 1.0], [[1.33, 0.27, 0.41], [0.39, -1.16, -1.44]])
        ),
        visible=Track([-1.0, -0.2952], [0.0, 1.0], "step"),
    )  # fmt: skip
    mirror = Mesh(
        [[1.3, -1.5, 1.5], [1.6, -1.5, -2], [1.6, 1.5, -2], [1.3, 1.5, 1.5]], FACES,
        material=Material(shading="unlit", reflectivity=0.8),
    )  # fmt: skip
    lights = [Light("point", position=(-0.24, 0.75, 2.31), intensity=6.0, shadows=True)]
    camera = Camera(position=(0.1, 0.2, 4), look_at=(0, 0, 0), fov=40.0)
    scene = Scene([flag, mirror], camera, lights=lights, shutter=Shutter(-0.5, 0.45))
    assert np.abs(shown(scene) - seen(scene))[..., 0].max() < 0.05


# Precision


def test_a_ground_of_many_repeats_is_as_sharp_as_one_cut_into_squares():
    rng = np.random.default_rng(3)
    texture = Texture(rng.uniform(size=(64, 64, 3)))
    half, off = 10000.0, 9000.0
    corners = np.array([[-half, -1, half], [half, -1, half], [half, -1, -half], [-half, -1, -half]])
    ground = Mesh(
        corners + [off, 0, -off], FACES, uv=corners[:, [0, 2]] * [1, -1],
        material=Material(shading="unlit", texture=texture),
    )  # fmt: skip
    camera = Camera(position=(0, 0.3, 5), look_at=(0, -0.6, 3), fov=40.0)
    scene = Scene([ground], camera)
    away = shown(scene, size=(80, 60)) - seen(scene, (80, 60), strata=1, repeats=1)
    assert np.sqrt(np.mean(away[24:, :, :3] ** 2)) < 2e-3
