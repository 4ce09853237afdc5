"""Memory is bounded: whatever the depth complexity, for large frames, for one crowded pixel."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.nightly import nightly
from support.plane_stacks import stack

import mbinterval as mb
from mbinterval.bench.meter import MeteredRuntime
from mbinterval.device.choose import choose_device
from mbinterval.errors import CapacityError, UsageError
from mbinterval.plan.memory import resident_memory
from mbinterval.scene.generators import dense_sphere

ROOT = Path(__file__).resolve().parents[2]
MEGABYTE = 10**6
LIMIT = 1500 * MEGABYTE

RENDER = """
import sys
import mbinterval as mb
from mbinterval.bench.meter import peak_memory
from mbinterval.scene.generators import ho17_cubes
from support.plane_stacks import stack
width, height, samples, planes = map(int, sys.argv[1:])
scene = stack(planes)[0] if planes else ho17_cubes(100)
film = mb.render(scene, width=width, height=height, settings=mb.Settings(samples=samples))
print(film.intervals.sum(), peak_memory())
"""


def intervals_and_memory(width: int, height: int, samples: int, planes: int) -> tuple[int, int]:
    """Intervals met, and most bytes held by a process of its own, from start to film.

    The scene is a ``stack`` of so many planes, all of them over every pixel, or 100 small cubes.
    """
    path = os.pathsep.join([str(ROOT), str(ROOT / "tests"), os.environ.get("PYTHONPATH", "")])
    run = subprocess.run(
        [sys.executable, "-c", RENDER, *map(str, (width, height, samples, planes))],
        env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    intervals, memory = map(int, run.stdout.split())
    return intervals, memory


def test_depth_complexity_costs_no_memory_at_16_samples_per_pixel():
    """Twelve million intervals would take at least 16 bytes each if all were held at once."""
    few, little = intervals_and_memory(32, 24, 16, planes=10)
    many, memory = intervals_and_memory(32, 24, 16, planes=1000)
    assert many > 12e6 > 90 * few
    assert memory - little < 16 * many / 4
    assert memory < LIMIT / 2


def test_the_measure_sees_what_is_held():
    _built, small, large = (
        intervals_and_memory(width, 1024, 1, planes=0)[1] for width in (64, 64, 4096)
    )
    assert large - small > 4096 * 1024 * 24 / 2  # half of the film


def test_a_frame_of_4k_stays_below_the_limit():
    intervals, memory = intervals_and_memory(3840, 2160, 4, planes=0)
    assert intervals > 1e6
    assert memory < LIMIT


@pytest.mark.parametrize("paths", ["exact", "triangulated"])
def test_ten_thousand_intervals_on_one_pixel(paths):
    count = 10_000
    scene, color, _ = stack(count)
    film = mb.render(
        scene, width=9, height=3, crop=(4, 1, 1, 1), settings=mb.Settings(samples=1, paths=paths)
    )
    assert film.intervals.tolist() == [[count]]
    want = color.sum(axis=0) / count - 0.5 / count * color[0]
    assert film.rgba[0, 0, :3] == pytest.approx(want, abs=2e-5)
    assert np.abs(want - color[: count // 2].mean(axis=0)).max() > 1e-3  # all of them count


LIMITED = """
import hashlib, sys
import mbinterval as mb
from mbinterval.bench.meter import peak_memory
from mbinterval.scene.generators import dense_sphere, ho17_cubes
count, segments, width, height = map(int, sys.argv[1:5])
memory = int(sys.argv[5]) or None
scene = dense_sphere(count) if count < 10 else ho17_cubes(count)
settings = mb.Settings(samples=1, motion_segments=segments)
try:
    film = mb.render(scene, width=width, height=height, settings=settings, memory=memory)
except mb.CapacityError as error:
    sys.exit(f"refused: {error}")
