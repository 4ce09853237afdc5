"""Many moving triangles in one tile, hard ones most of them, for the stages that meet them all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from reference.rays import at_time, is_front, see_clearly

from mbinterval.device import records
from support.adversarial_paths import SHAPES
from support.kernels import numbers, one_material, run, vertices_of

TILE = 16


@dataclass(frozen=True, eq=False)
class Triangles:
    """P paths of ``points`` ``(P, 2, 3, 3)``, from ``window`` ``(P, 2)`` of the shutter.

    ``single_sided`` ``(P,)``: these belong to mesh and material 1, others to 0. ``first`` ``(P,)``:
    the first path that is the same.
    """

    points: np.ndarray
    window: np.ndarray
    single_sided: np.ndarray
    first: np.ndarray

    def at(self, path: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Triangles ``(M, 3, 3)`` at times of the shutter, which must be those of their segment."""
        low, high = self.window[path].T
        return at_time(self.points[path], (t - low) / (high - low))

    def there(self, path: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Whether the motion segment of paths holds a time; of what rests, any does."""
        low, high = self.window[path].T
        return (low <= t) & ((t < high) | (high >= 1.0))

    def seen(
        self, path: np.ndarray, x: np.ndarray, y: np.ndarray, t: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Depths of paths at samples, whether they are seen, and whether that is sure."""
        now = self.at(path, t)
        depth, seen, sure = see_clearly(now, x, y)
        return depth, seen & (is_front(now) | ~self.single_sided[path]), sure


def draw(
    seed: int, count: int, corner: tuple[int, int], rests: bool = False, segments: bool = False
) -> Triangles:
    """``count`` triangles of all ``SHAPES`` in and about the tile at ``corner``.

    With ``segments`` some are there for a part of the shutter. Every eighth is the one before it
    once more.
    """
    rng = np.random.default_rng(seed)
    each = -(-count // len(SHAPES))
    parts = [shape(rng, each) for shape in SHAPES.values()]
    xy, w = (np.concatenate(part) for part in zip(*parts, strict=True))
    order = rng.permutation(len(xy))[:count]
    xy, w = xy[order], w[order]
    # None is a line or a point at an end: rounding alone says what that covers.
    (ax, ay), (bx, by) = (xy[:, :, 1:] - xy[:, :, :1]).transpose(2, 3, 0, 1)
    size = ax**2 + ay**2 + bx**2 + by**2
    flat = ((np.abs(ax * by - ay * bx) < 1e-10 * size) | (size < 1e-12)).any(axis=1)
    xy[flat] = xy[~flat][: np.count_nonzero(flat)] + 1.0
    if rests:
        xy[0], w[0] = np.array([[-99, -99], [-99, 299], [299, -99]]), 2.0  # behind most of them
    # A corner in the eye would hide all else, or would not: the test of "solve" has such ones.
    w = np.where(np.abs(w) < 1e-4, np.copysign(1e-4, w), w)
    xy = xy * np.where(rng.random(count) < 0.7, 0.5, 1.0)[:, None, None, None]
    w = w * np.where(w.min(axis=(1, 2)) < 0.1, 1024.0, 1.0)[:, None, None]
    place = rng.integers(0, 4 * TILE, (count, 2)) / 4.0
    place = np.where(rng.random((count, 1)) < 2 / 3, place, rng.uniform(0, TILE, place.shape))
    xy = xy + (place + corner)[:, None, None]
    points = np.concatenate([xy * w[..., None], w[..., None]], axis=-1)
    window = np.tile([0.0, 1.0], (count, 1))
    if segments:
        part = rng.random(count) < 0.3
        window[part] = np.array([[0.0, 0.25], [0.25, 0.5], [0.5, 1.0]])[
            rng.integers(0, 3, np.count_nonzero(part))
        ]
    single = rng.random(count) < 0.5
    if rests:
        points[:, 1] = points[:, 0]
    window[(points[:, 0] == points[:, 1]).all(axis=(1, 2))] = [0.0, 1.0]  # rest is for always
    first = np.arange(count)
    again = np.arange(7, count, 8)
    points[again], window[again] = points[again - 1], window[again - 1]
    single[again], first[again] = single[again - 1], again - 1
    return Triangles(points, window, single, first)


def tables(of: Triangles) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Vertices, paths, meshes and materials; vertices at both times of the one mesh follow."""
    count = len(of.points)
    paths = np.zeros(count, records.PATH)
    for corner, name in enumerate("abc"):
        paths[name] = 3 * np.arange(count) + corner
    moves = (of.points[:, 0] != of.points[:, 1]).any(axis=(1, 2))
    paths["step"], paths["mesh"] = np.where(moves, 3 * count, 0), of.single_sided
    paths["face"], paths["alpha"] = np.arange(count), 1.0
    paths["open"], paths["close"] = of.window.T
    both = [one_material(flags) for flags in (0, records.MATERIAL_SINGLE_SIDED)]
    meshes, materials = (np.concatenate(part) for part in zip(*both, strict=True))
    meshes["material"], meshes["count"] = [0, 1], 3 * count
    return vertices_of(of.points.swapaxes(0, 1)), paths, meshes, materials


def nearest_of(
    of: Triangles, x: np.ndarray, y: np.ndarray, t: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Path ``(S,)`` that each sample sees at its time, -1 for none; its depth; and whether sure.

    It is not where something may or may not be seen that would be no farther.
    """
    best, depth = np.full(len(x), -1), np.full(len(x), np.inf)
    doubt = np.full(len(x), np.inf)
    for path in range(len(of.points)):
        one = np.full(len(x), path)
        w, seen, sure = of.seen(one, x, y, t)
        there = of.there(one, t)
        w = np.where(np.isfinite(w), w, 0.0)
        doubt = np.where(there & ~sure, np.minimum(doubt, np.abs(w)), doubt)
        nearer = there & seen & (w < depth)
        best, depth = np.where(nearer, path, best), np.where(nearer, w, depth)
    return best, depth, doubt > depth * (1 + 1e-6)


POINTS = 64


def bounds_of(of: Triangles, circle: np.ndarray | None = None) -> np.ndarray:
    vertices, paths, meshes, materials = tables(of)
    if circle is not None:
        vertices["circle"] = circle.swapaxes(0, 1).ravel()
    told = numbers(width=4096, height=2160, path_count=len(paths))
    given = [told, vertices, paths, meshes, materials, np.zeros(1, records.CAMERA)]
    found = np.zeros(len(paths), records.BOUNDS)
    return run("stochastic/bounds.cl", "bounds", [*given, found], (), -(-len(paths) // 256))[-1]


def points_on(of: Triangles, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Path of points on triangles, when in its segment, and the corners' shares ``(M, 3)``."""
    rng = np.random.default_rng(seed)
    path = np.repeat(np.arange(len(of.points)), POINTS)
    tau = rng.choice([0.0, 1.0, 0.5], len(path))
    tau = np.where(rng.random(len(path)) < 2 / 3, tau, rng.random(len(path)))
    return path, tau, rng.dirichlet((0.5, 0.5, 0.5), len(path))


def circles(of: Triangles, seed: int) -> np.ndarray:
    """Circles of confusion ``(P, 2, 3)``, times w: none, small, or wider than tiles."""
    rng = np.random.default_rng(seed)
    size = rng.choice([0.0, 2.0, 30.0], (len(of.points), 1, 1))
    circle = size * rng.uniform(-1, 1, of.points.shape[:3]) * np.abs(of.points[..., 2])
    still = (of.points[:, 0] == of.points[:, 1]).all(axis=(1, 2))
    circle[still, 1] = circle[still, 0]
    return circle
