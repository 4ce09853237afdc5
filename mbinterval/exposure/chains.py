"""Edges cut into pieces, each short enough: chains of new vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbinterval.exposure.blur_errors import edge_errors
from mbinterval.exposure.cuts import Faces, Float64, Places
from mbinterval.exposure.surface import Surface

Flags = NDArray[np.bool_]

_MOST_ROUNDS = 40


@dataclass(frozen=True, eq=False)
class Edges:
    """Edges of faces, each once, in the order of their ends' places.

    Attributes
    ----------
    ends
        ``(E, 2)``.
    of_face
        ``(F, 3)`` the edge from each corner to the next.
    turned
        ``(F, 3)`` whether that runs the other way.
    errors, cuts
        ``(E,)`` how far the blur is off on them in pixels, and where to cut them.
    """

    ends: Places
    of_face: Places
    turned: Flags
    errors: Float64
    cuts: Float64


@dataclass(frozen=True, eq=False)
class Chains:
    """New vertices on edges: those of edge e are ``vertices[first[e]:first[e + 1]]``, in order."""

    vertices: Places
    first: Places

    @property
    def lengths(self) -> Places:
        """How many each edge has."""
        return np.diff(self.first)

    def of(self, edges: Places, turned: Flags) -> Places:
        """Chains of ``edges`` ``(n,)``, filled up behind with -1: ``(n, longest)``."""
        lengths = self.lengths[edges][:, None]
        step = np.arange(lengths.max(initial=0))
        place = self.first[edges][:, None] + np.where(turned[:, None], lengths - 1 - step, step)
        within = step < lengths
        if not within.any():
            return np.full(within.shape, -1)
        return np.where(within, self.vertices[np.where(within, place, 0)], -1)


def edges_of(surface: Surface, faces: Faces, error: float) -> Edges:
    """Find the edges of ``faces`` and how far the blur is off on them (`edge_errors`)."""
    given = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2).astype(np.int64)
    ends = surface.ordered(given)
    key = ends[:, 0] * surface.count + ends[:, 1]
    _, first, of_face = np.unique(key, return_index=True, return_inverse=True)
    return Edges(
        ends[first],
        of_face.reshape(-1, 3),
        (ends[:, 0] != given[:, 0]).reshape(-1, 3),
        *edge_errors(surface, ends[first], error),
    )


def cut_edges(
    surface: Surface, edges: Edges, which: Flags, error: float, most: int
) -> tuple[Chains, list[tuple[Places, Float64]], float]:
    """Cut those ``which`` are too far off until no piece is that may be seen.

    There are ``most`` new vertices. Returns the chains, the steps in which their vertices were
    added to ``surface`` (`Cuts.steps`), and the error that is left where these are too few.
    """
    (of,) = np.nonzero(which)
    ends, errors, cuts = edges.ends[of], edges.errors[of], edges.cuts[of]
    split, steps = np.ones(len(of), bool), []
    for _ in range(_MOST_ROUNDS):
        added = int(np.count_nonzero(split))
        most -= added
        if not added or most < 0:
            break
        new = surface.count + np.arange(added)
        steps.append((ends[split], cuts[split]))
        surface.add(*steps[-1])
        # Both halves of what is split come in the place of it.
        source = np.repeat(np.arange(len(of)), 1 + split)
        second = np.append(False, source[1:] == source[:-1])
        changed = split[source]
        of, ends, errors, cuts = of[source], ends[source], errors[source], cuts[source]
        ends[changed & ~second, 1] = ends[second, 0] = new
        errors[changed], cuts[changed] = edge_errors(surface, ends[changed], error)
        split = changed & (errors > error)
        split[split] = surface.seen(ends[split])
    inner = np.append(False, of[1:] == of[:-1]) if len(of) else np.zeros(0, bool)
    first = np.append(0, np.cumsum(np.bincount(of[inner], minlength=len(edges.ends))))
    left = float(errors[split].max(initial=0.0)) if most < 0 else 0.0
    return Chains(ends[inner, 0], first), steps, left
