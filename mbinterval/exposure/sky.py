"""The camera over the shutter for what is infinitely far: how it turns, and how its view widens."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbinterval.exposure.poses import CameraPoses
from mbinterval.exposure.segments import MOST_SEGMENTS, View
from mbinterval.exposure.shutter_times import Stretch, stretches

Float64 = NDArray[np.float64]

_SHARE = 0.9
"""Of the error that is allowed, for what lies between the places and times that are looked at."""
_PARTS = np.array([0.211, 0.5, 0.789])
"""Parts of a segment at which it is compared with the camera's motion."""


@dataclass(frozen=True, eq=False)
class Turning:
    """A stretch of the shutter without a cut; ``poses`` at both ends of each of its segments."""

    stretch: Stretch
    poses: CameraPoses


def turnings(view: View, motion_segments: int | None, motion_error: float) -> tuple[Turning, ...]:
    """Return the camera over the whole shutter, in segments that rays are linear between.

    A direction is off by no more than ``motion_error`` pixels, or there are ``motion_segments``.
    """
    if not view.moves:
        return (_turning(view, Stretch(), 1),)
    found = []
    for stretch in stretches(view.window.times_of(view.camera.jumps), [(0.0, 1.0)]):
        count = motion_segments or 1
        while (
            motion_segments is None
            and count < MOST_SEGMENTS
            and _error(view, stretch, count) > _SHARE * motion_error
        ):
            count *= 2
        found.append(_turning(view, stretch, count))
    return tuple(found)


def _turning(view: View, stretch: Stretch, count: int) -> Turning:
    times = stretch.inside(stretch.ends(count), view.window)
    return Turning(stretch, view.poses(times))


def sky_moves(sky: tuple[Turning, ...]) -> bool:
    """Whether what is infinitely far moves through the frame, or in and out of focus."""
    if not sky:
        return False
    views = np.concatenate([_far_view(turning.poses) for turning in sky])
    return bool(np.any(views != views[:1]))


def _far_view(poses: CameraPoses) -> Float64:
    """``(T, 12)``: what counts of poses for what is infinitely far, which is all but the eye."""
    lens = np.stack([poses.focal, poses.aperture, poses.focus], axis=1)
    return np.concatenate([poses.rotation.reshape(-1, 9), lens], axis=1)


def inverses(poses: CameraPoses, width: float, height: float) -> Float64:
    """``(T, 3, 3)``: what maps pixels (X, Y, 1) to rays in the world."""
    rays = []
    for rotation, focal in zip(poses.rotation, poses.focal * height, strict=True):
        to_pixels = np.array([[focal, 0, -width / 2], [0, -focal, -height / 2], [0, 0, -1.0]])
        rays.append(rotation.T @ np.linalg.inv(to_pixels))
    return np.array(rays)


def _error(view: View, stretch: Stretch, count: int) -> float:
    """Greatest distance in pixels of the frame's corners, edges and middle from where they are."""
    width = view.aspect * view.height
    grid = np.meshgrid([0.0, width / 2, width], [0.0, view.height / 2, view.height], [1.0])
    places = np.stack(grid, axis=-1).reshape(-1, 3)
    ends = inverses(_turning(view, stretch, count).poses, width, view.height) @ places.T
    worst = 0.0
    for part in _PARTS:
        times = stretch.inside(stretch.at((np.arange(count) + part) / count), view.window)
        poses = view.poses(times)
        true = _unit(inverses(poses, width, view.height) @ places.T)
        path = _unit((1.0 - part) * ends[:-1] + part * ends[1:])
        away = np.linalg.norm(true - path, axis=1).max(axis=1)
        worst = max(worst, float((away * poses.focal).max()) * view.height)
    return worst


def _unit(rays: Float64) -> Float64:
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))
