"""The analytic path: visibility solved as time intervals (Hong & Oh 2017).

    paths -> bin -> [nearest -> rasterize -> intervals -> sort -> occlude -> shade -> resolve]

Each word is a stage: a file in ``cl/analytic``, an entry in the plan, and a key of the timings.
The bracketed stages run fused, tile by tile, in one kernel (``tile.cl``), so that lists stay in
cache.
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
from mbinterval.plan import Plan
from mbinterval.sampling import fixed_pattern
from mbinterval.scene.exposure import Exposure

_log = logging.getLogger(__name__)

TILE_STAGES = ("nearest", "rasterize", "intervals", "sort", "occlude", "shade", "resolve")
"""Stages of the fused kernel, in the order in which it counts their time."""

_TILE_ARGUMENTS = (
    ("vertices", "paths", "shapes", "meshes", "materials", "face_color", "color", "uv", "normal")
    + ("textures", "texels", "lights", "cameras", "offsets", "background")
    + ("starts", "members", "queue", "next", "failed")
    + ("fragments", "intervals", "sorting", "sorted", "spans", "samples", "pixels", "ticks")
    + ("rgba", "depth", "met")
)
_POOLS = {
    "fragments": records.FRAGMENT,
    "intervals": records.INTERVAL,
    "sorted": records.INTERVAL,
    "spans": records.SPAN,
}
_SAMPLE_WORDS, _PIXEL_VECTORS, _SORT_ARRAYS, _LANES = 8, 2, 9, 16
_PATHS_PER_ITEM = 256
_BIN_CHUNKS = 64
_GROWTH = 4

Buffers = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Pixels:
    """What the kernels leave behind: arrays of the film's size, and seconds by stage."""

    rgba: NDArray[np.float32]
    depth: NDArray[np.float32]
    intervals: NDArray[np.uint32]
    timings: Mapping[str, float]


def render_analytic(runtime: Runtime, exposure: Exposure, motion: Motion, plan: Plan) -> Pixels:
    """Render ``exposure``, laid out as ``motion``, by the stages of ``plan``."""
    timings: dict[str, float] = {}
    buffers = _upload(runtime, exposure, motion, plan)
    _run_paths(runtime, motion, buffers, timings)
    _run_bin(runtime, len(motion.paths), plan, buffers, timings)
    _run_tiles(runtime, exposure, plan, buffers, timings)
    height, width = plan.crop[3], plan.crop[2]
    return Pixels(
        rgba=runtime.download(buffers["rgba"], (height, width, 4), np.float32),
        depth=runtime.download(buffers["depth"], (height, width), np.float32),
        intervals=runtime.download(buffers["met"], (height, width), np.uint32),
        timings=timings,
    )


def _upload(runtime: Runtime, exposure: Exposure, motion: Motion, plan: Plan) -> Buffers:
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
        "offsets": fixed_pattern(plan.samples),
        "background": background,
    }
    buffers: Buffers = {name: runtime.upload(array) for name, array in arrays.items()}
    buffers["light_count"] = len(looks.lights)
    return buffers


