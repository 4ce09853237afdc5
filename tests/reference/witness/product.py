"""The one place where the witness's tests meet the package: what makes scenes, and renders."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any
from unittest import mock

import numpy as np

from mbinterval import (
    Camera,
    Environment,
    Film,
    Light,
    Material,
    Mesh,
    Reflections,
    Scene,
    Settings,
    Shutter,
    Texture,
    Track,
    Transform,
    load,
    render,
)
from mbinterval.plan import prepare
from mbinterval.scene.deform import Morph, MorphedSkin, NodeJoints, Skin

__all__ = [
    "Camera",
    "Environment",
    "Film",
    "Light",
    "Material",
    "Mesh",
    "Morph",
    "MorphedSkin",
    "NodeJoints",
    "Reflections",
    "Scene",
    "Settings",
    "Shutter",
    "Skin",
    "Texture",
    "Track",
    "Transform",
    "films",
    "load",
    "render",
]

PATH_ERROR = 2e-3
"""Pixels that motion segments may be off by, of which the witness knows nothing."""


def films(
    scene: Scene, frame: float, size: tuple[int, int], repeats: int = 1, **settings: Any
) -> list[Film]:
    """Films that differ in their seeds alone, which follow each other from ``seed`` on."""
    given = {"motion_error": PATH_ERROR} | settings
    first = given.pop("seed", 0)
    with exposed_once():
        return [
            render(scene, frame=frame, width=size[0], height=size[1],
                   settings=Settings(**given, seed=first + number))
            for number in range(repeats)
        ]  # fmt: skip


@contextmanager
def exposed_once() -> Iterator[None]:
    """Within it a scene is exposed and laid out once for all renders that differ in their seeds.

    That is half the time of small films; seeds do not count there, and what comes of it is frozen.
    """
    once = {name: lru_cache(maxsize=4)(getattr(prepare, name)) for name in ("expose", "lay_out")}
    with mock.patch.multiple(prepare, **once):
        yield


def colors(found: list[Film]) -> np.ndarray:
    """``(R, H, W, 4)``."""
    return np.stack([film.rgba for film in found]).astype(np.float64)
