"""Spatial sample positions."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from mbinterval.device import records

_GRID = 1024
"""Offsets are multiples of 1/1024, so that a sample's position is exact in float32."""


@lru_cache(maxsize=64)
def fixed_pattern(count: int) -> NDArray[np.float32]:
    """Return ``(count, 2)`` offsets in [0, 1) of well-spread samples in a pixel.

    One sample is the pixel's centre. Otherwise a rank-1 lattice (Korobov form): sample i lies at
    ((i + 1/2) / n, i g / n + 1/2n mod 1), with the g that makes the least distance between two
    samples, across the pixel's edges too, the greatest. No two samples share a row or a column.
    """
    index = np.arange(count)
    best, best_distance = 1, -1.0
    for generator in range(1, count):
        if np.gcd(generator, count) != 1:
            continue
        offset = np.stack([index[1:], index[1:] * generator % count]) / count
        distance = float(np.hypot(*np.minimum(offset, 1.0 - offset)).min())
        if distance > best_distance + 1e-12:
            best, best_distance = generator, distance
    points = np.stack([index, index * best % count], axis=1) / count + 0.5 / count
    return (np.round(points * _GRID) / _GRID).astype(np.float32)


def fixed_slots(count: int) -> NDArray[np.void]:
    """Return the fixed pattern as ``Slot`` records."""
    slots = np.zeros(count, records.SLOT)
    x, y = fixed_pattern(count).T
    slots["x_low"] = slots["x_high"] = x
    slots["y_low"] = slots["y_high"] = y
    slots["weight"] = 1.0
    return slots
