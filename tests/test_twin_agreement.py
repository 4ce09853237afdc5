"""Films of triangulated paths against the float64 twin: on random scenes, and on the benchmark.

What is left is rounding. It changes a pixel by more than that only where it moves the end of an
interval, or a change of depth order, over a bit's centre; the twin says which pixels those are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import chain

import numpy as np
import pytest
from closed_forms import UNIT_CAMERA, world
from nightly import nightly
from reference import triangulated
from reference.hits import static_intervals
from reference.paths import Intervals, concatenate, paths_of
from reference.render import Crop, Image, render
from reference.samples import Grid, expand
from reference.visibility import limited

import mbinterval as mb
from mbinterval.exposure.exposure import Exposure, expose
from mbinterval.plan.sampling import fixed_pattern
from mbinterval.scene.formats.meshes.benchmark import read_benchmark
from mbinterval.scene.model import Camera, Light, Material, Mesh, Scene, Texture
from mbinterval.scene.tracks import Track

SIZE = (48, 32)
TIME_ERROR = 4e-6
"""Of the shutter; the greatest that the stage's own test meets is half of it."""

LIGHTS = (
    Light("ambient", intensity=0.2),
    Light("directional", color=(1, 0.8, 0.6), direction=(0.4, -0.5, -1)),
    Light("point", intensity=2.0, position=(0.5, 0.5, 0.0)),
)


@dataclass(frozen=True)
class Case:
    """A scene made by ``meshes(rng)``, and how it is rendered."""

    meshes: Callable[[np.random.Generator], list[Mesh]]
    settings: dict[str, object] = field(default_factory=dict)
    camera: Camera = UNIT_CAMERA
    background: object = (0.18, 0.1, 0.3)


def corners(
    rng: np.random.Generator, count: int, times: int, near: float, layers: range | None
) -> np.ndarray:
    """World positions ``(times, 3 count, 3)`` of triangles that deform as they move.

    With ``layers`` each keeps to a range of depths of its own: nothing passes through anything.
    """
    middle = rng.uniform((-4, -4), (SIZE[0] + 4, SIZE[1] + 4), (times, count, 1, 2))
    pixels = middle + rng.normal(0, 7, (1, count, 3, 2)) + rng.normal(0, 2, (times, count, 3, 2))
    w = rng.uniform(near, 4.0, (1, count, 1)) + rng.uniform(-0.3, 0.3, (times, count, 3))
    if layers is not None:
        place = rng.permutation(len(layers))[:count, None] + layers[0]
        w = 1.0 + 0.05 * place + 0.045 * rng.uniform(0, 1, (times, count, 3))
    return world(pixels, w, SIZE).reshape(times, -1, 3)


def triangles(
    rng: np.random.Generator,
    count: int = 40,
    times: int = 2,
    near: float = 1.0,
    layers: range | None = None,
    **fields: object,
) -> Mesh:
    """Separate triangles; one per-face colour each unless ``fields`` say otherwise."""
    positions = corners(rng, count, times, near, layers)
    if not {"color", "material"} & fields.keys():
        fields |= {"color": rng.uniform(0, 1, (count, 3)), "color_domain": "face"}
    if "material" not in fields:
        fields["shading"] = "unlit"
    return Mesh(
        positions=positions[0] if times == 1 else positions,
        faces=np.arange(3 * count).reshape(-1, 3),
        **fields,
    )


def single(rng: np.random.Generator) -> list[Mesh]:
    material = Material(shading="unlit", double_sided=False)
    color = rng.uniform(0, 1, (60, 3))
    return [triangles(rng, 60, material=material, color=color, color_domain="face")]


def apart(index: int, crossing: bool) -> range | None:
    """Depths of the mesh ``index`` of 20 triangles, unless they may cross."""
    return None if crossing else range(20 * index, 20 * index + 20)


def vertex_colored(rng: np.random.Generator, crossing: bool = False) -> list[Mesh]:
    fixed, changing = rng.uniform(0, 1, (60, 3)), rng.uniform(0, 1, (2, 60, 3))
    return [
        triangles(
            rng, 20, color=color, color_domain="vertex", material=Material(shading="unlit"),
            layers=apart(index, crossing),
        )
        for index, color in enumerate((fixed, changing))
    ]  # fmt: skip


def textured(rng: np.random.Generator, crossing: bool = False) -> list[Mesh]:
    meshes = []
    for index, (wrap, uv) in enumerate(
        (
            ("repeat", rng.uniform(-1, 2, (60, 2))),
            ("mirror", rng.uniform(-1, 2, (2, 60, 2))),
            ("clamp", rng.uniform(-1, 2, (60, 2))),
        )
    ):
        image = rng.uniform(0, 1, (16, 24, 3))
        material = Material(
            wrap, texture=Texture(image, wrap=wrap), shading="unlit", base_color=(1, 0.5, 0.8)
        )
        meshes.append(triangles(rng, 20, material=material, uv=uv, layers=apart(index, crossing)))
    return meshes


