"""Memory is bounded: whatever the depth complexity, for large frames, for one crowded pixel."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from test_capacity import stack

import mbinterval as mb

ROOT = Path(__file__).resolve().parent.parent
MEGABYTE = 10**6
LIMIT = 1500 * MEGABYTE

RENDER = """
import sys
import mbinterval as mb
from mbinterval.device.meter import peak_memory
from mbinterval.scene.generators import ho17_cubes
from test_capacity import stack
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
    small, large = (intervals_and_memory(width, 1024, 1, planes=0)[1] for width in (64, 4096))
    assert large - small > 4096 * 1024 * 24 / 2  # half of the film; a first run builds kernels too


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
