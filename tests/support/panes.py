"""Panes of one colour for files of layers."""

from __future__ import annotations

from dataclasses import replace

from mbinterval.scene.model import Mesh
from support.closed_forms import rectangle, slab
from support.translucent_scenes import glass

SIZE = (32, 16)


def pane(
    name: str, left: float, right: float, speed: float, w: float, opacity: float = 1.0
) -> Mesh:
    plain = slab(rectangle(left, right, -50, 50), (speed, 0), w, SIZE)
    return replace(plain, name=name, material=replace(glass(opacity), name=f"paint of {name}"))
