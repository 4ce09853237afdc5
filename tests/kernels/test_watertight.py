"""Meshes that deform have no gaps and no double covers, in space and in time.

Every face is solved on every sample. A closed mesh seen from outside has as many fronts as backs
at any time; a sheet that does not fold has one face. Times are compared as they are stored, and
what is out of balance may last 4 units in the last place of 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import pytest
from support.kernels import one_material, options, run, vertices_of
from support.nightly import nightly

import mbinterval as mb
from mbinterval.device import records
from mbinterval.exposure.exposure import expose
from mbinterval.layout.motion import lay_out
from mbinterval.scene.model import Camera, Mesh, Scene

ULPS = 4 * np.finfo(np.float32).eps
FAR = np.array([148376.0, 1234.0, -223423.0])
SIZE = (64, 64)
SEEDS = range(10)
FRONT, BACK = [0, 1, 2], [0, 2, 1]


@dataclass(frozen=True, eq=False)
class Sweep:
    """Faces ``(F, 3)`` into moving vertices ``(2, N, 3)``, homogeneous pixels; float64."""

    points: np.ndarray
    faces: np.ndarray


@dataclass(frozen=True, eq=False)
class Times:
    """Intervals ``t`` ``(I, 2)`` of faces on samples, sorted by sample and start."""

    sample: np.ndarray
    t: np.ndarray


def paths_of_faces(faces: np.ndarray, vertices: int, segments: int = 1) -> np.ndarray:
    """``Path`` records of faces; with several segments, each has the same motion."""
    paths = np.zeros((segments, len(faces)), records.PATH)
    for name, column in zip("abc", faces.T, strict=True):
        paths[name] = column
    paths["step"] = vertices
    ends = np.arange(segments + 1)[:, None] / segments
    paths["open"], paths["close"] = ends[:-1], ends[1:]
    return paths.ravel()


def solved(
    sweep: Sweep, samples: np.ndarray, corners: list[int], scalar: bool = False, segments: int = 1
) -> Times:
    """When the fronts of the faces, their corners in this order, cover each sample."""
    paths = paths_of_faces(sweep.faces[:, corners], sweep.points.shape[1], segments)
    vertices = vertices_of(sweep.points)
    single = records.MATERIAL_SINGLE_SIDED
    shapes = np.zeros(len(paths), records.SHAPE)
    depths = np.zeros(len(paths), records.DEPTH)
    arguments = [vertices, paths, np.uint32(len(paths)), *one_material(single), shapes, depths]
    items = -(-len(paths) // 256)
    shapes = run("analytic/paths.cl", "paths", arguments, ["-DMB_EXACT"], items)[-2]
    places = np.resize(samples.astype(np.float32), (-(-len(samples) // 8) * 8, 2))
    capacity = 64 * len(places) + 8 * len(paths)
    state = [np.zeros(len(places), kind) for kind in (np.int32, np.int32, np.uint32)]
    arguments = [
        vertices, paths, shapes, *one_material(single), np.uint32(len(paths)), places,
        np.uint32(len(places)), np.uint32(scalar), np.uint32(capacity),
        np.zeros(capacity, records.VISIT), *state, np.zeros(2, np.uint32),
    ]  # fmt: skip
    defines = ("-DMB_EXACT", "-DMB_MOVING", "-DMB_SINGLE_SIDED", *options())
    *_, visits, heads, _, _, (done, _) = run("solve.cl", "solve_all", arguments, defines)
    assert done
    sample, node = np.arange(len(samples)), heads[: len(samples)]
    parts = [(sample[:0], np.zeros((0, 2), np.float32))]
    while len(node):
        sample, node = sample[node >= 0], node[node >= 0]
        parts.append((sample, np.stack([visits["t0"][node], visits["t1"][node]], axis=1)))
        node = visits["next"][node]
    sample, t = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.lexsort((t[:, 0], sample))
    return Times(sample[order], t[order])


def longest(fronts: Times, backs: Times, more: int = 0) -> tuple[float, float]:
    """Greatest time, at one sample, in which fronts less backs are not ``more``, and all time.

    ``more`` is wanted throughout [0, 1] on every sample that any face covers.
    """
    samples = np.unique(np.concatenate([fronts.sample, backs.sample]))
    sample = np.concatenate([np.repeat(fronts.sample, 2), np.repeat(backs.sample, 2),
                             samples, samples])  # fmt: skip
    ends = np.zeros(len(samples)), np.ones(len(samples))
    time = np.concatenate([fronts.t.ravel(), backs.t.ravel(), *ends]).astype(np.float64)
    step = np.concatenate([np.tile([1, -1], len(fronts.t)), np.tile([-1, 1], len(backs.t)),
                           np.full(len(samples), -more), np.full(len(samples), more)])  # fmt: skip
    order = np.lexsort((time, sample))
    sample, time, net = sample[order], time[order], np.cumsum(step[order])
    wrong = (net[:-1] != 0) & (sample[:-1] == sample[1:])
    length = np.where(wrong, np.diff(time), 0.0)
    total = float((fronts.t[:, 1] - fronts.t[:, 0]).astype(np.float64).sum())
    return float(np.bincount(sample[:-1], length).max(initial=0.0)), total


def tetrasphere(levels: int) -> tuple[np.ndarray, np.ndarray]:
    """A tetrahedron split ``levels`` times, on the unit sphere: 4 ** (levels + 1) faces."""
    vertices = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    faces = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    for _ in range(levels):
        pairs = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), 1)
        edges, place = np.unique(pairs, axis=0, return_inverse=True)
        ab, bc, ca = place.reshape(3, -1) + len(vertices)
        vertices = np.concatenate([vertices, vertices[edges].mean(axis=1)])
        a, b, c = faces.T
        quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = np.concatenate([np.stack(q, axis=1) for q in quarters])
    return vertices / np.linalg.norm(vertices, axis=1, keepdims=True), faces


def split_apart(sweep: Sweep) -> Sweep:
    """The same faces without a shared vertex, as a mesh without indices has them."""
    order = np.random.default_rng(0).permutation(sweep.faces.size)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    return Sweep(sweep.points[:, sweep.faces.ravel()[order]], place.reshape(-1, 3))


def seen(positions: np.ndarray, camera: Camera, faces: np.ndarray) -> Sweep:
    """World positions ``(2, N, 3)`` as stage "vertices" transforms them."""
    mesh = Mesh(positions=positions, faces=faces)
    exposure = expose(Scene(meshes=[mesh], camera=camera), 1.0, SIZE[0] / SIZE[1])
    motion = lay_out(exposure, *SIZE)
    table = np.zeros(motion.vertex_count, records.VERTEX)
    given = [motion.jobs, motion.positions, motion.cameras, table]
    table = run("shared/vertices.cl", "vertices", given, ["-DMB_EXACT"], len(motion.jobs))[-1]
    points = np.stack([table[name] for name in "xyw"], axis=1)
    return Sweep(points.reshape(2, -1, 3), faces)


def closed(seed: int, levels: int, place: np.ndarray, depth: float = 4.0) -> Sweep:
    """A sphere whose vertices move at random, by half its radius or by a few edges."""
    rng = np.random.default_rng([seed, levels])
    vertices, faces = tetrasphere(levels)
    reach = 0.5 if seed % 2 else 2.0 * 0.5**levels
    positions = vertices + rng.normal(0, reach, (2, *vertices.shape)).clip(-1.2, 1.2)
    positions[1] += rng.normal(0, 0.3, 3)
    camera = Camera(position=tuple(place + [0, 0, depth]), focal_length=24.0)
    sweep = seen(positions + place, camera, faces)
    return split_apart(sweep) if seed % 3 == 0 else sweep


def places_on(sweep: Sweep, rng: np.random.Generator, count: int) -> np.ndarray:
    """Random samples, and others on vertices and middles of edges at the ends of the shutter."""
    ends = sweep.points[rng.integers(0, 2, count), rng.integers(0, sweep.points.shape[1], count)]
    face = sweep.faces[rng.integers(0, len(sweep.faces), count)]
    a, b = (sweep.points[rng.integers(0, 2), face[:, k]] for k in (0, 1))
    on = np.concatenate([ends, 0.5 * (a + b)])
    return np.concatenate([on[:, :2] / on[:, 2:], rng.uniform((16, 16), (48, 48), (count, 2))])


@pytest.mark.parametrize(
    ("levels", "seed"),
    [case if case[0] < 7 or case[1] < 2 else nightly(*case) for case in product(range(8), SEEDS)],
)
def test_closed_meshes_have_as_much_front_as_back_at_any_time(levels, seed):
    place = FAR if seed % 2 else np.zeros(3)
    sweep = closed(seed, levels, place)
    assert len(sweep.faces) == 4 ** (levels + 1)
    assert np.all(sweep.points[..., 2] > 0)
    rng = np.random.default_rng(seed)
    samples = places_on(sweep, rng, max(8, min(300, 60000 // len(sweep.faces))))
    fronts, backs = (solved(sweep, samples, corners) for corners in (FRONT, BACK))
    worst, total = longest(fronts, backs)
    assert worst <= ULPS
    assert total > len(samples) / 20


@pytest.mark.parametrize("seed", SEEDS)
def test_sample_by_sample_and_in_vectors_the_bits_are_the_same(seed):
    sweep = closed(seed, 3, FAR)
    samples = places_on(sweep, np.random.default_rng(seed), 64)
    vectors, scalars = (solved(sweep, samples, FRONT, scalar) for scalar in (False, True))
    assert np.array_equal(vectors.sample, scalars.sample)
    assert np.array_equal(vectors.t, scalars.t)


@pytest.mark.parametrize("seed", SEEDS)
def test_closed_meshes_that_cross_the_camera_plane_have_as_much_front_as_back(seed):
    """The eye stays outside: beside a sphere that reaches from before to behind it."""
    rng = np.random.default_rng(seed)
    vertices, faces = tetrasphere(3)
    place = FAR if seed % 2 else np.zeros(3)
    positions = vertices + rng.normal(0, 0.1, (2, *vertices.shape)) + [1.8, 0, -0.5] + place
    sweep = seen(positions, Camera(position=tuple(place), fov=150.0), faces)
    assert np.any(sweep.points[..., 2] < 0)
    samples = rng.uniform((30, 0), (120, 64), (1000, 2))
    fronts, backs = (solved(sweep, samples, corners) for corners in (FRONT, BACK))
    worst, total = longest(fronts, backs)
    assert worst <= ULPS
    assert total > 100


def on_lattice(seed: int, levels: int) -> Sweep:
    """Vertices at whole pixels at both ends of the shutter, whose products are exact."""
    rng = np.random.default_rng(seed)
    vertices, faces = tetrasphere(levels)
    xy = np.rint(16 + 6 * vertices[:, :2] + rng.integers(-4, 5, (2, len(vertices), 2)))
    w = 2.0 ** rng.integers(0, 3, (2, len(vertices), 1))
    return Sweep(np.concatenate([xy * w, w], axis=2), faces)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("levels", [0, 1, 2, 3])
def test_samples_exactly_on_vertices_and_edges_count_once(levels, seed):
    sweep = on_lattice(seed, levels)
    x, y = np.meshgrid(np.arange(0, 33), np.arange(0, 33))
    samples = np.stack([x.ravel(), y.ravel()], axis=1)
    fronts, backs = (solved(sweep, samples, corners) for corners in (FRONT, BACK))
    worst, total = longest(fronts, backs)
    assert worst <= ULPS
    assert total > 10


def sheet(seed: int, cells: int, shift: float) -> Sweep:
    """A grid of squares over pixels [0, 64), each cut in two, deforming without a fold."""
    rng = np.random.default_rng(seed)
    line = np.linspace(-8, 72, cells + 1)
    step = line[1] - line[0]
    xy = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    xy = xy + rng.uniform(-0.24, 0.24, (2, *xy.shape)) * step
    xy[1] += shift
    # One depth at each end of the shutter: straight lines on screen stay straight.
    w = np.broadcast_to(np.array([2.0, 3.0])[:, None, None], (*xy.shape[:2], 1))
    corner = np.arange(cells * (cells + 1)).reshape(cells, -1)[:, :-1].ravel()
    right, low, across = corner + 1, corner + cells + 1, corner + cells + 2
    faces = np.concatenate([np.stack([corner, low, right], 1), np.stack([right, low, across], 1)])
    return Sweep(np.concatenate([xy * w, w], axis=2), faces)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_sheet_without_folds_covers_every_sample_exactly_once_in_a_chain_of_equal_bits(seed):
    sweep = sheet(seed, 40, 5.0)
    sweep = split_apart(sweep) if seed % 2 else sweep
    rng = np.random.default_rng(seed)
    samples = np.concatenate([rng.uniform(8, 56, (400, 2)), places_on(sweep, rng, 100)[:200]])
    samples = samples[((samples > 8) & (samples < 56)).all(axis=1)]
    fronts, backs = (solved(sweep, samples, corners) for corners in (FRONT, BACK))
    assert not len(backs.t)
    assert np.array_equal(np.unique(fronts.sample), np.arange(len(samples)))
    assert longest(fronts, backs, more=1)[0] <= ULPS
    follows = fronts.sample[1:] == fronts.sample[:-1]
    assert np.count_nonzero(follows) > 200
    random = follows & (fronts.sample[1:] < 300)
    assert np.array_equal(fronts.t[1:, 0][random], fronts.t[:-1, 1][random])


@pytest.mark.parametrize("seed", SEEDS)
def test_a_sheet_on_whole_pixels_covers_samples_on_its_vertices_once(seed):
    rng = np.random.default_rng(seed)
    sweep = sheet(seed, 10, 0.0)
    step = rng.integers(0, 3, 2)
    xy = np.stack(np.meshgrid(np.arange(11), np.arange(11)), -1).reshape(-1, 2) * 4.0
    ends = np.stack([xy, xy + step])
    w = np.broadcast_to([[[1.0]], [[2.0]]], (*ends.shape[:2], 1))
    sweep = Sweep(np.concatenate([ends * w, w], axis=2), sweep.faces)
    samples = np.stack(np.meshgrid(np.arange(4, 36), np.arange(4, 36)), -1).reshape(-1, 2)
    fronts, backs = (solved(sweep, samples, corners) for corners in (FRONT, BACK))
    assert not len(backs.t)
    assert len(np.unique(fronts.sample)) == len(samples)
    assert longest(fronts, backs, more=1)[0] <= ULPS


def test_a_moved_vertex_or_a_missing_face_is_noticed():
    sweep = closed(1, 3, FAR)
    samples = places_on(sweep, np.random.default_rng(1), 300)
    apart = split_apart(sweep)
    points = apart.points.copy()
    points[0, ::3, 0] += 1e-4 * points[0, ::3, 2]  # a ten-thousandth of a pixel
    for wrong in (Sweep(points, apart.faces), Sweep(sweep.points, sweep.faces[1:])):
        fronts, backs = (solved(wrong, samples, corners) for corners in (FRONT, BACK))
        assert longest(fronts, backs)[0] > 10 * ULPS


@pytest.mark.parametrize("segments", [2, 3, 7, 10, 41, 2947, 4096])
def test_a_motion_segment_ends_at_the_bits_at_which_the_next_begins(segments):
    sweep = sheet(0, 2, 0.0)
    still = Sweep(sweep.points[[0, 0]], sweep.faces[:1])
    sample = still.points[0, still.faces[0]].mean(axis=0)
    one = solved(still, sample[None, :2] / sample[2], FRONT, segments=segments).t
    assert np.array_equal(one.ravel()[1:-1:2], one.ravel()[2::2])
    assert (len(one), one[0, 0], one[-1, 1]) == (segments, 0.0, 1.0)


@pytest.mark.parametrize("segments", [1, 3, 7, 10])
@pytest.mark.parametrize("pattern", ["fixed", "sobol"])
def test_films_of_a_sheet_are_covered_all_over_for_all_the_time(pattern, segments):
    """Through all stages: bin, walk, solve, envelope, and the joints of motion segments."""
    camera = Camera(position=tuple(FAR + [0, 0, 2.0]), focal_length=24.0)
    rng = np.random.default_rng(segments)
    line = np.linspace(-1.2, 1.2, 31)
    x, y = (c.ravel() for c in np.meshgrid(line, line))
    flat = np.stack([x, -y, np.zeros_like(x)], axis=1)
    move = rng.uniform(-0.015, 0.015, (segments + 1, *flat.shape)) * [1, 1, 0]
    mesh = Mesh(positions=flat + move + FAR, faces=sheet(0, 30, 0).faces, shading="unlit")
    scene = Scene(meshes=[mesh], camera=camera)
    film = mb.render(scene, width=64, height=64, settings=mb.Settings(samples=4, pattern=pattern))
    alpha = film.rgba[..., 3].astype(np.float64)
    assert np.abs(alpha - 1.0).max() <= 2 * ULPS  # the sum of some hundred spans is rounded too
    less = Mesh(positions=mesh.positions, faces=mesh.faces[::2], shading="unlit")
    film = mb.render(Scene(meshes=[less], camera=camera), width=64, height=64)
    assert film.rgba[..., 3].min() < 0.9
