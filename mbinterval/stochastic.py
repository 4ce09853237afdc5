"""The stochastic path: visibility at point samples in time, place and lens.

    vertices -> bounds -> bin -> [scatter -> sample -> shade -> resolve] (-> rgss)

Each word is a stage: a file in ``cl/stochastic`` (``vertices`` is in ``cl/shared``), an entry in
the plan, and a key of the timings. The bracketed stages run fused, tile by tile, in one kernel.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.analytic import Pixels, upload_scene
from mbinterval.device import records
from mbinterval.device.runtime import Runtime, seconds
from mbinterval.errors import CapacityError
from mbinterval.motion import Motion
from mbinterval.plan import Plan
from mbinterval.sampling import slots_of
from mbinterval.scene.exposure import Exposure
from mbinterval.stochastic_plan import sample_count
from mbinterval.tiles import Work, frame_record, packed, tile_grid

TILE_STAGES = ("scatter", "sample", "shade", "resolve")
"""Stages of the fused kernel, in the order in which it counts their time."""

_COUNTERS = (*TILE_STAGES, "visited", "stage1", "tests", "hits")
_ARGUMENTS = (
    *("vertices", "paths", "bounds", "flat", "meshes", "materials", "color", "uv"),
    *("normal", "textures", "texels", "lights", "cameras", "slots", "filter", "shutter"),
    *("background", "starts", "members", "queue", "next", "samples", "pixels", "counters"),
    *("rgba", "depth", "seen"),
)
_PATHS_PER_ITEM = 256
_BIN_CHUNKS = 64
_SCRATCH_WORDS = 7
_SLAB = 256
_PIXEL_VECTORS = 8
_SECONDS_AT_A_TIME = 0.5
_FIRST_LOAD = 100_000


def render_stochastic(
    runtime: Runtime,
    exposure: Exposure,
    motion: Motion,
    plan: Plan,
    progress: Callable[[float], None] | None = None,
) -> Pixels:
    """Render ``exposure``, laid out as ``motion``, by the stages of ``plan``."""
    work = Work(runtime, plan, upload_scene(runtime, exposure, motion, plan), exposure)
    _run_vertices(work, motion)
    _run_bounds(work, motion)
    listed = _run_bin(work, motion)
    counts = _render_tiles(work, motion, listed, progress)
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


def _run_vertices(work: Work, motion: Motion) -> None:
    """Stage "vertices": homogeneous pixel space at the ends of every motion segment."""
    runtime, buffers = work.runtime, work.buffers
    size = motion.vertex_count * records.VERTEX.itemsize
    buffers["vertices"] = runtime.allocate(size, "vertices")
    work.timings["vertices"] = 0.0
    if len(motion.jobs):
        kernel = runtime.kernel("shared/vertices.cl", "vertices", _lens(work.plan))
        names = ("jobs", "positions", "cameras", "vertices")
        event = runtime.run(kernel, len(motion.jobs), *(buffers[name] for name in names))
        work.timings["vertices"] = seconds(event)


def _lens(plan: Plan) -> tuple[str, ...]:
    return tuple(option for option in plan.options if option == "-DLENS")


def _run_bounds(work: Work, motion: Motion) -> None:
    """Stage "bounds": depth, scale and constant colour of every path."""
    runtime, buffers, count = work.runtime, work.buffers, len(motion.paths)
    buffers["bounds"] = runtime.allocate(count * records.BOUNDS.itemsize, "bounds")
    buffers["flat"] = runtime.allocate((count + 1) * 16, "colours of paths")
    given = (buffers["vertices"], buffers["paths"], np.uint32(count))
    names = ("meshes", "materials")
    event = runtime.run(
        runtime.kernel("stochastic/bounds.cl", "bounds", _lens(work.plan)),
        max(-(-count // _PATHS_PER_ITEM), 1),
        *given,
        *(buffers[name] for name in names),
        *(np.int32(work.plan.width), np.int32(work.plan.height)),
        *(buffers["bounds"], buffers["flat"]),
    )
    work.timings["bounds"] = seconds(event)


def _run_bin(work: Work, motion: Motion) -> NDArray[np.int64]:
    """Stage "bin": ``members`` of every tile from near to far; returns how many each lists."""
    runtime, buffers, count = work.runtime, work.buffers, len(motion.paths)
    left, top, columns, rows = tile_grid(work.plan)
    tiles, chunk = columns * rows, max(1, -(-count // _BIN_CHUNKS))
    chunks = -(-count // chunk)
    grid = packed("iiiiIIff", left, top, columns, rows, count, chunk, *sample_reach(work.plan))
    counts = runtime.allocate(4 * chunks * tiles, "counts of paths by tile")
    buffers["starts"] = runtime.allocate(4 * (tiles + 1), "starts")
    bounds = runtime.download(buffers["bounds"], (count,), records.BOUNDS)
    order = np.argsort(bounds["near"], kind="stable").astype(np.uint32)
    names = ("vertices", "paths", "bounds")
    given = (*(buffers[name] for name in names), runtime.upload(order, "order"), grid, counts)
    file, events, options = "stochastic/bin.cl", [], _lens(work.plan)
    if chunks:
        kernel = runtime.kernel(file, "bin_count", options)
        events.append(runtime.run(kernel, chunks, *given))
    scan = runtime.kernel("shared/scan.cl", "bin_scan")
    numbers = np.uint32(tiles), np.uint32(chunks)
    events.append(runtime.run(scan, 1, *numbers, counts, buffers["starts"]))
    starts = runtime.download(buffers["starts"], (tiles + 1,), np.uint32)
    if starts[-1] == records.NONE:
        raise CapacityError(f"the {tiles} tiles list 2**32 paths or more; render in crops")
    buffers["members"] = runtime.allocate(4 * int(starts[-1]), "paths by tile")
    if chunks:
        kernel = runtime.kernel(file, "bin_file", options)
        events.append(runtime.run(kernel, chunks, *given, buffers["members"]))
    work.timings["bin"] = sum(seconds(event) for event in events)
    return np.asarray(np.diff(starts.astype(np.int64)))


def sample_reach(plan: Plan) -> tuple[float, float]:
    """Where samples may lie relative to their pixels, in x and in y: from and to."""
    slots = slots_of(plan.settings)
    low = min(float(slots["x_low"].min()), float(slots["y_low"].min()), 0.0)
    return low, max(float(slots["x_high"].max()), float(slots["y_high"].max()), 1.0)


def _render_tiles(
    work: Work,
    motion: Motion,
    listed: NDArray[np.int64],
    progress: Callable[[float], None] | None,
) -> dict[str, int]:
    """Run the fused stages on all tiles, those that list most first; returns counts.

    The device gets a fraction of a second's worth at a time, so that an interrupt is heard and
    progress is told.
    """
    workers = min(work.runtime.workers, len(listed))
    _allocate(work, workers)
    work.timings |= dict.fromkeys(TILE_STAGES, 0.0)
    counts = dict.fromkeys(_COUNTERS[len(TILE_STAGES) :], 0)
    queue = np.argsort(-listed, kind="stable").astype(np.uint32)
    until = np.cumsum((listed[queue] + 1) * sample_count(work.plan.settings))
    done, most = 0, float(_FIRST_LOAD)
    while done < len(queue):
        before = until[done - 1] if done else 0
        end = max(int(np.searchsorted(until, before + most, side="right")), done + 1)
        took = _run_part(work, motion, queue[done:end], workers, counts)
        load, done = float(until[end - 1] - before), end
        most = load * np.clip(_SECONDS_AT_A_TIME / max(took, 1e-6), 0.1, 4.0)
        if progress is not None:
            progress(done / len(queue))
    return counts if "-DSTATISTICS" in work.plan.options else {}


def scratch_bytes(plan: Plan) -> int:
    """Return the bytes of a worker's scratch: the samples and the pixels of a tile."""
    return (4 * _SCRATCH_WORDS * plan.layers + 16 * _PIXEL_VECTORS) * _SLAB


