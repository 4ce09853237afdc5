"""The report of a study: one HTML file with pictures, plots and tables, that needs no network."""

from __future__ import annotations

import json
from collections.abc import Mapping
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from mbinterval.comparison.comparison import MAP_RANGE
from mbinterval.errors import UsageError
from mbinterval.files.atomic import write_file
from mbinterval.film.film import Film
from mbinterval.study import sections
from mbinterval.study.pictures import Gallery, data_uri, map_uri, worst_crop
from mbinterval.study.run import FORMAT, reference_name
from mbinterval.study.summary import equal_times, within
from mbinterval.study.tables import figure, seconds_text


def write_report(folder: str | Path) -> Path:
    """Write ``report.html`` into the folder of a study, which may have stopped early.

    Raises
    ------
    UsageError
        Where the folder holds no study.
    OutputError
        Where the report cannot be written.
    """
    folder = Path(folder)
    result = read_study(folder)
    path = folder / "report.html"
    write_file(path, page(result, folder).encode())
    return path


def read_study(folder: str | Path) -> dict[str, Any]:
    """Read the ``study.json`` of a folder; raises ``UsageError`` where there is none."""
    path = Path(folder) / "study.json"
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
        if result["format"] != FORMAT:
            raise ValueError("of another format")
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise UsageError(f"{path}: not a study ({error!r:.80})") from None
    return dict(result)


def page(result: Mapping[str, Any], folder: Path) -> str:
    """Return the report as HTML."""
    series = sections.main_series(result)
    gallery = _gallery(result, folder)
    pictures, strips = _pictures(result, series, gallery)
    texts = {
        "title": escape(f"{result['scene']}: what accuracy costs in time"),
        "summary": sections.summary(result),
        "viewer": "" if len(pictures) > 1 else "hidden",
        "strips": strips,
        "winners": sections.winners(series),
        "plots": sections.plots(result, series),
        "knobs": sections.knobs(result),
        "costs": sections.costs(result),
        "effects": sections.effects(result, gallery),
        "rows": sections.rows(result),
        "machine": sections.machine(result),
        "low": f"{MAP_RANGE[0]:g}",
        "high": f"{MAP_RANGE[1]:g}",
        # "<" is written so that no text in it can end the script element
        "data": json.dumps(pictures).replace("<", "\\u003c"),
    }
    parts = files("mbinterval.study").joinpath("page")
    read = {name: parts.joinpath(name).read_text(encoding="utf-8") for name in _PARTS}
    texts |= {"style": read["page.css"], "script": read["page.js"]}
    return Template(read["page.html"]).substitute(texts)


_PARTS = ("page.html", "page.css", "page.js")


def _gallery(result: Mapping[str, Any], folder: Path) -> Gallery:
    found = {}
    for reference in result["references"]:
        path = folder / reference_name(reference["method"])
        if reference["kind"] == "pixel" and path.is_file():
            found[reference["method"]] = Film.read(path).rgba[..., :3]
    return Gallery(folder, found)


def _pictures(
    result: Mapping[str, Any], series: Mapping[str, list[Any]], gallery: Gallery
) -> tuple[list[dict[str, str]], str]:
    """Pictures that can be compared, as the page's script takes them, and the strips as HTML."""
    times = equal_times({name: rows for name, rows in series.items() if len(rows) > 1})
    picked = {
        time: {
            name: row
            for name, rows in series.items()
            if (row := within(rows, time)) is not None and "film" in row
        }
        for time in times
    }
    shown = {row["name"]: row for row in (picked[times[len(times) // 2]] if times else {}).values()}
    colours, maps = {}, {}
    for name, row in shown.items():
        colour = gallery.colour(row["film"])
        errors = None if colour is None else gallery.error_map(colour, row["method"])
        if colour is not None and errors is not None:
            colours[name], maps[name] = colour, errors
    pictures = [
        {
            "name": f"reference by {method}",
            "method": method,
            "told": "",
            "image": data_uri(colour),
            "map": "",
        }
        for method, colour in gallery.references.items()
    ]
    for name, colour in colours.items():
        row = shown[name]
        told = f"{seconds_text(row['median'])}, RMSE {row['rmse']:.1e}"
        images = {"image": data_uri(colour), "map": map_uri(maps[name])}
        pictures.append({"name": name, "method": row["method"], "told": told, **images})
    if not maps:
        return pictures, ""
    return pictures, _strips(picked, gallery, worst_crop(list(maps.values())))


def _strips(
    picked: Mapping[float, Mapping[str, Any]], gallery: Gallery, crop: tuple[slice, slice]
) -> str:
    parts = []
    for time, rows in picked.items():
        figures = [
            _crop_figure(colour[crop], f"reference by {method}", "")
            for method, colour in list(gallery.references.items())[:1]
        ]
        for row in rows.values():
            colour = gallery.colour(row["film"])
            if colour is not None:
                told = f"{seconds_text(row['median'])}, RMSE {row['rmse']:.1e}"
                figures.append(_crop_figure(colour[crop], row["name"], told))
        title = f"<h3>at most {seconds_text(time)}</h3>"
        parts.append(f'{title}<div class="strip">{"".join(figures)}</div>')
    return "".join(parts)


def _crop_figure(colour: Any, name: str, told: str) -> str:
    height, width = colour.shape[:2]
    uri = data_uri(np.ascontiguousarray(colour))
    return figure(uri, (2 * height, 2 * width), f"crop of {name}", name, told)