def lit(rng: np.random.Generator, crossing: bool = False) -> list[Mesh]:
    normals = rng.normal(size=(2, 60, 3))
    glossy = Material("glossy", specular=(0.5, 0.4, 0.3), shininess=8.0)
    one_sided = Material("one", double_sided=False, base_color=(0.3, 0.9, 0.4))
    return [
        triangles(rng, 20, material=material, normals=normal, layers=apart(index, crossing))
        for index, (material, normal) in enumerate(
            ((glossy, None), (glossy, normals[0]), (one_sided, normals))
        )
    ]


def everything(rng: np.random.Generator) -> list[Mesh]:
    shaded = [part(rng, crossing=True) for part in (vertex_colored, textured, lit)]
    return [*single(rng), *chain(*shaded), triangles(rng, 20, 1)]


def resting(mesh: Mesh) -> Mesh:
    uv = None if mesh.uv is None else mesh.uv.reshape(-1, 60, 2)[0]
    return Mesh(positions=mesh.positions[0], faces=mesh.faces, material=mesh.material, uv=uv)


WALK = Track([0.75, 1.25], [[0.0, 0, 0], [0.3, -0.2, 0.25]])
TURN = Track([0.75, 1.25], [[0.2, 0.1, -3], [-0.4, 0.2, -3]])
MOVING_CAMERA = Camera(position=WALK, look_at=TURN, focal_length=24.0)

CASES = {
    "two-sided": Case(lambda rng: [triangles(rng)]),
    "single-sided": Case(single),
    "vertex colour": Case(vertex_colored),
    "texture": Case(textured),
    "four samples of a span": Case(textured, {"texture_samples": 4}),
    "phong": Case(lit),
    "static and moving": Case(lambda rng: [triangles(rng, 30), triangles(rng, 30, 1, near=2.0)]),
    "static": Case(lambda rng: [triangles(rng, 60, 1)]),
    "static, all effects": Case(lambda rng: [resting(m) for m in [*textured(rng), *lit(rng)]]),
    "moving camera": Case(
        lambda rng: [triangles(rng), triangles(rng, 30, 1)], camera=MOVING_CAMERA
    ),
    "lit, moving camera": Case(lit, camera=Camera(position=WALK, focal_length=24.0)),
    "near and behind the eye": Case(lambda rng: [triangles(rng, 60, near=-1.0)]),
    "static behind the eye": Case(lambda rng: [triangles(rng, 80, 1, near=-1.0)]),
    "three motion segments": Case(lambda rng: [triangles(rng, 30, 4)]),
    "three segments of linear motion": Case(
        lambda rng: [triangles(rng, 30)], {"motion_segments": 3}, MOVING_CAMERA
    ),
    "paired by depth": Case(lambda rng: [triangles(rng)], {"pairing": "depth"}),
    "at most six intervals": Case(lambda rng: [triangles(rng, 80)], {"max_intervals": 6}),
    "32 bits": Case(lambda rng: [triangles(rng)], {"occlusion": 32}),
    "256 bits": Case(lambda rng: [triangles(rng)], {"occlusion": 256}),
    "five samples": Case(lambda rng: [triangles(rng), triangles(rng, 10, 1)], {"samples": 5}),
    "background image": Case(
        lambda rng: [triangles(rng, 15)],
        background=np.random.default_rng(9).uniform(0, 1, (*SIZE[::-1], 3)),
    ),
}


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
    counts = settings.motion_segments, 1, settings.motion_error, size[1]
    exposure = expose(scene, 1.0, size[0] / size[1], *counts)
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


def late(exposure: Exposure, part: float) -> Exposure:
    """The same exposure, its shutter moved by ``part`` of its length."""
    meshes = []
    for mesh in exposure.meshes:
        step = part * (mesh.positions[-1] - mesh.positions[0])
        meshes.append(replace(mesh, positions=mesh.positions + step))
    return replace(exposure, meshes=tuple(meshes))


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


CROPS = {
    "cubes1000": (480, 360, 48, 32),
    "cubes2000": (500, 400, 32, 24),
    "wheel": (360, 300, 48, 32),
    "sphere82k": (400, 300, 24, 12),
}
"""Crops over dense and fast parts of the scenes that errors are quoted against."""


@pytest.mark.parametrize("name", CROPS)
def test_crops_of_the_benchmark_agree_with_the_twin(name, shared_file):
    scene, width, height = read_benchmark(shared_file(f"benchmark/{name}.npz"))
    settings = mb.Settings(paths="triangulated", occlusion=128, samples=1)
    found = compare(scene, (width, height), settings, CROPS[name])
    assert rms(found.error) < 1e-4
    assert rms(found.error[~found.delicate]) < 1e-6
    assert np.abs(found.error).max() < 3 / 128
    assert found.film.intervals.mean() > 3
