r"""The twin on the scenes of ../shared/benchmark, beside their converged references.

    PYTHONPATH=.:tests python tests/reports/reference_benchmark.py cubes1000 \
        [--crop X,Y,W,H] [--samples N] [--save FILE.npz]

Prints, for each way to render, seconds, intervals per sample, the full pixel error against the
reference and the temporal error against the exact twin at the same samples. The last line is the
negative control: the exact twin with its shutter moved by a hundredth.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from pathlib import Path

import numpy as np
from reference.render import Image, render

from mbinterval.exposure.exposure import Exposure, expose
from mbinterval.scene.formats.meshes.benchmark import read_benchmark

FOLDER = Path(__file__).parents[3] / "shared" / "benchmark"

WAYS: dict[str, dict[str, object]] = {
    "exact": {"paths": "exact", "bits": None},
    "exact, 128 bits": {"paths": "exact", "bits": 128},
    "triangulated, exact visibility": {"bits": None},
    "triangulated, 128 bits": {"bits": 128},
    "triangulated, 32 bits": {"bits": 32},
    "triangulated, 128 bits, paired by depth": {"bits": 128, "pairing": "depth"},
}


def rmse(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.sqrt(np.mean((a - b) ** 2)))


def spread(count: int) -> np.ndarray:
    """Offsets ``(count, 2)`` in a pixel; one is its centre."""
    index = np.arange(count)
    return np.stack([(index + 0.5) / count, (index * 0.6180339887498949 + 0.5) % 1.0], axis=1)


def moved(exposure: Exposure, part: float) -> Exposure:
    """The same exposure, its shutter moved by ``part`` of its length."""
    meshes = []
    for mesh in exposure.meshes:
        first, last = mesh.positions
        step = part * (last - first)
        meshes.append(dataclasses.replace(mesh, positions=mesh.positions + step))
    return dataclasses.replace(exposure, meshes=tuple(meshes))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", choices=["cubes1000", "cubes2000", "sphere82k", "wheel"])
    parser.add_argument("--crop", type=lambda text: tuple(map(int, text.split(","))))
    parser.add_argument("--samples", type=int, default=1)
    parser.add_argument("--save", type=Path)
    options = parser.parse_args()
    scene, width, height = read_benchmark(FOLDER / f"{options.scene}.npz")
    exposure = expose(scene, 0, width / height)
    x, y, w, h = options.crop or (0, 0, width, height)
    rgb = np.load(FOLDER / f"{options.scene}.reference.npz")["rgb"][y : y + h, x : x + w]
    images: dict[str, Image] = {}

    def row(name: str, frozen: Exposure, ways: dict[str, object]) -> None:
        start = time.perf_counter()
        image = images[name] = render(
            frozen, width, height, spread(options.samples), options.crop, **ways
        )
        full, temporal = (
            rmse(image.rgba[..., :3], rgb),
            rmse(image.rgba[..., :3], images["exact"].rgba[..., :3]),
        )
        print(
            f"{name:40}{time.perf_counter() - start:8.1f} s"
            f"{image.intervals.mean() / options.samples:9.2f} intervals"
            f"{full:10.2e} full{temporal:10.2e} temporal",
            flush=True,
        )

    for name, ways in WAYS.items():
        row(name, exposure, ways)
    row("control: shutter moved by 1 %", moved(exposure, 0.01), WAYS["exact"])
    if options.save:
        np.savez(options.save, **{name: image.rgba for name, image in images.items()})


if __name__ == "__main__":
    main()
