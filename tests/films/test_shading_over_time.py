"""Shading along spans at as many times as the error asks for: closed forms, the twin, stacks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.closed_forms import FACES, UNIT_CAMERA, rectangle, scene, slab_times, world
from support.exact_twin import case_of, exposed, rms, twin
from support.nightly import nightly
from support.translucent_scenes import made
from support.translucent_scenes import twin as blended_twin

import mbinterval as mb
from mbinterval.scene.camera import Shutter
from mbinterval.scene.model import Light, Material, Mesh, Scene, Texture

SIZE = (33, 17)  # the centre of the frame is the centre of a pixel
UV = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
TOWARDS_VIEW = Light("directional", direction=(0, 0, -1))
TOLERANCES = (0.01, 0.001)


def shot(of: Scene, **settings: object) -> np.ndarray:
    settings = mb.Settings(**({"samples": 1} | settings))
    return mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings).rgba.astype(float)


def turning(extent: float, shininess: float, **changed: object) -> Scene:
    """A wall whose normal's slope goes from -extent to extent, seen and lit along the axis."""
    corners = world(rectangle(-9, 40, -9, 30), 2.0, SIZE)
    ends = np.stack([corners, corners + [0, 0, 1e-6]])
    slopes = np.array([-extent, extent])
    normals = np.stack([np.broadcast_to([x, 0, 1], (4, 3)) for x in slopes])
    material = Material(base_color=(0, 0, 0), specular=(1, 0.5, 0.25), shininess=shininess)
    wall = Mesh(positions=ends, faces=FACES, normals=normals, material=material, motion_segments=1)
    return Scene(meshes=[wall], camera=UNIT_CAMERA, lights=[TOWARDS_VIEW], **changed)


def highlight(extent: float, shininess: float, open_at=np.ones_like) -> float:
    """Average of cos(2 phi)^n, the slope tan(phi) running from -extent to extent."""
    t = (np.arange(400_000) + 0.5) / 400_000
    x2 = (extent * (2 * t - 1)) ** 2
    value = np.maximum((1 - x2) / (1 + x2), 0.0) ** shininess
    return float(np.sum(value * open_at(t)) / np.sum(open_at(t)))


def test_the_sum_over_a_highlight_is_that_of_its_closed_form():
    # Of n = 2 the integral is x + 2 x / (1 + x^2) - 2 atan x.
    a = 0.8
    closed = (a + 2 * a / (1 + a * a) - 2 * np.arctan(a)) / a
    assert highlight(a, 2.0) == pytest.approx(closed, abs=1e-9)
    found = shot(turning(a, 2.0), shading_error=0.001)[8, 16, 0]
    assert found == pytest.approx(closed, abs=0.001)


@pytest.mark.parametrize("shininess", [8.0, 300.0, 20_000.0])
def test_a_highlight_that_passes_is_as_exact_as_asked_for(shininess):
    truth = highlight(2.0, shininess) * np.array([1, 0.5, 0.25])
    errors = [
        np.abs(shot(turning(2.0, shininess), shading_error=e)[8, 16, :3] - truth).max()
        for e in TOLERANCES
    ]
    assert all(found <= wanted for found, wanted in zip(errors, TOLERANCES, strict=True))
    if shininess > 1000.0:  # sixteen places miss it
        fixed = shot(turning(2.0, shininess), texture_samples=16)[8, 16, :3]
        assert np.abs(fixed - truth).max() > 0.9 * truth.max()


def test_the_light_of_a_shutter_curve_weighs_what_passes():
    curve = Shutter(open=0.0, close=1.0, curve="triangle")
    truth = highlight(0.5, 50.0, lambda t: 1.0 - np.abs(2 * t - 1))
    found = shot(turning(0.5, 50.0, shutter=curve), shading_error=0.001)[8, 16, 0]
    assert found == pytest.approx(truth, abs=0.001)
    assert abs(highlight(0.5, 50.0) - truth) > 0.05


def sliding(image: np.ndarray, speed: float, **fields: object) -> Mesh:
    """A quad over columns 4 to 20 that moves right; u runs over it."""
    corners = rectangle(4, 20, -9, 30)
    ends = world(np.stack([corners, corners + [speed, 0]]), 2.0, SIZE)
    texture = Texture(image, wrap="clamp")
    material = Material(shading="unlit", texture=texture, **fields)
    return Mesh(positions=ends, faces=FACES, material=material, uv=UV)


