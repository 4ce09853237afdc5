"""The analytic path: visibility solved as time intervals.

    exact:        paths -> bin -> [place -> nearest -> solve -> envelope (or mask)
                                   -> shade -> resolve] -> share
    triangulated: paths -> bin -> [place -> nearest -> rasterize -> intervals -> sort -> occlude
                                   -> shade -> resolve] -> share     (Hong & Oh 2017)

Each word is a stage: a file in ``cl/analytic``, an entry in the plan, and a key of the timings.
The bracketed stages run fused, tile by tile, in one kernel (``tile.cl``, ``tiles.py``), so that
lists stay in cache. Stages that the plan leaves out are not compiled.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.appearance import appearance, fit_background
from mbinterval.device import records
from mbinterval.device.runtime import Runtime, seconds
from mbinterval.errors import CapacityError
from mbinterval.motion import Motion
from mbinterval.plan import Plan, shutter_keys
from mbinterval.sampling import filter_of, slots_of
from mbinterval.scene.exposure import Exposure
from mbinterval.tiles import Work, frame_record, packed, render_tiles, tile_grid

_PATHS_PER_ITEM = 256
_BIN_CHUNKS = 64


@dataclass(frozen=True, eq=False)
class Pixels:
    """What the kernels leave behind: arrays of the film's size, seconds by stage, and counts."""

    rgba: NDArray[np.float32]
    depth: NDArray[np.float32]
    intervals: NDArray[np.uint32]
    timings: Mapping[str, float]
    stats: Mapping[str, int]


def render_analytic(
    runtime: Runtime,
    exposure: Exposure,
    motion: Motion,
    plan: Plan,
    progress: Callable[[float], None] | None = None,
) -> Pixels:
    """Render ``exposure``, laid out as ``motion``, by the stages of ``plan``.

    ``progress`` is called now and then with the fraction of the tiles that are done.
    """
    work = Work(runtime, plan, upload_scene(runtime, exposure, motion, plan), exposure)
    _run_paths(work, motion)
    listed = _run_bin(work, motion)
    stats = render_tiles(work, listed, progress)
    if "share" in plan.stages:
        _run_share(work)
    left, top = plan.crop[0] - plan.region[0], plan.crop[1] - plan.region[1]
    part = np.s_[top : top + plan.crop[3], left : left + plan.crop[2]]
    region = plan.region[3], plan.region[2]
    return Pixels(
        rgba=runtime.download(work.buffers["rgba"], (plan.crop[3], plan.crop[2], 4), np.float32),
        depth=runtime.download(work.buffers["depth"], region, np.float32)[part],
        intervals=runtime.download(work.buffers["met"], region, np.uint32)[part],
        timings=work.timings,
        stats=stats,
    )


def upload_scene(
    runtime: Runtime, exposure: Exposure, motion: Motion, plan: Plan
) -> dict[str, Any]:
    """Buffers of everything that the kernels read, and a few counts."""
    shape = filter_of(plan.settings)
    # Lights are placed relative to the eye, so that they are as exact far from the origin.
    looks = appearance(motion.materials, exposure.lights, exposure.cameras[0].eye[0])
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
    buffers: dict[str, Any] = {}
    for name, array in arrays.items():
        buffers[name] = runtime.upload(array, name)
    buffers["light_count"], buffers["static_paths"] = len(looks.lights), motion.static_paths
    return buffers


