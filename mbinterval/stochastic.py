"""The stochastic path: visibility at point samples in time, place and lens.

    vertices -> bounds -> bin (-> shadow_map) -> [scatter -> sample -> shade -> resolve] (-> rgss)

Each word is a stage: a file in ``cl/stochastic`` (``vertices`` is in ``cl/shared``), an entry in
the plan, and a key of the timings. The bracketed stages run fused, tile by tile, in one kernel.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

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
    Pixels,
    Work,
    add_counts,
    frame_record,
    grid_record,
    in_parts,
    list_paths,
    memory_room,
    shadow_count,
    start_work,
    transform_vertices,
)

TILE_STAGES = ("scatter", "sample", "shade", "resolve")
"""Stages of the fused kernel, in the order in which it counts their time."""

_COUNTS = (
    *("bounded", "visited", "stage1", "tests", "hits", "depth_tests"),
    *("texels", "texel_lines"),
)
_SAMPLE_SCRATCH = {
    **dict.fromkeys(("sample_x", "sample_y", "sample_t", "sample_u", "sample_v"), "float"),
    **{"sample_depth": "float", "sample_owner": "uint"},
}
_GLOSSY_SCRATCH = {"sample_a": "float", "sample_b": "float"}
_MIRROR_SCRATCH = {"sample_mirror_depth": "float", "sample_mirror_owner": "uint"}
_PIXEL_SCRATCH = {"pixel_color": "float4", "pixel_depth": "float", "pixel_seen": "uint"}
_SIGNED_SCRATCH = {
    **{"pixel_signed_color": "float4", "pixel_signed_depth": "float", "pixel_signs": "float"},
}
_KEPT_SCRATCH = {"kept_color": "float4", "kept_depth": "float"}
_PATHS_PER_ITEM = 256
_SLAB = 256


def render_stochastic(
    runtime: Runtime,
    exposure: Exposure,
    motion: Motion,
    plan: Plan,
    progress: Callable[[float], None] | None = None,
) -> Pixels:
    """Render ``exposure``, laid out as ``motion``, by the stages of ``plan``."""
    work = start_work(runtime, exposure, motion, plan)
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
        rgba=runtime.download(work.arrays["rgba"], (height, width, 4), np.float32),
        depth=runtime.download(work.arrays["depth"], (height, width), np.float32),
        intervals=runtime.download(work.arrays["seen"], (height, width), np.uint32),
        timings=work.timings,
        stats=counts,
    )


def _run_bounds(work: Work, motion: Motion) -> None:
    """Stage "bounds": depth and scale of every path, and whether it can be seen."""
    count = len(motion.paths)
    work.allocate("Bounds", "bounds", count)
    work.timings["bounds"] = 0.0
    if count == 0:
        return
    options, items = work.plan.flags("GLOSSY"), -(-count // _PATHS_PER_ITEM)
    event = work.run("stochastic/bounds.cl", "bounds", options, items)
    work.timings["bounds"] = seconds(event)


def _run_bin(work: Work, motion: Motion) -> NDArray[np.int64]:
    """Stage "bin": the paths that each tile lists, from near to far; returns how many."""
    runtime, count = work.runtime, len(motion.paths)
    bounds = runtime.download(work.arrays["bounds"], (count,), records.BOUNDS)
    order = np.argsort(bounds["near"], kind="stable").astype(np.uint32)
    options, reach = work.plan.flags("GLOSSY", "LENS"), reach_of(work.plan.settings)
    listed = runtime.upload("uint", order, "order")
    return list_paths(work, "stochastic/bin.cl", options, listed, count, reach)


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
    return sum(records.element(kind).itemsize * count for kind, count in _scratch(plan).values())


def _scratch(plan: Plan) -> dict[str, tuple[str, int]]:
    """Return the scratch arrays by name: kind, and how many elements each worker has."""
    samples, pixels = plan.layers * _SLAB, _SLAB
    asked = [
        (_SAMPLE_SCRATCH, True, samples),
        (_GLOSSY_SCRATCH, "GLOSSY" in plan.active, samples),
        (_MIRROR_SCRATCH, "MIRRORS" in plan.active, samples),
        (_PIXEL_SCRATCH, True, pixels),
        (_SIGNED_SCRATCH, "WEIGHTED" in plan.active, pixels),
        (_KEPT_SCRATCH, "PATTERN_RGSS" in plan.active, pixels * sample_count(plan.settings)),
    ]
    return {
        name: (kind, count)
        for arrays, there, count in asked
        if there
        for name, kind in arrays.items()
    }


def _allocate(work: Work, workers: int) -> None:
    """Buffers of the film, and each worker's scratch."""
    width, height = work.plan.region[2:]
    kept = 4 if "rgss" in work.plan.stages else 1
    for name, (kind, count) in _scratch(work.plan).items():
        work.allocate(kind, name, count * workers)
    work.allocate("uint", "next", 1)
    work.allocate("ulong", "counters", len(TILE_STAGES + _COUNTS) * workers)
    work.allocate("float4", "rgba", kept * width * height)
    work.allocate("float", "depth", kept * width * height)
    work.allocate("uint", "seen", width * height)


def _run_part(work: Work, queue: NDArray[np.uint32], workers: int, stats: dict[str, int]) -> float:
    """Render the queued tiles; returns seconds."""
    plan = work.plan
    work.upload("uint", "queue", queue)
    work.runtime.fill(work.arrays["next"])
    work.runtime.fill(work.arrays["counters"])
    event = work.run(
        *("stochastic/tile.cl", "tile", plan.options, min(workers, len(queue))),
        grid=grid_record(plan, len(queue)),
        frame=frame_record(plan.region, work.exposure.background),
    )
    took = seconds(event)
    add_counts(work, TILE_STAGES, _COUNTS, workers, took, stats)
    return took


def _run_rgss(work: Work) -> None:
    """Stage "rgss": the filter of eight samples, from what "resolve" kept of every pixel."""
    plan = work.plan
    colors, depths, seen = (work.arrays.pop(name) for name in ("rgba", "depth", "seen"))
    width, height = plan.crop[2:]
    for name, kind in (("rgba", "float4"), ("depth", "float"), ("seen", "uint")):
        work.allocate(kind, name, width * height)
    event = work.run(
        *("stochastic/rgss.cl", "rgss", plan.options, height),
        colors=colors,
        depths=depths,
        kept_seen=seen,
        frame=frame_record(plan.crop, work.exposure.background),
    )
    work.timings["rgss"] = seconds(event)
