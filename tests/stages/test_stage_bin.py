"""Stages "bin" and the walk: no path is lost, and what is walked is mostly hit."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from reference import exact, triangulated
from reference.paths import Paths, make_paths, paths_of
from reference.samples import Grid
from support.kernels import members_of, options, paths_of_points, run, shapes_of, slots_at
from support.random_paths import KINDS, SIZE

import mbinterval as mb
from mbinterval.device import records
from mbinterval.device.runtime import Runtime
from mbinterval.errors import CapacityError
from mbinterval.exposure.exposure import expose
from mbinterval.scene.model import Camera, Mesh, Scene

OFFSETS = np.array([[0.5, 0.5], [0.03125, 0.96875], [0.96875, 0.25]])


def random_points(kind: str, count: int = 60) -> np.ndarray:
    return KINDS[kind](np.random.default_rng(1 + len(kind)), count)


def hits(paths: Paths, offset: np.ndarray, size: tuple[int, int] = SIZE) -> np.ndarray:
    """Whether a path ``(P, H, W)`` is hit by any sample, by either kind of path."""
    grid = Grid(0, 0, *size, tuple(offset))
    covered = np.zeros((len(paths), grid.count), dtype=bool)
    shape = triangulated.surface(paths)
    for found in (triangulated.fragments(shape, grid), exact.intervals(paths, grid)):
        covered[found.path, found.sample] = True
    return covered.reshape(len(paths), size[1], size[0])


@lru_cache
def hits_of(kind: str) -> np.ndarray:
    """``(offsets, P, H, W)`` for the random paths of one kind."""
    paths = make_paths(random_points(kind))
    return np.stack([hits(paths, offset) for offset in OFFSETS])


def tiles_of(covered: np.ndarray, tile: int) -> np.ndarray:
    """Whether a path touches a tile: ``(P, tiles)``, row by row of tiles."""
    count, height, width = covered.shape
    rows, columns = -(-height // tile), -(-width // tile)
    padded = np.zeros((count, rows * tile, columns * tile), dtype=bool)
    padded[:, :height, :width] = covered
    blocks = padded.reshape(count, rows, tile, columns, tile)
    return blocks.any(axis=(2, 4)).reshape(count, -1)


@pytest.mark.parametrize("tile", [8, 16, 32])
@pytest.mark.parametrize("kind", KINDS)
def test_every_tile_gets_all_paths_that_touch_it_in_order(kind, tile):
    points = random_points(kind)
    members = members_of(shapes_of(*paths_of_points(points)), SIZE, tile, chunk=7)
    touched = tiles_of(hits_of(kind).any(axis=0), tile)
    filed = np.zeros_like(touched)
    for index, member in enumerate(members):
        assert np.all(np.diff(member.astype(np.int64)) > 0)
        filed[member, index] = True
    assert not np.any(touched & ~filed)
    assert touched.sum() > 80
    # Not by filing everything everywhere.
    if kind != "behind the eye":
        assert filed.sum() < 1.5 * touched.sum()


@pytest.mark.parametrize("chunk", [1, 13, 1000])
def test_members_do_not_depend_on_how_paths_are_shared_out(chunk):
    shapes = shapes_of(*paths_of_points(random_points("deforming")))
    want, got = members_of(shapes, SIZE, chunk=64), members_of(shapes, SIZE, chunk=chunk)
    assert all(np.array_equal(a, b) for a, b in zip(want, got, strict=True))


def test_members_come_in_the_order_that_is_given():
    shapes = shapes_of(*paths_of_points(random_points("deforming")))
    order = np.random.default_rng(2).permutation(len(shapes))
    place = np.argsort(order)
    for plain, ordered in zip(
        members_of(shapes, SIZE), members_of(shapes, SIZE, chunk=7, order=order), strict=True
    ):
        assert np.all(np.diff(place[ordered]) > 0)
        assert np.array_equal(np.sort(ordered), plain)


def test_culled_paths_are_filed_nowhere():
    points = random_points("deforming")
    points[3] *= -1.0
    members = members_of(shapes_of(*paths_of_points(points)), SIZE)
    assert not any(3 in member for member in members)


def walked(
    shapes: np.ndarray, slots: np.ndarray, tile: int, size: tuple[int, int] = SIZE
) -> np.ndarray:
    """Whether the walk visits a sample: ``(P, layers, H, W)``."""
    columns, rows, layers = -(-size[0] // tile), -(-size[1] // tile), len(slots)
    shape = (columns * rows, len(shapes), layers, tile)
    arrays = [
        shapes, np.uint32(len(shapes)), slots, *np.int32([columns, rows]),
        *np.int32(size), np.zeros(shape, np.int32), np.full(shape, -1, np.int32),
    ]  # fmt: skip
    defines = options(TILE=tile, LAYERS=layers)
    *_, first, last = run("walk.cl", "walk", arrays, defines)
    column = np.arange(tile)
    inside = (first[..., None] <= column) & (column <= last[..., None])
    inside = inside.reshape(rows, columns, len(shapes), layers, tile, tile)
    whole = inside.transpose(2, 3, 0, 4, 1, 5).reshape(len(shapes), layers, rows * tile, -1)
    assert not whole[:, :, size[1] :].any()
    assert not whole[:, :, :, size[0] :].any()
    return whole[:, :, : size[1], : size[0]]


@pytest.mark.parametrize("tile", [8, 16, 32])
@pytest.mark.parametrize("kind", KINDS)
def test_the_walk_visits_every_sample_that_is_hit(kind, tile):
    points = random_points(kind)
    visited = walked(shapes_of(*paths_of_points(points)), slots_at(OFFSETS), tile)
    covered = hits_of(kind)
    assert covered.sum() > 1000
    assert not np.any(covered.swapaxes(0, 1) & ~visited)


@pytest.mark.parametrize("kind", KINDS)
def test_the_walk_visits_a_pixel_when_any_place_of_its_slot_is_hit(kind):
    """Samples that lie differently in every pixel: all places from a slot's low to its high end."""
    shapes = shapes_of(*paths_of_points(random_points(kind)))
    slots = slots_at(OFFSETS.min(axis=0)[None], OFFSETS.max(axis=0)[None])
    visited, covered = walked(shapes, slots, 16)[:, 0], hits_of(kind).any(axis=0)
    assert not np.any(covered & ~visited)
    for index in range(len(OFFSETS)):
        assert visited.sum() > walked(shapes, slots_at(OFFSETS[index : index + 1]), 16).sum()


