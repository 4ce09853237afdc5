"""Which settings reach an error, or make the best of a time, on a scene: by small probes.

Each method is rendered with few samples. From these its error is taken for a power law of the
count, and its seconds for a straight line; what is predicted for the best is then measured, and
the count mended by what was measured until it holds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mbinterval.bench import Brevity, measure
from mbinterval.bench_cases import Case
from mbinterval.checks import number
from mbinterval.device.choose import choose_device
from mbinterval.device.meter import MeteredRuntime
from mbinterval.errors import UsageError
from mbinterval.settings import Settings
from mbinterval.study.judge import Truth, errors
from mbinterval.study.reference import converged
from mbinterval.study.summary import slope
from mbinterval.study.sweeps import ACCUMULATION, EXACT, PUBLISHED, STOCHASTIC

_FLATTEST, _STEEPEST = -0.1, -1.5
_TRIES = 6
_MARGIN = 0.95
"""What is aimed at after a miss, as a part of what was asked for."""


@dataclass(frozen=True)
class Candidate:
    """A method with one count to choose: its settings, the knob, probes, and the largest count."""

    name: str
    base: Mapping[str, Any]
    knob: str
    probes: tuple[int, ...]
    most: int

    def settings(self, count: int) -> dict[str, Any]:
        """Settings with the count."""
        return {**self.base, self.knob: count}


CANDIDATES = (
    Candidate("five-point", {**EXACT, "filter": "five_point"}, "samples", (1,), 1),
    Candidate("exact", EXACT, "samples", (1, 2, 4), 256),
    Candidate("published", PUBLISHED, "samples", (1, 2, 4), 256),
    Candidate("stochastic sobol", {**STOCHASTIC, "pattern": "sobol"}, "samples", (4, 16, 64), 4096),
    Candidate("stochastic fixed", {**STOCHASTIC, "pattern": "fixed"}, "samples", (4, 16, 64), 4096),
    Candidate("slices of 4", {**ACCUMULATION, "samples": 4}, "slices", (8, 16, 32), 4096),
    Candidate("slices of 16", {**ACCUMULATION, "samples": 16}, "slices", (8, 16, 32), 4096),
)
"""Methods that are tried; a scene may not allow some."""


@dataclass(frozen=True)
class Model:
    """What probes say of a candidate: error and seconds of any count.

    Attributes
    ----------
    points
        Count, seconds and error of each probe, by count.
    slower, worse
        What seconds and errors are multiplied by, since a later measurement said so.
    """

    candidate: Candidate
    points: tuple[tuple[int, float, float], ...]
    slower: float = 1.0
    worse: float = 1.0

    def error(self, count: float) -> float:
        """Predicted RMSE: a power law through the probe of the nearest count."""
        at, _seconds, error = min(self.points, key=lambda point: abs(math.log(point[0] / count)))
        return float(self.worse * error * (count / at) ** self.exponent)

    @property
    def exponent(self) -> float:
        """Of the power law, from the two largest counts; 0 where error does not fall."""
        points = [(count, error) for count, _, error in self.points[-2:] if error > 0.0]
        if len(points) < 2:
            return 0.0
        found = slope(points)
        return max(found, _STEEPEST) if found < _FLATTEST else 0.0

    def seconds(self, count: float) -> float:
        """Predicted seconds: a line through the probes beside the count."""
        counts, taken = zip(*((c, s) for c, s, _ in self.points), strict=True)
        if len(counts) == 1:
            return float(self.slower * taken[0])
        high = min(max(int(np.searchsorted(counts, count)), 1), len(counts) - 1)
        rise = (taken[high] - taken[high - 1]) / (counts[high] - counts[high - 1])
        return float(self.slower * (taken[high] + max(rise, 0.0) * (count - counts[high])))

    def count_for(self, error: float | None, seconds: float | None) -> int | None:
        """Least count that reaches ``error``, or the largest within ``seconds``; None without."""
        counts = _counts(self.candidate.most)
        if error is not None:
            return next((count for count in counts if self.error(count) <= error), None)
        limit = seconds or 0.0
        return next((count for count in counts[::-1] if self.seconds(count) <= limit), None)

    def mended(self, count: int, seconds: float, error: float) -> Model:
        """Return the model scaled so that it predicts a measurement."""
        predicted = self.error(count)  # 0 where a probe was as good as the reference
        worse = self.worse * error / predicted if predicted > 0.0 else self.worse
        return replace(self, slower=self.slower * seconds / self.seconds(count), worse=worse)


def _counts(most: int) -> list[int]:
    """All counts up to 16, and above steps of about a sixteenth."""
    counts = list(range(1, min(most, 16) + 1))
    while counts[-1] < most:
        counts.append(min(most, counts[-1] + counts[-1] // 16))
    return counts


@dataclass(frozen=True)
class Choice:
    """Settings that were chosen, or that another method would take; what is not measured is None.

    ``reached`` says whether the measured figure is as asked for.
    """

    name: str
    settings: Mapping[str, Any]
    predicted_seconds: float
    predicted_error: float
    seconds: float | None = None
    error: float | None = None
    reached: bool = False


def recommend(
    case: Case,
    *,
    error: float | None = None,
    seconds: float | None = None,
    device: Any = None,
    told: Callable[[str], None] | None = None,
) -> list[Choice]:
    """Find settings that reach ``error`` in the least time, or the least error within ``seconds``.

    Parameters
    ----------
    error, seconds
        RMSE over linear RGB, or wall clock with kernels built; one of them, above 0.
    told
        Told what is being done.

    Returns
    -------
    The best first, measured; then what other methods would take, best predicted first. Empty where
    no method is predicted to reach it.

    Raises
    ------
    UsageError
        For none of the two, or both; and what ``mbinterval.render`` raises.
    """
    if (error is None) == (seconds is None):
        raise UsageError("give either an error or a time, not both or none")
    target = number(error if seconds is None else seconds, "error or time", above=0.0)
    run = _Probing(case, MeteredRuntime(choose_device(device)), told or (lambda _text: None))
    models = run.models(None if error is None else target)
    choices = _ranked(models, error, seconds)
    if not choices:
        return []
    best = next(model for model in models if model.candidate.name == choices[0].name)
    return [run.mended(best, choices[0], error, seconds), *choices[1:]]


def _ranked(models: Iterable[Model], error: float | None, seconds: float | None) -> list[Choice]:
    found = []
    for model in models:
        count = model.count_for(error, seconds)
        if count is not None:
            found.append(_choice(model, count))
    if error is not None:
        return sorted(found, key=lambda choice: choice.predicted_seconds)
    return sorted(found, key=lambda choice: choice.predicted_error)


def _choice(model: Model, count: int) -> Choice:
    values = model.candidate.settings(count)
    return Choice(model.candidate.name, values, model.seconds(count), model.error(count))


class _Probing:
    """Renders of one recommendation."""

    def __init__(self, case: Case, meter: MeteredRuntime, told: Callable[[str], None]) -> None:
        self.case, self.meter, self.told = case, meter, told
        self.truth = Truth([])

    def models(self, error: float | None) -> list[Model]:
        self.told("references of a few renders")
        self.truth = self._truth(1e-4 if error is None else 0.5 * error)
        found = []
        for candidate in CANDIDATES:
            self.told(f"probes of {candidate.name}")
            points = [self.measured(candidate, count) for count in candidate.probes]
            kept = tuple(point for point in points if point is not None)
            if kept:
                found.append(Model(candidate, kept))
        return found

    def _truth(self, error: float) -> Truth:
        points = Settings(method="stochastic", samples=1024, pattern="sobol")
        exact = Settings(samples=4, pattern="sobol")
        made = [
            converged(self.case, settings, error, most=8, device=self.meter.device)
            for settings in (points, exact)
        ]
        return Truth(made)

    def measured(self, candidate: Candidate, count: int) -> tuple[int, float, float] | None:
        """Count, seconds and error of a render; None where the scene does not allow it."""
        values = candidate.settings(count)
        row = measure(
            [self.case],
            {candidate.name: values},
            3,
            self.meter,
            lambda _row, film: errors(film, values, self.truth),
            Brevity(1.0),
        )["scenes"][0]["rows"][0]
        return None if "error" in row else (count, float(row["median"]), float(row["rmse"]))

    def mended(
        self, model: Model, choice: Choice, error: float | None, seconds: float | None
    ) -> Choice:
        """Measure a choice, and where it does not hold the next one that the measurement tells."""
        tried: list[Choice] = []
        while len(tried) < _TRIES:
            count = int(choice.settings[model.candidate.knob])
            self.told(f"{choice.name}, {model.candidate.knob}={count}")
            point = self.measured(model.candidate, count)
            if point is None:
                break
            reached = point[2] <= error if error is not None else point[1] <= (seconds or 0.0)
            tried.append(replace(choice, seconds=point[1], error=point[2], reached=reached))
            model = model.mended(*point)
            following = model.count_for(
                None if error is None else _MARGIN * error,
                None if seconds is None else _MARGIN * seconds,
            )
            if reached or following is None or following == count:
                break
            choice = _choice(model, following)
        return _best_of(tried) if tried else choice


def _best_of(tried: Sequence[Choice]) -> Choice:
    return next((choice for choice in tried if choice.reached), tried[-1])


def options(settings: Mapping[str, Any]) -> str:
    """Settings as options of ``mbinterval render``: those that differ from the defaults."""
    defaults = Settings()
    given = {n: v for n, v in settings.items() if v != getattr(defaults, n) or n == "samples"}
    return " ".join(f"--{name.replace('_', '-')} {value}" for name, value in given.items())
