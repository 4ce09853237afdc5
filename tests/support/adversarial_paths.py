"""Motion paths and samples drawn where root finding is hard, in homogeneous pixel space.

``draw(rng, kind, count)`` returns points ``(count, 2, 3, 3)``: end, vertex, (X w, Y w, w), and
samples ``(count, 8, 2)`` whose coordinates float32 represents.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

SAMPLES = 8
"""Samples of each path."""

Shape = tuple[np.ndarray, np.ndarray]
"""Screen positions ``(count, 2, 3, 2)`` around the first sample, and w ``(count, 2, 3)``."""


def powers(rng: np.random.Generator, low: float, high: float, size: object) -> np.ndarray:
    """Numbers of either sign whose magnitude is 10 to a power in [low, high]."""
    return 10.0 ** rng.uniform(low, high, size) * rng.choice([-1.0, 1.0], size)


def generic(rng: np.random.Generator, count: int) -> Shape:
    return rng.normal(0, 6, (count, 2, 3, 2)), rng.uniform(0.2, 3.0, (count, 2, 3))


def translated(rng: np.random.Generator, count: int) -> Shape:
    """Rigid shapes over any distance: from 1e-9 pixels to thousands, and none at all."""
    xy, w = generic(rng, count)
    w[:, :, :] = w[:, :1, :1]
    step = powers(rng, -9, 3.5, (count, 1, 2)) * (rng.random((count, 1, 1)) < 0.9)
    xy[:, 1] = xy[:, 0] + step
    return xy, w


def nearly_resting(rng: np.random.Generator, count: int) -> Shape:
    xy, w = generic(rng, count)
    xy[:, 1] = xy[:, 0] + powers(rng, -14, -3, (count, 3, 2))
    w[:, 1] = w[:, 0] * (1.0 + powers(rng, -15, -5, (count, 3)))
    return xy, w


def pivoting(rng: np.random.Generator, count: int) -> Shape:
    """One vertex, or a whole edge, rests; sometimes on a sample."""
    xy, w = generic(rng, count)
    rests = rng.integers(1, 3, count)[:, None] > np.arange(3)
    xy[:, 1][rests], w[:, 1][rests] = xy[:, 0][rests], w[:, 0][rests]
    on = rng.random(count) < 0.3
    xy[on, :, 0] = 0.0
    return xy, w


def on_a_grid(rng: np.random.Generator, count: int) -> Shape:
    """Whole numbers: shared vertices, edges through samples, roots at 0 and 1, equal vertices."""
    xy = rng.integers(-3, 4, (count, 2, 3, 2)).astype(float)
    return xy, 2.0 ** rng.integers(-1, 2, (count, 2, 3))


def turning_over(rng: np.random.Generator, count: int) -> Shape:
    """Front to back once: through a line, through a point, or nearly so."""
    xy, w = generic(rng, count)
    through = rng.random((count, 1, 1)) * np.where(rng.random((count, 1, 1)) < 0.5, 0.0, 1.0)
    xy[:, 1] = -xy[:, 0] * rng.choice([1.0, 0.3, 4.0], (count, 1, 1)) + through
    line = rng.random(count) < 0.5
    xy[line, 1, :, 1] = xy[line, 0, :, 1]
    w[:, 1] = np.where(rng.random((count, 1)) < 0.5, w[:, 0], w[:, 1])
    return xy, w


def turning_over_twice(rng: np.random.Generator, count: int) -> Shape:
    """The area's quadratic has equal signs at the ends and another, or nearly, in between."""
    found = []
    while sum(map(len, found)) < count:
        xy = rng.normal(0, 6, (4096, 2, 3, 2))
        u, v = xy[:, :, 1] - xy[:, :, 0], xy[:, :, 2] - xy[:, :, 0]
        a0, a1 = (u[:, k, 0] * v[:, k, 1] - u[:, k, 1] * v[:, k, 0] for k in (0, 1))
        mixed = [u[:, i, 0] * v[:, j, 1] - u[:, i, 1] * v[:, j, 0] for i, j in ((0, 1), (1, 0))]
        middle = 0.5 * sum(mixed)
        twice = (a0 * a1 > 0) & (a0 * middle < 0) & (middle**2 > 0.98 * a0 * a1)
        found.append(xy[twice])
    xy = np.concatenate(found)[:count]
    w = np.broadcast_to(rng.uniform(0.5, 3.0, (count, 1, 1)), (count, 2, 3)).copy()
    return xy, w


def collapsing(rng: np.random.Generator, count: int) -> Shape:
    """Starts or ends as a segment, as a point, or as a needle."""
    xy, w = generic(rng, count)
    end = rng.integers(0, 2, count)
    row = np.arange(count)
    xy[row, end, 1] = xy[row, end, 0] + powers(rng, -12, -1, (count, 2)) * (
        rng.random((count, 1)) < 0.5
    )
    point = rng.random(count) < 0.3
    xy[row[point], end[point], 2] = xy[row[point], end[point], 0]
    w[:] = np.where(rng.random((count, 1, 1)) < 0.5, w[:, :, :1], w)
    return xy, w


def needles(rng: np.random.Generator, count: int) -> Shape:
    """A millionth of a pixel to a tenth wide, up to thousands long."""
    xy, w = generic(rng, count)
    direction = xy[:, :, 1] - xy[:, :, 0]
    long = 10.0 ** rng.uniform(0, 3, (count, 1, 1))
    part = rng.uniform(0, 1, (count, 2, 1))
    xy[:, :, 1] = xy[:, :, 0] + direction * long
    xy[:, :, 2] = xy[:, :, 0] + part * direction * long + powers(rng, -6, -1, (count, 2, 2))
    return xy, w


