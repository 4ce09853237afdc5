"""Lights as cameras: which paths each light that casts shadows may see in each tile of its view.

A directional light sees the scene in parallel, within the bounds of all vertices; a spot light up
to ``_WIDEST_CONE`` degrees wide through one frustum; other lights through the six faces of a cube.
The stages "paths" and "bin" find what may lie in a tile, as they do for the camera, and tiles list
paths from near to far.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.device import records
from mbinterval.device.runtime import DeviceArray, seconds
from mbinterval.layout.appearance import casting
from mbinterval.rendering.shared_steps import PATHS_PER_ITEM, Lists, Work, check_members

if TYPE_CHECKING:
    from mbinterval.layout.motion import Motion
    from mbinterval.scene.model import Light

Float64 = NDArray[np.float64]

_WIDEST_CONE = 60.0
_SIZES = (256, 8)  # of a view in tiles along its edge, at most and at least
_MEMBERS = 1 << 22  # paths that the tiles of a view list together, more or less
_MARGIN = 1.001  # of a view beyond what it is for
_ROUNDING = 1e-3  # of a tile: more than planes in float32 are wrong by


def world_positions(motion: Motion, origin: Float64) -> Float64:
    """Return where the vertices that paths name are in the world, from ``origin``: ``(n, 3)``.

    What is seen in mirrors is where it is mirrored from.
    """
    places = np.zeros((motion.vertex_count, 3))
    for job in motion.world_jobs:
        first, start, count = int(job["output"]), int(job["input"]), int(job["count"])
        places[first : first + count] = motion.positions[start : start + count] - origin
    return places


def casters_of(motion: Motion) -> NDArray[np.uint32]:
    """Return the paths that may stand in the light: all but what is seen in mirrors."""
    reflected = motion.meshes["world"][motion.paths["mesh"]] > 0
    return np.flatnonzero(~reflected).astype(np.uint32)


def world_vertices(places: Float64) -> NDArray[np.void]:
    """``Vertex`` records of ``places`` ``(n, 3)``; the third coordinate is ``w``."""
    vertices = np.zeros(len(places), records.VERTEX)
    for name, column in zip("xyw", places.T, strict=True):
        vertices[name] = column
    return vertices


@dataclass(frozen=True, eq=False)
class View:
    """What a light sees: rows of ``matrix`` ``(4, 4)`` map (point, 1) to x w, y w, w and depth.

    What it is for has x and y in [0, 1]; that is ``width`` wide at depth 1, or at any depth where
    the view is parallel. The ray through x, y starts at ``start @ (1, x, y)``, at depth ``near``,
    and goes along ``way @ (1, x, y)``, by which depth grows by 1; both are ``(3, 3)``.
    """

    matrix: Float64
    width: float
    start: Float64
    way: Float64
    near: float


def views_of(light: Light, origin: Float64, places: Float64) -> list[View]:
    """Return the views of a light, of points relative to ``origin``; ``places`` are all of them."""
    if light.kind == "directional":
        return [_parallel_view(np.asarray(light.direction), places)]
    at = np.asarray(light.position, np.float64) - origin
    if light.kind == "spot" and light.outer_angle <= _WIDEST_CONE:
        reach = _MARGIN * np.tan(np.radians(light.outer_angle))
        return [_frustum(at, np.asarray(light.direction), reach)]
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    return [_frustum(at, axis, _MARGIN) for axis in axes]


def _basis(forward: Float64) -> Float64:
    """Three orthonormal rows, the last along ``forward``."""
    forward = forward / np.linalg.norm(forward)
    across = np.cross(forward, np.eye(3)[np.argmin(np.abs(forward))])
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(forward, across), forward])


def _frustum(at: Float64, forward: Float64, reach: float) -> View:
    """Return the view from ``at`` that sees ``reach`` to each side at distance 1."""
    across, down, depth = _basis(forward)
    rows = np.stack([0.5 * (across / reach + depth), 0.5 * (down / reach + depth), depth, depth])
    way = np.stack([depth - reach * (across + down), 2 * reach * across, 2 * reach * down], axis=1)
    start = np.stack([at, np.zeros(3), np.zeros(3)], axis=1)
    matrix = np.concatenate([rows, -(rows @ at)[:, None]], axis=1)
    return View(matrix, 2.0 * reach, start, way, 0.0)


def _parallel_view(forward: Float64, places: Float64) -> View:
    """Return the view along ``forward`` of the bounds of ``places``."""
    basis = _basis(forward)
    found = places @ basis.T
    low, high = found.min(axis=0), found.max(axis=0)
    middle = 0.5 * (low + high)
    size = _MARGIN * np.where(high > low, high - low, 1.0)
    rows = np.zeros((4, 4))
    rows[:2, :3] = basis[:2] / size[:2, None]
    rows[:2, 3] = 0.5 - middle[:2] / size[:2]
    rows[2, 3] = 1.0
    rows[3, :3] = basis[2]
    # Rays begin before all there is.
    near = low[2] - 0.001 * size[2]
    corner = basis.T @ [*(middle[:2] - 0.5 * size[:2]), near]
    start = np.stack([corner, size[0] * basis[0], size[1] * basis[1]], axis=1)
    way = np.stack([basis[2], np.zeros(3), np.zeros(3)], axis=1)
    return View(rows, float(max(size[:2])), start, way, float(near))


def prepare_shadows(work: Work, motion: Motion) -> None:
    """Make the buffers that the stage "shadow" reads; stages "paths" and "bin" take longer by it.

    ``world`` has the vertices, ``shadow_lights`` and ``light_views`` what casts shadows and how it
    sees the scene, ``light_starts``, ``light_members`` and ``outlines`` what it sees.
    """
    exposure = work.exposure
    origin = np.asarray(exposure.path.opening.eye[0])
    places = world_positions(motion, origin)
    lights = [exposure.lights[index] for index in casting(exposure, work.plan.settings)]
    seen = [views_of(light, origin, places) if len(places) else [] for light in lights]
    flat = [view for views in seen for view in views]
    table = np.zeros(len(flat), records.LIGHT_VIEW)
    starts: list[NDArray[np.uint32]] = []
    members: list[NDArray[np.uint32]] = []
    outlines: list[NDArray[np.void]] = []
    listed = first = 0
    for row, (view, found) in zip(table, _listed(work, motion, places, flat), strict=True):
        row["matrix"] = scaled(view, found.size)
        row["size"], row["starts"] = found.size, first
        row["paths"] = len(outlines) * len(motion.paths)
        starts.append(found.starts + np.uint32(listed))
        members.append(found.members)
        outlines.append(found.outlines)
        listed += len(found.members)
        check_members(work, 4 * listed + sum(table.nbytes for table in outlines))
        first += len(found.starts)
    work.upload("Vertex", "world", world_vertices(places))
    work.upload("ShadowLight", "shadow_lights", light_table(lights, seen, origin))
    work.upload("LightView", "light_views", table)
    work.upload("uint", "light_starts", _joined(starts, np.uint32))
    work.upload("uint", "light_members", _joined(members, np.uint32))
    work.upload("Outline", "outlines", _joined(outlines, records.OUTLINE))


def scaled(view: View, size: int) -> Float64:
    """Return the view's matrix row by row, for ``size`` tiles along an edge."""
    return np.asarray((view.matrix * [[size], [size], [1], [1]]).ravel())


