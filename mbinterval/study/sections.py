"""Sections of a study's report, each from the study's result to HTML."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

from mbinterval.comparison.metrics import rms_map
from mbinterval.study.pictures import Gallery, data_uri, map_uri
from mbinterval.study.plots import PALETTE, Axis, Point, Series, bars, plot
from mbinterval.study.summary import (
    equal_errors,
    equal_times,
    measured,
    pareto,
    seconds_for,
    within,
)
from mbinterval.study.tables import figure, seconds_text, table

Result = Mapping[str, Any]

_SECONDS = Axis("seconds")
_RMSE = Axis("RMSE over linear RGB")
_MEMORY = Axis("MB in buffers of the device", log=False)
_SHOWN = 288  # pixels across of an effect's pictures


def main_series(result: Result) -> dict[str, list[Any]]:
    """Rows by series of those sweeps that trade time for error, by a count of samples or slices."""
    found = {
        sweep["series"]: measured(sweep["rows"])
        for sweep in result["sweeps"].values()
        if sweep["counts"]
    }
    return {name: rows for name, rows in found.items() if rows}


def summary(result: Result) -> str:
    """What was rendered, and what it was judged by."""
    size = f"{result['width']} x {result['height']} pixels"
    text = f"<p>Frame {result['frame']:g}, {size}, {result['triangles']:,} triangles.</p>"
    if not result["complete"]:
        text = '<p class="partial">This study was stopped before its end: what follows is what ' + (
            f"was done of it, {len(result['sweeps'])} sweeps.</p>{text}"
        )
    rows = [
        (
            {"pixel": "whole pixels", "centre": "pixel centres"}[of["kind"]],
            of["made"],
            str(of["renders"] or ""),
            f"{of['error']:.1e}" if of["error"] else "unknown",
            f"{of['seconds']:.1f}",
        )
        for of in result["references"]
    ]
    head = ("reference of", "made with", "renders", "its own RMSE", "seconds")
    caption = "References: no method is judged by one of its own"
    return text + table(head, rows, caption)


def winners(series: Mapping[str, Sequence[Any]]) -> str:
    """Tables of equal errors and equal times, with what is best."""
    if not series:
        return '<p class="none">No series was measured.</p>'
    errors, times = equal_errors(series), equal_times(series)
    seconds = {
        name: [seconds_for(rows, error) for error in errors] for name, rows in series.items()
    }
    head = ("series", *(f"RMSE {error:g}" for error in errors))
    first = table(head, _with_best(seconds, "{:.3f}"), "Seconds for the same error; * is least")
    best = {name: [_error_within(rows, time) for time in times] for name, rows in series.items()}
    head = ("series", *(f"in {seconds_text(time)}" for time in times))
    return first + table(head, _with_best(best, "{:.1e}"), "RMSE in the same time; * is least")


def _error_within(rows: Sequence[Any], seconds: float) -> float | None:
    row = within(rows, seconds)
    return None if row is None else float(row["rmse"])


def _with_best(values: Mapping[str, Sequence[float | None]], shape: str) -> list[list[str]]:
    columns = list(zip(*values.values(), strict=True))
    least = [min((v for v in column if v is not None), default=None) for column in columns]

    def cell(value: float | None, column: int) -> str:
        if value is None:
            return "not reached"
        return shape.format(value) + ("*" if value == least[column] else "")

    return [[name, *(cell(v, i) for i, v in enumerate(row))] for name, row in values.items()]


def plots(result: Result, series: Mapping[str, Sequence[Any]]) -> str:
    """Error against time with the Pareto front, against samples with slopes, and the stages."""
    by_name = {row["name"]: row for rows in series.values() for row in rows}
    front = [by_name[name] for name in pareto(by_name.values())]
    lines = [
        Series("Pareto front", _points(front, "median"), dashed=True, marks=False),
        *(Series(name, _points(rows, "median")) for name, rows in series.items()),
    ]
    colours = dict(zip(series, itertools.cycle(PALETTE), strict=False))
    drawn = plot(lines, _SECONDS, _RMSE, {"Pareto front": "#000", **colours})
    parts = [f"<h3>Error against time</h3>{drawn}"]
    slopes = {result["sweeps"][name]["series"]: value for name, value in result["slopes"].items()}
    named = {name: f"{name} {slopes[name]:+.2f}" if name in slopes else name for name in series}
    counted = [
        Series(
            named[name],
            [Point(row["value"], row["rmse"], _told(row)) for row in rows],
        )
        for name, rows in series.items()
        if not isinstance(rows[0]["value"], str)
    ]
    across = Axis("samples per pixel, or slices")
    parts += ["<h3>Error against samples, and the slope of each line</h3>"]
    parts += [plot(counted, across, _RMSE, {named[name]: c for name, c in colours.items()})]
    stages = {row["name"]: row["stages"] for rows in series.values() for row in _few(rows)}
    parts += ["<h3>Time by stage</h3>", bars(stages, "s")]
    memory = [
        Series(name, [Point(row["median"], row["buffers"] / 1e6, _told(row)) for row in rows])
        for name, rows in series.items()
    ]
    parts += ["<h3>Memory</h3>", plot(memory, _SECONDS, _MEMORY, colours)]
    return "".join(parts)


def _few(rows: Sequence[Any]) -> list[Any]:
    """Of a series the row that is nearest half a second."""
    return [min(rows, key=lambda row: abs(row["median"] - 0.5))]


def _points(rows: Iterable[Any], across: str, up: str = "rmse") -> list[Point]:
    return [Point(row[across], row[up], _told(row)) for row in rows if up in row]


def _told(row: Any) -> str:
    return f"{row['name']}: {row['median']:.3f} s, RMSE {row['rmse']:.2e}"


def knobs(result: Result) -> str:
    """A plot of each knob that is no count: error of the whole pixel, and in time alone."""
    parts = []
    for name, sweep in result["sweeps"].items():
        rows = measured(sweep["rows"])
        if sweep["counts"] or sweep["alike"] or len(rows) < 2:
            continue
        lines = [
            Series("whole pixel", _points(rows, "median")),
            Series("time alone", _points(rows, "median", "temporal"), dashed=True),
        ]
        parts.append(f"<h3>{escape(sweep['title'])}</h3>{plot(lines, _SECONDS, _RMSE)}")
        head = (sweep["knob"], "seconds", "RMSE", "RMSE in time")
        lines_of = [
            (
                str(row["value"]).lower(),
                f"{row['median']:.3f}",
                f"{row['rmse']:.2e}",
                f"{row['temporal']:.2e}" if "temporal" in row else "",
            )
            for row in rows
        ]
        parts.append(table(head, lines_of, name))
    culls = [
        Series(sweep["series"], [Point(r["value"], r["median"], _told(r)) for r in rows])
        for sweep in result["sweeps"].values()
        if sweep["alike"] and (rows := measured(sweep["rows"]))
    ]
    if culls:
        across = Axis("samples per pixel")
        parts.append(f"<h3>culling of point samples</h3>{plot(culls, across, _SECONDS)}")
    return "".join(parts)


def costs(result: Result) -> str:
    """Time against cubes, with the sort and without, against speed and triangles; and memory."""
    parts = []
    for name, curve in result["costs"].items():
        across = Axis(curve["axis"])
        rows = [(point["x"], row) for point in curve["points"] for row in point["rows"]]
        rows = [(x, row) for x, row in rows if "median" in row]
        names = list(dict.fromkeys(row["name"] for _, row in rows))
        lines = [
            Series(
                of,
                [Point(x, r["median"], f"{r['median']:.3f} s") for x, r in rows if r["name"] == of],
            )
            for of in names
        ]
        sorted_rows = [(x, row) for x, row in rows if "sort" in row["stages"]]
        if sorted_rows:
            points = [Point(x, r["median"] - r["stages"]["sort"]) for x, r in sorted_rows]
            lines.append(Series("published without its sort", points, dashed=True))
        parts.append(f"<h3>{escape(curve['title'])}</h3>{plot(lines, across, _SECONDS)}")
        memory = [
            Series(of, [Point(x, r["buffers"] / 1e6) for x, r in rows if r["name"] == of])
            for of in names
        ]
        if name != "speed":
            parts.append(plot(memory, across, _MEMORY))
    note = (
        "<p>Without its sort: the time of the same render less that of its sort stage, which is "
        "what Hong &amp; Oh's figure 16 switches off; the picture would be wrong.</p>"
    )
    return "".join(parts) + note if parts else '<p class="none">Not measured.</p>'


def effects(result: Result, gallery: Gallery) -> str:
    """What each effect of the scene costs each method, and the picture with it and without."""
    measured_effects = result.get("effects", [])
    if not measured_effects:
        return '<p class="none">Not measured.</p>'
    whole, *switched = measured_effects
    head, line = ["effect"], ["none"]
    for row in whole["rows"]:
        head += [f"{row['name']}, s", "it costs"]
        line += [f"{row['median']:.3f}" if "median" in row else "", ""]
    lines = [line, *([effect["effect"], *_cost_cells(whole, effect)] for effect in switched)]
    shown = [_effect_pictures(whole, effect, gallery) for effect in switched]
    return table(head, lines, "Time without each effect, the others left in") + "".join(shown)


def _cost_cells(whole: Any, effect: Any) -> list[str]:
    """Of each method the seconds without an effect, and the share that it takes of all."""
    before = {row["name"]: row.get("median") for row in whole["rows"]}
    cells = []
    for row in effect["rows"]:
        with_it, now = before[row["name"]], row.get("median")
        cells.append("" if now is None else f"{now:.3f}")
        cells.append(f"{(with_it - now) / with_it:+.0%}" if with_it and now is not None else "")
    return cells


def _effect_pictures(whole: Any, effect: Any, gallery: Gallery) -> str:
    why = f"{escape(effect['reason'])}. Switched off by: {escape(effect['off'])}."
    told = f"<h3>{escape(effect['effect'])}</h3><p>{why}</p>"
    pair = [gallery.colour(of["film"]) if "film" in of else None for of in (whole, effect)]
    if pair[0] is None or pair[1] is None:
        return told
    with_it, without = pair[0], pair[1]
    height, width = with_it.shape[:2]
    size = round(_SHOWN * height / width), _SHOWN
    name = effect["effect"]
    figures = [
        figure(data_uri(with_it), size, f"with {name}", f"with {name}"),
        figure(data_uri(without), size, f"without {name}", "without"),
        figure(map_uri(rms_map(without, with_it)), size, f"what {name} changes", "difference"),
    ]
    return f'{told}<div class="strip">{"".join(figures)}</div>'


def rows(result: Result) -> str:
    """Every row of every sweep."""
    head = (
        *("row", "settings", "seconds", "least", "spread", "processor s", "build s", "transfer s"),
        *("RMSE", "RMSE in time", "relative MSE", "MAE", "PSNR", "SSIM", "buffers MB"),
    )
    lines = [_line(row) for sweep in result["sweeps"].values() for row in sweep["rows"]]
    caption = "All rows: medians, kernels built; building and transfer are told apart"
    return table(head, lines, caption)


def _line(row: Mapping[str, Any]) -> list[str]:
    if "error" in row:
        return [row["name"], row["error"], *[""] * 13]
    shapes = {"median": ".3f", "minimum": ".3f", "spread": ".0%", "processor": ".3f"}
    shapes |= {"build": ".2f", "transfer": ".4f", "rmse": ".2e", "temporal": ".2e"}
    shapes |= {"relative_mse": ".2e", "mae": ".2e", "psnr": ".2f", "ssim": ".5f"}
    texts = [format(row[key], shape) if key in row else "" for key, shape in shapes.items()]
    return [row["name"], row["settings"], *texts, f"{row['buffers'] / 1e6:.1f}"]


def machine(result: Result) -> str:
    """Where it was measured, and with what versions."""
    lines = []
    for kind in ("machine", "device", "versions"):
        for name, value in result.get(kind, {}).items():
            text = f"{value / 1e9:.1f} GB/s" if name == "copy_bandwidth" else str(value)
            lines.append((kind, name.replace("_", " "), text))
    return table(("", "", ""), lines, "Machine and versions")
