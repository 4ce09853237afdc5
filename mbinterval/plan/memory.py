"""Bytes that a render takes, as far as they are known before it runs, and a limit to them.

What comes on top is known only when paths have met tiles: the lists of paths by tile, for lights
too, and pools that had to grow. They are held against the limit when they are known
(`check_members` of `shared_steps`, and `tiles`).
"""

from __future__ import annotations

import os
import resource
from pathlib import Path

import numpy as np

from mbinterval.device import records
from mbinterval.device.runtime import Runtime
from mbinterval.errors import CapacityError
from mbinterval.exposure.exposure import Exposure
from mbinterval.layout import appearance
from mbinterval.layout.motion import Motion
from mbinterval.plan import buffers
from mbinterval.plan.plan import Plan
from mbinterval.scene.model import Texture

_TEXEL = 16
_ORDER = 4
_KERNELS = 16 << 20  # what a CPU device takes to load kernels from its cache, and to start
_MOTION = ("positions", "jobs", "cameras", "paths", "meshes", "color", "uv", "normal")


def buffer_bytes(motion: Motion, plan: Plan, workers: int) -> dict[str, int]:
    """Return bytes by kind of buffer, for a device with as many ``workers``."""
    method = plan.settings.method
    paths = _path_bytes(len(motion.paths), motion.vertex_count, method, plan.exact)
    given = sum(getattr(motion, name).nbytes for name in _MOTION) - motion.paths.nbytes
    given += sum(places.nbytes for places in motion.places.values())
    cropped = plan.crop[2] * plan.crop[3]
    film = buffers.film_bytes(plan) + (16 * cropped if "share" in plan.stages else 0)
    if "BACKGROUND_IMAGE" in plan.active:
        film += 12 * plan.region[2] * plan.region[3]
    _, _, columns, rows = buffers.tile_grid(plan)
    pools = buffers.pool_bytes(plan, plan.capacity)
    if method != "analytic":
        pools = buffers.scratch_bytes(plan)
    events = buffers.first_events(plan) * records.EVENT.itemsize
    return {
        "geometry": given + paths,
        "textures": sum(_TEXEL * texel_count(texture) for texture in textures_of(motion)),
        "film": film,
        "pools": pools * min(workers, columns * rows),
        **({"events": events} if "record" in plan.stages else {}),
    }


def _path_bytes(paths: int, vertices: int, method: str, exact: bool) -> int:
    """Bytes of motion paths, of what is found about them, and the vertices that they go between."""
    depth = records.DEPTH.itemsize if exact else 0
    found = _found(method).itemsize + (depth if method == "analytic" else 0)
    path = records.PATH.itemsize + found + _ORDER
    return paths * path + vertices * records.VERTEX.itemsize


def _found(method: str) -> np.dtype[np.void]:
    """Record of what is found about each path, which the host reads to put them into order."""
    return records.SHAPE if method == "analytic" else records.BOUNDS


def memory_left(memory: int | None, runtime: Runtime) -> int | None:
    """Bytes of ``memory`` that are left for a frame; None where there is no limit.

    A CPU device shares its memory with the process: what this takes already goes off.
    """
    if memory is None or not runtime.is_cpu:
        return memory
    used = resident_memory() + _KERNELS
    if used >= memory:
        raise CapacityError(
            f"the program and the scene take {_mebibytes(used)}, and {_mebibytes(memory)} are "
            "allowed for all; allow more memory"
        )
    return memory - used


def check_paths(exposure: Exposure, method: str, room: int | None) -> None:
    """Refuse an exposure whose motion paths alone take more than ``room``, before they are made."""
    if room is None:
        return
    needs = {
        index: _path_bytes(
            len(mesh.faces) * max(mesh.segments, 1),
            mesh.positions.shape[1] * (mesh.segments + 1),
            method,
            exact=False,
        )
        for index, mesh in enumerate(exposure.meshes)
    }
    if sum(needs.values()) > room:
        most = exposure.meshes[max(needs, key=lambda index: needs[index])]
        raise CapacityError(
            f"the frame needs more than {_mebibytes(sum(needs.values()))} for its motion paths, "
            f"the most for mesh {most.mesh.name!r} with {len(most.faces)} faces in "
            f"{max(most.segments, 1)} motion segments; of the memory that is allowed "
            f"{_mebibytes(room)} are left: allow more, or fewer segments (motion_segments, "
            "motion_error)"
        )


def check_memory(motion: Motion, plan: Plan, memory: int | None) -> None:
    """Refuse a frame that has no room in the plan's part of ``memory``, with what it needs."""
    if plan.memory is None or memory is None:
        return
    needs = buffer_bytes(motion, plan, workers=1)
    # On the host: positions that were joined, records of paths that are put into order, the film.
    host = motion.positions.nbytes + buffers.film_bytes(plan)
    ordered = len(motion.paths) * _found(plan.settings.method).itemsize
    fixed = needs["geometry"] + needs["textures"]
    need = fixed + max(ordered, needs["film"] + host + buffers.least_bytes(plan))
    if need > plan.memory:
        parts = ", ".join(f"{name} {_mebibytes(needs[name])}" for name in list(needs)[:3])
        raise CapacityError(
            f"the frame needs {_mebibytes(need)} ({parts}, the rest for copies and lists); of the "
            f"memory that is allowed {_mebibytes(plan.memory)} are left: allow "
            f"{_mebibytes(memory - plan.memory + need)} in all or more, or use fewer motion "
            "segments, smaller textures, or crops"
        )


def resident_memory() -> int:
    """Bytes of memory that this process takes now; where that can't be told, the most it took."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _mebibytes(size: int) -> str:
    return f"{-(-size // 2**20)} MiB"


def textures_of(motion: Motion) -> list[Texture]:
    """Return the textures of the materials in use, as often as the device has each."""
    return list(appearance.textures_of(motion.materials).values())


def texel_count(texture: Texture) -> int:
    """Texels of a texture and its mip levels, each half the size of the one before."""
    height, width = map(int, texture.image.shape[:2])
    count = height * width
    while (height, width) != (1, 1):
        height, width = max(height // 2, 1), max(width // 2, 1)
        count += height * width
    return count