def _run_paths(
    runtime: Runtime, motion: Motion, buffers: Buffers, timings: dict[str, float]
) -> None:
    """Stage "paths": transform vertices, then find the shape of every path."""
    count = len(motion.paths)
    buffers["vertices"] = runtime.allocate(motion.vertex_count * records.VERTEX.itemsize)
    buffers["shapes"] = runtime.allocate(count * records.SHAPE.itemsize)
    timings["paths"] = 0.0
    if count == 0:
        return
    file = "analytic/paths.cl"
    first = runtime.run(
        runtime.kernel(file, "vertices"),
        len(motion.jobs),
        *(buffers[name] for name in ("jobs", "positions", "cameras", "vertices")),
    )
    second = runtime.run(
        runtime.kernel(file, "paths"),
        -(-count // _PATHS_PER_ITEM),
        *(buffers["vertices"], buffers["paths"], np.uint32(count)),
        *(buffers[name] for name in ("meshes", "materials", "shapes")),
    )
    timings["paths"] = seconds(first) + seconds(second)


def _tile_grid(plan: Plan) -> tuple[int, int, int, int]:
    """First pixel, and columns and rows, of the tiles that cover the crop.

    Tiles lie on multiples of their size in the frame.
    """
    x, y, width, height = plan.crop
    left, top = x // plan.tile * plan.tile, y // plan.tile * plan.tile
    columns = -(-(x + width - left) // plan.tile)
    return left, top, columns, -(-(y + height - top) // plan.tile)


def _run_bin(
    runtime: Runtime, count: int, plan: Plan, buffers: Buffers, timings: dict[str, float]
) -> None:
    """Stage "bin": ``members`` of every tile, from ``starts[tile]`` to ``starts[tile + 1]``."""
    left, top, columns, rows = _tile_grid(plan)
    tiles = columns * rows
    chunk = max(1, -(-count // _BIN_CHUNKS))
    chunks = -(-count // chunk)
    grid = _packed("iiiiiII", left, top, columns, rows, plan.tile, count, chunk)
    counts = runtime.allocate(4 * chunks * tiles)
    buffers["starts"] = runtime.allocate(4 * (tiles + 1))
    file, shapes = "analytic/bin.cl", buffers["shapes"]
    events = []
    if chunks:
        events.append(runtime.run(runtime.kernel(file, "bin_count"), chunks, shapes, grid, counts))
    scan = runtime.kernel(file, "bin_scan")
    events.append(
        runtime.run(scan, 1, np.uint32(tiles), np.uint32(chunks), counts, buffers["starts"])
    )
    starts = runtime.download(buffers["starts"], (tiles + 1,), np.uint32)
    buffers["members"] = runtime.allocate(4 * int(starts[-1]))
    if chunks:
        file_kernel = runtime.kernel(file, "bin_file")
        events.append(runtime.run(file_kernel, chunks, shapes, grid, counts, buffers["members"]))
    timings["bin"] = sum(seconds(event) for event in events)
    # Tiles with the most paths first: what is left for the end is short.
    buffers["order"] = np.argsort(-np.diff(starts.astype(np.int64)), kind="stable")


def _run_tiles(
    runtime: Runtime,
    exposure: Exposure,
    plan: Plan,
    buffers: Buffers,
    timings: dict[str, float],
) -> None:
    """Run the fused stages on all tiles, and on those that ran out of room again with more."""
    columns, rows, width, height = *_tile_grid(plan)[2:], *plan.crop[2:]
    workers = min(runtime.workers, columns * rows)
    samples = plan.layers * plan.tile**2
    buffers["next"] = runtime.allocate(4)
    buffers["failed"] = runtime.allocate(4 * columns * rows)
    buffers["samples"] = runtime.allocate(4 * _SAMPLE_WORDS * samples * workers)
    buffers["pixels"] = runtime.allocate(16 * _PIXEL_VECTORS * plan.tile**2 * workers)
    buffers["ticks"] = runtime.allocate(8 * len(TILE_STAGES) * workers)
    for name, size in (("rgba", 16), ("depth", 4), ("met", 4)):
        buffers[name] = runtime.allocate(size * width * height)
    queue = buffers.pop("order").astype(np.uint32)
    capacity = plan.capacity
    for stage in TILE_STAGES:
        timings[stage] = 0.0
    while len(queue):
        _run_queue(runtime, exposure, plan, buffers, timings, queue, capacity, workers)
        failed = runtime.download(buffers["failed"], (columns * rows,), np.uint32)
        queue = queue[failed[queue] != 0]
        if len(queue):
            capacity *= _GROWTH
            _log.info("%d tiles need larger pools: %d records each", len(queue), capacity)
            workers = _workers_that_fit(runtime, capacity, min(workers, len(queue)))
    for stage in TILE_STAGES:
        if stage not in plan.stages:
            del timings[stage]


def _run_queue(
    runtime: Runtime,
    exposure: Exposure,
    plan: Plan,
    buffers: Buffers,
    timings: dict[str, float],
    queue: NDArray[np.uint32],
    capacity: int,
    workers: int,
) -> None:
    """Render the queued tiles once with pools of ``capacity`` records."""
    left, top, columns, rows = _tile_grid(plan)
    for name, record in _POOLS.items():
        buffers[name] = runtime.allocate(record.itemsize * capacity * workers)
    buffers["sorting"] = runtime.allocate(4 * _SORT_ARRAYS * (capacity + _LANES) * workers)
    buffers["queue"] = runtime.upload(queue)
    runtime.fill(buffers["next"], 4)
    runtime.fill(buffers["ticks"], 8 * len(TILE_STAGES) * workers)
    lights = buffers["light_count"]
    grid = _packed("iiiiIII", left, top, columns, rows, len(queue), capacity, lights)
    constant = isinstance(exposure.background, tuple)
    frame = _packed("iiiifff", *plan.crop, *(exposure.background if constant else (0, 0, 0)))
    kernel = runtime.kernel("analytic/tile.cl", "tile", plan.options)
    event = runtime.run(kernel, workers, *(buffers[name] for name in _TILE_ARGUMENTS), grid, frame)
    took = seconds(event)
    ticks = runtime.download(buffers["ticks"], (workers, len(TILE_STAGES)), np.uint64).sum(axis=0)
    for stage, count in zip(TILE_STAGES, ticks.tolist(), strict=True):
        timings[stage] += took * count / max(int(ticks.sum()), 1)


def _workers_that_fit(runtime: Runtime, capacity: int, workers: int) -> int:
    """Fewer work-items where the pools of all would not fit into the device's memory."""
    largest = max(record.itemsize for record in _POOLS.values()) * capacity
    total = sum(record.itemsize for record in _POOLS.values()) * capacity
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
