"""Triangles divided between new vertices on their edges, into strips across the depth.

From one corner on, two chains of vertices along the edges beside it are joined step by step, so
that lines between them differ as little in depth as may be; no vertex is added within a triangle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbinterval.exposure.chains import Chains, Edges
from mbinterval.exposure.cuts import Faces, Places
from mbinterval.exposure.surface import Surface

Flags = NDArray[np.bool_]
Parts = tuple[Faces, Places]
"""Faces, and those that they are parts of."""


@dataclass(frozen=True, eq=False)
class _Chain:
    """Vertices ``(n, longest)`` from the first corner's next on, and how many."""

    vertices: Places
    lengths: Places

    def at(self, place: Places) -> Places:
        """Return vertices at ``place`` ``(n,)``; the last one beyond."""
        place = np.minimum(place, self.lengths - 1)
        return np.take_along_axis(self.vertices, place[:, None], axis=1)[:, 0]


def divided(surface: Surface, faces: Faces, edges: Edges, chains: Chains) -> Parts:
    """Divide ``faces``, of which ``edges`` are, at the vertices of ``chains`` on these."""
    turn = _turns(surface, faces, chains.lengths[edges.of_face])
    rows = np.arange(len(faces))[:, None]
    corners, of_face = faces[rows, turn].astype(np.int64), edges.of_face[rows, turn]
    turned, lengths = edges.turned[rows, turn], chains.lengths[of_face]
    bits = np.frexp(lengths.sum(axis=1).astype(float))[1]  # of a size: chains are filled up
    found: list[Parts] = []
    for size in np.unique(bits):
        (group,) = np.nonzero(bits == size)
        left, right = _chains(chains, corners[group], of_face[group], turned[group])
        all_cut = lengths[group].min(axis=1) > 0
        found += [
            (part, group[of])
            for part, of in _joined(surface, corners[group, 0], left, right, all_cut)
        ]
    return np.concatenate([p for p, _ in found]), np.concatenate([of for _, of in found])


def _turns(surface: Surface, faces: Faces, lengths: Places) -> Places:
    """Corners ``(F, 3)`` in the order that `_joined` takes them in.

    The edge opposite to the first one is not cut; where all are, the last one is that along which
    depth differs most.
    """
    deep = np.stack(
        [surface.depth_between(faces[:, i], faces[:, (i + 1) % 3]) for i in range(3)], axis=1
    )
    whole = lengths == 0
    first = np.where(whole.any(axis=1), np.argmax(whole, axis=1) + 2, np.argmax(deep, axis=1) + 1)
    return np.asarray((first[:, None] + np.arange(3)) % 3)


def _chains(
    chains: Chains, corners: Places, of_face: Places, turned: Flags
) -> tuple[_Chain, _Chain]:
    """From the first corner to the third, and by the second up to it, or to the second."""
    last = chains.of(of_face[:, 2], ~turned[:, 2])
    left = _packed([last, corners[:, 2:]])
    first, second = (chains.of(of_face[:, edge], turned[:, edge]) for edge in range(2))
    return left, _packed([first, corners[:, 1:2], second])


def _packed(parts: list[Places]) -> _Chain:
    """Join rows of vertices, without what they are filled up with."""
    joined = np.concatenate(parts, axis=1)
    order = np.argsort(joined < 0, axis=1, kind="stable")
    return _Chain(np.take_along_axis(joined, order, axis=1), (joined >= 0).sum(axis=1))


def _joined(
    surface: Surface, corner: Places, left: _Chain, right: _Chain, all_cut: Flags
) -> list[Parts]:
    """Triangles between two chains from ``corner`` on.

    Where both end in the third corner, ``all_cut``, the left one comes to it last.
    """
    rows = np.arange(len(corner))
    i, j = np.zeros(len(rows), np.int64), np.zeros(len(rows), np.int64)
    found = [(np.stack([corner, right.at(j), left.at(i)], axis=1), rows)]
    while True:
        more_left, more_right = i + 1 < left.lengths, j + 1 < right.lengths
        (active,) = np.nonzero(more_left | more_right)
        if not len(active):
            return [(part.astype(np.int32), of) for part, of in found]
        a, b = left.at(i), right.at(j)
        next_a, next_b = left.at(i + 1), right.at(j + 1)
        held = all_cut & (i + 2 >= left.lengths) & more_right
        nearer = surface.depth_between(next_a, b) <= surface.depth_between(a, next_b)
        go_left = more_left & ~held & (nearer | ~more_right)
        third = np.where(go_left, next_a, next_b)
        found.append((np.stack([b, third, a], axis=1)[active], rows[active]))
        i, j = i + go_left, j + (more_right & ~go_left)
