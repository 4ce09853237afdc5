"""Scenes seen through a lens."""

from __future__ import annotations

from dataclasses import replace

from mbinterval.scene.model import Scene

LENS = {"fov": None, "focal_length": 24.0, "f_stop": 0.02, "focus_distance": 1.8}


def with_lens(of: Scene) -> Scene:
    return replace(of, camera=replace(of.camera, **LENS))
