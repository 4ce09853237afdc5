"""Light, textures and colours at samples, against the analytic method where both are exact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.closed_forms import FACES, UNIT_CAMERA, rectangle, world
from support.nightly import nightly

import mbinterval as mb
from mbinterval.scene.model import Camera, Light, Material, Mesh, Scene, Texture
from mbinterval.scene.tracks import Track

SIZE = (48, 32)
PICTURE = Texture(np.random.default_rng(1).uniform(0, 1, (8, 8, 3)))
LIGHTS = (Light("ambient", intensity=0.2), Light("point", position=(0.5, 0.5, -0.5)),
          Light("spot", position=(0.5, 0.5, -0.5), direction=(-0.4, 0, -1), outer_angle=25.0),
          Light("directional", direction=(0.3, -1.0, -1.0)))  # fmt: skip


def quad(
    left: float, right: float, speed: float, w: object = 2.0,
    rows: tuple[float, float] = (3, 29), **fields: object,
) -> Mesh:  # fmt: skip
    corners = rectangle(left, right, *rows)
    ends = np.stack([corners, corners + [speed, 0.0]])
    positions = world(ends, w, SIZE)
    return Mesh(positions=positions if speed else positions[0], faces=FACES, **fields)


def textured(speed: float, left: float = 6.3, **fields: object) -> Mesh:
    material = Material("poster", texture=PICTURE, shading="unlit")
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    return quad(left, left + 25.0, speed, material=material, uv=uv, **fields)


def shiny(speed: float, **fields: object) -> Mesh:
    material = Material("shiny", specular=(0.4, 0.5, 0.6), shininess=9.0)
    normals = np.array([[-0.5, 0, 1], [0.5, 0.2, 1], [0.4, 0, 1], [-0.3, -0.3, 1.0]])
    tilted = np.array([1.8, 2.4, 2.3, 1.7])
    return quad(10.2, 40.0, speed, tilted, material=material, normals=normals, **fields)


def colored(speed: float, **fields: object) -> Mesh:
    colors = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0.0]])
    look = {"color": colors, "color_domain": "vertex", "shading": "unlit"}
    return quad(3.4, 30.0, speed, **look, **fields)


BANDS = {"texture": (textured, 0), "phong": (shiny, 11), "vertex colour": (colored, 22)}


def bands(speed: float) -> list[Mesh]:
    """Each kind in ten rows of its own; one kernel shows them all."""
    return [make(speed, rows=(top + 0.3, top + 9.7)) for make, top in BANDS.values()]


def film(*meshes: Mesh, size: tuple[int, int] = SIZE, **values: object) -> np.ndarray:
    scene = Scene(meshes=meshes, camera=UNIT_CAMERA, lights=LIGHTS, background=(0.1, 0.2, 0.3))
    return mb.render(scene, width=size[0], height=size[1], settings=mb.Settings(**values)).rgba


def band_of(kind: str, of: np.ndarray) -> np.ndarray:
    top = BANDS[kind][1]
    return of[top : top + 10]


def test_what_is_at_rest_is_the_analytic_film():
    want = film(*bands(0.0), samples=5)
    found = film(*bands(0.0), method="stochastic", pattern="fixed", samples=5)
    assert np.abs(found - want).max() < 2e-4
    assert all(band_of(kind, want)[..., :3].std() > 0.05 for kind in BANDS)


def test_one_slice_is_the_mesh_half_way():
    moving = bands(10.9)  # no edge runs through a sample then
    still = [replace(m, positions=m.positions.mean(axis=0)) for m in moving]
    found = film(*moving, method="accumulation", slices=1, samples=5, motion_segments=1)
    assert np.abs(found - film(*still, samples=5)).max() < 2e-4


def test_motion_comes_to_the_analytic_film():
    truth = film(*bands(11.0), samples=64, pattern="sobol", texture_samples=128)
    few, many = (film(*bands(11.0), method="stochastic", samples=n) for n in (16, 1024))
    for kind in BANDS:
        errors = [np.sqrt(np.mean(band_of(kind, f - truth) ** 2)) for f in (few, many)]
        assert errors[1] < 3e-3, kind
        assert errors[1] < 0.35 * errors[0], kind


@pytest.mark.nightly  # test_all_effects.py has these together with all others
def test_a_lens_and_light_come_to_the_analytic_film():
    camera = replace(UNIT_CAMERA, f_stop=0.1, focus_distance=1.9)
    scene = Scene(meshes=[shiny(11.0), textured(-7.0)], camera=camera, lights=LIGHTS)
    wide = {"width": SIZE[0], "height": SIZE[1]}
    settings = mb.Settings(samples=64, pattern="sobol", texture_samples=32)
    films = [mb.render(scene, **wide, settings=replace(settings, seed=k)).rgba for k in range(12)]
    truth = np.mean(films, axis=0)
    sampled = mb.Settings(method="stochastic", samples=1024)
    found = mb.render(scene, **wide, settings=sampled).rgba
    noise = np.sqrt(np.mean(np.var(films, axis=0)) / len(films))
    assert np.sqrt(np.mean((found - truth) ** 2)) < 2.0 * noise + 1e-3
    assert noise < 4e-3


def test_a_camera_that_turns_sees_light_where_the_analytic_method_does():
    """Rays of a tile's samples turn with the camera, not only the one through its middle."""
    turning = Track([0.75, 1.25], [[-0.6, 0.4, -2.0], [0.6, -0.4, -2.0]])
    camera = Camera(look_at=turning, focal_length=24.0)
    wall = quad(-90.0, 140.0, 0.0, rows=(-90, 120), material=Material(specular=(0, 0, 0)))
    scene = Scene(meshes=[wall], camera=camera, lights=[Light("point", position=(0.3, 0.2, -1.2))])
    size = {"width": SIZE[0], "height": SIZE[1]}
    truth = mb.render(scene, **size, settings=mb.Settings(samples=16, motion_segments=1)).rgba
    points = mb.Settings(method="stochastic", samples=256, motion_segments=1)
    found = mb.render(scene, **size, settings=points).rgba
    assert np.ptp(truth[..., 0]) > 0.3
    assert np.abs(found - truth).max() < 5e-3


