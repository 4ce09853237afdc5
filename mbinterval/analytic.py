"""The analytic path: visibility solved as time intervals.

    exact:        paths -> bin -> [nearest -> solve -> envelope (or mask) -> shade -> resolve]
    triangulated: paths -> bin -> [nearest -> rasterize -> intervals -> sort -> occlude
                                   -> shade -> resolve]              (Hong & Oh 2017)

Each word is a stage: a file in ``cl/analytic``, an entry in the plan, and a key of the timings.
The bracketed stages run fused, tile by tile, in one kernel (``tile.cl``), so that lists stay in
cache. Stages that the plan leaves out are not compiled.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.appearance import appearance, fit_background
from mbinterval.device import records
from mbinterval.device.runtime import Runtime, seconds
from mbinterval.errors import CapacityError
from mbinterval.motion import Motion
from mbinterval.plan import Plan, filter_of, shutter_keys, slots_of
from mbinterval.scene.exposure import Exposure

_log = logging.getLogger(__name__)

TILE_STAGES = (
    *("place", "nearest", "rasterize", "intervals", "sort", "occlude"),
    *("solve", "envelope", "mask", "shade", "resolve"),
)
"""Stages of the fused kernel, in the order in which it counts their time."""

_COUNTERS = (*TILE_STAGES, "tests", "hits")
_SHARED_ARGUMENTS = (
    *("vertices", "paths", "shapes", "meshes", "materials", "face_color", "color", "uv", "normal"),
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
_SAMPLE_WORDS, _PIXEL_VECTORS, _LANES = 14, 2, 16
_PATHS_PER_ITEM = 256
_BIN_CHUNKS = 64
_GROWTH = 4

Buffers = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Pixels:
    """What the kernels leave behind: arrays of the film's size, seconds by stage, and counts."""

    rgba: NDArray[np.float32]
    depth: NDArray[np.float32]
    intervals: NDArray[np.uint32]
    timings: Mapping[str, float]
    stats: Mapping[str, int]


def render_analytic(runtime: Runtime, exposure: Exposure, motion: Motion, plan: Plan) -> Pixels:
    """Render ``exposure``, laid out as ``motion``, by the stages of ``plan``."""
    timings: dict[str, float] = {}
    buffers = _upload(runtime, exposure, motion, plan)
    _run_paths(runtime, motion, plan, buffers, timings)
    _run_bin(runtime, motion, plan, buffers, timings)
    stats = _run_tiles(runtime, exposure, plan, buffers, timings)
    height, width = plan.crop[3], plan.crop[2]
    return Pixels(
        rgba=runtime.download(buffers["rgba"], (height, width, 4), np.float32),
        depth=runtime.download(buffers["depth"], (height, width), np.float32),
        intervals=runtime.download(buffers["met"], (height, width), np.uint32),
        timings=timings,
        stats=stats,
    )


def _upload(runtime: Runtime, exposure: Exposure, motion: Motion, plan: Plan) -> Buffers:
    shape = filter_of(plan.settings)
    looks = appearance(motion.materials, exposure.lights)
    background = np.zeros(0, np.float32)
    if "-DBACKGROUND_IMAGE" in plan.options:
        x, y, width, height = plan.crop
        image = fit_background(np.asarray(exposure.background), plan.width, plan.height)
        background = np.ascontiguousarray(image[y : y + height, x : x + width])
    arrays = {
        "positions": motion.positions,
        "jobs": motion.jobs,
        "cameras": motion.cameras,
        "paths": motion.paths,
        "meshes": motion.meshes,
        "face_color": motion.face_color,
        "color": motion.color,
        "uv": motion.uv,
        "normal": motion.normal,
        "materials": looks.materials,
        "textures": looks.textures,
        "texels": looks.texels,
        "lights": looks.lights,
        "slots": slots_of(plan.settings),
        "filter": np.zeros(0) if shape is None else shape.table.astype(np.float32),
        "shutter": shutter_keys(exposure.shutter),
        "background": background,
    }
    buffers: Buffers = {name: runtime.upload(array) for name, array in arrays.items()}
    buffers["light_count"], buffers["static_paths"] = len(looks.lights), motion.static_paths
    return buffers


