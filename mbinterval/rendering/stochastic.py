"""The stochastic path: visibility at point samples in time, place and lens.

    vertices -> bounds -> bin (-> shadow_map) -> [scatter -> sample -> shade -> resolve] (-> rgss)

Each word is a stage: a file in ``cl/stochastic`` (``vertices`` is in ``cl/shared``, and ``sample``
is one of the culling methods in ``cl/stochastic/cull``), an entry in the plan, and a key of the
timings. The bracketed stages run fused, tile by tile, in one kernel.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from mbinterval.device import records
from mbinterval.device.runtime import Runtime, seconds
from mbinterval.layout.motion import Motion
from mbinterval.plan.buffers import scratch, scratch_bytes
from mbinterval.plan.prepare import Prepared
from mbinterval.plan.sampling import reach_of, sample_count
from mbinterval.rendering.shadow_tree import prepare_rays
from mbinterval.rendering.shared_steps import (
    PATHS_PER_ITEM,
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


def render_stochastic(
    runtime: Runtime,
    ready: Prepared,
    progress: Callable[[float], None] | None = None,
) -> Pixels:
    """Render a frame by the stages of its plan."""
    work, motion, plan = start_work(runtime, ready), ready.motion, ready.plan
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
    options, items = work.plan.flags("GLOSSY"), -(-count // PATHS_PER_ITEM)
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


def _allocate(work: Work, workers: int) -> None:
    """Buffers of the film, and each worker's scratch."""
    width, height = work.plan.region[2:]
    kept = 4 if "rgss" in work.plan.stages else 1
    for name, (kind, count) in scratch(work.plan).items():
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
