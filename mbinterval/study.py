"""Studies: what accuracy costs in time, for every row of every sweep, on one scene.

Errors are of two kinds and never mixed. ``rmse`` is the full pixel's: against a reference that
averages over pixel, shutter and lens. ``temporal`` is against the truth at the pixel's centre, for
rows that sample there: what is left of it is due to time alone. A row is never judged by a
reference of its own method.
"""

from __future__ import annotations

import csv
import hashlib
import itertools
import json
import logging
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mbinterval import metrics
from mbinterval.atomic import prepare_output, replacing
from mbinterval.bench import measure
from mbinterval.bench_cases import Case
from mbinterval.bench_report import write_result
from mbinterval.checks import whole_number
from mbinterval.errors import UsageError
from mbinterval.film import Film
from mbinterval.reference import Reference, fingerprint
from mbinterval.settings import Settings
from mbinterval.sweeps import Sweep, chosen

_log = logging.getLogger(__name__)

FORMAT = 1
ROUNDS = 3
_ERRORS = ("rmse", "temporal", "relative_mse", "mae", "psnr", "ssim")
_COLUMNS = (
    *("sweep", "series", "row", "settings", "error", "first", "median", "minimum", "spread"),
    *("processor", "intervals", "tests", "hits", "memory", "resolved", *_ERRORS),
)


@dataclass(frozen=True, eq=False)
class Truth:
    """What rows are judged by: references of whole pixels, and of pixel centres.

    Of each kind the first is taken whose method is not the row's.
    """

    pixels: Sequence[Reference]
    centres: Sequence[Reference] = ()


def study(
    case: Case,
    truth: Truth,
    *,
    sweeps: Iterable[str] | None = None,
    rounds: int = ROUNDS,
    device: Any = None,
    folder: str | Path | None = None,
    progress: Callable[[int, int, float], None] | None = None,
) -> dict[str, Any]:
    """Measure every row of ``sweeps``; the result can be stored as JSON.

    Parameters
    ----------
    sweeps
        Names in `mbinterval.sweeps.SWEEPS`; None is all.
    rounds
        Renders of each row after the one that builds kernels; times are their medians.
    folder
        Where ``study.json``, ``study.csv`` and a film of each row, ``films/*.exr``, are written,
        after every sweep. A study of the same things that stopped there goes on; None writes
        nothing.
    progress
        Told after each sweep how many rows of how many are done, and the seconds that the rest
        will take at the mean speed so far.

    Returns
    -------
    ``sweeps`` by name with ``rows`` (see `mbinterval.bench.measure` for what a row has, and the
    errors in scene-linear colour), ``references``, ``pareto`` (see `pareto`), ``slopes`` (see
    `slope`), machine, device and versions. ``complete`` says whether all sweeps are in it.

    On Ctrl-C what is done stays in ``folder``. Raises what ``mbinterval.render`` raises.
    """
    whole_number(rounds, "rounds", 1)
    wanted = chosen(sweeps)
    key = _key(case, truth, rounds, device)
    path = None if folder is None else prepare_output(Path(folder) / "study.json")
    result = _begun(path, key) or _empty(case, truth, key, rounds)
    total = sum(len(sweep.rows) for sweep in wanted.values())
    done, measured, started = 0, 0, time.perf_counter()
    for name, sweep in wanted.items():
        if name not in result["sweeps"]:
            rows = _measured(case, truth, sweep, rounds, device, path, result)
            titles = {"title": sweep.title, "method": sweep.method, "knob": sweep.knob}
            result["sweeps"][name] = {**titles, "rows": rows}
            measured += len(rows)
        done += len(sweep.rows)
        result["complete"] = all(name in result["sweeps"] for name in wanted)
        _summarize(result)
        if path is not None:
            write_result(path, result)
            write_csv(path.with_suffix(".csv"), result)
        if progress is not None:
            each = (time.perf_counter() - started) / measured if measured else 0.0
            progress(done, total, each * (total - done))
    return result


def _empty(case: Case, truth: Truth, key: str, rounds: int) -> dict[str, Any]:
    kinds = (("pixel", truth.pixels), ("centre", truth.centres))
    references = [
        {"kind": kind, **{name: getattr(of, name) for name in ("made", "method", "renders")}}
        | {"error": of.error, "seconds": of.seconds}
        for kind, several in kinds
        for of in several
    ]
    for kind, several in kinds:
        for of in several:
            if of.image.shape != (case.height, case.width, 3):
                shape = f"{of.image.shape[1]} x {of.image.shape[0]}"
                size = f"{case.width} x {case.height}"
                raise UsageError(f"{kind} reference: {shape} pixels, but {case.name} is {size}")
    return {
        "format": FORMAT,
        "key": key,
        "scene": case.name,
        "frame": case.frame,
        "width": case.width,
        "height": case.height,
        "triangles": sum(len(mesh.faces) for mesh in case.scene.meshes),
        "rounds": rounds,
        "references": references,
        "sweeps": {},
        "complete": False,
    }


def _key(case: Case, truth: Truth, rounds: int, device: Any) -> str:
    """Hash of what must be the same for a study to go on where it stopped."""
    digest = hashlib.sha256(fingerprint(case, Settings(), device).encode())
    digest.update(json.dumps([rounds, FORMAT, dict(case.settings)]).encode())
    for reference in (*truth.pixels, *truth.centres):
        digest.update(reference.halves.tobytes())
    return digest.hexdigest()[:24]


