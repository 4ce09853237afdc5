"""Stage "paths": vertices in pixel space, and what a path's shape says about all samples."""

from __future__ import annotations

import numpy as np
import pytest
from reference import exact, triangulated
from reference.bernstein import evaluate
from reference.paths import make_paths
from reference.samples import Grid
from support.kernels import paths_of_points, run, shapes_and_depths, shapes_of
from support.random_paths import KINDS, SIZE, deforming

from mbinterval.device import records
from mbinterval.exposure.exposure import expose
from mbinterval.layout.motion import lay_out
from mbinterval.scene.model import Camera, Mesh, Scene

CULLED, BEHIND, CROSSED, REVERSED = 1, 2, 4, 32
GRIDS = [Grid(0, 0, *SIZE, offset) for offset in ((0.5, 0.5), (0.03125, 0.96875))]


def random_points(kind: str, count: int = 120) -> np.ndarray:
    return KINDS[kind](np.random.default_rng(len(kind)), count)


def hits(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Path and position of everything that the twin hits, by both kinds of path."""
    paths, found = make_paths(points), []
    shape = triangulated.surface(paths)
    for grid in GRIDS:
        for part in (triangulated.fragments(shape, grid), exact.intervals(paths, grid)):
            found.append((part.path, *grid.positions(part.sample)))
    return tuple(np.concatenate(column) for column in zip(*found, strict=True))


def plane_distance(shapes: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Least a X + b Y + c of the shape's planes at positions ``(M,)`` of shapes ``(M,)``."""
    used = np.arange(8) < shapes["planes"][:, None]
    side = shapes["c"] + shapes["a"] * x[:, None] + shapes["b"] * y[:, None].astype(np.float64)
    return np.where(used, side, np.inf).min(axis=1)


@pytest.mark.parametrize("kind", KINDS)
def test_every_hit_lies_inside_the_bounding_planes_and_rows(kind):
    points = random_points(kind)
    shapes = shapes_of(*paths_of_points(points))
    path, x, y = hits(points)
    assert len(path) > 1000
    own = shapes[path]
    assert not np.any(own["flags"] & CULLED)
    assert plane_distance(own, x, y).min() >= 0
    assert np.all((own["y_min"] <= y) & (y <= own["y_max"]))
    # They bind: some hit is near a plane, and much of the frame is outside.
    if kind != "small and fast":
        assert plane_distance(own, x, y).min() < 0.2
    everywhere, sample = np.indices((len(points), GRIDS[0].count)).reshape(2, -1)
    outside = plane_distance(shapes[everywhere], *GRIDS[0].positions(sample)) < 0
    assert outside.mean() > (0.05 if kind == "behind the eye" else 0.2)


def test_planes_moved_inwards_by_a_third_of_a_pixel_lose_hits():
    points = random_points("translated")
    shapes = shapes_of(*paths_of_points(points))
    path, x, y = hits(points)
    shapes["c"] -= 0.3
    assert np.any(plane_distance(shapes[path], x, y) < 0)


def test_a_path_behind_the_eye_is_culled_and_one_that_reaches_behind_is_marked():
    points = deforming(np.random.default_rng(1), 300, near=-3.0)
    points[:50, ..., :] *= np.where(points[:50, ..., 2:] > 0, -1.0, 1.0)
    flags = shapes_of(*paths_of_points(points))["flags"]
    w = points[..., 2].reshape(300, 6)
    assert np.array_equal((flags & CULLED) != 0, (w <= 0).all(axis=1))
    assert np.array_equal((flags & BEHIND) != 0, (w <= 0).any(axis=1) & (w > 0).any(axis=1))


@pytest.mark.parametrize("kind", ["deforming", "behind the eye", "pivoting"])
def test_facing_changes_at_the_roots_of_the_determinant(kind):
    points = random_points(kind, 2000)
    facing = shapes_of(*paths_of_points(points))["facing_changes"].astype(np.float64)
    paths = make_paths(points)
    d = triangulated.facing(paths, np.arange(len(points)))
    roots = np.nan_to_num(triangulated.roots(d), nan=np.inf)
    assert np.array_equal(facing[:, 0], np.where(d[:, 0] < 0, 1.0, -1.0))
    turns = np.isfinite(roots).sum(axis=1)
    assert {1, 2} <= set(turns.tolist())
    known = np.isfinite(roots)
    assert np.array_equal(np.isfinite(facing[:, 1:]), known)
    assert np.abs(facing[:, 1:][known] - roots[known]).max() < 1e-6
    assert np.abs(facing[:, 1:][known] - 0.99 * roots[known]).max() > 1e-3


def test_single_sided_paths_that_never_face_the_viewer_are_culled():
    points = random_points("deforming", 400)
    shapes = shapes_of(*paths_of_points(points), flags=records.MATERIAL_SINGLE_SIDED)
    seen = exact.intervals(make_paths(points, single_sided=True), GRIDS[0]).path
    culled = shapes["flags"] & CULLED != 0
    assert not culled[seen].any()
    assert 0.1 < culled.mean() < 0.6
    back = (shapes["facing_changes"][:, 0] < 0) & np.isinf(shapes["facing_changes"][:, 1])
    assert np.array_equal(culled, back)


def screen_crossing(p0, q0, p1, q1):
    """Where two segments of homogeneous points cross on screen, as a part of each, or None.

    By plain 2-D geometry on divided points; the part is of the homogeneous segment.
    """
    a, b, c, d = (v[:2] / v[2] for v in (p0, q0, p1, q1))
    matrix = np.stack([b - a, c - d], axis=1)
    s, u = np.linalg.solve(matrix, c - a)
    if not (0 < s < 1 and 0 < u < 1):
        return None
    parts = []
    for at, p, q in ((s, p0, q0), (u, p1, q1)):
        parts.append(at * p[2] / (at * p[2] + (1 - at) * q[2]))
    return parts


def test_crossed_sides_are_those_whose_edges_cross_on_screen_at_the_place_given():
    points = random_points("deforming", 1000)
    shapes = shapes_of(*paths_of_points(points))
    crossings = 0
    for path, shape in zip(points, shapes, strict=True):
        for side in range(3):
            p, q = side, (side + 1) % 3
            reversed_ = tuple(path[:, q].ravel()) < tuple(path[:, p].ravel())
            assert bool(shape["flags"] & REVERSED << side) == reversed_
            p, q = (q, p) if reversed_ else (p, q)
            want = screen_crossing(path[0, p], path[0, q], path[1, p], path[1, q])
            assert bool(shape["flags"] & CROSSED << side) == (want is not None)
            if want is not None:
                crossings += 1
                found = shape["crossing"][2 * side : 2 * side + 2]
                assert found == pytest.approx(want, abs=1e-6)
    assert crossings > 200


def test_edges_that_cross_behind_the_eye_are_not_crossed():
    p0, q0 = np.array([-1.0, -1, -1]), np.array([1.0, 1, -1])
    p1, q1 = np.array([-1.0, 1, -1]), np.array([1.0, -1, -1])
    for sign, crossed in ((1.0, False), (-1.0, True)):
        points = np.array([[[p0, q0, [9.0, 0, 1]], [p1, q1, [9.0, 0, 1]]]])
        points[:, :, :2] *= sign
        flags = shapes_of(*paths_of_points(points))["flags"][0]
        assert bool(flags & CROSSED) == crossed


def test_a_resting_path_has_no_crossed_side():
    vertices, paths = paths_of_points(random_points("deforming", 50))
    paths["step"] = 0
    assert not np.any(shapes_of(vertices, paths)["flags"] // CROSSED & 7)


@pytest.mark.parametrize("size", [1e-18, 1e-3, 1.0, 7.9, 1e18])
def test_scale_is_the_power_of_two_that_brings_w_near_one(size):
    points = random_points("deforming", 20) * size
    scale = shapes_of(*paths_of_points(points))["scale"].astype(np.float64)
    w = np.abs(points[..., 2]).max(axis=(1, 2))
    assert np.all((scale * w >= 1) & (scale * w < 2))
    assert np.array_equal(np.frexp(scale)[0], np.full(20, 0.5))


def test_shapes_do_not_depend_on_the_scale_of_the_scene():
    points = random_points("translated", 100)
    small, large = (shapes_of(*paths_of_points(points * 2.0**k)) for k in (-40, 40))
    for name in ("planes", "a", "b", "c", "y_min", "y_max", "facing_changes", "flags"):
        assert np.array_equal(small[name], large[name]), name


def test_vertices_far_from_the_origin_keep_their_precision():
    eye = np.array([148376.0, 1234.0, -223423.0])
    rng = np.random.default_rng(5)
    offsets = rng.integers(-(2**20), 2**20, (2, 60, 3)) / 2.0**20
    offsets[..., 2] -= 3.0
    mesh = Mesh(positions=eye + offsets, faces=np.arange(60).reshape(-1, 3), shading="unlit")
    camera = Camera(position=tuple(eye), fov=40.0)
    motion = lay_out(expose(Scene(meshes=[mesh], camera=camera), 1.0, 1.5), *SIZE)
    arguments = [motion.jobs, motion.positions, motion.cameras]
    output = np.zeros(motion.vertex_count, records.VERTEX)
    found = run("shared/vertices.cl", "vertices", [*arguments, output], items=len(motion.jobs))[-1]
    focal = 0.5 / np.tan(np.radians(20.0)) * SIZE[1]
    x, y, w = offsets[..., 0], offsets[..., 1], -offsets[..., 2]
    want = np.stack([focal * x + SIZE[0] / 2 * w, -focal * y + SIZE[1] / 2 * w, w])
    for name, value in zip("xyw", want, strict=True):
        assert np.abs(found[name] - value.ravel()).max() < 1e-12 * np.abs(want).max()
    rounded = (eye + offsets).astype(np.float32).astype(np.float64) - eye
    assert np.abs(rounded - offsets).max() > 1e-3  # what single precision would lose


@pytest.mark.parametrize("kind", ["deforming", "pivoting", "behind the eye"])
def test_depth_over_time_is_that_of_the_twin_at_every_sample(kind):
    points = random_points(kind)
    _, depths = shapes_and_depths(*paths_of_points(points))
    found = exact.intervals(make_paths(points), GRIDS[1])
    index, t = np.arange(len(found)), found.t.mean(axis=1)
    x, y = GRIDS[1].positions(found.sample)
    own = depths[found.path]
    below = sum(evaluate(own[name], t) * place for name, place in (("x", x), ("y", y), ("w", 1.0)))
    ours, truth = evaluate(own["d"], t) / below, found.depth(index, t)
    assert len(found) > 1000
    error = np.abs(ours / truth - 1.0)
    assert np.quantile(error, 0.99) < 1e-10
    assert error.max() < 1e-4  # seen all but edge-on
    assert np.abs(ours / found.depth(index, t * 0.99) - 1.0).max() > 1e-3
