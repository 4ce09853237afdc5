"""Environments in mirrors: the picture from below the floor, sums over the disc, point samples.

What a floor mirrors is what the eye would see from as far below it, upside down, without the floor.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.environments import environment, smooth
from support.nightly import nightly_but

import mbinterval as mb
from mbinterval.scene.model import Camera, Light, Material, Mesh, Scene
from mbinterval.scene.tracks import Track

SIZE = (24, 18)
FOV = 45.0
AROUND = environment(smooth)
METHODS = {
    "analytic": {"samples": 1},
    "accumulation": {"method": "accumulation", "samples": 1, "slices": 16},
}


def floor(shear: float = 0.0, size: float = 60.0) -> Mesh:
    corners = size * np.array([[-1.0, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]])
    material = Material("floor", shading="unlit", reflectivity=1.0, reflection_shear=shear)
    return Mesh(positions=corners, faces=[[0, 1, 2], [0, 2, 3]], material=material)


def things() -> list[Mesh]:
    """Metal and glass that fly over the floor."""
    rng = np.random.default_rng(3)
    corners = rng.uniform([-1, 0.4, -1], [1, 1.4, 1], (12, 3))
    faces = np.arange(12).reshape(-1, 3)
    metal = Material("metal", shading="metallic_roughness", metallic=1.0, roughness=0.3)
    glass = Material("glass", shading="unlit", opacity=0.5)
    return [
        Mesh(positions=np.stack([corners, corners + [0.6, 0.2, 0]]), faces=faces, material=metal),
        Mesh(positions=np.stack([corners, corners - [0.6, 0, 0]]) + [0, 0, 0.9], faces=faces,
             material=glass),
    ]  # fmt: skip


def camera(below: bool = False) -> Camera:
    """Over the floor, or as far below it; it flies and turns while the shutter is open."""
    side = np.array([1.0, -1.0, 1.0]) if below else np.ones(3)
    places = side * [[-0.5, 1.6, 4.0], [0.5, 1.8, 4.0]]
    aims = side * [[0.2, -1.6, 0.0], [-0.3, -1.5, 0.0]]
    frames = [0.75, 1.25]
    return Camera(position=Track(frames, places), look_at=Track(frames, aims), fov=FOV)


def scene(meshes: list[Mesh], view: Camera) -> Scene:
    lights = (Light("point", position=(0.5, 2.5, 1.0), intensity=3.0),)
    return Scene(meshes=meshes, camera=view, environment=AROUND, lights=lights)


def film(of: Scene, **values: object) -> np.ndarray:
    settings = mb.Settings(**{"motion_segments": 4, **values})
    rgba = mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings).rgba
    return np.asarray(rgba, np.float64)


@pytest.mark.parametrize("method", nightly_but(METHODS, "analytic"))
def test_a_floor_shows_what_is_seen_from_below_it(method):
    values = METHODS[method]
    seen = things() if method == "analytic" else things()[:1]  # slices see glass by chance
    found = film(scene([floor(), *seen], camera()), **values)
    upside_down = film(scene(seen, camera(below=True)), **values)[::-1]
    direct = film(scene(seen, camera()), **values)
    shown = direct[..., 3] == 0.0  # elsewhere things hide the floor
    assert shown.mean() > 0.4
    assert np.abs(found - upside_down)[shown, :3].max() < 2e-3  # shading_error
    assert upside_down[shown, 3].mean() > 0.02
    assert np.all(found[..., 3] > 1.0 - 1e-6)
    assert np.ptp(upside_down[shown, :3], axis=0).max() > 0.3


def test_a_glossy_floor_shows_the_mean_over_its_disc():
    """Of what is infinitely far: a ray is sheared along the floor by its height over it."""
    view = Camera(position=(0, 1.6, 4.0), look_at=(0.2, -1.6, 0.0), fov=FOV)
    of = replace(scene([floor(shear=0.25)], view), lights=())
    found = np.mean([film(of, samples=256, pattern="sobol", seed=k) for k in range(2)], axis=0)
    radius, turn = np.meshgrid(
        np.sqrt((np.arange(24) + 0.5) / 24), 2 * np.pi * np.arange(48) / 48, indexing="ij"
    )
    disc = np.stack([radius * np.cos(turn), 0.0 * turn, radius * np.sin(turn)], -1).reshape(-1, 3)
    forward = np.array([0.2, -3.2, -4.0]) / np.linalg.norm([0.2, -3.2, -4.0])
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    scale = np.tan(np.radians(FOV / 2))
    x = ((np.arange(4 * SIZE[0]) + 0.5) / (2 * SIZE[0]) - 1.0) * scale * SIZE[0] / SIZE[1]
    y = (1.0 - (np.arange(4 * SIZE[1]) + 0.5) / (2 * SIZE[1])) * scale
    ways = forward + x[None, :, None] * right + y[:, None, None] * up

    def expected(shear: float) -> np.ndarray:
        seen = ways[..., None, :] + shear * ways[..., None, 1:2] * disc
        seen[..., 1] *= -1.0
        light = smooth(seen / np.linalg.norm(seen, axis=-1, keepdims=True)).mean(axis=-2)
        return light.reshape(SIZE[1], 4, SIZE[0], 4, 3).mean(axis=(1, 3))

    assert np.abs(found[..., :3] - expected(0.25)).max() < 0.01
    assert np.abs(found[..., :3] - expected(0.15)).max() > 0.05


@pytest.mark.nightly  # test_all_effects.py has these together with all others
@pytest.mark.parametrize("shear", [0.3, 0.0])
def test_point_samples_see_the_same_in_mirrors(shear):
    """By blocks of pixels, over repeated seeds; what is a little turned is told apart."""
    of, repeats = scene([floor(shear), *things()], camera()), 12

    def blocks(of: Scene, **values: object) -> np.ndarray:
        films = [film(of, seed=k, **values)[..., :3] for k in range(repeats)]
        return np.array(films).reshape(repeats, 6, 3, 8, 3, 3).mean(axis=(2, 4))

    points = blocks(of, method="stochastic", pattern="random", samples=256)
    exact = blocks(of, pattern="sobol", samples=16)
    deviation = np.sqrt((points.var(axis=0, ddof=1) + exact.var(axis=0, ddof=1)) / repeats)
    z = (points.mean(axis=0) - exact.mean(axis=0)) / np.maximum(deviation, 1e-5)
    assert np.abs(z).max() < 5.5  # 144 blocks and channels, 22 degrees of freedom: one in 500
    assert np.sqrt(np.mean(z**2)) < 1.6
    turned = replace(of, environment=replace(AROUND, rotation=4.0))
    moved = blocks(turned, pattern="sobol", samples=16).mean(axis=0)
    assert np.abs((points.mean(axis=0) - moved) / np.maximum(deviation, 1e-5)).max() > 8.0
