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

    and on which side of the edge opposite each corner the ray passes, ``(N, 3, F)``; ``total`` is
    their sum, and ``front`` whether the front is met ``(N, F)``.
    """

    distance: np.ndarray
    side: np.ndarray
    total: np.ndarray
    front: np.ndarray

    def weights(self, ray: np.ndarray, face: np.ndarray) -> np.ndarray:
        """Corner weights ``(n, 3)`` where rays meet faces."""
        return self.side[ray, :, face] / self.total[ray, face][:, None]


class Triangles:
    """The faces of a frozen scene, ready for rays."""

    def __init__(self, still: Still) -> None:
        points = still.corners
        self.still = still
        ahead, after = points[:, :, [1, 2, 0]], points[:, :, [2, 0, 1]]
        # What B and A x B are multiplied by: (G, 6, 3, F), edge i opposite corner i.
        edges = np.concatenate([np.cross(ahead, after), after - ahead], axis=-1)
        self.edges = np.ascontiguousarray(edges.transpose(0, 3, 2, 1))
        across, along = points[:, :, 1] - points[:, :, 0], points[:, :, 2] - points[:, :, 0]
        self.normals = np.cross(across, along)
        self.offsets = np.sum(self.normals * points[:, :, 0], axis=-1)

    @property
    def faces(self) -> int:
        return self.normals.shape[1]

    def meet(self, group: np.ndarray, start: np.ndarray, way: np.ndarray) -> Hits:
        """Hits of rays ``start + w way``, w > 0, ``(N, 3)``, at the instants ``group`` ``(N,)``."""
        lines = np.concatenate([way, np.cross(start, way)], axis=-1)
        return self._hits(np.einsum("nk,nkif->nif", lines, self.edges[group]), group, start)

    def meet_all(self, start: np.ndarray, way: np.ndarray) -> Hits:
        """The same of ``(G, P, 3)`` rays, as many at each instant: G * P of them."""
        groups, count = start.shape[:2]
        lines = np.concatenate([way, np.cross(start, way)], axis=-1)
        side = lines @ self.edges.reshape(groups, 6, -1)
        side = side.reshape(groups * count, 3, self.faces)
        return self._hits(side, np.arange(groups).repeat(count), start.reshape(-1, 3))

    def _hits(self, side: np.ndarray, group: np.ndarray, start: np.ndarray) -> Hits:
        a, b, c = side[:, 0], side[:, 1], side[:, 2]
        total = a + b + c
        inside = np.minimum(np.minimum(a, b), c) >= 0.0
        inside |= np.maximum(np.maximum(a, b), c) <= 0.0
        ray, face = np.nonzero(inside & (total != 0.0) & self.still.there[group])
        g = group[ray]
        height = self.offsets[g, face] - np.einsum("ni,ni->n", self.normals[g, face], start[ray])
        along = height / total[ray, face]
        distance = np.full_like(total, np.inf)
        distance[ray, face] = np.where(along > 0.0, along, np.inf)
        return Hits(distance, side, total, total * self.still.front[group] < 0.0)
