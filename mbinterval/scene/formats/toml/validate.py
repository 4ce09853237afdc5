"""Every error of a scene file at once, each with its path in the file and a remedy."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, get_args

from pydantic import ValidationError

from mbinterval.errors import SceneError, UsageError
from mbinterval.scene.asset import GLTF_SUFFIXES, USD_SUFFIXES
from mbinterval.scene.formats.toml.schema import SceneTable, Table
from mbinterval.settings.settings import SETTINGS, check_setting
from mbinterval.settings.settings import conflicts as settings_conflicts
from mbinterval.values import nearest, shown

Problem = tuple[str, str]
"""Path in the file, and what is wrong there."""

_TYPES = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "a string in quotes",
    "bool_type": "true or false",
    "list_type": "a list",
    "dict_type": "a table",
    "model_type": "a table",
    "finite_number": "a finite number",
}

_PRIMITIVE_FIELDS = {
    "plane": {"size": 2},
    "box": {"size": 3},
    "sphere": {"radius": 0, "segments": 0},
    "cylinder": {"radius": 0, "height": 0, "segments": 0},
}


def validate(data: Any, base: Path, file: str, overruled: Collection[str] = ()) -> SceneTable:
    """Check a parsed scene file; relative paths are relative to ``base``.

    Each setting is checked by itself, and all of them together but for those that are
    ``overruled``: what these go with is not the file's to say.

    Raises ``SceneError`` with one line per error; ``file`` names the scene file in it.
    """
    if not isinstance(data, Mapping):
        raise SceneError(f"{file}: expected a table of fields, got {type(data).__name__}")
    problems: list[Problem] = []
    table = None
    try:
        table = SceneTable.model_validate(data, context={"base": base})
    except ValidationError as error:
        problems += [_translate(item) for item in error.errors(include_url=False)]
    problems += conflicts(data, overruled)
    if problems or table is None:
        raise scene_error(file, problems)
    return table


def scene_error(file: str, problems: Iterable[Problem]) -> SceneError:
    """One error that lists all ``problems``, each once."""
    lines = list(dict.fromkeys(f"{path}: {text}" if path else text for path, text in problems))
    if len(lines) == 1:
        return SceneError(f"{file}: {lines[0]}")
    return SceneError("\n  ".join([f"{file}: {len(lines)} errors", *lines]))


def _translate(error: Mapping[str, Any]) -> Problem:
    kind, loc = error["type"], error["loc"]
    path = _path(loc)
    if kind == "extra_forbidden":
        return path, unknown(str(loc[-1]), _fields(loc))
    if kind == "missing":
        return path, "is missing"
    if kind in _TYPES:
        return path, f"expected {_TYPES[kind]}, got {shown(error['input'])}"
    text = str(error["msg"])
    if text.startswith("Input should be "):
        text = f"expected {text[16:]}, got {shown(error['input'])}"
    return path, text


def unknown(name: str, known: Iterable[str]) -> str:
    """Say that a field is unknown, with the nearest known one."""
    return f"unknown field, {nearest(name, known)}"


def _fields(loc: tuple[str | int, ...]) -> list[str]:
    """Names of the fields that the table around the last name of ``loc`` may have."""
    table: type[Table] | None = SceneTable
    for part in loc[:-1]:
        if isinstance(part, str) and table is not None:
            table = _table(table.model_fields[part].annotation)
    return [] if table is None else list(table.model_fields)


def _table(annotation: Any) -> type[Table] | None:
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return annotation
    return next((found for item in get_args(annotation) if (found := _table(item))), None)


def _path(names: Iterable[str | int]) -> str:
    text = "".join(
        f"[{name}]" if isinstance(name, int) else f".{name or repr(name)}" for name in names
    )
    return text.lstrip(".")


def conflicts(data: Mapping[str, Any], overruled: Collection[str] = ()) -> list[Problem]:
    """What is wrong between fields, from the file as parsed, so that other errors don't hide it."""
    problems = list(_settings(_mapping(data.get("settings")), overruled))
    problems += _camera("camera", _mapping(data.get("camera")))
    if "camera" in data and "cameras" in data:
        problems.append(("cameras", "is given beside camera; give one of them"))
    names: list[Any] = []
    for index, camera in enumerate(map(_mapping, _list(data.get("cameras")))):
        path = f"cameras[{index}]"
        problems += _camera(path, camera)
        if camera.get("name") in names:
            problems.append((f"{path}.name", f"{camera['name']!r} is the name of another camera"))
        names += [camera["name"]] if "name" in camera else []
    shutter = _mapping(data.get("shutter"))
    if _ordered(shutter.get("close", 0.25), shutter.get("open", -0.25), strictly=True):
        problems.append(("shutter", "close must not come before open"))
    if "angle" in shutter and {"open", "close"} & set(shutter):
        problems.append(("shutter.angle", "given beside open or close; give one or the other"))
    if "place" in shutter and "angle" not in shutter:
        problems.append(("shutter.place", "goes with angle"))
    for index, item in enumerate(_list(data.get("objects"))):
        if isinstance(item, Mapping):
            problems += _object(f"objects[{index}]", item)
    return problems


