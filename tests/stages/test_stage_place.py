"""Stage "place": where samples lie in pixels at the ends of large frames, and what they weigh."""

from __future__ import annotations

import numpy as np
import pytest
from support.places import TILE, places, within
from support.sample_places import one_in_each, square_of_disc

import mbinterval as mb
from mbinterval.plan.sampling import filter_of
from mbinterval.scene.model import Camera

CORNERS = [(0, 0), (16368, 16), (32, 16368), (4080, 2160)]
"""Of four tiles: 1,024 pixels."""

LENS = Camera(f_stop=2.0, focus_distance=3.0)


def in_all(settings: mb.Settings, camera: Camera | None = None) -> tuple[np.ndarray, ...]:
    """Places relative to pixels ``(1024, N, 2)``, points of the lens, and weights ``(1024, N)``."""
    at, lens, weights = [], [], []
    for corner in CORNERS:
        found, weight = places(settings, corner, camera)
        at.append(within(found, corner).reshape(TILE * TILE, -1, 2))
        lens.append(found[..., 2:].reshape(TILE * TILE, -1, 2))
        weights.append(weight.reshape(TILE * TILE, -1))
    return np.concatenate(at), np.concatenate(lens), np.concatenate(weights)


@pytest.mark.parametrize("samples", [1, 2, 3, 16, 17, 64])
def test_samples_of_a_pixel_lie_in_rows_and_columns_of_their_own(samples):
    at, _, weights = in_all(mb.Settings(pattern="sobol", samples=samples))
    slack = 1e-3 * samples  # of float32 places in a frame of 16384 pixels
    assert np.all(one_in_each(at[..., 1], slack))
    assert np.all((at > -1e-3) & (at < 1 + 1e-3))
    if samples & (samples - 1) == 0:
        assert np.all(one_in_each(at[..., 0], slack))
        for rows in [2**k for k in range(1, 6) if 2**k < samples]:  # boxes of any shape
            box = np.floor(at[:256] * [samples // rows, rows]) @ [1, 1000]
            whole = [len(np.unique(each)) == samples for each in box]
            assert np.mean(whole) > 0.98  # float32 takes a few over an edge
    assert np.all(weights == 1.0)
    order = np.argsort(at[..., 1], axis=1)
    assert np.all(order == np.arange(samples))  # the l-th lies in row l
    assert np.std(at[:, 0], axis=0) == pytest.approx([1 / 12**0.5, 1 / samples / 12**0.5], rel=0.1)


def test_points_of_the_lens_are_spread_evenly_over_the_disc():
    _, lens, _ = in_all(mb.Settings(pattern="sobol", samples=16), LENS)
    assert np.all(np.hypot(*np.moveaxis(lens, -1, 0)) <= 1 + 1e-6)
    square = square_of_disc(lens)
    for axis in (0, 1):
        assert np.all(one_in_each(square[..., axis], 1e-4))
    boxes = np.floor(square * 4 - 1e-9).clip(0, 3) @ [1, 10]
    assert np.mean([len(np.unique(each)) == 16 for each in boxes]) > 0.99
    assert np.abs(square.reshape(-1, 2).mean(axis=0) - 0.5).max() < 2e-3


def test_a_fixed_pattern_is_the_same_in_every_pixel_and_its_lens_is_not():
    at, lens, _ = in_all(mb.Settings(pattern="fixed", samples=16), LENS)
    assert np.abs(at - at[0]).max() < 1e-3
    assert np.ptp(lens, axis=0).min() > 1.5


@pytest.mark.parametrize("name", ["gaussian", "mitchell"])
def test_a_filter_moves_the_samples_of_the_box_and_its_weights_add_up(name):
    box, _, _ = in_all(mb.Settings(pattern="sobol", samples=17))
    settings = mb.Settings(pattern="sobol", samples=17, filter=name)
    at, _, weights = in_all(settings)
    shape = filter_of(settings)
    table = np.asarray(shape.table, np.float64)
    # Near the frame's corner float32 places are exact enough to be put through the table here.
    want = np.interp(box[:256], np.linspace(0, 1, len(table)), table)
    assert at[:256] == pytest.approx(want, abs=2e-5 * np.ptp(table) + 2e-6)
    assert weights.sum(axis=1) == pytest.approx(np.full(len(weights), 17.0), abs=1e-4)
    if name == "gaussian":
        assert np.all(weights == 1.0)
        return
    away = np.abs(at - 0.5)
    sign = np.where((away[..., 0] > shape.zero) == (away[..., 1] > shape.zero), 1.0, -1.0)
    edge = (np.abs(away - shape.zero) < 2e-3).any(axis=(1, 2))
    signed = shape.mass**2 * sign  # in x and in y
    even = signed + (1.0 - signed.mean(axis=1, keepdims=True))
    assert weights[~edge] == pytest.approx(even[~edge], abs=1e-4)
    assert np.count_nonzero(sign < 0) > 1000
