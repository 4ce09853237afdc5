"""Bytes of the device buffers of a render, as far as they are known before it runs.

What comes on top is known only when paths have met tiles: the lists of paths by tile, and pools
that had to grow.
"""

from __future__ import annotations

from mbinterval import stochastic, tiles
from mbinterval.device import records
from mbinterval.motion import Motion
from mbinterval.plan import Plan
from mbinterval.scene.model import Texture
from mbinterval.work import tile_grid

_TEXEL = 16
_MOTION = ("positions", "jobs", "cameras", "paths", "meshes", "color", "uv", "normal")


def buffer_bytes(motion: Motion, plan: Plan, workers: int) -> dict[str, int]:
    """Return bytes by kind of buffer, for a device with as many ``workers``."""
    count, sampled = len(motion.paths), plan.settings.method != "analytic"
    path = records.SHAPE.itemsize + (records.DEPTH.itemsize if plan.exact else 0) + 4  # their order
    if sampled:
        path = records.BOUNDS.itemsize + 4
    vertices = motion.vertex_count * records.VERTEX.itemsize
    geometry = sum(getattr(motion, name).nbytes for name in _MOTION) + vertices + count * path
    cropped, pixels = plan.crop[2] * plan.crop[3], plan.region[2] * plan.region[3]
    film = 24 * pixels + (16 * cropped if "share" in plan.stages else 0)
    if "-DBACKGROUND_IMAGE" in plan.options:
        film += 12 * cropped
    _, _, columns, rows = tile_grid(plan)
    pool = sum(record.itemsize for record in tiles._pools(plan).values())
    pools = pool * (plan.capacity + tiles._LANES)
    if sampled:
        pools = stochastic.scratch_bytes(plan)
    return {
        "geometry": geometry,
        "textures": sum(_TEXEL * texel_count(texture) for texture in textures_of(motion)),
        "film": film,
        "pools": pools * min(workers, columns * rows),
    }


def textures_of(motion: Motion) -> list[Texture]:
    """Return the textures of the materials in use, each once."""
    return list({id(m.texture): m.texture for m in motion.materials if m.texture}.values())


def texel_count(texture: Texture) -> int:
    """Texels of a texture and its mip levels, each half the size of the one before."""
    height, width = map(int, texture.image.shape[:2])
    count = height * width
    while (height, width) != (1, 1):
        height, width = max(height // 2, 1), max(width // 2, 1)
        count += height * width
    return count
