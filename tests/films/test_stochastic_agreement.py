"""Point samples and exact time agree, pixel by pixel, and errors fall as they should.

Independent samples: a pixel's mean over N of them has the variance of one over N, and that variance
is known from the analytic film itself, rendered once more with squared colours. So each pixel and
channel gives a z score. Holm's correction for their number begins with the greatest, which
Bonferroni's bound judges: if that one stands, all do.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from support.agreement import (
    SAMPLES,
    SEEDS,
    analytic,
    critical,
    late,
    repeated,
    stochastic,
    welch,
    with_small_lens,
)
from support.hard_cases import CASES, COLORS, SIZE
from support.nightly import nightly

import mbinterval as mb
from mbinterval.plan.sampling import RADII
from mbinterval.scene.model import Scene

NAMED = "interpenetrating meshes"


def squared(of: Scene) -> Scene:
    meshes = [replace(m, color=np.asarray(m.color) ** 2) for m in of.meshes]
    return replace(of, meshes=meshes, background=tuple(np.square(of.background)))


@pytest.fixture(scope="module")
def sampled() -> np.ndarray:
    of = CASES[NAMED].make()
    return np.mean([stochastic(of, seed=k, pattern="random") for k in range(SEEDS)], axis=0)


@pytest.fixture(scope="module")
def expected() -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation of a pixel's mean; those with too few events are left out."""
    of = CASES[NAMED].make()
    mean, second = analytic(of), analytic(squared(of))
    variance = second - mean**2
    variance[..., 3] = mean[..., 3] * (1.0 - mean[..., 3])
    few = variance * SAMPLES * SEEDS < 25 * 0.25
    return mean, np.where(few, np.nan, np.sqrt(np.maximum(variance, 0) / (SAMPLES * SEEDS)))


def test_every_pixel_agrees_with_exact_time(sampled, expected):
    mean, sigma = expected
    z = (sampled - mean) / sigma
    assert np.isfinite(z).sum() > 2000
    assert np.nanmax(np.abs(z)) < critical(sigma)
    assert abs(np.nanstd(z) - 1.0) < 0.1  # no more and no less than chance


def test_a_shutter_moved_by_a_hundredth_is_rejected_with_known_power(sampled, expected):
    mean, sigma = expected
    moved = analytic(late(CASES[NAMED].make(), 0.01))
    z = (sampled - moved) / sigma
    bound = critical(sigma)
    assert np.nanmax(np.abs(z)) > bound
    # Power: the chance that some pixel exceeds the bound, from the true shift of each.
    shift = np.abs((moved - mean) / sigma)[np.isfinite(sigma)]
    keep = stats.norm.cdf(bound - np.sort(shift)[-50:])
    assert 1.0 - keep.prod() > 0.999


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    return analytic(CASES[NAMED].make())


def error(of: Scene, truth: np.ndarray, samples: int, pattern: str) -> float:
    films = [stochastic(of, samples, seed, pattern=pattern) for seed in range(4)]
    return float(np.sqrt(np.mean([np.mean((f - truth)[..., :3] ** 2) for f in films])))


def slope(of: Scene, truth: np.ndarray, pattern: str) -> float:
    counts = np.array([4, 32, 256])
    errors = [error(of, truth, int(n), pattern) for n in counts]
    return float(np.polyfit(np.log(counts), np.log(errors), 1)[0])


@pytest.mark.parametrize(
    ("pattern", "low", "high"),
    [("random", -0.54, -0.46), nightly("jittered", -1.0, -0.55), ("sobol", -1.0, -0.65)],
)
def test_random_samples_converge_by_the_square_root_and_stratified_ones_faster(
    pattern, low, high, truth
):
    of = CASES[NAMED].make()
    assert low < slope(of, truth, pattern) < high
    if pattern == "sobol":
        assert error(of, truth, 32, "sobol") < 0.6 * error(of, truth, 32, "random")


