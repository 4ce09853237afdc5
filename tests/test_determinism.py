"""The same bytes: run after run, on one thread and on two, in tiles of any size, and in crops."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from closed_forms import UNIT_CAMERA, rectangle, slab, world
from nightly import nightly

import mbinterval as mb
from mbinterval.scene.model import Light, Material, Mesh, Scene, Texture

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


@lru_cache
def whole(way: str) -> mb.Film:
    return film(way)


@pytest.mark.parametrize("way", WAYS)
def test_two_runs_give_the_same_bytes(way):
    assert contents(film(way)) == contents(whole(way))
    assert whole(way).rgba.std() > 0.1
    other = film(way, replace(busy_scene(), background=(0.1, 0.2, 0.3001)))
    assert contents(other) != contents(whole(way))


@pytest.mark.parametrize(
    ("way", "tile"),
    [("triangulated", 32), nightly("exact", 8), ("exact, masked", 32),
     nightly("triangulated", 8), nightly("exact", 32), nightly("exact, masked", 8)],
)  # fmt: skip
def test_tiles_of_any_size_give_the_same_bytes(way, tile):
    assert contents(film(way, tile_size=tile)) == contents(whole(way))


@pytest.mark.parametrize("crop", [(0, 0, 70, 45), (17, 5, 31, 29), (33, 44, 1, 1), (64, 0, 6, 45)])
@pytest.mark.parametrize("way", WAYS)
def test_a_crop_is_that_part_of_the_whole_to_the_bit(way, crop):
    x, y, width, height = crop
    part = film(way, crop=crop)
    for name in ("rgba", "depth", "intervals"):
        want = getattr(whole(way), name)[y : y + height, x : x + width]
        assert np.array_equal(getattr(part, name), want), name
    assert (part.origin, part.resolution) == ((x, y), SIZE)


THREADS = """
import sys
from test_determinism import WAYS, contents, film
import hashlib
for way in WAYS:
    print(hashlib.sha256(b"".join(contents(film(way)))).hexdigest())
"""


def hashes(threads: int) -> list[str]:
    here = Path(__file__).resolve().parent
    path = os.pathsep.join([str(here), str(here.parent), os.environ.get("PYTHONPATH", "")])
    run = subprocess.run(
        [sys.executable, "-c", THREADS],
        env=os.environ | {"POCL_MAX_PTHREAD_COUNT": str(threads), "PYTHONPATH": path},
        capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    return run.stdout.split()


def test_one_thread_and_two_give_the_same_bytes():
    one, two = hashes(1), hashes(2)
    assert len(one) == len(set(one)) == len(WAYS)
    assert one == two


def shuffled(mesh: Mesh, order: np.ndarray) -> Mesh:
    color = mesh.color if mesh.color is None or mesh.color_domain == "vertex" else mesh.color[order]
    return Mesh(
        positions=mesh.positions, faces=mesh.faces[order], color=color,
        color_domain=mesh.color_domain, uv=mesh.uv, material=mesh.material,
    )  # fmt: skip


@pytest.mark.parametrize("way", WAYS)
def test_the_order_of_triangles_does_not_matter_where_depths_differ(way):
    rng = np.random.default_rng(2)
    meshes = [shuffled(mesh, rng.permutation(30)) for mesh in busy_scene().meshes]
    other = film(way, replace(busy_scene(), meshes=meshes[::-1]))
    assert contents(other) == contents(whole(way))


@pytest.mark.parametrize("moving", [True, False])
@pytest.mark.parametrize("way", WAYS)
def test_equal_depths_go_to_the_mesh_that_comes_first(way, moving):
    speed = (3, 0) if moving else (0, 0)
    both = [
        slab(rectangle(-20, 90, -5, 50), speed, 2.0, SIZE, color)
        for color in ((1, 0, 0), (0, 1, 0))
    ]
    for meshes, want in ((both, [1, 0, 0, 1]), (both[::-1], [0, 1, 0, 1])):
        image = film(way, Scene(meshes=meshes, camera=UNIT_CAMERA), samples=1)
        assert np.abs(image.rgba - np.float32(want)).max() < 1e-6
