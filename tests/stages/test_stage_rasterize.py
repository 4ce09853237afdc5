"""Stage "rasterize": the fragments of every path on every sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from reference import triangulated
from reference.paths import make_paths
from reference.samples import Grid
from support.kernels import options, paths_of_points, run, shapes_of, slots_at
from support.random_paths import KINDS, SIZE, deforming

from mbinterval.device import records

OFFSETS = np.array([[0.5, 0.5], [0.03125, 0.96875]])
COUNT = 60


@dataclass(frozen=True, eq=False)
class Found:
    """Fragments by key ``(path, layer, row, column)`` as one number, sorted by it and by time."""

    key: np.ndarray
    t: np.ndarray
    w: np.ndarray

    def counts(self, keys: int) -> np.ndarray:
        return np.bincount(self.key, minlength=keys)

    def covered_time(self, keys: int) -> np.ndarray:
        """Paired in order of time: the sum of every second fragment less that of the others."""
        first = np.flatnonzero(np.diff(self.key, prepend=-1))
        place = np.arange(len(self.key)) - np.repeat(first, np.diff(first, append=len(self.key)))
        return np.bincount(self.key, np.where(place % 2, self.t, -self.t), minlength=keys)


def sorted_found(key: np.ndarray, t: np.ndarray, w: np.ndarray) -> Found:
    order = np.lexsort((w, t, key))
    return Found(key[order], t[order].astype(np.float64), w[order].astype(np.float64))


def listed(fragments: np.ndarray, heads: np.ndarray) -> np.ndarray:
    """Sample of every fragment, by following the lists of all samples at once."""
    owner = np.full(len(fragments), -1)
    node, sample = heads.ravel().copy(), np.arange(heads.size)
    while len(node):
        sample, node = sample[node >= 0], node[node >= 0]
        assert np.all(owner[node] == -1)  # no node is in two lists, or twice in one
        owner[node] = sample
        node = fragments["next"][node]
    return owner


def rasterized(
    points: np.ndarray, offsets: np.ndarray = OFFSETS, tile: int = 16, size: tuple[int, int] = SIZE
) -> Found:
    vertices, paths = paths_of_points(points)
    shapes = shapes_of(vertices, paths)
    members = np.arange(len(paths), dtype=np.uint32)
    capacity, layers, parts = 1 << 18, len(offsets), []
    defines = options(TILE=tile, LAYERS=layers)
    for y in range(0, size[1], tile):
        for x in range(0, size[0], tile):
            arrays = [
                vertices, paths, shapes, slots_at(offsets), members,
                np.uint32(len(members)), *np.int32([x, y]), np.uint32(capacity),
                np.zeros(capacity, records.FRAGMENT), np.zeros((layers, tile, tile), np.int32),
                np.zeros(2, np.uint32),
            ]  # fmt: skip
            *_, fragments, heads, (done, count) = run(
                "rasterize.cl", "rasterize_tile", arrays, defines
            )
            assert done
            fragments = fragments[:count]
            layer, row, column = np.unravel_index(listed(fragments, heads), heads.shape)
            row, column = row + y, column + x
            inside = (row < size[1]) & (column < size[0])
            path = fragments["part"] >> records.PART_BITS
            key = ((path * layers + layer) * size[1] + row) * size[0] + column
            parts.append([v[inside] for v in (key, fragments["t"], fragments["w"])])
    return sorted_found(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def twin(points: np.ndarray, offsets: np.ndarray = OFFSETS) -> Found:
    paths = make_paths(points)
    surface, parts = triangulated.surface(paths), []
    for layer, offset in enumerate(offsets):
        grid = Grid(0, 0, *SIZE, tuple(offset))
        found = triangulated.fragments(surface, grid)
        key = (found.path * len(offsets) + layer) * grid.count + found.sample
        parts.append((key, found.tau, found.w))
    return sorted_found(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def random_points(kind: str) -> np.ndarray:
    return KINDS[kind](np.random.default_rng(2 + len(kind)), COUNT)


def moved(points: np.ndarray, part: float) -> np.ndarray:
    """The same paths with their shutter moved by ``part`` of its length."""
    return points + part * (points[:, 1:] - points[:, :1])


KEYS = COUNT * len(OFFSETS) * SIZE[0] * SIZE[1]


@pytest.mark.parametrize("tile", [8, 16, 32])
@pytest.mark.parametrize("kind", KINDS)
def test_fragments_have_the_times_and_depths_of_the_twin(kind, tile):
    points = random_points(kind)
    found, truth = rasterized(points, tile=tile), twin(points)
    ours, theirs = found.counts(KEYS), truth.counts(KEYS)
    differ = ours != theirs
    # Where rounding moves a sample over the outline, a pair of equal fragments comes or goes.
    assert differ.sum() <= 1e-4 * np.count_nonzero(theirs)
    both = ~differ & (theirs > 0)
    a, b = (Found(f.key[both[f.key]], f.t[both[f.key]], f.w[both[f.key]]) for f in (found, truth))
    assert len(a.key) > 1000
    time, depth = np.abs(a.t - b.t), np.abs(a.w / b.w - 1.0)
    assert time.max() < 1e-5
    assert np.sqrt(np.mean(time**2)) < 2e-7
    # Two fragments at all but the same time may be told apart in the wrong order.
    assert np.quantile(depth, 0.999) < 1e-5
    assert np.abs(found.covered_time(KEYS) - truth.covered_time(KEYS))[differ].sum() < 1e-4
    late = twin(moved(points, 0.01))
    assert np.abs(found.covered_time(KEYS) - late.covered_time(KEYS)).max() > 5e-3


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "behind the eye"])
def test_a_path_before_the_eye_has_an_even_number_of_fragments_on_every_sample(kind):
    found = rasterized(random_points(kind))
    assert not np.any(found.counts(KEYS) % 2)
    assert np.any(found.counts(KEYS) >= 4) or kind in ("translated", "small and fast")


def sheet(size: int, rng: np.random.Generator | None = None, cell: float = 1.0) -> np.ndarray:
    """Triangles ``(2 size**2, 2, 3, 3)`` of a sheet of square cells around the frame's middle.

    Without ``rng`` it rests with its vertices on multiples of ``cell``; with it, vertices move.
    """
    x, y = np.meshgrid(np.arange(size + 1.0), np.arange(size + 1.0), indexing="ij")
    screen = np.stack([x, y], -1) * cell
    w = np.ones((2, size + 1, size + 1))
    ends = np.stack([screen, screen])
    if rng is not None:
        w = rng.uniform(0.9, 1.1, w.shape)
        ends = ends + rng.uniform(-0.3, 0.3, ends.shape) * cell
    points = np.concatenate([ends * w[..., None], w[..., None]], axis=-1)
    a, b = points[:, :-1, :-1], points[:, 1:, :-1]
    c, d = points[:, 1:, 1:], points[:, :-1, 1:]
    faces = [np.stack(v, axis=3).reshape(2, -1, 3, 3) for v in ((a, b, c), (a, c, d))]
    return np.concatenate(faces, axis=1).swapaxes(0, 1)


def covered_times(points: np.ndarray, offset: tuple[float, float], size: int) -> np.ndarray:
    """Covered time by path and sample: ``(P, size, size)``."""
    found = rasterized(points, np.array([offset]), size=(size, size))
    keys = len(points) * size * size
    assert not np.any(found.counts(keys) % 2)
    return found.covered_time(keys).reshape(len(points), size, size)


@pytest.mark.parametrize("offset", [(0.0, 0.0), (0.5, 0.0), (0.5, 0.5), (0.0, 0.25)])
@pytest.mark.parametrize("speed", [(0, 0), (3, 0), (0, -2), (2, 2), (-1, 3)])
def test_samples_on_edges_and_vertices_of_a_sheet_are_covered_exactly_once(offset, speed):
    """Every sample lies on a vertex, an edge or a diagonal, at many of the times."""
    points = sheet(14)
    points[:, 1, :, :2] += speed
    time = covered_times(points, offset, 16)[:, 4:10, 4:10]
    assert time.min() >= 0
    assert time.sum(axis=0) == pytest.approx(np.ones((6, 6)), abs=1e-6)
    if speed == (0, 0):
        assert set(np.unique(time)) == {0.0, 1.0}
    else:
        assert np.count_nonzero(time, axis=0).min() > 1


@pytest.mark.parametrize("seed", range(4))
def test_a_deforming_sheet_has_no_gap_and_no_double_cover(seed):
    points = sheet(8, np.random.default_rng(seed), cell=2.0)
    flags = shapes_of(*paths_of_points(points))["flags"]
    assert np.any(flags // 4 & 7)  # some sides are crossed
    time = covered_times(points, (0.5, 0.5), 16)[:, 3:13, 3:13].sum(axis=0)
    assert time == pytest.approx(np.ones((10, 10)), abs=2e-6)
    holed = covered_times(np.delete(points, 27, axis=0), (0.5, 0.5), 16)[:, 3:13, 3:13].sum(axis=0)
    assert holed.min() < 0.9


def test_a_full_pool_is_reported_and_nothing_is_written_beyond_it():
    vertices, paths = paths_of_points(deforming(np.random.default_rng(6), COUNT))
    shapes = shapes_of(vertices, paths)
    pool = np.zeros(300, records.FRAGMENT)
    pool["part"] = 12345
    arrays = [
        vertices, paths, shapes, slots_at(OFFSETS), np.arange(COUNT, dtype=np.uint32),
        np.uint32(COUNT), *np.int32([0, 0]), np.uint32(200), pool,
        np.zeros((2, 16, 16), np.int32), np.zeros(2, np.uint32),
    ]  # fmt: skip
    defines = options(LAYERS=2)
    *_, fragments, _, (done, count) = run("rasterize.cl", "rasterize_tile", arrays, defines)
    assert (done, count) == (0, 200)
    assert np.all(fragments["part"][200:] == 12345)
