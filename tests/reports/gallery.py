"""Who wins where: studies of the shipped scenes, a table, and the README's two pictures of them.

    python tests/reports/gallery.py FOLDER [--pictures] [--scenes NAME ...]

Studies are kept in FOLDER, one for each scene, and go on there where they stopped; they are those
of ``mbinterval study scenes/NAME.toml --width 384 --height 288`` with the sweeps below. Prints the
table; --pictures writes ``scenes/pictures/equal_time.png`` and ``pareto.png`` (with matplotlib).
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from mbinterval import cli
from mbinterval.comparison.comparison import false_colour
from mbinterval.files.images import linear_to_srgb
from mbinterval.film.film import Film
from mbinterval.study.pictures import Gallery, worst_crop
from mbinterval.study.report import read_study
from mbinterval.study.run import reference_name
from mbinterval.study.summary import measured, pareto, seconds_for, within

SCENES = Path(__file__).resolve().parents[2] / "scenes"
FRAMES = {
    **{"fast_cubes": 1, "ho17_cubes": 1, "rolling_wheel": 12, "milk_truck": 7, "fly_by": 12},
    **{"running_fox": 12, "walking_fox": 12, "propeller": 12, "glass": 6, "shadows": 6},
    **{"lanterns": 6, "metals": 6, "chrome": 7, "mirror": 7},
    **{"crossing_depth": 1, "slab_behind_slit": 1},
}
SHOWN = ("fast_cubes", "rolling_wheel", "milk_truck", "fly_by")
SWEEPS = "samples,five-point,samples-published,stochastic-sobol,slices-4"
KINDS = {
    "exact time": ("exact", "five-point"),
    "Hong & Oh 2017": ("published",),
    "point samples": ("stochastic sobol",),
    "slices": ("slices of 4",),
}
ERRORS = (0.01, 0.003, 0.001, 0.0003)
CELL = (224, 168)


def studied(name: str, folder: Path) -> dict[str, Any]:
    """The study of a scene, made where it is not there."""
    place = folder / name
    size = ["--width", "384", "--height", "288", "--frame", str(FRAMES[name])]
    kept = ["--reference-error", "2e-4", "--row-seconds", "5", "--no-costs"]
    scene = str(SCENES / f"{name}.toml")
    code = cli.main(["study", scene, *size, *kept, "--sweeps", SWEEPS, "-o", str(place)])
    if code:
        raise SystemExit(code)
    return read_study(place)


def rows_of(result: dict[str, Any]) -> dict[str, list[Any]]:
    """Rows by kind."""
    return {
        kind: [
            row
            for sweep in result["sweeps"].values()
            if sweep["series"] in series
            for row in measured(sweep["rows"])
        ]
        for kind, series in KINDS.items()
    }


def table(results: dict[str, Any]) -> str:
    """Seconds of each kind for the same errors; the least is bold."""
    lines = [f"| scene | method | {' | '.join(f'RMSE {error:g}' for error in ERRORS)} |"]
    lines.append("|---|---|" + "---|" * len(ERRORS))
    for name, result in results.items():
        found = {
            kind: [seconds_for(rows, error) for error in ERRORS]
            for kind, rows in rows_of(result).items()
        }
        for kind, seconds in found.items():
            cells = []
            for column, value in enumerate(seconds):
                others = [row[column] for row in found.values() if row[column] is not None]
                text = "" if value is None else f"{value:.2g}"
                cells.append(f"**{text}**" if value is not None and value == min(others) else text)
            lines.append(f"| {name} | {kind} | {' | '.join(cells)} |")
    return "\n".join(lines)


def equal_time(results: dict[str, Any], folder: Path) -> Image.Image:
    """For each scene what the default, four exact samples, takes is given to each kind."""
    width, height = CELL
    sheet = Image.new("RGB", (width * (1 + len(KINDS)), (2 * height + 34) * len(SHOWN)), "white")
    for line, name in enumerate(SHOWN):
        result = results[name]
        place = folder / name
        references = {
            of["method"]: Film.read(place / reference_name(of["method"])).rgba[..., :3]
            for of in result["references"]
            if of["kind"] == "pixel"
        }
        gallery = Gallery(place, references)
        rows = rows_of(result)
        default = next(row for row in rows["exact time"] if row["value"] == 4)
        chosen = {kind: within(rows[kind], 1.02 * default["median"]) for kind in KINDS}
        colours = {k: gallery.colour(row["film"]) for k, row in chosen.items() if row is not None}
        maps = {k: gallery.error_map(c, chosen[k]["method"]) for k, c in colours.items()}
        crop = worst_crop(list(maps.values()))
        top = line * (2 * height + 34)
        paste(sheet, references["stochastic"][crop], 0, top)
        say(sheet, 0, top + height, f"{name}: reference")
        for column, (kind, colour) in enumerate(colours.items(), start=1):
            row = chosen[kind]
            paste(sheet, colour[crop], column * width, top)
            paste(sheet, false_colour(maps[kind][crop]), column * width, top + height + 30)
            text = f"{kind}, {row['name'].split(', ')[-1]}\n"
            text += f"{row['median']:.2f} s, RMSE {row['rmse']:.1e}"
            say(sheet, column * width, top + height, text)
    return sheet


def paste(sheet: Image.Image, colour: Any, x: int, y: int) -> None:
    encoded = np.round(255 * linear_to_srgb(colour)).astype(np.uint8)
    sheet.paste(Image.fromarray(encoded).resize(CELL, Image.Resampling.NEAREST), (x, y))


def say(sheet: Image.Image, x: int, y: int, text: str) -> None:
    ImageDraw.Draw(sheet).multiline_text((x + 4, y + 2), text, "black", spacing=2)


def plot(results: dict[str, Any], path: Path) -> None:
    """Error against time of each kind, and the front of all, in a panel for each scene."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(2, 2, figsize=(9.6, 7.2), layout="constrained")
    for name, axes in zip(SHOWN, panels.flat, strict=True):
        rows = rows_of(results[name])
        everything = [row for several in rows.values() for row in several]
        front = pareto(everything)
        by_name = {row["name"]: row for row in everything}
        points = [(by_name[one]["median"], by_name[one]["rmse"]) for one in front]
        axes.loglog(*zip(*points, strict=True), "-", color="0.8", linewidth=6, label="Pareto front")
        for kind, several in rows.items():
            ordered = sorted(several, key=lambda row: row["median"])
            seconds = [row["median"] for row in ordered]
            axes.loglog(seconds, [row["rmse"] for row in ordered], "-o", label=kind, markersize=4)
        axes.set(title=name, xlabel="seconds", ylabel="RMSE over linear RGB")
        axes.grid(visible=True, which="both", alpha=0.3)
    panels[0, 0].legend(fontsize=8)
    figure.savefig(path, dpi=100)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--pictures", action="store_true")
    parser.add_argument("--scenes", nargs="+", default=list(FRAMES), choices=FRAMES)
    arguments = parser.parse_args()
    results = {name: studied(name, arguments.folder) for name in arguments.scenes}
    print(table(results))
    if arguments.pictures:
        equal_time(results, arguments.folder).save(SCENES / "pictures" / "equal_time.png")
        plot(results, SCENES / "pictures" / "pareto.png")


if __name__ == "__main__":
    main()
