"""Visible spans that a test makes up, for the stages that colour and record them.

Samples have four triangles each that cover them all the time, with colours at their corners that
change, and two stacks of one to four of these, one after the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from reference.rays import at_time, see

from mbinterval.device import records
from support.kernels import one_material, shapes_and_depths, vertices_of
from support.stage_lists import LAYERS, SAMPLES, TILE, around, times_within

DEEP = 4
PIXELS = TILE * TILE
ALPHAS = (1.0, 0.75, 0.5, 2.0**-20, 0.0)


@dataclass(frozen=True, eq=False)
class Spans:
    """Samples ``xy`` ``(S, 2)``; paths, four of each sample in turn, ``points`` ``(P, 2, 3, 3)``.

    ``base`` ``(P, 3)`` colours of paths, ``corner`` ``(2, P, 3, 3)`` of their corners at both
    ends, 1 where ``flat`` ``(P,)``; ``alpha`` ``(P,)``. Stacks ``t`` ``(S, 2, 2)`` and layers of
    each, ``size`` ``(S, 2)``; ``weight`` ``(S, 2)`` of spans and ``share`` ``(S,)`` of samples.
    """

    xy: np.ndarray
    points: np.ndarray
    base: np.ndarray
    corner: np.ndarray
    flat: np.ndarray
    alpha: np.ndarray
    t: np.ndarray
    size: np.ndarray
    weight: np.ndarray
    share: np.ndarray

    def layers(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Sample, stack and path of each span, in the order of the pool."""
        flat = self.size.ravel()
        stack = np.repeat(np.arange(len(flat)), flat)
        layer = np.arange(len(stack)) - np.repeat(np.cumsum(flat) - flat, flat)
        return stack // 2, stack, stack // 2 * DEEP + layer

    def color(self, path: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Colour ``(M, 3)`` of paths where their samples see them, at times."""
        x, y = self.xy[path // DEEP].T
        _, share, _ = see(at_time(self.points[path], t), x, y)
        part = t[:, None, None]
        now = (1 - part) * self.corner[0, path] + part * self.corner[1, path]
        return self.base[path] * np.einsum("mv,mva->ma", share, now)

    def mean_color(self, path: np.ndarray, t0: np.ndarray, t1: np.ndarray, n: int) -> np.ndarray:
        """Its mean at the middles of n equal parts of [t0, t1]."""
        return sum(self.color(path, t0 + (k + 0.5) / n * (t1 - t0)) for k in range(n)) / n

    def depth(self, path: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Depth of paths where their samples see them, at times."""
        return see(at_time(self.points[path], t), *self.xy[path // DEEP].T)[0]

    def mean_depth(self, path: np.ndarray, t0: np.ndarray, t1: np.ndarray) -> np.ndarray:
        """Its mean over [t0, t1], by Gauss's rule in parts that halve towards both ends."""
        places, weights = np.polynomial.legendre.leggauss(12)
        half = 2.0 ** -np.arange(30, 0, -1)
        cuts = np.concatenate([[0.0], half, 1.0 - half[-2::-1], [1.0]])
        parts = (cuts[:-1, None] + np.diff(cuts)[:, None] * (0.5 + 0.5 * places)).ravel()
        shares = (0.5 * np.diff(cuts)[:, None] * weights).ravel()
        return sum(
            share * self.depth(path, t0 + part * (t1 - t0))
            for part, share in zip(parts, shares, strict=True)
        )


def draw(seed: int, deep: bool) -> Spans:
    """Stacks of up to four layers, or of one."""
    rng = np.random.default_rng(seed)
    count = SAMPLES * DEEP
    xy = rng.choice([0.0, 0.5, 255.96875, 4095.0], (SAMPLES, 2)) + rng.uniform(0, 1, (SAMPLES, 2))
    xy = xy.astype(np.float32).astype(np.float64)
    w = rng.uniform(0.5, 2.0, (count, 2, 3)) * rng.choice([1e-6, 1.0, 1e6], (count, 1, 1))
    still = rng.random(count) < 0.2
    w[still, 1] = w[still, 0]
    points = around(rng, np.repeat(xy, DEEP, axis=0), w, still)
    base = rng.choice([0.0, 0.5, 1.0, 1000.0], (count, 3))
    corner = rng.choice([0.0, 1.0], (2, count, 3, 3))
    corner = np.where(rng.random(corner.shape) < 2 / 3, corner, rng.random(corner.shape))
    flat = rng.random(count) < 0.2
    corner[:, flat] = 1.0
    t = np.sort(rng.random((SAMPLES, 4)), axis=1).reshape(SAMPLES, 2, 2)
    ends = times_within(rng, np.tile([0.0, 1.0], (SAMPLES, 1))).astype(np.float64)
    t[::2] = np.stack([ends, np.column_stack([ends[:, 1], np.ones(SAMPLES)])], axis=1)[::2]
    size = rng.integers(1, DEEP + 1, (SAMPLES, 2)) if deep else np.ones((SAMPLES, 2), int)
    size[t[..., 0] >= t[..., 1]] = 0
    alpha = rng.choice(ALPHAS, count) if deep else np.ones(count)
    return Spans(xy, points, base, corner.astype(np.float32), flat, alpha,
                 t.astype(np.float32).astype(np.float64), size,
                 rng.choice([0.0, 1.0, 0.37], (SAMPLES, 2)),
                 rng.choice([1.0, -0.5, 2.25], SAMPLES))  # fmt: skip


def tables(of: Spans) -> dict[str, np.ndarray]:
    """The records that stages "shade" and "record" read."""
    count = len(of.points)
    paths = np.zeros(count, records.PATH)
    for corner, name in enumerate("abc"):
        paths[name] = 3 * np.arange(count) + corner
    paths["step"], paths["close"], paths["color"], paths["alpha"] = 3 * count, 1, of.base, of.alpha
    vertices = vertices_of(of.points.swapaxes(0, 1))
    shapes, depths = shapes_and_depths(vertices, paths)
    paths["mesh"] = of.flat
    mesh, material = one_material()
    meshes = np.concatenate([mesh, mesh])
    meshes["count"], meshes["color"], meshes["color_step"] = 3 * count, [0, records.NONE], 1
    places = np.zeros(SAMPLES, records.PLACE)
    places["x"], places["y"] = of.xy.T
    sample, stack, path = of.layers()
    spans = np.zeros(len(sample), records.SPAN)
    spans["t0"], spans["t1"] = of.t.reshape(-1, 2)[stack].T
    spans["weight"], spans["source"] = of.weight.ravel()[stack], path
    runs = np.zeros(SAMPLES, records.RUN)
    runs["count"] = of.size.sum(axis=1)
    runs["start"] = np.cumsum(runs["count"]) - runs["count"]
    return {
        "vertices": vertices, "paths": paths, "shapes": shapes, "depths": depths, "meshes": meshes,
        "materials": material, "vertex_colors": of.corner.astype(np.float32), "places": places,
        "weights": of.share.astype(np.float32), "spans": spans, "span_runs": runs,
    }  # fmt: skip


def rests(of: Spans) -> np.ndarray:
    """Share of light ``(spans,)`` that passes what is before each span in its stack."""
    _, stack, path = of.layers()
    rest = np.ones(len(path))
    for k in range(1, len(path)):
        if stack[k] == stack[k - 1]:
            rest[k] = rest[k - 1] * (1.0 - of.alpha[path[k - 1]])
    return rest


SIZES = {"TILE": TILE, "LAYERS": LAYERS, "MASK_BITS": None}
EFFECTS = ("EXACT", "MOVING", "PLACED", "WEIGHTED", "VERTEX_COLOR")
