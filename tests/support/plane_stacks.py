"""Stacks of planes: as many layers over every pixel as are asked for."""

from __future__ import annotations

import numpy as np

from mbinterval.scene.model import Mesh, Scene
from support.closed_forms import UNIT_CAMERA, world

COUNT = 3000


def stack(count: int = COUNT) -> tuple[Scene, np.ndarray, np.ndarray]:
    """Half-planes over every pixel, each nearer one arriving a little later than the one behind.

    Returns the scene, colours ``(count, 3)`` from front to back, and the times at which the
    leading edges pass x = 4.5.
    """
    rng = np.random.default_rng(3)
    color = rng.uniform(0, 1, (count, 3))
    arrival = (np.arange(count)[::-1] + 0.5) / count
    speed = 100.0
    edge = 4.5 - speed * arrival
    start = np.stack([np.stack([edge, edge * 0 - 5000], 1), np.stack([edge, edge * 0 + 5000], 1),
                      np.stack([edge - 5000, edge * 0], 1)], axis=1)  # fmt: skip
    w = 1.0 + 1e-3 * np.arange(count)[:, None]
    ends = np.stack([start, start + [speed, 0]])
    positions = world(ends, w, (9, 3)).reshape(2, -1, 3)
    order = rng.permutation(count)  # in no order of depth
    faces = np.arange(3 * count).reshape(-1, 3)[order]
    mesh = Mesh(positions=positions, faces=faces, color=color[order], color_domain="face",
                shading="unlit")  # fmt: skip
    return Scene(meshes=[mesh], camera=UNIT_CAMERA), color, arrival
