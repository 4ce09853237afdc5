"""Run the kernels' functions alone: kernels in ``tests/wrappers`` include a stage's file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mbinterval.device import records
from mbinterval.device.kernel_effects import effect_options
from mbinterval.device.runtime import DeviceArray, Runtime, runtime, seconds
from mbinterval.errors import KernelBuildError
from mbinterval.plan.plan import Crop, Plan
from mbinterval.plan.prepare import Prepared, prepare
from mbinterval.rendering.analytic import render_analytic
from mbinterval.rendering.shared_steps import list_grid
from mbinterval.scene.model import Scene
from mbinterval.settings.settings import Settings

WRAPPERS = Path(__file__).resolve().parents[1] / "wrappers"

DEFAULTS = {"TILE": 16, "LAYERS": 1, "MASK_BITS": 128}
"""Sizes that the plan defines for a scene in motion, and LAYERS, which the wrappers' tiles have."""

POINT_SIZES = {"TILE": None, "LAYERS": None, "MASK_BITS": None}
"""The sizes that point sampling has."""


def options(*effects: str, **sizes: object) -> tuple[str, ...]:
    """Compiler options as a plan makes them; a size of None is left out."""
    named = {name: value for name, value in (DEFAULTS | sizes).items() if value is not None}
    masks = ("BIT_MASK",) if "MASK_BITS" in named else ()
    return (*effect_options((*effects, *masks)), *(f"-D{n}={v}" for n, v in named.items()))


def run(
    file: str | Path,
    kernel: str,
    arguments: Sequence[Any],
    defines: Sequence[str] = (),
    items: int = 1,
    clock: list[float] | None = None,
) -> list[np.ndarray]:
    """Run ``kernel`` of wrapper ``file`` (or of a file in ``cl``); returns every array argument.

    ``arguments`` come in the kernel's order. Arrays are copied to the device and back; what they
    hold is what an output buffer starts with. Numbers are passed by value, and so are records that
    the kernel takes so. ``clock`` gets the seconds that the kernel ran.
    """
    device = runtime()
    path = WRAPPERS / file if (WRAPPERS / file).exists() else file
    program = device.kernel(str(path), kernel, tuple(defines))
    passed, arrays = {}, []
    for (name, kind), argument in zip(program.parameters, arguments, strict=True):
        passed[name] = argument
        if kind.endswith("*"):
            passed[name] = filled(device, kind[:-1], argument)
            arrays.append((passed[name], argument))
    event = device.run(program, items, passed)
    if clock is not None:
        clock.append(seconds(event))
    return [fetched(device, there, array) for there, array in arrays]


def numbers(**fields: Any) -> np.ndarray:
    """``Numbers``, 0 where they are not given."""
    return records.pack("Numbers", **(dict.fromkeys(records.NUMBERS.names, 0) | fields))


def built(source: str, file: str, defines: Sequence[str]) -> Any:
    """The program of ``source``, built for what the compiler says of it: in a fifth of the time.

    What comes from a cache has no log, so it comes from none.
    """
    fresh = f"-DNOT_IN_ANY_CACHE={os.getpid()}"
    return runtime()._build(source, file, (*defines, fresh, "-cl-opt-disable")).program


def warns(file: str, defines: Sequence[str]) -> bool:
    """Whether the compiler warns of a file in ``cl``."""
    import pyopencl as cl

    program = built(f'#include "{file}"\n', file, defines)
    log = program.get_build_info(runtime().device, cl.program_build_info.LOG)
    return "warning" in log.lower()  # some devices tell of each step


def builds_without(
    of: Plan, names: Sequence[str], after: str, file: str = "analytic/tile.cl"
) -> bool:
    """Whether a plan's kernel builds when ``names`` must not be used past the header ``after``."""
    source = f'#include "{after}"\n#pragma GCC poison {" ".join(names)}\n#include "{file}"\n'
    try:
        built(source, file, of.options)
    except KernelBuildError as error:
        if "poisoned" not in str(error):
            raise
        return False
    return True


