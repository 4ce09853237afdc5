"""Lists of exact intervals that a test makes up, for the stages that decide what is seen of them.

Each sample has a place of its own and triangles of its own around it, which move and cover it all
the time, so that any interval of theirs is possible: long and short ones, coincident times, depths
that are equal, cross once or often, or lie at the ends of what float32 holds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from reference.rays import at_time, see
from reference.samples import expand

from mbinterval.device import records
from support.kernels import one_material, options, run, shapes_and_depths, vertices_of

TILE, LAYERS = 16, 4
SAMPLES = TILE * TILE * LAYERS
MANY = 600
"""Intervals of a sample that are more than the kernels sort by counting."""


@dataclass(frozen=True, eq=False)
class Lists:
    """Samples at ``xy`` ``(S, 2)``, P paths, I intervals sorted by sample and from near to far.

    ``points`` ``(P, 2, 3, 3)``, ``window`` ``(P, 2)`` when each segment begins and ends, ``alpha``
    ``(P,)``; ``twin`` ``(P,)`` the first path that is the same triangle. ``sample``, ``path``
    ``(I,)``, ``t`` ``(I, 2)`` float32 values. ``rest`` ``(S,)``: path at rest of a sample, or -1;
    these come first.
    """

    xy: np.ndarray
    points: np.ndarray
    window: np.ndarray
    alpha: np.ndarray
    twin: np.ndarray
    sample: np.ndarray
    path: np.ndarray
    t: np.ndarray
    rest: np.ndarray

    def depth(self, sample: np.ndarray, path: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Depths ``(M,)`` of paths at samples and times of the shutter."""
        low, high = self.window[path].T
        found, _, _ = see(at_time(self.points[path], (t - low) / (high - low)), *self.xy[sample].T)
        return found

    def everything(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Sample, path and times of all intervals, with what rests, all the time."""
        still = np.flatnonzero(self.rest >= 0)
        whole = np.tile([0.0, 1.0], (len(still), 1))
        return (
            np.concatenate([still, self.sample]),
            np.concatenate([self.rest[still], self.path]),
            np.concatenate([whole, self.t]),
        )


def around(
    rng: np.random.Generator, xy: np.ndarray, w: np.ndarray, still: np.ndarray
) -> np.ndarray:
    """Triangles ``(P, 2, 3, 3)`` that cover their samples throughout; ``w`` ``(P, 2, 3)``."""
    count = len(xy)
    angle = rng.uniform(0, 2 * np.pi, (count, 1)) + np.arange(3) * 2.1
    angle = (angle + rng.uniform(-0.4, 0.4, angle.shape)) * rng.choice([-1, 1], (count, 1))
    ends = rng.choice([0.02, 1.0, 3e3], (count, 2, 3))
    radius = np.where(rng.random(ends.shape) < 2 / 3, ends, 10 ** rng.uniform(-1, 2, ends.shape))
    radius[still, 1] = radius[still, 0]
    way = np.stack([np.cos(angle), np.sin(angle)], axis=-1)[:, None]
    screen = xy[:, None, None] + radius[..., None] * way
    return np.concatenate([screen * w[..., None], w[..., None]], axis=-1)


def times_within(rng: np.random.Generator, window: np.ndarray) -> np.ndarray:
    """Times ``(M, 2)`` in windows: two thirds of the ends at ends of bits, 0 and 1, coincident."""
    count = len(window)
    t = np.sort(rng.random((count, 2)), axis=1)
    special = np.sort(rng.integers(0, 17, (count, 2)) / 16, axis=1)
    t = np.where(rng.random((count, 2)) < 2 / 3, special, t)
    t = np.sort(np.clip(t, *window.T[:, :, None]), axis=1).astype(np.float32)
    short = rng.random(count) < 0.1
    t[short, 1] = np.nextafter(t[short, 0], np.float32(2))
    return t


def draw(seed: int, alphas: tuple[float, ...] = (1.0,)) -> Lists:
    """Lists of none, one, a few, and now and then very many intervals."""
    rng = np.random.default_rng(seed)
    xy = rng.choice([0.0, 0.5, 255.96875, 4095.0], (SAMPLES, 2))
    xy = np.where(rng.random(xy.shape) < 2 / 3, xy, rng.uniform(0, 4096, xy.shape))
    xy = xy.astype(np.float32).astype(np.float64)
    rest = np.where(rng.random(SAMPLES) < 0.3, 0, -1)
    rest[rest == 0] = np.arange(np.count_nonzero(rest == 0))
    still = np.flatnonzero(rest >= 0)
    counts = rng.choice([0, 1, 2, 3, 8, 24], SAMPLES, p=[0.1, 0.15, 0.2, 0.2, 0.25, 0.1])
    counts[rng.choice(SAMPLES, 2)] = MANY
    sample = np.concatenate([still, np.repeat(np.arange(SAMPLES), counts)])
    moves, count = np.arange(len(sample)) >= len(still), len(sample)
    # One scale of depth for each sample; within it vertices pass each other.
    scale = rng.choice([1e-30, 1.0, 1e30], SAMPLES, p=[0.2, 0.6, 0.2])
    w = rng.uniform(0.5, 2.0, (count, 2, 3))
    level = rng.random(count) < 0.3
    w[level] = rng.choice([0.5, 1.0, 2.0], (np.count_nonzero(level), 1, 1))
    apart = rng.random(count) < 0.2  # that nothing of the sample crosses
    w[apart] *= 10 ** rng.uniform(-6, 6, (np.count_nonzero(apart), 1, 1))
    w *= scale[sample, None, None]
    w[~moves, 1] = w[~moves, 0]
    window = np.tile([0.0, 1.0], (count, 1))
    part = moves & (rng.random(count) < 0.2)
    window[part] = np.array([[0.0, 0.25], [0.25, 0.5], [0.5, 1.0]])[rng.integers(0, 3, part.sum())]
    points = around(rng, xy[sample], w, ~moves)
    # Some triangles are others of the same sample once more.
    twin = np.arange(count)
    same = np.flatnonzero((sample[1:] == sample[:-1]) & moves[:-1] & (rng.random(count - 1) < 0.2))
    for k in same:
        twin[k + 1], points[k + 1], window[k + 1] = twin[k], points[k], window[k]
    order = np.concatenate([np.arange(len(still)), len(still) + rng.permutation(moves.sum())])
    place = np.argsort(order)  # of what was path k
    points, window, sample = points[order], window[order], sample[order]
    first = np.full(count, count)
    np.minimum.at(first, twin, place)
    twin = first[twin][order]
    alpha = rng.choice(alphas, count)
    alpha[: len(still)] = 1.0
    path = np.arange(len(still), count)
    t = times_within(rng, window[path])
    there = t[:, 0] < t[:, 1]
    path, t = path[there], t[there]
    near = points[path, :, :, 2].min(axis=(1, 2))
    order = np.lexsort((rng.random(len(path)), near, sample[path]))
    path, t = path[order], t[order].astype(np.float64)
    return Lists(xy, points, window, alpha, twin, sample[path], path, t, rest)


def tables(lists: Lists) -> dict[str, np.ndarray]:
    """The records of the lists: paths, shapes, depths, visits and the samples' heads."""
    count, points = len(lists.points), lists.points
    paths = np.zeros(count, records.PATH)
    for corner, name in enumerate("abc"):
        paths[name] = 6 * np.arange(count) + corner
    moves = (points[:, 0] != points[:, 1]).any(axis=(1, 2))
    paths["step"], paths["alpha"] = np.where(moves, 3, 0), lists.alpha
    paths["open"], paths["close"] = lists.window.T
    vertices = vertices_of(points)
    shapes, depths = shapes_and_depths(vertices, paths)
    visits = np.zeros(len(lists.path), records.VISIT)
    visits["t0"], visits["t1"] = lists.t.T
    tau = (lists.t - lists.window[lists.path, :1]) / np.diff(lists.window[lists.path])
    tau = tau[..., None]
    w = points[lists.path, :, :, 2]
    ends = (1 - tau) * w[:, :1] + tau * w[:, 1:]
    visits["near"], visits["far"] = ends.min((1, 2)) * (1 - 2e-6), ends.max((1, 2)) * (1 + 2e-6)
    translucent = (lists.alpha < 1.0)[lists.path]
    visits["path"] = lists.path.astype(np.uint32) | (translucent.astype(np.uint32) << 31)
    follows = np.append(lists.sample[1:] == lists.sample[:-1], False)
    visits["next"] = np.where(follows, np.arange(len(visits)) + 1, -1)
    heads = np.full(SAMPLES, -1, np.int32)
    begins = np.flatnonzero(np.diff(lists.sample, prepend=-1))
    heads[lists.sample[begins]] = begins
    places = np.zeros(SAMPLES, records.PLACE)
    places["x"], places["y"] = lists.xy.T
    there = lists.rest >= 0
    depth = np.full(SAMPLES, np.inf)
    still = np.flatnonzero(there)
    depth[still] = lists.depth(still, lists.rest[still], np.zeros(len(still)))
    part = (np.where(there, lists.rest, 0) << records.PART_BITS).astype(np.uint32)
    return {
        "vertices": vertices, "paths": paths, "shapes": shapes, "depths": depths,
        "visits": visits, "heads": heads, "places": places, "static_depth": depth,
        "static_part": part,
    }  # fmt: skip


def records_of(runs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sample, and place in the pool, of each record of the samples' runs."""
    start = runs["start"].astype(np.int64)
    return expand(start, start + runs["count"])


def solved(
    stage: str,
    given: dict[str, np.ndarray],
    *effects: str,
    capacity: int = 1 << 14,
    **sizes: object,
) -> tuple[np.ndarray, np.ndarray, bool]:
    """Spans and runs of a stage's wrapper, and whether all fit."""
    mesh, material = one_material()
    fronts = [np.zeros(capacity, records.FRONT) for _ in range(2)]
    ordering = np.zeros(capacity + 16, records.ORDERING)
    spans = np.zeros(capacity + 8, records.SPAN)
    spans["weight"] = -1.0
    names = ("vertices", "paths", "shapes", "depths")
    arrays = [
        *(given[name] for name in names), mesh, material, given["places"],
        given["static_depth"], given["static_part"], given["visits"], given["heads"],
        np.uint32(capacity), *fronts, ordering.view(np.float32), spans,
        np.zeros(SAMPLES, records.RUN), np.zeros(1, np.uint32),
    ]  # fmt: skip
    defines = options("MOVING", "EXACT", "STATIC", "PLACED", *effects,
                      **{"TILE": TILE, "LAYERS": LAYERS, "MASK_BITS": None} | sizes)  # fmt: skip
    *_, spans, runs, (done,) = run(f"{stage}.cl", f"{stage}_tile", arrays, defines)
    return spans, runs, bool(done)


def moments(
    lists: Lists, spans: np.ndarray, runs: np.ndarray, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Sample and time ``(M,)`` of moments to look at: random, and between any two neighbours of
    the times at which something begins or ends, but for those that only rounding parts."""
    sample, _, t = lists.everything()
    owner, place = records_of(runs)
    found = np.stack([spans[place]["t0"], spans[place]["t1"]], axis=1).astype(np.float64)
    ends = np.concatenate([t.ravel(), found.ravel()])
    given = np.arange(len(ends)) < t.size
    whose = np.repeat(np.concatenate([sample, owner]), 2)
    order = np.lexsort((~given, ends, whose))
    ends, whose, given = ends[order], whose[order], given[order]
    gap = np.where(whose[1:] == whose[:-1], np.diff(ends), 0.0)
    between = np.flatnonzero((gap > 1e-6) | ((gap > 0) & given[1:] & given[:-1]))
    rng = np.random.default_rng(seed)
    more = np.repeat(np.arange(SAMPLES), 8)
    return (
        np.concatenate([whose[between], more]),
        np.concatenate([ends[between] + 0.5 * gap[between], rng.random(len(more))]),
    )


def within(
    sample: np.ndarray, t: np.ndarray, owner: np.ndarray, ends: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of a moment (sample, t) and of an item with ends ``(I, 2)`` on its sample then."""
    order = np.argsort(owner, kind="stable")
    first, last = (np.searchsorted(owner[order], sample, side) for side in ("left", "right"))
    moment, place = expand(first, last)
    item = order[place]
    there = (ends[item, 0] <= t[moment]) & (t[moment] < ends[item, 1])
    return moment[there], item[there]
