"""Triangles cut where a lens's limits bend the blur, so that it is nearly linear on each.

The blur is a function of depth alone, and depth is linear over a triangle. So where the blur is
within an error of a straight line along all three edges, it is over the triangle: each line of one
depth lies between two points of the edges. What is cut is decided for each edge by itself, from
where its ends are, so that neighbours cut the edge that they share alike, whether they share its
vertices or not: nothing opens between them. Cuts are straight and attributes linear along them,
so that the surface stays what it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mbinterval.exposure.chains import cut_edges, edges_of
from mbinterval.exposure.cuts import Cuts, Faces, Float64, Places
from mbinterval.exposure.sight import Sight
from mbinterval.exposure.strips import Parts, divided
from mbinterval.exposure.surface import Surface

_MOST_ROUNDS = 40


@dataclass(frozen=True, eq=False)
class Refined:
    """How a mesh is cut, None if it is not, and the error in pixels where it is too large yet."""

    cuts: Cuts | None
    error: float


def refine(sights: tuple[Sight, ...], faces: Faces, error: float, most: int) -> Refined:
    """Cut ``faces`` so that the blur is off by no more than ``error`` pixels where they are seen.

    ``sights`` are of all copies of the mesh; there are ``most`` new vertices.
    """
    chosen = np.flatnonzero(_candidates(sights, faces))
    if not len(chosen):
        return Refined(None, 0.0)
    used, local = np.unique(faces[chosen], return_inverse=True)
    surface = Surface(tuple(sight.of(sight.positions[:, used]) for sight in sights))
    active, parents = local.reshape(-1, 3).astype(np.int32), chosen
    done: list[Parts] = []
    steps: list[tuple[Places, Float64]] = []
    left = 0.0
    for _ in range(_MOST_ROUNDS):
        edges = edges_of(surface, active, error)
        far = edges.errors > error
        busy = far[edges.of_face].any(axis=1) & surface.seen(active)
        done.append((active[~busy], parents[~busy]))
        active, parents = active[busy], parents[busy]
        edges = replace(edges, of_face=edges.of_face[busy], turned=edges.turned[busy])
        if left > 0.0 or not len(active):
            break
        which = far & (np.bincount(edges.of_face.ravel(), minlength=len(far)) > 0)
        chains, more, left = cut_edges(surface, edges, which, error, most)
        steps, most = steps + more, most - sum(len(shares) for _, shares in more)
        active, origin = divided(surface, active, edges, chains)
        parents = parents[origin]
    if len(active):
        left = max(left, error, float(edges.errors[edges.of_face].max()))
    if not steps:
        return Refined(None, left)
    whole = np.setdiff1d(np.arange(len(faces)), chosen)
    ids = np.append(used, sights[0].positions.shape[1] + np.arange(surface.count - len(used)))
    parts = [(ids[part].astype(np.int32), of) for part, of in (*done, (active, parents))]
    joined = _in_order([(faces[whole], whole), *parts])
    return Refined(Cuts(*joined, tuple((ids[ends], shares) for ends, shares in steps)), left)


def _in_order(parts: list[Parts]) -> Parts:
    """Join ``parts``, each in the place of the face that it is of."""
    faces = np.concatenate([part for part, _ in parts])
    parents = np.concatenate([of for _, of in parts])
    order = np.argsort(parents, kind="stable")
    return faces[order], parents[order]


def _candidates(sights: tuple[Sight, ...], faces: Faces) -> NDArray[np.bool_]:
    """Faces that a bend is ever on."""
    found = np.zeros(len(faces), bool)
    for sight in sights:
        low, high = sight.depth_range()
        nearest, farthest = low[faces].min(axis=1), high[faces].max(axis=1)
        for place in sight.bends.places:
            found |= (nearest < place.max()) & (farthest > place.min())
    return found
