"""Read a scene from a file of any known kind, or from a Python dict."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mbinterval.errors import SceneError, UsageError
from mbinterval.files.contents import read_file, recording
from mbinterval.scene.asset import GLTF_SUFFIXES, USD_SUFFIXES
from mbinterval.scene.model import Scene
from mbinterval.values import number, shown


@dataclass(frozen=True)
class RenderDefaults:
    """What a scene file proposes to the command line; None where it doesn't."""

    width: int | None = None
    height: int | None = None
    frames: str | None = None
    output: str | None = None


@dataclass(frozen=True, eq=False)
class SceneFile:
    """A scene and what else its file says.

    Attributes
    ----------
    scene
        The scene.
    settings
        Values of the ``[settings]`` table, for ``Settings.from_mapping``.
    render
        Values of the ``[render]`` table.
    files
        SHA-256 of each file that was read, by its path, as it was read: the scene's own first.
    """

    scene: Scene
    settings: Mapping[str, Any] = field(default_factory=dict)
    render: RenderDefaults = field(default_factory=RenderDefaults)
    files: Mapping[Path, str] = field(default_factory=dict)


def load(
    source: str | Path | Mapping[str, Any],
    base: str | Path | None = None,
    *,
    clip: str | int | None = None,
    fps: float | None = None,
) -> Scene:
    """Read a scene.

    Parameters
    ----------
    source
        A scene file (.toml, .json), or the same as a dict; a glTF model (.glb, .gltf); a USD file
        (.usd, .usda, .usdc, .usdz); a benchmark (.npz); or any mesh file that trimesh reads (.obj,
        .ply, .stl, ...).
    base
        Folder that relative paths in a dict are relative to; default is the current one. In a
        file they are relative to the file.
    clip
        Name or index of the animation clip of a glTF model; None is the first.
    fps
        Frames per second of an animated model: a key at s seconds is at frame s * fps. None is 24,
        or for USD the file's time codes per second, so that a frame is a time code.

    The tables ``[settings]`` and ``[render]`` of a scene file are no part of a scene: they are
    checked, and left to `load_file` and the command line.

    Raises
    ------
    SceneError
        With every error of a scene file, each with its path in the file.
    UsageError
        For ``clip`` or ``fps`` with a source that has no use for them.
    """
    return load_file(source, base, clip=clip, fps=fps).scene


def load_file(
    source: str | Path | Mapping[str, Any],
    base: str | Path | None = None,
    overruled: Collection[str] = (),
    *,
    clip: str | int | None = None,
    fps: float | None = None,
) -> SceneFile:
    """Read a scene as `load` does, with the settings and render defaults of its file.

    Settings of the file must go together, but for those whose names are ``overruled``: the
    caller joins them with values of its own, which `Settings` then checks. For example
    ``Settings.from_mapping({**mbinterval.load_file(path).settings, "samples": 16})``.
    """
    with recording() as files:
        loaded = _load(source, base, overruled, clip, fps)
    return replace(loaded, files=files)


def _load(
    source: Any,
    base: Any,
    overruled: Collection[str],
    clip: str | int | None,
    fps: float | None,
) -> SceneFile:
    if isinstance(source, Mapping):
        if base is not None and not isinstance(base, str | Path):
            raise SceneError(f"base={shown(base)}: expected the path of a folder")
        _check_animation("", clip, fps)
        return _from_table(source, Path(base or "."), "scene", overruled)
    if not isinstance(source, str | Path) or "\0" in str(source):
        raise SceneError(f"{shown(source)}: expected the path of a file, or a dict")
    path = Path(source)
    if path.is_dir():
        raise SceneError(f"{path}: is a folder; give a file in it")
    if not path.is_file():
        raise SceneError(f"{path}: no such file")
    kind = path.suffix.lower()
    _check_animation(kind, clip, fps)
    if kind in (".toml", ".json"):
        return _from_table(_parse(path, kind), path.parent, str(path), overruled)
    if kind == ".npz":
        from mbinterval.scene.formats.meshes.benchmark import read_benchmark

        scene, width, height = read_benchmark(path)
        return SceneFile(scene, {}, RenderDefaults(width=width, height=height))
    return _model_scene(path, kind, clip, fps)


def _check_animation(kind: str, clip: str | int | None, fps: float | None) -> None:
    if (clip, fps) != (None, None) and kind not in (*GLTF_SUFFIXES, *USD_SUFFIXES):
        raise UsageError(
            "clip and fps go with a glTF or USD model; a scene file has them per object"
        )
    if clip is not None and kind in USD_SUFFIXES:
        raise UsageError("clip goes with a glTF model; a USD file has one animation")


def _model_scene(path: Path, kind: str, clip: str | int | None, fps: float | None) -> SceneFile:
    fps = None if fps is None else number(fps, "fps", above=0.0)
    usual = Scene(meshes=())
    if kind in GLTF_SUFFIXES:
        from mbinterval.scene.formats.gltf.gltf import read_gltf

        asset = read_gltf(path, fps or usual.fps, clip)
    elif kind in USD_SUFFIXES:
        from mbinterval.scene.formats.usd.usd import read_usd

        asset = read_usd(path, fps)
    else:
        from mbinterval.scene.formats.meshes.mesh_files import read_mesh_file

        asset = read_mesh_file(path)
    return SceneFile(
        Scene(
            asset.meshes,
            asset.camera,
            asset.lights,
            shutter=asset.shutter or usual.shutter,
            fps=fps or asset.fps or usual.fps,
            name=path.stem,
            notes=asset.notes,
            animation=asset.animation,
            cameras=asset.cameras,
        )
    )


def _parse(path: Path, kind: str) -> Any:
    """Parsed TOML or JSON; a syntax error gives line and column."""
    import json
    import tomllib

    try:
        text = read_file(path).decode("utf-8-sig")
        return tomllib.loads(text) if kind == ".toml" else json.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"{path}: not valid TOML: {error}") from None
    except json.JSONDecodeError as error:
        raise SceneError(
            f"{path}: not valid JSON: {error.msg} (at line {error.lineno}, column {error.colno})"
        ) from None
    except UnicodeDecodeError as error:
        raise SceneError(f"{path}: not UTF-8 text ({error}); save it as UTF-8") from None
    except RecursionError:
        raise SceneError(f"{path}: nested too deeply") from None
    except ValueError as error:  # integers of thousands of digits
        raise SceneError(f"{path}: {error}") from None
    except OSError as error:
        raise SceneError(f"{path}: cannot be read ({error.strerror or error})") from None


def _from_table(data: Any, base: Path, file: str, overruled: Collection[str]) -> SceneFile:
    from mbinterval.scene.formats.toml.build import build_scene
    from mbinterval.scene.formats.toml.validate import validate

    table = validate(data, base, file, overruled)
    values = table.render.model_dump(exclude_none=True)
    try:
        scene = build_scene(table, file)
    except SceneError as error:
        if str(error).startswith(file):
            raise
        raise SceneError(f"{file}: {error}") from None
    return SceneFile(scene, table.settings, RenderDefaults(**values))
