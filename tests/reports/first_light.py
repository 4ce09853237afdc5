"""A device's first light: every kernel built, shipped scenes against kept films, times by stage.

    python tests/reports/first_light.py [--device NAME] [--page FILE] [--keep] [--rounds 3]

Builds every kernel of ``cl/``, renders the shipped scenes in both methods and some in others, at
32 x 24 pixels, and compares them with the films in ``tests/reports/first_light.npz``: on PoCL 3.0
they have the same bytes, elsewhere an RMSE of 1e-5 at most, since compilers round in their own way.
Then it times the stages of four scenes at 512 x 384 and prints a page, also to ``--page``. The exit
code is 1 where a film differs or a kernel was not built. ``--keep`` makes the kept films anew, as
each change that is meant to change a film does.
"""

from __future__ import annotations

import argparse
import re
import statistics
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from gallery import FRAMES
from numpy.typing import NDArray

import mbinterval as mb
from mbinterval.bench.meter import copy_bandwidth
from mbinterval.device.choose import choose_device
from mbinterval.device.runtime import Runtime
from mbinterval.device.sources import kernel_root

SCENES = Path(__file__).resolve().parents[2] / "scenes"
KEPT = Path(__file__).with_suffix(".npz")
SIZE = (32, 24)
TIMED_SIZE = (512, 384)
TIMED = ("fast_cubes", "rolling_wheel", "milk_truck", "running_fox")
TOLERANCE = 1e-5
"""RMSE in linear RGB and alpha, of a device that need not have the same bytes."""

EXACT: dict[str, Any] = {"method": "analytic", "samples": 2}
POINTS: dict[str, Any] = {"method": "stochastic", "samples": 16}
PUBLISHED: dict[str, Any] = {**EXACT, "paths": "triangulated", "occlusion": 128}
OTHERS: dict[tuple[str, str], dict[str, Any]] = {
    ("rolling_wheel", "published"): PUBLISHED,
    ("fast_cubes", "mask"): {**EXACT, "occlusion": 64, "partial_bits": True},
    ("fast_cubes", "five-point"): {**EXACT, "samples": 1, "filter": "five_point"},
    ("fast_cubes", "layers"): {**EXACT, "aovs": ("sharp", "depth", "normal", "forward", "object")},
    ("fast_cubes", "rotated grid"): {**POINTS, "samples": 4, "pattern": "rgss"},
    ("fast_cubes", "clip space"): {**POINTS, "cull": "clip_space"},
    ("shadows", "shadow maps"): {**POINTS, "shadow_map": 64},
    ("lanterns", "lines"): {"method": "accumulation", "slices": 4, "slice_lens": "line"},
}
"""What the shipped scenes do not run in the two methods' own ways."""


@dataclass(frozen=True)
class Row:
    """A scene rendered in one way; ``of`` has the settings."""

    scene: str
    way: str
    of: dict[str, Any]

    @property
    def name(self) -> str:
        return f"{self.scene}, {self.way}"


ROWS = [
    *(Row(scene, "exact", EXACT) for scene in sorted(FRAMES)),
    *(Row(scene, "points", POINTS) for scene in sorted(FRAMES)),
    *(Row(scene, way, of) for (scene, way), of in OTHERS.items()),
]


class FirstRuntime(Runtime):
    """A device that notes which kernels were made, by file, and what building took."""

    def __init__(self, device: Any) -> None:
        self.made: dict[tuple[str, str], float] = {}
        super().__init__(device)

    def kernel(self, file: str, name: str, options: Any = ()) -> Any:
        started = time.perf_counter()
        found = super().kernel(file, name, options)
        took = time.perf_counter() - started
        self.made[file, name] = self.made.get((file, name), 0.0) + took
        return found


def all_kernels() -> set[tuple[str, str]]:
    """File and name of every kernel in ``cl/``."""
    root = kernel_root()
    return {
        (path.relative_to(root).as_posix(), name)
        for path in root.rglob("*.cl")
        for name in re.findall(r"^kernel void (\w+)", path.read_text(encoding="utf-8"), re.M)
    }


@cache
def loaded(scene: str) -> Any:
    """A shipped scene with its settings."""
    return mb.load_file(SCENES / f"{scene}.toml")


def render(row: Row, device: Runtime, size: tuple[int, int] = SIZE) -> mb.Film:
    """The row's film; the settings of its scene's file do not count."""
    file = loaded(row.scene)
    return mb.render(
        file.scene, frame=FRAMES[row.scene], width=size[0], height=size[1],
        settings=mb.Settings(**row.of), device=device,
    )  # fmt: skip


def stored(film: mb.Film) -> NDArray[np.float32]:
    """``(h, w, n)`` float32: colour, alpha, depth and every layer of ``film``."""
    depth = np.nan_to_num(film.depth[..., None], posinf=0.0)
    layers = [
        np.asarray(values, np.float32).reshape(*film.depth.shape, -1)
        for _, values in sorted(film.layers.items())
    ]
    return np.concatenate([film.rgba, depth, *layers], axis=-1).astype(np.float32)


