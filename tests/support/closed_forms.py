"""Scenes whose motion blur has a closed form, the form, and geometry given in pixels.

Positions are in pixels, speeds in pixels per shutter, t in [0, 1] over the shutter.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbinterval.scene.model import Camera, Mesh, Scene

UNIT_CAMERA = Camera(focal_length=24.0)
"""At the origin, looking down -Z; its focal length is exactly one image height."""


def world(pixels: np.ndarray, w: np.ndarray | float, size: tuple[int, int]) -> np.ndarray:
    """World points ``(..., 3)`` that ``UNIT_CAMERA`` sees at ``pixels`` ``(..., 2)``, depth w."""
    pixels, width, height = np.asarray(pixels, dtype=np.float64), *size
    w = np.broadcast_to(w, pixels.shape[:-1]).astype(np.float64)
    x = (pixels[..., 0] - width / 2) * w / height
    y = -(pixels[..., 1] - height / 2) * w / height
    return np.stack([x, y, -w], axis=-1)


def rectangle(left: float, right: float, top: float, bottom: float) -> np.ndarray:
    """Corners ``(4, 2)`` in pixels, counter-clockwise as seen (y runs down)."""
    return np.array([[left, bottom], [right, bottom], [right, top], [left, top]], dtype=float)


FACES = np.array([[0, 1, 2], [0, 2, 3]])


def slab(
    start: np.ndarray,
    speed: tuple[float, float],
    w: float,
    size: tuple[int, int],
    color: Sequence[float] = (1.0, 1.0, 1.0),
    segments: int | None = None,
) -> Mesh:
    """A rectangle of corners ``start`` ``(4, 2)`` px, moving at ``speed``; (0, 0) is static."""
    ends = [start, start + np.asarray(speed, dtype=float)]
    positions = world(np.stack(ends), w, size)
    if not any(speed):
        positions = positions[0]
    return Mesh(
        positions=positions, faces=FACES, color=np.asarray(color), shading="unlit",
        motion_segments=segments,
    )  # fmt: skip


def scene(meshes: Sequence[Mesh], background: Sequence[float] = (0.0, 0.0, 0.0)) -> Scene:
    return Scene(meshes=meshes, camera=UNIT_CAMERA, background=tuple(background))


def slab_times(
    x: np.ndarray, left: float, right: float, speed: float
) -> tuple[np.ndarray, np.ndarray]:
    """When a slab [left + speed t, right + speed t) covers positions x: t0 and t1 in [0, 1]."""
    x = np.asarray(x, dtype=np.float64)
    if speed == 0:
        inside = (left <= x) & (x < right)
        return np.zeros_like(x), inside.astype(float)
    ends = np.stack([(x - left) / speed, (x - right) / speed])
    t0, t1 = np.clip(ends.min(axis=0), 0, 1), np.clip(ends.max(axis=0), 0, 1)
    return t0, t1


def overlap(a: tuple[np.ndarray, np.ndarray], b: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Length of the common part of two time ranges."""
    return np.maximum(np.minimum(a[1], b[1]) - np.maximum(a[0], b[0]), 0.0)


def slab_pixel_coverage(column: np.ndarray, left: float, right: float, speed: float) -> np.ndarray:
    """Coverage over shutter and pixels [column, column + 1) of a slab, speed not 0.

    An edge at ``e`` has passed x for the time clip((x - e) / speed, 0, 1), whose integral over x
    is a ramp's; the slab is the difference of its two edges.
    """

    def passed(x: np.ndarray, e: float) -> np.ndarray:
        # Integral of clip((u - e) / |speed|, 0, 1) du up to x.
        u = np.clip(x - e, 0.0, abs(speed))
        return u * u / (2.0 * abs(speed)) + np.maximum(x - e - abs(speed), 0.0)

    column = np.asarray(column, dtype=np.float64)
    if speed < 0:  # mirror in x
        return slab_pixel_coverage(-column - 1.0, -right, -left, -speed)

    def coverage(x: np.ndarray) -> np.ndarray:
        return passed(x, left) - passed(x, right)

    return coverage(column + 1.0) - coverage(column)


def pivot_time(
    sample: np.ndarray, pivot: np.ndarray, start: np.ndarray, end: np.ndarray
) -> np.ndarray:
    """When the line from ``pivot`` to a point moving from ``start`` to ``end`` meets samples.

    All in pixels at one depth; samples ``(..., 2)``. The cross product of (B(t) - A) and (P - A)
    is linear in t, so that its root has a closed form; it may lie outside [0, 1].
    """
    p = np.asarray(sample, dtype=np.float64) - pivot
    first, last = np.subtract(start, pivot), np.subtract(end, pivot)
    before = first[0] * p[..., 1] - first[1] * p[..., 0]
    after = last[0] * p[..., 1] - last[1] * p[..., 0]
    return before / (before - after)


def pivoting(size: tuple[int, int]) -> tuple[Scene, np.ndarray]:
    """A big triangle that turns about a corner, and when its leading edge meets the samples."""
    pivot, start, end = np.array([-20.0, 8.0]), np.array([90.0, 2.0]), np.array([90.0, 15.0])
    low = np.array([-20.0, 400.0])
    corners = np.array([[pivot, low, start], [pivot, low, end]])
    mesh = Mesh(positions=world(corners, 2.0, size), faces=[[0, 1, 2]], shading="unlit")
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    return scene([mesh]), pivot_time(np.stack([x, y], -1), pivot, start, end)
