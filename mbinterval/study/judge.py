"""What rows are judged by, and their errors.

Errors are of two kinds and never mixed. ``rmse`` is the full pixel's: against a reference that
averages over pixel, shutter and lens. ``temporal`` is against the truth at the row's own places in
the pixel: what is left of it is due to time alone. No row is judged by a reference of its own
method, or of one that shares its kernels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.bench.cases import Case
from mbinterval.comparison import metrics
from mbinterval.errors import UsageError
from mbinterval.film.film import Film
from mbinterval.settings.settings import Settings
from mbinterval.study.reference import Reference, converged

ERRORS = ("rmse", "temporal", "relative_mse", "mae", "psnr", "ssim")
ERROR = 1e-4
_FINE = 0.02
"""Path error of references, in pixels: rows have a tenth unless it is their knob."""

Told = Callable[[str, int, float], None]


@dataclass(frozen=True, eq=False)
class Truth:
    """What rows are judged by: references of whole pixels, and of pixel centres.

    Of each kind the first is taken whose method is `independent` of the row's.
    """

    pixels: Sequence[Reference]
    centres: Sequence[Reference] = ()

    @property
    def listed(self) -> list[tuple[str, Reference]]:
        """All references, each with what it averages over."""
        return [("pixel", of) for of in self.pixels] + [("centre", of) for of in self.centres]

    def check_size(self, case: Case) -> None:
        """Raise ``UsageError`` for a reference of another size than the case."""
        for kind, of in self.listed:
            if of.image.shape != (case.height, case.width, 3):
                shape = f"{of.image.shape[1]} x {of.image.shape[0]}"
                size = f"{case.width} x {case.height}"
                raise UsageError(f"{kind} reference: {shape} pixels, but {case.name} is {size}")


def make_truth(
    case: Case,
    *,
    error: float = ERROR,
    folder: str | Path | None = None,
    device: Any = None,
    told: Told | None = None,
) -> Truth:
    """Make the references of a study: each method is judged by another one.

    Exact time is judged by 4,096 point samples in each of several renders, and at pixel centres by
    as many slices; point samples and slices are judged by exact time at scattered places.

    Parameters
    ----------
    error
        RMSE that references should have, above 0; they have more where that takes too many renders.
    told
        Told what is made, how many renders there are, and the error so far.
    """

    def made(what: str, settings: Settings, most: int) -> Reference:
        def progress(count: int, found: float) -> None:
            if told is not None:
                told(what, count, found)

        options: dict[str, Any] = {"folder": folder, "device": device, "progress": progress}
        return converged(case, settings, error, most=most, **options)

    fine: dict[str, Any] = {"motion_error": _FINE}
    points = Settings(method="stochastic", samples=4096, pattern="sobol", **fine)
    exact = Settings(samples=16, pattern="sobol", **fine)
    slices = Settings(method="accumulation", samples=1, slices=2048, slice_times="jittered", **fine)
    return Truth(
        pixels=[made("point samples", points, 12), made("exact time", exact, 12)],
        centres=[made("slices", slices, 6)],
    )


def errors(
    film: Film,
    values: Mapping[str, Any],
    truth: Truth,
    exact: Mapping[int, NDArray[Any]] | None = None,
) -> dict[str, float]:
    """Errors of a film by name; those that nothing can judge are left out.

    ``resolved`` is whether ``rmse`` is more than the reference's noise: else that the row is as
    good is all that is known. ``exact`` are the colours of films that are exact in time at
    the places of the fixed pattern, by their number: point samples and slices at these places are
    judged by them.
    """
    method = values.get("method", Settings().method)
    found: dict[str, float] = {}
    reference = _judge(truth.pixels, method)
    if reference is not None:
        found["rmse"] = reference.rmse_of(film.rgba)
        found["resolved"] = reference.resolves(film.rgba)
        colour = film.rgba[..., :3]
        for name in ERRORS[2:]:
            value = getattr(metrics, name)(colour, reference.image)
            if math.isfinite(value):
                found[name] = value
    temporal = _temporal(film, values, truth, exact or {})
    return found if temporal is None else {**found, "temporal": temporal}


def _temporal(
    film: Film, values: Mapping[str, Any], truth: Truth, exact: Mapping[int, NDArray[Any]]
) -> float | None:
    places = fixed_places(values)
    if places is None:
        return None
    method = values.get("method", Settings().method)
    if method != "analytic" and places in exact:
        return metrics.rmse(film.rgba[..., :3], exact[places][..., :3])
    centre = _judge(truth.centres, method)
    return centre.rmse_of(film.rgba) if centre is not None and places == 1 else None


def _judge(references: Sequence[Reference], method: str) -> Reference | None:
    return next((of for of in references if independent(of.method, method)), None)


def independent(one: str, other: str) -> bool:
    """Whether a method may judge another: slices and point samples share their kernels."""
    points = ("stochastic", "accumulation")
    return one != other and not (one in points and other in points)


def fixed_places(values: Mapping[str, Any]) -> int | None:
    """How many places of the fixed pattern a row samples in each pixel; None for other ones."""
    plain = Settings.from_mapping(values)
    if (plain.filter, plain.filter_radius, plain.frameless) != ("box", None, 1):
        return None
    default = "sobol" if plain.method == "stochastic" else "fixed"
    fixed = (plain.pattern or default) == "fixed" and plain.slice_times != "stochastic"
    return plain.samples if fixed else None


def is_exact(values: Mapping[str, Any]) -> bool:
    """Whether a row has no error in time, but for its motion segments'."""
    plain = Settings.from_mapping(values)
    kinds = (plain.method, plain.paths, plain.occlusion, plain.motion_segments)
    chosen = plain.motion_error == Settings().motion_error
    return kinds == ("analytic", "exact", "exact", None) and chosen


def exact_places(rows: Mapping[str, Mapping[str, Any]]) -> dict[str, int]:
    """Rows by name that can judge others in time, and how many fixed places each samples."""
    judges = {name: fixed_places(values) for name, values in rows.items() if is_exact(values)}
    return {name: places for name, places in judges.items() if places is not None}


def colour_of(film: Film) -> NDArray[np.float32]:
    """``(H, W, 3)``: the film's colour, without what else it holds."""
    return np.ascontiguousarray(film.rgba[..., :3])