peak = peak_memory()
print(hashlib.sha256(film.rgba.tobytes() + film.depth.tobytes()).hexdigest(), peak)
"""


def limited(memory: int, *what: int) -> tuple[str, int]:
    """Digest of a film and the most bytes that its process held; or the refusal and 0."""
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    run = subprocess.run(
        [sys.executable, "-c", LIMITED, *map(str, (*what, memory))],
        env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if run.returncode and run.stderr.startswith("refused: "):
        return run.stderr, 0
    assert run.returncode == 0, run.stderr
    digest, memory = run.stdout.split()
    return digest, int(memory)


@pytest.mark.parametrize(
    "what", [(6, 1, 320, 240), nightly((100, 1, 2560, 1440))], ids=["faces", "film"]
)
def test_the_memory_that_a_refusal_asks_for_suffices_and_is_not_exceeded(what):
    free, _ = limited(0, *what)
    refusal, _ = limited(2**20, *what)
    taken = re.search(r"the program and the scene take (\d+) MiB", refusal)
    assert taken, refusal
    refusal, _ = limited((int(taken[1]) + 30) * 2**20, *what)  # room for motion paths
    said = re.search(r"the frame needs (\d+) MiB .* left: allow (\d+) MiB in all", refusal)
    assert said, refusal
    need, allowed = (int(number) * 2**20 for number in said.groups())
    digest, peak = limited(allowed + 2**20, *what)  # a process starts with some pages more or less
    assert digest == free
    assert peak <= allowed + 2**20
    assert peak > allowed - 0.5 * need  # the estimate is no wild one
    refusal, _ = limited(allowed - need // 10, *what)
    assert "the frame needs" in refusal


def test_motion_paths_that_have_no_room_are_refused_before_they_are_made():
    (mesh,) = dense_sphere(5).meshes
    scene = mb.Scene(meshes=[replace(mesh, motion_segments=1000, shading=None)])
    before = resident_memory()
    with pytest.raises(CapacityError) as caught:
        mb.render(
            scene, width=8, height=8, memory=before + 100 * MEGABYTE,
            settings=mb.Settings(motion_segments=1000),
        )  # fmt: skip
    assert f"mesh {mesh.name!r} with {len(mesh.faces)} faces in 1000 motion seg" in str(
        caught.value
    )
    assert "allow more, or fewer segments" in str(caught.value)
    assert resident_memory() - before < 1000 * len(mesh.faces) * 100  # positions, but no paths


def test_a_program_that_is_larger_than_what_is_allowed_is_said():
    scene = mb.Scene(meshes=())
    with pytest.raises(CapacityError, match=r"the program and the scene take .* 5 MiB are allowed"):
        mb.render(scene, width=8, height=8, memory=5 * 2**20)
    for wrong in (0, -1, 2.5, "2G"):
        with pytest.raises(UsageError, match="memory="):
            mb.render(scene, width=8, height=8, memory=wrong)


@pytest.mark.parametrize("paths", ["exact", nightly("triangulated")])
def test_pools_are_as_many_and_as_large_as_memory_allows(paths, monkeypatch):
    """On a device with 64 threads pools take 400 MiB; with less memory the bytes are the same."""
    scene, _, _ = stack(2000)
    settings = mb.Settings(samples=1, paths=paths, tile_size=8)
    meter = MeteredRuntime(choose_device())
    meter.workers = 64
    options = {"width": 64, "height": 64, "settings": settings, "device": meter}
    free = mb.render(scene, **options)
    pools = {name for name in meter.allocated if name.startswith("pool of")}
    wide = sum(meter.allocated[name] for name in pools)
    assert wide > 400 * MEGABYTE
    monkeypatch.setattr("mbinterval.plan.memory.resident_memory", lambda: 0)
    for memory in (200, 40):
        meter.clear()
        film = mb.render(scene, **options, memory=memory * MEGABYTE)
        assert film.rgba.tobytes() == free.rgba.tobytes()
        assert sum(meter.uploaded.values()) + sum(meter.allocated.values()) < memory * MEGABYTE
        assert sum(meter.allocated[name] for name in pools) > 0.1 * memory * MEGABYTE
