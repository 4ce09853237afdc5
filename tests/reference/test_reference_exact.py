"""The exact twin against rational arithmetic, dense sampling in time and watertightness."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from support.closed_forms import scene
from support.nightly import nightly

from mbinterval.exposure.exposure import expose
from mbinterval.scene.model import Mesh
from reference import accumulation, bernstein, exact, rational
from reference.paths import make_paths, paths_of
from reference.render import render
from reference.samples import Grid, Points
from reference.visibility import exact as envelope

CENTRE = (16.0, 8.0)
"""A sample whose coordinates multiply without rounding, so that vertices can rest on it."""


def adversarial(rng: np.random.Generator, count: int) -> np.ndarray:
    """Moving triangles around ``CENTRE``, most of them degenerate in one way or another."""
    w = rng.uniform(0.2, 3.0, (count, 2, 3, 1))
    points = rng.normal(0.0, 4.0, (count, 2, 3, 3))
    kind = rng.integers(0, 8, count)
    w[kind == 0] = rng.uniform(-1.0, 2.0, (np.count_nonzero(kind == 0), 2, 3, 1))
    points[kind == 1, 1] = points[kind == 1, 0] + rng.normal(0, 4, (3,))  # translation
    points[kind == 2, 1, 0] = points[kind == 2, 0, 0]  # a vertex that pivots
    points[kind == 3] = np.round(points[kind == 3])  # roots at ends, equal edges, zeros
    points[kind == 4, 1] = -points[kind == 4, 0]  # collapses and turns inside out
    points[kind == 5, 0, 1] = points[kind == 5, 0, 0]  # starts as a segment
    points[kind == 6, :, 0] = 0.0  # a vertex rests on the sample
    points[..., :2] = points[..., :2] * w + np.array(CENTRE) * w
    points[..., 2:] = w
    return points


def solved(points: np.ndarray, **options: bool) -> list[list[np.ndarray]]:
    """Exact intervals at ``CENTRE``, by path."""
    paths = make_paths(points, **options)
    found = exact.intervals(paths, Points(np.array([CENTRE])))
    return [list(found.t[found.path == path]) for path in range(len(points))]


@pytest.mark.parametrize("single_sided", [False, nightly(True)])
def test_times_agree_with_rational_arithmetic_on_adversarial_paths(single_sided):
    points = adversarial(np.random.default_rng(1), 500)
    ours = solved(points, single_sided=single_sided)
    compared, shifted = 0, 0.0
    for path, found in enumerate(ours):
        truth = rational.covered(points[path], *CENTRE, single_sided)
        truth = [np.array([float(a), float(b)]) for a, b, _ in truth if b - a > 1e-7]
        found = [t for t in found if t[1] - t[0] > 1e-7]
        assert len(found) == len(truth), path
        for a, b in zip(found, truth, strict=True):
            assert np.abs(a - b).max() < 1e-8, path
            shifted = max(shifted, np.abs(a + 0.01 - b).max())
        compared += len(found)
    assert compared > 100
    assert shifted > 5e-3


def test_coverage_agrees_with_dense_sampling_in_time():
    points = adversarial(np.random.default_rng(2), 100)
    paths = make_paths(points)
    sample = Points(np.array([CENTRE]))
    found = exact.intervals(paths, sample)
    slices = 250
    seen = np.zeros((100, slices), dtype=bool)
    for index in range(slices):
        for path in range(100):
            one = make_paths(points[path : path + 1])
            seen[path, index] = (
                accumulation.slice_hits(one, sample, (index + 0.5) / slices)[0][0] >= 0
            )
    want = np.zeros_like(seen)
    centres = (np.arange(slices) + 0.5) / slices
    for (t0, t1), path in zip(found.t, found.path, strict=True):
        want[path] |= (t0 <= centres) & (centres < t1)
    assert np.count_nonzero(seen != want) <= 2
    assert np.count_nonzero(seen) > 2000


def test_a_path_can_have_four_intervals_when_all_is_ahead_of_the_eye():
    points = adversarial(np.random.default_rng(3), 60000)
    ahead = points[(points[..., 2] > 0).all(axis=(1, 2))]
    counts = np.bincount([len(found) for found in solved(ahead)])
    assert 3 <= len(counts) - 1 <= 4


def icosahedron() -> tuple[np.ndarray, np.ndarray]:
    g = (1 + 5**0.5) / 2
    v = np.array([[s * a, t * b, 0] for a, b in ((1, g),) for s in (-1, 1) for t in (-1, 1)])
    v = np.concatenate([v, np.roll(v, 1, axis=1), np.roll(v, 2, axis=1)])
    near = np.isclose(np.linalg.norm(v[:, None] - v[None], axis=2), 2.0)
    faces = [
        (i, j, k) for i in range(12) for j in range(i) for k in range(j)
        if near[i, j] and near[j, k] and near[i, k]
    ]  # fmt: skip
    faces = [(i, j, k) if np.linalg.det(v[[i, j, k]]) > 0 else (i, k, j) for i, j, k in faces]
    return v, np.array(faces)


@pytest.mark.parametrize("seed", range(3))
def test_a_closed_mesh_shows_as_much_front_as_back_at_every_sample(seed):
    rng = np.random.default_rng(seed)
    v, faces = icosahedron()
    ends = np.stack([v, v]) + rng.normal(0, 1.0, (2, 12, 3)) + [148376.0, 1234.0, -223423.0]
    pixels = (ends - [148376.0, 1234.0, -223413.0]) * [60.0, -60.0, -1.0]
    pixels[..., :2] += 16 * pixels[..., 2:]
    points = pixels[:, faces].transpose(1, 0, 2, 3)
    lattice = Grid(0, 0, 33, 33, (0.0, 0.0)).positions(np.arange(33 * 33))
    vertices = pixels[0, :, :2] / pixels[0, :, 2:]
    samples = Points(np.concatenate([np.stack(lattice, 1), vertices]))
    times = []
    for orientation in (points, points[:, :, ::-1]):
        found = exact.intervals(make_paths(orientation, single_sided=True), samples)
        times.append(np.bincount(found.sample, np.diff(found.t, axis=1)[:, 0], samples.count))
    assert times[0].sum() > 50
    assert np.abs(times[0] - times[1]).max() < 1e-14
    assert np.all(points[..., 2] > 0)


def moving_scene(seed: int, triangles: int = 25):
    """Triangles that turn and pass through each other, most of them in front of the camera."""
    rng = np.random.default_rng(seed)
    centre = rng.uniform((-2, -1.5, -8), (2, 1.5, -4), (2, triangles, 1, 3))
    corners = centre + rng.normal(0, 1.0, (2, triangles, 3, 3))
    mesh = Mesh(
        positions=corners.reshape(2, -1, 3), faces=np.arange(3 * triangles).reshape(-1, 3),
        color=rng.uniform(0, 1, (triangles, 3)), color_domain="face", shading="unlit",
    )  # fmt: skip
    return expose(scene([mesh], (0.2, 0.3, 0.4)), 0, 4 / 3)


def rmse(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.sqrt(np.mean((a - b) ** 2)))


def test_exact_images_are_the_limit_of_accumulation():
    frozen = moving_scene(11)
    truth = render(frozen, 32, 24, bits=None, paths="exact")
    error = []
    for slices in (64, 512):
        image = accumulation.render(frozen, 32, 24, slices)
        error.append(rmse(image.rgba, truth.rgba))
        covered = truth.rgba[..., 3] > 0.5
        assert np.abs(image.depth[covered] - truth.depth[covered]).mean() < 16 / slices
    assert error[0] < 8e-3
    assert error[1] < 1e-3
    assert rmse(render(frozen, 32, 24, bits=None).rgba, truth.rgba) > 5 * error[1]


def test_envelope_holds_the_nearest_at_random_moments():
    frozen = moving_scene(12, triangles=40)
    paths, grid = paths_of(frozen, 32, 24), Grid(0, 0, 32, 24)
    found = exact.intervals(paths, grid)
    spans = envelope(found)
    rng = np.random.default_rng(0)
    wrong = 0
    for t in rng.uniform(0, 1, 200):
        path, _ = accumulation.slice_hits(paths, grid, t)
        now = spans.interval[(spans.t[:, 0] <= t) & (t < spans.t[:, 1])]
        ours = np.full(grid.count, -1)
        assert len(np.unique(found.sample[now])) == len(now)
        ours[found.sample[now]] = found.path[now]
        wrong += np.count_nonzero(ours != path)
    assert wrong == 0


def test_depth_along_an_interval_is_rational_and_crosses_more_than_once():
    rng = np.random.default_rng(4)
    points = np.concatenate(
        [rng.normal(0, 6, (30000, 2, 3, 2)), rng.uniform(1, 1.6, (30000, 2, 3, 1))], axis=-1
    )
    points[..., :2] = (points[..., :2] + CENTRE) * points[..., 2:]
    found = exact.intervals(make_paths(points), Points(np.array([CENTRE])))
    first, second = np.arange(0, len(found) - 1, 2), np.arange(1, len(found), 2)
    overlap = np.minimum(found.t[first, 1], found.t[second, 1]) - np.maximum(
        found.t[first, 0], found.t[second, 0]
    )
    first, second = first[overlap > 0.01], second[overlap > 0.01]
    pair, time = found.crossings(first, second)
    crossed, times = np.unique(pair, return_counts=True)
    assert len(pair) > 100
    assert np.count_nonzero(times > 1) > 5
    gap = found.depth(first[pair], time) - found.depth(second[pair], time)
    assert np.abs(gap).max() < 1e-9
    for index in [*crossed[times > 1][:20], *crossed[:20]]:
        i, j = first[index], second[index]
        truth = rational.depth_crossings(points[found.path[i]], points[found.path[j]], *CENTRE)
        low, high = max(found.t[i, 0], found.t[j, 0]), min(found.t[i, 1], found.t[j, 1])
        truth = [float(t) for t in truth if low < t < high]
        assert np.sort(time[pair == index]) == pytest.approx(truth, abs=1e-9)


def test_bernstein_roots_find_what_was_put_in():
    rng = np.random.default_rng(5)
    for degree in (1, 2, 3, 5):
        wanted = np.sort(rng.uniform(0, 1, (200, degree)), axis=1)
        wanted = wanted[(np.diff(wanted, axis=1) > 0.02).all(axis=1)]
        c = np.ones((len(wanted), 1))
        for k in range(degree):
            c = bernstein.product(c, np.stack([-wanted[:, k], 1 - wanted[:, k]], axis=1))
        assert bernstein.roots(c) == pytest.approx(wanted, abs=1e-9)
        assert np.allclose(bernstein.evaluate(c, wanted[:, 0]), 0, atol=1e-15)
        if degree == 2:
            both = np.sort(bernstein.quadratic_roots(c), axis=1)
            assert both == pytest.approx(wanted, abs=1e-12)


def test_a_zero_end_does_not_hide_a_second_root():
    assert np.sort(bernstein.quadratic_roots(np.array([[0.0, -1.0, 1.0]]))) == pytest.approx(
        np.array([[0.0, 2 / 3]])
    )


def test_restriction_and_products_keep_the_value():
    rng = np.random.default_rng(6)
    a, b = rng.normal(size=(50, 4)), rng.normal(size=(50, 3))
    low, high, s = rng.uniform(0, 1, (3, 50))
    t = low + s * (high - low)
    c = bernstein.product(a, b)
    assert bernstein.evaluate(c, t) == pytest.approx(
        bernstein.evaluate(a, t) * bernstein.evaluate(b, t)
    )
    part = bernstein.restrict(c, low, high)
    assert bernstein.evaluate(part, s) == pytest.approx(bernstein.evaluate(c, t))


def test_rational_roots_of_a_cubic():
    # (t - 1/4) (t - 1/2) (t - 3/4)
    p = [Fraction(1)]
    for root in (1, 2, 3):
        p = rational.multiply(p, [Fraction(-root, 4), Fraction(1)])
    found = rational.sign_changes(p, Fraction(0), Fraction(1))
    assert [float(t) for t in found] == pytest.approx([0.25, 0.5, 0.75])