@pytest.mark.parametrize("speed", [9.0, nightly(0.0)])
def test_linear_colour_is_the_same_shaded_once_per_pixel_and_triangle(speed):
    each = film(colored(speed), method="stochastic", samples=16)
    once = film(colored(speed), method="stochastic", samples=16, shading_rate="pixel")
    assert np.abs(once - each).max() < 1e-5


def test_textures_are_not():
    each = film(textured(9.0), method="stochastic", samples=64)
    once = film(textured(9.0), method="stochastic", samples=64, shading_rate="pixel")
    assert np.abs(once - each).max() > 0.02
    assert np.array_equal(once[..., 3], each[..., 3])


def test_hybrid_shades_once_what_does_not_move():
    meshes = textured(0.0, 1.0), textured(6.0, 30.0)
    ways = [{}, {"shading_rate": "pixel"}, {"hybrid": True}]
    each, once, hybrid = (film(*meshes, method="stochastic", samples=16, **way) for way in ways)
    assert np.array_equal(hybrid[:, :26], once[:, :26])
    assert np.array_equal(hybrid[:, 31:], each[:, 31:])
    assert np.abs(hybrid - each).max() > 1e-3
    assert np.abs(hybrid - once).max() > 1e-3


def test_look_ups_are_counted_and_what_a_small_cache_fetches():
    """Four texels for each sample that is shaded; of 8 x 8 a tile that shows them has 4 lines."""
    scene = Scene(meshes=[textured(9.0)], camera=UNIT_CAMERA)

    def counted(**values: object) -> tuple[int, int, int]:
        settings = mb.Settings(method="stochastic", samples=16, statistics=True, **values)
        of = mb.render(scene, width=SIZE[0], height=SIZE[1], settings=settings)
        return of.stats["texels"], of.stats["texel_lines"], int(of.intervals.sum())

    texels, lines, seen = counted()
    assert texels == 4 * seen
    assert lines == 4 * 6
    once, fewer, _ = counted(shading_rate="pixel")
    assert once < 0.2 * texels  # pixels that two triangles share are shaded twice
    assert fewer == lines
    big = replace(textured(9.0).material, texture=Texture(np.ones((2048, 2048, 3))))
    scene = Scene(meshes=[replace(textured(9.0), material=big)], camera=UNIT_CAMERA)
    texels, lines, seen = counted()
    assert texels == 4 * seen
    assert seen < lines < 4 * seen  # texels far apart: a look-up touches one line, two or four


def test_flat_colours_do_not_care():
    mesh = quad(4.0, 30.0, 5.0, color=np.array([0.2, 0.4, 0.6]), shading="unlit")
    ways = [{}, {"shading_rate": "pixel"}, {"hybrid": True}]
    films = [film(mesh, method="stochastic", samples=16, **way) for way in ways]
    assert all(np.array_equal(f, films[0]) for f in films)