def must_be_equal(device: Any) -> bool:
    """Whether a device is to give the bytes that are kept."""
    return "PoCL 3.0" in device.platform.version


@dataclass(frozen=True)
class Difference:
    """How far a film is from the kept one; ``held`` says whether that is as it should be."""

    row: Row
    rmse: float
    largest: float
    equal: bool
    held: bool


def compare(
    device: FirstRuntime, kept: dict[str, NDArray[np.float32]], rows: list[Row] = ROWS
) -> Iterator[Difference]:
    """Render ``rows`` and compare each with its kept film."""
    exactly = must_be_equal(device.device)
    for row in rows:
        film, other = stored(render(row, device)), kept[row.name]
        difference = np.abs(film[..., :4].astype(float) - other[..., :4])
        rmse = float(np.sqrt(np.mean(difference**2)))
        equal = film.tobytes() == other.tobytes()
        held = equal if exactly else rmse <= TOLERANCE
        yield Difference(row, rmse, float(difference.max()), equal, held)


def timed(device: FirstRuntime, rounds: int) -> list[str]:
    """A table of medians by stage, in milliseconds."""
    lines = ["| scene | way | in all | by stage, ms |", "|---|---|---|---|"]
    for scene in TIMED:
        for way, of in (("exact", EXACT), ("points", POINTS)):
            row = Row(scene, way, of)
            render(row, device, TIMED_SIZE)  # builds the kernels
            walls, stages = [], []
            for _ in range(rounds):
                started = time.perf_counter()
                stages.append(render(row, device, TIMED_SIZE).timings)
                walls.append(time.perf_counter() - started)
            median = {
                stage: statistics.median(1e3 * timings[stage] for timings in stages)
                for stage in stages[0]
            }
            told = " ".join(f"{stage} {ms:.1f}" for stage, ms in median.items() if ms >= 0.05)
            lines.append(f"| {scene} | {way} | {1e3 * statistics.median(walls):.0f} | {told} |")
    return lines


def page(
    device: FirstRuntime, differences: list[Difference], missing: set[tuple[str, str]], rounds: int
) -> str:
    """The report, in Markdown."""
    of = device.device
    rule = "the same bytes" if must_be_equal(of) else f"an RMSE of {TOLERANCE:g} at most"
    held = sum(difference.held for difference in differences)
    built = sum(device.made.values())
    lines = [
        f"# First light on {of.name.strip()}",
        "",
        f"{of.platform.name.strip()}, {of.platform.version.strip()}, driver {of.driver_version}; "
        f"{of.max_compute_units} compute units, {of.global_mem_size / 2**30:.1f} GiB; "
        f"copies {copy_bandwidth(device, 5) / 1e9:.1f} GB/s. mbinterval {mb.__version__}.",
        "The kernels are shaped for CPUs; this is one."
        if device.is_cpu
        else "Kernels that are shaped for CPUs, on a device that is none.",
        "",
        f"Kernels: {len(device.made)} made in {built:.1f} s"
        + (f"; **not built: {sorted(missing)}**" if missing else ", which are all."),
        "",
        f"Films of {SIZE[0]} x {SIZE[1]} pixels, where {rule} is asked for: {held} of "
        f"{len(differences)} hold.",
        "",
        "| film | bytes | RMSE | largest | |",
        "|---|---|---|---|---|",
    ]
    for difference in differences:
        same = "the same" if difference.equal else "others"
        verdict = "" if difference.held else "**does not hold**"
        numbers = f"{difference.rmse:.1e} | {difference.largest:.1e}"
        lines.append(f"| {difference.row.name} | {same} | {numbers} | {verdict} |")
    lines += [
        "",
        f"Medians of {rounds} renders of {TIMED_SIZE[0]} x {TIMED_SIZE[1]} pixels, ms.",
        "",
    ]
    return "\n".join([*lines, *timed(device, rounds)]) + "\n"


def kept_films() -> dict[str, NDArray[np.float32]]:
    """The films that are kept, by the names of rows."""
    with np.load(KEPT) as found:
        return dict(found)


def main() -> int:
    """Run everything, and print the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", help="as for mbinterval render")
    parser.add_argument("--page", type=Path, help="a file for the page as well")
    parser.add_argument("--keep", action="store_true", help="make the kept films anew")
    parser.add_argument("--rounds", type=int, default=3, help="renders of each timed row [3]")
    given = parser.parse_args()
    device = FirstRuntime(choose_device(given.device))
    if given.keep:
        films = {row.name: stored(render(row, device)) for row in ROWS}
        np.savez_compressed(KEPT, **films)
    differences = list(compare(device, kept_films()))
    copy_bandwidth(device, 1)
    missing = all_kernels() - device.made.keys()
    text = page(device, differences, missing, given.rounds)
    print(text)
    if given.page:
        given.page.write_text(text, encoding="utf-8")
    return int(bool(missing) or not all(difference.held for difference in differences))


if __name__ == "__main__":
    raise SystemExit(main())
