"""Checks that scene records make of what they are given, with one wording.

Each returns what is stored, or raises a ``SceneError`` that names the object and the field, shows
what was given, and says what is expected.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval import values
from mbinterval.errors import SceneError

Vector = tuple[float, float, float]

LARGEST = float(np.finfo(np.float32).max)
"""Largest number of a scene: kernels have colours, light and attributes in float32."""
UPTO = f"up to {LARGEST:.2g}, the largest that float32 holds"

whole_number = partial(values.whole_number, error=SceneError)
refuse = partial(values.refuse, error=SceneError)


def number(value: Any, what: str, *limits: float, **more: float) -> float:
    """Return a number within limits, as `mbinterval.values.number`, and within float32's."""
    found = values.number(value, what, *limits, **more, error=SceneError)
    if abs(found) > LARGEST:
        raise refuse(value, what, f"a number {UPTO}")
    return found


def choice(value: Any, choices: tuple[str, ...], what: str) -> str:
    """Return ``value``, one of ``choices``."""
    return values.choice(value, choices, what, SceneError)


def flag(value: Any, what: str) -> bool:
    """Return True or False."""
    return values.instance(value, bool, what, SceneError)


def text(value: Any, what: str) -> str:
    """Return a text."""
    return values.instance(value, str, what, SceneError)


def named(kind: str, name: Any) -> str:
    """Say which object is meant: its kind, and its name if it has one."""
    return f"{kind} {name!r}" if text(name, f"{kind}: name") else kind


def check_kind(value: Any, kind: type, what: str, remedy: str = "") -> None:
    """Refuse what is not of ``kind``, with the ``remedy``."""
    if not isinstance(value, kind):
        raise refuse(value, what, f"a {kind.__name__}{remedy}")


def freeze(record: object, **values: Any) -> None:
    """Set fields of a frozen record; arrays become contiguous and read-only."""
    for name, value in values.items():
        if isinstance(value, np.ndarray):
            value = np.ascontiguousarray(value)
            if value.base is not None or value.flags.writeable:
                value = value.copy()
            value.flags.writeable = False
        object.__setattr__(record, name, value)


def numbers(value: Any, dtype: Any, what: str) -> NDArray[Any]:
    """Return ``value`` as an array of ``dtype``."""
    if isinstance(value, str | Path):
        raise refuse(value, what, "an array of numbers")
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        raise refuse(value, what, "an array of numbers, every row as long as the others") from None
    if array.dtype.kind not in "iuf":
        raise refuse(value, what, "an array of numbers")
    with np.errstate(over="ignore"):  # what becomes infinite is reported as such
        return array.astype(dtype, copy=False)


def image(value: Any, what: str) -> NDArray[Any]:
    """Return the pixels of an image, ``(h, w, 3)`` or ``(h, w, 4)``."""
    if isinstance(value, str | Path):
        raise refuse(value, what, f"pixels; mbinterval.read_image({str(value)!r}) reads the file")
    if getattr(value, "dtype", None) in (np.uint8, np.uint16):
        raise SceneError(
            f"{what} holds {value.dtype}, expected scene-linear numbers; mbinterval.read_image "
            "makes them of an image file"
        )
    pixels = numbers(value, np.float32, what)
    if pixels.ndim != 3 or pixels.shape[2] not in (3, 4) or 0 in pixels.shape:
        raise SceneError(f"{what} has shape {pixels.shape}, expected (h, w, 3) or (h, w, 4)")
    check_finite(pixels, what, "pixel", value)
    return pixels


def vector(value: Any, what: str) -> Vector:
    """Return three finite numbers."""
    x, y, z = row(value, 3, what, "three finite numbers")
    return x, y, z


def product(factors: Mapping[str, Any], what: str) -> None:
    """Refuse factors, by their names, whose product float32 can't hold."""
    most = {name: float(np.abs(value).max(initial=0.0)) for name, value in factors.items()}
    if math.prod(most.values()) > LARGEST:
        given = " and ".join(f"{name}, up to {value:g}," for name, value in most.items())
        raise SceneError(f"{what}: {given} have a product beyond what float32 holds; lower them")


def row(value: Any, count: int, what: str, expected: str) -> tuple[float, ...]:
    """Return as many finite numbers as ``count`` says; ``expected`` says it in words."""
    try:
        array = numbers(value, np.float64, what)
    except SceneError:
        array = np.zeros(0)
    if array.shape != (count,) or not np.isfinite(array).all():
        raise refuse(value, what, expected)
    if np.abs(array).max() > LARGEST:
        raise refuse(value, what, f"{expected}, {UPTO}")
    return tuple(array.tolist())


def check_finite(array: NDArray[Any], what: str, unit: str, given: Any = None) -> None:
    """Refuse NaN, infinity and what float32 can't hold; the message names the first place.

    ``given`` is what ``array`` was made of, with the values that are shown.
    """
    if not array.size or (array.max() <= LARGEST and array.min() >= -LARGEST):  # false for NaN
        return
    place = np.argwhere(~(np.abs(array) <= LARGEST))[0]
    value = (array if given is None else np.asarray(given))[tuple(place)]
    if unit == "pixel":
        at = f"pixel (row {place[0]}, column {place[1]})"
    else:
        at = f"{unit} {place[-2]}" + (f" at time {place[0]}" if array.ndim == 3 else "")
    wanted = f"be {UPTO}" if np.isfinite(value) else "be finite"
    raise SceneError(f"{what}: {value} at {at}; every value must {wanted}")


def items(value: Any, kind: type, what: str) -> tuple[Any, ...]:
    """Return a sequence of ``kind`` as a tuple."""
    name = kind.__name__
    try:
        found = tuple(value)
    except TypeError:
        hint = "put it into a list" if isinstance(value, kind) else f"expected a list of {name}"
        raise SceneError(f"{what} is {type(value).__name__}; {hint}") from None
    for index, item in enumerate(found):
        if not isinstance(item, kind):
            raise SceneError(f"{what}[{index}] is {type(item).__name__}, expected {name}")
    return found
