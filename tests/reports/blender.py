"""Blender's Cycles as a second witness: scenes rendered by both, and how far they are apart.

    python tests/reports/blender.py --blender PYTHON [--cases NAME ...] [--keep FOLDER]
        [--size 320 240] [--samples 256] [--seeds 8] [--out tests/reports/blender.md]

PYTHON is an interpreter that can ``import bpy`` (``pip install bpy`` in an environment of its own,
1 GB; its page says for which version of Python). A case takes one to two minutes of two cores.

Geometry, motion, camera and materials are evaluated by mbinterval (`blender_handover`), and time,
visibility, lens, light and filter are Cycles' own (`blender_render`): motion at 129 times, or 3
where it is straight, a box filter, no clamping, no denoising, no adaptive sampling. Cycles draws
its times from a table of 256 rows, so that the exposure begins half a row late and ends one and a
half rows early; that is measured first, on an edge that crosses the frame, and mbinterval is given
the same exposure.

Both sides are rendered with several seeds, mbinterval with exact time and 8 samples for each seed
(64 where the lens is open). RMSE is between the means of both, "noise" is the RMSE that the spread
of the seeds alone explains, and "block" the largest mean difference, mbinterval less Cycles, of a
block of 16 x 16 pixels in any channel, with the noise of that block's mean. p is that of
`mb.compare` for equal expectations (colour and alpha, the smaller one, twice). The control is
mbinterval's exposure moved by a hundredth of its length.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from blender_cases import CASES
from blender_handover import Work, write

import mbinterval as mb
from mbinterval.files.exr import read_exr

FIRST, LENGTH = 0.5 / 256.0, 254.0 / 256.0
"""Cycles exposes from FIRST on for LENGTH of the shutter."""
SHIFT = 0.01
BLOCK = 16
LEVEL = 0.01
HEAD = """| scene | what it shows | alpha: RMSE | noise | colour: RMSE | noise | block | noise \
| p | control: alpha | colour | p |
|---|---|---|---|---|---|---|---|---|---|---|---|
"""


def exposed_as_cycles_does(scene: mb.Scene, lines: int, shift: float = 0.0) -> mb.Scene:
    """The scene with the exposure that Cycles makes of its shutter.

    ``shift`` moves it, by so much of its length. Cycles exposes the line i of ``lines`` from
    (i + 1) / lines of the readout on, mbinterval from i / (lines - 1).
    """
    shutter, first = scene.shutter, FIRST + shift
    opens, closes = shutter.window(scene.fps, lines)
    whole = closes - opens
    if shutter.rolling is not None:
        length = shutter.line_exposure * scene.fps / whole
        readout = 1.0 - length
        moved = replace(
            shutter,
            open=opens + whole * (readout / lines + length * first),
            line_offset=whole * readout / lines / scene.fps,
            line_exposure=whole * length * LENGTH / scene.fps,
        )
    else:
        begin = opens + first * whole
        moved = replace(shutter, open=begin, close=begin + LENGTH * whole)
    meshes = [_within(mesh, first) for mesh in scene.meshes]
    return replace(scene, meshes=meshes, shutter=moved)


def _within(mesh: mb.Mesh, first: float) -> mb.Mesh:
    """A mesh given by straight paths over the shutter, over the exposure instead."""
    if mesh.times == 1:
        return mesh
    start, end = mesh.positions
    ends = [start + part * (end - start) for part in (first, first + LENGTH)]
    return replace(mesh, positions=np.stack(ends))


def ours(scene: mb.Scene, frame: float, work: Work) -> list[mb.Film]:
    """mbinterval's film for each seed."""
    settings = mb.Settings(
        samples=work.samples, pattern="sobol", transparent=True, motion_error=0.02
    )
    size = {"width": work.width, "height": work.height}
    return [
        mb.render(scene, frame=frame, settings=replace(settings, seed=seed), **size)
        for seed in work.seeds
    ]


