"""What Hong & Oh 2017 claim, measured here: masks, texture samples, number of cubes, the sort.

    python tests/reports/ho17_claims.py [--accumulation [--picture FILE.png]]

Prints tables in Markdown. ``--accumulation`` also makes their comparison picture: analytic renders
beside 3,000 accumulated slices by the tests' float64 twin, which takes minutes.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

import mbinterval as mb
from mbinterval.exposure.exposure import expose
from mbinterval.files.images import write_png
from mbinterval.scene.generators import fast_cubes, ho17_cubes

HERE = Path(__file__).resolve().parent
SIZE = (1024, 768)


def ho17(**changes: object) -> mb.Settings:
    """The method as published: triangulated paths, 128 bits, pixel centres."""
    return mb.Settings(**{"paths": "triangulated", "occlusion": 128, "samples": 1, **changes})


def timed(scene: mb.Scene, settings: mb.Settings, runs: int = 5, **place: object) -> mb.Film:
    """The film whose time is the median of ``runs`` warm renders."""
    where = {"frame": 1, "width": SIZE[0], "height": SIZE[1], **place}
    films = [mb.render(scene, settings=settings, **where) for _ in range(runs + 1)][1:]
    return sorted(films, key=seconds)[len(films) // 2]


def seconds(film: mb.Film) -> float:
    return sum(film.timings.values())


def rmse(a: np.ndarray, b: np.ndarray) -> float:
    difference = a[..., :3].astype(np.float64) - b[..., :3]
    return float(np.sqrt(np.mean(difference**2)))


def masks() -> None:
    print("\n### Bits of the mask (fast cubes, 1,000)\n")
    print("| bits | seconds | RMSE against exact occlusion |\n|---|---|---|")
    scene = fast_cubes(1000)
    truth = mb.render(scene, width=SIZE[0], height=SIZE[1], settings=ho17(occlusion="exact"))
    for bits in (32, 64, 128, 256, 512, 1024):
        film = timed(scene, ho17(occlusion=bits))
        print(f"| {bits} | {seconds(film):.3f} | {rmse(film.rgba, truth.rgba):.1e} |")


def texture_samples() -> None:
    print("\n### Texture samples (rolling wheel, frame 8, 640 x 360)\n")
    print("| samples | seconds | RMSE against 1,024 |\n|---|---|---|")
    scene = mb.load(HERE.parents[1] / "scenes" / "rolling_wheel.toml")
    place = {"frame": 8, "width": 640, "height": 360}
    truth = mb.render(scene, settings=ho17(texture_samples=1024), **place)
    for count in (1, 2, 4, 8, 16, 32, 64, 128):
        film = timed(scene, ho17(texture_samples=count), **place)
        print(f"| {count} | {seconds(film):.3f} | {rmse(film.rgba, truth.rgba):.1e} |")


def cubes() -> None:
    print("\n### Number of cubes (figures 15 and 16)\n")
    print("| cubes | intervals per pixel | seconds | of them sort | exact paths, seconds |")
    print("|---|---|---|---|---|")
    for count in range(1000, 2001, 200):
        scene = ho17_cubes(count)
        film, exact = timed(scene, ho17()), timed(scene, mb.Settings(samples=1))
        print(
            f"| {count} | {film.intervals.mean():.2f} | {seconds(film):.3f} "
            f"| {film.timings['sort']:.3f} | {seconds(exact):.3f} |"
        )


def interval_limit() -> None:
    print("\n### The limit of 90 intervals (fast cubes, 2,000, two-sided)\n")
    scene = fast_cubes(2000, double_sided=True)
    whole = mb.render(scene, width=SIZE[0], height=SIZE[1], settings=ho17())
    print("| limit | RMSE against no limit | pixels that differ |\n|---|---|---|")
    for limit in (15, 30, 60, 90):
        film = mb.render(scene, width=SIZE[0], height=SIZE[1], settings=ho17(max_intervals=limit))
        differ = np.mean(np.any(film.rgba != whole.rgba, axis=2))
        print(f"| {limit} | {rmse(film.rgba, whole.rgba):.1e} | {100 * differ:.2f} % |")


def accumulation(
    picture: str | None = None, slices: int = 3000, width: int = 384, height: int = 288
) -> None:
    """Their figures 13 and 14: analytic beside accumulated slices, at the pixels' centres."""
    sys.path.insert(0, str(HERE.parent))
    from reference.accumulation import render as accumulate

    scene = ho17_cubes(1000)
    exposure = expose(scene, 1, width / height)
    truth = accumulate(exposure, width, height, slices).rgba
    print(f"\n### Against {slices:,} accumulated slices (ho17_cubes, {width} x {height})\n")
    print("| method | RMSE |\n|---|---|")
    few = accumulate(exposure, width, height, 64).rgba
    images = {
        name: mb.render(scene, width=width, height=height, settings=settings).rgba
        for name, settings in (
            ("exact", mb.Settings(samples=1)),
            ("Hong & Oh, 128 bits", ho17()),
            ("Hong & Oh, exact occlusion", ho17(occlusion="exact")),
        )
    } | {"64 accumulated slices": few}
    for name, image in images.items():
        print(f"| {name} | {rmse(image, truth):.1e} |")
    if picture is not None:
        show(picture, [images["exact"], images["Hong & Oh, 128 bits"], truth, few])


def show(path: str, four: list[np.ndarray]) -> None:
    """Write the same part of four images, four times as large, in two rows."""
    parts = [image[100:196, 130:258, :3] for image in four]
    whole = np.vstack([np.hstack(parts[:2]), np.hstack(parts[2:])])
    large = whole.repeat(4, axis=0).repeat(4, axis=1)
    write_png(path, large, transparent=False, text={})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--accumulation", action="store_true")
    parser.add_argument("--picture", help="write the comparison to this PNG")
    options = parser.parse_args()
    masks()
    texture_samples()
    cubes()
    interval_limit()
    if options.accumulation:
        accumulation(options.picture)


if __name__ == "__main__":
    main()
