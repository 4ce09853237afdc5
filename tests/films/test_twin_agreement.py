"""Films of triangulated paths against the float64 twin: on random scenes, and on the benchmark.

What is left is rounding. It changes a pixel by more than that only where it moves the end of an
interval, or a change of depth order, over a bit's centre; the twin says which pixels those are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from reference import triangulated
from reference.hits import static_intervals
from reference.paths import Intervals, concatenate, paths_of
from reference.render import Crop, Image, render
from reference.samples import Grid, expand
from reference.visibility import limited
from support.closed_forms import UNIT_CAMERA
from support.nightly import nightly
from support.random_triangles import CASES, CROPS, LIGHTS, MOVING_CAMERA, SIZE, everything, late

import mbinterval as mb
from mbinterval.exposure.asked import Asked
from mbinterval.exposure.exposure import Exposure, expose
from mbinterval.plan.sampling import fixed_pattern
from mbinterval.scene.formats.meshes.benchmark import read_benchmark
from mbinterval.scene.model import Scene

TIME_ERROR = 4e-6
"""Of the shutter; the greatest that the stage's own test meets is half of it."""


def delicate_samples(found: Intervals, bits: int, count: int) -> np.ndarray:
    """Samples on which rounding may give a bit to another interval."""
    place = found.t * bits - 0.5
    near_centre = np.abs(place - np.rint(place)) < TIME_ERROR * bits
    near_centre &= (found.t > 0) & (found.t < 1)
    delicate = np.zeros(count, dtype=bool)
    delicate[found.sample[near_centre.any(axis=1)]] = True
    first, last = (np.ceil(t * bits - 0.5).astype(np.int64) for t in found.t.T)
    index, bit = expand(first, last)
    cell = found.sample[index] * bits + bit
    w = found.depth(index, (bit + 0.5) / bits)
    slope = np.abs(np.diff(found.w, axis=1) / np.diff(found.t, axis=1))[index, 0]
    noise = 2e-6 * np.abs(w) + TIME_ERROR * slope
    order = np.lexsort((w, cell))
    cell, w, noise = cell[order], w[order], noise[order]
    close = (np.diff(cell) == 0) & (np.diff(w) < noise[1:] + noise[:-1])
    delicate[cell[1:][close] // bits] = True
    return delicate


@dataclass(frozen=True, eq=False)
class Comparison:
    """A film, the twin's image, and the pixels ``(H, W)`` where bits may have flipped."""

    film: mb.Film
    truth: Image
    delicate: np.ndarray

    @property
    def error(self) -> np.ndarray:
        return self.film.rgba - self.truth.rgba


def twin(
    exposure: Exposure, size: tuple[int, int], settings: mb.Settings, crop: Crop | None = None
) -> Image:
    return render(
        exposure, *size, fixed_pattern(settings.samples).astype(np.float64), crop,
        bits=settings.occlusion, pairing=settings.pairing, max_intervals=settings.max_intervals,
        texture_samples=settings.shading_times,
    )  # fmt: skip


def compare(
    scene: Scene, size: tuple[int, int], settings: mb.Settings, crop: Crop | None = None
) -> Comparison:
    x, y, width, height = crop or (0, 0, *size)
    asked = Asked(settings.motion_segments, settings.motion_error, moment=settings.aov_time)
    exposure = expose(scene, 1.0, size[0] / size[1], asked, height=size[1])
    paths = paths_of(exposure, *size, attributes=False)
    delicate = np.zeros(width * height, dtype=bool)
    for offset in fixed_pattern(settings.samples).astype(np.float64):
        grid = Grid(x, y, width, height, tuple(offset))
        found = limited(
            triangulated.intervals(paths, grid, settings.pairing), settings.max_intervals
        )
        found = concatenate([found, static_intervals(paths, grid)])
        delicate |= delicate_samples(found, settings.occlusion, grid.count)
    film = mb.render(scene, width=size[0], height=size[1], settings=settings, crop=crop)
    truth = twin(exposure, size, settings, crop)
    return Comparison(film, truth, delicate.reshape(height, width))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def case_of(name: str, seed: int) -> tuple[Scene, mb.Settings]:
    case = CASES[name]
    meshes = case.meshes(np.random.default_rng(seed))
    scene = Scene(meshes=meshes, camera=case.camera, lights=LIGHTS, background=case.background)
    fixed = {"paths": "triangulated", "occlusion": 128, "samples": 1, "pattern": "fixed"}
    return scene, mb.Settings(**(fixed | case.settings))


def cut_within_a_bit(settings: mb.Settings) -> float:
    """Part by which averages may differ where surfaces cross.

    Intervals are cut there, in the middle of a bit: the kernels average depth and colour over the
    pieces up to the cut, the twin up to the bit's edge.
    """
    return 0.5 / settings.occlusion


LAYERED = ("vertex colour", "texture", "four samples", "phong", "lit", "static,", "static behind")
"""Beginnings of the names of cases in which nothing crosses."""


def assert_agreement(found: Comparison, settings: mb.Settings, depth: float = 1e-5) -> None:
    """RMSE 1e-4 over all; 1e-6 where no bit can have flipped, and a few bits where it can."""
    limit = 1e-6
    sure = found.error[~found.delicate]
    assert rms(found.error) < 1e-4
    assert rms(sure) < limit
    assert np.abs(sure).max() < 10 * limit
    assert found.delicate.mean() < 0.05 * settings.samples
    assert np.abs(found.error).max() < 3 / settings.occlusion
    steady = ~found.delicate & np.isfinite(found.truth.depth)
    assert found.film.depth[steady] == pytest.approx(found.truth.depth[steady], rel=depth)
    assert np.array_equal(np.isinf(found.film.depth)[~found.delicate], ~steady[~found.delicate])
    if settings.max_intervals is None:
        assert np.mean(found.film.intervals != found.truth.intervals) < 1e-3


PARTS = ("vertex colour", "texture", "five samples")
"""Of what all together have too, for the night alone."""


@pytest.mark.parametrize("seed", [1, nightly(2)])
@pytest.mark.parametrize("name", [nightly(name) if name in PARTS else name for name in CASES])
def test_random_scenes_agree_with_the_twin(name, seed):
    scene, settings = case_of(name, seed)
    depth = 1e-5 if name.startswith(LAYERED) else cut_within_a_bit(settings)
    assert_agreement(compare(scene, SIZE, settings), settings, depth)


@pytest.mark.parametrize("seed", [1, nightly(2)])
def test_everything_at_once_agrees_but_for_how_spans_end_where_surfaces_cross(seed):
    scene = Scene(
        meshes=everything(np.random.default_rng(seed)),
        camera=MOVING_CAMERA, lights=LIGHTS, background=(0.1, 0.2, 0.3),
    )  # fmt: skip
    settings = mb.Settings(paths="triangulated", occlusion=128, samples=2, pattern="fixed")
    found = compare(scene, SIZE, settings)
    assert rms(found.error) < 0.2 * cut_within_a_bit(settings)
    assert np.abs(found.error[..., 3][~found.delicate]).max() < 1e-6
    assert np.mean(found.film.intervals != found.truth.intervals) < 1e-3


@pytest.mark.parametrize(
    "name", ["two-sided", "phong", nightly("vertex colour"), nightly("texture")]
)
def test_a_shutter_shifted_by_a_hundredth_or_colour_scaled_by_one_percent_is_rejected(name):
    scene, settings = case_of(name, 1)
    found = compare(scene, SIZE, settings)
    shifted = twin(late(expose(scene, 1.0, 1.5), 0.01), SIZE, settings)
    for image in (shifted.rgba, 1.01 * found.truth.rgba):
        wrong = replace(found, truth=replace(found.truth, rgba=image))
        assert rms(wrong.error) > 1e-3
        with pytest.raises(AssertionError):
            assert_agreement(wrong, settings)


def test_far_from_the_origin_the_picture_is_the_same():
    place = np.array([148376.0, 1234.0, -223423.0])
    scene, settings = case_of("two-sided", 3)
    mesh = scene.meshes[0]
    grid = np.round(mesh.positions * 2**20) / 2**20  # adding ``place`` rounds nothing
    meshes = [replace(mesh, positions=grid + shift) for shift in (0, place)]
    cameras = [UNIT_CAMERA, replace(UNIT_CAMERA, position=tuple(place))]
    films = [
        mb.render(replace(scene, meshes=[m], camera=c), width=48, height=32, settings=settings)
        for m, c in zip(meshes, cameras, strict=True)
    ]
    assert np.array_equal(films[0].rgba, films[1].rgba)
    assert np.array_equal(films[0].depth, films[1].depth)


@pytest.mark.parametrize("name", CROPS)
def test_crops_of_the_benchmark_agree_with_the_twin(name, shared_file):
    scene, width, height = read_benchmark(shared_file(f"benchmark/{name}.npz"))
    settings = mb.Settings(paths="triangulated", occlusion=128, samples=1)
    found = compare(scene, (width, height), settings, CROPS[name])
    assert rms(found.error) < 1e-4
    assert rms(found.error[~found.delicate]) < 1e-6
    assert np.abs(found.error).max() < 3 / 128
    assert found.film.intervals.mean() > 3
