"""Where rays meet plain triangles: by the plane, and by the sides on which the point lies in it.

Homogeneous pixel space is a space of three dimensions in which the sample (X, Y) looks from the
origin along (X, Y, 1), and w is how far it sees. There are no edge functions and no determinants of
vertices here, and nothing is solved in time: a triangle is where its vertices are at one moment.
"""

from __future__ import annotations

import numpy as np

NUDGES = (2.0**-13, 2.0**-14)
"""Two distances, in pixels, that stand for one that is as small as one likes."""


def at_time(points: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Triangles ``(M, 3, 3)`` at times ``tau`` ``(M,)`` between both ends of ``(M, 2, 3, 3)``."""
    part = tau[:, None, None]
    return (1.0 - part) * points[:, 0] + part * points[:, 1]


def meet(
    triangles: np.ndarray, origin: np.ndarray, way: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How far along ``way`` rays from ``origin``, both ``(M, 3)``, meet planes; the sides there.

    The distance ``(M,)``, in lengths of ``way``, is no number or infinite where there is none.
    Shares ``(M, 3)`` of the corners add up to 1 and are all positive inside of the triangle. Last,
    ``(M,)``: below zero where the corners run clockwise as seen along the ray.
    """
    p = triangles - origin[:, None]
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    facing = (normal * way).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        distance = (normal * p[:, 0]).sum(axis=1) / facing
        point = distance[:, None] * way
        parts = [
            (np.cross(p[:, j] - p[:, i], point - p[:, i]) * normal).sum(axis=1)
            for i, j in ((1, 2), (2, 0), (0, 1))
        ]
        shares = np.stack(parts, axis=1) / (normal**2).sum(axis=1, keepdims=True)
    return distance, shares, facing


def see(
    triangles: np.ndarray, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depth ``(M,)`` of triangles at samples, the corners' shares, and whether they are seen."""
    # Seen from the sample's own axis: what is far off the middle of the frame loses no digits.
    w = triangles[..., 2]
    moved = np.stack(
        [triangles[..., 0] - x[:, None] * w, triangles[..., 1] - y[:, None] * w, w], axis=-1
    )
    ahead = np.broadcast_to([0.0, 0.0, 1.0], (len(x), 3))
    depth, shares, _ = meet(moved, np.zeros((len(x), 3)), ahead)
    with np.errstate(invalid="ignore"):
        return depth, shares, (shares > 0.0).all(axis=1) & (depth > 0.0) & (depth < np.inf)


def see_nudged(
    triangles: np.ndarray, x: np.ndarray, y: np.ndarray, on: float = 1e-9
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depth of triangles at samples, whether they are seen, and whether that is sure.

    Where a share is below ``on`` the sample is taken to lie on an edge, and counts as if it were at
    (x + eps, y + eps^2): that is sure if two small numbers for eps give one answer, and nothing
    else changes. It needs triangles whose edges are far steeper than eps, or level.
    """
    depth, shares, seen = see(triangles, x, y)
    with np.errstate(invalid="ignore"):
        close = ~(np.abs(shares) > on)
    near = np.flatnonzero(close.any(axis=1))
    sure = np.ones(len(x), bool)
    answers = []
    for eps in NUDGES:
        _, moved, there = see(triangles[near], x[near] + eps, y[near] + eps * eps)
        answers.append(there)
        sure[near] &= (close[near] | ((moved > 0) == (shares[near] > 0))).all(axis=1)
    seen[near] = answers[0]
    sure[near] &= answers[0] == answers[1]
    return depth, seen & (depth > 0.0), sure


def see_clearly(
    triangles: np.ndarray, x: np.ndarray, y: np.ndarray, on: float = 1e-9
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Likewise, but not sure where a sample may lie on an edge."""
    depth, shares, seen = see(triangles, x, y)
    with np.errstate(invalid="ignore"):
        return depth, seen, ~((shares > -on).all(axis=1) & (shares <= on).any(axis=1))


def is_front(triangles: np.ndarray) -> np.ndarray:
    """Whether the side is turned to the eye from which corners run counter-clockwise."""
    outward = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return np.asarray((outward * triangles[:, 0]).sum(axis=1) < 0.0)
