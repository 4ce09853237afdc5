"""One small scene that calls for every effect at once."""

from __future__ import annotations

from functools import cache

import numpy as np

import mbinterval as mb
from mbinterval.scene.model import Camera, Light, Material, Mesh, Scene, Shutter, Texture
from mbinterval.scene.primitives import sphere
from mbinterval.scene.tracks import Track
from mbinterval.scene.transforms import Transform
from support.environments import environment, smooth

SIZE = (24, 18)
SQUARE = np.array([[-1.0, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])
UV = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
BETWEEN = [0.75, 1.25]  # when the shutter of frame 1 opens and closes


@cache
def everything(late: float = 0.0) -> Scene:
    """Balls, glass and a leaf over a glossy floor: lit, shaded, mirrored, seen through.

    ``late`` is a part of the shutter by which all that moves is later.
    """
    rng = np.random.default_rng(5)
    wave = np.linspace(0.0, 1.0, 8)
    image = np.dstack([rng.uniform(0, 1, (8, 8, 3)), np.add.outer(wave, wave) / 2])
    leaf = Material("leaf", texture=Texture(image), alpha_mode="mask", alpha_cutoff=0.5)
    glass = Material("glass", texture=Texture(image[::-1]), alpha_mode="blend", opacity=0.7)
    gold = {"shading": "metallic_roughness", "base_color": (1.0, 0.7, 0.3), "metallic": 1.0}
    chrome = Material("chrome", roughness=0.15, **gold)
    glowing = Material("lamp", emission=(0.4, 0.2, 0.1), roughness=0.5, **gold)
    floor = Material("floor", base_color=(0.5, 0.5, 0.6), reflectivity=0.4, reflection_shear=0.2)
    return Scene(
        meshes=[
            Mesh(positions=4 * SQUARE, faces=FACES, material=floor),
            _ball(0.45, (-0.7, 0.5, 0.2), (0.5, 0.1, 0.0), late, chrome,
                  reflections=mb.Reflections(size=16, times=2)),
            _ball(0.3, (0.6, 1.0, -0.5), (-0.4, 0.0, 0.3), late, glowing),
            _plate(0.5, (0.2, 0.7, 0.7), (-0.5, 0.3, 0.0), late, glass),
            _plate(0.6, (0.4, 1.6, 0.0), (0.3, -0.2, 0.2), late, leaf),
        ],
        camera=Camera(
            position=Track(BETWEEN, [[-0.1, 1.8, 4.0], [0.1, 1.8, 4.0]]), look_at=(0, 0.5, 0),
            fov=40.0, f_stop=0.5, focus_distance=4.0,
        ),
        lights=(
            Light("point", position=(1.0, 3.0, 1.0), intensity=4.0, shadows=True),
            Light("spot", position=(-1.5, 2.5, 1.0), direction=(1, -1.5, -0.5), intensity=5.0,
                  inner_angle=15.0, outer_angle=35.0, shadows=True),
        ),
        environment=environment(smooth, 32, intensity=0.4),
        shutter=Shutter(curve=(0.2, 1.0, 0.6)),
    )  # fmt: skip


def _plate(size: float, at: object, by: object, late: float, material: Material) -> Mesh:
    corners = size * SQUARE + at
    ends = np.stack([corners, corners + by]) + late * np.asarray(by)
    return Mesh(positions=ends, faces=FACES, uv=UV, material=material)


def _ball(
    size: float, at: object, by: object, late: float, material: Material, **fields: object
) -> Mesh:
    made = sphere(size, 8)
    start = np.asarray(at) + late * np.asarray(by)
    place = Transform(translation=Track(BETWEEN, np.stack([start, start + by])))
    return Mesh(positions=made.positions, faces=made.faces, normals=made.normals,
                material=material, transform=place, **fields)  # fmt: skip