def row_of(image: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Bilinear look-ups in a texture whose rows are alike, from their definition."""
    x = np.clip(u * image.shape[1] - 0.5, 0, image.shape[1] - 1)
    left = np.minimum(x.astype(int), image.shape[1] - 2)
    part = (x - left)[..., None]
    return (1 - part) * image[0, left] + part * image[0, left + 1]


def passing(image: np.ndarray, speed: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean colour, and how long, of what each column sees of `sliding`."""
    x = np.arange(SIZE[0]) + 0.5
    t0, t1 = slab_times(x, 4, 20, speed)
    part = (np.arange(20_000) + 0.5) / 20_000
    t = t0[:, None] + (t1 - t0)[:, None] * part
    u = (x[:, None] - 4 - speed * t) / 16
    return row_of(image, u).mean(axis=1), t1 - t0


def stripes(count: int) -> np.ndarray:
    """Black and white columns, each a texel wide."""
    return np.broadcast_to((np.arange(count) % 2.0)[None, :, None], (2, count, 3))


@pytest.mark.parametrize("speed", [0.3, 2.0, 9.0, -23.0])
@pytest.mark.parametrize("count", [8, 48])
def test_stripes_that_slide_by_are_as_exact_as_asked_for(count, speed):
    image = stripes(count)
    mean, time = passing(image, speed)
    for wanted in TOLERANCES:
        found = shot(scene([sliding(image, speed)]), shading_error=wanted)[8, :, 0]
        assert np.abs(found - time * mean[:, 0]).max() <= wanted + 1e-5
    late, _ = passing(np.roll(image, 1, axis=1), speed)
    assert np.abs(found - time * late[:, 0]).max() > 0.005


def test_a_ramp_needs_three_looks():
    ramp = np.broadcast_to(((np.arange(16) + 0.5) / 16)[None, :, None], (2, 16, 3))
    mean, time = passing(ramp, 9.0)
    inner = (np.arange(SIZE[0]) > 14) & (time > 0.5)
    assert np.count_nonzero(inner) > 3
    found = shot(scene([sliding(ramp, 9.0)]), shading_error=0.01)[8, :, 0]
    assert np.abs(found - time * mean[:, 0])[inner].max() < 1e-4


def test_texels_that_rush_by_in_great_number_come_to_their_mean():
    noise = np.random.default_rng(3).uniform(0, 1, (2, 6000, 3))
    noise[1] = noise[0]
    found = shot(scene([sliding(noise, -60.0)]))[8]
    mean, time = passing(noise, -60.0)
    assert np.abs(found[:, :3] - time[:, None] * mean).max() < 0.02


@pytest.mark.parametrize(
    "name", ["texture", nightly("everything"), nightly("vertex colour"), nightly("phong")]
)
def test_random_scenes_come_to_those_of_a_thousand_times(name):
    of, settings = case_of(name, 1)
    truth = shot_like(of, replace(settings, texture_samples=1024))
    found = [
        shot_like(of, replace(settings, texture_samples=None, shading_error=e))
        for e in (0.01, 0.001)
    ]
    worst = [np.abs(f - truth).max() for f in found]
    assert worst[1] < 0.005  # normals that pass through zero turn at once
    assert worst[1] <= worst[0]
    coarse = twin(exposed(of, settings), settings).rgba
    assert rms(found[1] - truth) < 0.6 * rms(coarse - truth) + 1e-5


def shot_like(of: Scene, settings: mb.Settings) -> np.ndarray:
    return mb.render(of, width=48, height=32, settings=settings).rgba.astype(float)


@pytest.mark.parametrize(
    ("name", "most"), [("vertices", 2e-4), ("tested", 0.015), nightly("textured", 2e-3)]
)
def test_stacks_whose_alpha_varies_come_to_those_of_a_thousand_times(name, most):
    of, settings = made(name, 1)
    truth = shot_like(of, replace(settings, texture_samples=1024))
    found = shot_like(of, replace(settings, texture_samples=None, shading_error=0.001))
    assert np.abs(found - truth).max() < most
    if name == "tested":  # what is seen through a hole is there, or not
        assert np.abs(blended_twin(of, settings).rgba - truth).max() > 2.0 * most


@pytest.mark.nightly  # which test_all_effects.py has for all effects together
@pytest.mark.parametrize("tile", [8, 32])
def test_two_renders_and_any_tiles_give_the_same_bytes(tile):
    of = scene([sliding(stripes(48), 9.0), *turning(0.5, 50.0).meshes])
    of = replace(of, lights=(TOWARDS_VIEW,))
    films = [shot(of, tile_size=size).tobytes() for size in (16, 16, tile)]
    assert len(set(films)) == 1


def test_a_scene_whose_colours_are_constant_has_nothing_of_it():
    plain = scene([replace(sliding(stripes(8), 3.0), material=Material(shading="unlit"), uv=None)])
    films = [shot(plain, shading_error=e).tobytes() for e in (0.01, 0.001)]
    assert films[0] == films[1]
