"""Random motion paths in homogeneous pixel space, ``(P, 2, 3, 3)``: end, vertex, (X w, Y w, w)."""

from __future__ import annotations

import numpy as np

SIZE = (48, 32)
"""Width and height of the frame that they are spread over."""


def deforming(rng: np.random.Generator, count: int, near: float = 0.5) -> np.ndarray:
    """Six unrelated vertices each; ``near`` <= 0 puts some behind the eye."""
    w = rng.uniform(near, 3.0, (count, 2, 3))
    xy = rng.uniform((-8, -8), (SIZE[0] + 8, SIZE[1] + 8), (count, 2, 3, 2))
    return np.concatenate([xy * w[..., None], w[..., None]], axis=-1)


def translated(rng: np.random.Generator, count: int, near: float = 0.5) -> np.ndarray:
    """Triangles that keep their shape in homogeneous space."""
    points = deforming(rng, count, near)
    points[:, 1] = points[:, 0] + rng.uniform((-20, -20, -0.4), (20, 20, 1.5), (count, 1, 3))
    return points


def small_and_fast(rng: np.random.Generator, count: int) -> np.ndarray:
    """Triangles below a pixel that cross most of the frame."""
    w = rng.uniform(1.0, 3.0, (count, 1, 1)) + rng.uniform(0, 0.01, (count, 2, 3))
    corners = rng.uniform(0, 0.8, (count, 1, 3, 2)) + rng.uniform(0, SIZE, (count, 2, 1, 2))
    return np.concatenate([corners * w[..., None], w[..., None]], axis=-1)


def pivoting(rng: np.random.Generator, count: int) -> np.ndarray:
    """Triangles that turn about one of their vertices, and some that rest altogether."""
    points = deforming(rng, count)
    points[:, 1, 0] = points[:, 0, 0]
    points[: count // 4, 1] = points[: count // 4, 0]
    return points


def all_but_pivoting(rng: np.random.Generator, count: int) -> np.ndarray:
    """Triangles that turn about a vertex which rests but for rounding, as a wheel's hub does."""
    points = deforming(rng, count)
    points[:, 1, 0] = points[:, 0, 0] * (1.0 + 2.0**-52 * rng.integers(-3, 4, (count, 3)))
    return points


KINDS = {
    "deforming": lambda rng, count: deforming(rng, count),
    "translated": lambda rng, count: translated(rng, count),
    "small and fast": lambda rng, count: small_and_fast(rng, count),
    "pivoting": lambda rng, count: pivoting(rng, count),
    "all but pivoting": lambda rng, count: all_but_pivoting(rng, count),
    "behind the eye": lambda rng, count: deforming(rng, count, near=-1.0),
}
