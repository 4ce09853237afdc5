"""Plots as inline SVG: points and lines on axes, linear or logarithmic, and stacked bars.

No plotting library is among what a study needs; SVG of its own also keeps its page one file.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape

WIDTH, HEIGHT = 720, 420
_LEFT, _RIGHT, _TOP, _BOTTOM = 66, 206, 14, 50
PALETTE = (
    *("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#8a6d00", "#56b4e9"),
    *("#6a3d9a", "#7f7f7f", "#b15928", "#1b9e9e", "#e6007e", "#444444"),
    *("#a6d854", "#984ea3", "#f0c000", "#80380f", "#4daf4a", "#001f8b"),
)
"""Colours of series; the first six can be told apart by colour-blind people (Okabe & Ito)."""


@dataclass(frozen=True)
class Point:
    """A point of a plot, and what is said of it when it is pointed at."""

    x: float
    y: float
    told: str = ""


@dataclass(frozen=True)
class Series:
    """Points that belong together; ``line`` joins them, ``dashed`` too."""

    name: str
    points: Sequence[Point]
    line: bool = True
    dashed: bool = False
    marks: bool = True


@dataclass(frozen=True)
class Axis:
    """An axis: what it says, and whether it is logarithmic."""

    title: str
    log: bool = True


@dataclass(frozen=True)
class _Scale:
    """Where values lie on the page."""

    axis: Axis
    low: float
    high: float
    start: float
    end: float
    ticks: Sequence[float] = field(default=())

    def at(self, value: float) -> float:
        part = (_place(value, self.axis.log) - self.low) / (self.high - self.low)
        return round(self.start + part * (self.end - self.start), 2)


def plot(
    series: Iterable[Series], across: Axis, up: Axis, colours: Mapping[str, str] | None = None
) -> str:
    """Draw series; those that can't be shown, as 0 on a logarithmic axis, are left out.

    ``colours`` are those of series by name; others take the `PALETTE` in turn. Entries of the
    legend are buttons that hide their series (see ``page.js``).
    """
    shown = [_visible(one, across, up) for one in series]
    shown = [one for one in shown if one.points]
    if not shown:
        return '<p class="none">Nothing was measured for this plot.</p>'
    points = [point for one in shown for point in one.points]
    x = _scale(across, [point.x for point in points], _LEFT, WIDTH - _RIGHT)
    y = _scale(up, [point.y for point in points], HEIGHT - _BOTTOM, _TOP)
    given, parts = dict(colours or {}), [_axes(x, y)]
    for one in shown:
        given.setdefault(one.name, PALETTE[len(given) % len(PALETTE)])
    names = list(dict.fromkeys(one.name for one in shown))
    for one in shown:
        parts.append(_drawn(one, x, y, given[one.name], names.index(one.name)))
    parts += [_legend(name, given[name], i) for i, name in enumerate(names)]
    height = max(HEIGHT, _TOP + 17 * len(names) + 10)
    label = escape(f"{up.title} against {across.title}")
    return (
        f'<svg class="plot" viewBox="0 0 {WIDTH} {height}" role="img" aria-label="{label}">'
        f"{''.join(parts)}</svg>"
    )


def _visible(series: Series, across: Axis, up: Axis) -> Series:
    def fits(value: float, axis: Axis) -> bool:
        return math.isfinite(value) and (value > 0.0 or not axis.log)

    kept = [p for p in series.points if fits(p.x, across) and fits(p.y, up)]
    return Series(series.name, kept, series.line, series.dashed, series.marks)


def _place(value: float, log: bool) -> float:
    return math.log10(value) if log else value


def _scale(axis: Axis, values: Sequence[float], start: float, end: float) -> _Scale:
    places = [_place(value, axis.log) for value in values]
    low, high = min(places), max(places)
    if not axis.log:
        low = min(low, 0.0)
    margin = 0.04 * (high - low) or 0.1
    low, high = low - (margin if axis.log else 0.0), high + margin
    ticks = _log_ticks(low, high) if axis.log else _ticks(low, high)
    return _Scale(axis, low, high, start, end, ticks)


def _log_ticks(low: float, high: float) -> list[float]:
    parts = (1.0, 2.0, 5.0) if high - low < 2.5 else (1.0,)
    decades = range(math.floor(low), math.ceil(high) + 1)
    values = [part * 10.0**decade for decade in decades for part in parts]
    return [value for value in values if low <= math.log10(value) <= high]


def _ticks(low: float, high: float) -> list[float]:
    step = 10.0 ** math.floor(math.log10((high - low) / 4.0))
    step *= next(m for m in (1.0, 2.0, 5.0, 10.0) if (high - low) / (m * step) <= 6.0)
    first = math.ceil(low / step)
    return [step * i for i in range(first, math.floor(high / step) + 1)]


def _axes(x: _Scale, y: _Scale) -> str:
    parts = []
    for tick in x.ticks:
        at = x.at(tick)
        parts.append(f'<line class="grid" x1="{at}" x2="{at}" y1="{y.start}" y2="{y.end}"/>')
        parts.append(f'<text x="{at}" y="{y.start + 16}" class="tick mid">{_number(tick)}</text>')
    for tick in y.ticks:
        at = y.at(tick)
        parts.append(f'<line class="grid" x1="{x.start}" x2="{x.end}" y1="{at}" y2="{at}"/>')
        parts.append(
            f'<text x="{x.start - 6}" y="{at + 4}" class="tick end">{_number(tick)}</text>'
        )
    middle, centre = (x.start + x.end) / 2, (y.start + y.end) / 2
    parts.append(
        f'<text x="{middle}" y="{y.start + 38}" class="axis mid">{escape(x.axis.title)}</text>'
    )
    parts.append(
        f'<text transform="translate(14 {centre}) rotate(-90)" class="axis mid">'
        f"{escape(y.axis.title)}</text>"
    )
    return "".join(parts)


def _number(value: float) -> str:
    if value == 0.0 or 1e-3 <= abs(value) < 1e4:
        return f"{value:g}"
    return f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e")


def _drawn(series: Series, x: _Scale, y: _Scale, colour: str, place: int) -> str:
    at = [(x.at(point.x), y.at(point.y)) for point in series.points]
    parts = []
    if series.line and len(at) > 1:
        dash = ' stroke-dasharray="5 4"' if series.dashed else ""
        path = " ".join(f"{px},{py}" for px, py in at)
        parts.append(f'<polyline points="{path}" stroke="{colour}"{dash}/>')
    for (px, py), point in zip(at, series.points, strict=True):
        if series.marks:
            told = escape(f"{series.name}: {point.told}" if point.told else series.name)
            mark = _mark(px, py, place)
            parts.append(f'<path d="{mark}" fill="{colour}"><title>{told}</title></path>')
    return f'<g class="series" data-series="{escape(series.name)}">{"".join(parts)}</g>'


def _mark(x: float, y: float, place: int) -> str:
    """A circle, square, triangle or diamond, so that colour does not have to say it alone."""
    if place % 4 == 0:
        return f"M{x - 3.5} {y}a3.5 3.5 0 1 0 7 0a3.5 3.5 0 1 0 -7 0"
    if place % 4 == 1:
        return f"M{x - 3} {y - 3}h6v6h-6z"
    if place % 4 == 2:
        return f"M{x} {y - 4}l4 7h-8z"
    return f"M{x} {y - 4.5}l4 4.5l-4 4.5l-4 -4.5z"


def _legend(name: str, colour: str, place: int) -> str:
    left, top = WIDTH - _RIGHT + 16, _TOP + 10 + 17 * place
    return (
        f'<g class="legend" role="button" tabindex="0" aria-pressed="true" '
        f'data-series="{escape(name)}"><path d="{_mark(left, top - 4, place)}" fill="{colour}"/>'
        f'<text x="{left + 10}" y="{top}">{escape(name)}</text></g>'
    )


def bars(rows: Mapping[str, Mapping[str, float]], unit: str) -> str:
    """Draw a stacked bar for each row, of parts by name, longest row across the whole width."""
    parts = list(dict.fromkeys(name for row in rows.values() for name in row))
    if not parts:
        return '<p class="none">Nothing was measured for this plot.</p>'
    colours = {name: PALETTE[i % len(PALETTE)] for i, name in enumerate(parts)}
    longest = max(sum(row.values()) for row in rows.values())
    left, width = 210, WIDTH - 280
    drawn, top = [], 10
    for name, row in rows.items():
        drawn.append(f'<text x="{left - 8}" y="{top + 13}" class="tick end">{escape(name)}</text>')
        at = float(left)
        for part, value in row.items():
            size = width * value / longest
            told = escape(f"{name}: {part} {value:.4f} {unit}")
            drawn.append(
                f'<rect x="{at:.2f}" y="{top}" width="{max(size, 0.0):.2f}" height="17" '
                f'fill="{colours[part]}"><title>{told}</title></rect>'
            )
            at += max(size, 0.0)
        total = f"{sum(row.values()):.3g} {unit}"
        drawn.append(f'<text x="{at + 6:.2f}" y="{top + 13}" class="tick">{total}</text>')
        top += 23
    for place, (name, colour) in enumerate(colours.items()):
        x, y = left + 110 * (place % 4), top + 18 + 18 * (place // 4)
        drawn.append(f'<rect x="{x}" y="{y - 10}" width="11" height="11" fill="{colour}"/>')
        drawn.append(f'<text x="{x + 16}" y="{y}" class="tick">{escape(name)}</text>')
    height = top + 30 + 18 * -(-len(colours) // 4)
    return (
        f'<svg class="plot" viewBox="0 0 {WIDTH} {height}" role="img" '
        f'aria-label="{escape(unit)} by stage">{"".join(drawn)}</svg>'
    )
