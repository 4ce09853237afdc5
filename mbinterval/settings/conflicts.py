"""Settings that are each in order, but not together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mbinterval.film.aovs import RECORDED
from mbinterval.settings.rules import PATTERNS


@dataclass(frozen=True)
class Conflict:
    """Settings, by ``names``, that are each in order but not together; ``text`` says why."""

    names: tuple[str, str]
    text: str


def find_conflicts(
    given: Mapping[str, Any], owners: Mapping[str, tuple[str, ...]]
) -> list[Conflict]:
    """Find those of the settings ``given``, which are all, that don't go together.

    ``owners`` are the methods of each one that is not as it is by default.
    """
    found = [*_conflicts_of_methods(given, owners), *_conflicts_of_samples(given)]
    if given["paths"] == "triangulated" and given["pattern"] == "sobol":
        why = "triangulated paths are rasterized in rows of samples; use pattern='fixed'"
        found.append(("pattern", "paths", why))
    if given["paths"] == "exact" and given["max_intervals"] is not None:
        why = "exact paths lose no interval; max_intervals is for paths='triangulated'"
        found.append(("max_intervals", "paths", why))
    if given["partial_bits"] is True and given["occlusion"] == "exact":
        why = "exact occlusion has no bits; give occlusion a number of bits, 32 to 1024"
        found.append(("partial_bits", "occlusion", why))
    if given["paths"] == "triangulated" and "operations" in (given["aovs"] or ()):
        found.append(("aovs", "paths", "operations are counted for paths='exact'"))
    if given["occlusion"] != "exact" and "sharp" in (given["aovs"] or ()):
        found.append(("aovs", "occlusion", "a mask does not tell what is seen at a moment"))
    found += _conflicts_of_spans(given)
    if given["filter"] == "five_point":
        why = "it is a rule for samples=1 with pattern='fixed'; use filter='box' with more"
        if given["samples"] != 1:
            found.append(("filter", "samples", why))
        if given["pattern"] not in (None, "fixed"):
            found.append(("filter", "pattern", why))
        if given["filter_radius"] is not None:
            found.append(("filter_radius", "filter", "the five-point rule has none"))
    return [Conflict((a, b), f"{a}={given[a]!r} with {b}={given[b]!r}: {c}") for a, b, c in found]


def _conflicts_of_spans(given: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Find settings with which what is made from visible spans can't be had."""
    names = given["aovs"] or ()
    names = names.replace(" ", "").split(",") if isinstance(names, str) else names
    asked = {name for name in RECORDED if name in names}
    found = []
    if asked and given["filter"] == "five_point":
        why = "samples are shared by pixels, spans are not; use filter='box'"
        found.append(("aovs", "filter", why))
    if asked - {"events"} and given["filter"] == "mitchell":
        why = "coverage below 0 has no place in a Cryptomatte or a deep image; use another filter"
        found.append(("aovs", "filter", why))
    if "events" in asked and given["paths"] != "exact":
        found.append(("aovs", "paths", "events are exact in time; use paths='exact'"))
    if "events" in asked and given["occlusion"] != "exact":
        found.append(("aovs", "occlusion", "a mask does not tell when something is seen"))
    return found


def _conflicts_of_methods(
    given: Mapping[str, Any], owners: Mapping[str, tuple[str, ...]]
) -> list[tuple[str, str, str]]:
    """Find settings that the method does not have: two names, and why."""
    method = given["method"]
    found = [
        (name, "method", f"it is for method={' or '.join(map(repr, methods))}")
        for name, methods in owners.items()
        if method not in methods
    ]
    patterns = PATTERNS[method]
    if given["pattern"] is not None and given["pattern"] not in patterns:
        found.append(("pattern", "method", f"that has {', '.join(map(repr, patterns))}"))
    if method != "stochastic" and given["samples"] > 256:
        found.append(("samples", "method", "that has 1 to 256"))
    return found


def _conflicts_of_samples(given: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Likewise for settings of point sampling."""
    if given["method"] == "analytic":
        return []
    found = []
    if given["filter"] == "five_point":
        found.append(("filter", "method", "it is for method='analytic'; use filter='box'"))
    if given["pattern"] == "rgss" and given["samples"] != 4:
        found.append(("samples", "pattern", "the rotated grid has 4"))
    if given["pattern"] == "rgss" and given["filter"] != "box":
        found.append(("filter", "pattern", "the rotated grid has a filter of its own"))
    if given["pattern"] == "rgss" and given["filter_radius"] is not None:
        found.append(("filter_radius", "pattern", "the rotated grid has a filter of its own"))
    if given["cull"] == "interleave_uvt" and given["pattern"] != "interleave_uvt":
        found.append(("cull", "pattern", "it is for pattern='interleave_uvt'"))
    if given["cull_tile"] != 1 and given["cull"] == "best":
        found.append(("cull_tile", "cull", "that has tiles of its own"))
    if given["hybrid"] is True and given["shading_rate"] == "pixel":
        found.append(("hybrid", "shading_rate", "nothing is left to it"))
    if given["method"] == "accumulation":
        found += _conflicts_of_slices(given)
    return found


def _conflicts_of_slices(given: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    found = []
    if given["slice_times"] != "stochastic" and given["pattern"] not in (None, "fixed"):
        why = "slices at rest have the same samples in every pixel; use slice_times='stochastic'"
        found.append(("pattern", "slice_times", why))
    if given["slices"] * given["samples"] > 65536:
        found.append(("slices", "samples", "at most 65536 samples per pixel together"))
    return found
