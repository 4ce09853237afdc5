"""Rays of samples: where the camera is, and through which point of its lens each sample looks.

What a sample at (X, Y) sees through a point of a thin lens are all points whose projection, moved
by the lens point times the circle of confusion at their depth, is (X, Y). With w times the circle,
c(w), affine in the depth w along the view, these points lie on a straight ray A + w B; where limits
bend c, on several pieces of rays, each for depths of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .tracks import at, matrices

SENSOR = 24.0
"""Height in millimetres of the sensor of a camera that is given by its field of view."""


@dataclass(frozen=True, eq=False)
class Poses:
    """The camera at G instants.

    ``axes`` ``(G, 3, 3)`` are its right, up and backward directions in the world, as rows;
    ``focal`` in heights of the image; ``radius`` of the lens and ``focus`` in world units.
    """

    eye: np.ndarray
    axes: np.ndarray
    focal: np.ndarray
    radius: np.ndarray
    focus: np.ndarray


@dataclass(frozen=True, eq=False)
class Piece:
    """Rays A + w B, ``(G, P, 3)`` in the world, for depths from ``low`` to ``high`` ``(G, 1)``."""

    start: np.ndarray
    way: np.ndarray
    low: np.ndarray
    high: np.ndarray


def poses_at(camera: Any, frames: np.ndarray, aspect: float) -> Poses:
    if camera.transform is not None:
        place = matrices(camera.transform, frames)
        eye, axes = place[:, :3, 3], place[:, :3, :3].swapaxes(1, 2)
        axes = axes / np.linalg.norm(axes, axis=2, keepdims=True)
    else:
        eye = at(camera.position, frames)
        ahead = np.broadcast_to([0.0, 0.0, -1.0], eye.shape)
        if camera.look_at is not None:
            ahead = at(camera.look_at, frames) - eye
        right = np.cross(ahead, at(camera.up, frames))
        axes = np.stack([right, np.cross(right, ahead), -ahead], axis=1)
        axes = axes / np.linalg.norm(axes, axis=2, keepdims=True)
    if camera.focal_length is None:
        fov = at(45.0 if camera.fov is None else camera.fov, frames)
        focal = 0.5 / np.tan(np.radians(fov) / 2.0)
        millimetres = focal * SENSOR
    else:
        millimetres = at(camera.focal_length, frames)
        height = camera.vertical_aperture
        if height is None:
            wide = camera.horizontal_aperture
            height = SENSOR if wide is None else wide / aspect
        focal = millimetres / height
    radius, focus = np.zeros(len(frames)), np.ones(len(frames))
    if camera.f_stop is not None:
        radius = millimetres * 1e-3 / camera.meters_per_unit / at(camera.f_stop, frames) / 2.0
        focus = at(camera.focus_distance, frames)
    return Poses(eye, axes, focal, radius, focus)


def lens_points(camera: Any, square: np.ndarray) -> np.ndarray:
    """Points of the lens, right and down in the picture, for ``(..., 2)`` in the unit square."""
    r, turn = np.sqrt(square[..., :1]), square[..., 1:]
    if not camera.blades:
        angle = 2.0 * np.pi * turn
        return r * np.concatenate([np.cos(angle), np.sin(angle)], axis=-1)
    blade, along = np.divmod(turn * camera.blades, 1.0)
    angle = 2.0 * np.pi * blade / camera.blades + np.radians(camera.blade_rotation)
    step = 2.0 * np.pi / camera.blades
    p = np.concatenate([np.cos(angle), np.sin(angle)], axis=-1)
    q = np.concatenate([np.cos(angle + step), np.sin(angle + step)], axis=-1)
    return r * (p + along * (q - p))


def _circles(
    camera: Any, poses: Poses, height: int
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Pieces of c(w) = c0 + c1 w in pixels: (c0, c1, low, high), each ``(G,)``."""
    full = poses.radius * poses.focal * height  # c(w) = full (w / focus - 1)
    slope, zero, far = full / poses.focus, np.zeros_like(full), np.full_like(full, np.inf)
    if camera.sharp_range is None and camera.foreground_blur is None:
        return [(-full, slope, zero, far)]
    if camera.sharp_range is None:
        near_edge = far_edge = poses.focus
    else:
        near_edge, far_edge = (np.full_like(full, edge) for edge in camera.sharp_range)
    limit = np.inf if camera.foreground_blur is None else camera.foreground_blur * height
    # Before the near edge c falls as slope (w - near), but not below -limit w.
    bent = zero if limit == np.inf else slope * near_edge / (slope + limit)
    return [
        *([] if limit == np.inf else [(zero, np.full_like(full, -limit), zero, bent)]),
        (-slope * near_edge, slope, bent, near_edge),
        (zero, zero, near_edge, far_edge),
        (-slope * far_edge, slope, far_edge, far),
    ]


def rays(
    camera: Any, poses: Poses, places: np.ndarray, lens: np.ndarray | None, size: tuple[int, int]
) -> list[Piece]:
    """Rays of samples at ``places`` ``(G, P, 2)`` in pixels, through ``lens`` points if any."""
    width, height = size
    focal = (poses.focal * height)[:, None]
    x = (places[..., 0] - width / 2.0) / focal
    y = -(places[..., 1] - height / 2.0) / focal
    to_world = poses.axes
    eye = np.broadcast_to(poses.eye[:, None], (*places.shape[:2], 3))
    straight = np.stack([x, y, np.full_like(x, -1.0)], axis=-1)
    whole = np.zeros((len(eye), 1)), np.full((len(eye), 1), np.inf)
    if lens is None or not poses.radius.any():
        return [Piece(eye, straight @ to_world, *whole)]
    found = []
    flipped = lens * [1.0, -1.0]
    for constant, linear, low, high in _circles(camera, poses, height):
        start, way = np.zeros_like(straight), straight.copy()
        start[..., :2] = -flipped * (constant[:, None] / focal)[..., None]
        way[..., :2] -= flipped * (linear[:, None] / focal)[..., None]
        found.append(Piece(eye + start @ to_world, way @ to_world, low[:, None], high[:, None]))
    return found


def projected(poses: Poses, points: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Pixels and depth ``(G, n, 3)`` of points in the world, through the middle of the lens."""
    seen = (points - poses.eye[:, None]) @ poses.axes.swapaxes(1, 2)
    depth = -seen[..., 2]
    focal = (poses.focal * size[1])[:, None]
    x = size[0] / 2.0 + focal * seen[..., 0] / depth
    return np.stack([x, size[1] / 2.0 - focal * seen[..., 1] / depth, depth], axis=-1)
