"""Vertices of a mesh as its copies have them, and what each copy sees of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.exposure.cuts import Float64, Places, between
from mbinterval.exposure.sight import Sight

Flags = NDArray[np.bool_]


class Surface:
    """Vertices that more are added to, on edges between them."""

    def __init__(self, sights: tuple[Sight, ...]) -> None:
        self._sights = sights
        self._depths = [sight.depths for sight in sights]
        self._outside = [sight.outside() for sight in sights]

    @property
    def count(self) -> int:
        """How many there are."""
        return int(self._depths[0].shape[1])

    def add(self, ends: Places, shares: Float64) -> None:
        """Add vertices on edges between ``ends`` ``(m, 2)``, at ``shares`` ``(m,)`` of them."""
        more = [sight.of(between(sight.positions, ends, shares)) for sight in self._sights]
        pairs = list(zip(self._sights, more, strict=True))
        self._sights = tuple(
            sight.of(np.concatenate([sight.positions, new.positions], axis=1))
            for sight, new in pairs
        )
        for copy, new in enumerate(more):
            self._depths[copy] = np.concatenate([self._depths[copy], new.depths], axis=1)
            self._outside[copy] = np.concatenate([self._outside[copy], new.outside()])

    def seen(self, faces: NDArray[Any]) -> Flags:
        """Which faces ``(F, 3)``, or edges ``(E, 2)``, may be seen, in any copy."""
        found = np.zeros(len(faces), bool)
        for outside in self._outside:
            found |= ~beyond(outside, faces)
        return found

    def ordered(self, ends: Places) -> Places:
        """Return ends of edges in the order that their places have, whichever way they come."""
        places = self._sights[0].positions
        turned, undecided = np.zeros(len(ends), bool), np.ones(len(ends), bool)
        for column in places.transpose(0, 2, 1).reshape(-1, places.shape[1]):
            first, second = column[ends[:, 0]], column[ends[:, 1]]
            turned |= undecided & (first > second)
            undecided &= first == second
            if not undecided.any():
                break
        return np.where(turned[:, None], ends[:, ::-1], ends)

    def copies(self) -> list[tuple[Sight, Float64]]:
        """How each copy is seen, and its depths ``(K+1, n)``."""
        return list(zip(self._sights, self._depths, strict=True))

    def depth_between(self, first: NDArray[Any], second: NDArray[Any]) -> Float64:
        """Greatest difference in depth between vertices, ``(n,)``."""
        found = np.zeros(len(first))
        for depths in self._depths:
            apart = np.abs(depths[:, first] - depths[:, second]).max(axis=0)
            found = np.maximum(found, apart)
        return found


def beyond(outside: Flags, faces: NDArray[Any]) -> Flags:
    """Which faces lie on one side of what is seen with all their vertices (`Sight.outside`)."""
    return np.asarray(np.any(np.all(outside[faces], axis=1), axis=1))
