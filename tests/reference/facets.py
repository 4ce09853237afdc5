"""What GGX's facets reflect of light that is 1 everywhere: integrated over the visible ones.

Heitz 2018, "Sampling the GGX Distribution of Visible Normals": facets as an eye sees them are the
points of a half of a disc, stretched; what remains of the model is the masking of the light.
"""

from __future__ import annotations

import numpy as np


def gauss(count: int, end: float) -> tuple[np.ndarray, np.ndarray]:
    place, weight = np.polynomial.legendre.leggauss(count)
    return 0.5 * end * (1.0 + place), 0.5 * end * weight


def white_light(cosine: float, alpha: float, count: int = 400) -> tuple[float, float]:
    """Shares by a cosine to the view: times the colour that is mirrored head-on, and besides."""
    sine = np.sqrt(1.0 - cosine * cosine)
    vx, vz = np.array([alpha * sine, cosine]) / np.hypot(alpha * sine, cosine)
    # Of the disc, by symmetry one half: across = sin(p), down = -cos(q) times its half chord.
    p, weigh_p = gauss(count, 0.5 * np.pi)
    q, weigh_q = gauss(count, np.pi)
    across, chord = np.sin(p)[:, None], np.cos(p)[:, None]
    area = (weigh_p[:, None] * chord) * (weigh_q * np.sin(q)) * chord
    tilt = 0.5 * (1.0 + vz)
    down = (1.0 - tilt) * chord - tilt * chord * np.cos(q)
    out = np.sqrt(np.maximum(0.0, 1.0 - across**2 - down**2))
    half = np.stack([
        alpha * (vx * out - vz * down), alpha * across + 0.0 * down,
        np.maximum(vx * down + vz * out, 0.0),
    ])  # fmt: skip
    half /= np.linalg.norm(half, axis=0)
    facing = sine * half[0] + cosine * half[2]
    light = np.maximum(2.0 * facing * half[2] - cosine, 0.0)
    root = np.sqrt(alpha**2 + (1.0 - alpha**2) * light**2)
    share = 2.0 / np.pi * area * 2.0 * light / (light + root)
    fifth = (1.0 - np.clip(facing, 0.0, 1.0)) ** 5
    return float((share * (1.0 - fifth)).sum()), float((share * fifth).sum())
