"""Rotations: quaternions x, y, z, w, and Euler angles.

The core has no SciPy for them; trimesh, which has some, takes 0.6 s to load.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]

EULER_ORDERS = ("xyz", "xzy", "yxz", "yzx", "zxy", "zyx")


def slerp(a: Float64, b: Float64, part: Float64 | float) -> Float64:
    """Spherical interpolation of unit quaternions along the shorter arc (Shoemake 1985).

    ``a`` and ``b`` are ``(..., 4)``, ``part`` ``(...)``.
    """
    part = np.asarray(part, np.float64)[..., None]
    dot = np.sum(a * b, axis=-1, keepdims=True)
    b = np.where(dot < 0.0, -b, b)
    angle = arc(a, b)[..., None]
    with np.errstate(invalid="ignore"):
        turned = (np.sin((1.0 - part) * angle) * a + np.sin(part * angle) * b) / np.sin(angle)
    result = np.where(angle < 1e-9, (1.0 - part) * a + part * b, turned)
    return np.asarray(result / np.linalg.norm(result, axis=-1, keepdims=True))


def arc(a: Float64, b: Float64) -> Float64:
    """Angle in radians, from 0 to pi, between unit quaternions ``(..., 4)`` as vectors."""
    # atan2 of half chords keeps nearly equal and nearly opposite rotations accurate.
    apart, together = np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1)
    return np.asarray(2.0 * np.arctan2(apart, together))


def quaternion_matrix(quaternion: Float64 | Sequence[float]) -> Float64:
    """``(..., 3, 3)`` rotations of quaternions ``(..., 4)`` of any non-zero length."""
    given = np.asarray(quaternion, dtype=np.float64)
    x, y, z, w = np.moveaxis(given / np.linalg.norm(given, axis=-1, keepdims=True), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternion_product(a: Float64, b: Float64) -> Float64:
    """Quaternion x, y, z, w of the rotation ``b`` followed by ``a``."""
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.append(vector, a[3] * b[3] - a[:3] @ b[:3])


def euler_quaternion(degrees: Sequence[float], order: str = "xyz") -> Float64:
    """Quaternion x, y, z, w of turns about the fixed axes x, y, z, the first of ``order`` first."""
    result = np.array([0.0, 0.0, 0.0, 1.0])
    for axis in order:
        index = "xyz".index(axis)
        half = np.radians(degrees[index]) / 2.0
        turn = np.zeros(4)
        turn[index], turn[3] = np.sin(half), np.cos(half)
        result = quaternion_product(turn, result)
    return result


def euler_matrix(degrees: Float64, order: str) -> Float64:
    """``(..., 3, 3)`` turns by ``degrees`` ``(..., 3)`` about the fixed axes x, y and z.

    The first axis of ``order`` turns first: ``"xyz"`` is USD's ``rotateXYZ``.
    """
    radians = np.radians(degrees)
    result = np.eye(3)
    for axis in order:
        index = "xyz".index(axis)
        sine, cosine = np.sin(radians[..., index]), np.cos(radians[..., index])
        turn = np.zeros((*radians.shape[:-1], 3, 3))
        after, before = (index + 1) % 3, (index + 2) % 3
        turn[..., index, index] = 1.0
        turn[..., after, after] = turn[..., before, before] = cosine
        turn[..., before, after], turn[..., after, before] = sine, -sine
        result = turn @ result
    return np.asarray(result)
