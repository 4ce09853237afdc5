"""All effects in one scene: exact time agrees with point samples, to the same bytes every time."""

from __future__ import annotations

import numpy as np
import pytest
from support.all_effects import SIZE, everything
from support.kernels import ready_for
from support.nightly import nightly

import mbinterval as mb

COUNTS: dict[str, dict[str, object]] = {
    "analytic": {"pattern": "sobol", "samples": 8},
    "stochastic": {"method": "stochastic", "pattern": "random", "samples": 128},
}


def film(**values: object) -> mb.Film:
    settings = mb.Settings(**{"motion_segments": 2, **values})
    return mb.render(everything(), width=SIZE[0], height=SIZE[1], settings=settings)


def blocks(repeats: int, late: float = 0.0, **values: object) -> np.ndarray:
    """Means over 3 x 3 pixels of renders with other seeds: ``(repeats, 6, 8, 3)``."""
    films = [
        mb.render(
            everything(late), width=SIZE[0], height=SIZE[1],
            settings=mb.Settings(motion_segments=2, seed=seed, **values),
        ).rgba[..., :3].astype(float)
        for seed in range(repeats)
    ]  # fmt: skip
    return np.array(films).reshape(repeats, 6, 3, 8, 3, 3).mean(axis=(2, 4))


def test_it_calls_for_every_effect_of_light_and_surfaces():
    effects = ready_for(everything(), mb.Settings(), *SIZE).plan.effects
    active = {effect.macro for effect in effects if effect.active}
    assert active >= {
        *("MOVING", "LENS", "TRANSLUCENT", "ALPHA_VARIES", "PHONG", "METALLIC"),
        *(
            "EMISSION",
            "FACES_TURN",
            "POINT_LIGHTS",
            "SPOT_LIGHTS",
            "SHADOWS",
            "TEXTURED",
            "MIRRORS",
            "GLOSSY",
        ),
        *("ENVIRONMENT", "SKY", "REFLECTIONS"),
    }


@pytest.mark.parametrize("repeats", [5, nightly(8)])
def test_point_samples_agree_and_tell_a_shutter_that_is_late(repeats):
    points = blocks(repeats, **COUNTS["stochastic"])
    exact = blocks(repeats, **COUNTS["analytic"])
    deviation = np.sqrt((points.var(axis=0, ddof=1) + exact.var(axis=0, ddof=1)) / repeats)
    z = (points.mean(axis=0) - exact.mean(axis=0)) / np.maximum(deviation, 1e-5)
    # Of 144 blocks and channels: one in 500 with 14 degrees of freedom, one in 35 with 8.
    assert np.abs(z).max() < 6.5
    assert np.sqrt(np.mean(z**2)) < 1.6
    moved = blocks(repeats, 0.05, **COUNTS["analytic"]).mean(axis=0)
    assert np.abs((points.mean(axis=0) - moved) / np.maximum(deviation, 1e-5)).max() > 8.0


@pytest.mark.parametrize("method", COUNTS)
def test_tiles_crops_and_repeats_have_the_same_bytes(method):
    whole = film(**COUNTS[method])
    assert film(**COUNTS[method]).rgba.tobytes() == whole.rgba.tobytes()
    x, y, width, height = 5, 3, 13, 11
    part = mb.render(
        everything(), width=SIZE[0], height=SIZE[1], crop=(x, y, width, height),
        settings=mb.Settings(motion_segments=2, **COUNTS[method]),
    )  # fmt: skip
    assert np.array_equal(part.rgba, whole.rgba[y : y + height, x : x + width])
    if method == "analytic":
        small = film(tile_size=8, **COUNTS[method])
        assert small.rgba.tobytes() == whole.rgba.tobytes()
