"""Which object and which material a pixel shows: numbers that stay from frame to frame, and names.

An object is a mesh of the scene. 0 is nothing; the first of each has 1.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.appearance import DEFAULT_MATERIAL
from mbinterval.scene.model import Material, Scene


def names(scene: Scene, aovs: Sequence[str]) -> dict[str, str]:
    """Names of objects and materials that ``aovs`` ask for, in order, as metadata: JSON lists."""
    found = {}
    if "object" in aovs:
        found["objects"] = _json([mesh.name for mesh in scene.meshes])
    if "material" in aovs:
        found["materials"] = _json([material.name for material in _materials(scene)])
    return found


def identified(
    scene: Scene, aovs: Sequence[str], layers: Mapping[str, NDArray[Any]]
) -> dict[str, NDArray[Any]]:
    """Return ``layers`` with those of ``"object"`` and ``"material"`` that are asked for.

    The second follows from the first.
    """
    found = dict(layers)
    if "material" in aovs:
        index = {material: place for place, material in enumerate(_materials(scene), start=1)}
        table = [0, *(index[mesh.material or DEFAULT_MATERIAL] for mesh in scene.meshes)]
        found["material"] = np.array(table, np.uint32)[layers["object"]]
    return {name: found[name] for name in aovs}


def _materials(scene: Scene) -> list[Material]:
    """Materials that meshes use; those that are equal in name and all else are one."""
    return list(dict.fromkeys(mesh.material or DEFAULT_MATERIAL for mesh in scene.meshes))


def _json(values: Sequence[str]) -> str:
    return json.dumps(values, ensure_ascii=False)
