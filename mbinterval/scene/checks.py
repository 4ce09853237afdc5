"""Checks that scene records make of what they are given, with one wording."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbinterval.errors import SceneError

Vector = tuple[float, float, float]


def freeze(record: object, **values: Any) -> None:
    """Set fields of a frozen record; arrays become contiguous and read-only."""
    for name, value in values.items():
        if isinstance(value, np.ndarray):
            value = np.ascontiguousarray(value)
            if value.base is not None or value.flags.writeable:
                value = value.copy()
            value.flags.writeable = False
        object.__setattr__(record, name, value)


def numbers(value: ArrayLike, dtype: Any, what: str) -> NDArray[Any]:
    """Return ``value`` as an array, or say what it is not."""
    try:
        return np.asarray(value, dtype=dtype)
    except (TypeError, ValueError) as error:
        raise SceneError(f"{what}: not an array of numbers ({error})") from None


def vector(value: Any, what: str) -> Vector:
    """Return three finite numbers."""
    array = numbers(value, np.float64, what)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise SceneError(f"{what}={value!r}, expected three finite numbers")
    return (float(array[0]), float(array[1]), float(array[2]))


def check_choice(value: str, choices: tuple[str, ...], what: str) -> None:
    """Refuse what is not one of ``choices``."""
    if value not in choices:
        raise SceneError(f"{what}={value!r}, expected one of {', '.join(map(repr, choices))}")


def check_finite(array: NDArray[Any], what: str, unit: str) -> None:
    """Refuse NaN and infinity; the message names the first place."""
    if np.isfinite(array).all():
        return
    place = np.argwhere(~np.isfinite(array))[0]
    value = array[tuple(place)]
    if unit == "pixel":
        at = f"pixel (row {place[0]}, column {place[1]})"
    else:
        at = f"{unit} {place[-2]}" + (f" at time {place[0]}" if array.ndim == 3 else "")
    raise SceneError(f"{what}: {value} at {at}; every value must be finite")
