"""Seconds and error on the benchmark scenes, exact paths beside Hong & Oh's pipeline.

    python tests/reports/speed.py

Scenes and converged references are those of ../shared/benchmark, 1024 x 768; closed meshes are
single-sided. Seconds are wall clock from the scene in host memory to the film in host memory,
kernels built, median of seven renders.
"""

from __future__ import annotations

import dataclasses
import statistics
import time
from pathlib import Path

import numpy as np

import mbinterval as mb
from mbinterval.scene.benchmark import read_benchmark
from mbinterval.scene.generators import ho17_cubes

FOLDER = Path(__file__).resolve().parents[3] / "shared" / "benchmark"
CLOSED = ("cubes1000", "cubes2000", "sphere82k")
PUBLISHED = {"paths": "triangulated", "occlusion": 128, "samples": 1}
SHARED = {"samples": 1, "filter": "five_point"}
ROWS: tuple[tuple[str, dict[str, object]], ...] = (
    ("wheel", {"samples": 1}),
    ("wheel", SHARED),
    ("wheel", {"samples": 2}),
    ("wheel", {"samples": 4}),
    ("wheel", PUBLISHED),
    ("cubes1000", {"samples": 1}),
    ("cubes1000", SHARED),
    ("cubes1000", {"samples": 2}),
    ("cubes1000", {"samples": 4}),
    ("cubes1000", PUBLISHED),
    ("cubes2000", {"samples": 1}),
    ("cubes2000", SHARED),
    ("cubes2000", {"samples": 2}),
    ("sphere82k", {"samples": 1}),
    ("sphere82k", SHARED),
    ("ho17_cubes", {"samples": 1}),
    ("ho17_cubes", PUBLISHED),
    *((name, {"method": "stochastic", "samples": 64}) for name in ("wheel", *CLOSED)),
)


def load(name: str) -> tuple[mb.Scene, int, int, np.ndarray | None]:
    if name == "ho17_cubes":
        return ho17_cubes(1000), 1024, 768, None
    scene, width, height = read_benchmark(FOLDER / f"{name}.npz")
    if name in CLOSED:
        material = mb.Material(shading="unlit", double_sided=False)
        meshes = [dataclasses.replace(mesh, material=material) for mesh in scene.meshes]
        scene = dataclasses.replace(scene, meshes=meshes)
    return scene, width, height, np.load(FOLDER / f"{name}.reference.npz")["rgb"]


def main() -> None:
    print("| scene | settings | seconds | least | RMSE |\n|---|---|---|---|---|")
    for name, values in ROWS:
        scene, width, height, truth = load(name)
        settings = mb.Settings(**values)  # type: ignore[arg-type]
        seconds = []
        for _ in range(8):
            start = time.perf_counter()
            film = mb.render(scene, width=width, height=height, settings=settings)
            seconds.append(time.perf_counter() - start)
        error = (
            "" if truth is None else f"{np.sqrt(np.mean((film.rgba[..., :3] - truth) ** 2)):.5f}"
        )
        text = ", ".join(f"{key}={value}" for key, value in values.items())
        median = statistics.median(seconds[1:])
        print(f"| {name} | {text} | {median:.3f} | {min(seconds):.3f} | {error} |", flush=True)


if __name__ == "__main__":
    main()
