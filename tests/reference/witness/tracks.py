"""Keyed values and transforms at many instants at once, from the keys."""

from __future__ import annotations

from typing import Any

import numpy as np


def is_keyed(value: Any) -> bool:
    return hasattr(value, "interpolation")


def at(value: Any, frames: np.ndarray) -> np.ndarray:
    """A track's values ``(T, ...)`` at ``frames`` ``(T,)``; of a constant T times the same."""
    if not is_keyed(value):
        constant = np.asarray(value, np.float64)
        return np.broadcast_to(constant, (len(frames), *constant.shape))
    keys, values = np.asarray(value.frames), np.asarray(value.values)
    if value.interpolation == "cubic":
        before, values, after = values[:, 0], values[:, 1], values[:, 2]
    frames = np.clip(frames, keys[0], keys[-1])
    k = np.clip(np.searchsorted(keys, frames, side="right") - 1, 0, len(keys) - 1)
    if value.interpolation == "step" or len(keys) == 1:
        return values[k]
    k = np.minimum(k, len(keys) - 2)
    span = (keys[k + 1] - keys[k]).reshape(-1, *[1] * (values.ndim - 1))
    s = (frames - keys[k]).reshape(span.shape) / span
    p, q = values[k], values[k + 1]
    if value.interpolation == "cubic":
        found = p + s * span * after[k]  # Hermite's cubic in Newton's form
        found = found + s**2 * (q - p - span * after[k])
        found = found + s**2 * (s - 1.0) * (span * (after[k] + before[k + 1]) - 2.0 * (q - p))
        return found / np.linalg.norm(found, axis=1, keepdims=True) if value.quaternion else found
    if value.quaternion:
        return slerp(p, q, s)
    return p + s * (q - p)


def slerp(p: np.ndarray, q: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Rows of unit quaternions turned from p to q by the part s, the shorter way."""
    q = np.where(np.sum(p * q, axis=1, keepdims=True) < 0.0, -q, q)
    along = q - p * np.sum(p * q, axis=1, keepdims=True)  # q's part across p
    size = np.linalg.norm(along, axis=1, keepdims=True)
    angle = np.arctan2(size, np.sum(p * q, axis=1, keepdims=True))
    across = np.divide(along, size, out=np.zeros_like(along), where=size > 0.0)
    return np.cos(s * angle) * p + np.sin(s * angle) * across


def rotations(quaternions: np.ndarray) -> np.ndarray:
    """``(T, 3, 3)`` of quaternions x, y, z, w: v + 2 w (a x v) + 2 a x (a x v)."""
    unit = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
    a, w = unit[:, :3], unit[:, 3]
    cross = np.zeros((len(unit), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -a[:, 2], a[:, 1], -a[:, 0]
    cross -= cross.swapaxes(1, 2)
    return np.eye(3) + 2.0 * w[:, None, None] * cross + 2.0 * cross @ cross


def euler_rotations(degrees: np.ndarray, order: str) -> np.ndarray:
    """``(T, 3, 3)`` of turns about the fixed axes x, y, z, the first of ``order`` first."""
    found = np.broadcast_to(np.eye(3), (len(degrees), 3, 3))
    for axis in map("xyz".index, order):
        half = np.radians(degrees[:, axis]) / 2.0
        quaternions = np.zeros((len(degrees), 4))
        quaternions[:, axis], quaternions[:, 3] = np.sin(half), np.cos(half)
        found = rotations(quaternions) @ found
    return found


def matrices(node: Any, frames: np.ndarray) -> np.ndarray:
    """World matrices ``(T, 4, 4)`` of a node: parent * translation * rotation * scale * matrix.

    A node of the witness's own may have ``euler`` angles instead of a rotation, each of which goes
    its own way.
    """
    if node is None:
        return np.broadcast_to(np.eye(4), (len(frames), 4, 4))
    local = np.zeros((len(frames), 4, 4))
    if getattr(node, "euler", None) is None:
        turn = rotations(at(node.rotation, frames))
    else:
        turn = euler_rotations(at(node.euler, frames), node.euler_order)
    local[:, :3, :3] = turn * at(node.scale, frames)[:, None, :]
    local[:, :3, 3] = at(node.translation, frames)
    local[:, 3, 3] = 1.0
    if node.matrix is not None:
        local = local @ np.asarray(node.matrix)
    return matrices(node.parent, frames) @ local