def _begun(path: Path | None, key: str) -> dict[str, Any] | None:
    """What an earlier study of the same things left."""
    if path is None or not path.is_file():
        return None
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
        if stored["format"] == FORMAT and stored["key"] == key:
            _log.info("%s: goes on after %d sweeps", path, len(stored["sweeps"]))
            return dict(stored)
    except (OSError, ValueError, KeyError, TypeError) as error:
        _log.warning("%s: cannot be read (%s); the study begins anew", path, error)
        return None
    _log.warning("%s: is of another scene, version or machine; the study begins anew", path)
    return None


def _measured(
    case: Case,
    truth: Truth,
    sweep: Sweep,
    rounds: int,
    device: Any,
    path: Path | None,
    result: dict[str, Any],
) -> list[dict[str, Any]]:
    def figures(row: str, film: Film) -> dict[str, Any]:
        if path is not None:
            film.write(path.parent / film_name(row))
        return errors(film, sweep.rows[row], truth)

    found = measure([case], sweep.rows, rounds, device, figures)
    result.update({name: found[name] for name in ("versions", "machine", "device")})
    rows: list[dict[str, Any]] = found["scenes"][0]["rows"]
    for row in rows:
        row["value"] = sweep.rows[row["name"]].get(sweep.knob)
    return rows


def film_name(row: str) -> str:
    """Where the film of a row is, relative to the study's folder."""
    return f"films/{row.replace(', ', '-').replace(' ', '-')}.exr"


def errors(film: Film, values: Mapping[str, Any], truth: Truth) -> dict[str, float]:
    """Errors of a film by name; those that nothing can judge are left out.

    ``resolved`` is whether ``rmse`` is at least the reference's own error: below it, that the row
    is as good is all that is known.
    """
    method = values.get("method", Settings().method)
    found: dict[str, float] = {}
    reference = _judge(truth.pixels, method)
    if reference is not None:
        found["rmse"] = reference.rmse_of(film.rgba)
        found["resolved"] = found["rmse"] >= (reference.error or 0.0)
        colour = film.rgba[..., :3]
        for name in _ERRORS[2:]:
            value = getattr(metrics, name)(colour, reference.image)
            if math.isfinite(value):
                found[name] = value
    centre = _judge(truth.centres, method)
    if centre is not None and _at_centres(values):
        found["temporal"] = centre.rmse_of(film.rgba)
    return found


def _judge(references: Sequence[Reference], method: str) -> Reference | None:
    return next((of for of in references if of.method != method), None)


def _at_centres(values: Mapping[str, Any]) -> bool:
    """Whether a pixel is its centre, as one sample of the box filter has it."""
    plain = Settings.from_mapping(values)
    return (plain.samples, plain.filter, plain.filter_radius) == (1, "box", None)


def _summarize(result: dict[str, Any]) -> None:
    rows = [row for sweep in result["sweeps"].values() for row in sweep["rows"]]
    result["pareto"] = pareto(rows)
    slopes = {}
    for name, sweep in result["sweeps"].items():
        if sweep["knob"] == "samples":
            points = [
                (row["value"], row["rmse"])
                for row in sweep["rows"]
                if row.get("rmse") and row["resolved"]
            ]
            if len(points) > 1:
                slopes[name] = slope(points)
    result["slopes"] = slopes


def pareto(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Names of the rows that no other beats in both ``median`` seconds and ``rmse``, by seconds.

    It ends with the first row that the reference does not resolve.
    """
    judged = [row for row in rows if "median" in row and "rmse" in row]
    front, best = [], math.inf
    for row in sorted(judged, key=lambda row: (row["median"], row["rmse"])):
        if row["rmse"] < best:
            best = row["rmse"] if row.get("resolved", True) else 0.0
            front.append(row["name"])
    return front


def slope(points: Sequence[tuple[float, float]]) -> float:
    """Exponent of the power law that fits (count, error) in least squares of logarithms."""
    x, y = np.log(np.array(points, np.float64)).T
    return float(np.polyfit(x, y, 1)[0])


def seconds_for(rows: Iterable[Mapping[str, Any]], rmse: float) -> float | None:
    """Seconds that a series needs for an ``rmse``; None where its rows do not reach it.

    Between the two rows of its front that enclose it, on a straight line of logarithms.
    """
    points = _front(rows)
    for (t0, e0), (t1, e1) in itertools.pairwise(points):
        if e1 <= rmse <= e0:
            part = math.log(e0 / rmse) / math.log(e0 / e1) if e1 > 0.0 else 1.0
            return float(t0 * (t1 / t0) ** part)
    return points[0][0] if points and points[0][1] <= rmse else None


def _front(rows: Iterable[Mapping[str, Any]]) -> list[tuple[float, float]]:
    listed = list(rows)
    names = pareto(listed)
    by_name = {row["name"]: row for row in listed}
    return [(by_name[name]["median"], by_name[name]["rmse"]) for name in names]


def write_csv(path: str | Path, result: Mapping[str, Any]) -> None:
    """Write a line for each row of a study, empty where a row has no such figure.

    Raises ``OutputError``.
    """
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, _COLUMNS, restval="", extrasaction="ignore")
        writer.writeheader()
        for name, sweep in result["sweeps"].items():
            for row in sweep["rows"]:
                place = {"sweep": name, "series": sweep["method"], "row": row["name"]}
                writer.writerow({**row, **place})
