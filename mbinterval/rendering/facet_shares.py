"""What facets reflect of light that is the same from everywhere, as the kernels look it up.

GGX's facets, masked on both ways by Smith's term, and Schlick's approximation of Fresnel's, as in
``cl/shared/shading.h``. Between cosines of 0 and of some alphas white facets reflect less than at
0 and than beyond: so half of the table's columns are for that, whatever alpha is.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from mbinterval.layout.appearance import LEAST_ROUGHNESS

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

SHARES = (96, 192)
"""Rows, of roughness, and columns, of cosines (``cl/shared/environment.h``)."""
_BEFORE, _BEYOND, _AROUND = 8, 24, 12
"""Places of the quadrature over facets, near the normal and beyond, and around it."""
_LEAST_COSINE = 1e-9
_COSINES = 2001
"""That the columns' places are found between."""


def roughness_of_rows() -> Float64:
    """``(SHARES[0],)``: the finer the smoother."""
    part = np.linspace(0.0, 1.0, SHARES[0])
    return np.asarray(LEAST_ROUGHNESS + (1.0 - LEAST_ROUGHNESS) * part**2)


def column_of(cosine: Float64, alpha: Float64 | float) -> Float64:
    """Place of cosines to the view among the columns, from 0 to 1."""
    width = 2.0 * alpha
    return np.asarray(0.5 * (1.0 + width) * cosine / (cosine + width) + 0.5 * cosine**0.75)


def cosines_of_columns(alpha: float) -> Float64:
    """``(SHARES[1],)``: the cosines of the columns in a row of that alpha."""
    between = np.append(0.0, np.geomspace(_LEAST_COSINE, 1.0, _COSINES))
    part = np.linspace(0.0, 1.0, SHARES[1])
    return np.asarray(np.interp(part, column_of(between, alpha), between))


@lru_cache(maxsize=1)
def shares() -> Float32:
    """``(*SHARES, 4)``: of light that is 1 everywhere, by roughness and cosine to the view.

    What facets reflect times the colour that is mirrored head-on, and in addition to it; the share
    of light that Fresnel's term takes from what Lambert's model scatters. The last is not used.
    """
    table = np.zeros((*SHARES, 4))
    # The third is smooth and the same for every alpha.
    between = np.linspace(0.0, 1.0, _COSINES // 10) ** 2
    lost = lost_by_scattering(between)
    for row, rough in zip(table, roughness_of_rows(), strict=True):
        cosine = cosines_of_columns(rough**2)
        row[:, 0], row[:, 1] = reflected(cosine, rough**2)
        row[:, 2] = np.interp(cosine, between, lost)
    return table.astype(np.float32)


def reflected(cosine: Float64, alpha: float) -> tuple[Float64, Float64]:
    """Shares ``(n,)`` that facets reflect: times the colour that is mirrored head-on, and besides.

    Integrated over half-way vectors: those up to a quarter of a turn less half the view's angle
    from the normal mirror light from above the surface whichever side they lean to, those beyond
    up to an azimuth, as far as that angle more; so that the integrand is smooth in each part, but
    for roots at the ends, which nodes that crowd there take away.
    """
    c = np.maximum(cosine, _LEAST_COSINE)[:, None]
    sine, angle = np.sqrt(1.0 - c * c), np.arccos(c)
    # tan(theta) = alpha tan(s) spreads the distribution's facets evenly.
    first, last = (
        np.arctan2(np.sin(end), alpha * np.cos(end))
        for end in (0.25 * np.pi - 0.5 * angle, 0.25 * np.pi + 0.5 * angle)
    )
    (before, weigh_before), (beyond, weigh_beyond) = _ends(_BEFORE), _ends(_BEYOND)
    s = np.concatenate([first * before, first + (last - first) * beyond], axis=1)
    width = np.concatenate([first * weigh_before, (last - first) * weigh_beyond], axis=1)
    tangent = alpha * np.tan(s)
    up = 1.0 / np.sqrt(1.0 + tangent**2)
    out = tangent * up
    with np.errstate(divide="ignore", invalid="ignore"):
        limit = np.nan_to_num(c * (1.0 - 2.0 * up**2) / (2.0 * up * out * sine), nan=-1.0)
    limit[:, :_BEFORE] = -1.0
    azimuth = np.arccos(np.clip(limit, -1.0, 1.0))
    slope = alpha / (np.cos(s) ** 2 + (alpha * np.sin(s)) ** 2)
    density = alpha**2 / (np.pi * (up**2 * (alpha**2 - 1.0) + 1.0) ** 2)
    part, weigh = _gauss(_AROUND)
    facets = (2.0 * azimuth * density * out * slope * width)[..., None] * weigh
    facing = (sine * out)[..., None] * np.cos(azimuth[..., None] * part) + (c * up)[..., None]
    light = np.maximum(2.0 * facing * up[..., None] - c[..., None], 0.0)
    share = facets * 4.0 * facing * light * _unmasked(c[..., None], alpha) * _unmasked(light, alpha)
    fifth = (1.0 - np.clip(facing, 0.0, 1.0)) ** 5
    return (share * (1.0 - fifth)).sum(axis=(1, 2)), (share * fifth).sum(axis=(1, 2))


def lost_by_scattering(cosine: Float64) -> Float64:
    """Share ``(n,)`` that Fresnel's term takes from what Lambert's model scatters."""
    part, weigh = _gauss(24)
    out, up = np.sqrt(1.0 - part)[:, None], np.sqrt(part)[:, None]
    turn, weigh_turn = np.cos(np.pi * part), weigh
    c = cosine[:, None, None]
    half = 0.5 * (1.0 + np.sqrt(1.0 - c * c) * out * turn + c * up)
    lost = (1.0 - np.sqrt(np.clip(half, 0.0, 1.0))) ** 5
    return np.asarray(np.einsum("cij,i,j->c", lost, weigh, weigh_turn))


def _unmasked(cosine: Float64, alpha: float) -> Float64:
    """Smith's term over twice the cosine."""
    return np.asarray(1.0 / (cosine + np.sqrt(alpha**2 + (1.0 - alpha**2) * cosine**2)))


def _gauss(count: int) -> tuple[Float64, Float64]:
    """Gauss and Legendre's places in [0, 1] and their weights."""
    place, weight = np.polynomial.legendre.leggauss(count)
    return 0.5 * (1.0 + place), 0.5 * weight


def _ends(count: int) -> tuple[Float64, Float64]:
    """Places in [0, 1] that crowd at both ends, and their weights."""
    place, weight = _gauss(count)
    angle = 0.5 * np.pi * place
    return np.sin(angle) ** 2, weight * 0.5 * np.pi * np.sin(2.0 * angle)
