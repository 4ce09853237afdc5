"""Rays against triangles in float64, all against all, by Plücker coordinates.

A ray A + w B passes the edge from p to q on the side that the sign of
B . (p x q) + (A x B) . (q - p) says; it meets a triangle where all three have one sign, and their
shares of the sum are the point's weights of the corners.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .motion import Still

BLOCK = 1 << 19
"""Pairs of rays and triangles that are held at once."""


@dataclass(frozen=True, eq=False)
class Hits:
    """Of N rays and F faces: distances ``(N, F)`` in lengths of the rays' ways, infinite for none,

    corner weights ``(N, F, 3)``, and whether the front is met ``(N, F)``.
    """

    distance: np.ndarray
    weights: np.ndarray
    front: np.ndarray


class Triangles:
    """The faces of a frozen scene, ready for rays."""

    def __init__(self, still: Still) -> None:
        points = still.corners
        self.still = still
        ahead, after = points[:, :, [1, 2, 0]], points[:, :, [2, 0, 1]]
        # What B and A x B are multiplied by: (G, 6, F, 3), edge i opposite corner i.
        edges = np.concatenate([np.cross(ahead, after), after - ahead], axis=-1)
        self.edges = np.ascontiguousarray(edges.transpose(0, 3, 1, 2))
        across, along = points[:, :, 1] - points[:, :, 0], points[:, :, 2] - points[:, :, 0]
        self.normals = np.cross(across, along)
        self.offsets = np.sum(self.normals * points[:, :, 0], axis=-1)

    @property
    def faces(self) -> int:
        return self.normals.shape[1]

    def meet(self, group: np.ndarray, start: np.ndarray, way: np.ndarray) -> Hits:
        """Hits of rays ``start + w way``, w > 0, ``(N, 3)``, at the instants ``group`` ``(N,)``."""
        lines = np.concatenate([way, np.cross(start, way)], axis=-1)
        side = np.einsum("nk,nkfi->nfi", lines, self.edges[group])
        return self._hits(side, self._distance(group, start, side), group)

    def meet_all(self, start: np.ndarray, way: np.ndarray) -> Hits:
        """The same of ``(G, P, 3)`` rays, as many at each instant: G * P of them."""
        groups, count = start.shape[:2]
        lines = np.concatenate([way, np.cross(start, way)], axis=-1)
        side = lines @ self.edges.reshape(groups, 6, -1)
        side = side.reshape(groups * count, self.faces, 3)
        group = np.arange(groups).repeat(count)
        return self._hits(side, self._distance(group, start.reshape(-1, 3), side), group)

    def _distance(self, group: np.ndarray, start: np.ndarray, side: np.ndarray) -> np.ndarray:
        over = side.sum(axis=-1)
        height = self.offsets[group] - np.einsum("nfi,ni->nf", self.normals[group], start)
        return np.divide(height, over, out=np.full_like(over, np.inf), where=over != 0.0)

    def _hits(self, side: np.ndarray, distance: np.ndarray, group: np.ndarray) -> Hits:
        total = side.sum(axis=-1)
        inside = (side >= 0.0).all(axis=-1) | (side <= 0.0).all(axis=-1)
        met = inside & (total != 0.0) & (distance > 0.0) & self.still.there[group]
        weights = np.divide(side, total[..., None], out=np.zeros_like(side), where=met[..., None])
        front = total * self.still.front[group] < 0.0
        return Hits(np.where(met, distance, np.inf), weights, front)
