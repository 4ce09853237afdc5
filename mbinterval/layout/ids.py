"""Which object and which material a pixel shows: numbers that stay from frame to frame, and names.

An object is a mesh of the scene. 0 is nothing; the first of each has 1.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.film import cryptomatte
from mbinterval.film.aovs import EXPORTS
from mbinterval.layout.appearance import DEFAULT_MATERIAL
from mbinterval.layout.motion import Motion
from mbinterval.scene.model import Material, Scene


def names(scene: Scene, aovs: Sequence[str]) -> dict[str, str]:
    """Names of objects and materials that ``aovs`` ask for, in order, as metadata: JSON lists."""
    found = {}
    if "object" in aovs:
        found["objects"] = _json([mesh.name for mesh in scene.meshes])
    if "material" in aovs:
        found["materials"] = _json([material.name for material in _materials(scene)])
    for layer in (name for name in aovs if name in _NAMED):
        found |= cryptomatte.metadata(layer, dict.fromkeys(_NAMED[layer](scene)))
    return found


def add_hashes(motion: Motion, scene: Scene, aovs: Sequence[str]) -> Motion:
    """Return ``motion`` with ``hashes`` for the Cryptomattes among ``aovs``."""
    hashes = {}
    for layer in (name for name in aovs if name in _NAMED):
        found = [0, *map(cryptomatte.id_of, _NAMED[layer](scene))]
        hashes[layer] = np.array(found, np.uint32)[motion.objects[1:]]
    return replace(motion, hashes=hashes)


def notes(scene: Scene, aovs: Sequence[str]) -> tuple[str, ...]:
    """Say which names a Cryptomatte can't tell apart, since their hashes are one."""
    found = []
    for layer in (name for name in aovs if name in _NAMED):
        names: dict[int, str] = {}
        for name in dict.fromkeys(_NAMED[layer](scene)):
            other = names.setdefault(cryptomatte.id_of(name), name)
            if other != name:
                found.append(f"{layer}: {other!r} and {name!r} have one ID; rename one of them")
    return tuple(found)


def _object_names(scene: Scene) -> list[str]:
    """Name of each mesh; where it has none, its number as layer "object" has it."""
    return [mesh.name or f"object {place}" for place, mesh in enumerate(scene.meshes, start=1)]


def _material_names(scene: Scene) -> list[str]:
    """Name of the material of each mesh; where it has none, its number likewise."""
    number = {material: place for place, material in enumerate(_materials(scene), start=1)}
    used = [mesh.material or DEFAULT_MATERIAL for mesh in scene.meshes]
    return [material.name or f"material {number[material]}" for material in used]


_NAMED = {"crypto_object": _object_names, "crypto_material": _material_names}
"""For each Cryptomatte, the name that every mesh goes by."""


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
    return {name: found[name] for name in aovs if name not in EXPORTS}


def _materials(scene: Scene) -> list[Material]:
    """Materials that meshes use; those that are equal in name and all else are one."""
    return list(dict.fromkeys(mesh.material or DEFAULT_MATERIAL for mesh in scene.meshes))


def _json(values: Sequence[str]) -> str:
    return json.dumps(values, ensure_ascii=False)
