"""Textures averaged over what a sample stands for: the definition, ramps, point samples."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from reference import shading as twin
from support.closed_forms import FACES, UNIT_CAMERA, rectangle, world
from support.exact_twin import rms
from support.kernels import builds_without, run
from support.nightly import nightly

import mbinterval as mb
from mbinterval.exposure.exposure import expose
from mbinterval.layout.appearance import appearance
from mbinterval.layout.motion import lay_out
from mbinterval.plan.prepare import make_plan
from mbinterval.scene.model import Camera, Material, Mesh, Scene, Texture

SIZE = (64, 48)


def test_look_ups_are_a_row_along_the_longer_side():
    rng = np.random.default_rng(7)
    texture = Texture(rng.uniform(0, 1, (32, 48, 3)), wrap="mirror")
    uv = rng.uniform(-2, 3, (1500, 2))
    right, down = 10.0 ** rng.uniform(-3, 0, (2, 1500, 1)) * rng.normal(0, 0.3, (2, 1500, 2))
    down[::5] = 0.0
    least = np.where(rng.uniform(size=1500) < 0.2, rng.uniform(0, 4, 1500), 0.0)
    given = np.concatenate([uv, right, down, least[:, None]], axis=1).astype(np.float32)
    tables = appearance([Material(texture=texture)], ())
    arrays = [
        *(tables.texels, tables.textures, given, np.uint32(len(given)), np.int32(4)),
        np.zeros((len(given), 3), np.float32),
    ]
    found = run("shading.cl", "footprints", arrays, ["-DMB_ANISOTROPY"])[-1]
    uv, right, down, least = np.split(given.astype(np.float64), [2, 4, 6], axis=1)
    chain = twin.mip_chain(texture.image)
    truth = twin.averaged(chain, texture, uv, right, down, 4, least[:, 0])[:, :3]
    error = np.abs(found - truth).max(axis=1)
    assert np.quantile(error, 0.99) < 1e-4  # the number of look-ups is rounded
    other = twin.averaged(chain, texture, uv, down, right, 3, least[:, 0])[:, :3]
    assert np.quantile(np.abs(found - other).max(axis=1), 0.9) > 1e-3


def floor(image: np.ndarray, speed: float) -> Scene:
    """A floor that goes far, moving to the right, under a low camera."""
    corners = np.array([[-8, 0, -16], [8, 0, -16], [8, 0, 2], [-8, 0, 2.0]])
    positions = np.stack([corners, corners + [speed, 0, 0]]) if speed else corners
    uv = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    material = Material(shading="unlit", texture=Texture(image))
    mesh = Mesh(positions=positions, faces=FACES[:, ::-1], uv=uv, material=material)
    return Scene(meshes=[mesh], camera=Camera(position=(0, 1, 3), look_at=(0, 0.4, -2), fov=45))


def shot(of: Scene, **settings: object) -> np.ndarray:
    settings = mb.Settings(**settings)
    return mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings).rgba.astype(float)


@pytest.mark.parametrize("speed", [0.4, nightly(0.0)])
def test_a_ramp_is_the_same_over_any_footprint(speed):
    across, along = np.meshgrid((np.arange(64) + 0.5) / 64, (np.arange(64) + 0.5) / 64)
    scene = floor(np.stack([across, along, 0.5 * across], axis=2), speed)
    low = slice(24, 48)  # the rows that don't reach the far edge, where the ramp ends
    plain, wide = (shot(scene, samples=1, anisotropy=k)[low, 8:56] for k in (0, 8))
    assert np.abs(wide - plain).max() < 2e-3
    assert wide[..., 0].std() > 0.02


@pytest.mark.parametrize(
    ("speed", "counts"), [(0.4, (4, 64)), nightly(0.4, (4, 16, 64)), nightly(0.0, (4, 16, 64))]
)
def test_noise_of_few_samples_is_less_and_more_samples_come_to_the_point_samples(speed, counts):
    image = np.random.default_rng(0).uniform(0, 1, (256, 256, 3))
    scene = floor(image, speed)
    truth = shot(scene, method="stochastic", samples=4096)
    one = [rms(shot(scene, samples=1, anisotropy=k) - truth) for k in (0, 1, 8)]
    assert one[2] < 0.6 * one[0]
    assert one[2] < one[1]
    scattered = {"anisotropy": 8, "pattern": "sobol"}
    more = [rms(shot(scene, samples=n, **scattered) - truth) for n in counts]
    for (n, less), (m, least) in pairwise(zip(counts, more, strict=True)):
        assert least < 0.6 ** np.log2(m / n / 2) * less
    assert more[-1] < 0.004


def test_a_facing_wall_shows_the_mean_of_its_texels():
    """Each pixel is 16 x 16 texels wide: its centre is looked up where such a part is a texel."""
    size = (16, 8)
    image = np.random.default_rng(1).uniform(0, 1, (128, 256, 3))
    corners = world(rectangle(0, 16, 0, 8), 2.0, size)
    uv = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    material = Material(shading="unlit", texture=Texture(image, wrap="clamp"))
    wall = Mesh(positions=corners, faces=FACES, uv=uv, material=material)
    scene = Scene(meshes=[wall], camera=UNIT_CAMERA)
    settings = mb.Settings(samples=1, anisotropy=1)
    found = mb.render(scene, width=16, height=8, settings=settings).rgba[..., :3]
    want = image.reshape(8, 16, 16, 16, 3).mean(axis=(1, 3))
    assert np.abs(found - want).max() < 1e-4
    settings = replace(settings, anisotropy=0)
    plain = mb.render(scene, width=16, height=8, settings=settings).rgba[..., :3]
    assert np.abs(plain - want).max() > 0.1


@pytest.mark.parametrize("tile", [8, nightly(32)])
def test_a_film_does_not_depend_on_tiles(tile):
    scene = floor(np.random.default_rng(2).uniform(0, 1, (64, 64, 3)), 0.4)
    scene = replace(
        scene, meshes=[*scene.meshes, *floor(np.eye(32)[..., None].repeat(3, 2), 0.0).meshes]
    )
    films = [shot(scene, samples=2, anisotropy=4, tile_size=size) for size in (16, tile)]
    assert films[0].tobytes() == films[1].tobytes()


def test_there_is_no_code_for_it_where_it_is_not_asked_for():
    scene = floor(np.zeros((4, 4, 3)), 0.4)
    frozen = expose(scene, 0, 1.5)
    layout = lay_out(frozen, *SIZE)
    place = (*SIZE, (0, 0, *SIZE))
    plain = make_plan(frozen, layout, mb.Settings(), *place)
    asked = make_plan(frozen, layout, mb.Settings(anisotropy=8), *place)
    for name, header in (("texture_over", "shading"), ("load_footprint", "attributes")):
        assert builds_without(plain, (name,), f"shared/{header}.h")
        assert not builds_without(asked, (name,), f"shared/{header}.h")
    reasons = {effect.name: effect for effect in asked.effects}
    assert reasons["texture footprint"].active
    assert reasons["texture footprint"].reason == "anisotropy=8"
