"""Look-ups in a picture of all directions: against a sum over texels, at seams, poles and lamps."""

from __future__ import annotations

import numpy as np
import pytest
from reference import panoramas as twin
from support.kernels import run

import mbinterval as mb
from mbinterval.rendering import panorama
from mbinterval.rendering.panorama import MOST_COLUMNS, picture, picture_size, sums_of

SKY = ["-DMB_SKY"]
RNG = np.random.default_rng(5)


def look_up(of: mb.Environment, ways: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """Colours ``(n, 3)`` of directions, of samples that stand for ``spread`` radians."""
    made = picture(of, sums=True)
    given = np.concatenate([ways, spread[:, None]], axis=1).astype(np.float32)
    arrays = [made[name] for name in ("panorama", "panorama_texels", "panorama_sums")]
    found = np.zeros((len(ways), 3), np.float32)
    return run("panorama.cl", "look_up", [*arrays, given, np.uint32(len(ways)), found], SKY)[-1]


def all_around(count: int) -> np.ndarray:
    """Directions of any length, many of them next to poles, seam and axes."""
    ways = RNG.normal(size=(count, 3))
    ways[::5, ::2] *= 10.0 ** RNG.uniform(-6, -1, (len(ways[::5]), 1))
    ways[1::5, 0], ways[1::5, 2] = RNG.normal(size=len(ways[1::5])) * 1e-3, 1.0
    ways[:6] = np.concatenate([np.eye(3), -np.eye(3)])
    return (ways * 10.0 ** RNG.uniform(-2, 2, (count, 1))).astype(np.float32)


def off_poles(ways: np.ndarray) -> np.ndarray:
    """Those that have a longitude."""
    return np.hypot(ways[:, 0], ways[:, 2]) > 0.0


@pytest.mark.parametrize("rows", [1, 2, 5, 48])
@pytest.mark.parametrize("degrees", [0.0, 200.0])
def test_what_is_looked_up_is_the_mean_over_what_a_sample_stands_for(rows, degrees):
    image = RNG.uniform(0, 2, (rows, 2 * rows, 3)).astype(np.float32)
    of = mb.Environment(image, intensity=3.0, rotation=degrees)
    ways = all_around(600)
    spread = 10.0 ** RNG.uniform(-4, 0.8, len(ways))
    spread[::4] = 0.0
    found = look_up(of, ways, spread.astype(np.float32))
    x, y = twin.places(image, ways, np.radians(degrees))
    wide, high = twin.boxes(image, ways, spread.astype(np.float32))
    truth = [3.0 * twin.mean_in_box(image, *box) for box in zip(x, y, wide, high, strict=True)]
    assert np.abs(found - truth)[off_poles(ways)].max() < 6.0 * rows * 2e-6 + 2e-6
    if rows > 5:
        boxes = zip(x, y, 1.2 * wide, high, strict=True)
        other = [3.0 * twin.mean_in_box(image, *box) for box in boxes]
        assert np.quantile(np.abs(found - other).max(axis=1), 0.7) > 1e-2


def test_where_texels_are_wider_it_is_interpolated_between_their_centres():
    image = RNG.uniform(0, 2, (32, 64, 3)).astype(np.float32)
    ways = all_around(600)
    ways = ways[off_poles(ways)]
    x, y = twin.places(image, ways, 0.0)
    truth = twin.interpolated(image.astype(np.float64), x, y)
    level = np.hypot(ways[:, 0], ways[:, 2]) / np.linalg.norm(ways, axis=1)
    texel = 2.0 * np.pi / 64 * np.minimum(level, 1.0)
    found = look_up(mb.Environment(image), ways, 0.999 * texel)
    assert np.abs(found - truth).max() < 2e-4
    just = look_up(mb.Environment(image), ways, 1.001 * texel)
    assert np.abs(just - found).max() < 5e-3  # nothing jumps where boxes begin
    assert np.abs(look_up(mb.Environment(image), ways, 2.0 * texel) - found).max() > 0.3


def test_what_is_dark_keeps_its_digits_beside_a_sun():
    image = RNG.uniform(1, 2, (64, 128, 3)).astype(np.float32)
    image[10, 70] = 1e12
    ways = all_around(400)
    spread = np.full(len(ways), 0.5)
    found = look_up(mb.Environment(image), ways, spread)
    x, y = twin.places(image, ways, 0.0)
    wide, high = twin.boxes(image, ways, spread)
    boxes = list(zip(x, y, wide, high, strict=True))
    truth = np.array([twin.mean_in_box(image.astype(np.float64), *box) for box in boxes])
    dark = truth[:, 0] < 3.0
    assert 0.5 < dark.mean() < 0.99
    assert np.abs(found - truth)[dark].max() < 2e-4
    assert np.abs(found / truth - 1.0)[~dark].max() < 2e-2  # the box's edge is rounded


@pytest.mark.parametrize("light", [0.0, 1e-30, 1.0, 1e24])
def test_sums_are_whole_numbers_of_a_unit(light):
    texels = (light * RNG.uniform(0, 1, (9, 18, 3))).astype(np.float32)
    sums, unit = sums_of(texels)
    assert sums.dtype == np.int64
    assert sums.max() <= 2**62 + texels.size
    found = np.diff(np.diff(sums, axis=0), axis=1) * unit
    assert np.allclose(found, texels, rtol=1e-7, atol=0.0)
    assert not sums[0].any()
    assert not sums[:, 0].any()


def path(x: np.ndarray, y: np.ndarray, wide: float, high: float) -> np.ndarray:
    return np.stack([x, y, np.full(16, wide), np.full(16, high)]).astype(np.float32)


def test_how_far_patches_are_apart_and_the_box_around_them():
    image = RNG.uniform(0, 1, (32, 64, 3)).astype(np.float32)
    steps = np.arange(16.0)
    rows = [
        path(20 + 0.5 * steps, 9 + 0.25 * steps, 1.0, 1.0),
        path((60 + 0.5 * steps) % 64, 9 + 0.0 * steps, 2.0, 1.0),  # over the seam
        path((3 - 0.5 * steps) % 64, 9 - 0.5 * steps, 1.0, 1.0),
        path((10 + 8 * steps) % 64, 1 + 0.1 * steps, 64.0, 1.0),  # around the pole
    ]
    made = picture(mb.Environment(image), sums=True)
    arrays = [made[name] for name in ("panorama", "panorama_texels", "panorama_sums")]
    out = [np.zeros((len(rows), 16), np.float32), np.zeros((len(rows), 4), np.float32)]
    count = np.uint32(len(rows))
    apart, around = run("panorama.cl", "stretches", [*arrays, np.array(rows), count, *out], SKY)[
        -2:
    ]
    assert apart[:, :-1] == pytest.approx(np.repeat([[0.5], [0.25], [0.5], [0.125]], 15, axis=1))
    assert not apart[:, -1].any()
    boxes = [
        (23.75, 10.875, 9.5, 5.75),
        (63.75, 9.0, 11.5, 2.0),
        (63.25, 5.25, 9.5, 9.5),
        (10.0, 1.75, 64.0, 3.5),
    ]
    for found, (x, y, wide, high), patch in zip(around, boxes, (1, 2, 1, 64), strict=True):
        assert found[:3] == pytest.approx(twin.mean_in_box(image, x, y, wide, high), abs=1e-5)
        assert found[3] == pytest.approx(wide * high / patch, rel=1e-5)


def test_very_fine_pictures_are_halved(monkeypatch):
    image = RNG.uniform(0, 1, (50, 100, 3)).astype(np.float32)
    monkeypatch.setattr(panorama, "MOST_COLUMNS", 50)
    of = mb.Environment(image)
    assert picture_size(of) == (50, 25)
    texels = picture(of)["panorama_texels"]
    assert np.abs(texels - image.reshape(25, 2, 50, 2, 3).mean(axis=(1, 3))).max() < 1e-6
    assert MOST_COLUMNS >= 8192
