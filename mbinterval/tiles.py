"""The fused stages of the analytic path: tiles from a queue, and what to do when pools run full."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.device import records
from mbinterval.device.runtime import Runtime, seconds
from mbinterval.errors import CapacityError
from mbinterval.plan import Crop, Plan
from mbinterval.scene.exposure import Exposure

_log = logging.getLogger(__name__)

TILE_STAGES = (
    *("place", "nearest", "rasterize", "intervals", "sort", "occlude"),
    *("solve", "envelope", "mask", "shade", "resolve"),
)
"""Stages of the fused kernel, in the order in which it counts their time."""

_COUNTERS = (*TILE_STAGES, "tests", "hits")
_ARGUMENTS = (
    *("vertices", "paths", "shapes", "meshes", "materials", "color", "uv", "normal"),
    *("textures", "texels", "lights", "cameras", "slots", "filter", "shutter", "background"),
    *("starts", "members", "queue", "next", "failed", "samples", "pixels", "counters"),
    *("rgba", "depth", "met"),
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
_SAMPLE_WORDS, _PIXEL_VECTORS, _LANES = 18, 2, 16
_GROWTH = 4
_SECONDS_AT_A_TIME = 0.5
_FIRST_LOAD = 100_000  # paths of tiles times samples: a fifth of a second, more or less


@dataclass(eq=False)
class Work:
    """A frame in work: the plan, the device's buffers by name, and seconds by stage so far."""

    runtime: Runtime
    plan: Plan
    buffers: dict[str, Any]
    exposure: Exposure
    timings: dict[str, float] = field(default_factory=dict)


