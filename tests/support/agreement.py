"""Films of point samples with their variances, and tests of pixels against exact time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import stats

import mbinterval as mb
from mbinterval.scene.model import Scene
from support.hard_cases import SIZE

SAMPLES, SEEDS = 4096, 12
ALPHA = 0.01


def analytic(of: Scene) -> np.ndarray:
    settings = mb.Settings(samples=256, pattern="sobol")
    return mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings).rgba.astype(float)


def stochastic(of: Scene, samples: int = SAMPLES, seed: int = 0, **values: object) -> np.ndarray:
    settings = mb.Settings(method="stochastic", samples=samples, seed=seed, **values)
    return mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings).rgba.astype(float)


def late(of: Scene, by: float) -> Scene:
    meshes = [
        replace(m, positions=m.positions + by * (m.positions[-1] - m.positions[0]))
        for m in of.meshes
    ]
    return replace(of, meshes=meshes)


def critical(sigma: np.ndarray) -> float:
    return stats.norm.isf(ALPHA / 2 / np.isfinite(sigma).sum())


def with_small_lens(of: Scene) -> Scene:
    lens = {"fov": None, "focal_length": 24.0, "f_stop": 0.02, "focus_distance": 1.8}
    return replace(of, camera=replace(of.camera, **lens))


def repeated(of: Scene, count: int, **values: object) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean over seeds of a pixel, the variance of that mean, and how many seeds differ.

    Points of a net are not independent of each other, but nets of different seeds are.
    """
    films = np.stack(
        [
            mb.render(of, width=SIZE[0], height=SIZE[1],
                      settings=mb.Settings(seed=seed, **values)).rgba.astype(float)
            for seed in range(count)
        ]
    )  # fmt: skip
    differ = (np.abs(films - np.median(films, axis=0)) > 1e-6).sum(axis=0)
    return films.mean(axis=0), films.var(axis=0, ddof=1) / count, differ


def welch(a: tuple, b: tuple, counts: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Welch's t of each pixel, and what Bonferroni allows it."""
    (mean, variance, differ), (other, own, _) = a, b
    both = np.where(differ >= 30, variance + own, np.nan)
    t = (mean - other) / np.sqrt(both)
    degrees = both**2 / (variance**2 / (counts[0] - 1) + own**2 / (counts[1] - 1))
    return t, stats.t.isf(ALPHA / 2 / np.isfinite(t).sum(), degrees)
