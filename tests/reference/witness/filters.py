"""Pixel filters, drawn by importance from their absolute value."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

RADII = {"box": 0.5, "triangle": 1.0, "gaussian": 1.5, "blackman_harris": 1.5, "mitchell": 2.0}


def weight(name: str, radius: float, x: np.ndarray) -> np.ndarray:
    """The filter's weight at distances ``x`` from the centre, in pixels; not normalized."""
    s = np.abs(x) / radius
    if name == "box":
        found = np.ones_like(s)
    elif name == "triangle":
        found = 1.0 - s
    elif name == "gaussian":  # its radius is three standard deviations; 0 at the radius
        found = np.exp(-0.5 * (3.0 * s) ** 2) - np.exp(-4.5)
    elif name == "blackman_harris":  # the window of four terms
        c = [np.cos(np.pi * k * (s + 1.0)) for k in range(4)]
        found = 0.35875 * c[0] - 0.48829 * c[1] + 0.14128 * c[2] - 0.01168 * c[3]
    else:  # Mitchell & Netravali 1988, B = C = 1/3, over [-2, 2]
        b = c = 1.0 / 3.0
        d = 2.0 * s
        near = (12 - 9 * b - 6 * c) * d**3 + (-18 + 12 * b + 6 * c) * d**2 + 6 - 2 * b
        far = (-b - 6 * c) * d**3 + (6 * b + 30 * c) * d**2 + (-12 * b - 48 * c) * d
        found = np.where(d < 1.0, near, far + 8 * b + 24 * c) / 6.0
    return np.where(s <= 1.0, found, 0.0)


@lru_cache(maxsize=32)
def _table(name: str, radius: float) -> tuple[np.ndarray, np.ndarray, float]:
    x = np.linspace(-radius, radius, 8001)
    middle = 0.5 * (x[1:] + x[:-1])
    size = np.abs(weight(name, radius, middle))
    passed = np.append(0.0, np.cumsum(size))
    return x, passed / passed[-1], float(size.sum() / weight(name, radius, middle).sum())


def draw(name: str, radius: float | None, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Offsets from the pixel's centre for ``share`` in [0, 1], and what each sample weighs."""
    radius = RADII[name] if radius is None else radius
    x, passed, mass = _table(name, radius)
    at = np.interp(share, passed, x)
    return at, mass * np.sign(weight(name, radius, at))
