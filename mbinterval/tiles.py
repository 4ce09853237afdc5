"""The fused stages of the analytic path: tiles from a queue, and what to do when pools run full."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from mbinterval.device import records
from mbinterval.device.runtime import seconds
from mbinterval.errors import CapacityError
from mbinterval.plan import Plan
from mbinterval.record import EVENTS_FULL, POOLS_FULL, Recorder
from mbinterval.work import (
    CUBE_MAPS,
    Work,
    add_counts,
    frame_record,
    in_parts,
    layer_bytes,
    memory_room,
    packed,
    tile_grid,
)

_log = logging.getLogger(__name__)

TILE_STAGES = (
    *("place", "nearest", "rasterize", "intervals", "sort", "occlude"),
    *("solve", "envelope", "mask", "stack", "shadow", "shade", "record", "moment", "resolve"),
)
"""Stages of the fused kernel, in the order in which it counts their time."""

_COUNTS = ("tests", "hits")
_ARGUMENTS = (
    *("vertices", "paths", "shapes", "meshes", "materials", "color", "uv", "normal"),
    *("textures", "texels", "lights", "cameras", "slots", "filter", "shutter", "background"),
    *("starts", "members", "queue", "next", "failed", "samples", "pixels", "counters"),
    *("rgba", "depth", "met"),
)
_LAYERS = ("sharp", "planes", "forward", "backward")  # those that are asked for
_SHADOWS = (
    *("world", "shadow_lights", "light_views", "light_starts", "light_members", "outlines"),
    *("stamps", "path_count"),
)
_EXACT_POOLS = {
    "visits": records.VISIT,
    "fronts": records.FRONT,
    "merged": records.FRONT,
    "ordering": records.ORDERING,
}
_TRIANGULATED_POOLS = {
    "fragments": records.FRAGMENT,
    "intervals": records.INTERVAL,
    "sorting": records.SORTING,
    "sorted": records.INTERVAL,
}
_PIXEL_VECTORS = 2
LANES = 16
"""Records that every pool has beyond its capacity, for whole vectors to be written."""
_GROWTH = 4
_LEAST_CAPACITY = 4096


def render_tiles(
    work: Work,
    listed: NDArray[np.int64],
    progress: Callable[[float], None] | None,
    recorder: Recorder | None = None,
) -> dict[str, int]:
    """Run the fused stages on all tiles, and again on those that ran out of room.

    ``listed`` is the number of paths that each tile lists. Tiles with the most come first, so
    that what is left for the end is short. Visible spans go to the ``recorder``. Returns counts:
    ``tests`` and ``hits`` of exact paths, those of attempts that were repeated too.
    """
    queue = np.argsort(-listed, kind="stable").astype(np.uint32)
    loads = (listed + 1) * work.plan.settings.samples
    workers = min(work.runtime.workers, len(queue))
    _allocate(work, workers)
    if recorder is not None:
        recorder.allocate()
    capacity, workers = _first_pools(work, workers)
    stats = dict.fromkeys(_COUNTS, 0)
    work.timings |= {stage: 0.0 for stage in TILE_STAGES if stage in work.plan.stages}
    while len(queue):
        _allocate_pools(work, capacity, workers)
        render = partial(
            _run_part, work, capacity=capacity, workers=workers, stats=stats, recorder=recorder
        )
        for done in in_parts(queue, loads[queue], render):
            if progress is not None:
                progress((len(listed) - len(queue) + done) / len(listed))
        failed = work.runtime.download(work.buffers["failed"], listed.shape, np.uint32)[queue]
        if recorder is not None and (failed == EVENTS_FULL).any():
            some_fitted = bool((failed != EVENTS_FULL).any())
            if not recorder.make_room(some_fitted, alone=workers == 1):
                workers = 1
        queue = queue[failed != 0]
        if (failed == POOLS_FULL).any():
            capacity *= _GROWTH
            _log.info("%d tiles need larger pools: %d records each", len(queue), capacity)
            workers = _workers_that_fit(work, capacity, min(workers, len(queue)))
    return stats if work.plan.exact and "solve" in work.plan.stages else {}


def _allocate(work: Work, workers: int) -> None:
    """Buffers of the film, and of the scratch that does not depend on the pools' capacity."""
    _, _, columns, rows = tile_grid(work.plan)
    width, height = work.plan.region[2:]
    asked = work.plan.settings.aovs
    pixels = work.plan.tile**2 * workers
    sizes = {
        "next": 4,
        "failed": 4 * columns * rows,
        "samples": 4 * _sample_words(work.plan) * work.plan.layers * pixels,
        "pixels": 16 * (_PIXEL_VECTORS + ("sharp" in asked)) * pixels,
        "counters": 8 * len(TILE_STAGES + _COUNTS) * workers,
        "rgba": 16 * width * height,
        "depth": 4 * width * height,
        "met": 4 * width * height,
        **layer_bytes(work.plan),
    }
    if "shadow" in work.plan.stages:
        sizes["stamps"] = 4 * int(work.buffers["path_count"]) * workers
    for name, size in sizes.items():
        work.buffers[name] = work.runtime.allocate(size, name)


