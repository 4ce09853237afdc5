"""The environment: how it is seen, what surfaces scatter of it and what they mirror."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

LEAST_ROUGHNESS = 0.03
WIDE = 0.1
"""GGX's alpha from which on a table of a few degrees tells what facets mirror."""


def seen(environment: Any, ways: np.ndarray) -> np.ndarray:
    """Colours ``(n, 3)`` in directions ``(n, 3)``: bilinear between the texels' middles."""
    image = np.asarray(environment.image, np.float64)
    height, width = image.shape[:2]
    length = np.linalg.norm(ways, axis=1)
    turn = np.arctan2(ways[:, 0], -ways[:, 2]) + np.radians(environment.rotation)
    up = np.arcsin(np.clip(ways[:, 1] / length, -1.0, 1.0))
    x = (turn / (2.0 * np.pi) + 0.5) * width - 0.5
    y = np.clip((0.5 - up / np.pi) * height - 0.5, 0.0, height - 1.0)
    x0, y0 = np.floor(x), np.minimum(np.floor(y), height - 2.0)
    fx, fy = (x - x0)[:, None], (y - y0)[:, None]
    left, top = x0.astype(int) % width, y0.astype(int)
    right, below = (left + 1) % width, top + 1
    upper = (1.0 - fx) * image[top, left] + fx * image[top, right]
    lower = (1.0 - fx) * image[below, left] + fx * image[below, right]
    return environment.intensity * ((1.0 - fy) * upper + fy * lower)


@lru_cache(maxsize=16)
def _spread(environment: Any, alpha: float | None) -> np.ndarray:
    """The environment averaged about directions by longitude and latitude, ``(2 n, n + 1, 3)``.

    About each direction light weighs by its cosine over pi (Lambert), or with ``alpha`` as facets
    that are seen head-on mirror it there (Karis 2013): by their distribution and the cosine. Such
    weights depend on angles alone, so that along a circle of latitude they are a convolution.
    """
    rows = max(48, environment.image.shape[0])
    edge = np.pi * np.arange(rows + 1) / rows
    up, turn = 0.5 * np.pi - 0.5 * (edge[1:] + edge[:-1]), np.pi * np.arange(2 * rows) / rows
    ways = _ways(*np.meshgrid(up, turn, indexing="ij"))
    light = seen(environment, ways.reshape(-1, 3)).reshape(rows, 2 * rows, 3)
    solid = -np.diff(np.cos(edge)) * np.pi / rows
    about = np.linspace(0.5, -0.5, rows + 1)[:, None, None] * np.pi
    cosine = np.sin(about) * np.sin(up)[:, None]
    cosine = cosine + np.cos(about) * np.cos(up)[:, None] * np.cos(turn)
    weight = solid[:, None] * np.maximum(cosine, 0.0) / np.pi
    if alpha is not None:
        facing = 0.5 * (1.0 + cosine)  # the half vector's cosine, squared
        weight = weight / (facing * (alpha**2 - 1.0) + 1.0) ** 2
        weight = weight / weight.sum(axis=(1, 2), keepdims=True)
    waves = np.einsum("ijk,jkc->kic", np.fft.rfft(weight), np.fft.rfft(light, axis=1))
    return np.fft.irfft(waves, 2 * rows, axis=0)


def _ways(up: np.ndarray, turn: np.ndarray) -> np.ndarray:
    return np.stack([np.cos(up) * np.sin(turn), np.sin(up), -np.cos(up) * np.cos(turn)], axis=-1)