def small_and_fast(rng: np.random.Generator, count: int) -> Shape:
    """Below a pixel, hundreds of pixels in one shutter."""
    middle = powers(rng, 1.5, 3.2, (count, 1, 1, 2))
    part = rng.uniform(0.05, 0.95, (count, 1, 1, 1))
    middle = np.concatenate([-part * middle, (1.0 - part) * middle], axis=1)
    xy = middle + rng.normal(0, 1, (count, 2, 3, 2)) * 10.0 ** rng.uniform(-4, 0, (count, 1, 1, 1))
    return xy, np.broadcast_to(rng.uniform(0.5, 3, (count, 2, 1)), (count, 2, 3)).copy()


def through_the_eye_plane(rng: np.random.Generator, count: int) -> Shape:
    """w below, near, at and through zero."""
    xy, w = generic(rng, count)
    w = rng.uniform(-1.0, 2.0, (count, 2, 3))
    w = np.where(rng.random(w.shape) < 0.2, powers(rng, -12, -2, w.shape), w)
    w = np.where(rng.random(w.shape) < 0.05, 0.0, w)
    return xy, w


def near_the_eye_plane(rng: np.random.Generator, count: int) -> Shape:
    """All ahead of the eye, some vertices by very little: screen positions at great distance."""
    xy, w = generic(rng, count)
    close = rng.random(w.shape) < 0.4
    w = np.where(close, 10.0 ** rng.uniform(-9, -2, w.shape), w)
    xy = np.where(close[..., None], xy / w[..., None], xy)
    return xy, w


SHAPES: dict[str, Callable[[np.random.Generator, int], Shape]] = {
    "generic": generic,
    "translated": translated,
    "nearly resting": nearly_resting,
    "pivoting": pivoting,
    "on a grid": on_a_grid,
    "turning over": turning_over,
    "turning over twice": turning_over_twice,
    "collapsing": collapsing,
    "needles": needles,
    "small and fast": small_and_fast,
    "through the eye plane": through_the_eye_plane,
    "near the eye plane": near_the_eye_plane,
}
KINDS = (*SHAPES, "tangent")


def offsets_of(rng: np.random.Generator, xy: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Samples ``(count, 8, 2)`` around the first, which is 0: most lie on the path somewhere."""
    count = len(xy)
    tau = rng.random((count, SAMPLES, 1, 1))
    tau[:, 4:6] = rng.integers(0, 2, (count, 2, 1, 1))
    points = np.concatenate([xy * w[..., None], w[..., None]], axis=-1)
    now = (1.0 - tau) * points[:, None, 0] + tau * points[:, None, 1]
    weight = rng.dirichlet((0.6, 0.6, 0.6), (count, SAMPLES))
    weight[:, 3:5] = np.eye(3)[rng.integers(0, 3, (count, 2))]  # on a vertex, moving or at an end
    weight[:, 5, 0], weight[:, 5, 1:] = 0.0, 0.5  # on an edge at an end
    at = np.einsum("ksv,ksva->ksa", weight, now)
    with np.errstate(divide="ignore", invalid="ignore"):
        offsets = at[..., :2] / at[..., 2:]
    offsets[~(np.abs(offsets) < 3000.0).all(axis=-1)] = 1.0
    offsets[:, 1] += powers(rng, -7, 1, (count, 2))
    offsets[:, 0] = 0.0
    return offsets


def tangent(rng: np.random.Generator, count: int) -> Shape:
    """The first sample is touched by the line of an edge, or missed by 1e-13 to 1e-1 pixels."""
    xy, w = generic(rng, count)
    points = np.concatenate([xy * w[..., None], w[..., None]], axis=-1)
    (p, q), (r, s) = points[:, 0, :2].swapaxes(0, 1), points[:, 1, :2].swapaxes(0, 1)
    line = [np.cross(p, q), 0.5 * (np.cross(p, s) + np.cross(r, q)), np.cross(r, s)]
    t = rng.random((count, 1))
    value = (1 - t) ** 2 * line[0] + 2 * t * (1 - t) * line[1] + t**2 * line[2]
    slope = 2 * ((1 - t) * (line[1] - line[0]) + t * (line[2] - line[1]))
    touch = np.cross(value, slope)
    touch = touch[:, :2] / touch[:, 2:]
    normal = value[:, :2] / np.linalg.norm(value[:, :2], axis=1, keepdims=True)
    touch += normal * powers(rng, -13, -1, (count, 1)) * (rng.random((count, 1)) < 0.9)
    return xy - touch[:, None, None], w


def draw(rng: np.random.Generator, kind: str, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Paths of one of ``KINDS`` and their samples."""
    xy, w = tangent(rng, count) if kind == "tangent" else SHAPES[kind](rng, count)
    # Whole places times a w of few bits are not rounded: what rests on the sample does so exactly.
    whole = rng.random((count, 1)) < 0.7
    first = rng.uniform(0, 1024, (count, 2)).astype(np.float32).astype(np.float64)
    first = np.where(whole, np.rint(first), first)
    w = np.where(whole[..., None] & (np.abs(w) > 1e-3), np.rint(w * 2.0**24) / 2.0**24, w)
    offsets = offsets_of(rng, xy, w)
    samples = (first[:, None] + offsets).astype(np.float32).astype(np.float64)
    shifted = np.concatenate([xy * w[..., None], w[..., None]], axis=-1)
    shifted[..., :2] += first[:, None, None] * w[..., None]
    return shifted, samples
