"""Stage "scatter": samples of a tile's pixels in time, on the lens and in place, slab by slab."""

from __future__ import annotations

import numpy as np
import pytest
from support.kernels import POINT_SIZES, numbers, options, run
from support.point_samples import by_pixel
from support.sample_places import one_in_each, square_of_disc

from mbinterval.device import records

TILE = 16
CORNERS = [(0, 0), (16368, 16), (32, 16368), (4080, 2160)]
"""Of four tiles: 1,024 pixels."""


def scattered(
    corner: tuple[int, int], samples: int, seed: int = 0, frame: tuple[int, int] = (16384, 16384)
) -> dict[str, np.ndarray]:
    """Arrays ``(N, 16, 16)``: x, y within pixels, t, u, v, depth, owner."""
    count = samples * TILE * TILE
    told = numbers(samples=samples, layers=samples, seed=seed, width=frame[0], height=frame[1])
    arrays = [np.zeros(count, np.float32) for _ in range(6)]
    given = [np.zeros(1, records.SLOT), np.zeros(1, np.float32), np.zeros(1, records.SHUTTER_KEY),
             told, *np.int32(corner), *arrays, np.zeros(count, np.uint32)]  # fmt: skip
    defines = options("STOCHASTIC", "MOVING", "LENS", "PATTERN_SOBOL", "REORDERED", **POINT_SIZES)
    found = run("scatter.cl", "scatter_tile", given, defines)[3:]
    result = dict(zip(("x", "y", "t", "u", "v", "z", "owner"), map(by_pixel, found), strict=True))
    row, column = np.indices((TILE, TILE))
    result["x"], result["y"] = result["x"] + 8 - column, result["y"] + 8 - row
    return result


def in_all(samples: int) -> dict[str, np.ndarray]:
    """The same of all tiles, ``(1024, N)``."""
    parts = [scattered(corner, samples) for corner in CORNERS]
    return {name: np.concatenate([p[name].reshape(samples, -1).T for p in parts])
            for name in parts[0]}  # fmt: skip


@pytest.mark.parametrize("samples", [1, 3, 16, 64])
def test_samples_are_stratified_in_time_and_on_the_lens(samples):
    found = in_all(samples)
    assert np.all(one_in_each(found["t"], 1e-4))
    assert np.all((found["t"] >= 0) & (found["t"] < 1))
    lens = np.stack([found["u"], found["v"]], axis=-1)
    assert np.all(np.hypot(found["u"], found["v"]) <= 1 + 1e-6)
    square = square_of_disc(lens)
    for name in "xy":
        assert np.all((found[name] > -1e-6) & (found[name] < 1 + 1e-6))
    assert np.all(np.isinf(found["z"]))
    assert np.all(found["owner"] == records.NONE)
    if samples & (samples - 1) == 0:
        for values in (square[..., 0], square[..., 1], found["x"], found["y"]):
            assert np.mean(one_in_each(values, 1e-3 * samples)) > 0.99
    if samples == 64:  # boxes of time and lens, of volume 1/64 each
        for parts in ((4, 4, 4), (8, 4, 2), (2, 1, 32), (16, 2, 2)):
            at = np.stack([found["t"], square[..., 0], square[..., 1]], axis=-1)
            box = np.floor(at * parts).clip(0, np.array(parts) - 1) @ [1, 100, 10000]
            assert np.mean([len(np.unique(each)) == 64 for each in box]) > 0.95


def test_pixels_differ_and_are_the_same_in_any_frame_and_for_no_other_seed():
    found = in_all(16)
    assert len(np.unique(found["t"][:, 0])) > 1000
    here, other = (scattered((0, 0), 16, seed) for seed in (3, 4))
    again = scattered((0, 0), 16, 3, (640, 401))
    for name in "xytuv":
        assert np.array_equal(here[name], again[name])
        assert np.mean(here[name] == other[name]) < 0.01


def test_slabs_hold_samples_that_are_alike_in_time_and_on_the_lens():
    """The order within a pixel puts them so: in a slab they spread less than anyhow."""
    found = scattered((4080, 2160), 64)
    for name in "tuv":
        assert found[name].std(axis=(1, 2)).mean() < 0.9 * found[name].std()
    # All of a pixel's samples are there still.
    assert np.all(one_in_each(found["t"].reshape(64, -1).T, 1e-4))