def light_table(lights: list[Light], seen: list[list[View]], origin: Float64) -> NDArray[np.void]:
    """Return ``ShadowLight`` records; views are numbered in the order of ``seen``."""
    table = np.zeros(len(lights), records.SHADOW_LIGHT)
    first = 0
    for row, light, views in zip(table, lights, seen, strict=True):
        row["finite"] = light.kind != "directional"
        if light.kind == "directional":
            direction = np.asarray(light.direction, np.float64)
            row["vector"] = -direction / np.linalg.norm(direction)
        else:
            row["origin"] = np.asarray(light.position) - origin
        row["view"], row["views"] = first, len(views)
        first += len(views)
    return table


@dataclass(frozen=True, eq=False)
class _Listed:
    """Paths by tile of a view of ``size`` tiles by ``size``, and where each path may be seen."""

    size: int
    starts: NDArray[np.uint32]
    members: NDArray[np.uint32]
    outlines: NDArray[np.void]


def _listed(
    work: Work, motion: Motion, places: Float64, views: list[View]
) -> Iterator[tuple[View, _Listed]]:
    """Stages "paths" and "bin" for each view."""
    # Both sides of every surface stand in the light.
    both = np.zeros(len(motion.materials), records.MATERIAL)
    materials = work.runtime.upload("Material", both, "materials")
    for view in views:
        seen = places @ view.matrix[:, :3].T + view.matrix[:, 3]
        nears, casters = _least_depths(seen[:, 3], motion), casters_of(motion)
        order = casters[np.argsort(nears[casters], kind="stable")]
        size, found = _first_size(len(motion.paths)), None
        while found is None:
            found = _list_view(work, motion, seen, size, materials, order)
            size = size if found is not None else size // 2
        starts, members, shapes = found
        yield view, _Listed(size, starts, members, _outlines(shapes, nears))


