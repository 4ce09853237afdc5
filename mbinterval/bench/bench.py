"""Benchmarks: settings on scenes, in rounds that interleave them, as a table and as JSON.

Seconds are wall clock from the scene in host memory to the film in host memory, with kernels
built. Each round renders every row once, so that what else the machine does falls on all rows
alike: ratios within one run say more than seconds do.
"""

from __future__ import annotations

import ast
import dataclasses
import logging
import os
import platform
import re
import statistics
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.bench.cases import Case
from mbinterval.bench.meter import (
    MeteredRuntime,
    clear_peak_memory,
    moved_bytes,
    peak_memory,
)
from mbinterval.device.choose import choose_device
from mbinterval.errors import UsageError
from mbinterval.files.ownership import SOFTWARE
from mbinterval.film.film import Film
from mbinterval.plan.sampling import sample_count
from mbinterval.rendering.renderer import render
from mbinterval.settings.settings import RULES, Settings
from mbinterval.values import nearest
from mbinterval.version import __version__

_log = logging.getLogger(__name__)

ROUNDS = 7
SCENES = ("ho17_cubes", "fast_cubes:1000", "fast_cubes:2000", "blades", "dense_sphere")
"""Generated scenes that are measured where none is named."""

_EXACT = {"method": "analytic", "paths": "exact", "occlusion": "exact", "filter": "box"}
ROWS: dict[str, dict[str, Any]] = {
    "exact 1": {**_EXACT, "samples": 1},
    "five-point 1": {**_EXACT, "samples": 1, "filter": "five_point"},
    "exact 2": {**_EXACT, "samples": 2},
    "exact 4": {**_EXACT, "samples": 4},
    "hong-oh": {**_EXACT, "paths": "triangulated", "occlusion": 128, "samples": 1},
}
"""Settings of the rows of the table by name, where no others are asked for."""

EQUAL_ERROR = "equal error"
"""Row: the stochastic method at the fewest samples that come as near to the reference as the first
row does."""

_MORE_ROWS: dict[str, dict[str, Any]] = {
    **{f"point samples {n}": {"method": "stochastic", "samples": n} for n in (64, 256, 1024)},
    **{
        f"z-buffer {n}": {"method": "accumulation", "slices": 1, "pattern": "fixed", "samples": n}
        for n in (1, 4)
    },
    EQUAL_ERROR: {"method": "stochastic"},
}

_KEPT = (
    *("motion_segments", "motion_error", "texture_samples", "shading_error"),
    *("seed", "transparent"),
)
"""Settings of a scene file that stay in a row whose method has them; the others are the row's."""

_MOST_SAMPLES = 4096
_BISECTIONS = 3


def measure(
    cases: Sequence[Case],
    rows: Iterable[str] | Mapping[str, Mapping[str, Any]] = ROWS,
    rounds: int = ROUNDS,
    device: Any = None,
    figures: Callable[[str, Film], Mapping[str, Any]] | None = None,
    brevity: Brevity | None = None,
) -> dict[str, Any]:
    """Measure ``rows`` on ``cases``; the result can be stored as JSON.

    Rows are names that `row_names` has, or settings as `settings_text` writes them, such as
    ``method="stochastic", samples=64``, or a mapping of names to settings. ``figures`` gives
    further entries of a row, from its name and its last film. ``device`` may be a
    ``MeteredRuntime``, which keeps its kernels. With ``brevity`` slow rows are rendered less often,
    or left out.

    A row that a scene does not allow, such as triangulated paths with a lens, has an ``error`` and
    no figures. Times are in seconds, sizes in bytes, shares and ratios are fractions:

    ``first`` (the render that builds kernels and warms up; with ``brevity`` of a few pixels),
    ``build`` (the part of it that compilers took), ``transfer`` (median of the part of a render in
    which scene and film went to the device and back), ``median``, ``minimum``, ``spread``
    (distance of the quartiles over the median), ``seconds`` of each round, ``processor`` (median of
    the process's processor seconds, all cores together, which other load on the machine changes
    less), ``stages`` (medians by stage; ``host`` is the rest), ``ratio`` (to the first row),
    ``tests`` and ``hits`` (exact paths), ``memory`` (most resident bytes of the process during a
    render), ``buffers`` (bytes of the device's named buffers), ``rmse`` (over linear RGB, where
    there is a reference). Of the analytic method: ``intervals`` (met per sample), ``moved`` (bytes,
    see `mbinterval.bench.meter.moved_bytes`) and ``bandwidth`` (bytes moved per second over the
    device's copy bandwidth); of the others ``rate``, samples per second of the median.
    """
    named = rows if isinstance(rows, Mapping) else {row: _values_of(row) for row in rows}
    made = isinstance(device, MeteredRuntime)
    meter = device if made else MeteredRuntime(choose_device(device))
    load = os.getloadavg()[0]
    measured = []
    for case in cases:
        _log.info("%s: %d rows, %d rounds", case.name, len(named), rounds)
        measured.append(
            {
                "name": case.name,
                "width": case.width,
                "height": case.height,
                "triangles": sum(len(mesh.faces) for mesh in case.scene.meshes),
                "rows": _measure_rows(case, named, rounds, meter, figures, brevity),
            }
        )
    return {
        "format": 1,
        "software": SOFTWARE,
        "versions": _versions(meter.device),
        "machine": _machine(),
        "device": {
            "name": meter.device.name.strip(),
            "platform": meter.device.platform.name.strip(),
            "compute_units": meter.device.max_compute_units,
            "copy_bandwidth": meter.copied,
        },
        "load": load,
        "rounds": rounds,
        "scenes": measured,
    }


