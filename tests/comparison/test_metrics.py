"""The metrics against closed forms, and against other implementations of the same papers."""

import math

import flip_evaluator
import numpy as np
import pytest
from skimage import metrics as other

from mbinterval.comparison import metrics
from mbinterval.errors import UsageError
from mbinterval.files.images import linear_to_srgb


@pytest.fixture(scope="module")
def pair():
    """An image with structure, HDR values and blacks, and the same with noise and a blur."""
    rng = np.random.default_rng(3)
    rows, columns = np.mgrid[:61, :83] / 20.0
    reference = np.stack([np.sin(rows) ** 2, np.cos(columns) ** 4, rows * columns / 4], axis=2)
    image = 0.5 * (reference + np.roll(reference, 1, 1)) + rng.normal(0, 0.03, reference.shape)
    return image, reference


def test_of_equal_images_every_metric_is_at_its_best(pair):
    _image, reference = pair
    best = {"rmse": 0, "relative_mse": 0, "mae": 0, "psnr": math.inf, "ssim": 1, "flip": 0}
    for name, value in best.items():
        assert getattr(metrics, name)(reference, reference) == pytest.approx(value, abs=1e-7)


def test_a_constant_shift_has_closed_forms():
    reference = np.full((20, 30, 3), 0.5)
    image = reference + 0.01
    assert metrics.rmse(image, reference) == pytest.approx(0.01, rel=1e-12)
    assert metrics.mae(image, reference) == pytest.approx(0.01, rel=1e-12)
    assert metrics.psnr(image, reference) == pytest.approx(40.0, rel=1e-12)
    assert metrics.relative_mse(image, reference) == pytest.approx(1e-4 / 0.26, rel=1e-12)
    x, y = linear_to_srgb(0.51), linear_to_srgb(0.5)
    similar = (2 * x * y + 1e-4) / (x * x + y * y + 1e-4)
    assert metrics.ssim(image, reference) == pytest.approx(similar, rel=1e-6)


def test_known_noise_has_its_standard_deviation():
    noise = np.random.default_rng(0).normal(0, 0.05, (200, 300, 3))
    zero = np.zeros_like(noise)
    spread = 4 / math.sqrt(noise.size)  # four standard errors, relative
    assert metrics.rmse(noise, zero) == pytest.approx(0.05, rel=spread)
    assert metrics.mae(noise, zero) == pytest.approx(0.05 * math.sqrt(2 / math.pi), rel=spread)
    assert metrics.relative_mse(noise, zero) == pytest.approx(0.0025 / 0.01, rel=2 * spread)


def test_colours_are_neither_clipped_nor_encoded():
    """8 against 4, and -1 against 1, count in full."""
    image, reference = np.full((2, 2, 3), 8.0), np.full((2, 2, 3), 4.0)
    image[0], reference[0] = -1.0, 1.0
    assert metrics.rmse(image, reference) == pytest.approx(math.sqrt((4 + 16) / 2))
    assert np.allclose(metrics.rms_map(image, reference), [[2, 2], [4, 4]])


def test_the_metrics_agree_with_scikit_image(pair):
    image, reference = pair
    assert metrics.rmse(image, reference) ** 2 == pytest.approx(
        other.mean_squared_error(reference, image), rel=1e-12
    )
    assert metrics.psnr(image, reference) == pytest.approx(
        other.peak_signal_noise_ratio(reference, image, data_range=1.0), rel=1e-12
    )
    theirs, their_map = other.structural_similarity(
        linear_to_srgb(reference), linear_to_srgb(image), data_range=1.0, channel_axis=2,
        gaussian_weights=True, sigma=1.5, use_sample_covariance=False, full=True,
    )  # fmt: skip
    assert metrics.ssim(image, reference) == pytest.approx(theirs, rel=1e-7)
    np.testing.assert_allclose(
        metrics.ssim_map(image, reference), their_map.mean(axis=2), atol=1e-6
    )
    assert theirs < 0.99  # and it is no comparison of equal images


def test_ssim_needs_a_whole_window():
    small = np.zeros((10, 40, 3))
    assert math.isnan(metrics.ssim(small, small))
    assert metrics.ssim_map(small, small).shape == (10, 40)


def aces(x):
    """Narkowicz's fit of ACES at 0.6 of the exposure, as Andersson et al. 2021 have it."""
    x = 0.6 * x
    return np.clip(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 0, 1)


def test_hdr_flip_is_the_worst_ldr_flip_of_the_fixed_exposures(pair):
    """Their LDR-FLIP of what our own tone mapping makes of the images, exposure by exposure."""
    image, reference = (np.maximum(values, 0).astype(np.float32) for values in pair)
    maps = []
    for stops in np.linspace(*metrics.EXPOSURES):
        shown = (aces(values * 2.0**stops).astype(np.float32) for values in (reference, image))
        maps.append(flip_evaluator.evaluate(*shown, "LDR", inputsRGB=False, applyMagma=False)[0])
    worst = np.max(maps, axis=0)[..., 0]
    np.testing.assert_allclose(metrics.flip_map(image, reference), worst, atol=2e-5)
    assert metrics.flip(image, reference) == pytest.approx(float(worst.mean()), abs=2e-6)
    assert worst.mean() > 0.05


def test_the_exposures_of_flip_do_not_follow_the_image(pair):
    """One bright pixel changes FLIP around it only; with exposures of its own it would not."""
    image, reference = pair
    bright = [values.copy() for values in pair]
    for values in bright:
        values[0, 0] = 1000.0
    far = (slice(40, None), slice(40, None))
    assert np.array_equal(metrics.flip_map(*bright)[far], metrics.flip_map(image, reference)[far])


def test_without_its_package_flip_says_what_to_install(monkeypatch, pair):
    monkeypatch.setattr(metrics.importlib.util, "find_spec", lambda _name: None)
    with pytest.raises(UsageError, match=r"pip install 'mbinterval\[study\]'"):
        metrics.flip(*pair)


def test_flip_takes_values_of_any_layout(pair):
    """Half floats, slices and negative colour: their package reads raw memory."""
    image, reference = pair
    whole = metrics.flip(image, reference)
    strided = [np.repeat(values, 2, axis=1)[:, ::2] for values in pair]
    assert metrics.flip(*strided) == whole
    assert metrics.flip(np.maximum(image, 0), reference) == whole
    assert image.min() < 0