def _about(table: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """What a table of directions says of unit ``ways`` ``(n, 3)``, linear between its places."""
    turns, rows = len(table), table.shape[1] - 1
    x = np.arctan2(ways[:, 0], -ways[:, 2]) / (2.0 * np.pi) * turns
    y = (0.5 - np.arcsin(np.clip(ways[:, 1], -1.0, 1.0)) / np.pi) * rows
    left, j = np.floor(x), np.minimum(y.astype(int), rows - 1)
    fx, fy = (x - left)[:, None], (y - j)[:, None]
    i = left.astype(int) % turns
    near = (1.0 - fy) * table[i, j] + fy * table[i, j + 1]
    i = (i + 1) % turns
    return (1.0 - fx) * near + fx * ((1.0 - fy) * table[i, j] + fy * table[i, j + 1])


def scattered(environment: Any, normals: np.ndarray) -> np.ndarray:
    """What Lambert's surfaces with unit ``normals`` ``(n, 3)`` scatter: the integral over pi."""
    return _about(_spread(environment, None), normals)


def mirrored(environment: Any, ways: np.ndarray, alpha: float) -> np.ndarray:
    """Mean light ``(n, 3)`` that facets of GGX's ``alpha`` mirror about unit ``ways``."""
    if alpha < WIDE:
        return mirrored_by_draws(environment, ways, alpha)
    return _about(_spread(environment, alpha), ways)


def mirrored_by_draws(
    environment: Any, ways: np.ndarray, alpha: float, count: int = 96
) -> np.ndarray:
    """The same by half vectors that are drawn by the distribution, however narrow it is.

    As for a view along the normal (Karis 2013): directions weigh by their cosine.
    """
    k = np.arange(count)
    part, turn = (k + 0.5) / count, 2.0 * np.pi * (0.618033988749895 * k)
    half = np.arctan(alpha * np.sqrt(part / (1.0 - part)))
    angle = 2.0 * half
    kept = angle < 0.5 * np.pi
    angle, turn = angle[kept], turn[kept]
    share = np.cos(angle) / np.cos(angle).sum()
    first = np.cross(ways, np.where(np.abs(ways[:, :1]) < 0.7, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(ways, first)
    found = np.zeros_like(ways)
    for a, b, s in zip(angle, turn, share, strict=True):
        way = np.cos(a) * ways + np.sin(a) * (np.cos(b) * first + np.sin(b) * second)
        found += s * seen(environment, way)
    return found


def mean_cosine(alpha: np.ndarray, count: int = 400) -> np.ndarray:
    """Of directions that facets of GGX's ``alpha`` ``(n,)`` mirror for a view head-on."""
    part = (np.arange(count) + 0.5) / count
    each, back = np.unique(alpha, return_inverse=True)
    angle = 2.0 * np.arctan(each[:, None] * np.sqrt(part / (1.0 - part)))
    return np.maximum(np.cos(angle), 0.0).mean(axis=1)[back]


@lru_cache(maxsize=64)
def shares(roughness: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Cosines to the view, and what one bounce off GGX facets makes of light that is 1 all around.

    Times the colour that is mirrored head-on; in addition to it; and what Schlick's term takes
    from Lambert's light. Integrated over directions of light about the mirrored one.
    """
    alpha = max(roughness, LEAST_ROUGHNESS) ** 2
    cosine = np.linspace(0.0, 1.0, 65)[1:]
    # Half vectors by tan(angle) = alpha tan(s), with s even: fine where the distribution is.
    s = (np.arange(300) + 0.5) / 300 * 0.5 * np.pi
    turn = ((np.arange(90) + 0.5) / 90 * np.pi)[None]
    tangent = alpha * np.tan(s)[:, None]
    up = 1.0 / np.sqrt(1.0 + tangent**2)
    out = tangent * up
    # d(angle)/ds, and the distribution's density over solid angle.
    slope = alpha / (np.cos(s) ** 2 + alpha**2 * np.sin(s) ** 2)
    spread = up**2 * (alpha**2 - 1.0) + 1.0
    density = alpha**2 / (np.pi * spread**2)
    solid = density * out * slope[:, None] * (0.5 * np.pi / 300) * (2.0 * np.pi / 90)
    factor, added = np.zeros_like(cosine), np.zeros_like(cosine)
    for i, c in enumerate(cosine):
        facing = np.sqrt(1.0 - c * c) * out * np.cos(turn) + c * up
        light = 2.0 * facing * up - c
        use = (facing > 0.0) & (light > 0.0)
        smith = 1.0
        for x in (c, np.where(use, light, 1.0)):
            smith = smith / (x + np.sqrt(alpha**2 + (1.0 - alpha**2) * x * x))
        # D V F cos over light's directions, whose angle is 4 (v.h) that of half vectors
        share = np.where(use, solid * smith * light * 4.0 * facing, 0.0)
        fifth = (1.0 - np.clip(facing, 0.0, 1.0)) ** 5
        factor[i], added[i] = (share * (1.0 - fifth)).sum(), (share * fifth).sum()
    height = ((np.arange(200) + 0.5) / 200)[:, None]
    lost = np.zeros_like(cosine)
    for i, c in enumerate(cosine):
        along = np.sqrt(1.0 - c * c) * np.sqrt(1.0 - height) * np.cos(turn) + c * np.sqrt(height)
        lost[i] = ((1.0 - np.sqrt(0.5 * (1.0 + along))) ** 5).mean()
    return cosine, factor, added, lost