def _run_paths(work: Work, motion: Motion) -> None:
    """Stage "paths": transform vertices, then find the shape of every path."""
    runtime, buffers, count = work.runtime, work.buffers, len(motion.paths)
    sizes = {
        "vertices": motion.vertex_count * records.VERTEX.itemsize,
        "shapes": count * records.SHAPE.itemsize,
        "depths": count * records.DEPTH.itemsize if work.plan.exact else 0,
    }
    for name, size in sizes.items():
        buffers[name] = runtime.allocate(size, name)
    work.timings["paths"] = 0.0
    if count == 0:
        return
    file = "analytic/paths.cl"
    options = tuple(option for option in work.plan.options if option in ("-DEXACT", "-DLENS"))
    first = runtime.run(
        runtime.kernel("shared/vertices.cl", "vertices", options),
        len(motion.jobs),
        *(buffers[name] for name in ("jobs", "positions", "cameras", "vertices")),
    )
    second = runtime.run(
        runtime.kernel(file, "paths", options),
        -(-count // _PATHS_PER_ITEM),
        *(buffers["vertices"], buffers["paths"], np.uint32(count)),
        *(buffers[name] for name in ("meshes", "materials", "shapes", "depths")),
    )
    work.timings["paths"] = seconds(first) + seconds(second)


def _path_order(work: Work, motion: Motion) -> Any:
    """Order in which tiles list their paths: static ones first, from near to far.

    Moving ones are listed from near to far too if they are exact; others as they come.
    """
    static, count = motion.static_paths, len(motion.paths)
    order = np.arange(count, dtype=np.uint32)
    if count:
        near = work.runtime.download(work.buffers["shapes"], (count,), records.SHAPE)["near"]
        order[:static] = np.argsort(near[:static], kind="stable")
        if work.plan.exact:
            order[static:] = static + np.argsort(near[static:], kind="stable")
    return work.runtime.upload(order, "order")


def _run_bin(work: Work, motion: Motion) -> NDArray[np.int64]:
    """Stage "bin": ``members`` of every tile, from ``starts[tile]`` to ``starts[tile + 1]``.

    Returns how many each lists.
    """
    runtime, buffers, plan = work.runtime, work.buffers, work.plan
    left, top, columns, rows = tile_grid(plan)
    tiles, count = columns * rows, len(motion.paths)
    chunk = max(1, -(-count // _BIN_CHUNKS))
    chunks = -(-count // chunk)
    grid = packed(
        "iiiiiIIffff", left, top, columns, rows, plan.tile, count, chunk, *_sample_reach(plan)
    )
    counts = runtime.allocate(4 * chunks * tiles, "counts of paths by tile")
    buffers["starts"] = runtime.allocate(4 * (tiles + 1), "starts")
    given = buffers["shapes"], _path_order(work, motion), grid, counts
    file, events = "analytic/bin.cl", []
    if chunks:
        events.append(runtime.run(runtime.kernel(file, "bin_count"), chunks, *given))
    scan = runtime.kernel("shared/scan.cl", "bin_scan")
    numbers = np.uint32(tiles), np.uint32(chunks)
    events.append(runtime.run(scan, 1, *numbers, counts, buffers["starts"]))
    starts = runtime.download(buffers["starts"], (tiles + 1,), np.uint32)
    if starts[-1] == records.NONE:
        raise CapacityError(
            f"the {tiles} tiles list 2**32 paths or more; render in crops, or with a larger "
            "tile_size"
        )
    buffers["members"] = runtime.allocate(4 * int(starts[-1]), "paths by tile")
    if chunks:
        file_kernel = runtime.kernel(file, "bin_file")
        events.append(runtime.run(file_kernel, chunks, *given, buffers["members"]))
    work.timings["bin"] = sum(seconds(event) for event in events)
    return np.asarray(np.diff(starts.astype(np.int64)))


def _run_share(work: Work) -> None:
    """Stage "share": the film from the values at the centres of the region's pixels."""
    runtime, plan, background = work.runtime, work.plan, work.exposure.background
    film = runtime.allocate(16 * plan.crop[2] * plan.crop[3], "rgba")
    kernel = runtime.kernel("analytic/share.cl", "share", plan.options)
    frames = [frame_record(part, background) for part in (plan.region, plan.crop)]
    event = runtime.run(
        kernel, plan.crop[3], work.buffers["rgba"], *frames, work.buffers["background"], film
    )
    work.timings["share"] = seconds(event)
    work.buffers["rgba"] = film


def _sample_reach(plan: Plan) -> tuple[float, ...]:
    """Where samples may lie relative to their pixels: x from and to, y from and to."""
    slots = slots_of(plan.settings)
    return tuple(
        float(pick(slots[f"{axis}_{end}"]))
        for axis in "xy"
        for end, pick in (("low", np.min), ("high", np.max))
    )