def row_names() -> tuple[str, ...]:
    """Return the names of all rows that have one."""
    return (*ROWS, *_MORE_ROWS)


@dataclass(frozen=True)
class Brevity:
    """How slow rows are kept short.

    Attributes
    ----------
    seconds
        A row is not rendered again once its renders took this long together; kernels are built by
        a render of a few pixels, so that one is enough.
    leave_out
        Told the name of the row to come and the seconds of the renders before it by name; returns
        why that row is left out, or None.
    """

    seconds: float
    leave_out: Callable[[str, Mapping[str, float]], str | None] = lambda _row, _seconds: None


@dataclass(eq=False)
class _Samples:
    """What the rounds of one row gave so far; bytes moved of the analytic method only."""

    settings: Settings
    film: Film
    first: float
    built: float
    moved: int | None = None
    buffers: int = 0
    seconds: list[float] = field(default_factory=list)
    processor: list[float] = field(default_factory=list)
    transfers: list[float] = field(default_factory=list)
    stages: list[Mapping[str, float]] = field(default_factory=list)
    memory: int = 0


def _measure_rows(
    case: Case,
    rows: Mapping[str, Mapping[str, Any]],
    rounds: int,
    meter: MeteredRuntime,
    figures: Callable[[str, Film], Mapping[str, Any]] | None,
    brevity: Brevity | None,
) -> list[dict[str, Any]]:
    samples: dict[str, _Samples] = {}
    results: dict[str, dict[str, Any]] = {}
    for row, values in rows.items():
        try:
            if brevity is not None:
                taken = {name: of.seconds[0] for name, of in samples.items()}
                reason = brevity.leave_out(row, taken)
                if reason is not None:
                    raise UsageError(reason)
            settings = _settings_of(case, values)
            if row == EQUAL_ERROR:
                settings = _with_equal_error(case, settings, samples, meter)
            samples[row] = _begun(case, settings, meter, brevity is not None)
        except UsageError as error:
            results[row] = {"name": row, "error": str(error)}
    for _ in range(rounds):
        for of in samples.values():
            if len(of.seconds) < rounds and (brevity is None or sum(of.seconds) < brevity.seconds):
                _time(case, of, meter)
    for row, of in samples.items():
        results[row] = {"name": row, **_result(case, of, meter.copied)}
        if figures is not None:
            results[row].update(figures(row, of.film))
    base = next((results[row]["median"] for row in rows if row in samples), 1.0)
    for row in samples:
        results[row]["ratio"] = results[row]["median"] / base
    return [results[row] for row in rows]


def _with_equal_error(
    case: Case, settings: Settings, before: Mapping[str, _Samples], meter: MeteredRuntime
) -> Settings:
    """Find the fewest samples, to an eighth, whose error is not above that of the first row.

    Their number is doubled until it suffices; then the interval is halved.
    """
    first = next(iter(before.values()), None)
    if case.reference is None or first is None:
        raise UsageError(f"row {EQUAL_ERROR!r}: needs a reference, and a row before it to equal")
    reference, most = case.reference, _rmse(first.film, case.reference)

    def suffices(count: int) -> bool:
        film = _render(case, dataclasses.replace(settings, samples=count), meter)
        return _rmse(film, reference) <= most

    enough = 1
    while not suffices(enough):
        enough *= 2
        if enough > _MOST_SAMPLES:
            raise UsageError(f"row {EQUAL_ERROR!r}: {_MOST_SAMPLES} samples do not suffice")
    too_few = enough // 2
    for _ in range(_BISECTIONS):
        middle = (too_few + enough) // 2
        if middle <= too_few:
            break
        too_few, enough = (too_few, middle) if suffices(middle) else (middle, enough)
    return dataclasses.replace(settings, samples=enough)


