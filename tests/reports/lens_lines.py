"""Points of the lens against lines across it, in accumulated slices, and the thin lens of others.

    python tests/reports/lens_lines.py [--picture FILE.png]

Renders ``scenes/lanterns.toml`` with four samples in each slice. Prints the RMSE over linear RGB
against 16,384 point samples per pixel, and how much time lines take; the picture shows eight slices
of each kind and the reference.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import mbinterval as mb

SCENE = Path(__file__).resolve().parents[2] / "scenes" / "lanterns.toml"
FRAME, SIZE, SEEDS = 6.0, (320, 180), 3
SLICES = (4, 8, 16, 32, 64, 128, 256)
ACCUMULATION = {"method": "accumulation", "samples": 4}


def film(scene: mb.Scene, seed: int = 0, **values: Any) -> np.ndarray:
    settings = mb.Settings(seed=seed, **values)
    return mb.render(scene, frame=FRAME, width=SIZE[0], height=SIZE[1], settings=settings).rgba


def rows(slices: int) -> dict[str, dict[str, Any]]:
    return {
        "points": {**ACCUMULATION, "slices": slices},
        "lines": {**ACCUMULATION, "slices": slices, "slice_lens": "line"},
        "stochastic": {"method": "stochastic", "samples": 4 * slices},
    }


def measured(scene: mb.Scene, truth: np.ndarray, values: dict[str, Any]) -> tuple[float, float]:
    """RMSE over ``SEEDS`` and the median of their seconds."""
    squares, seconds = [], []
    for seed in range(SEEDS):
        start = time.perf_counter()
        found = film(scene, seed, **values)
        seconds.append(time.perf_counter() - start)
        squares.append(np.mean((found - truth)[..., :3] ** 2))
    return float(np.sqrt(np.mean(squares))), float(np.median(seconds))


def picture(scene: mb.Scene, truth: np.ndarray, path: Path) -> None:
    """Points, lines and the reference beside each other."""
    few = rows(8)
    films = [film(scene, **few["points"]), film(scene, **few["lines"]), truth]
    strip = np.clip(np.concatenate(films, axis=1)[..., :3], 0.0, 1.0)
    encoded = np.where(strip <= 0.0031308, 12.92 * strip, 1.055 * strip ** (1 / 2.4) - 0.055)
    Image.fromarray(np.round(255 * encoded).astype(np.uint8)).save(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()
    scene = mb.load(SCENE)
    fine = [film(scene, 100 + k, method="stochastic", samples=4096) for k in range(4)]
    truth = np.mean(fine, axis=0)
    own = np.sqrt(np.mean((fine[0] + fine[1] - fine[2] - fine[3])[..., :3] ** 2)) / 4
    print(f"the reference's own error: {own:.1e}")
    print("| slices of 4 | points | lines | as many point samples | lines' time over points' |")
    print("|---|---|---|---|---|")
    for values in rows(1).values():
        film(scene, **values)  # kernels are built
    for slices in SLICES:
        found = [measured(scene, truth, values) for values in rows(slices).values()]
        errors = " | ".join(f"{error:.4f}" for error, _ in found)
        print(f"| {slices} | {errors} | {found[1][1] / found[0][1]:.2f} |", flush=True)
    if options.picture:
        picture(scene, truth, options.picture)


if __name__ == "__main__":
    main()
