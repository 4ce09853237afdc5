"""The twin of triangulated paths against dense sampling, exact paths and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from support.closed_forms import (
    rectangle,
    scene,
    slab,
)

from mbinterval.exposure.exposure import expose
from mbinterval.scene.model import Material, Mesh
from reference import exact, triangulated
from reference.hits import barycentrics, static_intervals
from reference.paths import Intervals, make_paths, paths_of
from reference.render import render
from reference.samples import Grid, Points
from reference.visibility import exact as envelope
from reference.visibility import limited, masked

SIZE = (32, 16)


def exposed(meshes: list[Mesh], background: tuple[float, ...] = (0.0, 0.0, 0.0)):
    return expose(scene(meshes, background), 0, SIZE[0] / SIZE[1])


def random_points(rng: np.random.Generator, count: int, near: float = 0.5) -> np.ndarray:
    """Homogeneous points over a 32 x 16 image; ``near`` <= 0 puts some behind the eye."""
    w = rng.uniform(near, 3.0, (count, 2, 3))
    xy = rng.uniform((-8, -8), (40, 24), (count, 2, 3, 2))
    return np.concatenate([xy * w[..., None], w[..., None]], axis=-1)


def translated(rng: np.random.Generator, count: int) -> np.ndarray:
    points = random_points(rng, count)
    points[:, 1] = points[:, 0] + rng.uniform((-20, -20, -0.4), (20, 20, 2), (count, 1, 3))
    return points


def all_samples(grid: Grid) -> Points:
    return Points(np.stack(grid.positions(np.arange(grid.count)), axis=1))


def total_time(intervals: Intervals, shape: tuple[int, int]) -> np.ndarray:
    """Covered time by (path, sample)."""
    total = np.zeros(shape)
    np.add.at(total, (intervals.path, intervals.sample), np.diff(intervals.t, axis=1)[:, 0])
    return total


def test_a_counter_clockwise_triangle_has_negative_d_seen_from_its_front():
    corners = np.array([[0.0, 0, -2], [1, 0, -2], [0, 1, -2]])  # seen from +z, where the eye is
    mesh = Mesh(positions=corners[None].repeat(2, 0), faces=[[0, 1, 2]], motion_segments=1)
    moving = Mesh(positions=np.stack([corners, corners + np.array([0.1, 0, 0])]), faces=[[0, 1, 2]])
    for each in (mesh, moving):
        paths = paths_of(exposed([each]), *SIZE)
        assert np.all(triangulated.facing(paths, np.arange(1)) < 0)


def test_pixel_space_puts_right_to_the_right_and_up_above():
    mesh = Mesh(positions=[[0.0, 0, -2], [0.5, 0, -2], [0, 0.5, -2]], faces=[[0, 1, 2]])
    points = paths_of(exposed([mesh]), *SIZE).points[0, 0]
    assert points[:, 2] == pytest.approx(2.0)
    assert points[:, :2] / 2 == pytest.approx(np.array([[16, 8], [20, 8], [16, 4]]))


def test_grid_candidates_lose_nothing_even_behind_the_eye():
    rng = np.random.default_rng(1)
    paths = make_paths(random_points(rng, 150, near=-1.0))
    grid = Grid(0, 0, *SIZE)
    for method in (triangulated.intervals, exact.intervals):
        walked, brute = method(paths, grid), method(paths, all_samples(grid))
        assert len(walked) > 10000
        for name in ("sample", "path", "t"):
            assert np.array_equal(getattr(walked, name), getattr(brute, name))


def test_samples_on_edges_and_vertices_of_a_sheet_hit_exactly_one_triangle():
    x, y = np.meshgrid(np.arange(5.0), np.arange(5.0), indexing="ij")
    grid = np.stack([x, y, np.ones_like(x)], axis=-1)
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    sheet = np.concatenate([np.stack(v, -2).reshape(-1, 3, 3) for v in ((a, b, c), (a, c, d))])
    points = np.stack(np.meshgrid(np.arange(0.5, 4, 0.5), np.arange(0.5, 4, 0.5)), -1)
    sample = Points(points.reshape(-1, 2))
    item, index = sample.candidates(sheet)
    hit, _, _ = barycentrics(sheet[item], *sample.positions(index))
    assert np.array_equal(np.bincount(index[hit], minlength=sample.count), np.ones(sample.count))


def test_a_resting_path_covers_the_whole_segment_of_every_sample_it_holds():
    rng = np.random.default_rng(2)
    points = random_points(rng, 50)
    points[:, 1] = points[:, 0]
    paths, grid = make_paths(points), Grid(0, 0, *SIZE)
    found = triangulated.intervals(paths, grid)
    assert np.allclose(found.t, [0, 1], atol=1e-9)
    assert np.allclose(found.w[:, 0], found.w[:, 1])


def test_translation_has_exact_times_and_depths():
    rng = np.random.default_rng(3)
    paths, grid = make_paths(translated(rng, 200)), Grid(0, 0, *SIZE)
    ours, truth = triangulated.intervals(paths, grid), exact.intervals(paths, grid)
    long = np.diff(truth.t, axis=1)[:, 0] > 1e-9
    assert len(ours) == np.count_nonzero(long) > 5000
    assert np.abs(ours.t - truth.t[long]).max() < 1e-9
    assert np.abs(ours.w - truth.w[long]).max() < 1e-8


def test_free_deformation_has_the_error_of_the_split_side_surfaces():
    rng = np.random.default_rng(4)
    paths, grid = make_paths(random_points(rng, 300)), Grid(0, 0, *SIZE)
    shape = (300, grid.count)
    ours = total_time(triangulated.intervals(paths, grid), shape)
    truth = total_time(exact.intervals(paths, grid), shape)
    error = np.abs(ours - truth)[(ours > 0) | (truth > 0)]
    assert 0.01 < error.mean() < 0.08
    assert error.max() <= 1.0


def test_pairing_by_depth_differs_only_where_a_sample_has_four_fragments():
    rng = np.random.default_rng(5)
    paths, grid = make_paths(random_points(rng, 200)), Grid(0, 0, *SIZE)
    by_time = triangulated.intervals(paths, grid, "time")
    by_depth = triangulated.intervals(paths, grid, "depth")
    found = triangulated.fragments(triangulated.surface(paths), grid)
    starts = found.starts()
    counts = np.diff(starts, append=len(found.tau))
    assert set(np.unique(counts)) <= {2, 4, 6, 8}
    total = [total_time(part, (200, grid.count)) for part in (by_time, by_depth)]
    four = np.zeros((200, grid.count), dtype=bool)
    four[found.path[starts], found.sample[starts]] = counts > 2
    assert np.allclose(total[0][~four], total[1][~four])
    assert np.mean(np.abs(total[0] - total[1])[four] > 1e-9) > 0.1


def test_an_odd_count_is_completed_when_the_triangle_passes_through_the_eye():
    # A wall around the axis that comes from w = 3 and passes the eye at tau = 0.75.
    flat = np.array([[-100.0, -100], [300, -100], [0, 300]])
    points = np.zeros((1, 2, 3, 3))
    for end, w in enumerate((3.0, -1.0)):
        points[0, end] = np.column_stack([flat, np.full(3, w)])
    paths, grid = make_paths(points), Grid(0, 0, *SIZE)
    found = triangulated.intervals(paths, grid)
    assert len(found) == grid.count
    assert np.allclose(found.t, [0.0, 0.75])
    assert np.allclose(found.w, [3.0, 0.0])
    truth = exact.intervals(paths, grid)
    assert np.allclose(found.t[found.sample], truth.t[truth.sample])


def test_an_odd_count_without_a_root_drops_the_nearest_fragment():
    corners = np.array([[0.0, 0, 1], [0, 8, 1], [8, 0, 1]])
    paths = make_paths(np.stack([corners, corners + np.array([3.0, 1, 0])])[None])
    three = triangulated.Fragments(
        np.zeros(3, dtype=int), np.zeros(3, dtype=int), np.array([0.0, 0.4, 0.9]),
        np.array([2.0, 1.0, 3.0]), np.zeros((3, 0)),
    )  # fmt: skip
    assert np.allclose(triangulated.complete(paths, three).tau, [0.0, 0.9])


@pytest.mark.parametrize("method", [triangulated.intervals, exact.intervals])
def test_single_sided_paths_are_seen_while_they_face_the_viewer(method):
    points = random_points(np.random.default_rng(7), 300)
    grid = Grid(0, 0, *SIZE)
    both = make_paths(points)
    front = method(make_paths(points, single_sided=True), grid)
    back = method(make_paths(points[:, :, ::-1], single_sided=True), grid)
    shape = (300, grid.count)
    total = [total_time(part, shape) for part in (method(both, grid), front, back)]
    assert np.allclose(total[0], total[1] + total[2], atol=1e-6)
    assert min(total[1].sum(), total[2].sum()) > 100
    tau = front.t.mean(axis=1)
    d = triangulated.facing(both, front.path)
    assert np.all(triangulated.evaluate(d, tau) < 1e-9)


def test_static_geometry_is_its_nearest_triangle_over_the_whole_shutter():
    near = slab(rectangle(4, 12, 2, 12), (0, 0), 2.0, SIZE)
    far = slab(rectangle(0, 32, 0, 16), (0, 0), 5.0, SIZE)
    paths = paths_of(exposed([far, near]), *SIZE)
    found = static_intervals(paths, Grid(0, 0, *SIZE))
    w = np.full(SIZE[::-1], 5.0)
    w[2:12, 4:12] = 2.0
    assert found.w[:, 0] == pytest.approx(w.ravel())
    assert np.array_equal(found.t, np.tile([0.0, 1.0], (32 * 16, 1)))


def test_equal_depths_go_to_the_lower_path_index():
    red, green = (
        slab(rectangle(0, 32, 0, 16), speed, 2.0, SIZE, color, segments=1)
        for speed, color in (((0, 0), (1, 0, 0)), ((0, 0), (0, 1, 0)))
    )
    image = render(exposed([red, green]), *SIZE)
    assert np.all(image.rgba == [1, 0, 0, 1])


def test_limited_keeps_the_nearest_by_minimum_depth():
    found = exact.intervals(
        make_paths(random_points(np.random.default_rng(8), 60)), Grid(0, 0, 8, 8)
    )
    kept = limited(found, 5)
    assert np.bincount(kept.sample).max() == 5
    for sample in range(5):
        least = np.sort(found[found.sample == sample].w.min(axis=1))
        assert np.allclose(np.sort(kept[kept.sample == sample].w.min(axis=1)), least[:5])


def test_masked_visibility_is_the_nearest_at_every_bit_centre():
    rng = np.random.default_rng(9)
    found = triangulated.intervals(make_paths(random_points(rng, 40)), Grid(0, 0, 8, 8))
    bits = 64
    spans = masked(found, bits, 64)
    for sample in range(0, 64, 7):
        for bit in range(bits):
            t = (bit + 0.5) / bits
            here = np.flatnonzero(
                (found.sample == sample) & (found.t[:, 0] <= t) & (t < found.t[:, 1])
            )
            want = here[np.argmin(found.depth(here, np.full(len(here), t)))] if len(here) else -1
            at = found.sample[spans.interval] == sample
            at &= (spans.t[:, 0] <= t) & (t < spans.t[:, 1])
            assert spans.interval[at].tolist() == ([want] if len(here) else [])


def test_exact_visibility_is_the_limit_of_finer_masks():
    rng = np.random.default_rng(10)
    paths = make_paths(random_points(rng, 60))
    found = triangulated.intervals(paths, Grid(0, 0, 12, 12))
    seen = np.zeros((60, 144))
    spans = envelope(found)
    np.add.at(seen, (found.path[spans.interval], found.sample[spans.interval]), spans.weight)
    for bits, limit in ((256, 8e-3), (4096, 5e-4)):
        spans = masked(found, bits, 144)
        fine = np.zeros_like(seen)
        np.add.at(fine, (found.path[spans.interval], found.sample[spans.interval]), spans.weight)
        assert np.sqrt(np.mean((fine - seen) ** 2)) < limit
        assert np.abs(fine.sum(0) - seen.sum(0)).max() < 8 / bits
    shifted = np.roll(seen, 1, axis=0)
    assert np.sqrt(np.mean((fine - shifted) ** 2)) > 1e-2


def test_single_sided_material_culls_in_the_render():
    corners = rectangle(4, 28, 2, 14)
    mesh = slab(corners[::-1], (3, 0), 2.0, SIZE)
    hidden = Mesh(
        positions=mesh.positions, faces=mesh.faces,
        material=Material(shading="unlit", double_sided=False),
    )  # fmt: skip
    assert render(exposed([hidden]), *SIZE).rgba.max() == 0
    assert render(exposed([mesh]), *SIZE).rgba.max() == 1