def _settings(settings: Mapping[str, Any], overruled: Collection[str]) -> Iterator[Problem]:
    right = {}
    for name, value in settings.items():
        if name not in SETTINGS:
            yield f"settings.{name}", unknown(str(name), SETTINGS)
            continue
        try:
            right[name] = check_setting(name, value)
        except UsageError as error:
            yield f"settings.{name}", str(error).removeprefix(f"{name}=")
    for conflict in settings_conflicts(right):
        # What is wrong or overruled is not judged together with what is given.
        if not set(conflict.names) & (set(overruled) | settings.keys() - right.keys()):
            blamed = next(name for name in conflict.names if name in right)
            yield f"settings.{blamed}", conflict.text


def _camera(path: str, camera: Mapping[str, Any]) -> Iterator[Problem]:
    yield from _keys(path, camera)
    names = set(camera).union(*map(_mapping, _list(camera.get("keys"))))
    if {"fov", "focal_length"} <= names:
        yield path, "fov and focal_length both given; give one"
    if names & {"vertical_aperture", "horizontal_aperture"} and "focal_length" not in names:
        yield path, "an aperture without focal_length; give focal_length or fov"
    placed = sorted(names & {"position", "look_at", "up"})
    if "transform" in names and placed:
        yield path, f"transform and {placed[0]} both given; give one"
    yield from _transform(f"{path}.transform", _mapping(camera.get("transform")))


def _transform(path: str, transform: Mapping[str, Any]) -> Iterator[Problem]:
    yield from _keys(path, transform)
    names = set(transform).union(*map(_mapping, _list(transform.get("keys"))))
    if {"rotation", "euler"} <= names:
        yield path, "rotation and euler both given; give one"


def _keys(path: str, table: Mapping[str, Any]) -> Iterator[Problem]:
    """Keys come in order of time, and a field is constant or keyed, not both."""
    keys = [_mapping(key) for key in _list(table.get("keys"))]
    yield from _in_order(f"{path}.keys", keys)
    for index, key in enumerate(keys):
        for side in ("before", "after"):
            where, handles = f"{path}.keys[{index}].{side}", _mapping(key.get(side))
            if side in key and table.get("interpolation") != "cubic":
                yield where, "handles need interpolation = 'cubic'"
            for name in handles.keys() - key.keys():
                yield f"{where}.{name}", f"a handle of a key without {name}; give both"
    keyed = set().union(*keys)
    for name in table:
        if name in keyed:
            yield f"{path}.{name}", "is given here and in keys; give it in one place"


def _in_order(path: str, items: Any) -> Iterator[Problem]:
    keys = [_mapping(key) for key in _list(items)]
    for index, (before, after) in enumerate(itertools.pairwise(keys)):
        if _ordered(after.get("frame"), before.get("frame")):
            where = f"{path}[{index + 1}].frame"
            yield where, f"{after['frame']} must come after {before['frame']}, the key before it"


def _object(path: str, item: Mapping[str, Any]) -> Iterator[Problem]:
    sources = [name for name in ("file", "positions", "primitive") if name in item]
    if len(sources) != 1:
        found = " and ".join(sources) or "none"
        yield path, f"give one of file, positions (with faces) and primitive, found {found}"
    elif sources[0] == "positions" and "faces" not in item:
        yield f"{path}.faces", "is missing; positions need faces"
    if "positions" not in item:
        for name in ("faces", "normals", "uv", "color", "color_domain"):
            if name in item:
                yield f"{path}.{name}", "only goes with positions"
    kind = Path(str(item.get("file", ""))).suffix.lower()
    for name, kinds in (("clip", GLTF_SUFFIXES), ("fps", (*GLTF_SUFFIXES, *USD_SUFFIXES))):
        if name in item and kind not in kinds:
            said = "a glTF file" if name == "clip" else "a glTF or USD file"
            yield f"{path}.{name}", f"only {said} has animation to apply it to"
    if "visible" in item and "visibility" in item:
        yield f"{path}.visible", "is given beside visibility; give one"
    yield from _in_order(f"{path}.visibility", item.get("visibility"))
    yield from _primitive(f"{path}.primitive", _mapping(item.get("primitive")))
    yield from _transform(f"{path}.transform", _mapping(item.get("transform")))


def _primitive(path: str, primitive: Mapping[str, Any]) -> Iterator[Problem]:
    kind = primitive.get("kind")
    fields = _PRIMITIVE_FIELDS.get(kind) if isinstance(kind, str) else None
    if fields is None:
        return
    for name in ("size", "radius", "height", "segments"):
        if name in primitive and name not in fields:
            yield f"{path}.{name}", f"a {kind} has only {', '.join(fields)}"
    size = primitive.get("size")
    if isinstance(size, list | tuple) and fields.get("size", len(size)) != len(size):
        yield f"{path}.size", f"a {kind} has {fields['size']} sizes, got {len(size)}"


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _list(value: Any) -> list[Any]:
    return list(value) if isinstance(value, list | tuple) else []


def _ordered(early: Any, late: Any, strictly: bool = False) -> bool:
    """Whether both are numbers and ``early`` is not above ``late``, or is below it."""
    if not (isinstance(early, int | float) and isinstance(late, int | float)):
        return False
    return early < late if strictly else early <= late
