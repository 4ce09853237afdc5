"""Motion blur rendered analytically in time, on OpenCL.

    import mbinterval as mb

    scene = mb.load("scenes/wheel.toml")
    film = mb.render(scene, frame=12, width=640, height=480, settings=mb.Settings(samples=4))
    film.write("wheel.0012.exr")

The names are loaded when they are first used, so that importing mbinterval is quick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from mbinterval.version import __version__

__all__ = [
    "Camera",
    "CapacityError",
    "Comparison",
    "DeepImage",
    "DeviceError",
    "Environment",
    "Events",
    "Film",
    "KernelBuildError",
    "Light",
    "Material",
    "MbintervalError",
    "Mesh",
    "OutputError",
    "Reflections",
    "Scene",
    "SceneError",
    "Settings",
    "Shutter",
    "Texture",
    "Track",
    "Transform",
    "UsageError",
    "__version__",
    "compare",
    "devices",
    "errors",
    "farm",
    "load",
    "load_file",
    "read_image",
    "render",
]

_ERRORS = (
    "CapacityError",
    "DeviceError",
    "KernelBuildError",
    "MbintervalError",
    "OutputError",
    "SceneError",
    "UsageError",
)
_HOMES = {
    **dict.fromkeys(_ERRORS, "errors"),
    **dict.fromkeys(("Camera", "Light", "Material", "Mesh", "Scene"), "scene.model"),
    **dict.fromkeys(("Shutter", "Texture"), "scene.model"),
    **dict.fromkeys(("Environment", "Reflections"), "scene.environment"),
    "Track": "scene.tracks",
    "Transform": "scene.transforms",
    "Comparison": "comparison.comparison",
    "DeepImage": "film.deep",
    "Events": "film.events",
    "Film": "film.film",
    "Settings": "settings.settings",
    "compare": "comparison.comparison",
    "devices": "device.choose",
    "farm": "batch.dask_farm",
    "load": "scene.formats.load",
    "load_file": "scene.formats.load",
    "read_image": "files.images",
    "render": "rendering.renderer",
}
"""The module, below this package, of each public name."""

if TYPE_CHECKING:
    from mbinterval import errors
    from mbinterval.batch.dask_farm import farm
    from mbinterval.comparison.comparison import Comparison, compare
    from mbinterval.device.choose import devices
    from mbinterval.errors import (
        CapacityError,
        DeviceError,
        KernelBuildError,
        MbintervalError,
        OutputError,
        SceneError,
        UsageError,
    )
    from mbinterval.files.images import read_image
    from mbinterval.film.deep import DeepImage
    from mbinterval.film.events import Events
    from mbinterval.film.film import Film
    from mbinterval.rendering.renderer import render
    from mbinterval.scene.environment import Environment, Reflections
    from mbinterval.scene.formats.load import load, load_file
    from mbinterval.scene.model import Camera, Light, Material, Mesh, Scene, Shutter, Texture
    from mbinterval.scene.tracks import Track
    from mbinterval.scene.transforms import Transform
    from mbinterval.settings.settings import Settings


def __getattr__(name: str) -> Any:
    if name == "errors":
        return importlib.import_module("mbinterval.errors")
    if name not in _HOMES:
        raise AttributeError(f"module 'mbinterval' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"mbinterval.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