@pytest.mark.parametrize("pattern", ["sobol", "jittered", "fixed", "interleave_uvt"])
def test_every_pattern_has_the_same_mean(pattern, truth):
    of = CASES[NAMED].make()
    if pattern == "fixed":  # the same places as long as there are as many
        truth = mb.render(of, width=SIZE[0], height=SIZE[1],
                          settings=mb.Settings(samples=256)).rgba  # fmt: skip
    film = np.mean([stochastic(of, 256, seed, pattern=pattern) for seed in range(16)], axis=0)
    assert np.sqrt(np.mean((film - truth) ** 2)) < 3e-3
    assert abs((film - truth).mean()) < 2e-4
    control = analytic(late(of, 0.05))
    assert abs((film - control).mean()) > 1e-3 or np.sqrt(np.mean((film - control) ** 2)) > 6e-3


SLICES = {"method": "accumulation", "slices": 4}


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("gaussian", {"pattern": "sobol"}),
        ("triangle", {"pattern": "random"}),
        nightly("mitchell", {"pattern": "interleave_uvt"}),
        nightly("triangle", {"pattern": "sobol"}),
        nightly("mitchell", {"pattern": "sobol"}),
        nightly("mitchell", {"pattern": "jittered"}),
        nightly("gaussian", {"pattern": "fixed"}),
        ("mitchell", SLICES),
        ("gaussian", SLICES | {"slices": 256, "slice_times": "stochastic"}),
    ],
    ids=lambda value: value if isinstance(value, str) else "-".join(map(str, value.values())),
)
def test_every_pattern_has_the_mean_of_the_filter(name, values):
    """Of a picture at rest, whose edges are as wide as the filter."""
    of = CASES[NAMED].make()
    of = replace(of, meshes=[replace(m, positions=m.positions[0]) for m in of.meshes])
    slices = values.get("slices") == 4  # which have the same places in every pixel

    def exact(**given: object) -> np.ndarray:
        places = {"samples": 16} if slices else {"samples": 256, "pattern": "sobol"}
        settings = mb.Settings(**places, **given)
        return mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings).rgba

    samples = 16 if "slices" in values else 1024
    settings = mb.Settings(**{"method": "stochastic", "samples": samples, "filter": name} | values)
    found = mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings).rgba
    narrower = RADII[name] / 1.3
    near = 1e-3 if slices else 7e-3
    assert np.sqrt(np.mean((found - exact(filter=name)) ** 2)) < near
    assert np.sqrt(np.mean((found - exact(filter=name, filter_radius=narrower)) ** 2)) > 0.012


def test_rgss_has_the_mean_of_its_filter():
    """Four fixed places of a pixel and four of its neighbours, each at a quarter of all times."""
    of = CASES["shared edges"].make()
    films = [stochastic(of, 4, seed, pattern="rgss") for seed in range(200)]
    found = np.mean(films, axis=0)
    truth = analytic(of)
    assert np.abs(films[0] - found).max() > 0.05
    assert np.sqrt(np.mean((found - truth)[2:-2, 2:-2] ** 2)) < 0.05
    assert abs((found - truth)[2:-2, 2:-2].mean()) < 3e-3
    assert COLORS.shape[1] == 3


@pytest.mark.parametrize("lens", [True, nightly(False)])
def test_nets_agree_with_exact_time_pixel_by_pixel_and_a_late_shutter_does_not(lens):
    of = CASES[NAMED].make()
    of = with_small_lens(of) if lens else of
    nets = repeated(of, 300, method="stochastic", samples=16)
    exact = {"samples": 32, "pattern": "sobol"}
    t, bound = welch(nets, repeated(of, 24, **exact), (300, 24))
    assert np.isfinite(t).sum() > 1500
    assert np.nanmax(np.abs(t) / bound) < 1.0
    assert abs(np.nanstd(t) - 1.0) < 0.1
    t, bound = welch(nets, repeated(late(of, 0.01), 24, **exact), (300, 24))
    assert np.nanmax(np.abs(t) / bound) > 1.0
