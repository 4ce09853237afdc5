"""Patterns of samples, pixel filters and how errors fall with more samples."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest
from reference.render import render as twin
from support.closed_forms import UNIT_CAMERA, world
from support.nightly import nightly
from support.places import places, within

import mbinterval as mb
from mbinterval.exposure.exposure import expose
from mbinterval.plan.sampling import fixed_pattern
from mbinterval.scene.model import Camera, Mesh, Scene

LENS = Camera(focal_length=50.0, f_stop=1.0, focus_distance=2.0)


def is_net(points: np.ndarray) -> np.ndarray:
    """Whether each of the sets ``(..., 2^k, 2)`` has one point in every elementary interval."""
    n = points.shape[-2]
    k = n.bit_length() - 1
    good = np.ones(points.shape[:-2], dtype=bool)
    for a in range(k + 1):
        cell = np.floor(points[..., 0] * 2**a) * 2 ** (k - a) + np.floor(
            points[..., 1] * 2 ** (k - a)
        )
        good &= np.all(np.sort(cell, axis=-1) == np.arange(n), axis=-1)
    return good


@pytest.mark.parametrize("count", [1, 2, 4, 8, 16, 64, 256])
def test_scattered_samples_are_a_net_in_every_pixel_and_different_in_each(count):
    settings = mb.Settings(pattern="sobol", samples=count)
    points = within(places(settings)[0]).reshape(-1, count, 2)
    assert np.all((points >= 0) & (points < 1))
    nets = is_net(points)
    assert nets[0]
    # Added to its pixel's number a place is rounded to 2^-20, now and then over a border.
    assert nets.mean() > 0.9
    assert len(np.unique(np.round(points[:, 0], 6), axis=0)) == 256
    shifted = points.copy()
    shifted[:, 0, 0] = (shifted[:, 0, 0] + 0.5) % 1.0
    assert count == 1 or is_net(shifted).mean() < 0.5


@pytest.mark.parametrize("count", [3, 5, 12, 100])
def test_any_other_number_of_scattered_samples_is_well_spread_too(count):
    settings = mb.Settings(pattern="sobol", samples=count)
    points = within(places(settings)[0]).reshape(-1, count, 2)
    for axis in (0, 1):
        share = (points[..., axis] < 0.5).mean(axis=1)
        assert np.abs(share - 0.5).max() <= 1.0 / count + 1e-9  # random ones: 0.5 / sqrt(count)
    assert np.abs(points.mean(axis=(0, 1)) - 0.5).max() < 4 * np.sqrt(1 / 12 / 256)


def test_scattered_samples_are_uniform_over_the_pixel_and_seeds_differ():
    points = [
        within(places(mb.Settings(pattern="sobol", samples=4, seed=s))[0]).reshape(-1, 4, 2)
        for s in range(8)
    ]
    assert not np.any(np.all(points[0] == points[1], axis=(1, 2)))
    every = np.concatenate(points).reshape(-1, 2)
    cells = np.bincount((every * 8).astype(int) @ [8, 1], minlength=64)
    chi = ((cells - len(every) / 64) ** 2 / (len(every) / 64)).sum()
    assert chi < 63 + 4 * np.sqrt(2 * 63)
    # Neighbours are independent.
    x = points[0].reshape(16, 16, 4, 2)[:, :, 0]
    for a, b in ((x[:-1], x[1:]), (x[:, :-1], x[:, 1:])):
        for axis in (0, 1):
            r = np.corrcoef(a[..., axis].ravel(), b[..., axis].ravel())[0, 1]
            assert abs(r) < 4 / np.sqrt(240)


@pytest.mark.parametrize("count", [1, 2, 4, 5, 16, 64, 97, 256])
def test_fixed_samples_have_a_row_and_a_column_each(count):
    points = fixed_pattern(count).astype(np.float64)
    for axis in (0, 1):
        assert np.array_equal(np.sort((points[:, axis] * count).astype(int)), np.arange(count))


@pytest.mark.parametrize("count", [8, 31, 37, 64, 256])
def test_a_symmetric_fixed_pattern_has_an_opposite_of_each_sample(count):
    points = fixed_pattern(count, symmetric=True).astype(np.float64)
    for axis in (0, 1):
        assert np.array_equal(np.sort((points[:, axis] * count).astype(int)), np.arange(count))
    opposite = 1.0 - points
    assert {tuple(p) for p in points} == {tuple(p) for p in opposite}
    assert {tuple(p) for p in fixed_pattern(count)} != {tuple(p) for p in 1 - fixed_pattern(count)}


FILTERS = {
    "triangle": lambda x: np.maximum(1.0 - np.abs(x), 0.0),
    "gaussian": lambda x: np.where(np.abs(x) < 1.5, np.exp(-2 * x * x) - np.exp(-4.5), 0.0),
    "blackman_harris": lambda x: np.where(
        np.abs(x) < 1.5,
        0.35875
        + 0.48829 * np.cos(np.pi * x / 1.5)
        + 0.14128 * np.cos(2 * np.pi * x / 1.5)
        + 0.01168 * np.cos(3 * np.pi * x / 1.5),
        0.0,
    ),
    "mitchell": lambda x: np.select(
        [np.abs(x) < 1.0, np.abs(x) < 2.0],
        [
            7 / 6 * np.abs(x) ** 3 - 2 * x * x + 8 / 9,
            -7 / 18 * np.abs(x) ** 3 + 2 * x * x - 10 / 3 * np.abs(x) + 16 / 9,
        ],
    ),
}  # fmt: skip
"""One-dimensional filters of default radius, written out again."""


@pytest.mark.parametrize("name", FILTERS)
def test_samples_have_the_density_of_their_filter(name):
    settings = mb.Settings(pattern="sobol", samples=64, filter=name)
    found, weights = places(settings)
    points = within(found).reshape(-1, 2) - 0.5
    weights = weights.reshape(-1)
    grid = np.linspace(-2.5, 2.5, 20001)
    density = FILTERS[name](grid)
    moments = [np.cos, lambda x: x * x, lambda x: np.abs(x) < 0.5, lambda x: (x > 0.2) & (x < 0.7)]
    for axis in (0, 1):
        for moment in moments:
            want = (density * moment(grid)).sum() / density.sum()
            # Weights add up to 1 per pixel; along the other axis they average out.
            got = (weights * moment(points[:, axis])).mean()
            assert got == pytest.approx(want, abs=6e-3), moment
    box = (np.abs(points) < 0.5).all(axis=1).mean()
    assert box < 0.9  # not the box filter's


def test_weights_of_a_filter_with_lobes_add_up_in_every_pixel():
    settings = mb.Settings(pattern="sobol", samples=16, filter="mitchell")
    _, weights = places(settings)
    assert np.abs(weights.sum(axis=-1) - 16).max() < 1e-4
    assert weights.min() < 0
    # A scene that is the same everywhere is so through any filter.
    whole = world(np.array([[[-90.0, -90], [150, -90], [-90, 150]]] * 2), 2.0, (16, 16))
    whole[1] += [0.1, 0, 0]
    scene = Scene(
        meshes=[Mesh(positions=whole.reshape(2, 3, 3), faces=[[0, 1, 2]], shading="unlit")],
        camera=UNIT_CAMERA,
    )
    film = mb.render(scene, width=16, height=16, settings=settings)
    assert film.rgba == pytest.approx(np.ones_like(film.rgba), abs=1e-5)


def test_points_of_the_lens_are_uniform_over_the_disc_and_independent_of_the_place():
    settings = mb.Settings(pattern="sobol", samples=16)
    found, _ = places(settings, camera=LENS)
    uv = found[..., 2:].reshape(-1, 2)
    radius = np.hypot(*uv.T)
    assert radius.max() <= 1.0 + 1e-6
    rings = np.bincount((np.minimum(radius**2, 1 - 1e-9) * 8).astype(int), minlength=8)
    angles = np.bincount(((np.arctan2(*uv.T) / np.pi + 1) * 4).astype(int) % 8, minlength=8)
    for cells in (rings, angles):
        assert np.abs(cells / len(uv) - 1 / 8).max() < 0.02
    place = within(found).reshape(-1, 2)
    for a in place.T:
        for b in uv.T:
            assert abs(np.corrcoef(a, b)[0, 1]) < 0.05
    # 16 points of a pixel: one in each sixteenth of the disc's area, as rings and as sectors.
    quarter = np.sort((np.hypot(*found[..., 2:].transpose(3, 0, 1, 2)) ** 2 * 2).astype(int), -1)
    assert np.mean(quarter.sum(axis=-1) == 8) > 0.3  # half of each pixel's points in the inner half


@pytest.mark.parametrize("blades", [3, 4, 5, 8])
def test_blades_make_a_polygon_of_uniform_brightness(blades):
    camera = Camera(
        focal_length=50.0, f_stop=1.0, focus_distance=2.0, blades=blades, blade_rotation=10.0
    )
    uv = places(mb.Settings(pattern="sobol", samples=64), camera=camera)[0][..., 2:].reshape(-1, 2)
    step = 2 * np.pi / blades
    normals = np.radians(10.0) + step * (np.arange(blades) + 0.5)
    outward = uv @ np.stack([np.cos(normals), np.sin(normals)])
    apothem = np.cos(np.pi / blades)
    assert outward.max() <= apothem + 1e-6
    assert outward.max() > 0.999 * apothem
    assert (uv**2).sum(axis=1).mean() == pytest.approx((2 + np.cos(step)) / 6, rel=0.01)
    # Within the polygon of half the size lies a quarter.
    assert np.mean(outward.max(axis=1) < apothem / 2) == pytest.approx(0.25, abs=0.01)
    sectors = np.argmax(outward, axis=1)
    assert np.bincount(sectors) / len(uv) == pytest.approx(np.full(blades, 1 / blades), abs=0.01)


def spinning() -> Scene:
    """A star of triangles that turn about the frame's middle."""
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    inner = 3 * np.stack([np.cos(angle), np.sin(angle)], -1)
    outer = 14 * np.stack([np.cos(angle + 0.06), np.sin(angle + 0.06)], -1)
    third = 12 * np.stack([np.cos(angle + 0.2), np.sin(angle + 0.2)], -1)
    start = np.stack([inner, outer, third], axis=1)
    turn = 0.12
    matrix = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    ends = np.stack([start, start @ matrix]) + [16.2, 15.7]
    colors = np.random.default_rng(0).uniform(0, 1, (24, 3))
    mesh = Mesh(
        positions=world(ends, 2.0, (32, 32)).reshape(2, -1, 3),
        faces=np.arange(72).reshape(-1, 3), color=colors, color_domain="face", shading="unlit",
    )  # fmt: skip
    return Scene(meshes=[mesh], camera=UNIT_CAMERA, background=(0.1, 0.1, 0.1))


@lru_cache
def converged() -> np.ndarray:
    """The twin's 900 samples per pixel, in a part of the frame."""
    line = (np.arange(30) + 0.5) / 30
    lattice = np.stack(np.meshgrid(line, line), -1).reshape(-1, 2)
    lattice[:, 0] += (np.arange(900) // 30 - 14.5) / 900  # no two in one column
    return twin(expose(spinning(), 1.0, 1.0), 32, 32, lattice, CROP, paths="exact").rgba


CROP = (17, 3, 12, 10)


@pytest.mark.parametrize("pattern", ["sobol", nightly("fixed")])
def test_four_times_the_samples_halve_the_error_over_the_pixel(pattern):
    errors = []
    for count in (1, 4, 16, 64):
        settings = mb.Settings(samples=count, pattern=pattern)
        film = mb.render(spinning(), width=32, height=32, settings=settings, crop=CROP)
        errors.append(np.sqrt(np.mean((film.rgba - converged())[..., :3] ** 2)))
    print(f"\n{pattern}: {' '.join(f'{error:.2e}' for error in errors)}")
    for few, many in pairwise(errors):
        assert many < 0.5 * few
