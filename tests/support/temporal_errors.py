"""Covered times of (path, sample) pairs by several methods, and how they differ from the truth.

Two sets of intervals of a pair are compared by the stretches of time that only one of them
covers. Each stretch lies at an end of a true interval; how long it may be depends on how fast
the edge that makes this end passes over the sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from reference import exact, rational, triangulated
from reference.paths import make_paths

from mbinterval.device import records
from support.adversarial_paths import SAMPLES
from support.kernels import DEFAULTS, options, paths_of_points, run, shapes_of

SHARE = 1 << 16


@dataclass(frozen=True, eq=False)
class Cover:
    """Intervals ``t`` ``(I, 2)`` of pairs ``pair`` ``(I,)``, sorted by pair and start."""

    pair: np.ndarray
    t: np.ndarray

    @classmethod
    def sorted(cls, pair: np.ndarray, t: np.ndarray) -> Cover:
        order = np.lexsort((t[:, 0], pair))
        return cls(pair[order], t[order].astype(np.float64))

    def of(self, pair: int) -> np.ndarray:
        return self.t[slice(*np.searchsorted(self.pair, [pair, pair + 1]))]

    def replaced(self, others: dict[int, np.ndarray]) -> Cover:
        """With other intervals for some pairs."""
        keep = ~np.isin(self.pair, list(others))
        pair = [self.pair[keep], *(np.full(len(t), p) for p, t in others.items())]
        t = [self.t[keep], *(t.reshape(-1, 2) for t in others.values())]
        return Cover.sorted(np.concatenate(pair), np.concatenate(t))

    def masked(self, bits: int) -> Cover:
        """Ends as a mask of so many bits has them, whose bit counts when its centre is inside."""
        t = np.ceil(self.t * bits - 0.5) / bits
        return Cover(self.pair[t[:, 0] < t[:, 1]], t[t[:, 0] < t[:, 1]])


def kernel_cover(points: np.ndarray, samples: np.ndarray, scalar: bool, flags: int = 0) -> Cover:
    """Stage "solve" on the pairs: in vectors where it can, or one by one."""
    parts = []
    share = SHARE // SAMPLES
    for begin in range(0, len(points), share):
        pair, t = _solved(points[begin : begin + share], samples[begin : begin + share],
                          scalar, flags)  # fmt: skip
        parts.append((pair + begin * SAMPLES, t))
    return Cover.sorted(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _solved(
    points: np.ndarray, samples: np.ndarray, scalar: bool, flags: int
) -> tuple[np.ndarray, np.ndarray]:
    from support.kernels import one_material

    vertices, paths = paths_of_points(points)
    shapes, count, capacity = shapes_of(vertices, paths, flags), len(points), 10 * samples.size // 2
    arrays = [
        vertices, paths, shapes, *one_material(flags), np.uint32(count),
        np.ascontiguousarray(samples, np.float32), np.uint32(scalar), np.uint32(capacity),
        np.zeros(capacity, records.VISIT), np.zeros(samples.size // 2, np.int32),
        np.zeros(samples.size // 2, np.int32), np.zeros(samples.size // 2, np.uint32),
        np.zeros(2, np.uint32),
    ]  # fmt: skip
    assert DEFAULTS["LAYERS"] == 1
    defines = ("-DMB_EXACT", "-DMB_MOVING", *(["-DMB_SINGLE_SIDED"] if flags else []), *options())
    *_, visits, heads, _, met, (done, total) = run("solve.cl", "solve_pairs", arrays, defines)
    assert done
    pairs, t = [], []
    pair, node = np.arange(len(heads)), heads
    while len(node):
        pair, node = pair[node >= 0], node[node >= 0]
        pairs.append(pair)
        t.append(np.stack([visits["t0"][node], visits["t1"][node]], axis=1))
        node = visits["next"][node]
    pair = np.concatenate(pairs)
    assert len(pair) == total
    assert np.array_equal(np.bincount(pair, minlength=len(met)), met)
    return pair, np.concatenate(t)


def twin_cover(points: np.ndarray, samples: np.ndarray, single_sided: bool = False) -> Cover:
    """The float64 twin's exact intervals of all pairs."""
    path = np.repeat(np.arange(len(points)), SAMPLES)
    x, y = samples.reshape(-1, 2).T
    paths, parts = make_paths(points, single_sided=single_sided), []
    for begin in range(0, len(path), SHARE):
        share = slice(begin, begin + SHARE)
        t, pair = exact.solve_pairs(paths, path[share], x[share], y[share])
        parts.append((pair + begin, t))
    return Cover.sorted(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def rational_cover(
    points: np.ndarray, sample: np.ndarray, single_sided: bool = False
) -> np.ndarray:
    """Times ``(n, 2)`` of one pair in exact fractions."""
    found = rational.covered(points, *sample, single_sided)
    return np.array([[float(a), float(b)] for a, b, _ in found]).reshape(-1, 2)


@dataclass(frozen=True)
class _Pairs:
    """Eight samples of each path as a set of samples; ``path`` is that of every item asked for."""

    xy: np.ndarray
    path: np.ndarray

    @property
    def count(self) -> int:
        return len(self.xy)

    def positions(self, sample: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.xy[sample, 0], self.xy[sample, 1]

    def candidates(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        item = np.repeat(np.arange(len(points)), SAMPLES)
        return item, self.path[item] * SAMPLES + np.tile(np.arange(SAMPLES), len(points))


def triangulated_cover(points: np.ndarray, samples: np.ndarray) -> Cover:
    """Intervals of triangulated paths (Hong & Oh 2017), by the twin of those kernels."""
    paths, parts = make_paths(points), []
    share = SHARE // SAMPLES
    for begin in range(0, len(points), share):
        part = make_paths(points[begin : begin + share])
        shape = triangulated.surface(part)
        pairs = _Pairs(samples[begin : begin + share].reshape(-1, 2), shape.path)
        found = triangulated.intervals(part, pairs, shape=shape)
        parts.append((found.sample + begin * SAMPLES, found.t))
    assert len(paths) == len(points)
    return Cover.sorted(*(np.concatenate(column) for column in zip(*parts, strict=True)))


@dataclass(frozen=True, eq=False)
class Differences:
    """Stretches ``t`` ``(D, 2)`` of pairs ``pair`` that one of two covers alone has.

    ``most`` is the greatest number of intervals of the first cover at one time, over more than
    1e-6 of the shutter.
    """

    pair: np.ndarray
    t: np.ndarray
    most: int

    @property
    def length(self) -> np.ndarray:
        return self.t[:, 1] - self.t[:, 0]


def differences(found: Cover, truth: Cover) -> Differences:
    ends = [c.t.ravel() for c in (found, truth)]
    pair = np.concatenate([np.repeat(c.pair, 2) for c in (found, truth)])
    time = np.concatenate(ends)
    step = np.zeros((len(time), 2), dtype=np.int64)
    step[: len(ends[0]), 0] = np.tile([1, -1], len(found.t))
    step[len(ends[0]) :, 1] = np.tile([1, -1], len(truth.t))
    order = np.lexsort((time, pair))
    pair, time, count = pair[order], time[order], np.cumsum(step[order], axis=0)
    inside = np.flatnonzero((np.diff(pair) == 0) & (np.diff(time) > 0))
    ours, true = count[inside].T
    long = np.diff(time)[inside] > 1e-6
    differ = inside[(ours > 0) != (true > 0)]
    return Differences(
        pair[differ], np.stack([time[differ], time[differ + 1]], axis=1),
        int(ours[long].max(initial=0)),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Ends:
    """What the edges do at times ``t`` of pairs: ``(M, 3)`` each, edge i opposite vertex i.

    ``distance`` in pixels from the sample to the edge's line, ``speed`` at which the line passes,
    in pixels per shutter; ``eye`` ``(M,)`` is how near the path's plane is to the eye, relative
    to its bounds over the shutter.
    """

    distance: np.ndarray
    speed: np.ndarray
    eye: np.ndarray


def ends_at(points: np.ndarray, samples: np.ndarray, t: np.ndarray) -> Ends:
    """Of ``points`` ``(M, 2, 3, 3)`` at ``samples`` ``(M, 2)`` and times ``(M,)``."""
    v = points.copy()
    v[..., :2] -= samples[:, None, None] * points[..., 2:]
    part = t[:, None, None]
    now, rate = (1.0 - part) * v[:, 0] + part * v[:, 1], v[:, 1] - v[:, 0]
    a, b, a1, b1 = (np.roll(u, s, axis=1) for u in (now, rate) for s in (-1, -2))
    line = np.cross(a, b)
    change = (np.cross(a1, b) + np.cross(a, b1))[..., 2]
    size = np.hypot(line[..., 0], line[..., 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        distance, speed = np.abs(line[..., 2]) / size, np.abs(change) / size
    distance[~np.isfinite(distance)] = 0.0  # a point for an edge: it lies where you like
    speed[~np.isfinite(speed)] = 0.0
    d = np.einsum("mv,mv->m", line[..., 2], now[..., 2])
    bound = np.einsum("mv,mv->m", np.abs(line[..., 2]), np.abs(now[..., 2]))
    return Ends(distance, speed, np.abs(d) / np.where(bound > 0, bound, 1.0))
