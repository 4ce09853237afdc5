"""A scene with some of everything, in all ways to render it, and what a film holds."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

import mbinterval as mb
from mbinterval.scene.model import Light, Material, Mesh, Scene, Texture
from support.closed_forms import UNIT_CAMERA, world

SIZE = (70, 45)  # no multiple of any tile
WAYS = {
    "triangulated": {"paths": "triangulated", "occlusion": 128},
    "exact": {"paths": "exact", "occlusion": "exact"},
    "exact, masked": {"paths": "exact", "occlusion": 128},
}


def corners(rng: np.random.Generator, count: int) -> np.ndarray:
    pixels = rng.uniform(0, SIZE, (2, count, 1, 2)) + rng.normal(0, 8, (2, count, 3, 2))
    return world(pixels, rng.uniform(1, 4, (2, count, 3)), SIZE)


@lru_cache
def busy_scene() -> Scene:
    """Moving and static, flat, lit and textured triangles."""
    rng = np.random.default_rng(1)
    faces = np.arange(90).reshape(-1, 3)
    texture = Texture(rng.uniform(0, 1, (16, 16, 3)))
    ends = [corners(rng, 30).reshape(2, -1, 3) for _ in range(4)]
    meshes = [
        Mesh(positions=ends[0], faces=faces, color=rng.uniform(0, 1, (30, 3)), shading="unlit"),
        Mesh(positions=ends[1], faces=faces, material=Material(shininess=5.0)),
        Mesh(
            positions=ends[2], faces=faces, uv=rng.uniform(0, 3, (90, 2)),
            material=Material(texture=texture, double_sided=False),
        ),
        Mesh(positions=ends[3][0] + [0, 0, -2], faces=faces, shading="unlit"),
    ]  # fmt: skip
    lights = (Light("ambient", intensity=0.3), Light("point", intensity=3.0))
    return Scene(meshes=meshes, camera=UNIT_CAMERA, lights=lights, background=(0.1, 0.2, 0.3))


def film(way: str, scene: Scene | None = None, samples: int = 3, **options: object) -> mb.Film:
    names = ("tile_size", "max_intervals")
    settings = {name: options.pop(name) for name in names if name in options}
    return mb.render(
        scene or busy_scene(), width=SIZE[0], height=SIZE[1],
        settings=mb.Settings(samples=samples, **WAYS[way], **settings), **options,
    )  # fmt: skip


def contents(film_: mb.Film) -> tuple[bytes, bytes, bytes]:
    return film_.rgba.tobytes(), film_.depth.tobytes(), film_.intervals.tobytes()
