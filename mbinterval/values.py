"""Checks of single values that the public API is given, with one wording.

Each returns the value as it is stored, or raises ``error`` with what was given and what is
expected. NumPy's numbers are as good as Python's; a bool is never a number.
"""

from __future__ import annotations

import difflib
import math
import numbers
import operator
import sys
from collections.abc import Iterable, Sequence
from typing import Any, TypeVar

from mbinterval.errors import MbintervalError, UsageError

T = TypeVar("T")
Error = type[MbintervalError]


def shown(value: object, most: int = 60) -> str:
    """``value`` as a message shows it: in one line, and no longer than ``most`` characters."""
    text = " ".join(repr(value).split())
    return text if len(text) <= most else text[: most - 3] + "..."


def refuse(value: object, what: str, expected: str, error: Error = UsageError) -> MbintervalError:
    """Make the error for a ``value`` of ``what`` that is not as ``expected``."""
    return error(f"{what}={shown(value)}: expected {expected}")


def whole_number(
    value: Any, what: str, low: int, high: int | None = None, error: Error = UsageError
) -> int:
    """Return a whole number from ``low`` to ``high``; 16.0 is none."""
    upto = "up" if high is None else f"to {high}"
    expected = f"a whole number from {low} {upto}"
    if isinstance(value, bool):
        raise refuse(value, what, expected, error)
    try:
        number = operator.index(value)
    except TypeError:
        raise refuse(value, what, expected, error) from None
    if number < low or (high is not None and number > high):
        raise refuse(value, what, expected, error)
    return number


def number(
    value: Any,
    what: str,
    low: float = -math.inf,
    high: float = math.inf,
    *,
    above: float = -math.inf,
    below: float = math.inf,
    error: Error = UsageError,
) -> float:
    """Return a finite number as a float: ``low`` and ``high`` are allowed, the others are not."""
    plain: Any = value.item() if getattr(value, "ndim", None) == 0 else value
    real = isinstance(plain, numbers.Real) and not isinstance(plain, bool)
    finite = real and abs(plain) <= sys.float_info.max  # integers have no end, floats do
    if finite and low <= plain <= high and above < plain < below:
        return float(plain)
    limits = [("from", low), ("above", above), ("up to", high), ("below", below)]
    parts = [f"{word} {limit:g}" for word, limit in limits if math.isfinite(limit)]
    expected = " ".join(["a number", " and ".join(parts)]) if parts else "a finite number"
    raise refuse(value, what, expected, error)


def choice(value: Any, choices: Sequence[T], what: str, error: Error = UsageError) -> T:
    """Return the one of ``choices``, words and whole numbers, that ``value`` is."""
    plain = value
    if not isinstance(value, str | bool):
        try:
            plain = operator.index(value)
        except TypeError:
            plain = None
    if isinstance(plain, bool) or plain not in choices:
        raise refuse(value, what, f"one of {', '.join(map(repr, choices))}", error)
    return choices[choices.index(plain)]


def instance(value: Any, kind: type[T], what: str, error: Error = UsageError) -> T:
    """Return ``value``, an instance of ``kind``."""
    if not isinstance(value, kind):
        raise refuse(value, what, _KINDS.get(kind, f"a {kind.__name__}"), error)
    return value


_KINDS: dict[type, str] = {bool: "True or False", str: "a text", tuple: "a list or tuple"}


def nearest(name: str, known: Iterable[str]) -> str:
    """Say which of the ``known`` names an unknown one may be meant for."""
    names = list(known)
    near = difflib.get_close_matches(name, names, n=1)
    return f"did you mean {near[0]}?" if near else f"known here: {', '.join(names)}"
