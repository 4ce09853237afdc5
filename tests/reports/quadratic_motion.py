"""Would motion paths along parabolas pay? Writes ``tests/reports/quadratic_motion.md``.

    python tests/reports/quadratic_motion.py

Vertices move along chords in homogeneous pixel space, so that edge functions have degree two. Here
they are cut again, with the same points followed and the same measure of deviation, into segments
in which each goes along the parabola through its true places at both ends and nearest the middle:
degree four. A prototype of stage "solve" (``tests/wrappers/quadratic_motion.cl``) then solves both
for the samples, one per pixel, of random tiles that are swept; of paths that pass or reach behind
the eye, none. The scenes have one chain of sources of motion each.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from support.kernels import options, run
from support.parabolas import FRAME, Cutter, curves, exposed

HERE = Path(__file__).resolve().parent
SCENES = ("rolling_wheel", "propeller", "running_fox", "walking_fox")
SIZES = ((640, 360), (1920, 1080))
TILE, TILES, PIECE, REPEATS = 16, 40, 8192, 15
FILE, ONE_BY_ONE = "quadratic_motion.cl", 2


def hull_holds(corners: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Whether places are in the convex hulls of ``corners`` ``(n, C, 2)``."""
    angles = np.sort(np.arctan2(corners[..., 1] - y[:, None], corners[..., 0] - x[:, None]), axis=1)
    gaps = np.diff(angles, axis=1, append=angles[:, :1] + 2.0 * np.pi)
    return gaps.max(axis=1) < np.pi


def pairs(points: np.ndarray, tiles: np.ndarray, rng: Any) -> tuple[np.ndarray, np.ndarray]:
    """Runs (path, first, count, 0), and each pair's x and y: what paths may cover of the tiles."""
    corners = (points[..., :2] / points[..., 2:]).reshape(len(points), -1, 2)
    low, high = corners.min(axis=1), corners.max(axis=1)
    row, column = np.divmod(np.arange(TILE**2), TILE)
    runs, seen, first = [], [], 0
    for tile in tiles:
        place = tile + np.stack([column, row], axis=1) + rng.random((TILE**2, 2))
        near = np.flatnonzero((low < tile + TILE).all(axis=1) & (high > tile).all(axis=1))
        inside = (place > low[near, None]).all(axis=2) & (place < high[near, None]).all(axis=2)
        path, sample = np.nonzero(inside)
        kept = hull_holds(corners[near[path]], *place[sample].T)
        path, sample = near[path[kept]], sample[kept]
        index, start, count = np.unique(path, return_index=True, return_counts=True)
        runs.append(np.stack([index, first + start, count, 0 * index], axis=1))
        seen.append(place[sample])
        first += len(path)
    return np.concatenate(runs).astype(np.uint32), np.concatenate(seen)


