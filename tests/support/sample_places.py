"""What is true of samples' places in any good pattern."""

from __future__ import annotations

import numpy as np


def square_of_disc(point: np.ndarray) -> np.ndarray:
    """The unit square's points ``(..., 2)`` that Shirley and Chiu's map takes to the disc's.

    By areas: a square of half the side r becomes the disc of radius r, and each of its sides an
    arc of a quarter turn, along which lengths are in proportion to angles.
    """
    radius, angle = np.hypot(*np.moveaxis(point, -1, 0)), np.arctan2(point[..., 1], point[..., 0])
    quarter = np.floor((angle + np.pi / 4) / (np.pi / 2)) % 4
    along = (angle - quarter * np.pi / 2 + np.pi) % (2 * np.pi) - np.pi
    x, y = radius, along / (np.pi / 4) * radius
    turn = [(x, y), (-y, x), (-x, -y), (y, -x)]
    square = np.select([quarter[..., None] == k for k in range(4)],
                       [np.stack(t, axis=-1) for t in turn])  # fmt: skip
    return 0.5 * (square + 1.0)


def one_in_each(values: np.ndarray, slack: float = 0.0) -> np.ndarray:
    """Whether of N values ``(..., N)`` in [0, 1] one lies in each of N equal parts."""
    count = values.shape[-1]
    ranked = np.sort(values, axis=-1) * count
    part = np.arange(count)
    return ((part - slack <= ranked) & (ranked <= part + 1 + slack)).all(axis=-1)
