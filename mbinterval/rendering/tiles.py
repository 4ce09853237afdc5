"""The fused stages of the analytic path: tiles from a queue, and what to do when pools run full."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from mbinterval.device.runtime import seconds
from mbinterval.errors import CapacityError
from mbinterval.film.aovs import plane_count
from mbinterval.plan.buffers import (
    LANES,
    LEAST_CAPACITY,
    pool_bytes,
    pools,
    record_bytes,
    scratch,
    tile_grid,
)
from mbinterval.rendering.recorder import EVENTS_FULL, POOLS_FULL, Recorder
from mbinterval.rendering.shared_steps import (
    Work,
    add_counts,
    frame_record,
    grid_record,
    in_parts,
    memory_room,
)

_log = logging.getLogger(__name__)

TILE_STAGES = (
    *("place", "nearest", "rasterize", "intervals", "sort", "occlude"),
    *("solve", "envelope", "mask", "stack", "shadow", "shade", "record", "moment", "resolve"),
)
"""Stages of the fused kernel, in the order in which it counts their time."""

_COUNTS = ("tests", "hits")
_GROWTH = 4


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
        failed = work.runtime.download(work.arrays["failed"], listed.shape, np.uint32)[queue]
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
    """Make the film, and the scratch that does not depend on the pools' capacity."""
    plan = work.plan
    _, _, columns, rows = tile_grid(plan)
    pixels, asked = plan.region[2] * plan.region[3], plan.settings.aovs
    work.allocate("uint", "next", 1)
    work.allocate("uint", "failed", columns * rows)
    work.allocate("ulong", "counters", len(TILE_STAGES + _COUNTS) * workers)
    work.allocate("float4", "rgba", pixels)
    work.allocate("float", "depth", pixels)
    work.allocate("uint", "met", pixels)
    if "sharp" in asked:
        work.allocate("float4", "sharp", pixels)
    if plane_count(asked):
        work.allocate("uint", "planes", pixels * plane_count(asked))
    for name, (kind, count) in scratch(plan).items():
        work.allocate(kind, name, count * workers)
    if "shadow" in plan.stages:
        work.allocate("uint", "path_stamps", work.numbers["path_count"] * workers)


def _allocate_pools(work: Work, capacity: int, workers: int) -> None:
    for name in pools(work.plan):
        work.arrays.pop(name, None)  # the smaller ones go before larger ones come
    for name, kind in pools(work.plan).items():
        work.allocate(kind, name, (capacity + LANES) * workers, f"pool of {name}")


def _run_part(
    work: Work,
    queue: NDArray[np.uint32],
    capacity: int,
    workers: int,
    stats: dict[str, int],
    recorder: Recorder | None,
) -> float:
    """Render the queued tiles with pools as they are; returns seconds, for `in_parts`."""
    runtime, plan = work.runtime, work.plan
    work.upload("uint", "queue", queue)
    for name in ("next", "counters", *(("path_stamps",) if "shadow" in plan.stages else ())):
        runtime.fill(work.arrays[name])
    if recorder is not None:
        recorder.empty()
    event = work.run(
        *("analytic/tile.cl", "tile", plan.options, min(workers, len(queue))),
        grid=grid_record(plan, len(queue), capacity, recorder.capacity if recorder else 0),
        frame=frame_record(plan.region, work.exposure.background),
    )
    took = seconds(event)
    add_counts(work, TILE_STAGES, _COUNTS, workers, took, stats)
    return took if recorder is None else max(took, recorder.drain(queue))


def _first_pools(work: Work, workers: int) -> tuple[int, int]:
    """Capacity of the first pools, and work-items; less where memory is short."""
    capacity, room = work.plan.capacity, memory_room(work)
    while capacity > LEAST_CAPACITY and pool_bytes(work.plan, capacity) * workers > room:
        capacity //= 2
    return capacity, _workers_that_fit(work, capacity, workers)


def _workers_that_fit(work: Work, capacity: int, workers: int) -> int:
    """Fewer work-items where the pools of all would not fit into the memory that there is."""
    most = max(record_bytes(work.plan).values()) * (capacity + LANES)
    device, room = work.runtime.device, memory_room(work, besides=pools(work.plan))
    fit = min(device.max_mem_alloc_size // most, room // pool_bytes(work.plan, capacity))
    if fit >= 1:
        return min(workers, int(fit))
    if work.plan.memory is not None:
        raise CapacityError(
            f"the pools of a tile take {pool_bytes(work.plan, capacity) / 2**20:.1f} MiB, and "
            f"{max(room, 0) / 2**20:.1f} MiB of the memory that is allowed are left: allow more, "
            "or use a smaller tile_size, fewer samples, or crops"
        )
    raise CapacityError(
        f"one row of a tile holds more than {capacity // _GROWTH} intervals, and device "
        f"{device.name.strip()!r} has no memory for more: use a smaller tile_size, fewer "
        "samples or fewer motion segments"
    )