def tile_grid(plan: Plan) -> tuple[int, int, int, int]:
    """Return the first pixel, and columns and rows, of the tiles that cover the region.

    Tiles lie on multiples of their size in the frame.
    """
    x, y, width, height = plan.region
    left, top = x // plan.tile * plan.tile, y // plan.tile * plan.tile
    columns = -(-(x + width - left) // plan.tile)
    return left, top, columns, -(-(y + height - top) // plan.tile)


def render_tiles(
    work: Work, listed: NDArray[np.int64], progress: Callable[[float], None] | None
) -> dict[str, int]:
    """Run the fused stages on all tiles, and again on those that ran out of room.

    ``listed`` is the number of paths that each tile lists. Tiles with the most come first, so
    that what is left for the end is short. Returns counts: ``tests`` and ``hits`` of exact paths,
    those of attempts that were repeated too.
    """
    queue = np.argsort(-listed, kind="stable").astype(np.uint32)
    loads = (listed + 1) * work.plan.settings.samples
    workers = min(work.runtime.workers, len(queue))
    _allocate(work, workers)
    capacity, stats = work.plan.capacity, dict.fromkeys(("tests", "hits"), 0)
    work.timings |= {stage: 0.0 for stage in TILE_STAGES if stage in work.plan.stages}
    while len(queue):
        _allocate_pools(work, capacity, workers)
        for done in _render_parts(work, queue, loads[queue], capacity, workers, stats):
            if progress is not None:
                progress((len(listed) - len(queue) + done) / len(listed))
        failed = work.runtime.download(work.buffers["failed"], listed.shape, np.uint32)
        queue = queue[failed[queue] != 0]
        if len(queue):
            capacity *= _GROWTH
            _log.info("%d tiles need larger pools: %d records each", len(queue), capacity)
            workers = _workers_that_fit(work, capacity, min(workers, len(queue)))
    return stats if work.plan.exact and "solve" in work.plan.stages else {}


def _allocate(work: Work, workers: int) -> None:
    """Buffers of the film, and of the scratch that does not depend on the pools' capacity."""
    _, _, columns, rows = tile_grid(work.plan)
    width, height = work.plan.region[2:]
    pixels = work.plan.tile**2 * workers
    sizes = {
        "next": 4,
        "failed": 4 * columns * rows,
        "samples": 4 * _SAMPLE_WORDS * work.plan.layers * pixels,
        "pixels": 16 * _PIXEL_VECTORS * pixels,
        "counters": 8 * len(_COUNTERS) * workers,
        "rgba": 16 * width * height,
        "depth": 4 * width * height,
        "met": 4 * width * height,
    }
    for name, size in sizes.items():
        work.buffers[name] = work.runtime.allocate(size, name)


def _render_parts(
    work: Work,
    queue: NDArray[np.uint32],
    loads: NDArray[np.int64],
    capacity: int,
    workers: int,
    stats: dict[str, int],
) -> Iterator[int]:
    """Render the queue with pools of ``capacity``; yields how many of its tiles are done.

    The device gets a fraction of a second's worth at a time, so that an interrupt is heard and
    progress is told.
    """
    until, done, most = np.cumsum(loads), 0, float(_FIRST_LOAD)
    while done < len(queue):
        before = until[done - 1] if done else 0
        end = max(int(np.searchsorted(until, before + most, side="right")), done + 1)
        took = _run_part(work, queue[done:end], capacity, workers, stats)
        load, done = float(until[end - 1] - before), end
        most = load * np.clip(_SECONDS_AT_A_TIME / max(took, 1e-6), 0.1, 4.0)
        yield done


def _pools(plan: Plan) -> dict[str, np.dtype[np.void]]:
    """Pools of a work-item: record of each."""
    pools = _EXACT_POOLS if plan.exact else _TRIANGULATED_POOLS
    return {**pools, "spans": records.SPAN}


def _allocate_pools(work: Work, capacity: int, workers: int) -> None:
    for name in _pools(work.plan):
        work.buffers.pop(name, None)  # the smaller ones go before larger ones come
    for name, record in _pools(work.plan).items():
        size = record.itemsize * (capacity + _LANES) * workers
        work.buffers[name] = work.runtime.allocate(size, f"pool of {name}")


def _run_part(
    work: Work, queue: NDArray[np.uint32], capacity: int, workers: int, stats: dict[str, int]
) -> float:
    """Render the queued tiles with pools as they are; returns seconds."""
    runtime, buffers, plan = work.runtime, work.buffers, work.plan
    left, top, columns, rows = tile_grid(plan)
    buffers["queue"] = runtime.upload(queue, "queue")
    runtime.fill(buffers["next"], 4)
    runtime.fill(buffers["counters"], 8 * len(_COUNTERS) * workers)
    roll, background = work.exposure.roll, work.exposure.background
    rolling = (roll.start, roll.step, roll.length) if roll else (0.0, 0.0, 1.0)
    counts = len(queue), capacity, buffers["light_count"], buffers["static_paths"]
    grid = packed("iiiiIIIIIfff", left, top, columns, rows, *counts, plan.settings.seed, *rolling)
    frame = frame_record(plan.region, background)
    names = (*_ARGUMENTS, *(("depths",) if plan.exact else ()), *_pools(plan))
    kernel = runtime.kernel("analytic/tile.cl", "tile", plan.options)
    arguments = [buffers[name] for name in names]
    took = seconds(runtime.run(kernel, min(workers, len(queue)), *arguments, grid, frame))
    counted = runtime.download(buffers["counters"], (workers, len(_COUNTERS)), np.uint64)
    sums = dict(zip(_COUNTERS, counted.sum(axis=0).tolist(), strict=True))
    ticks = sum(sums[stage] for stage in TILE_STAGES) or 1
    for stage in work.timings.keys() & TILE_STAGES:
        work.timings[stage] += took * sums[stage] / ticks
    for name in stats:
        stats[name] += sums[name]
    return took


def _workers_that_fit(work: Work, capacity: int, workers: int) -> int:
    """Fewer work-items where the pools of all would not fit into the device's memory."""
    sizes = [record.itemsize * (capacity + _LANES) for record in _pools(work.plan).values()]
    device = work.runtime.device
    fit = min(device.max_mem_alloc_size // max(sizes), device.global_mem_size // 2 // sum(sizes))
    if fit < 1:
        raise CapacityError(
            f"one row of a tile holds more than {capacity // _GROWTH} intervals, and device "
            f"{device.name.strip()!r} has no memory for more: use a smaller tile_size, fewer "
            "samples or fewer motion segments"
        )
    return min(workers, int(fit))


def frame_record(region: Crop, background: Any) -> NDArray[np.void]:
    """Return the ``Frame`` of a part of the frame, over a colour or an image ``background``."""
    constant = background if isinstance(background, tuple) else (0.0, 0.0, 0.0)
    return packed("iiiifff", *region, *constant)


def packed(kinds: str, *values: Any) -> NDArray[np.void]:
    """Pack a small argument record of 4-byte numbers: i, I or f each."""
    types = {"i": "i4", "I": "u4", "f": "f4"}
    record = np.zeros(1, [(f"value{i}", types[kind]) for i, kind in enumerate(kinds)])
    record[0] = values
    return record