def _run_paths(
    runtime: Runtime, motion: Motion, plan: Plan, buffers: Buffers, timings: dict[str, float]
) -> None:
    """Stage "paths": transform vertices, then find the shape of every path."""
    count = len(motion.paths)
    buffers["vertices"] = runtime.allocate(motion.vertex_count * records.VERTEX.itemsize)
    buffers["shapes"] = runtime.allocate(count * records.SHAPE.itemsize)
    buffers["depths"] = runtime.allocate(count * records.DEPTH.itemsize if plan.exact else 0)
    timings["paths"] = 0.0
    if count == 0:
        return
    file = "analytic/paths.cl"
    options = tuple(option for option in plan.options if option in ("-DEXACT", "-DLENS"))
    first = runtime.run(
        runtime.kernel(file, "vertices", options),
        len(motion.jobs),
        *(buffers[name] for name in ("jobs", "positions", "cameras", "vertices")),
    )
    second = runtime.run(
        runtime.kernel(file, "paths", options),
        -(-count // _PATHS_PER_ITEM),
        *(buffers["vertices"], buffers["paths"], np.uint32(count)),
        *(buffers[name] for name in ("meshes", "materials", "shapes", "depths")),
    )
    timings["paths"] = seconds(first) + seconds(second)


def _path_order(runtime: Runtime, motion: Motion, plan: Plan, buffers: Buffers) -> Any:
    """Order in which tiles list their paths: static ones first, exact ones from near to far."""
    count = len(motion.paths)
    order = np.arange(count, dtype=np.uint32)
    if plan.exact and count > motion.static_paths:
        shapes = runtime.download(buffers["shapes"], (count,), records.SHAPE)
        near = shapes["near"][motion.static_paths :]
        order[motion.static_paths :] = motion.static_paths + np.argsort(near, kind="stable")
    return runtime.upload(order)


def _tile_grid(plan: Plan) -> tuple[int, int, int, int]:
    """First pixel, and columns and rows, of the tiles that cover the crop.

    Tiles lie on multiples of their size in the frame.
    """
    x, y, width, height = plan.crop
    left, top = x // plan.tile * plan.tile, y // plan.tile * plan.tile
    columns = -(-(x + width - left) // plan.tile)
    return left, top, columns, -(-(y + height - top) // plan.tile)


def _run_bin(
    runtime: Runtime, motion: Motion, plan: Plan, buffers: Buffers, timings: dict[str, float]
) -> None:
    """Stage "bin": ``members`` of every tile, from ``starts[tile]`` to ``starts[tile + 1]``."""
    left, top, columns, rows = _tile_grid(plan)
    tiles, count = columns * rows, len(motion.paths)
    order = _path_order(runtime, motion, plan, buffers)
    chunk = max(1, -(-count // _BIN_CHUNKS))
    chunks = -(-count // chunk)
    slots = slots_of(plan.settings)
    reach = [
        float(pick(slots[f"{axis}_{end}"]))
        for axis in "xy"
        for end, pick in (("low", np.min), ("high", np.max))
    ]
    grid = _packed("iiiiiIIffff", left, top, columns, rows, plan.tile, count, chunk, *reach)
    counts = runtime.allocate(4 * chunks * tiles)
    buffers["starts"] = runtime.allocate(4 * (tiles + 1))
    file, shapes = "analytic/bin.cl", buffers["shapes"]
    events = []
    if chunks:
        events.append(
            runtime.run(runtime.kernel(file, "bin_count"), chunks, shapes, order, grid, counts)
        )
    scan = runtime.kernel(file, "bin_scan")
    events.append(
        runtime.run(scan, 1, np.uint32(tiles), np.uint32(chunks), counts, buffers["starts"])
    )
    starts = runtime.download(buffers["starts"], (tiles + 1,), np.uint32)
    buffers["members"] = runtime.allocate(4 * int(starts[-1]))
    if chunks:
        file_kernel = runtime.kernel(file, "bin_file")
        events.append(
            runtime.run(file_kernel, chunks, shapes, order, grid, counts, buffers["members"])
        )
    timings["bin"] = sum(seconds(event) for event in events)
    # Tiles with the most paths first: what is left for the end is short.
    buffers["order"] = np.argsort(-np.diff(starts.astype(np.int64)), kind="stable")


def _run_tiles(
    runtime: Runtime,
    exposure: Exposure,
    plan: Plan,
    buffers: Buffers,
    timings: dict[str, float],
) -> dict[str, int]:
    """Run the fused stages on all tiles, and on those that ran out of room again with more."""
    columns, rows, width, height = *_tile_grid(plan)[2:], *plan.crop[2:]
    workers = min(runtime.workers, columns * rows)
    samples = plan.layers * plan.tile**2
    buffers["next"] = runtime.allocate(4)
    buffers["failed"] = runtime.allocate(4 * columns * rows)
    buffers["samples"] = runtime.allocate(4 * _SAMPLE_WORDS * samples * workers)
    buffers["pixels"] = runtime.allocate(16 * _PIXEL_VECTORS * plan.tile**2 * workers)
    buffers["counters"] = runtime.allocate(8 * len(_COUNTERS) * workers)
    for name, size in (("rgba", 16), ("depth", 4), ("met", 4)):
        buffers[name] = runtime.allocate(size * width * height)
    queue = buffers.pop("order").astype(np.uint32)
    capacity, stats = plan.capacity, dict.fromkeys(("tests", "hits"), 0)
    timings |= {stage: 0.0 for stage in TILE_STAGES if stage in plan.stages}
    while len(queue):
        took = _run_queue(runtime, exposure, plan, buffers, queue, capacity, workers)
        counters = runtime.download(buffers["counters"], (workers, len(_COUNTERS)), np.uint64)
        counts = dict(zip(_COUNTERS, counters.sum(axis=0).tolist(), strict=True))
        ticks = sum(counts[stage] for stage in TILE_STAGES) or 1
        for stage in timings.keys() & TILE_STAGES:
            timings[stage] += took * counts[stage] / ticks
        for name in stats:
            stats[name] += counts[name]
        failed = runtime.download(buffers["failed"], (columns * rows,), np.uint32)
        queue = queue[failed[queue] != 0]
        if len(queue):
            capacity *= _GROWTH
            _log.info("%d tiles need larger pools: %d records each", len(queue), capacity)
            workers = _workers_that_fit(runtime, plan, capacity, min(workers, len(queue)))
    return stats if plan.exact and "solve" in plan.stages else {}


def _pools(plan: Plan) -> dict[str, np.dtype[np.void]]:
    """Pools of a work-item: record of each."""
    pools = _EXACT_POOLS if plan.exact else _TRIANGULATED_POOLS
    return {**pools, "spans": records.SPAN}


def _run_queue(
    runtime: Runtime,
    exposure: Exposure,
    plan: Plan,
    buffers: Buffers,
    queue: NDArray[np.uint32],
    capacity: int,
    workers: int,
) -> float:
    """Render the queued tiles once with pools of ``capacity`` records; returns seconds."""
    left, top, columns, rows = _tile_grid(plan)
    pools = _pools(plan)
    arguments = [*_SHARED_ARGUMENTS, *(["depths"] if plan.exact else []), *pools]
    for name, record in pools.items():
        padding = _LANES if name in ("sorting", "ordering") else 0
        buffers[name] = runtime.allocate(record.itemsize * (capacity + padding) * workers)
    buffers["queue"] = runtime.upload(queue)
    runtime.fill(buffers["next"], 4)
    runtime.fill(buffers["counters"], 8 * len(_COUNTERS) * workers)
    lights = buffers["light_count"]
    roll = exposure.roll
    rolling = (roll.start, roll.step, roll.length) if roll else (0.0, 0.0, 1.0)
    counts = len(queue), capacity, lights, buffers["static_paths"], plan.settings.seed
    grid = _packed("iiiiIIIIIfff", left, top, columns, rows, *counts, *rolling)
    constant = isinstance(exposure.background, tuple)
    frame = _packed("iiiifff", *plan.crop, *(exposure.background if constant else (0, 0, 0)))
    kernel = runtime.kernel("analytic/tile.cl", "tile", plan.options)
    event = runtime.run(kernel, workers, *(buffers[name] for name in arguments), grid, frame)
    return seconds(event)


def _workers_that_fit(runtime: Runtime, plan: Plan, capacity: int, workers: int) -> int:
    """Fewer work-items where the pools of all would not fit into the device's memory."""
    sizes = [record.itemsize * capacity for record in _pools(plan).values()]
    largest, total = max(sizes), sum(sizes)
    device = runtime.device
    fit = min(device.max_mem_alloc_size // largest, device.global_mem_size // 2 // total)
    if fit < 1:
        raise CapacityError(
            f"one row of a tile holds more than {capacity // _GROWTH} fragments, and device "
            f"{device.name.strip()!r} has no memory for more: use a smaller tile_size, fewer "
            "samples or fewer motion segments"
        )
    return min(workers, int(fit))


def _packed(kinds: str, *values: Any) -> NDArray[np.void]:
    """Pack a small argument record of 4-byte numbers: i, I or f each."""
    types = {"i": "i4", "I": "u4", "f": "f4"}
    record = np.zeros(1, [(f"value{i}", types[kind]) for i, kind in enumerate(kinds)])
    record[0] = values
    return record