def _first_size(paths: int) -> int:
    """Tiles along the edge of a view: some for each path, if these were spread out."""
    size = _SIZES[1]
    while size < _SIZES[0] and size * size < 16 * paths:
        size *= 2
    return size


def _outlines(shapes: NDArray[np.void], nears: NDArray[np.float32]) -> NDArray[np.void]:
    """Planes of shapes, and more that are no bounds to fill them up."""
    outlines = np.zeros(len(shapes), records.OUTLINE)
    there = np.arange(shapes["a"].shape[1]) < shapes["planes"][:, None]
    for name, without in zip("abc", (0.0, 0.0, 1.0), strict=True):
        outlines[name] = np.where(there, shapes[name], without)
    outlines["c"] += _ROUNDING * there
    outlines["near"] = nears
    return outlines


def _least_depths(depth: Float64, motion: Motion) -> NDArray[np.float32]:
    """Return the least depth of each path, rounded down."""
    paths = motion.paths
    corners = [paths[name] + end * paths["step"] for name in "abc" for end in (0, 1)]
    least = np.min([depth[corner] for corner in corners], axis=0)
    return np.asarray(np.nextafter(least.astype(np.float32), np.float32(-np.inf)))


def _list_view(
    work: Work,
    motion: Motion,
    seen: Float64,
    size: int,
    materials: DeviceArray,
    order: NDArray[np.uint32],
) -> tuple[NDArray[np.uint32], NDArray[np.uint32], NDArray[np.void]] | None:
    """Return starts and members of the tiles, and shapes; None if members are too many."""
    runtime, count = work.runtime, len(motion.paths)
    vertices = world_vertices(seen[:, :3] * [size, size, 1.0])
    shapes = runtime.allocate("Shape", count, "shapes")
    event = work.run(
        *("analytic/paths.cl", "paths", (), -(-count // PATHS_PER_ITEM)),
        count=count,
        vertices=runtime.upload("Vertex", vertices, "vertices"),
        materials=materials,
        shapes=shapes,
        depths=runtime.allocate("Depth", 0, "depths"),
    )
    work.timings["paths"] += seconds(event)
    given = {"shapes": shapes, "order": runtime.upload("uint", order, "order")}
    lists = Lists(
        runtime, "analytic/bin.cl", (), given, len(order), (0, 0, size, size), 1, (0, 1, 0, 1)
    )
    total = int(lists.starts[-1])
    if size > _SIZES[1] and (total == records.NONE or total > max(_MEMBERS, 16 * count)):
        work.timings["bin"] += lists.seconds()
        return None
    members = runtime.download(lists.file(), (total,), np.uint32)
    work.timings["bin"] += lists.seconds()
    return lists.starts, members, runtime.download(shapes, (count,), records.SHAPE)


def _joined(arrays: list[NDArray[Any]], dtype: Any) -> NDArray[Any]:
    return np.concatenate(arrays).astype(dtype) if arrays else np.zeros(1, dtype)
