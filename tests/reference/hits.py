"""Where a sample's eye ray meets plain triangles in homogeneous pixel space.

The vertices are shifted to the sample, x - X w and y - Y w; the edge through a and b is then
e = x_a y_b - x_b y_a, and e_i belongs to the edge opposite vertex i. A triangle is hit when all
three e have one sign and w = sum e_i w_i / sum e_i > 0. Where e is exactly 0, the sample is taken
to lie at (X + eps, Y + eps^2): the left and upper edges of a triangle belong to it, and of the
triangles around a point exactly one is hit. Nothing is clipped.
"""

from __future__ import annotations

import numpy as np

from .paths import Intervals, Paths
from .samples import Grid, Points

Samples = Grid | Points


def shifted(points: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Points ``(M, ..., 3)`` with the sample ``(M,)`` moved to the origin."""
    shape = (-1,) + (1,) * (points.ndim - 2)
    w = points[..., 2]
    return np.stack(
        [points[..., 0] - x.reshape(shape) * w, points[..., 1] - y.reshape(shape) * w, w], axis=-1
    )


def edge(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edge function of shifted points ``(M, 3)``, and its sign after the perturbation."""
    value = a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]
    sign = np.sign(value)
    on = np.flatnonzero(value == 0)
    if len(on):
        a, b = a[on], b[on]
        right = np.sign(b[:, 2] * a[:, 1] - a[:, 2] * b[:, 1])
        down = np.sign(b[:, 0] * a[:, 2] - a[:, 0] * b[:, 2])
        sign[on] = np.where(right != 0, right, down)
    return value, sign


def barycentrics(
    points: np.ndarray, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Hits of triangles ``(M, 3, 3)`` at samples ``(M,)``: index of the hits, weights, depth."""
    v = shifted(points, x, y)
    (e0, s0), (e1, s1), (e2, s2) = (
        edge(v[:, 1], v[:, 2]),
        edge(v[:, 2], v[:, 0]),
        edge(v[:, 0], v[:, 1]),
    )
    total = e0 + e1 + e2
    hit = np.flatnonzero((s0 == s1) & (s1 == s2) & (s0 != 0) & (total != 0))
    weight = np.stack([e0[hit], e1[hit], e2[hit]], axis=1) / total[hit, None]
    w = (weight * v[hit, :, 2]).sum(axis=1)
    ahead = w > 0
    return hit[ahead], weight[ahead], w[ahead]


def static_intervals(paths: Paths, samples: Samples) -> Intervals:
    """The nearest opaque static triangle of every sample, [0, 1) at constant depth.

    Equal depths go to the lower path index. Translucent ones are there wherever they are hit.
    """
    static = np.flatnonzero(paths.segments == 0)
    points = paths.points[static, 0]
    front = (np.linalg.det(points) < 0) | ~paths.single_sided[static]
    static, points = static[front], points[front]
    item, sample = samples.candidates(points)
    hit, weight, w = barycentrics(points[item], *samples.positions(sample))
    path, sample = static[item[hit]], sample[hit]
    opaque = np.flatnonzero(paths.opaque[path])
    order = opaque[np.lexsort((path[opaque], w[opaque], sample[opaque]))]
    order = order[np.diff(sample[order], prepend=-1) > 0]
    order = np.concatenate([order, np.flatnonzero(~paths.opaque[path])])
    path, sample, w, weight = path[order], sample[order], w[order], weight[order]
    values = np.einsum("hv,hva->ha", weight, paths.attributes[path, 0])
    return Intervals(
        sample=sample,
        path=path,
        t=np.tile([0.0, 1.0], (len(path), 1)),
        w=np.stack([w, w], axis=1),
        attributes=np.stack([values, values], axis=1),
    )
