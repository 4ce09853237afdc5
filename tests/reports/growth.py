"""How time and memory grow with triangles, intervals and motion.

    python tests/reports/growth.py [--rounds 3] [--plot FILE.png]

Generated scenes at 1024 x 768 with one sample per pixel, exact paths: a sphere whose triangles get
smaller, or that moves further; cubes that become more, so that depth complexity grows with them.
Seconds are those of the processor, all cores together, of a render with kernels built, the least
of some rounds: on a machine that others use they are steadier than those of a clock. Memory is the
most that the process holds meanwhile. The slope is that of log seconds over log intervals between
neighbouring rows: 1 is linear. The plot needs matplotlib.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import mbinterval as mb
from mbinterval.bench.meter import clear_peak_memory, peak_memory
from mbinterval.scene.generators import dense_sphere, fast_cubes, ho17_cubes

SETTINGS = mb.Settings(samples=1)
SWEEPS: dict[str, tuple[str, list[tuple[float, Callable[[], mb.Scene]]]]] = {
    "sphere, smaller triangles": (
        "triangles",
        [(20 * 4**n, lambda n=n: dense_sphere(n)) for n in range(1, 9)],
    ),
    "sphere of 81,920, longer motion": (
        "pixels moved",
        [(270 * f, lambda f=f: dense_sphere(travel=f)) for f in (1 / 64, 1 / 16, 1 / 4, 1 / 2, 1)],
    ),
    "small cubes, more of them": (
        "triangles",
        [(12 * n, lambda n=n: ho17_cubes(n)) for n in (333, 1000, 3333, 10_000, 33_333, 83_334)],
    ),
    "fast cubes, more of them": (
        "triangles",
        [(12 * n, lambda n=n: fast_cubes(n)) for n in (125, 250, 500, 1000, 2000, 4000, 8000)],
    ),
}


@dataclass(frozen=True)
class Point:
    """One scene of a sweep: what grows, intervals met in the frame, seconds, bytes."""

    amount: float
    intervals: int
    seconds: float
    memory: int


def measured(amount: float, scene: mb.Scene, rounds: int) -> Point:
    mb.render(scene, width=64, height=48, settings=SETTINGS)  # builds the kernels
    seconds = []
    for _ in range(rounds):
        clear_peak_memory()
        started = time.process_time()
        film = mb.render(scene, settings=SETTINGS)
        seconds.append(time.process_time() - started)
    return Point(amount, int(film.intervals.sum(dtype=np.int64)), min(seconds), peak_memory())


def slope(before: Point, now: Point) -> float:
    return float(np.log(now.seconds / before.seconds) / np.log(now.intervals / before.intervals))


def print_sweep(name: str, grows: str, points: list[Point]) -> None:
    print(f"\n{name}\n")
    print(f"| {grows} | intervals, millions | seconds | ns per interval | slope | MB |")
    print("|---|---|---|---|---|---|")
    for before, now in zip([None, *points], points, strict=False):
        rise = "" if before is None else f"{slope(before, now):.2f}"
        print(
            f"| {now.amount:,.0f} | {now.intervals / 1e6:.2f} | {now.seconds:.2f} "
            f"| {1e9 * now.seconds / now.intervals:.0f} | {rise} | {now.memory / 1e6:.0f} |",
            flush=True,
        )


def plot(curves: dict[str, list[Point]], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(9.6, 4.2), layout="constrained")
    for name, points in curves.items():
        seconds = [point.seconds for point in points]
        left.loglog([p.intervals for p in points], seconds, "-o", label=name, markersize=4)
        if SWEEPS[name][0] == "triangles":
            right.loglog([p.amount for p in points], seconds, "-o", label=name, markersize=4)
        else:
            right.plot([], [])  # the next curve keeps its colour
    line = np.array([1e6, 1e8])
    left.loglog(line, 1e-7 * line, ":", color="grey", label="100 ns per interval")
    left.set(xlabel="intervals met in the frame", ylabel="processor seconds, all cores")
    right.set(xlabel="triangles")
    for axes in (left, right):
        axes.grid(visible=True, which="both", alpha=0.3)
    left.legend(fontsize=8)
    figure.savefig(path, dpi=120)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--plot", type=Path)
    options = parser.parse_args()
    curves = {}
    for name, (grows, scenes) in SWEEPS.items():
        points = [measured(amount, make(), options.rounds) for amount, make in scenes]
        curves[name] = points
        print_sweep(name, grows, points)
    if options.plot:
        plot(curves, options.plot)


if __name__ == "__main__":
    main()
