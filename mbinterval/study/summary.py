"""What follows from a study's rows: the Pareto front, slopes, equal times and equal errors."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

Row = Mapping[str, Any]


def summarize(result: dict[str, Any]) -> None:
    """Put ``pareto`` and ``slopes`` into a study's result."""
    result["pareto"] = pareto(row for sweep in result["sweeps"].values() for row in sweep["rows"])
    slopes = {}
    for name, sweep in result["sweeps"].items():
        if sweep["knob"] in ("samples", "slices") and not sweep["alike"]:
            points = [
                (row["value"], row["rmse"])
                for row in sweep["rows"]
                if row.get("rmse") and row["resolved"]
            ]
            if len(points) > 1:
                slopes[name] = slope(points)
    result["slopes"] = slopes


def measured(rows: Iterable[Row]) -> list[Row]:
    """Those of ``rows`` that have both ``median`` seconds and an ``rmse``."""
    return [row for row in rows if "median" in row and "rmse" in row]


def pareto(rows: Iterable[Row]) -> list[str]:
    """Names of the rows that no other beats in both ``median`` seconds and ``rmse``, by seconds.

    It ends with the first row that the reference does not resolve.
    """
    front, best = [], math.inf
    for row in sorted(measured(rows), key=lambda row: (row["median"], row["rmse"])):
        if row["rmse"] < best:
            best = row["rmse"] if row.get("resolved", True) else 0.0
            front.append(row["name"])
    return front


def slope(points: Sequence[tuple[float, float]]) -> float:
    """Exponent of the power law that fits (count, error) in least squares of logarithms."""
    x, y = np.log(np.array(points, np.float64)).T
    return float(np.polyfit(x, y, 1)[0])


def seconds_for(rows: Iterable[Row], rmse: float) -> float | None:
    """Seconds that a series needs for an ``rmse``; None where its rows do not reach it.

    Between the two rows of its front that enclose it, on a straight line of logarithms.
    """
    points = _front(rows)
    for (t0, e0), (t1, e1) in itertools.pairwise(points):
        if e1 <= rmse <= e0:
            part = math.log(e0 / rmse) / math.log(e0 / e1) if e1 > 0.0 else 1.0
            return float(t0 * (t1 / t0) ** part)
    return points[0][0] if points and points[0][1] <= rmse else None


def _front(rows: Iterable[Row]) -> list[tuple[float, float]]:
    listed = list(rows)
    names = pareto(listed)
    by_name = {row["name"]: row for row in listed}
    return [(by_name[name]["median"], by_name[name]["rmse"]) for name in names]


def within(rows: Iterable[Row], seconds: float) -> Row | None:
    """The row of least ``rmse`` among those that take at most ``seconds``; None without one."""
    fitting = [row for row in measured(rows) if row["median"] <= seconds]
    return min(fitting, key=lambda row: row["rmse"], default=None)


def equal_times(series: Mapping[str, Sequence[Row]], count: int = 3) -> list[float]:
    """Seconds at which series are compared: ``count`` of them, evenly spread in logarithms.

    From the time that the slowest series needs for its first row to that which the series that ends
    first takes for its last.
    """
    times = [[row["median"] for row in measured(rows)] for rows in series.values()]
    spans = [(min(taken), max(taken)) for taken in times if taken]
    if not spans:
        return []
    low, high = max(low for low, _ in spans), min(high for _, high in spans)
    return [float(t) for t in np.geomspace(1.05 * low, 1.05 * max(low, high), count)]


def equal_errors(series: Mapping[str, Sequence[Row]], count: int = 5) -> list[float]:
    """Errors that are compared: one, two and five times powers of ten, those that most reach."""
    listed = [
        [row["rmse"] for row in measured(rows) if row["rmse"] > 0] for rows in series.values()
    ]
    reached = sorted(min(errors) for errors in listed if errors)
    if not reached:
        return []
    worst = max(max(errors) for errors in listed if errors)
    steps = [m * 10.0**e for e in range(-6, 1) for m in (1.0, 2.0, 5.0)]
    fitting = [step for step in steps if reached[0] <= step <= worst]
    if len(fitting) <= count:
        return fitting[::-1]
    places = np.linspace(0, len(fitting) - 1, count).round().astype(int)
    return [fitting[place] for place in places[::-1]]
