"""The stochastic path: visibility at point samples in time, place and lens.

    vertices -> bounds -> bin (-> shadow_map) -> [scatter -> sample -> shade -> resolve] (-> rgss)

Each word is a stage: a file in ``cl/stochastic`` (``vertices`` is in ``cl/shared``), an entry in
the plan, and a key of the timings. The bracketed stages run fused, tile by tile, in one kernel.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.device import records
from mbinterval.device.runtime import Runtime, seconds
from mbinterval.motion import Motion
from mbinterval.plan import Plan
from mbinterval.sampling import reach_of
from mbinterval.scene.exposure import Exposure
from mbinterval.shadow_tree import prepare_rays
from mbinterval.stochastic_plan import sample_count
from mbinterval.work import (
    CUBE_MAPS,
    Pixels,
    Work,
    add_counts,
    frame_record,
    in_parts,
    list_paths,
    memory_room,
    packed,
    shadow_count,
    tile_grid,
    transform_vertices,
    upload_scene,
)

TILE_STAGES = ("scatter", "sample", "shade", "resolve")
"""Stages of the fused kernel, in the order in which it counts their time."""

_COUNTS = (
    *("bounded", "visited", "stage1", "tests", "hits", "depth_tests"),
    *("texels", "texel_lines"),
)
_ARGUMENTS = (
    *("vertices", "paths", "bounds", "meshes", "materials", "color", "uv"),
    *("normal", "textures", "texels", "lights", "cameras", "slots", "filter", "shutter"),
    *("background", "starts", "members", "queue", "next", "samples", "pixels", "counters"),
    *("rgba", "depth", "seen"),
)
_SHADOWS = (
    *("world", "shadow_lights", "tree", "leaves", "leaf_nodes", "light_views", "shadow_map"),
)
_PATHS_PER_ITEM = 256
_SLAB = 256
_PIXEL_VECTORS = 8


def render_stochastic(
    runtime: Runtime,
    exposure: Exposure,
    motion: Motion,
    plan: Plan,
    progress: Callable[[float], None] | None = None,
) -> Pixels:
    """Render ``exposure``, laid out as ``motion``, by the stages of ``plan``."""
    work = Work(runtime, plan, upload_scene(runtime, exposure, motion, plan), exposure)
    work.timings["vertices"] = transform_vertices(work, motion)
    _run_bounds(work, motion)
    listed = _run_bin(work, motion)
    if shadow_count(plan):
        prepare_rays(work, motion)
    counts = _render_tiles(work, listed, progress)
    if "rgss" in plan.stages:
        _run_rgss(work)
    height, width = plan.crop[3], plan.crop[2]
    return Pixels(
        rgba=runtime.download(work.buffers["rgba"], (height, width, 4), np.float32),
        depth=runtime.download(work.buffers["depth"], (height, width), np.float32),
        intervals=runtime.download(work.buffers["seen"], (height, width), np.uint32),
        timings=work.timings,
        stats=counts,
    )


def _run_bounds(work: Work, motion: Motion) -> None:
    """Stage "bounds": depth and scale of every path, and whether it can be seen."""
    runtime, buffers, count = work.runtime, work.buffers, len(motion.paths)
    buffers["bounds"] = runtime.allocate(count * records.BOUNDS.itemsize, "bounds")
    work.timings["bounds"] = 0.0
    if count == 0:
        return
    event = runtime.run(
        runtime.kernel("stochastic/bounds.cl", "bounds", work.plan.flags("GLOSSY")),
        -(-count // _PATHS_PER_ITEM),
        *(buffers["vertices"], buffers["paths"], np.uint32(count)),
        *(buffers["meshes"], buffers["materials"], buffers["cameras"]),
        *(np.int32(work.plan.width), np.int32(work.plan.height), buffers["bounds"]),
    )
    work.timings["bounds"] = seconds(event)


def _run_bin(work: Work, motion: Motion) -> NDArray[np.int64]:
    """Stage "bin": the paths that each tile lists, from near to far; returns how many."""
    runtime, buffers, count = work.runtime, work.buffers, len(motion.paths)
    bounds = runtime.download(buffers["bounds"], (count,), records.BOUNDS)
    order = np.argsort(bounds["near"], kind="stable").astype(np.uint32)
    names = ("vertices", "paths", "bounds", "meshes", "cameras")
    given = (*(buffers[name] for name in names), runtime.upload(order, "order"))
    asked = work.plan.flags("GLOSSY", "LENS")
    reach = reach_of(work.plan.settings)
    return list_paths(work, "stochastic/bin.cl", asked, given, count, reach)


def _render_tiles(
    work: Work,
    listed: NDArray[np.int64],
    progress: Callable[[float], None] | None,
) -> dict[str, int]:
    """Run the fused stages on all tiles, those that list most first; returns counts."""
    workers = min(work.runtime.workers, len(listed))
    if work.plan.memory is not None:
        workers = max(1, min(workers, memory_room(work) // scratch_bytes(work.plan)))
    _allocate(work, workers)
    work.timings |= dict.fromkeys(TILE_STAGES, 0.0)
    stats = dict.fromkeys(_COUNTS, 0)
    queue = np.argsort(-listed, kind="stable").astype(np.uint32)
    loads = (listed[queue] + 1) * sample_count(work.plan.settings)
    for done in in_parts(queue, loads, partial(_run_part, work, workers=workers, stats=stats)):
        if progress is not None:
            progress(done / len(queue))
    return stats if "STATISTICS" in work.plan.active else {}


def scratch_bytes(plan: Plan) -> int:
    """Return the bytes of a worker's scratch: the samples and the pixels of a tile."""
    return (4 * _scratch_words(plan) * plan.layers + 16 * _PIXEL_VECTORS) * _SLAB