def theirs(python: str, scene: mb.Scene, frame: float, work: Work, folder: Path) -> np.ndarray:
    """Cycles' pixels ``(seeds, H, W, 4)``, by way of files in ``folder``."""
    write(scene, frame, work, folder)
    child = Path(__file__).with_name("blender_render.py")
    done = subprocess.run([python, str(child), str(folder)], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{python}: exit code {done.returncode}\n{(done.stdout + done.stderr)[-4000:]}")
    films = [read_exr(folder / f"{seed}.exr").channels for seed in work.seeds]
    return np.array([np.stack([film[name] for name in "RGBA"], axis=-1) for film in films])


@dataclass(frozen=True)
class Figures:
    """How far two sets of repeats are apart; each pair is a figure and its noise."""

    alpha: tuple[float, float]
    colour: tuple[float, float]
    block: tuple[float, float]
    p_value: float


def figures(films: list[mb.Film], cycles: np.ndarray, samples: int) -> Figures:
    """Compare mbinterval's repeats with Cycles', of so many ``samples`` each."""
    own = np.array([film.rgba for film in films], np.float64)
    other = cycles.astype(np.float64)
    difference = own.mean(axis=0) - other.mean(axis=0)
    variance = sum(side.var(axis=0, ddof=1) / len(side) for side in (own, other))
    rmse, noise = (
        [float(np.sqrt(np.mean(values[..., part]))) for part in (slice(3, 4), slice(0, 3))]
        for values in (difference**2, variance)
    )
    means = _blocks(difference)
    place = np.unravel_index(np.argmax(np.abs(means)), means.shape)
    spread = np.sqrt(sum(_blocks(side).var(axis=0, ddof=1) / len(side) for side in (own, other)))
    alphas = [replace(film, rgba=np.repeat(film.rgba[..., 3:], 4, axis=2)) for film in films]
    pairs = (films, cycles[..., :3]), (alphas, np.repeat(cycles[..., 3:], 3, axis=3))
    verdicts = [
        mb.compare(image, list(reference), which=("rmse",), samples=samples).verdict
        for image, reference in pairs
    ]
    p_value = min(1.0, *(2.0 * one.p_value for one in verdicts if one is not None))
    return Figures(
        alpha=(rmse[0], noise[0]),
        colour=(rmse[1], noise[1]),
        block=(float(means[place]), float(spread[place])),
        p_value=p_value,
    )


def _blocks(values: np.ndarray) -> np.ndarray:
    """Means of ``(..., H, W, C)`` over whole blocks."""
    rows, columns = (length // BLOCK for length in values.shape[-3:-1])
    cut = values[..., : rows * BLOCK, : columns * BLOCK, :]
    split = cut.reshape(*values.shape[:-3], rows, BLOCK, columns, BLOCK, values.shape[-1])
    return np.asarray(split.mean(axis=(-4, -2)))


@dataclass(frozen=True)
class Row:
    """What a case says: as it is, and with the exposure moved."""

    name: str
    same: Figures
    moved: Figures

    def __str__(self) -> str:
        same, moved = self.same, self.moved
        pairs = (same.alpha, same.colour, same.block)
        cells = " | ".join(f"{figure:.5f} | {noise:.5f}" for figure, noise in pairs)
        return (
            f"| {self.name} | {CASES[self.name].shows} | {cells} | {same.p_value:.2g} "
            f"| {moved.alpha[0]:.5f} | {moved.colour[0]:.5f} | {moved.p_value:.1g} |\n"
        )


def row(name: str, python: str, work: Work, folder: Path) -> Row:
    """Render a case and compare."""
    case = CASES[name]
    scene = case.scene()
    cycles = theirs(python, scene, case.frame, work, folder)
    lens = scene.camera is not None and scene.camera.f_stop is not None
    own = replace(work, samples=64 if lens else 8)
    same, moved = (
        figures(
            ours(exposed_as_cycles_does(scene, work.height, shift), case.frame, own),
            cycles,
            work.samples,
        )
        for shift in (0.0, SHIFT)
    )
    return Row(name, same, moved)


def summary(rows: list[Row]) -> str:
    """Say what of it noise does not explain, and whose control is seen."""
    apart = [one.name for one in rows if one.same.p_value <= LEVEL]
    unseen = [one.name for one in rows if one.moved.p_value > LEVEL]
    agree = f"noise explains {len(rows) - len(apart)} of {len(rows)} scenes"
    seen = f"the moved exposure is told apart in {len(rows) - len(unseen)}"
    return (
        f"At level {LEVEL:g} {agree}{', all but ' * bool(apart)}{', '.join(apart)}; "
        f"{seen}{', all but ' * bool(unseen)}{', '.join(unseen)}.\n"
    )


def exposure_of_cycles(python: str, work: Work, folder: Path) -> tuple[float, float]:
    """When Cycles' exposure begins and how long it is, from an edge that crosses the frame.

    The edge passes a column x, from 0 to 1, at the time x, so alpha there is the part of the
    exposure that is left then: a line.
    """
    edge = np.array([[-4.0, -2.0, 0.0], [-0.5, -2.0, 0.0], [-0.5, 2.0, 0.0], [-4.0, 2.0, 0.0]])
    mesh = mb.Mesh(
        np.stack([edge, edge + [1.0, 0.0, 0.0]]), [[0, 1, 2], [0, 2, 3]], shading="unlit"
    )
    aspect = work.width / work.height
    fov = float(np.degrees(2.0 * np.arctan(0.5 / aspect)))
    camera = mb.Camera(position=(0.0, 0.0, 1.0), fov=fov)
    cycles = theirs(python, mb.Scene([mesh], camera), 1.0, work, folder)
    alpha = cycles[..., 3].mean(axis=(0, 1), dtype=np.float64)
    inner = slice(work.width // 64, -work.width // 64)
    columns = (np.arange(work.width) + 0.5) / work.width
    slope, value = np.polyfit(columns[inner], alpha[inner], 1)
    return (value - 1.0) / -slope, -1.0 / slope


def main() -> None:
    """Render, compare, print the table and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--blender", required=True, metavar="PYTHON")
    parser.add_argument("--cases", nargs="*", default=list(CASES), metavar="NAME")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="where Blender's files stay")
    parser.add_argument("--size", nargs=2, type=int, default=[320, 240])
    parser.add_argument("--samples", type=int, default=256, help="of Cycles, for each seed")
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path(__file__).with_suffix(".md"))
    given = parser.parse_args()
    seeds = tuple(range(1, given.seeds + 1))
    work = Work(*given.size, given.samples, seeds, given.threads)
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.keep or Path(temporary)
        first, length = exposure_of_cycles(
            given.blender, replace(work, height=32), folder / "exposure"
        )
        version = (folder / "exposure" / "version.txt").read_text(encoding="utf-8")
        said = (
            f"Blender {version}, {work.width} x {work.height} pixels, {len(seeds)} times "
            f"{work.samples} samples. Its exposure begins at {first:.5f} of the shutter and lasts "
            f"{length:.5f} of it; mbinterval's begins at {FIRST:.5f} and lasts {LENGTH:.5f}.\n"
        )
        print(f"{said}\n{HEAD}", end="", flush=True)
        rows = []
        for name in given.cases:
            rows.append(row(name, given.blender, work, folder / name.replace(" ", "_")))
            print(rows[-1], end="", flush=True)
    found = summary(rows)
    print(f"\n{found}", end="")
    title, _usage, *about = __doc__.rstrip().split("\n\n")
    table = HEAD + "".join(map(str, rows))
    text = "\n\n".join([f"# {title.rstrip('.')}", *about[1:], said, table, found])
    given.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
