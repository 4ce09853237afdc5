"""The analytic path: visibility solved as time intervals.

    exact:        paths -> bin -> [place -> nearest -> solve -> envelope (or mask, or stack)
                                   -> shadow -> shade -> record -> moment -> resolve] -> share
    triangulated: paths -> bin -> [place -> nearest -> rasterize -> intervals -> sort -> occlude
                                   -> shade -> record -> moment -> resolve] -> share
                                                                               (Hong & Oh 2017)

Each word is a stage: a file in ``cl/analytic``, an entry in the plan, and a key of the timings.
Cube maps (``cube_map``, in ``cl/shared``) are made before, if the plan asks for them.
The bracketed stages run fused, tile by tile, in one kernel (``tile.cl``, ``tiles.py``), so that
lists stay in cache. Stages that the plan leaves out are not compiled.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.device import records
from mbinterval.device.runtime import DeviceArray, Runtime, seconds
from mbinterval.film.aovs import plane_count, split_planes
from mbinterval.layout.motion import Motion
from mbinterval.plan.prepare import Prepared
from mbinterval.plan.sampling import reach_of
from mbinterval.rendering.recorder import Recorder, collectors_of
from mbinterval.rendering.shadows import prepare_shadows
from mbinterval.rendering.shared_steps import (
    PATHS_PER_ITEM,
    Pixels,
    Work,
    frame_record,
    list_paths,
    start_work,
    transform_vertices,
)
from mbinterval.rendering.tiles import render_tiles


def render_analytic(
    runtime: Runtime,
    ready: Prepared,
    progress: Callable[[float], None] | None = None,
) -> Pixels:
    """Render a frame by the stages of its plan.

    ``progress`` is called now and then with the fraction of the tiles that are done.
    """
    work, motion, plan = start_work(runtime, ready), ready.motion, ready.plan
    _run_paths(work, motion)
    listed = _run_bin(work, motion)
    if "shadow" in plan.stages:
        prepare_shadows(work, motion)
    takers = collectors_of(work, motion)
    recorder = Recorder(work, tuple(takers.values())) if takers else None
    stats = render_tiles(work, listed, progress, recorder)
    if "share" in plan.stages:
        work.timings["share"] = 0.0
        for name in ("rgba", "sharp"):
            if name in work.arrays:
                _run_share(work, name)
    left, top = plan.crop[0] - plan.region[0], plan.crop[1] - plan.region[1]
    part = np.s_[top : top + plan.crop[3], left : left + plan.crop[2]]
    region = plan.region[3], plan.region[2]
    made = {name: taker.result() for name, taker in takers.items()}
    deep, events = made.pop("deep", None), made.pop("events", None)
    return Pixels(
        rgba=runtime.download(work.arrays["rgba"], (plan.crop[3], plan.crop[2], 4), np.float32),
        depth=runtime.download(work.arrays["depth"], region, np.float32)[part],
        intervals=runtime.download(work.arrays["met"], region, np.uint32)[part],
        layers=_layers(work, motion, part) | made,
        deep=deep,
        events=events,
        timings=work.timings,
        stats=stats,
    )


def _layers(work: Work, motion: Motion, part: tuple[slice, slice]) -> dict[str, NDArray[Any]]:
    """Layers that were asked for; ``part`` of the region is the film."""
    plan, runtime = work.plan, work.runtime
    found: dict[str, NDArray[Any]] = {}
    if "sharp" in work.arrays:
        size = plan.crop[3], plan.crop[2], 4
        found["sharp"] = runtime.download(work.arrays["sharp"], size, np.float32)
    if "planes" in work.arrays:
        size = plane_count(plan.settings.aovs), plan.region[3], plan.region[2]
        planes = runtime.download(work.arrays["planes"], size, np.uint32)
        found |= split_planes(plan.settings.aovs, planes[:, *part])
    if "object" in found:
        found["object"] = motion.objects[found["object"]]
    return found


def _run_paths(work: Work, motion: Motion) -> None:
    """Stage "paths": transform vertices, then find the shape of every path."""
    count = len(motion.paths)
    work.timings["paths"] = transform_vertices(work, motion)
    work.allocate("Shape", "shapes", count)
    work.allocate("Depth", "depths", count if work.plan.exact else 0)
    if count == 0:
        return
    options = work.plan.flags("EXACT", "GLOSSY", "LENS")
    items = -(-count // PATHS_PER_ITEM)
    event = work.run("analytic/paths.cl", "paths", options, items, count=count)
    work.timings["paths"] += seconds(event)


def _path_order(work: Work, motion: Motion) -> DeviceArray:
    """Order in which tiles list their paths: static ones first, from near to far.

    Moving ones are listed from near to far too if they are exact; others as they come.
    """
    static, count = motion.static_paths, len(motion.paths)
    order = np.arange(count, dtype=np.uint32)
    if count:
        near = work.runtime.download(work.arrays["shapes"], (count,), records.SHAPE)["near"]
        order[:static] = np.argsort(near[:static], kind="stable")
        if work.plan.exact:
            order[static:] = static + np.argsort(near[static:], kind="stable")
    return work.runtime.upload("uint", order, "order")


def _run_bin(work: Work, motion: Motion) -> NDArray[np.int64]:
    """Stage "bin": the paths that each tile lists; returns how many."""
    order, reach = _path_order(work, motion), reach_of(work.plan.settings)
    return list_paths(work, "analytic/bin.cl", (), order, len(motion.paths), reach)


def _run_share(work: Work, name: str) -> None:
    """Stage "share": a film from the values at the centres of the region's pixels."""
    plan, background, centres = work.plan, work.exposure.background, work.arrays.pop(name)
    work.allocate("float4", name, plan.crop[2] * plan.crop[3])
    event = work.run(
        *("analytic/share.cl", "share", plan.options, plan.crop[3]),
        centres=centres,
        given=frame_record(plan.region, background),
        film=frame_record(plan.crop, background),
        shared=work.arrays[name],
    )
    work.timings["share"] += seconds(event)
