"""Studies: what accuracy costs in time, for every row of every sweep, on one scene."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import logging
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.bench.bench import Brevity, measure
from mbinterval.bench.cases import Case
from mbinterval.bench.meter import MeteredRuntime
from mbinterval.device.choose import choose_device
from mbinterval.errors import OutputError
from mbinterval.files.atomic import prepare_output, write_file
from mbinterval.files.ownership import SOFTWARE, check_replaceable
from mbinterval.files.results import write_result
from mbinterval.film.film import Film
from mbinterval.settings.settings import Settings
from mbinterval.study.costs import CURVES, curve, effects
from mbinterval.study.judge import ERRORS, Truth, colour_of, errors, exact_places
from mbinterval.study.reference import fingerprint
from mbinterval.study.summary import summarize
from mbinterval.study.sweeps import SWEEPS, Sweep, chosen, weight
from mbinterval.values import number, whole_number

_log = logging.getLogger(__name__)

FORMAT = 2
ROUNDS = 3
ROW_SECONDS = 12.0
AGAIN_SECONDS = 1.5
_COLUMNS = (
    *("sweep", "series", "row", "settings", "error", "build", "transfer", "median", "minimum"),
    *(
        "spread",
        "processor",
        "intervals",
        "tests",
        "hits",
        "memory",
        "buffers",
        "resolved",
        *ERRORS,
    ),
)
_CURVE_WEIGHT = 30.0

Progress = Callable[[str, int, int, float | None], None]


def study(
    case: Case,
    truth: Truth,
    *,
    sweeps: Iterable[str] | None = None,
    costs: bool = True,
    rounds: int = ROUNDS,
    row_seconds: float = ROW_SECONDS,
    device: Any = None,
    folder: str | Path | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Measure every row of ``sweeps``; the result can be stored as JSON.

    Parameters
    ----------
    sweeps
        Names in `mbinterval.study.sweeps.SWEEPS`; None is all.
    costs
        Whether to measure too what time depends on beside settings (`mbinterval.study.costs`).
    rounds
        Renders of each row; times are their medians. Rows of more than half a second have fewer.
    row_seconds
        A row is left out where the row before it lets expect a longer render, above 0.
    folder
        Where ``study.json``, ``study.csv`` and films of references and of rows that differ in a
        count, ``films/*.exr``, are written, after every sweep. A study of the same things that
        stopped there goes on; None writes nothing.
    progress
        Told before each part what it is, how many of how many rows are done, and about how many
        seconds the rest will take, None as long as nothing is measured; and once at the end.

    Returns
    -------
    ``sweeps`` by name with ``rows`` (see `mbinterval.bench.bench.measure` for what a row has, and
    `mbinterval.study.judge.errors`), ``costs``, ``effects``, ``references``, ``pareto`` and
    ``slopes`` (see `mbinterval.study.summary`), machine, device and versions. ``complete`` says
    whether all that was asked for is in it.

    On Ctrl-C what is done stays in ``folder``. Raises what ``mbinterval.render`` raises.
    """
    whole_number(rounds, "rounds", 1)
    number(row_seconds, "row_seconds", above=0.0)
    wanted = chosen(sweeps)
    truth.check_size(case)
    path = None if folder is None else prepare_output(Path(folder) / "study.json")
    key = _key(case, truth, rounds, row_seconds, device)
    result = _begun(path, key) or _empty(case, truth, key, rounds)
    if path is not None:
        _write_references(path.parent, truth)
    run = _Run(case, truth, rounds, row_seconds, device, path, result)
    parts = {name: sum(map(weight, sweep.rows.values())) for name, sweep in wanted.items()}
    if costs:
        parts |= dict.fromkeys((*CURVES, "effects"), _CURVE_WEIGHT)
    left = _Left(parts, progress)
    for name in parts:
        left.tell(name)
        if not run.has(name):
            run.measure(name)
            left.measured(name)
        result["complete"] = all(run.has(part) for part in parts)
        run.store()
    left.tell("")
    return result


@dataclass(eq=False)
class _Left:
    """Tells the progress: how much of the weight of all parts is done, and in what time."""

    parts: Mapping[str, float]
    progress: Progress | None
    started: float = field(default_factory=time.perf_counter)
    done: list[str] = field(default_factory=list)
    weighed: float = 0.0

    def measured(self, name: str) -> None:
        self.weighed += self.parts[name]

    def tell(self, name: str) -> None:
        """Tell that part ``name`` begins, and those before it are done."""
        names = list(self.parts)
        place = names.index(name) if name else len(names)
        rest = sum(self.parts[part] for part in names[place:])
        spent = time.perf_counter() - self.started
        left = spent / self.weighed * rest if self.weighed else None
        if self.progress is not None:
            self.progress(name, _rows(names[:place]), _rows(names), left if rest else 0.0)


def _rows(names: Iterable[str]) -> int:
    return sum(len(SWEEPS[name].rows) if name in SWEEPS else 1 for name in names)


