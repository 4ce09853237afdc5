"""Which settings reach an error, or make the best of a time, on a scene: by small probes.

Each method is rendered with few samples. From these its error is taken for a power law of the
count, and its seconds for a straight line. What is predicted to be the best is then measured, and
the prediction of its method mended, until nothing better than what was measured is predicted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mbinterval.bench.bench import Brevity, measure
from mbinterval.bench.cases import Case
from mbinterval.bench.meter import MeteredRuntime
from mbinterval.device.choose import choose_device
from mbinterval.errors import UsageError
from mbinterval.settings.settings import Settings
from mbinterval.study.judge import Truth, errors
from mbinterval.study.reference import converged
from mbinterval.study.summary import slope
from mbinterval.study.sweeps import ACCUMULATION, EXACT, PUBLISHED, STOCHASTIC
from mbinterval.values import number

_FLATTEST, _STEEPEST = -0.1, -1.5
_TRIES = 8
_MARGIN = 0.97
"""What is aimed at, as a part of what was asked for."""


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
    later
        Count and error of later measurements, as they came.
    slower
        What seconds are multiplied by, since the last of these said so.
    """

    candidate: Candidate
    points: tuple[tuple[int, float, float], ...]
    later: tuple[tuple[int, float], ...] = ()
    slower: float = 1.0

    def error(self, count: float) -> float:
        """Predicted RMSE: a power law through the last measurement, or the nearest probe."""
        probes = [(at, error) for at, _seconds, error in self.points]
        nearest = min(probes, key=lambda probe: abs(math.log(probe[0] / count)))
        at, error = self.later[-1] if self.later else nearest
        return float(error * (count / at) ** self.exponent)

    @property
    def exponent(self) -> float:
        """Of the power law, from two measurements or the largest probes; 0 where it is flat."""
        probes = [(count, error) for count, _, error in self.points]
        last = (self.later if len(self.later) > 1 else probes)[-2:]
        kept = [point for point in last if point[1] > 0.0]
        if len(kept) < 2:
            return 0.0
        found = slope(kept)
        return max(found, _STEEPEST) if found < _FLATTEST else 0.0

    def seconds(self, count: float) -> float:
        """Predicted seconds: a line through the probes beside the count.

        Below the first one they fall no faster than the count.
        """
        counts, taken = zip(*((c, s) for c, s, _ in self.points), strict=True)
        if len(counts) == 1:
            return float(self.slower * taken[0])
        high = min(max(int(np.searchsorted(counts, count)), 1), len(counts) - 1)
        rise = (taken[high] - taken[high - 1]) / (counts[high] - counts[high - 1])
        line = taken[high] + max(rise, 0.0) * (count - counts[high])
        return float(self.slower * max(line, taken[0] * min(count / counts[0], 1.0)))

    def count_for(self, error: float | None, seconds: float | None) -> int | None:
        """Least count that reaches ``error``, or the largest within ``seconds``; None without."""
        counts = _counts(self.candidate.most)
        if error is not None:
            return next((count for count in counts if self.error(count) <= error), None)
        limit = seconds or 0.0
        return next((count for count in counts[::-1] if self.seconds(count) <= limit), None)

    def mended(self, count: int, seconds: float, error: float) -> Model:
        """Return the model with one more measurement."""
        slower = self.slower * seconds / self.seconds(count)
        return replace(self, later=(*self.later, (count, error)), slower=slower)


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
    The best first, measured; then what other methods would take, best predicted first, by what was
    measured of them on the way. Empty where no method is predicted to reach it.

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
    goal = _Goal(target, of_time=error is None)
    return run.search({model.candidate.name: model for model in models}, goal)


@dataclass(frozen=True)
class _Goal:
    """An error to reach in the least time, or with ``of_time`` the other way round."""

    limit: float
    of_time: bool

    def count_for(self, model: Model) -> int | None:
        aim = _MARGIN * self.limit
        return model.count_for(*((None, aim) if self.of_time else (aim, None)))

    def reached(self, seconds: float, error: float) -> bool:
        return (seconds if self.of_time else error) <= self.limit

    def price(self, seconds: float, error: float) -> float:
        """What is to be least."""
        return error if self.of_time else seconds

    def measured_price(self, choice: Choice) -> float:
        return self.price(choice.seconds or 0.0, choice.error or 0.0)


def _ranked(models: Iterable[Model], goal: _Goal) -> list[Choice]:
    """Choices that are predicted to reach the goal, best first."""
    counts = [(model, goal.count_for(model)) for model in models]
    found = [_choice(model, count) for model, count in counts if count is not None]
    return sorted(found, key=lambda one: goal.price(one.predicted_seconds, one.predicted_error))


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

    def search(self, models: dict[str, Model], goal: _Goal) -> list[Choice]:
        """Measure what is predicted to be best until nothing better is predicted."""
        tried: dict[tuple[str, int], Choice] = {}
        while len(tried) < _TRIES:
            ranked = _ranked(models.values(), goal)
            reached = [choice for choice in tried.values() if choice.reached]
            best = min(reached, key=goal.measured_price, default=None)
            if not ranked or (best is not None and not _better(ranked[0], best, goal)):
                break
            choice, model = ranked[0], models[ranked[0].name]
            count = int(choice.settings[model.candidate.knob])
            if (choice.name, count) in tried:
                break
            self.told(f"{choice.name}, {model.candidate.knob}={count}")
            point = self.measured(model.candidate, count)
            if point is None:
                del models[choice.name]
                continue
            held = goal.reached(*point[1:])
            tried[choice.name, count] = replace(
                choice, seconds=point[1], error=point[2], reached=held
            )
            models[choice.name] = model.mended(*point)
        return self._found(list(tried.values()), _ranked(models.values(), goal), goal)

    def _found(
        self, tried: Sequence[Choice], ranked: Sequence[Choice], goal: _Goal
    ) -> list[Choice]:
        reached = sorted((one for one in tried if one.reached), key=goal.measured_price)
        best = reached[0] if reached else (tried[-1] if tried else None)
        if best is None:
            return list(ranked)
        return [best, *(choice for choice in ranked if choice.name != best.name)]


def _better(predicted: Choice, best: Choice, goal: _Goal) -> bool:
    """Whether a prediction promises more than what was measured, and is of another method."""
    price = goal.price(predicted.predicted_seconds, predicted.predicted_error)
    return predicted.name != best.name and price < goal.measured_price(best)


def options(settings: Mapping[str, Any]) -> str:
    """Settings as options of ``mbinterval render``: those that differ from the defaults."""
    defaults = Settings()
    given = {n: v for n, v in settings.items() if v != getattr(defaults, n) or n == "samples"}
    return " ".join(f"--{name.replace('_', '-')} {value}" for name, value in given.items())
