"""What a study varies: each sweep turns one knob, and all else stays as it was.

A sweep is a table of rows, settings by name. Rows that a scene does not allow, such as
triangulated paths with a lens, are told as such by the study.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from mbinterval.checks import nearest
from mbinterval.errors import UsageError
from mbinterval.settings import OCCLUSIONS

_EXACT = {"method": "analytic", "paths": "exact", "occlusion": "exact", "filter": "box"}
_PUBLISHED = {**_EXACT, "paths": "triangulated"}
_COUNTS = (1, 2, 4, 8, 16, 32, 64, 128, 256)


@dataclass(frozen=True)
class Sweep:
    """One knob.

    Attributes
    ----------
    title
        What is varied, for people.
    method
        Which methods the rows are of, as a series in a plot is named.
    knob
        Name of the setting that is varied.
    rows
        Settings of each row by its name.
    """

    title: str
    method: str
    knob: str
    rows: Mapping[str, Mapping[str, Any]]


def _sweep(
    title: str, method: str, base: Mapping[str, Any], knob: str, values: Iterable[Any]
) -> Sweep:
    rows = {f"{method}, {knob} {value}": {**base, knob: value} for value in values}
    return Sweep(title, method, knob, rows)


_MASKS = tuple(bits for bits in OCCLUSIONS if bits != "exact")

SWEEPS: dict[str, Sweep] = {
    "samples": _sweep("samples per pixel", "exact", _EXACT, "samples", _COUNTS),
    "samples-sobol": _sweep(
        "samples per pixel, scrambled in each pixel",
        "exact sobol",
        {**_EXACT, "pattern": "sobol"},
        "samples",
        _COUNTS[1:],
    ),
    "samples-published": _sweep(
        "samples per pixel, Hong & Oh 2017",
        "published",
        {**_PUBLISHED, "occlusion": 128},
        "samples",
        _COUNTS[:5],
    ),
    "five-point": Sweep(
        "one sample that neighbours share",
        "five-point",
        "filter",
        {"five-point": {**_EXACT, "samples": 1, "filter": "five_point"}},
    ),
    "occlusion": _sweep(
        "occlusion of exact paths",
        "exact masked",
        {**_EXACT, "samples": 1},
        "occlusion",
        (*_MASKS, "exact"),
    ),
    "occlusion-published": _sweep(
        "occlusion of triangulated paths",
        "published 1",
        {**_PUBLISHED, "samples": 1},
        "occlusion",
        (*_MASKS, "exact"),
    ),
    "texture": _sweep(
        "shading evaluations per visible span",
        "exact texture",
        {**_EXACT, "samples": 1},
        "texture_samples",
        (1, 2, 4, 8, 16, 32, 64),
    ),
    "segments": _sweep(
        "linear motion segments per shutter",
        "exact segments",
        {**_EXACT, "samples": 1},
        "motion_segments",
        (1, 2, 4, 8, 16),
    ),
    "limit": _sweep(
        "intervals kept per sample",
        "published limit",
        {**_PUBLISHED, "samples": 1, "occlusion": 128},
        "max_intervals",
        (10, 30, 90, 270),
    ),
}
"""All sweeps by name, in the order in which a study makes them."""


def chosen(names: Iterable[str] | None) -> dict[str, Sweep]:
    """Sweeps by ``names``; None is all. An unknown name raises with the nearest known one."""
    found = {}
    for name in SWEEPS if names is None else names:
        if name not in SWEEPS:
            raise UsageError(f"sweep {name!r}: unknown, {nearest(str(name), SWEEPS)}")
        found[name] = SWEEPS[name]
    if not found:
        raise UsageError(f"no sweep; known here: {', '.join(SWEEPS)}")
    return found
