"""Stage "resolve" of point sampling: sums over samples become the film's pixels."""

from __future__ import annotations

import numpy as np
import pytest
from support.kernels import POINT_SIZES, numbers, options, run
from support.point_samples import by_pixel

from mbinterval.device import records

TILE, SAMPLES = 16, 8
BOXES = [(0, 0, 16, 16), (5, 9, 7, 6), (15, 0, 1, 16), (0, 3, 16, 1)]
"""Column, row, width and height, in the tile, of the pixels that are in the film."""


def resolved(
    box: tuple[int, ...], *effects: str, told: dict[str, float] | None = None
) -> tuple[dict[str, np.ndarray], list[np.ndarray], np.ndarray]:
    """Sums of the tile's pixels, ``(16, 16, ...)``, the film, and its background."""
    rng = np.random.default_rng(box[0])
    pixels = TILE * TILE
    cover = rng.choice([0.0, SAMPLES, 2.0], pixels)
    cover = np.where(rng.random(pixels) < 2 / 3, cover, rng.integers(0, SAMPLES, pixels))
    signs = rng.integers(-SAMPLES, SAMPLES + 1, pixels)
    color = rng.choice([0.0, 1.0, 1e4], (pixels, 3)) * cover[:, None]
    sums = {
        "color": np.column_stack([color, cover]), "depth": rng.choice([1e-6, 1, 1e6]) * cover,
        "count": cover, "signed_color": np.column_stack([0.5 * color, signs]),
        "signed_depth": 3.0 * signs, "signs": signs,
    }  # fmt: skip
    sums = {name: value.astype(np.uint32 if name == "count" else np.float32)
            for name, value in sums.items()}  # fmt: skip
    x, y, width, height = box
    film = (1000 + x - 3, 48 + y - 2, width + 5, height + 4)  # wider than the tile's part
    back = rng.uniform(0, 1, (film[3], film[2], 3)).astype(np.float32)
    frame = records.pack("Frame", **dict(zip(("x", "y", "width", "height"), film, strict=True)),
                         background=(0.25, 0.5, 1.0))  # fmt: skip
    shape = film[3], film[2]
    out = [np.full((*shape, 4), -1, np.float32), np.full(shape, -1, np.float32),
           np.full(shape, 777, np.uint32)]  # fmt: skip
    arrays = [numbers(samples=SAMPLES, **(told or {})), frame, *np.int32([1000, 48]),
              *np.int32([x, x + width, y, y + height]), *sums.values(), back, *out]  # fmt: skip
    defines = options("STOCHASTIC", "CULL_BBOX", "PATTERN_SOBOL", *effects, **POINT_SIZES)
    found = run("stochastic_resolve.cl", "resolve_tile", arrays, defines)[-3:]
    outside = np.ones(shape, bool)
    outside[2 : 2 + height, 3 : 3 + width] = False
    for value, untouched in zip(found, (-1, -1, 777), strict=True):
        assert np.all(value[outside] == untouched)
    kept = [value[2 : 2 + height, 3 : 3 + width] for value in found]
    return {name: in_rows(v)[y : y + height, x : x + width] for name, v in sums.items()}, kept, back


def in_rows(values: np.ndarray) -> np.ndarray:
    """From blocks of 4 x 4 pixels to rows ``(16, 16, ...)``."""
    flat = values.reshape(TILE * TILE, -1)
    rows = np.stack([by_pixel(column)[0] for column in flat.T], axis=-1)
    return rows.reshape(TILE, TILE, *values.shape[1:])


@pytest.mark.parametrize("box", BOXES)
@pytest.mark.parametrize("effect", ["", "BACKGROUND_IMAGE"])
def test_a_pixel_is_the_mean_of_its_samples_over_the_background(effect, box):
    sums, (rgba, depth, seen), back = resolved(box, *[effect] * bool(effect))
    mean = sums["color"] / SAMPLES
    _, _, width, height = box
    behind = back[2 : 2 + height, 3 : 3 + width] if effect else np.array([0.25, 0.5, 1.0])
    want = mean[..., :3] + (1 - mean[..., 3:]) * behind
    assert rgba[..., :3] == pytest.approx(want, rel=1e-6, abs=1e-6)
    assert np.array_equal(rgba[..., 3], mean[..., 3])
    assert np.array_equal(seen, sums["count"])
    covered = sums["color"][..., 3] > 0
    assert np.all(np.isinf(depth[~covered]))
    want = sums["depth"][covered] / sums["color"][covered, 3]
    assert depth[covered] == pytest.approx(want, rel=1e-6)


def test_samples_weigh_the_filters_mass_times_their_sign_and_all_together_their_number():
    mass = 1.375
    sums, (rgba, _, _), _ = resolved(BOXES[0], "WEIGHTED", told={"filter_mass": mass})
    lacking = 1.0 - mass * sums["signs"] / SAMPLES
    want = (mass * sums["signed_color"] + lacking[..., None] * sums["color"]) / SAMPLES
    assert rgba[..., 3] == pytest.approx(want[..., 3], rel=1e-5, abs=1e-5)
    want = want[..., :3] + (1 - want[..., 3:]) * [0.25, 0.5, 1.0]
    assert rgba[..., :3] == pytest.approx(want, rel=1e-5, abs=1e-2)
