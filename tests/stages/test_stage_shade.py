"""Stage "shade": colours of spans, averaged over their time and summed into pixels."""

from __future__ import annotations

import numpy as np
import pytest
from support.kernels import numbers, options, run
from support.stage_lists import LAYERS, SAMPLES, TILE
from support.stage_spans import EFFECTS, PIXELS, SIZES, Spans, draw, rests, tables

ERROR = 0.01
INSIDE = np.zeros((TILE, TILE), bool)
INSIDE[: TILE - 2, 1:] = True
"""Pixels of the tile that the wrapper says are rendered."""


def shaded(of: Spans, *effects: str, **told: float) -> tuple[np.ndarray, ...]:
    """Sums over samples ``(256, ...)``: colour with alpha, depth, intervals."""
    met = np.arange(SAMPLES, dtype=np.uint32)
    given = tables(of)
    sums = [np.zeros((PIXELS, 4), np.float32), np.zeros(PIXELS, np.float32),
            np.zeros(PIXELS, np.uint32)]  # fmt: skip
    arrays = [numbers(samples=LAYERS, layers=LAYERS, **told), *given.values(), met, *sums]
    defines = options(*EFFECTS, *effects, **SIZES)
    return tuple(run("shade.cl", "shade_tile", arrays, defines)[-3:])


def summed(of: Spans, color: np.ndarray, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sums over the samples of each pixel of what spans add."""
    sample, stack, _ = of.layers()
    weight = of.share[sample] * of.weight.ravel()[stack]
    pixel = sample % PIXELS
    sums = [np.bincount(pixel, weight * c, PIXELS) for c in [*color.T, depth]]
    return np.stack(sums[:4], axis=1), sums[4]


def scale_of(of: Spans, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sums of magnitudes, by which sums are rounded."""
    sample, _, path = of.layers()
    pixel = sample % PIXELS
    most = np.bincount(pixel, 3.0 * of.base[path].max(axis=1) + 1.0, PIXELS)
    return most[:, None], np.bincount(pixel, 3.0 * np.abs(depth), PIXELS)


@pytest.mark.parametrize("places", [1, 3, 16, 40])
def test_a_pixel_has_the_mean_colour_of_its_spans_at_the_middles_of_n_parts(places):
    of = draw(places, deep=False)
    rgba, depth, met = shaded(of, shading_times=places)
    _, stack, path = of.layers()
    t0, t1 = of.t.reshape(-1, 2)[stack].T
    color = of.mean_color(path, t0, t1, places)
    mean = of.mean_depth(path, t0, t1)
    want, want_depth = summed(of, np.column_stack([color, np.ones(len(path))]), mean)
    size, deep = scale_of(of, mean)
    inside = INSIDE.ravel()
    assert np.all(np.abs(rgba - want)[inside] <= 2e-5 * size[inside])
    assert np.all(np.abs(depth - want_depth)[inside] <= 3e-7 * deep[inside])
    _, in_middle = summed(of, np.zeros((len(path), 4)), of.depth(path, 0.5 * (t0 + t1)))
    assert np.any(np.abs(depth - in_middle)[inside] > 1e-3 * deep[inside])
    assert np.array_equal(met[inside], np.arange(SAMPLES).reshape(-1, PIXELS).sum(0)[inside])
    for untouched in (rgba, depth, met):
        assert np.all(untouched[~inside] == 0)
    assert np.count_nonzero(np.abs(want) > 1e-3 * size) > 300
    later = of.mean_color(path, t0 + 0.01 * (t1 - t0), t1, places)
    shifted, _ = summed(of, np.column_stack([later, np.ones(len(path))]), mean)
    assert np.any(np.abs(rgba - shifted)[inside] > 2e-5 * size[inside])


def test_stacks_are_blended_front_to_back_and_as_exact_as_asked_for():
    of = draw(9, deep=True)
    rgba, depth, _ = shaded(of, "TRANSLUCENT", "SHADING_ERROR", shading_error=ERROR)
    _, stack, path = of.layers()
    t0, t1 = of.t.reshape(-1, 2)[stack].T
    part = rests(of) * of.alpha[path]
    color = np.column_stack([of.mean_color(path, t0, t1, 240), np.ones(len(path))])
    mean = of.mean_depth(path, t0, t1)
    want, want_depth = summed(of, part[:, None] * color, part * mean)
    size, deep = scale_of(of, mean)
    inside = INSIDE.ravel()
    # Four samples of two stacks, each of which may be wrong by so much.
    assert np.all(np.abs(rgba - want)[inside] <= 8 * 2.25 * ERROR + 2e-5 * size[inside])
    assert np.abs(rgba - want)[inside][:, 3].max() < 1e-4
    assert np.all(np.abs(depth - want_depth)[inside] <= 3e-7 * deep[inside])
    assert np.count_nonzero(of.size > 2) > 500
