"""Random scenes for culling, and how films of them are compared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import mbinterval as mb
from mbinterval.scene.model import Material, Scene
from mbinterval.settings.rules import CULLS
from support.hard_cases import mesh, scene

EXACT = tuple(
    cull for cull in CULLS if cull not in ("bbox", "interleave_uvt", "clip_space_printed")
)
"""Methods that must lose nothing, whatever the pattern."""


def same(a: mb.Film, b: mb.Film) -> bool:
    arrays = ("rgba", "depth", "intervals")
    return all(getattr(a, name).tobytes() == getattr(b, name).tobytes() for name in arrays)


def random_scene(seed: int) -> Scene:
    """Big and small triangles, near the eye and behind it, one-sided or not, moving or not."""
    rng = np.random.default_rng(seed)
    count = 24
    spread = 10 ** rng.uniform(-0.5, 1.5, (1, count, 1, 1))
    points = rng.uniform((-20, -20), (68, 52), (2, count, 1, 2))
    points[1, : count // 4] = points[0, : count // 4]
    points = points + rng.normal(0, 1, (2, count, 3, 2)) * spread
    low = (0.5, 0.02, -1.0)[seed % 3]
    w = rng.uniform(low, 3.0, (2, count, 3))
    still = mesh(points[:1, :6], w[:1, :6], shift=40)
    one_sided = Material(shading="unlit", double_sided=False)
    back = replace(mesh(points[:, 6:12], w[:, 6:12], shift=60), material=one_sided)
    of = scene(mesh(points[:, 12:], w[:, 12:]), still, back)
    if seed // 3 % 2:
        camera = replace(of.camera, fov=None, focal_length=24.0, f_stop=0.02, focus_distance=1.2)
        of = replace(of, camera=camera)
    return of
