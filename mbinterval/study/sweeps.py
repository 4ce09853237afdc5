"""What a study varies: each sweep turns one knob, and all else stays as it was.

A sweep is a table of rows, settings by name. Rows that a scene does not allow, such as
triangulated paths with a lens, are told as such by the study.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from mbinterval.errors import UsageError
from mbinterval.settings.rules import CULLS, OCCLUSIONS
from mbinterval.values import nearest

_ANY = {"filter": "box", "transparent": False}
EXACT = {**_ANY, "method": "analytic", "paths": "exact", "occlusion": "exact"}
PUBLISHED = {**EXACT, "paths": "triangulated", "occlusion": 128}
STOCHASTIC = {**_ANY, "method": "stochastic"}
ACCUMULATION = {**_ANY, "method": "accumulation"}

_COUNTS = (1, 2, 4, 8, 16, 32, 64, 128, 256)
_FEWER = (4, 16, 64, 256, 1024)
_SLICES = (16, 32, 64, 128, 256, 512, 1024)


@dataclass(frozen=True)
class Sweep:
    """One knob.

    Attributes
    ----------
    title
        What is varied, for people.
    series
        What the rows are called together, in a plot.
    knob
        Name of the setting that is varied.
    rows
        Settings of each row by its name.
    alike
        Whether all rows give one image and differ in time only.
    """

    title: str
    series: str
    knob: str
    rows: Mapping[str, Mapping[str, Any]]
    alike: bool = False

    @property
    def counts(self) -> bool:
        """Whether it trades time for error, by a count of samples or slices or their filter."""
        return self.knob in ("samples", "slices", "filter") and not self.alike


def _sweep(
    title: str,
    series: str,
    base: Mapping[str, Any],
    knob: str,
    values: Iterable[Any],
    alike: bool = False,
) -> Sweep:
    rows = {f"{series}, {knob} {str(value).lower()}": {**base, knob: value} for value in values}
    return Sweep(title, series, knob, rows, alike)


_MASKS = tuple(bits for bits in OCCLUSIONS if bits != "exact")
_ONE = {**EXACT, "samples": 1}
_PATTERNS = {
    "jittered": _FEWER,
    "random": _FEWER,
    "fixed": _FEWER,
    "interleave_uvt": _FEWER,
    "rgss": (4,),
}


def _analytic() -> dict[str, Sweep]:
    scrambled = {**EXACT, "pattern": "sobol"}
    one_published = {**PUBLISHED, "samples": 1}
    shared = {"five-point": {**_ONE, "filter": "five_point"}}
    title = "samples per pixel, exact in time"
    return {
        "samples": _sweep(title, "exact", EXACT, "samples", _COUNTS),
        "samples-sobol": _sweep(
            f"{title}, scrambled in each pixel", "exact sobol", scrambled, "samples", _COUNTS[1:]
        ),
        "five-point": Sweep("one sample that neighbours share", "five-point", "filter", shared),
        "samples-published": _sweep(
            "samples per pixel, Hong & Oh 2017", "published", PUBLISHED, "samples", _COUNTS[:5]
        ),
        "occlusion": _sweep(
            "occlusion of exact paths", "exact masked", _ONE, "occlusion", OCCLUSIONS[::-1]
        ),
        "occlusion-partial": _sweep(
            "masks whose bits may be seen in part",
            "exact masked in part",
            {**_ONE, "partial_bits": True},
            "occlusion",
            _MASKS,
        ),
        "occlusion-published": _sweep(
            "occlusion of triangulated paths",
            "published 1",
            one_published,
            "occlusion",
            OCCLUSIONS[::-1],
        ),
        "pairing": _sweep(
            "pairing of fragments", "published paired", one_published, "pairing", ("time", "depth")
        ),
        "limit": _sweep(
            "intervals kept per sample",
            "published limit",
            one_published,
            "max_intervals",
            (10, 30, 90, 270),
        ),
        "texture": _sweep(
            "shading evaluations per visible span",
            "exact texture",
            _ONE,
            "texture_samples",
            (1, 2, 4, 8, 16, 32, 64),
        ),
        "shading": _sweep(
            "error of colour along a visible span that is aimed at",
            "exact shading",
            _ONE,
            "shading_error",
            (0.03, 0.01, 0.003, 0.001, 0.0003),
        ),
        "anisotropy": _sweep(
            "most texture look-ups over a sample's footprint",
            "exact anisotropy",
            _ONE,
            "anisotropy",
            (0, 1, 2, 4, 8, 16),
        ),
        "segments": _sweep(
            "linear motion segments per shutter",
            "exact segments",
            _ONE,
            "motion_segments",
            (1, 2, 4, 8, 16),
        ),
        "motion-error": _sweep(
            "greatest path error of chosen motion segments, pixels",
            "exact motion error",
            _ONE,
            "motion_error",
            (1.0, 0.3, 0.1, 0.03, 0.01),
        ),
    }


def _stochastic() -> dict[str, Sweep]:
    sobol = {**STOCHASTIC, "pattern": "sobol"}
    many = {**sobol, "samples": 64}
    title = "samples in time, place and lens"
    found = {
        "stochastic-sobol": _sweep(
            f"{title}, sobol", "stochastic sobol", sobol, "samples", (*_COUNTS, 1024, 4096)
        )
    }
    for pattern, counts in _PATTERNS.items():
        base = {**STOCHASTIC, "pattern": pattern}
        found[f"stochastic-{pattern}"] = _sweep(
            f"{title}, {pattern}", f"stochastic {pattern}", base, "samples", counts
        )
    choices: tuple[tuple[str, tuple[Any, ...]], ...] = (
        ("test", ("vertices", "edges")),
        ("shading_rate", ("sample", "pixel")),
        ("hybrid", (False, True)),
        ("frameless", (1, 2, 4, 8, 16)),
    )
    for knob, values in choices:
        found[knob.replace("_", "-")] = _sweep(
            f"{knob.replace('_', ' ')} of 64 samples", f"stochastic {knob}", many, knob, values
        )
    for cull in CULLS:
        base = {**sobol, "cull": cull}
        if cull == "interleave_uvt":
            base["pattern"] = cull
        found[f"cull-{cull.replace('_', '-')}"] = _sweep(
            f"culling {cull}", f"cull {cull}", base, "samples", _FEWER[:4], True
        )
    return found


def _accumulation() -> dict[str, Sweep]:
    one = {**ACCUMULATION, "samples": 1}
    few = {**ACCUMULATION, "samples": 4}
    scattered = {**one, "slice_times": "stochastic", "pattern": "sobol"}
    return {
        "slices": _sweep("slices at pixel centres", "slices", one, "slices", _SLICES),
        "slices-jittered": _sweep(
            "slices at random times",
            "slices jittered",
            {**one, "slice_times": "jittered"},
            "slices",
            _SLICES,
        ),
        "slices-4": _sweep(
            "slices of 4 samples", "slices of 4", few, "slices", (4, 8, *_SLICES[:5])
        ),
        "slices-lines": _sweep(
            "slices of 4 samples, along lines across the lens",
            "slices of lines",
            {**few, "slice_lens": "line"},
            "slices",
            (4, 8, *_SLICES[:5]),
        ),
        "slices-stochastic": _sweep(
            "slices that are sampled over their parts of the shutter",
            "slices stochastic",
            scattered,
            "slices",
            _SLICES,
        ),
        "slice-samples": _sweep(
            "samples of each of 64 slices",
            "64 slices",
            {**ACCUMULATION, "slices": 64},
            "samples",
            (1, 2, 4, 8, 16),
        ),
    }


SWEEPS: dict[str, Sweep] = {**_analytic(), **_stochastic(), **_accumulation()}
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


def weight(values: Mapping[str, Any]) -> float:
    """Work of a row, roughly: for the time that is left. Rows of many samples end early."""
    samples = float(values.get("samples", 4))
    if values["method"] != "analytic":
        samples *= float(values.get("slices", 1)) / 128.0
    return 1.0 + min(samples, 16.0)
