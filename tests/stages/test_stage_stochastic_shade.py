"""Stage "shade" of point sampling: colours of samples, one by one or once for all of a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from reference.rays import at_time, see
from support.kernels import POINT_SIZES, numbers, one_material, options, run, vertices_of
from support.stage_lists import around

from mbinterval.device import records

SLABS, PIXELS = 4, 256
SAMPLES = SLABS * PIXELS
CORNER = (2000, 1072)
MIDDLE = np.array(CORNER) + 8.0


@dataclass(frozen=True, eq=False)
class Case:
    """Samples slab by slab, and what each sees: one path for all of a pixel, or one of its own.

    ``place`` ``(S, 2)`` from the tile's middle and ``t`` ``(S,)``, float32; ``owner`` ``(S,)`` of
    paths ``points`` ``(S, 2, 3, 3)``, with ``base`` ``(S, 3)`` and ``corner`` ``(2, S, 3, 3)``
    colours; ``seen`` ``(S,)`` whether they see anything; ``shared`` ``(pixels,)``.
    """

    place: np.ndarray
    t: np.ndarray
    points: np.ndarray
    base: np.ndarray
    corner: np.ndarray
    flat: np.ndarray
    owner: np.ndarray
    seen: np.ndarray
    shared: np.ndarray
    depth: np.ndarray


def drawn(seed: int) -> Case:
    rng = np.random.default_rng(seed)
    # Each sample of a pixel lies within the same pixel, whatever the order of pixels.
    place = rng.integers(-8, 8, (PIXELS, 2)) + rng.uniform(0, 1, (SLABS, PIXELS, 2))
    place = place.reshape(SAMPLES, 2).astype(np.float32)
    t = rng.choice([0.0, 0.25, 1.0], SAMPLES)
    t = np.where(rng.random(SAMPLES) < 2 / 3, t, rng.random(SAMPLES)).astype(np.float32)
    shared, index = rng.random(PIXELS) < 0.5, np.arange(SAMPLES)
    owner = np.where(np.tile(shared, SLABS), index % PIXELS, index)
    w = rng.uniform(0.5, 2.0, (SAMPLES, 2, 3)) * rng.choice([1e-6, 1.0, 1e6], (SAMPLES, 1, 1))
    w[rng.random(SAMPLES) < 0.3] = 1.0
    still = rng.random(SAMPLES) < 0.3
    w[still, 1] = w[still, 0]
    middle = np.tile(place[:PIXELS] + MIDDLE, (SLABS, 1))
    points = around(rng, middle, w, still)
    wide = points[..., :2] / points[..., 2:] - middle[:, None, None]
    size = np.linalg.norm(wide, axis=-1, keepdims=True)
    wide *= np.maximum(size, 6.0) / size  # about all of the pixel
    points[..., :2] = (middle[:, None, None] + wide) * points[..., 2:]
    flat = rng.random(SAMPLES) < 0.2
    corner = rng.choice([0.0, 0.5, 1.0], (2, SAMPLES, 3, 3)).astype(np.float32)
    corner[:, flat] = 1.0
    still = (points[:, 0] == points[:, 1]).all(axis=(1, 2))
    corner[1, still] = corner[0, still]
    base = rng.choice([0.0, 1.0, 1000.0], (SAMPLES, 3))
    depth = rng.choice([1e-6, 1.0, 1e6], SAMPLES).astype(np.float32)
    seen = rng.random(SAMPLES) < 0.8
    return Case(place, t, points, base, corner, flat, owner, seen, shared, depth)


def shaded(of: Case, *effects: str) -> list[np.ndarray]:
    """Sums over the samples of each pixel: colour with alpha, depth, samples that see anything."""
    paths = np.zeros(SAMPLES, records.PATH)
    for corner, name in enumerate("abc"):
        paths[name] = 3 * np.arange(SAMPLES) + corner
    still = (of.points[:, 0] == of.points[:, 1]).all(axis=(1, 2))
    paths["step"], paths["close"], paths["alpha"] = np.where(still, 0, 3 * SAMPLES), 1.0, 1.0
    paths["color"], paths["mesh"] = of.base, of.flat
    mesh, material = one_material()
    meshes = np.concatenate([mesh, mesh])
    meshes["count"], meshes["color"], meshes["color_step"] = 3 * SAMPLES, [0, records.NONE], 1
    bounds = np.zeros(SAMPLES, records.BOUNDS)
    size = np.abs(of.points).max(axis=(1, 2, 3)) * 4096
    bounds["scale"] = 2.0 ** -np.floor(np.log2(size))
    owner = np.where(of.seen, of.owner, records.NONE).astype(np.uint32)
    sums = [np.zeros((PIXELS, 4), np.float32), np.zeros(PIXELS, np.float32),
            np.zeros(PIXELS, np.uint32)]  # fmt: skip
    arrays = [
        numbers(samples=SLABS, layers=SLABS), vertices_of(of.points.swapaxes(0, 1)), paths, bounds,
        meshes, material, of.corner, *np.int32(CORNER), *of.place.T, of.t, of.depth, owner, *sums,
    ]  # fmt: skip
    defines = options(
        "STOCHASTIC",
        "MOVING",
        "CULL_BBOX",
        "PATTERN_SOBOL",
        "VERTEX_COLOR",
        *effects,
        **POINT_SIZES,
    )
    return run("stochastic_shade.cl", "shade_tile", arrays, defines)[-3:]


def summed(values: np.ndarray) -> np.ndarray:
    return values.reshape(SLABS, PIXELS, *values.shape[1:]).sum(axis=0)


def color_of(of: Case, once: bool) -> np.ndarray:
    """Colour ``(S, 3)`` that each sample sees; ``once`` for all of a pixel that see one path."""
    x, y = (of.place.astype(np.float64) + MIDDLE).T.copy()
    time = of.t.astype(np.float64)
    for values in (x, y, time):
        mean = summed(values * of.seen) / np.maximum(summed(of.seen), 1)
        values.reshape(SLABS, PIXELS)[:, of.shared & once] = mean[of.shared & once]
    _, share, _ = see(at_time(of.points[of.owner], time), x, y)
    part = time[:, None, None]
    now = (1 - part) * of.corner[0, of.owner] + part * of.corner[1, of.owner]
    return of.base[of.owner] * np.einsum("mv,mva->ma", share, now)


@pytest.mark.parametrize("effect", ["", "SHADE_PIXEL"])
@pytest.mark.parametrize("seed", range(2))
def test_a_pixel_has_the_sum_of_the_colours_that_its_samples_see(effect, seed):
    of = drawn(seed)
    rgba, depth, count = shaded(of, *[effect] * bool(effect))
    assert np.array_equal(count, summed(of.seen))
    assert np.array_equal(rgba[:, 3], summed(of.seen))
    assert depth == pytest.approx(summed(of.depth * of.seen), rel=1e-6)
    want = summed(color_of(of, bool(effect)) * of.seen[:, None])
    most = summed(of.base[of.owner].max(axis=1)) + 1.0
    away = np.abs(rgba[:, :3] - want).max(axis=1) / most
    assert away.max() < 2e-3
    assert np.mean(away < 1e-4) > 0.95
    assert np.count_nonzero(want.max(axis=1) > 1e-2 * most) > 100


def test_once_for_a_pixel_is_not_the_same_as_for_each_sample():
    of = drawn(0)
    each, once = shaded(of)[0], shaded(of, "SHADE_PIXEL")[0]
    assert np.any(np.abs(each - once).max(axis=1) > 1.0)