def filled(device: Runtime, kind: str, array: np.ndarray) -> DeviceArray:
    """A read-write array with a copy of ``array``."""
    import pyopencl as cl

    made = DeviceArray(device.allocate("uint", -(-array.nbytes // 4)).buffer, kind, array.nbytes)
    if array.nbytes:
        cl.enqueue_copy(device.queue, made.buffer, np.ascontiguousarray(array))
    return made


def fetched(device: Runtime, there: DeviceArray, like: np.ndarray) -> np.ndarray:
    """What is in ``there``, as ``like``."""
    import pyopencl as cl

    found = np.empty_like(like, order="C")
    if found.nbytes:
        cl.enqueue_copy(device.queue, found, there.buffer)
    return found


def vertices_of(points: np.ndarray) -> np.ndarray:
    """``Vertex`` records of homogeneous pixel points ``(..., 3)``, in the same order."""
    flat = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    table = np.zeros(len(flat), records.VERTEX)
    for name, column in zip("xyw", flat.T, strict=True):
        table[name] = column
    return table


def paths_of_points(points: np.ndarray, segments: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """``Vertex`` and ``Path`` records of points ``(P, 2, 3, 3)``: end, vertex, (x, y, w).

    Paths of ``segments`` segments are one triangle's, one after the other.
    """
    count = len(points)
    table = np.zeros(count, records.PATH)
    for corner, name in enumerate("abc"):
        table[name] = 6 * np.arange(count) + corner
    table["step"] = 3
    table["open"] = (np.arange(count) % segments) / segments
    table["close"] = (np.arange(count) % segments + 1) / segments
    return vertices_of(points), table


def slots_at(low: np.ndarray, high: np.ndarray | None = None) -> np.ndarray:
    """``Slot`` records of samples at ``low`` ``(n, 2)``, or anywhere from there to ``high``."""
    slots = np.zeros(len(low), records.SLOT)
    for ends, corner in (("low", low), ("high", low if high is None else high)):
        slots[f"x_{ends}"], slots[f"y_{ends}"] = np.asarray(corner).T
    return slots


def one_material(flags: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """``Mesh`` and ``Material`` records of one mesh without attributes."""
    mesh, material = np.zeros(1, records.MESH), np.zeros(1, records.MATERIAL)
    for name in ("uv", "normal", "color"):
        mesh[name] = records.NONE
    material["texture"], material["flags"] = records.NONE, flags
    return mesh, material


def shapes_of(vertices: np.ndarray, paths: np.ndarray, flags: int = 0) -> np.ndarray:
    """Stage "paths": the ``Shape`` of every path."""
    return shapes_and_depths(vertices, paths, flags)[0]


def shapes_and_depths(
    vertices: np.ndarray, paths: np.ndarray, flags: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Stage "paths" as exact paths need it: ``Shape`` and ``Depth`` of every path."""
    tables = [np.zeros(len(paths), record) for record in (records.SHAPE, records.DEPTH)]
    arguments = [vertices, paths, np.uint32(len(paths)), *one_material(flags), *tables]
    items = -(-len(paths) // 256)
    *_, shapes, depths = run("analytic/paths.cl", "paths", arguments, ["-DMB_EXACT"], items)
    return shapes, depths


def members_of(
    shapes: np.ndarray,
    size: tuple[int, int],
    tile: int = 16,
    chunk: int = 64,
    order: np.ndarray | None = None,
    places: tuple[float, float, float, float] = (0.0, 1.0, 0.0, 1.0),
) -> list[np.ndarray]:
    """Stage "bin": the paths of every tile of a frame of ``size``, row by row of tiles.

    ``places`` is the least and greatest x, and then y, of samples relative to their pixels.
    """
    columns, rows = -(-size[0] // tile), -(-size[1] // tile)
    grid = list_grid((0, 0, columns, rows), tile, len(shapes), chunk, places)
    tiles, chunks = columns * rows, -(-len(shapes) // chunk)
    order = np.arange(len(shapes)) if order is None else order
    given = [shapes, order.astype(np.uint32), grid]
    file, counts = "analytic/bin.cl", np.zeros(tiles * chunks, np.uint32)
    counts = run(file, "bin_count", [*given, counts], items=chunks)[-1]
    scan = [np.uint32(tiles), np.uint32(chunks), counts, np.zeros(tiles + 1, np.uint32)]
    counts, starts = run("shared/scan.cl", "bin_scan", scan)
    entries = np.zeros(starts[-1], np.uint32)
    entries = run(file, "bin_file", [*given, counts, entries], items=chunks)[-1]
    return np.split(entries, starts[1:-1])


def ready_for(
    scene: Scene,
    settings: Settings,
    width: int,
    height: int,
    crop: Crop | None = None,
    **changes: Any,
) -> Prepared:
    """Frame 1 as ``mbinterval.render`` makes it ready, its plan with ``changes``."""
    ready = prepare(scene, 1.0, width, height, settings, crop)
    return replace(ready, plan=replace(ready.plan, **changes))


def render_with(scene: Scene, settings: Settings, width: int, height: int, **changes: Any) -> Any:
    """Pixels of a render whose plan is made with ``changes``, such as ``capacity``."""
    return render_analytic(runtime(), ready_for(scene, settings, width, height, **changes))
