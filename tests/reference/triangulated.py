"""Time intervals of triangulated motion paths (Hong & Oh 2017, 3.2, 3.3 and 4.2).

The surface of a path is closed: cap 0 at time 0, cap 1 at time 1, and a side for each of the
moving edges ab, bc, ca. A side from p0 q0 to p1 q1 has its centre h, the mean of the four ends,
at time 0.5, and four triangles (p0, q0, h), (q0, q1, h), (q1, p1, h), (p1, p0, h). Where the two
positions of the edge cross on screen, in front of the eye, at X0 and X1, the side is the two
triangles (p0, p1, x) and (q0, q1, x) with x = (X0 + X1) / 2 at time 0.5. Time and attributes are
linear over each plain triangle, in homogeneous space.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .bernstein import evaluate, roots
from .hits import Samples, barycentrics
from .paths import Intervals, Paths

SIDES = ((0, 1), (1, 2), (2, 0))


@dataclass(frozen=True, eq=False)
class Surface:
    """S plain triangles: points ``(S, 3, 3)``, times ``(S, 3)``, attributes ``(S, 3, A)``."""

    path: np.ndarray
    points: np.ndarray
    times: np.ndarray
    attributes: np.ndarray


@dataclass(frozen=True, eq=False)
class Fragments:
    """Crossings of a sample's eye ray with the surface of a path; ``tau`` is the local time."""

    sample: np.ndarray
    path: np.ndarray
    tau: np.ndarray
    w: np.ndarray
    attributes: np.ndarray

    def __getitem__(self, index: np.ndarray) -> Fragments:
        values = (self.sample, self.path, self.tau, self.w, self.attributes)
        return Fragments(*(value[index] for value in values))

    def starts(self) -> np.ndarray:
        """Where each run of one path on one sample begins, in fragments sorted by these."""
        change = np.diff(self.sample, prepend=-1) | np.diff(self.path, prepend=-1)
        return np.flatnonzero(change)

    @classmethod
    def join(cls, *parts: Fragments) -> Fragments:
        names = cls.__dataclass_fields__
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def det(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """a . (b x c) of arrays ``(..., 3)``."""
    return (a * np.cross(b, c)).sum(axis=-1)


def surface(paths: Paths) -> Surface:
    """Triangulate every moving path; its caps first, then sides ab, bc, ca."""
    moving = np.flatnonzero(paths.segments > 0)
    # Attributes are interpolated as positions are: one array of columns (x, y, w, attributes).
    full = np.concatenate([paths.points[moving], paths.attributes[moving]], axis=-1)
    parts = [(moving, full[:, end], np.full((len(full), 3), float(end))) for end in (0, 1)]
    for p, q in SIDES:
        corners = full[:, 0, p], full[:, 0, q], full[:, 1, p], full[:, 1, q]
        crosses, crossing = _crossing(*corners)
        for where, triangles in (
            (~crosses, _centre_triangles(*corners)),
            (crosses, _crossing_triangles(*corners, crossing)),
        ):
            parts += [(moving[where], v[where], np.broadcast_to(t, (where.sum(), 3)))
                      for v, t in triangles]  # fmt: skip
    path, points, times = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Surface(path, points[..., :3], times, points[..., 3:])


Triangles = list[tuple[np.ndarray, tuple[float, float, float]]]


def _centre_triangles(p0: np.ndarray, q0: np.ndarray, p1: np.ndarray, q1: np.ndarray) -> Triangles:
    h = ((p0 + q0) + (p1 + q1)) / 4.0
    rim = ((p0, q0, 0.0, 0.0), (q0, q1, 0.0, 1.0), (q1, p1, 1.0, 1.0), (p1, p0, 1.0, 0.0))
    return [(np.stack([a, b, h], axis=1), (ta, tb, 0.5)) for a, b, ta, tb in rim]


def _crossing_triangles(
    p0: np.ndarray, q0: np.ndarray, p1: np.ndarray, q1: np.ndarray, x: np.ndarray
) -> Triangles:
    return [(np.stack([a, b, x], axis=1), (0.0, 1.0, 0.5)) for a, b in ((p0, p1), (q0, q1))]


def _crossing(
    p0: np.ndarray, q0: np.ndarray, p1: np.ndarray, q1: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Whether p0 q0 and p1 q1 cross on screen, and the point where they do."""
    first = _divide(p0, q0, p1, q1)
    second = _divide(p1, q1, p0, q0)
    crosses = first[0] & second[0] & (first[1][:, 2] > 0) & (second[1][:, 2] > 0)
    return crosses, (first[1] + second[1]) / 2.0


def _divide(
    p: np.ndarray, q: np.ndarray, u: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Whether the plane through the eye, u and v parts p from q, and where it cuts p q."""
    at_p, at_q = (det(end[:, :3], u[:, :3], v[:, :3]) for end in (p, q))
    apart = ((at_p < 0) & (at_q > 0)) | ((at_p > 0) & (at_q < 0))
    s = at_p / np.where(apart, at_p - at_q, 1.0)
    return apart, p + s[:, None] * (q - p)


def fragments(shape: Surface, samples: Samples) -> Fragments:
    """Every crossing, sorted by sample, path, time and depth."""
    item, sample = samples.candidates(shape.points)
    hit, weight, w = barycentrics(shape.points[item], *samples.positions(sample))
    item, sample = item[hit], sample[hit]
    return _sorted(
        Fragments(
            sample=sample,
            path=shape.path[item],
            tau=(weight * shape.times[item]).sum(axis=1),
            w=w,
            attributes=np.einsum("hv,hva->ha", weight, shape.attributes[item]),
        )
    )


def _sorted(f: Fragments, pairing: str = "time") -> Fragments:
    last = (f.w, f.tau) if pairing == "time" else (f.tau, f.w)
    return f[np.lexsort((*last, f.path, f.sample))]


def facing(paths: Paths, path: np.ndarray) -> np.ndarray:
    """Bernstein coefficients ``(M, 4)`` of d = det(a, b, c) over the segments of ``path``."""
    (a0, b0, c0), (a1, b1, c1) = paths.points[path].transpose(1, 2, 0, 3)
    once = det(a1, b0, c0) + det(a0, b1, c0) + det(a0, b0, c1)
    twice = det(a0, b1, c1) + det(a1, b0, c1) + det(a1, b1, c0)
    return np.stack([det(a0, b0, c0), once / 3.0, twice / 3.0, det(a1, b1, c1)], axis=1)


def complete(paths: Paths, f: Fragments) -> Fragments:
    """Make every path's number of fragments even; ``f`` is sorted by time.

    An odd number means that the eye is inside the swept volume. The missing end is when the
    plane of the triangle passes through the eye, the root of d nearest in time to a fragment: it
    is added at w = 0 with the attributes of the fragment nearest to it in time. Without a root
    the fragment of least w is dropped.
    """
    starts = f.starts()
    counts = np.diff(starts, append=len(f.tau))
    odd = np.flatnonzero(counts % 2)
    if not len(odd):
        return f
    run = np.repeat(np.arange(len(odd)), counts[odd])
    index = np.repeat(starts[odd], counts[odd]) + _ranks(counts[odd])
    begin = np.cumsum(counts[odd]) - counts[odd]
    root = roots(facing(paths, f.path[starts[odd]]))
    away = np.abs(f.tau[index, None] - root[run])
    away = np.minimum.reduceat(np.where(np.isnan(away), np.inf, away), begin, axis=0)
    rooted = np.isfinite(away.min(axis=1))
    root = root[np.arange(len(odd)), np.argmin(away, axis=1)]
    distance = np.where(rooted[run], np.abs(f.tau[index] - root[run]), f.w[index])
    chosen = index[np.lexsort((distance, run))[begin]]
    like = f[chosen[rooted]]
    added = Fragments(
        like.sample, like.path, root[rooted], np.zeros(len(like.w)), like.attributes
    )  # fmt: skip
    keep = np.ones(len(f.tau), dtype=bool)
    keep[chosen[~rooted]] = False
    return _sorted(Fragments.join(f[keep], added))


def _ranks(counts: np.ndarray) -> np.ndarray:
    """0, 1, ..., n - 1 for every n in counts."""
    return np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)


def pair(paths: Paths, f: Fragments, pairing: str = "time") -> Intervals:
    """Two by two, in order of time or of depth, fragments become intervals."""
    f = _sorted(complete(paths, f), pairing)
    first = np.arange(0, len(f.tau), 2)
    swap = f.tau[first] > f.tau[first + 1]
    ends = np.stack([first + swap, first + 1 - swap], axis=1)
    ends = ends[f.tau[ends[:, 0]] < f.tau[ends[:, 1]]]
    path = f.path[ends[:, 0]]
    return Intervals(
        sample=f.sample[ends[:, 0]],
        path=path,
        t=paths.time(path[:, None], f.tau[ends]),
        w=f.w[ends],
        attributes=f.attributes[ends],
    )


def cull(paths: Paths, intervals: Intervals) -> Intervals:
    """Cut intervals of single-sided paths to the times at which d < 0, the front is seen.

    Depth and attributes at a cut are linear between the interval's ends. There may be two pieces.
    """
    single = paths.single_sided[intervals.path]
    if not single.any():
        return intervals
    path, index = np.unique(intervals.path[single], return_inverse=True)
    d = facing(paths, path)
    cuts = np.nan_to_num(roots(d), nan=1.0)
    cuts = np.sort(np.concatenate([np.zeros((len(path), 1)), cuts, np.ones((len(path), 1))], 1))
    front = evaluate(d[:, None], 0.5 * (cuts[:, 1:] + cuts[:, :-1])) < 0
    cuts = paths.time(path[:, None], cuts)
    one = intervals[single]
    parts = [intervals[~single]]
    for piece in range(front.shape[1]):
        t = np.clip(one.t, cuts[index, piece, None], cuts[index, piece + 1, None])
        parts.append(_clipped(one, t, np.flatnonzero(front[index, piece] & (t[:, 0] < t[:, 1]))))
    names = ("sample", "path", "t", "w", "attributes")
    joined = Intervals(*(np.concatenate([getattr(p, name) for p in parts]) for name in names))
    return joined[np.lexsort((joined.t[:, 0], joined.path, joined.sample))]


def _clipped(whole: Intervals, t: np.ndarray, keep: np.ndarray) -> Intervals:
    """The intervals ``keep`` of ``whole``, with new ends at ``t``, linear in between."""
    whole, t = whole[keep], t[keep]
    part = (t - whole.t[:, :1]) / np.diff(whole.t, axis=1)
    values = whole.attributes
    return Intervals(
        sample=whole.sample,
        path=whole.path,
        t=t,
        w=whole.w[:, :1] + part * np.diff(whole.w, axis=1),
        attributes=values[:, :1] + part[..., None] * np.diff(values, axis=1),
    )


def intervals(
    paths: Paths, samples: Samples, pairing: str = "time", shape: Surface | None = None
) -> Intervals:
    """Intervals of all moving paths, sorted by sample, path and start; ``shape`` saves work."""
    shape = surface(paths) if shape is None else shape
    return cull(paths, pair(paths, fragments(shape, samples), pairing))
