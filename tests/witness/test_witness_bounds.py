"""What the README gives bounds for, in place of exactness, against the witness.

Cube maps of what is around an object have texels and parts of the shutter; averaged look-ups of
textures stand for what a sample is of. The witness looks from the middle of the object itself, in
the very direction and at the very moment, and takes many points of each pixel.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from reference.witness.film import Asked, film
from reference.witness.product import (
    Camera,
    Environment,
    Light,
    Material,
    Mesh,
    Reflections,
    Scene,
    Settings,
    Shutter,
    Texture,
    Track,
    Transform,
    render,
)
from support.nightly import nightly

SIZE = (32, 24)


def rmse(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.sqrt(np.mean((a[..., :3] - b[..., :3]) ** 2)))


# Reflections by cube maps


def ball(count: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals and faces of a sphere by longitude and latitude."""
    up, turn = np.meshgrid(
        np.linspace(0.0, np.pi, count // 2 + 1),
        np.linspace(0.0, 2.0 * np.pi, count, endpoint=False),
        indexing="ij",
    )
    points = np.stack([np.sin(up) * np.sin(turn), np.cos(up), np.sin(up) * np.cos(turn)], axis=-1)
    faces = []
    for row in range(count // 2):
        for k in range(count):
            a, b = row * count + k, row * count + (k + 1) % count
            faces += [[a, a + count, b + count], [a, b + count, b]]
    return points.reshape(-1, 3), np.array(faces)


def panel(middle: list[float], half: float, move: list[float], color: list[float]) -> Mesh:
    """A square that faces the origin, and moves."""
    away = np.array(middle) / np.linalg.norm(middle)
    right = np.cross(away, [0.3, 1.0, 0.2])
    right /= np.linalg.norm(right)
    sides = half * np.array([right, np.cross(away, right)])
    corners = np.array(
        [a * sides[0] + b * sides[1] for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    )
    keys = Track([-0.5, 0.5], [middle, np.add(middle, move)])
    return Mesh(corners, [[0, 1, 2], [0, 2, 3]], color=color, shading="unlit",
                transform=Transform(translation=keys))  # fmt: skip


PANELS = (
    panel([0.0, 2.0, 6.0], 2.5, [3.0, 0.0, 0.0], [0.9, 0.5, 0.1]),
    panel([6.0, 1.0, 2.0], 2.0, [0.0, -3.0, 0.0], [0.1, 0.4, 0.8]),
    panel([-5.0, -3.0, 3.0], 2.0, [0.0, 2.0, 2.0], [0.7, 0.8, 0.2]),
)


def chrome(roughness: float, size: int, times: int, around: bool) -> Scene:
    """A ball that moves and mirrors panels that move, before a sky or nothing."""
    points, faces = ball()
    path = Transform(translation=Track([-0.5, 0.5], [[-0.3, 0, 0], [0.3, 0, 0]]))
    metal = Material(shading="metallic_roughness", metallic=1.0, roughness=roughness)
    mirror = Mesh(0.9 * points, faces, normals=points, material=metal, transform=path,
                  reflections=Reflections(size=size, times=times))  # fmt: skip
    up = np.linspace(1.0, 0.0, 32)[:, None, None] * np.ones((32, 64, 1))
    sky = Environment((0.1 + 0.3 * up * [0.4, 0.6, 1.0]).astype(np.float32), background=False)
    return Scene(
        [mirror, *PANELS], Camera(position=(0, 0, 5), fov=30.0), background=(0.05, 0.1, 0.05),
        lights=[Light("ambient", intensity=0.0)], environment=sky if around else None,
        shutter=Shutter(-0.5, 0.5),
    )  # fmt: skip


@cache
def mirrored(roughness: float, around: bool, late: float = 0.0) -> np.ndarray:
    """By the witness; the number of texels and parts counts for nothing there."""
    scene = chrome(roughness, 16, 1, around)
    scene = replace(scene, shutter=Shutter(-0.5 + late, 0.5 + late))
    return film(scene, 0.0, SIZE, Asked(64, 4, centre=True)).rgba.mean(axis=0)


def shown(scene: Scene, **settings: object) -> np.ndarray:
    given = Settings(**{"samples": 1, "shading_error": 1e-3} | settings)
    film = render(scene, frame=0.0, width=SIZE[0], height=SIZE[1], settings=given)
    return film.rgba.astype(np.float64)


@pytest.mark.parametrize(
    ("roughness", "around"), [(0.0, False), (0.3, True), nightly(0.0, True), nightly(0.6, False)]
)
def test_what_a_ball_mirrors_comes_to_the_witness_with_texels_and_parts(roughness, around):
    truth = mirrored(roughness, around)
    assert truth[..., 0].max() > 0.3
    coarse, fine = (rmse(shown(chrome(roughness, *asked, around)), truth)
                    for asked in ((32, 1), (128, 8)))  # fmt: skip
    assert fine < BOUNDS[roughness]
    assert coarse > 2.0 * fine
    assert rmse(mirrored(roughness, around, 0.1), truth) > 2.0 * fine


BOUNDS = {0.0: 4e-3, 0.3: 4e-3, 0.6: 4e-3}
"""RMSE with 128 texels along an edge and eight parts of the shutter."""


# Textures far away


def floor(speed: float) -> Scene:
    """A floor of noise that goes far, moving to the right, under a low camera."""
    noise = np.random.default_rng(0).uniform(0.0, 1.0, (256, 256, 3))
    corners = np.array([[-8, 0, -16], [8, 0, -16], [8, 0, 2], [-8, 0, 2.0]])
    keys = Track([-0.25, 0.25], [[0.0, 0, 0], [speed, 0, 0]])
    material = Material(shading="unlit", texture=Texture(noise.astype(np.float32)))
    mesh = Mesh(corners, [[0, 2, 1], [0, 3, 2]], uv=[[0, 0], [1, 0], [1, 1], [0, 1]],
                material=material, transform=Transform(translation=keys))  # fmt: skip
    return Scene([mesh], Camera(position=(0, 1, 3), look_at=(0, 0.4, -2), fov=45))


@pytest.mark.parametrize("speed", [0.4, nightly(0.0)])
def test_averaged_look_ups_come_to_the_mean_over_pixels(speed):
    """At sixteen samples a third of the error of a point for each; at one a quarter."""
    scene = floor(speed)
    truth = film(scene, 0.0, SIZE, Asked(64, 16)).rgba.mean(axis=0)
    away = {
        (samples, probes): rmse(shown(scene, samples=samples, anisotropy=probes), truth)
        for samples in (1, 16) for probes in (0, 8)
    }  # fmt: skip
    assert away[1, 8] < min(0.03, 0.4 * away[1, 0]), away
    assert away[16, 8] < min(0.012, 0.7 * away[16, 0]), away
