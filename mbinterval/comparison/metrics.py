"""How far an image is from a reference: the numbers of a comparison, and their maps.

Images are ``(H, W, 3)`` arrays of scene-linear Rec.709 colour. RMSE, relative MSE, MAE and PSNR
are over linear values that are not clipped, all pixels and channels alike. SSIM and FLIP are about
what people see: SSIM of the sRGB curve clipped to [0, 1], HDR-FLIP at the fixed `EXPOSURES`.

SSIM is written out, since scikit-image would bring SciPy to the core; the tests hold it to that.
"""

from __future__ import annotations

import importlib
import importlib.util
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import UsageError
from mbinterval.files.images import linear_to_srgb

Array = NDArray[np.floating[Any]]

RELATIVE_OFFSET = 0.01
"""Added to the squared reference in the relative MSE, so that black divides by something."""

EXPOSURES = (-2.0, 2.0, 3)
"""Exposures of HDR-FLIP in stops: first, last, and how many.

They are the same for every image. Left alone, FLIP takes them from the reference, and then the
figures of two references cannot be compared.
"""

PIXELS_PER_DEGREE = 67.02064514160156
"""Of FLIP: a display 3840 pixels and 0.7 m wide, seen from 0.7 m, its authors' default."""

_WINDOW = 5  # pixels either side of the centre of SSIM's window
_SIGMA = 1.5
_C1, _C2 = 0.01**2, 0.03**2


def rmse(image: Array, reference: Array) -> float:
    """Root of the mean squared difference."""
    return math.sqrt(float(np.mean(_difference(image, reference) ** 2)))


def relative_mse(image: Array, reference: Array) -> float:
    """Mean of the squared difference over the squared reference plus `RELATIVE_OFFSET`.

    As Rousselle et al. 2011 have it (Adaptive sampling and reconstruction, section 6).
    """
    squared = np.asarray(reference, np.float64) ** 2
    return float(np.mean(_difference(image, reference) ** 2 / (squared + RELATIVE_OFFSET)))


def mae(image: Array, reference: Array) -> float:
    """Mean absolute difference."""
    return float(np.mean(np.abs(_difference(image, reference))))


def psnr(image: Array, reference: Array) -> float:
    """Peak signal-to-noise ratio in dB for a peak of 1; infinite for equal images."""
    error = rmse(image, reference)
    return math.inf if error == 0.0 else -20.0 * math.log10(error)


def rms_map(image: Array, reference: Array) -> NDArray[np.float32]:
    """``(H, W)``: root mean square of the channels' differences at each pixel."""
    mean = np.mean(_difference(image, reference) ** 2, axis=2)
    return np.asarray(np.sqrt(mean), np.float32)


def ssim(image: Array, reference: Array) -> float:
    """Mean structural similarity, 1 for equal images; NaN below 11 pixels in width or height.

    Wang et al. 2004 with their constants: an 11 x 11 Gaussian window of standard deviation 1.5,
    K1 = 0.01, K2 = 0.03, a range of 1; the mean over the channels of the sRGB-encoded images and
    the pixels whose window lies inside.
    """
    inner = ssim_map(image, reference)[_WINDOW:-_WINDOW, _WINDOW:-_WINDOW]
    return float(np.mean(inner, dtype=np.float64)) if inner.size else math.nan


def ssim_map(image: Array, reference: Array) -> NDArray[np.float32]:
    """``(H, W)``: structural similarity at each pixel; the image is mirrored at its edges."""
    x, y = linear_to_srgb(image), linear_to_srgb(reference)
    mean_x, mean_y = _blurred(x), _blurred(y)
    var_x = _blurred(x * x) - mean_x**2
    var_y = _blurred(y * y) - mean_y**2
    covariance = _blurred(x * y) - mean_x * mean_y
    above = (2.0 * mean_x * mean_y + _C1) * (2.0 * covariance + _C2)
    below = (mean_x**2 + mean_y**2 + _C1) * (var_x + var_y + _C2)
    return np.asarray(np.mean(above / below, axis=2), np.float32)


def flip(image: Array, reference: Array) -> float:
    """Mean HDR-FLIP, 0 for equal images, at most 1. Raises as `flip_map` does."""
    return float(np.mean(flip_map(image, reference), dtype=np.float64))


def flip_map(image: Array, reference: Array) -> NDArray[np.float32]:
    """``(H, W)``: HDR-FLIP at each pixel (Andersson et al. 2021), by its authors' package.

    The largest LDR-FLIP of the `EXPOSURES`, with the ACES tone mapper. Negative colour, which FLIP
    does not know, is taken as 0.

    Raises
    ------
    UsageError
        Where the package flip-evaluator is not installed.
    """
    if not has_flip():
        raise UsageError("FLIP: its package is missing; pip install 'mbinterval[study]'")
    package: Any = importlib.import_module("flip_evaluator")
    first, last, count = EXPOSURES
    parameters = {"startExposure": first, "stopExposure": last, "numExposures": count}
    pixels, _mean, _parameters = package.evaluate(
        *(np.maximum(values, 0.0).astype(np.float32, order="C") for values in (reference, image)),
        "HDR",
        inputsRGB=False,
        applyMagma=False,
        computeMeanError=False,
        parameters={**parameters, "ppd": PIXELS_PER_DEGREE, "tonemapper": "ACES"},
    )
    return np.asarray(pixels, np.float32)[..., 0]


def has_flip() -> bool:
    """Whether FLIP's package, of the extra ``study``, is installed."""
    return importlib.util.find_spec("flip_evaluator") is not None


def _difference(image: Array, reference: Array) -> NDArray[np.float64]:
    return np.asarray(image, np.float64) - np.asarray(reference, np.float64)


def _blurred(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Gaussian average over SSIM's window, along both axes, mirrored at the edges."""
    offsets = np.arange(-_WINDOW, _WINDOW + 1)
    weights = np.exp(-0.5 * (offsets / _SIGMA) ** 2)
    weights /= weights.sum()
    for axis in (0, 1):
        length = values.shape[axis]
        margins = [(0, 0)] * values.ndim
        margins[axis] = (_WINDOW, _WINDOW)
        padded = np.moveaxis(np.pad(values, margins, mode="symmetric"), axis, 0)
        total = sum(w * padded[i : i + length] for i, w in enumerate(weights))
        values = np.moveaxis(np.asarray(total), 0, axis)
    return values