def _sample_words(plan: Plan) -> int:
    """Words of scratch for each sample: ``SAMPLE_WORDS`` of ``cl/analytic/tile.h``."""
    glossy = 2 if "GLOSSY" in plan.active else 0
    return 18 + glossy + ("operations" in plan.settings.aovs)


def pools(plan: Plan) -> dict[str, np.dtype[np.void]]:
    """Pools of a work-item: record of each."""
    kinds = _EXACT_POOLS if plan.exact else _TRIANGULATED_POOLS
    if "shadow" in plan.stages:
        return {**kinds, "steps": records.STEP, "spans": records.SHADED_SPAN}
    return {**kinds, "spans": records.SPAN}


def _allocate_pools(work: Work, capacity: int, workers: int) -> None:
    for name in pools(work.plan):
        work.buffers.pop(name, None)  # the smaller ones go before larger ones come
    for name, record in pools(work.plan).items():
        size = record.itemsize * (capacity + LANES) * workers
        work.buffers[name] = work.runtime.allocate(size, f"pool of {name}")


def _run_part(
    work: Work,
    queue: NDArray[np.uint32],
    capacity: int,
    workers: int,
    stats: dict[str, int],
    recorder: Recorder | None,
) -> float:
    """Render the queued tiles with pools as they are; returns seconds, for `in_parts`."""
    runtime, buffers, plan = work.runtime, work.buffers, work.plan
    left, top, columns, rows = tile_grid(plan)
    buffers["queue"] = runtime.upload(queue, "queue")
    runtime.fill(buffers["next"], 4)
    runtime.fill(buffers["counters"], 8 * len(TILE_STAGES + _COUNTS) * workers)
    roll, background = work.exposure.roll, work.exposure.background
    rolling = (roll.start, roll.step, roll.length) if roll else (0.0, 0.0, 1.0)
    counts = len(queue), capacity, buffers["light_count"], buffers["static_paths"]
    grid = packed("iiiiIIIIIfff", left, top, columns, rows, *counts, plan.settings.seed, *rolling)
    frame = frame_record(plan.region, background)
    layers = [name for name in _LAYERS if name in buffers]
    names = [*_ARGUMENTS, *layers, *(("depths",) if plan.exact else ()), *pools(plan)]
    if "shadow" in plan.stages:
        names[-2:-2] = _SHADOWS
        runtime.fill(buffers["stamps"], 4 * int(buffers["path_count"]) * workers)
    names += CUBE_MAPS if "cube_map" in plan.stages else ()
    kernel = runtime.kernel("analytic/tile.cl", "tile", plan.options)
    arguments = [buffers[name] for name in names]
    if recorder is not None:
        arguments += recorder.arguments()
    took = seconds(runtime.run(kernel, min(workers, len(queue)), *arguments, grid, frame))
    add_counts(work, TILE_STAGES, _COUNTS, workers, took, stats)
    return took if recorder is None else max(took, recorder.drain(queue))


def _first_pools(work: Work, workers: int) -> tuple[int, int]:
    """Capacity of the first pools, and work-items; less where memory is short."""
    capacity, room = work.plan.capacity, memory_room(work)
    while capacity > _LEAST_CAPACITY and _pool_bytes(work.plan, capacity) * workers > room:
        capacity //= 2
    return capacity, _workers_that_fit(work, capacity, workers)


def _pool_bytes(plan: Plan, capacity: int) -> int:
    """Bytes of the pools of a work-item."""
    return sum(record.itemsize for record in pools(plan).values()) * (capacity + LANES)


def least_pools(plan: Plan) -> int:
    """Bytes of the smallest pools that a render begins with, for one work-item."""
    return _pool_bytes(plan, min(plan.capacity, _LEAST_CAPACITY))


def _workers_that_fit(work: Work, capacity: int, workers: int) -> int:
    """Fewer work-items where the pools of all would not fit into the memory that there is."""
    most = max(record.itemsize for record in pools(work.plan).values()) * (capacity + LANES)
    device, room = work.runtime.device, memory_room(work, besides=pools(work.plan))
    fit = min(device.max_mem_alloc_size // most, room // _pool_bytes(work.plan, capacity))
    if fit >= 1:
        return min(workers, int(fit))
    if work.plan.memory is not None:
        raise CapacityError(
            f"the pools of a tile take {_pool_bytes(work.plan, capacity) / 2**20:.1f} MiB, and "
            f"{max(room, 0) / 2**20:.1f} MiB of the memory that is allowed are left: allow more, "
            "or use a smaller tile_size, fewer samples, or crops"
        )
    raise CapacityError(
        f"one row of a tile holds more than {capacity // _GROWTH} intervals, and device "
        f"{device.name.strip()!r} has no memory for more: use a smaller tile_size, fewer "
        "samples or fewer motion segments"
    )
