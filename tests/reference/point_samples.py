"""Point samples in time, place and lens, path by path in float64: no culling, no shared code.

A vertex at time t is the linear blend of its two ends in homogeneous pixel space, moved by the
lens point times its circle of confusion, blended likewise. The triangle of three such vertices is
then hit as a plain one is (hits.py), zeros decided by the perturbed sample.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mbinterval.exposure.exposure import CameraPoses, Exposure

from .hits import edge
from .paths import Paths, paths_of


class Drawn(NamedTuple):
    """Samples: place in pixels, time of the shutter, point of the lens; arrays of one shape."""

    x: np.ndarray
    y: np.ndarray
    t: np.ndarray
    u: np.ndarray
    v: np.ndarray


def circles(w: np.ndarray, poses: CameraPoses, index: int, height: int) -> np.ndarray:
    """Circle of confusion times w of a thin lens without limits."""
    scale = poses.aperture[index] * poses.focal[index] * height
    return scale * (w / poses.focus[index] - 1.0)


def path_circles(exposure: Exposure, paths: Paths, height: int) -> np.ndarray:
    """Circles ``(P, 2, 3)`` of the paths' corners."""
    result = np.zeros(paths.points.shape[:3])
    for k in range(len(paths)):
        count = int(paths.segments[k])
        poses = exposure.meshes[paths.mesh[k]].poses
        for end in range(2):
            time = min(int(paths.segment[k]) + end, count)
            result[k, end] = circles(paths.points[k, end, :, 2], poses, time, height)
    return result


def covered(
    points: np.ndarray, circle: np.ndarray, local: np.ndarray, drawn: Drawn
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """One path ``(2, 3, 3)`` at samples ``(M,)``: hit, depth, and how sure that is.

    Sureness is the least distance of an edge to the sample in pixels, more or less.
    """
    t = local[:, None, None]
    now = (1.0 - t) * points[0] + t * points[1]
    blur = (1.0 - t[..., 0]) * circle[0] + t[..., 0] * circle[1]
    v = np.empty_like(now)
    v[..., 0] = now[..., 0] + drawn.u[:, None] * blur - drawn.x[:, None] * now[..., 2]
    v[..., 1] = now[..., 1] + drawn.v[:, None] * blur - drawn.y[:, None] * now[..., 2]
    v[..., 2] = now[..., 2]
    pairs = ((1, 2), (2, 0), (0, 1))
    found = [edge(v[:, a], v[:, b]) for a, b in pairs]
    (e0, s0), (e1, s1), (e2, s2) = found
    total = e0 + e1 + e2
    same = (s0 == s1) & (s1 == s2) & (s0 != 0) & (total != 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        w = (e0 * v[:, 0, 2] + e1 * v[:, 1, 2] + e2 * v[:, 2, 2]) / total
        sizes = [np.hypot(*(v[:, a, k] * v[:, b, 2] - v[:, b, k] * v[:, a, 2] for k in (0, 1)))
                 for a, b in pairs]  # fmt: skip
        away = [np.abs(e) / size for (e, _), size in zip(found, sizes, strict=True)]
    sure = np.nan_to_num(np.min(away, axis=0), nan=0.0)
    return same & (w > 0), w, sure


def nearest_paths(
    exposure: Exposure, width: int, height: int, drawn: Drawn
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Index of the path that each sample sees, -1 for none; colours by path; depth.

    Of equal depths the first path is seen, static meshes first.
    """
    paths = paths_of(exposure, width, height, attributes=False)
    circle = path_circles(exposure, paths, height)
    flat = Drawn(*(part.ravel() for part in drawn))
    best = np.full(flat.t.shape, -1)
    depth = np.full(flat.t.shape, np.inf)
    for k in np.argsort(paths.segments > 0, kind="stable"):
        low, high = paths.window[k]
        place = (flat.t - low) / (high - low)
        last = high >= 1.0
        if paths.segments[k] == 0:
            place = np.zeros_like(place)
        on = np.flatnonzero((place >= 0) & ((place < 1) | last))
        hit, w, _ = covered(
            paths.points[k], circle[k], place[on], Drawn(*(part[on] for part in flat))
        )
        if paths.single_sided[k]:
            hit &= _front(paths.points[k], circle[k], place[on], Drawn(*(p[on] for p in flat)))
        nearer = on[hit & (w < depth[on])]
        depth[nearer] = w[hit & (w < depth[on])]
        best[nearer] = k
    shape = drawn.t.shape
    return best.reshape(shape), paths.color, depth.reshape(shape)


def _front(points: np.ndarray, circle: np.ndarray, t: np.ndarray, drawn: Drawn) -> np.ndarray:
    t = t[:, None, None]
    now = (1.0 - t) * points[0] + t * points[1]
    blur = (1.0 - t[..., 0]) * circle[0] + t[..., 0] * circle[1]
    now = now.copy()
    now[..., 0] += drawn.u[:, None] * blur
    now[..., 1] += drawn.v[:, None] * blur
    return np.asarray(np.linalg.det(now) < 0)
