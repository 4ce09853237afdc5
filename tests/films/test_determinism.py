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
from support.busy_scenes import SIZE, WAYS, busy_scene, contents, film
from support.closed_forms import UNIT_CAMERA, rectangle, slab
from support.nightly import nightly

import mbinterval as mb
from mbinterval.scene.model import Mesh, Scene


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
from support.busy_scenes import WAYS, contents, film
import hashlib
for way in WAYS:
    print(hashlib.sha256(b"".join(contents(film(way)))).hexdigest())
"""


def hashes(threads: int) -> list[str]:
    here = Path(__file__).resolve().parents[1]
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
