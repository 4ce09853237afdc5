"""Triangles of a mesh cut into smaller ones, in the same surface."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Faces = NDArray[np.int32]
Places = NDArray[np.int64]
Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Cuts:
    """New vertices on edges, and the faces between them and the mesh's own.

    Attributes
    ----------
    faces
        ``(F, 3)`` int32, those that are cut from one face in its place.
    parents
        ``(F,)`` the mesh's face that each is a part of.
    steps
        New vertices, numbered on from those before: ``ends`` ``(m, 2)`` of the edge that each is
        on, all numbered before the step, and ``shares`` ``(m,)`` of its second end, from 0 to 1.
    """

    faces: Faces
    parents: Places
    steps: tuple[tuple[Places, Float64], ...]

    def extended(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return values of vertices ``(..., N, width)`` with those of the new vertices."""
        count = values.shape[-2]
        more = sum(len(shares) for _, shares in self.steps)
        found = np.empty((*values.shape[:-2], count + more, values.shape[-1]), values.dtype)
        found[..., :count, :] = values
        for ends, shares in self.steps:
            found[..., count : count + len(shares), :] = between(found, ends, shares)
            count += len(shares)
        return found

    def only(self, keep: NDArray[np.bool_]) -> Cuts:
        """Return the same with some of the faces."""
        return replace(self, faces=self.faces[keep], parents=self.parents[keep])


def between(values: NDArray[Any], ends: Places, shares: Float64) -> NDArray[Any]:
    """Values ``(..., N, width)`` between vertices ``ends`` ``(m, 2)``: ``(..., m, width)``."""
    first, second = values[..., ends[:, 0], :], values[..., ends[:, 1], :]
    return np.asarray((1.0 - shares)[:, None] * first + shares[:, None] * second)
