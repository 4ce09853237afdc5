"""Meshes that call for effects, and plans of them."""

from __future__ import annotations

import numpy as np

import mbinterval as mb
from mbinterval.plan.plan import Plan
from mbinterval.scene.model import Mesh, Scene
from support.closed_forms import UNIT_CAMERA, rectangle, world
from support.kernels import ready_for

SIZE = (32, 16)

WAYS = {
    "triangulated": {"paths": "triangulated", "occlusion": 128},
    "triangulated, exact occlusion": {"paths": "triangulated", "occlusion": "exact"},
    "exact": {"paths": "exact", "occlusion": "exact"},
    "exact, masked": {"paths": "exact", "occlusion": 64},
}


def mesh(moving: bool = True, **fields: object) -> Mesh:
    ends = world(np.stack([rectangle(3, 9, -1, 17)] * 2), 2.0, SIZE)
    ends[1] += [0.4, 0, 0]
    if "material" not in fields:
        fields["shading"] = "unlit"
    positions = ends if moving else ends[0]
    return Mesh(positions=positions, faces=[[0, 1, 2], [0, 2, 3]], **fields)


def plan(*meshes: Mesh, scene: Scene | None = None, **settings: object) -> Plan:
    scene = scene or Scene(meshes=meshes, camera=UNIT_CAMERA)
    return ready_for(scene, mb.Settings(**settings), *SIZE).plan


UV = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
