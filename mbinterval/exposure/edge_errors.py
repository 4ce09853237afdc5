"""Where bends of the blur lie on a moving edge, and how far it is from a straight line there.

An end's *height* over a bend is its depth minus the bend's place, linear in time within a motion
segment. While the heights of both ends have opposite signs, a and b from 0, the bend is on the
edge, at a/(a+b) of it; a straight line in place of ``max(0, height)`` is off by ab/(a+b) there, and
by less elsewhere. Neighbours must find the same bits, so that all of this goes element by element.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Piece:
    """Times from ``first`` to ``last`` of each segment, ``(K, E)``, without a change of sign.

    Distances of both ends from the bend are ``a + t da`` and ``b + t db`` there; ``across`` says
    where the bend is between them.
    """

    first: Float64
    last: Float64
    a: Float64
    da: Float64
    b: Float64
    db: Float64
    across: NDArray[np.bool_]

    def distances(self, time: Float64) -> tuple[Float64, Float64]:
        return (
            np.maximum(self.a + time * self.da, 0.0),
            np.maximum(self.b + time * self.db, 0.0),
        )


def sags(a: Float64, b: Float64) -> tuple[Float64, Float64]:
    """Greatest ab/(a+b) in each segment and its mean, or a little more: ``(K, E)`` each.

    Of heights ``(K+1, E)``; 0 where there is no bend between the ends. It is concave in time, so
    that a mean is at most the value in the middle.
    """
    most, mean = np.zeros_like(a[1:]), np.zeros_like(a[1:])
    for piece in _pieces(a, b):
        for time in (piece.first, _time_of_greatest(piece), piece.last):
            sag = harmonic(*piece.distances(time))
            most = np.where(piece.across, np.maximum(most, sag), most)
        middle = harmonic(*piece.distances(0.5 * (piece.first + piece.last)))
        mean += np.where(piece.across, (piece.last - piece.first) * middle, 0.0)
    return most, mean


def swept(a: Float64, b: Float64) -> tuple[Float64, Float64]:
    """First and last part of each edge, from 0 to 1, where the bend ever is: ``(E,)`` each.

    1 and 0 where it never is.
    """
    low, high = np.ones_like(a[0]), np.zeros_like(a[0])
    for piece in _pieces(a, b):
        for time in (piece.first, piece.last):
            near, far = piece.distances(time)
            there = piece.across & (near + far > 0.0)
            place = near / np.where(there, near + far, 1.0)
            low = np.minimum(low, np.where(there, place, 1.0).min(axis=0))
            high = np.maximum(high, np.where(there, place, 0.0).max(axis=0))
    return low, high


def harmonic(a: Float64, b: Float64) -> Float64:
    """ab/(a+b) of distances from 0, 0 where both are."""
    total = a + b
    return np.asarray(a * (b / np.where(total > 0.0, total, 1.0)))


def _pieces(a: Float64, b: Float64) -> Iterator[_Piece]:
    """Yield the three pieces of every segment: before, between and after the ends' zeros."""
    da, db = a[1:] - a[:-1], b[1:] - b[:-1]
    zeros = _zero(a[:-1], da), _zero(b[:-1], db)
    bounds = [np.zeros_like(da), np.minimum(*zeros), np.maximum(*zeros), np.ones_like(da)]
    for first, last in itertools.pairwise(bounds):
        middle = 0.5 * (first + last)
        sign_a, sign_b = np.sign(a[:-1] + middle * da), np.sign(b[:-1] + middle * db)
        across = (sign_a * sign_b < 0.0) & (last > first)
        yield _Piece(
            *(first, last, sign_a * a[:-1], sign_a * da, sign_b * b[:-1], sign_b * db, across)
        )


def _zero(start: Float64, change: Float64) -> Float64:
    """Time in [0, 1] at which a height is 0; 1 where it is at none."""
    time = -start / np.where(change != 0.0, change, 1.0)
    return np.where((change != 0.0) & (time > 0.0) & (time < 1.0), time, 1.0)


def _time_of_greatest(piece: _Piece) -> Float64:
    """Time of a piece at which ab/(a+b) is greatest, if that is between its ends.

    One distance grows and the other falls there, and b/a is the root of minus the slopes' ratio.
    """
    opposite = piece.across & (piece.da * piece.db < 0.0)
    ratio = np.sqrt(np.where(opposite, -piece.db / np.where(opposite, piece.da, 1.0), 1.0))
    slope = np.where(opposite, piece.db - ratio * piece.da, 1.0)
    time = np.where(opposite, (ratio * piece.a - piece.b) / slope, piece.first)
    return np.clip(time, piece.first, piece.last)
