"""Error against samples per pixel, on the benchmark scenes and their converged references.

    python tests/reports/convergence.py [--plot FILE.png] [--points]

The references are those of ../shared/benchmark: 65,536 point samples per pixel by an independent
renderer. Prints RMSE over linear RGB, and with --points, for point samples in time and place of
several patterns, the slope of its logarithm over that of their number; the plot needs matplotlib.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import mbinterval as mb
from mbinterval.scene.formats.meshes.benchmark import read_benchmark

FOLDER = Path(__file__).resolve().parents[3] / "shared" / "benchmark"
COUNTS = (1, 4, 16, 64)
POINT_COUNTS = (4, 16, 64, 256, 1024)
PATTERNS = {"analytic": ("fixed", "sobol"), "stochastic": ("random", "jittered", "sobol")}


def errors(name: str, method: str, pattern: str, counts: tuple[int, ...]) -> list[float]:
    scene, width, height = read_benchmark(FOLDER / f"{name}.npz")
    truth = np.load(FOLDER / f"{name}.reference.npz")["rgb"].astype(np.float64)
    result = []
    for count in counts:
        settings = mb.Settings(method=method, samples=count, pattern=pattern)
        film = mb.render(scene, width=width, height=height, settings=settings)
        result.append(float(np.sqrt(np.mean((film.rgba[..., :3] - truth) ** 2))))
    return result


def plot(curves: dict[tuple[str, str], list[float]], counts: tuple[int, ...], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6.4, 4.2), layout="constrained")
    for (name, pattern), values in curves.items():
        style = {"fixed": "-o", "sobol": "--s", "jittered": "-^", "random": "-o"}[pattern]
        axes.loglog(counts, values, style, label=f"{name}, {pattern}", markersize=4)
    start = max(values[0] for values in curves.values())
    axes.loglog(counts, [start / (count / counts[0]) ** 0.5 for count in counts], ":",
                color="grey", label="a half for four times")  # fmt: skip
    axes.set(xlabel="samples per pixel", ylabel="RMSE against 65,536 point samples per pixel")
    axes.set_xticks(counts, [str(count) for count in counts])
    axes.grid(visible=True, which="both", alpha=0.3)
    axes.legend(fontsize=8)
    figure.savefig(path, dpi=120)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plot", type=Path)
    parser.add_argument("--points", action="store_true")
    options = parser.parse_args()
    method = "stochastic" if options.points else "analytic"
    counts = POINT_COUNTS if options.points else COUNTS
    curves = {}
    print(f"| scene | pattern | {' | '.join(map(str, counts))} | slope |")
    print("|---" * (len(counts) + 3) + "|")
    for name in ("wheel", "cubes1000"):
        for pattern in PATTERNS[method]:
            found = curves[name, pattern] = errors(name, method, pattern, counts)
            row = " | ".join(f"{value:.2e}" for value in found)
            slope = np.polyfit(np.log(counts), np.log(found), 1)[0]
            print(f"| {name} | {pattern} | {row} | {slope:.2f} |", flush=True)
    if options.plot:
        plot(curves, counts, options.plot)


if __name__ == "__main__":
    main()