def launches(curve: Any, skip: bool, tiles: np.ndarray, roll: Any) -> Iterator[list[Any]]:
    """Arguments of the kernels, for about `PIECE` pairs at a time."""
    runs, places = pairs(curve[0], tiles, np.random.default_rng(2))
    seen = np.zeros((len(places), 4), np.float32)
    seen[:, :2], seen[:, 3] = places, 1.0
    if roll is not None:
        seen[:, 2] = roll.start + roll.step * np.floor(places[:, 1])
        seen[:, 3] = seen[:, 2] + roll.length
    for some in np.split(runs, np.flatnonzero(np.diff(runs[:, 1] // PIECE)) + 1):
        own = seen[some[0, 1] : some[-1, 1] + some[-1, 2]]
        some[:, 1] -= some[0, 1]
        out = [np.zeros(len(own), np.int32), np.zeros(len(own), np.float32)]
        yield [*curve, some, np.uint32(len(some)), own, np.uint32(skip), *out]


def solved(degree: int, pieces: Iterator[list[Any]], samples: int) -> dict[str, float]:
    """Figures per sample, of pairs and of edges; times are the least of each piece, in sum."""
    found, ns = [], 0.0
    build = options("EXACT", MASK_BITS=None)
    for piece in pieces:
        took: list[float] = []
        for _ in range(REPEATS):
            *_, met, covered = run(FILE, f"solve_degree_{degree}", piece, build, clock=took)
        found.append((met, covered))
        ns += 1e9 * min(took)
    met, covered = joined(found)
    return {
        "pairs": len(met) / samples,
        "hard": 100.0 * np.mean(met // 16 == ONE_BY_ONE),
        "intervals": np.sum(met % 16) / samples,
        "covered": np.sum(covered, dtype=float),
        "solve": ns / samples,
        "edge": ns / (3 * len(met)),
    }


def tiles_of(points: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Corners ``(n, 2)`` of random tiles of the box that control points are in."""
    swept = (points[..., :2] / points[..., 2:]).reshape(-1, 2)
    low, high = np.clip([swept.min(axis=0), swept.max(axis=0)], 0, np.array(size) - 1) // TILE
    axes = (np.arange(a, b + 1) for a, b in zip(low, high, strict=True))
    every = np.stack(np.meshgrid(*axes)).reshape(2, -1).T
    return TILE * np.random.default_rng(1).permutation(every)[:TILES]


def joined(parts: list[Any]) -> list[np.ndarray]:
    return [np.concatenate(arrays) for arrays in zip(*parts, strict=True)]


def measured(name: str, size: tuple[int, int]) -> list[dict[str, float]]:
    """Figures of chords, of these raised, of parabolas, and of these without those one by one."""
    cutter = Cutter()
    chords, true = exposed(name, size), exposed(name, size, cutter)
    straight = [mesh for mesh in chords.meshes if mesh.segments]
    moving = [mesh for mesh in true.meshes if mesh.segments]
    points, paths = joined([curves(mesh, size, None) for mesh in straight])
    raised = np.stack([points[:, 0], points.mean(axis=1), points[:, 1]], axis=1), paths
    bent = joined([curves(mesh, size, cutter) for mesh in moving])
    few = max(mesh.segments for mesh in straight), max(len(cutter.knots_of(m)) - 1 for m in moving)
    tiles, found = tiles_of(points, size), []
    cases = (2, (points, paths), 0), (4, raised, 0), (4, bent, 0), (4, bent, 1)
    for (degree, curve, skip), segments in zip(cases, (few[0], *few, few[1]), strict=True):
        pieces = launches(curve, bool(skip), tiles, chords.roll)
        found.append(solved(degree, pieces, len(tiles) * TILE**2) | {"segments": segments})
    return found


PAGE = f"""# Motion along parabolas: would fewer segments pay?

Made by `python tests/reports/quadratic_motion.py`, frame {FRAME:g} of each scene, `motion_error`
0.1 pixels. *Chords* are the product's segments: edge functions of degree two. *Parabolas* go
through each vertex's true place at the ends and in the middle of a segment, in homogeneous pixel
space: degree four. *Raised* are the chords, written as parabolas. A pair is a path and a sample in
the convex hull of what it sweeps; samples are one per pixel of {TILES} random tiles of 16 x 16, at
random places. Intervals are what "solve" lists. Nanoseconds are the least of {REPEATS} runs on one
core of a prototype that solves eight samples at once, and one by one where an edge may have several
roots; gathering and bounds of depth are left out. The last column has the ratio of times, and what
it would be if those one by one took none. The time for which samples are covered, in sum, differs
from that of chords by %(raised).1g of it raised, and by %(bent).1g along parabolas.

| scene, lines | segments: chords, parabolas | pairs per sample | intervals per sample | \
one by one, %% | ns per edge: chords, raised, parabolas | ns per sample | ratio |
|---|---|---|---|---|---|---|---|
%(rows)s

One edge costs %(edge)s times as much with degree four, as a root takes some of Newton's steps in
place of a square root. Segments become %(segments)s times fewer, but pairs only %(pairs)s times, as
a longer path sweeps more samples; so "solve" alone takes %(solve)s times as long, less than now
only for %(faster)s.
Listed intervals become %(intervals)s times fewer, but the envelope would order
them by polynomials of degree ten instead of five (depth is a sextic over a quartic, no longer a
cubic over a quadratic): 22 coefficients of a path instead of 13, 70 products for a pair instead of
24, 55 interpolations for each halving instead of 15, and up to ten changes of order.
"""


def line(case: tuple[str, tuple[int, int]], row: list[dict[str, float]]) -> str:
    a, b, c, d = row
    cells = [f"{case[0]}, {case[1][1]}", f"{a['segments']}, {c['segments']}"]
    cells += [f"{a[k]:.2f}, {c[k]:.2f}" for k in ("pairs", "intervals", "hard")]
    cells += [f"{a['edge']:.1f}, {b['edge']:.1f}, {c['edge']:.1f}"]
    cells += [f"{a['solve']:.0f}, {c['solve']:.0f}"]
    return f"| {' | '.join(cells)} | {c['solve'] / a['solve']:.2f}, {d['solve'] / a['solve']:.2f} |"


def main() -> None:
    found = {}
    for case in ((name, size) for size in SIZES for name in SCENES):
        found[case] = measured(*case)
        print(line(case, found[case]), flush=True)
    values: dict[str, Any] = {"rows": "\n".join(map(line, found, found.values()))}
    for name in ("segments", "pairs", "intervals", "edge", "solve"):
        ratios = [row[2][name] / row[0][name] for row in found.values()]
        ratios = ratios if name in ("edge", "solve") else [1.0 / ratio for ratio in ratios]
        values[name] = f"{min(ratios):.1f} to {max(ratios):.1f}"
    for kind, name in ((1, "raised"), (2, "bent")):
        values[name] = max(abs(r[kind]["covered"] / r[0]["covered"] - 1.0) for r in found.values())
    faster = [case for case, row in found.items() if row[2]["solve"] < row[0]["solve"]]
    values["faster"] = ", ".join(f"{n} at {size[1]} lines" for n, size in faster) or "none"
    (HERE / "quadratic_motion.md").write_text(PAGE % values)


if __name__ == "__main__":
    main()
