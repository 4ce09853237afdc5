"""The camera over the shutter for what is infinitely far: how it turns, and how its view widens."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbinterval.exposure.asked import Asked
from mbinterval.exposure.camera_path import CameraPath, Chords
from mbinterval.exposure.poses import CameraPoses, pixel_matrix

Float64 = NDArray[np.float64]

_SHARE = 0.9
"""Of the error that is allowed, for what lies between the places and times that are looked at."""


@dataclass(frozen=True, eq=False)
class Turning:
    """A stretch of the shutter without a cut; ``poses`` at its ``knots`` (K+1,)."""

    knots: Float64
    poses: CameraPoses


def turnings(path: CameraPath, aspect: float, height: int, asked: Asked) -> tuple[Turning, ...]:
    """Return the camera over the whole shutter, in segments that rays are linear between.

    They have the knots of its chords, and as many more as keep a direction within ``asked.error``
    pixels of where these see it.
    """
    found = []
    for part in path.parts:
        knots = part.knots
        while path.moves and asked.segments is None and len(knots) <= asked.most:
            middles = 0.5 * (knots[1:] + knots[:-1])
            wide = _errors(part, knots, middles, aspect, height) > _SHARE * asked.error
            if not wide.any():
                break
            added = middles[wide].astype(np.float32).astype(np.float64)
            knots = np.union1d(knots, added)
        found.append(Turning(knots, part.at(knots)))
    return tuple(found)


def inverses(poses: CameraPoses, width: float, height: float) -> Float64:
    """``(T, 3, 3)``: what maps pixels (X, Y, 1) to rays in the world."""
    rays = []
    for view in poses.view:
        rays.append(np.linalg.inv(pixel_matrix(width, height) @ view))
    return np.array(rays)


def _errors(part: Chords, knots: Float64, middles: Float64, aspect: float, height: int) -> Float64:
    """Pixels by which rays between knots are off in the ``middles``, in the frame, at most."""
    width = aspect * height
    grid = np.meshgrid([0.0, width / 2, width], [0.0, height / 2, height], [1.0])
    places = np.stack(grid, axis=-1).reshape(-1, 3)
    ends = inverses(part.at(knots), width, height) @ places.T
    poses = part.at(middles)
    true = _unit(inverses(poses, width, height) @ places.T)
    away = np.linalg.norm(true - _unit(0.5 * (ends[:-1] + ends[1:])), axis=1).max(axis=1)
    return np.asarray(away * poses.focal * height)


def _unit(rays: Float64) -> Float64:
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))
