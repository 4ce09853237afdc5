"""What rays of the stochastic path meet: a tree of boxes over all paths, and shadow maps.

The tree is a complete binary one over paths in Morton order (Lauterbach et al. 2009), some in each
leaf; a box holds its paths over the whole shutter.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mbinterval.device import records
from mbinterval.device.runtime import seconds
from mbinterval.layout.appearance import casting
from mbinterval.rendering.shadows import (
    View,
    casters_of,
    light_table,
    scaled,
    views_of,
    world_positions,
    world_vertices,
)
from mbinterval.rendering.shared_steps import Work

if TYPE_CHECKING:
    from mbinterval.layout.motion import Motion

_LEAF_PATHS = 4
_MORTON_BITS = 10
_SLACK = 1e-5
"""Of the farthest coordinate: more than rays in float32 are wrong by."""


def prepare_rays(work: Work, motion: Motion) -> None:
    """Make the buffers that samples' rays need, and shadow maps where the plan has them."""
    exposure, settings = work.exposure, work.plan.settings
    origin = np.asarray(exposure.path.opening.eye[0])
    places = world_positions(motion, origin)
    casters = casters_of(motion)
    nodes, leaves = tree_of(motion.paths[casters], places)
    leaves[leaves != records.NONE] = casters[leaves[leaves != records.NONE]]
    lights = [exposure.lights[index] for index in casting(exposure, settings)]
    seen = [views_of(light, origin, places) if len(places) else [] for light in lights]
    flat = [view for views in seen for view in views]
    size = settings.shadow_map or 1
    views = np.zeros(len(flat), records.LIGHT_VIEW)
    for row, view in zip(views, flat, strict=True):
        row["matrix"], row["size"], row["texel"] = scaled(view, size), size, view.width / size
    work.upload("Vertex", "world", world_vertices(places))
    work.upload("ShadowLight", "shadow_lights", light_table(lights, seen, origin))
    work.upload("TreeNode", "tree", nodes)
    work.upload("uint", "leaves", leaves)
    work.upload("LightView", "light_views", views)
    work.numbers["leaf_nodes"] = len(nodes) // 2
    if "shadow_map" in work.plan.stages:
        _run_shadow_map(work, flat)


def tree_of(
    paths: NDArray[np.void], places: NDArray[np.float64]
) -> tuple[NDArray[np.void], NDArray[np.uint32]]:
    """Return the nodes, root at 1 and the second half leaves, and the paths of each leaf.

    ``places`` ``(n, 3)`` are those of the vertices.
    """
    corners = [paths[name] + end * paths["step"] for name in "abc" for end in (0, 1)]
    ends = np.array([places[corner] for corner in corners]).reshape(6, len(paths), 3)
    low, high = ends.min(axis=0), ends.max(axis=0)
    order = np.argsort(_morton(0.5 * (low + high)), kind="stable").astype(np.uint32)
    count = 1
    while count * _LEAF_PATHS < len(paths):
        count *= 2
    leaves = np.full(count * _LEAF_PATHS, records.NONE, np.uint32)
    leaves[: len(paths)] = order
    slots = np.full((len(leaves), 8), [*[np.inf] * 3, *[-np.inf] * 3, np.inf, -np.inf], np.float32)
    slack = _SLACK * float(np.abs(places).max(initial=0.0))
    slots[: len(paths), :3], slots[: len(paths), 3:6] = low[order] - slack, high[order] + slack
    slots[: len(paths), 6], slots[: len(paths), 7] = paths["open"][order], paths["close"][order]
    nodes = np.zeros(2 * count, records.TREE_NODE)
    table = nodes.view(np.float32).reshape(-1, 8)
    level, size = _joined_boxes(slots, _LEAF_PATHS), count
    while size:
        table[size : 2 * size] = level
        level, size = _joined_boxes(level, 2) if size > 1 else level, size // 2
    return nodes, leaves


def _joined_boxes(boxes: NDArray[np.float32], count: int) -> NDArray[np.float32]:
    """Return boxes ``(n / count, 8)`` that hold ``count`` of ``boxes`` each."""
    groups = boxes.reshape(-1, count, 8)
    least, most = groups.min(axis=1), groups.max(axis=1)
    return np.asarray(
        np.concatenate([least[:, :3], most[:, 3:6], least[:, 6:7], most[:, 7:]], axis=1)
    )


def _morton(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Places of points ``(n, 3)`` along a curve that fills their bounds."""
    if not len(points):
        return np.zeros(0, np.int64)
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    cells = ((points - low) / np.where(size > 0, size, 1.0) * ((1 << _MORTON_BITS) - 1)).astype(int)
    code = np.zeros(len(points), np.int64)
    for bit in range(_MORTON_BITS):
        for axis in range(3):
            code |= (cells[:, axis] >> bit & 1) << (3 * bit + axis)
    return code


def _run_shadow_map(work: Work, views: list[View]) -> None:
    """Stage "shadow_map": depths by texel, time and view."""
    settings = work.plan.settings
    size, strata = settings.shadow_map or 1, settings.shadow_strata
    rays = np.zeros(len(views), records.VIEW_RAYS)
    for row, view in zip(rays, views, strict=True):
        scale = [1.0, 1.0 / size, 1.0 / size]
        row["from"], row["way"] = (view.start * scale).T.ravel(), (view.way * scale).T.ravel()
        row["depth"] = view.near
    rows = len(views) * strata * size
    work.allocate("float", "shadow_map", rows * size)
    event = work.run(
        *("stochastic/shadow_map.cl", "shadow_map", (), rows),
        views=work.runtime.upload("ViewRays", rays, "rays of lights"),
    )
    work.timings["shadow_map"] = seconds(event)
