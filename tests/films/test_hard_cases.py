"""The cases that must stay stable (DESIGN.md 6), each on both kinds of paths.

The truth is the float64 twin of exact paths at the same samples. Exact paths must meet it.
Triangulated ones (Hong & Oh 2017) are known to fail in many cases. For each the RMS error that is
expected is stated, to a factor of 1.5; 0 means that they hold. They have exact occlusion, so that
it is the error of triangulation, and of depth that is linear in time, alone.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from math import comb

import numpy as np
import pytest
from reference import rational
from reference.render import render as twin
from support.closed_forms import UNIT_CAMERA, overlap, rectangle, slab, slab_times, world
from support.hard_cases import BACKGROUND, CASES, SIZE, crowded, scaled, scene, swinging
from support.kernels import run
from support.nightly import nightly

import mbinterval as mb
from mbinterval.exposure.exposure import expose
from mbinterval.scene.model import Camera, Light, Material, Mesh, Scene


def film(of: Scene, paths: str, crop: tuple[int, int, int, int] = (0, 0, *SIZE)) -> mb.Film:
    settings = mb.Settings(paths=paths, occlusion="exact", samples=1)
    found = mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings, crop=crop)
    assert np.isfinite(found.rgba).all()
    assert not np.isnan(found.depth).any()
    return found


def truth(of: Scene, crop: tuple[int, int, int, int]) -> np.ndarray:
    exposure = expose(of, 1.0, SIZE[0] / SIZE[1])
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):  # edge-on, 0 by 0
        return twin(exposure, *SIZE, crop=crop, paths="exact").rgba


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


@pytest.mark.parametrize("name", CASES)
def test_exact_paths_hold(name):
    case = CASES[name]
    of = case.make()
    want = truth(of, case.crop)
    error = film(of, "exact", case.crop).rgba - want
    assert np.abs(error).max() < 1e-6
    assert want[..., 3].mean() > 0.001
    # Control: the same scene, its shutter moved by a hundredth of its length.
    late = [
        replace(m, positions=m.positions + 0.01 * (m.positions[-1] - m.positions[0]))
        for m in of.meshes
    ]
    moved = film(replace(of, meshes=late), "exact", case.crop).rgba - want
    if name not in ("nearly zero motion", "small motion", "through the eye"):
        assert np.abs(moved).max() > 1e-4


@pytest.mark.parametrize("name", CASES)
def test_triangulated_paths_err_as_expected(name):
    case = CASES[name]
    of = case.make()
    error = rms(film(of, "triangulated", case.crop).rgba - truth(of, case.crop))
    if case.split == 0.0:
        assert error < 1e-6
    else:
        assert case.split / 1.5 < error < case.split * 1.5


@pytest.mark.parametrize("paths", ["exact", "triangulated"])
def test_light_is_the_same_far_from_the_origin(paths):
    def lit(place: np.ndarray) -> Scene:
        triangles = np.random.default_rng(5).integers(-64, 64, (2, 30, 3)) / 32 - [0, 0, 4]
        shiny = Material(shading="phong", specular=(0.5, 0.5, 0.5), shininess=8.0)
        moving = Mesh(positions=triangles + place, faces=np.arange(30).reshape(-1, 3),
                      material=shiny)  # fmt: skip
        lamp = Light("point", position=tuple(place + [1.0, 2.0, -1.0]), intensity=4.0)
        camera = Camera(position=tuple(place), focal_length=24.0)
        return Scene(meshes=[moving], camera=camera, lights=[lamp])

    near, far = (film(lit(place), paths).rgba for place in (np.zeros(3), np.full(3, 2.0**30)))
    assert near[..., :3].max() > 0.2
    assert np.array_equal(near, far)


@pytest.mark.parametrize("paths", ["exact", "triangulated"])
def test_of_coplanar_triangles_the_first_is_seen_whole(paths):
    """Triangulated ones have rounded depths: where both are, either may be seen."""
    x = np.arange(SIZE[0]) + 0.5
    ends = [(4.3, 12.3, 19.0), (30.2, 39.2, -23.0)]
    slabs = [
        slab(rectangle(left, right, -1, 33), (speed, 0), 2.0, SIZE, color)
        for (left, right, speed), color in zip(ends, np.eye(3), strict=False)
    ]
    times = [slab_times(x, *end) for end in ends]
    alone = np.array([t1 - t0 for t0, t1 in times])
    both = overlap(*times)
    assert both.max() > 0.1
    for order in ((0, 1), (1, 0)):
        of = Scene(meshes=[slabs[k] for k in order], camera=UNIT_CAMERA)
        image = film(of, paths).rgba[7]
        assert image[:, 3] == pytest.approx(alone.sum(axis=0) - both, abs=1e-6)
        unsure = both if paths == "triangulated" else 0.0
        for k, want in zip(order, (alone[order[0]], alone[order[1]] - both), strict=True):
            assert np.all(np.abs(image[:, k] - want) <= 1e-6 + unsure)


@pytest.mark.parametrize("paths", ["exact", "triangulated"])
def test_nothing_at_all_is_the_background(paths):
    image = film(scene(), paths)
    assert np.all(image.rgba == np.float32([*BACKGROUND, 0.0]))
    assert np.all(np.isinf(image.depth))


@pytest.mark.parametrize("paths", ["exact", "triangulated"])
def test_no_interval_of_thousands_is_lost(paths):
    found = film(crowded(), paths, CASES["a thousand intervals on a pixel"].crop)
    assert found.intervals.min() > 1000


@pytest.mark.parametrize("paths", ["exact", "triangulated"])
def test_a_swing_is_seen_outside_of_the_hull_of_its_ends(paths):
    image = film(swinging(), paths).rgba[..., 3]
    assert image[:12].sum() > 5  # the ends lie in rows 20 to 31
    ends = swinging()
    ends = replace(ends, meshes=[replace(ends.meshes[0], positions=ends.meshes[0].positions[::8])])
    assert film(ends, paths).rgba[:12, :, 3].sum() == 0.0


@pytest.mark.parametrize("paths", ["exact", "triangulated"])
@pytest.mark.parametrize("corner", [300, 16384, 40000, 65500])
def test_far_pixels_of_large_frames_lose_no_small_triangle(corner, paths):
    rng = np.random.default_rng(1)
    size, crop = (65536, 65536), (corner, corner, 32, 32)
    pixels = rng.uniform(0, 32, (2, 400, 1, 2)) + rng.normal(0, 0.02, (2, 400, 3, 2)) + corner
    positions = world(pixels, 2.0, size).reshape(2, -1, 3)
    of = Scene(
        meshes=[Mesh(positions=positions, faces=np.arange(1200).reshape(-1, 3), shading="unlit")],
        camera=UNIT_CAMERA,
    )
    settings = mb.Settings(paths=paths, occlusion="exact", samples=1)
    found = mb.render(of, width=size[0], height=size[1], crop=crop, settings=settings)
    want = twin(expose(of, 1.0, 1.0), *size, crop=crop, paths="exact")
    if paths == "exact":
        assert np.array_equal(found.intervals, want.intervals)
        assert np.abs(found.rgba - want.rgba).max() < 1e-6
    assert abs(int(found.intervals.sum()) - int(want.intervals.sum())) <= 5


@pytest.mark.parametrize("paths", ["exact", "triangulated"])
def test_triangles_smaller_than_rounding_are_not_seen(paths):
    rng = np.random.default_rng(2)
    place = rng.uniform((-2, -1.5, -5), (2, 1.5, -2), (2, 5000, 1, 3))
    for ulps in (0, 1, 4, 100):
        positions = place * (1 + ulps * 2.0**-52 * rng.integers(-1, 2, (2, 5000, 3, 3)))
        whole = Mesh(positions=positions.reshape(2, -1, 3), shading="unlit",
                     faces=np.arange(15000).reshape(-1, 3))  # fmt: skip
        assert film(scene(whole), paths).rgba[..., 3].max() == 0.0


@pytest.mark.parametrize(("scale", "words"), [(1e31, "larger units"), (1e-33, "smaller units")])
def test_scales_beyond_the_range_of_numbers_are_refused(scale, words):
    with pytest.raises(mb.SceneError, match=words):
        film(scaled(scale), "exact")


@pytest.mark.parametrize("scale", [1e18, 1e-18, 1e29, 1e-29])
def test_any_other_scale_is_the_same_picture(scale):
    assert np.abs(film(scaled(scale), "exact").rgba - film(scaled(1.0), "exact").rgba).max() < 1e-6


def test_denormal_vertices_are_as_good_as_zero():
    whole = scaled(1.0)
    zero = whole.meshes[0].positions.copy()
    zero[:, ::7, :2] = 0.0
    films = [
        film(replace(whole, meshes=[replace(whole.meshes[0], positions=p)]), "exact").rgba
        for p in (zero, np.where(zero == 0.0, 5e-324, zero))
    ]
    assert np.abs(films[0] - films[1]).max() < 1e-6
    assert np.abs(films[0] - film(whole, "exact").rgba).max() > 0.1


@pytest.mark.parametrize(
    ("seed", "count"), [(3, 200), nightly(3, 500), nightly(4, 500), nightly(5, 500)]
)
def test_depths_cross_where_exact_fractions_say_with_roots_at_the_ends_too(seed, count):
    """Quintics with small whole coefficients, many of them 0: the sign changes in (0, 1)."""
    rng = np.random.default_rng(seed)
    coefficients = rng.integers(-3, 4, (count, 6)).astype(float)
    coefficients[::5, 0] = 0.0
    coefficients[::7, 5] = 0.0
    arrays = [coefficients, np.uint32(count), np.zeros((count, 5)), np.zeros(count, np.int32)]
    *_, roots, counts = run("quintic.cl", "quintics", arrays)
    total = 0
    for b, found, number in zip(coefficients, roots, counts, strict=True):
        want = sign_changes_inside([Fraction(int(c)) for c in b])
        assert number == len(want), b
        assert np.abs(found[:number] - want).max(initial=0.0) < 2e-9, b
        total += number
    assert total > 0.6 * count


def sign_changes_inside(b: list[Fraction]) -> list[float]:
    """Places in (0, 1) at which the Bernstein polynomial really changes its sign."""
    power = [Fraction(0)] * 6
    for i, c in enumerate(b):
        for k in range(6 - i):
            power[i + k] += c * comb(5, i) * comb(5 - i, k) * (-1) ** k
    if not any(power):
        return []
    places = rational.sign_changes(power, Fraction(0), Fraction(1))
    stops = [Fraction(0), *(p for p in places if 0 < p < 1), Fraction(1)]
    middles = [rational.value(power, (x + y) / 2) for x, y in pairwise(stops)]
    changes = [u * v < 0 for u, v in pairwise(middles)]
    return [float(p) for p, c in zip(stops[1:-1], changes, strict=True) if c]