@dataclass(eq=False)
class _Run:
    """A study at work."""

    case: Case
    truth: Truth
    rounds: int
    row_seconds: float
    device: Any
    path: Path | None
    result: dict[str, Any]
    exact: dict[int, NDArray[np.float32]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.meter = MeteredRuntime(choose_device(self.device))
        for name in self.result["sweeps"]:  # of a study that goes on
            for row, places in exact_places(SWEEPS[name].rows).items():
                stored = self.path and self.path.parent / film_name(row)
                if stored and stored.is_file():
                    self.exact[places] = colour_of(Film.read(stored))

    def has(self, part: str) -> bool:
        kept = self.result["sweeps"] if part in SWEEPS else self.result["costs"]
        return part in kept or (part == "effects" and "effects" in self.result)

    def measure(self, part: str) -> None:
        if part in SWEEPS:
            self.result["sweeps"][part] = self._sweep(SWEEPS[part])
        elif part in CURVES:
            self.result["costs"][part] = curve(part, self.case, self.rounds, self.meter)
        else:
            keep = None if self.path is None else self._keep_without
            self.result["effects"] = effects(self.case, self.rounds, self.meter, keep)

    def _keep_without(self, effect: str, film: Film) -> str:
        assert self.path is not None
        name = film_name(f"without {effect}" if effect else "as it is")
        film.write(self.path.parent / name)
        return name

    def _sweep(self, sweep: Sweep) -> dict[str, Any]:
        judges = exact_places(sweep.rows)

        def figures(row: str, film: Film) -> dict[str, Any]:
            if row in judges:
                self.exact[judges[row]] = colour_of(film)
            if self.path is not None and sweep.counts:
                film.write(self.path.parent / film_name(row))
            return errors(film, sweep.rows[row], self.truth, self.exact)

        def leave_out(row: str, taken: Mapping[str, float]) -> str | None:
            expected = _expected(sweep, row, taken)
            if expected is None or expected <= self.row_seconds:
                return None
            return f"left out: it would take about {expected:.0f} s, {self.row_seconds:g} are given"

        brevity = Brevity(AGAIN_SECONDS, leave_out)
        found = measure([self.case], sweep.rows, self.rounds, self.meter, figures, brevity)
        self.result.update({name: found[name] for name in ("versions", "machine", "device")})
        rows: list[dict[str, Any]] = found["scenes"][0]["rows"]
        for row in rows:
            values = sweep.rows[row["name"]]
            row |= {"value": values.get(sweep.knob), "method": values["method"]}
            if "median" in row and self.path is not None and sweep.counts:
                row["film"] = film_name(row["name"])
        names = ("title", "series", "knob", "alike", "counts")
        return {**{name: getattr(sweep, name) for name in names}, "rows": rows}

    def store(self) -> None:
        summarize(self.result)
        if self.path is not None:
            write_result(self.path, self.result)
            write_csv(self.path.with_suffix(".csv"), self.result)


def _expected(sweep: Sweep, row: str, taken: Mapping[str, float]) -> float | None:
    """Seconds of a row by the one before it, for knobs that time grows with."""
    if sweep.knob not in ("samples", "slices") or not taken:
        return None
    before, seconds = list(taken.items())[-1]
    return seconds * float(sweep.rows[row][sweep.knob] / sweep.rows[before][sweep.knob])


def _empty(case: Case, truth: Truth, key: str, rounds: int) -> dict[str, Any]:
    references = [
        {"kind": kind, **{name: getattr(of, name) for name in ("made", "method", "renders")}}
        | {"error": of.error, "seconds": of.seconds}
        for kind, of in truth.listed
    ]
    return {
        "format": FORMAT,
        "software": SOFTWARE,
        "key": key,
        "scene": case.name,
        "frame": case.frame,
        "width": case.width,
        "height": case.height,
        "triangles": sum(len(mesh.faces) for mesh in case.scene.meshes),
        "rounds": rounds,
        "references": references,
        "sweeps": {},
        "costs": {},
        "complete": False,
    }


def _key(case: Case, truth: Truth, rounds: int, row_seconds: float, device: Any) -> str:
    """Hash of what must be the same for a study to go on where it stopped."""
    digest = hashlib.sha256(fingerprint(case, Settings(), device).encode())
    options = [rounds, row_seconds, FORMAT, dict(case.settings)]
    digest.update(json.dumps(options).encode())
    for _kind, reference in truth.listed:
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
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        _log.warning("%s: cannot be read (%s); the study begins anew", path, error)
        return None
    _log.warning("%s: is of another scene, version or machine; the study begins anew", path)
    return None


def check_folder(folder: Path) -> None:
    """Refuse a folder in which a study would replace files of somebody else.

    Raises ``OutputError``.
    """
    path, remedy = folder / "study.json", "give another folder"
    check_replaceable(path, ".json", remedy)
    if path.exists():
        return
    for name in ("study.csv", "report.html"):
        if (folder / name).exists():
            raise OutputError(f"{folder / name}: is there, and of no study; {remedy}")
    for film in sorted(folder.glob("films/*.exr")):
        check_replaceable(film, ".exr", remedy)


def _write_references(folder: Path, truth: Truth) -> None:
    """Films of the references of whole pixels, for the report."""
    for of in truth.pixels:
        rgba = np.concatenate([of.image, np.ones_like(of.image[..., :1])], axis=2)
        shape = rgba.shape[:2]
        film = Film(
            rgba=rgba,
            depth=np.full(shape, np.inf, np.float32),
            intervals=np.zeros(shape, np.uint32),
            timings={},
            resolution=(shape[1], shape[0]),
            metadata={"software": SOFTWARE},
        )
        film.write(folder / reference_name(of.method))


def reference_name(method: str) -> str:
    """Where the film of the reference of a method is, relative to the study's folder."""
    return f"films/reference-{method or 'given'}.exr"


def film_name(row: str) -> str:
    """Where the film of a row is, relative to the study's folder."""
    return f"films/{row.replace(', ', '-').replace(' ', '-')}.exr"


def write_csv(path: str | Path, result: Mapping[str, Any]) -> None:
    """Write a line for each row of a study, empty where a row has no such figure.

    Raises ``OutputError``.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, _COLUMNS, restval="", extrasaction="ignore")
    writer.writeheader()
    for name, sweep in result["sweeps"].items():
        for row in sweep["rows"]:
            place = {"sweep": name, "series": sweep["series"], "row": row["name"]}
            writer.writerow({**row, **place})
    write_file(path, text.getvalue().encode())
