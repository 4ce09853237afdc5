"""The JSON of a glTF file against the records of pygltflib, before it makes these of it.

pygltflib converts what it can and fails somewhere on the rest; here the first value that is not
what glTF 2.0 says is named with its place in the file.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from types import NoneType
from typing import Any, get_args, get_origin, get_type_hints

from mbinterval.errors import SceneError
from mbinterval.values import shown

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
"""Types of an accessor's components, as NumPy has them."""

SHAPES = {
    "SCALAR": (1, 1),
    "VEC2": (1, 2),
    "VEC3": (1, 3),
    "VEC4": (1, 4),
    "MAT2": (2, 2),
    "MAT3": (3, 3),
    "MAT4": (4, 4),
}
"""Columns and rows of an accessor's elements."""

_CHOICES: dict[str, tuple[Any, ...]] = {
    "Accessor.type": tuple(SHAPES),
    "Accessor.componentType": tuple(COMPONENTS),
    "AccessorSparseIndices.componentType": (5121, 5123, 5125),
    "AnimationSampler.interpolation": ("LINEAR", "STEP", "CUBICSPLINE"),
    "Material.alphaMode": ("OPAQUE", "MASK", "BLEND"),
    "Camera.type": ("perspective", "orthographic"),
    "Primitive.mode": tuple(range(7)),
}
_LENGTHS = {"translation": 3, "rotation": 4, "scale": 3, "matrix": 16, "baseColorFactor": 4}
_OPTIONAL = {"Image", "GLTF2.scene"}  # the records say that these are required
_REQUIRED = {"Primitive.attributes"}  # and that this one is not
_LARGEST = 2**32 - 1

_INDEX, _NUMBER, _TEXT, _VECTOR = int, float, str, list[float]
_EXTENSIONS: dict[str, dict[str, Any]] = {
    "KHR_lights_punctual": {"light": _INDEX, "lights": list[dict[str, Any]]},
    "KHR_texture_transform": {
        "offset": _VECTOR,
        "scale": _VECTOR,
        "rotation": _NUMBER,
        "texCoord": _INDEX,
    },
}
_LIGHT = {"type": _TEXT, "name": _TEXT, "color": _VECTOR, "intensity": _NUMBER, "range": _NUMBER}

Problem = tuple[str, str]
"""Place in the file, and what is wrong there."""


def check_document(document: Any) -> None:
    """Raise ``SceneError`` for the first value that is not what glTF 2.0 has in its place."""
    from pygltflib import GLTF2

    for place, text in _record(document, GLTF2, ""):
        raise SceneError(f"{place.lstrip('.')}{place and ': '}{text}; the file is damaged")


def _record(value: Any, record: Any, place: str) -> Iterator[Problem]:
    """Problems of an object that is to become a ``record``."""
    if not isinstance(value, dict):
        yield place, _expected("an object", value)
        return
    for name, (hint, needed) in _fields(record).items():
        if value.get(name) is not None:
            yield from _value(value[name], hint, f"{place}.{name}", f"{record.__name__}.{name}")
        elif needed:
            yield f"{place}.{name}", "is missing"
    yield from _extensions(value.get("extensions"), f"{place}.extensions")


@cache
def _fields(record: Any) -> Mapping[str, tuple[Any, bool]]:
    """Type of each field of a ``record``, and whether it has to be there."""
    found = {}
    for field in dataclasses.fields(record):
        hint, optional = get_type_hints(record)[field.name], False
        if NoneType in get_args(hint):
            hint, optional = get_args(hint)[0], True
        names = {record.__name__, f"{record.__name__}.{field.name}"}
        if field.name not in ("extensions", "extras"):
            needed = field.default is None and not optional and not names & _OPTIONAL
            found[field.name] = hint, needed or bool(names & _REQUIRED)
    return found


def _value(value: Any, hint: Any, place: str, name: str) -> Iterator[Problem]:
    """Problems of a value of type ``hint``; ``name`` is that of its record and field."""
    if get_origin(hint) is list:
        yield from _list(value, get_args(hint)[0], place, name)
    elif getattr(hint, "__name__", "") == "Attributes":
        if not isinstance(value, dict):
            yield place, _expected("an object", value)
            return
        for key, item in value.items():
            if key not in ("extensions", "extras"):
                yield from _value(item, int, f"{place}.{key}", "")
    elif dataclasses.is_dataclass(hint):
        yield from _record(value, hint, place)
    elif name in _CHOICES and value not in _CHOICES[name]:
        yield place, _expected(", ".join(map(str, _CHOICES[name])), value)
    elif hint is int and not _is_index(value):
        yield place, _expected("a whole number from 0 up", value)
    elif hint is float and not _is_number(value):
        yield place, _expected("a finite number", value)
    elif hint in (str, bool) and not isinstance(value, hint):
        yield place, _expected("a string" if hint is str else "true or false", value)


def _list(value: Any, hint: Any, place: str, name: str) -> Iterator[Problem]:
    length = _LENGTHS.get(name.rpartition(".")[2])
    if not isinstance(value, list) or (length and value and len(value) != length):
        yield place, _expected(f"a list of {length} numbers" if length else "a list", value)
        return
    for index, item in enumerate(value):
        yield from _value(item, hint, f"{place}[{index}]", "")


def _extensions(extensions: Any, place: str) -> Iterator[Problem]:
    """Problems of the extensions that are read."""
    if extensions is None:
        return
    if not isinstance(extensions, dict):
        yield place, _expected("an object", extensions)
        return
    for name, value in extensions.items():
        if not isinstance(value, dict):
            yield f"{place}.{name}", _expected("an object", value)
            continue
        yield from _known(value, _EXTENSIONS.get(name, {}), f"{place}.{name}")
        lights = value.get("lights") if name == "KHR_lights_punctual" else None
        for index, light in enumerate(lights if isinstance(lights, list) else ()):
            at = f"{place}.{name}.lights[{index}]"
            if isinstance(light, dict):
                yield from _known(light, _LIGHT, at)
                if light.get("type") is None:
                    yield f"{at}.type", "is missing"
            else:
                yield at, _expected("an object", light)


def _known(value: Mapping[str, Any], known: Mapping[str, Any], place: str) -> Iterator[Problem]:
    for name, hint in known.items():
        if value.get(name) is not None:
            yield from _value(value[name], hint, f"{place}.{name}", "")


def _is_index(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= _LARGEST


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) <= sys.float_info.max if isinstance(value, int) else math.isfinite(value)


def _expected(what: str, value: Any) -> str:
    return f"expected {what}, got {shown(value)}"
