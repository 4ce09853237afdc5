"""Stage "resolve": sums over samples become the film's pixels."""

from __future__ import annotations

import numpy as np
import pytest
from support.kernels import numbers, options, run

TILE, SAMPLES = 8, 4
FILM = (19, 11, 6, 9)
"""Column, row, width and height of the film in the frame; the tile begins at (16, 8)."""

X, Y = slice(3, 8), slice(3, 8)
"""Columns and rows of the tile that lie in the film."""


def resolved(*effects: str, background: np.ndarray) -> tuple[dict[str, np.ndarray], list]:
    rng = np.random.default_rng(1)
    cover = rng.uniform(0, SAMPLES, (TILE, TILE)).astype(np.float32)
    cover[rng.random((TILE, TILE)) < 0.3] = 0.0
    sums = {
        "color": np.dstack([rng.uniform(0, 1, (TILE, TILE, 3)) * cover[..., None], cover]),
        "depth": 7.0 * cover,
        "count": rng.integers(0, 99, (TILE, TILE)),
    }
    types = (np.float32, np.float32, np.uint32)
    sums = {name: v.astype(t) for (name, v), t in zip(sums.items(), types, strict=True)}
    height, width = FILM[3], FILM[2]
    outputs = [
        np.full((height, width, 4), -1, np.float32), np.full((height, width), -1, np.float32),
        np.full((height, width), 777, np.uint32),
    ]  # fmt: skip
    bounds = [16, 8, X.start, X.stop, Y.start, Y.stop]
    arrays = [
        numbers(samples=SAMPLES), *np.int32(bounds), *sums.values(), np.array(FILM, np.int32),
        background.astype(np.float32), *outputs,
    ]  # fmt: skip
    found = run("resolve.cl", "resolve_tile", arrays, options(*effects, TILE=TILE))
    return sums, found[-3:]


def inside(film: np.ndarray) -> np.ndarray:
    """The film's pixels that belong to the tile."""
    return film[:5, :5]


@pytest.mark.parametrize("effect", ["", "TRANSPARENT", "BACKGROUND_IMAGE"])
def test_a_pixel_is_the_mean_of_its_samples_over_the_background(effect):
    rng = np.random.default_rng(2)
    image = rng.uniform(0, 1, (FILM[3], FILM[2], 3)).astype(np.float32)
    sums, (rgba, _, met) = resolved(*[effect] * bool(effect), background=image)
    mean = sums["color"][Y, X] / SAMPLES
    behind = {"": image[0, 0], "TRANSPARENT": np.zeros(3), "BACKGROUND_IMAGE": inside(image)}
    want = mean[..., :3] + (1 - mean[..., 3:]) * behind[effect]
    assert inside(rgba)[..., :3] == pytest.approx(want, abs=1e-6)
    assert np.array_equal(inside(rgba)[..., 3], mean[..., 3])
    assert np.array_equal(inside(met), sums["count"][Y, X])
    assert np.abs(want - (mean[..., :3] + (1 - mean[..., 3:]) * 0.5)).max() > 0.01


def test_depth_is_the_mean_over_what_is_covered_and_infinite_where_nothing_is():
    sums, (_, depth, _) = resolved(background=np.zeros(3))
    covered = sums["color"][Y, X, 3] > 0
    assert np.all(np.isinf(inside(depth)[~covered]))
    assert inside(depth)[covered] == pytest.approx(7.0)
    assert 0 < np.count_nonzero(covered) < covered.size


def test_pixels_outside_the_tile_or_the_crop_are_left_alone():
    _, (rgba, depth, met) = resolved(background=np.zeros(3))
    for film, untouched in ((rgba[..., 0], -1), (depth, -1), (met, 777)):
        assert np.all(film[5:] == untouched)
        assert np.all(film[:, 5:] == untouched)
        assert not np.any(inside(film) == untouched)