def _allocate(work: Work, workers: int) -> None:
    """Buffers of the film, and each worker's scratch."""
    width, height = work.plan.region[2:]
    kept = 4 if "rgss" in work.plan.stages else 1
    sizes = {
        "next": 4,
        "samples": 4 * _SCRATCH_WORDS * work.plan.layers * _SLAB * workers,
        "pixels": 16 * _PIXEL_VECTORS * _SLAB * workers,
        "counters": 8 * len(_COUNTERS) * workers,
        "rgba": 16 * kept * width * height,
        "depth": 4 * kept * width * height,
        "seen": 4 * width * height,
    }
    for name, size in sizes.items():
        work.buffers[name] = work.runtime.allocate(size, name)


def _run_part(
    work: Work, motion: Motion, queue: NDArray[np.uint32], workers: int, counts: dict[str, int]
) -> float:
    """Render the queued tiles; returns seconds."""
    runtime, buffers, plan = work.runtime, work.buffers, work.plan
    left, top, columns, rows = tile_grid(plan)
    buffers["queue"] = runtime.upload(queue, "queue")
    runtime.fill(buffers["next"], 4)
    runtime.fill(buffers["counters"], 8 * len(_COUNTERS) * workers)
    roll, background = work.exposure.roll, work.exposure.background
    rolling = (roll.start, roll.step, roll.length) if roll else (0.0, 0.0, 1.0)
    numbers = len(queue), len(motion.paths), buffers["light_count"], plan.settings.seed
    size = (plan.width, plan.height)
    grid = packed(
        *("iiiiIIIIfffffii", left, top, columns, rows, *numbers),
        *(*rolling, *sample_reach(plan), *size),
    )
    frame = frame_record(plan.region, background)
    kernel = runtime.kernel("stochastic/tile.cl", "tile", plan.options)
    arguments: list[Any] = [buffers[name] for name in _ARGUMENTS]
    took = seconds(runtime.run(kernel, min(workers, len(queue)), *arguments, grid, frame))
    counted = runtime.download(buffers["counters"], (workers, len(_COUNTERS)), np.uint64)
    sums = dict(zip(_COUNTERS, counted.sum(axis=0).tolist(), strict=True))
    ticks = sum(sums[stage] for stage in TILE_STAGES) or 1
    for stage in TILE_STAGES:
        work.timings[stage] += took * sums[stage] / ticks
    for name in counts:
        counts[name] += sums[name]
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