def _scratch_words(plan: Plan) -> int:
    """Words of scratch for each sample: ``SCRATCH`` of ``cl/stochastic/tile.cl``."""
    return 7 + 2 * ("MIRRORS" in plan.active) + 2 * ("GLOSSY" in plan.active)


def _allocate(work: Work, workers: int) -> None:
    """Buffers of the film, and each worker's scratch."""
    width, height = work.plan.region[2:]
    kept = 4 if "rgss" in work.plan.stages else 1
    sizes = {
        "next": 4,
        "samples": 4 * _scratch_words(work.plan) * work.plan.layers * _SLAB * workers,
        "pixels": 16 * _PIXEL_VECTORS * _SLAB * workers,
        "counters": 8 * len(TILE_STAGES + _COUNTS) * workers,
        "rgba": 16 * kept * width * height,
        "depth": 4 * kept * width * height,
        "seen": 4 * width * height,
    }
    for name, size in sizes.items():
        work.buffers[name] = work.runtime.allocate(size, name)


def _run_part(work: Work, queue: NDArray[np.uint32], workers: int, stats: dict[str, int]) -> float:
    """Render the queued tiles; returns seconds."""
    runtime, buffers, plan = work.runtime, work.buffers, work.plan
    left, top, columns, rows = tile_grid(plan)
    buffers["queue"] = runtime.upload(queue, "queue")
    runtime.fill(buffers["next"], 4)
    runtime.fill(buffers["counters"], 8 * len(TILE_STAGES + _COUNTS) * workers)
    roll, background = work.exposure.roll, work.exposure.background
    rolling = (roll.start, roll.step, roll.length) if roll else (0.0, 0.0, 1.0)
    numbers = len(queue), buffers["light_count"], plan.settings.seed
    reach = reach_of(plan.settings)
    grid = packed(
        *("iiiiIIIfffffii", left, top, columns, rows, *numbers),
        *(*rolling, min(reach), max(reach), plan.width, plan.height),
    )
    frame = frame_record(plan.region, background)
    kernel = runtime.kernel("stochastic/tile.cl", "tile", plan.options)
    names = (*_ARGUMENTS, *(_SHADOWS if shadow_count(plan) else ()))
    names += CUBE_MAPS if "cube_map" in plan.stages else ()
    arguments: list[Any] = [buffers[name] for name in names]
    took = seconds(runtime.run(kernel, min(workers, len(queue)), *arguments, grid, frame))
    add_counts(work, TILE_STAGES, _COUNTS, workers, took, stats)
    return took


def _run_rgss(work: Work) -> None:
    """Stage "rgss": the filter of eight samples, from what "resolve" kept of every pixel."""
    runtime, buffers, plan = work.runtime, work.buffers, work.plan
    kept = [buffers[name] for name in ("rgba", "depth", "seen")]
    width, height = plan.crop[2:]
    for name, size in (("rgba", 16), ("depth", 4), ("seen", 4)):
        buffers[name] = runtime.allocate(size * width * height, name)
    frame = frame_record(plan.crop, work.exposure.background)
    films = [buffers[name] for name in ("background", "rgba", "depth", "seen")]
    kernel = runtime.kernel("stochastic/rgss.cl", "rgss", plan.options)
    work.timings["rgss"] = seconds(runtime.run(kernel, height, *kept, *films, frame))
