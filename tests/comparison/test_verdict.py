"""The statistical verdict: its parts against SciPy, its false alarms and power by simulation."""

import numpy as np
import pytest
from scipy import stats
from support.nightly import nightly

from mbinterval.comparison.distributions import fisher_above, holm, student_two_sided
from mbinterval.comparison.verdict import Repeats, judge

SIZE = (32, 48)


def bernoulli(rng, probability, samples, repeats, shared=False):
    """Repeats of an image whose pixels see white with ``probability``, else black."""
    if shared:  # the same random number for all pixels of a sample
        numbers = rng.random((repeats, samples, 1, 1, 1))
        images = (numbers < probability).mean(axis=1)
    else:
        images = rng.binomial(samples, probability, (repeats, *probability.shape)) / samples
    return Repeats([image.astype(np.float32) for image in images], samples, shared)


@pytest.fixture(scope="module")
def coverage():
    """Coverage ``(H, W, 3)`` from none over one in a million to full: rare events everywhere."""
    exponent = np.linspace(-6.5, 0.0, SIZE[1])
    row = np.where(exponent < -6, 0.0, 10.0**exponent)
    rows = np.tile(row[:, None], (SIZE[0], 1, 3))
    return np.concatenate([rows[: SIZE[0] // 2], 1.0 - rows[SIZE[0] // 2 :]])


@pytest.mark.parametrize("degrees", [1, 2, 3, 4, 7, 8, 15, 30, 63])
def test_students_t_is_scipys(degrees):
    t = np.array([0.0, 0.1, 1.0, 2.5, 6.0, 15.0, 40.0, 1e4, np.inf])
    expected = 2 * stats.t.sf(t, degrees)
    np.testing.assert_allclose(student_two_sided(t, degrees), expected, atol=1e-14)


@pytest.mark.parametrize(
    ("value", "first", "second"),
    [(1.0, 1.0, 15.0), (50.0, 1.0, 1.0), (3.0, 10.5, 150.2), (1.05, 2e4, 3e5), (0.98, 2e5, 3e6),
     (0.0, 3.0, 4.0), (1e9, 2.0, 3.0)],
)  # fmt: skip
def test_fishers_f_is_scipys(value, first, second):
    expected = stats.f.sf(value, first, second)
    assert fisher_above(value, first, second) == pytest.approx(expected, rel=1e-8)


def test_holms_correction_is_scipys_bonferroni_step_by_step():
    p_values = np.array([0.02, 0.001, 0.04, 0.9, 0.001, 0.015])
    # By hand: 6 * 0.001, 5 * 0.001, 4 * 0.015, 3 * 0.02, 2 * 0.04, 1 * 0.9, never decreasing.
    expected = [0.06, 0.006, 0.08, 0.9, 0.006, 0.06]
    np.testing.assert_allclose(holm(p_values), expected)


def test_without_repeats_that_differ_there_is_no_verdict(coverage):
    one = Repeats([coverage])
    assert judge(one, Repeats([coverage + 0.1])) is None
    assert judge(one, Repeats([coverage + 0.1] * 5)) is None


LEVEL = 0.05
TRIALS = 60
MOST = int(stats.binom.ppf(0.999, TRIALS, LEVEL))  # false alarms that the level allows


@pytest.mark.parametrize(
    ("samples", "repeats", "other", "shared"),
    [(1, 16, None, False), nightly(16, 16, None, False), (256, 8, None, False),
     (16, 16, 16, False), nightly(64, 4, 32, False), (16, 16, None, True),
     nightly(4, 64, None, False)],
)  # fmt: skip
def test_false_alarms_are_no_more_than_the_level(coverage, samples, repeats, other, shared):
    """Also for events that are rarer than samples, where the estimated variance is 0."""
    alarms = 0
    for seed in range(TRIALS):
        rng = np.random.default_rng([seed, samples, repeats])
        image = bernoulli(rng, coverage, samples, repeats, shared)
        truth = bernoulli(rng, coverage, 64, other) if other else Repeats([coverage])
        alarms += not judge(image, truth, LEVEL).explained
    assert alarms <= MOST, f"{alarms} of {TRIALS}"


def test_false_alarms_with_normal_noise_tied_between_pixels():
    alarms = 0
    for seed in range(TRIALS):
        rng = np.random.default_rng(seed)
        noise = rng.normal(0, 0.01, (12, *SIZE, 3)) + rng.normal(0, 0.02, (12, 1, 1, 1))
        verdict = judge(Repeats(list(noise), 10**6), Repeats([np.zeros((*SIZE, 3))]), LEVEL)
        alarms += not verdict.explained
    assert alarms <= MOST, f"{alarms} of {TRIALS}"


def test_without_the_allowance_for_rare_events_the_level_would_not_hold(coverage):
    """The negative control of the test above: told of more samples than there are."""
    alarms = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        image = Repeats(bernoulli(rng, coverage, 16, 16).images, samples=10**9)
        alarms += not judge(image, Repeats([coverage]), LEVEL).explained
    assert alarms > 5


@pytest.mark.parametrize("size", [nightly(1), 8, nightly(SIZE[1])])
def test_a_difference_as_large_as_stated_is_found_nine_times_of_ten(size):
    """And one of a tenth of it hardly ever."""
    sigma, found, small = 0.02, 0, 0
    truth = Repeats([np.full((*SIZE, 3), 0.5)])
    place = (slice(8, 8 + size), slice(24, 24 + size), 1) if size < 16 else (..., 1)
    for seed in range(100):
        rng = np.random.default_rng(seed)
        noise = rng.normal(0.5, sigma, (16, *SIZE, 3))
        detectable = judge(Repeats(list(noise), 10**6), truth, LEVEL).detectable[size]
        for part in (1.0, 0.1):
            images = noise.copy()
            images[(slice(None), *place)] += part * detectable
            verdict = judge(Repeats(list(images), 10**6), truth, LEVEL)
            if part == 1.0:
                found += not verdict.explained
            else:
                small += not verdict.explained
    assert found >= 82  # the 0.5 % quantile of 100 trials at 90 %
    assert small <= 15


def test_the_verdict_names_the_pixels(coverage):
    rng = np.random.default_rng(1)
    image = bernoulli(rng, coverage, 64, 16)
    for values in image.images:
        values[5:9, 33:38, 0] = 0.9
    verdict = judge(image, Repeats([coverage]))
    expected = np.zeros(SIZE, bool)
    expected[5:9, 33:38] = np.abs(coverage[5:9, 33:38, 0] - 0.9) > 0.1
    assert not verdict.explained
    assert np.array_equal(verdict.pixels, expected)
    assert expected.sum() == 20
    first = verdict.regions[0]
    assert (first.column, first.row, first.size) == (32, 0, 8)
    assert "20 x one pixel" in str(verdict)


def test_a_faint_tint_shows_in_averages_only(coverage):
    image = bernoulli(np.random.default_rng(2), coverage, 64, 16)
    tinted = Repeats([values * 1.01 for values in image.images], 64)
    assert judge(image, Repeats([coverage])).explained
    verdict = judge(tinted, Repeats([coverage]))
    assert not verdict.explained
    assert max(region.size for region in verdict.regions) >= 8


def test_equal_but_for_rounding_is_explained(coverage):
    image = bernoulli(np.random.default_rng(3), coverage, 4, 8)
    assert judge(image, Repeats([v + np.float32(3e-7) for v in image.images], 4)).p_value == 1.0
