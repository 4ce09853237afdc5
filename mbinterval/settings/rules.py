"""What is known of each setting beside its default: range, methods, help; kept in its field."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from mbinterval.values import choice, instance, number, whole_number

METHODS = ("analytic", "stochastic", "accumulation")
ANALYTIC = ("analytic",)
SAMPLED = ("stochastic", "accumulation")

OCCLUSIONS = ("exact", 32, 64, 128, 256, 512, 1024)
"""Ways to decide visibility: exactly, or by a mask of so many bits."""

CULLS = (
    *("best", "bbox", "hull", "obb", "pixar", "interleave_uvt", "dual_space", "clip_space"),
    *("clip_space_printed", "trim", "zmax", "zmax_strata", "zmin", "zmin_strata"),
)
"""Ways to leave out point samples that a path cannot cover."""

PATTERNS: dict[str, tuple[str, ...]] = {
    "analytic": ("fixed", "sobol"),
    "stochastic": ("sobol", "jittered", "random", "fixed", "rgss", "interleave_uvt"),
    "accumulation": ("fixed", "sobol", "jittered", "random"),
}
"""Sampling patterns of each method."""

_RULE = "rule"

Check = Callable[[Any, str], Any]


@dataclass(frozen=True)
class Rule:
    """What a setting may be, and where it counts.

    Attributes
    ----------
    help
        What the command line says of it.
    check
        Takes a value and the setting's name; returns what is stored, or raises `UsageError`.
    methods
        The methods that have it.
    speed_only
        Whether it changes speed and counts, and never the image.
    of_aovs
        If not empty: it says something about these ``aovs`` only.
    """

    help: str
    check: Check
    methods: tuple[str, ...] = METHODS
    speed_only: bool = False
    of_aovs: tuple[str, ...] = ()


def setting(default: Any, help: str, check: Check, **known: Any) -> Any:
    """Make the field of a setting; ``known`` are further fields of its `Rule`."""
    return field(default=default, metadata={_RULE: Rule(help, check, **known)})


def rule_of(setting: Any) -> Rule:
    """Return the rule of a dataclass field that `setting` made."""
    rule: Rule = setting.metadata[_RULE]
    return rule


def one_of(*choices: str | int) -> Check:
    """Check for one of some words and numbers."""
    return lambda value, name: choice(value, choices, name)


def whole(low: int, high: int) -> Check:
    """Check for a whole number from ``low`` to ``high``."""
    return lambda value, name: whole_number(value, name, low, high)


def real(low: float = -math.inf, high: float = math.inf, above: float = -math.inf) -> Check:
    """Check for a number from ``low``, or from above ``above``, to ``high``."""
    return lambda value, name: number(value, name, low, high, above=above)


def or_none(check: Check) -> Check:
    """Check for None, or for what ``check`` takes."""
    return lambda value, name: None if value is None else check(value, name)


def switch(value: Any, name: str) -> bool:
    """Check for True or False."""
    return instance(value, bool, name)


def words(choices: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """Return the words of several lists, each once."""
    return tuple(dict.fromkeys(word for some in choices for word in some))