def _begun(case: Case, settings: Settings, meter: MeteredRuntime, brief: bool) -> _Samples:
    """Build the kernels of a row: by a render, or by one of a few pixels and then its first."""
    meter.clear()
    started = time.perf_counter()
    few = (case.width // 2, case.height // 2, min(8, case.width // 2), min(8, case.height // 2))
    film = _render(case, settings, meter, few if brief and min(few) else None)
    of = _Samples(settings, film, time.perf_counter() - started, meter.building)
    if brief:
        _time(case, of, meter)
    if settings.method == "analytic":
        of.moved = moved_bytes(meter, of.film, settings)
    of.buffers = sum(meter.uploaded.values()) + sum(meter.allocated.values())
    return of


def _time(case: Case, of: _Samples, meter: MeteredRuntime) -> None:
    clear_peak_memory()
    meter.clear()
    started, busy = time.perf_counter(), time.process_time()
    of.film = _render(case, of.settings, meter)
    of.seconds.append(time.perf_counter() - started)
    of.processor.append(time.process_time() - busy)
    of.transfers.append(meter.transferring)
    of.stages.append(of.film.timings)
    of.memory = max(of.memory, peak_memory())


def _render(
    case: Case,
    settings: Settings,
    meter: MeteredRuntime,
    crop: tuple[int, int, int, int] | None = None,
) -> Film:
    return render(
        case.scene,
        frame=case.frame,
        width=case.width,
        height=case.height,
        settings=settings,
        device=meter,
        crop=crop,
    )


def _result(case: Case, of: _Samples, copied: float) -> dict[str, Any]:
    median = statistics.median(of.seconds)
    names = of.stages[-1].keys()
    stages = {name: statistics.median(s[name] for s in of.stages) for name in names}
    spent = statistics.median(
        seconds - sum(s.values()) for seconds, s in zip(of.seconds, of.stages, strict=True)
    )
    film = of.film
    result = {
        "settings": settings_text(of.settings),
        "first": of.first,
        "build": of.built,
        "transfer": statistics.median(of.transfers),
        "median": median,
        "minimum": min(of.seconds),
        "spread": _spread(of.seconds),
        "seconds": of.seconds,
        "processor": statistics.median(of.processor),
        "stages": {**stages, "host": spent},
        "memory": of.memory,
        "buffers": of.buffers,
        **film.stats,
    }
    count = of.film.intervals.size * sample_count(of.settings)
    if of.moved is None:
        result["rate"] = count / median
    else:
        result["intervals"] = float(of.film.intervals.sum(dtype=np.int64)) / count
        result["moved"] = of.moved
        result["bandwidth"] = of.moved / median / copied
    if case.reference is not None:
        result["rmse"] = _rmse(of.film, case.reference)
    return result


def _rmse(film: Film, reference: NDArray[np.float32]) -> float:
    """Error over linear RGB."""
    difference = film.rgba[..., :3].astype(np.float64) - reference
    return float(np.sqrt(np.mean(difference**2)))


def settings_text(settings: Settings) -> str:
    """Settings as ``Settings(...)`` takes them: samples, and what differs from the defaults."""
    values = {"samples": settings.samples}
    for item in dataclasses.fields(Settings):
        value = getattr(settings, item.name)
        if value != item.default:
            values[item.name] = value
    return ", ".join(f"{name}={value!r}".replace("'", '"') for name, value in values.items())


def _values_of(row: str) -> dict[str, Any]:
    """Settings that a row names, or is."""
    if "=" not in row:
        named = {**ROWS, **_MORE_ROWS}
        if row not in named:
            known = nearest(row, named)
            raise UsageError(f'row {row!r}: unknown, {known}; or settings such as "samples=9"')
        return dict(named[row])
    try:
        call = ast.parse(f"Settings({row})", mode="eval").body
        if not isinstance(call, ast.Call) or call.args:
            raise ValueError
        values = {str(given.arg): ast.literal_eval(given.value) for given in call.keywords}
    except (ValueError, SyntaxError):
        raise UsageError(
            f'row {row!r}: expected settings as in method="stochastic", samples=64'
        ) from None
    Settings.from_mapping(values)
    return values


def _settings_of(case: Case, values: Mapping[str, Any]) -> Settings:
    method = values.get("method", "analytic")
    kept = {
        name: value
        for name, value in case.settings.items()
        if name in _KEPT and method in RULES[name].methods
    }
    return Settings.from_mapping({**kept, **values})


def _spread(seconds: Sequence[float]) -> float:
    if len(seconds) < 2:
        return 0.0
    low, middle, high = statistics.quantiles(seconds, n=4, method="inclusive")
    return (high - low) / middle


def _versions(device: Any) -> dict[str, str]:
    packages = ("numpy", "pyopencl")
    return {
        "mbinterval": __version__,
        "python": platform.python_version(),
        **{name: version(name) for name in packages},
        "opencl": device.platform.version.strip(),
        "driver": device.driver_version.strip(),
    }


def _machine() -> dict[str, Any]:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        text = ""
    named = re.search(r"^model name\s*: (.*)$", text, re.MULTILINE)
    return {
        "processor": named[1] if named else platform.processor() or platform.machine(),
        "cores": len(os.sched_getaffinity(0)),
        "system": platform.platform(),
    }
