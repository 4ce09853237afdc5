"""How many pixels blur is off where it is taken for linear: on edges, and between knots.

What counts is the mean over time, weighted as a pixel's light is: a bend that passes leaves an edge
or a vertex wrong for a moment alone, and a film adds moments up. At one moment the error may be
`_MOMENT` times as much.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbinterval.exposure.cuts import Faces, Places
from mbinterval.exposure.edge_errors import harmonic, sags, swept
from mbinterval.exposure.limits import Bends
from mbinterval.exposure.sight import Sight
from mbinterval.exposure.surface import Surface, beyond

Float64 = NDArray[np.float64]

_MOMENT = 10.0
_NEAREST = 0.25
"""Of a bend's depth. What is nearer than that has more blur, and as much more error."""
_VALUES = 1 << 20
"""Numbers in each array on the way: edges times segments."""


def edge_errors(surface: Surface, ends: Places, error: float) -> tuple[Float64, Float64]:
    """Errors in pixels on edges between ``ends`` ``(E, 2)``, and where to cut them: ``(E,)`` each.

    Of the copy in which each is worst. An edge is cut in the middle of where the worst bend is in
    the course of time. Errors of no more than ``error`` may be less than is said.
    """
    found, cuts = np.zeros(len(ends)), np.full(len(ends), 0.5)
    for sight, depths in surface.copies():
        errors = _bound(sight.bends, depths, ends)
        (chosen,) = np.nonzero(errors > error)
        step = max(1, _VALUES // len(depths))
        for start in range(0, len(chosen), step):
            part = chosen[start : start + step]
            a, b = depths[:, ends[part, 0]], depths[:, ends[part, 1]]
            errors[part], places = _measured(sight, a, b)
            cuts[part] = np.where(errors[part] > found[part], places, cuts[part])
        found = np.maximum(found, errors)
    return found, cuts


def _bound(bends: Bends, depths: Float64, ends: Places) -> Float64:
    """More than the errors: a sag is at most a quarter of an edge's depth."""
    long, behind = np.zeros(len(ends)), np.zeros(len(ends), bool)
    for row in depths:
        a, b = row[ends[:, 0]], row[ends[:, 1]]
        long = np.maximum(long, np.abs(a - b))
        behind |= np.minimum(a, b) < 0.0
    if not len(bends.places):
        return np.zeros(len(ends))
    most = (bends.changes.max(axis=1) / bends.places.min(axis=1)).sum()
    return np.asarray(0.25 * most * long * _nearer(behind))


def _measured(sight: Sight, a: Float64, b: Float64) -> tuple[Float64, Float64]:
    """Errors of edges between depths ``(K+1, E)``, and where to cut them."""
    lowest = np.minimum(a, b)
    behind = np.minimum(lowest[1:], lowest[:-1]) < 0.0
    total, mean = np.zeros_like(a[1:]), np.zeros_like(a[1:])
    worst, cut = np.full(a.shape[1], -1.0), np.full(a.shape[1], 0.5)
    for place, change in zip(sight.bends.places, sight.bends.changes, strict=True):
        over = a - place[:, None], b - place[:, None]
        pixels = np.maximum(change[1:], change[:-1]) / np.minimum(place[1:], place[:-1])
        scale = pixels[:, None] * _nearer(behind)
        most, usual = (scale * sag for sag in sags(*over))
        low, high = swept(*over)
        worse = (most.max(axis=0) > worst) & (low <= high)
        worst = np.where(worse, most.max(axis=0), worst)
        cut = np.where(worse, 0.5 * (low + high), cut)
        total, mean = total + most, mean + usual
    return _counted(total.max(axis=0), sight.light * mean.sum(axis=0)), cut


@dataclass(frozen=True)
class KnotErrors:
    """Greatest errors on vertices in pixels: on average, and at one moment."""

    mean: float = 0.0
    moment: float = 0.0

    @property
    def error(self) -> float:
        """What counts of them."""
        return float(_counted(np.array(self.moment), np.array(self.mean)))

    def more(self, limit: float) -> float:
        """How many times as many segments bring the error down to ``limit``, more or less.

        A mean falls with the square of their number.
        """
        return max(math.sqrt(self.mean / limit), self.moment / _MOMENT / limit)

    def most(self, other: KnotErrors) -> KnotErrors:
        """Return the greater of each."""
        return KnotErrors(max(self.mean, other.mean), max(self.moment, other.moment))


def knot_errors(sight: Sight, faces: Faces, middle: Bends | None) -> KnotErrors:
    """Errors on the vertices of ``faces`` in the segments in which these may be seen.

    ``middle`` is the lens in the middle of each, None where it does not change.
    """
    depths, outside = sight.depth_at(0), sight.outside_at(0)
    mean, worst = np.zeros(len(depths)), np.zeros(len(depths))
    for knot in range(sight.knots - 1):
        after, outside_after = sight.depth_at(knot + 1), sight.outside_at(knot + 1)
        seen = np.zeros(len(depths), bool)
        seen[faces[~beyond(outside & outside_after, faces)]] = True
        ends = np.stack([depths[seen], after[seen]])
        kink, pull = _kinks(sight.bends, knot, ends), np.zeros(ends.shape[1])
        if middle is not None:
            pull = _pulls(sight.bends, middle, knot, ends)
        # Between knots the first are two straight lines, the second about a parabola.
        mean[seen] += sight.light * (kink / 2.0 + pull / 1.5)
        worst[seen] = np.maximum(worst[seen], kink + pull)
        depths, outside = after, outside_after
    return KnotErrors(float(np.minimum(mean, worst).max()), float(worst.max()))


def _kinks(bends: Bends, knot: int, ends: Float64) -> Float64:
    """Sags of vertices at depths ``(2, n)`` that pass bends after ``knot``: ``(n,)`` pixels."""
    found = np.zeros(ends.shape[1])
    nearer = _nearer(ends.min(axis=0, initial=0.0) < 0.0)
    for place, change in zip(bends.places, bends.changes, strict=True):
        before, after = ends[0] - place[knot], ends[1] - place[knot + 1]
        scale = change[knot : knot + 2].max() / place[knot : knot + 2].min()
        sag = scale * harmonic(np.abs(before), np.abs(after)) * nearer
        found += np.where(before * after < 0.0, sag, 0.0)
    return found


def _pulls(bends: Bends, middle: Bends, knot: int, ends: Float64) -> Float64:
    """How far blur is off in the middle after ``knot``, at depths ``(2, n)``: ``(n,)`` pixels."""
    w = ends.mean(axis=0)
    chord = bends.at(slice(knot, knot + 2)).circle(ends).mean(axis=0)
    away = np.abs(middle.at(slice(knot, knot + 1)).circle(w[None])[0] - chord)
    return np.asarray(np.where(w > 0.0, away / np.maximum(w, _NEAREST * middle.near[knot]), 0.0))


def _counted(moment: Float64, mean: Float64) -> Float64:
    """What counts of errors at one moment, and on average."""
    return np.maximum(np.minimum(mean, moment), moment / _MOMENT)


def _nearer(behind: NDArray[np.bool_]) -> Float64:
    """How much greater errors are before a bend where what is behind the eye is joined to it."""
    return np.where(behind, 1.0 / _NEAREST, 1.0)