def test_a_walk_with_planes_moved_inwards_is_caught_losing_samples():
    points = random_points("translated")
    shapes = shapes_of(*paths_of_points(points))
    shapes["c"] -= 0.3
    visited = walked(shapes, slots_at(OFFSETS), 16)
    assert np.any(hits_of("translated").swapaxes(0, 1) & ~visited)


def sphere(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a unit sphere of ``4 count**2`` triangles: latitudes and longitudes."""
    theta, phi = np.meshgrid(
        np.linspace(1e-3, np.pi - 1e-3, count + 1), np.linspace(0, 2 * np.pi, 2 * count + 1),
        indexing="ij",
    )  # fmt: skip
    points = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], -1)
    index = np.arange(theta.size).reshape(theta.shape)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack(v, -1).reshape(-1, 3) for v in ((a, b, c), (a, c, d))])
    return points.reshape(-1, 3), faces


def test_at_least_half_of_the_samples_walked_on_a_fast_dense_sphere_are_hits():
    """Triangles below a pixel that move 200 px, as those of the benchmark's sphere do."""
    size = (320, 160)
    points, faces = sphere(128)
    turn = 0.5
    rotation = np.array(
        [[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]]
    )
    ends = np.stack([points + [-2.0, -0.3, 0], points @ rotation.T + [2.0, 0.3, 0]])
    chosen = faces[np.random.default_rng(3).choice(len(faces), 300, replace=False)]
    mesh = Mesh(positions=ends, faces=chosen, shading="unlit")
    scene = Scene(meshes=[mesh], camera=Camera(position=(0.0, 0.0, 7.0), fov=40.0))
    paths = paths_of(expose(scene, 1.0, size[0] / size[1]), *size)
    screen = paths.points[..., :2] / paths.points[..., 2:]
    assert np.median(np.ptp(screen[:, 0], axis=1).max(axis=1)) < 1.0
    assert np.median(np.linalg.norm(screen[:, 1] - screen[:, 0], axis=-1)) > 100.0
    shapes = shapes_of(*paths_of_points(paths.points))
    visited = walked(shapes, slots_at(OFFSETS[:1]), 16, size)[:, 0]
    grid = Grid(0, 0, *size)
    found = exact.intervals(paths, grid)
    covered = np.zeros((len(paths), grid.count), dtype=bool)
    covered[found.path, found.sample] = True
    hit = covered.reshape(visited.shape)
    assert not np.any(hit & ~visited)
    assert hit.sum() > 10000
    assert hit.sum() > 0.5 * visited.sum()
    filed = members_of(shapes, size, 8)
    assert hit.sum() < 0.1 * 64 * sum(map(len, filed))  # what whole tiles would have cost


@pytest.mark.parametrize(("counts", "total"), [((3, 4), 7), ((2**31, 2**31), None),
                                               ((2**32 - 1, 5), None)])  # fmt: skip
def test_more_entries_than_32_bits_hold_are_noticed(counts, total):
    scan = [np.uint32(2), np.uint32(1), np.array(counts, np.uint32), np.zeros(3, np.uint32)]
    _, starts = run("shared/scan.cl", "bin_scan", scan)
    assert starts[-1] == (records.NONE if total is None else total)


@pytest.mark.parametrize(("method", "remedy"), [("analytic", "tile_size"), ("stochastic", "crops")])
def test_what_bin_cannot_list_is_a_capacity_error(method, remedy, monkeypatch):
    download = Runtime.download

    def overflowing(self, buffer, shape, dtype):
        array = download(self, buffer, shape, dtype)
        if dtype is np.uint32 and len(shape) == 1:  # the tiles' starts
            array[-1] = records.NONE
        return array

    monkeypatch.setattr(Runtime, "download", overflowing)
    mesh = Mesh(positions=np.eye(3) - [0, 0, 3], faces=[[0, 1, 2]])
    with pytest.raises(CapacityError, match=rf"2\*\*32 paths or more; .*{remedy}$"):
        mb.render(Scene(meshes=[mesh]), width=8, height=8, settings=mb.Settings(method=method))
