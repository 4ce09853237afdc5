"""The one place where the witness's tests meet the package: what makes scenes, and renders."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbinterval import (
    Camera,
    Environment,
    Film,
    Light,
    Material,
    Mesh,
    Scene,
    Settings,
    Shutter,
    Texture,
    Track,
    Transform,
    load,
    render,
)
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
    """Films that differ in their seeds alone."""
    given = {"motion_error": PATH_ERROR} | settings
    return [
        render(scene, frame=frame, width=size[0], height=size[1],
               settings=Settings(**given, seed=seed))
        for seed in range(repeats)
    ]  # fmt: skip


def colors(found: list[Film]) -> np.ndarray:
    """``(R, H, W, 4)``."""
    return np.stack([film.rgba for film in found]).astype(np.float64)
