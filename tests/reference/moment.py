"""What the centres of pixels see at one moment: every triangle as it is then, and a z-buffer.

Optical flow follows the same share of each vertex into another exposure, of the frame before or
after, and subtracts the pixel's centre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbinterval.exposure.exposure import Exposure

from . import exact
from .accumulation import slice_hits
from .paths import NORMAL, UV, paths_of, to_pixels
from .samples import Grid
from .shading import Shader


@dataclass(frozen=True, eq=False)
class Moment:
    """Values at the centres of pixels, ``(H, W)`` or ``(H, W, n)``, float64; 0 where nothing is.

    ``mesh`` counts the exposure's meshes from 0 on, -1 is none; ``face`` those of the mesh;
    ``share`` is barycentric in the world; ``depth`` is infinite where nothing is.
    """

    mesh: np.ndarray
    face: np.ndarray
    share: np.ndarray
    depth: np.ndarray
    normal: np.ndarray
    uv: np.ndarray


def moment(exposure: Exposure, width: int, height: int, t: float) -> Moment:
    """What is seen at time ``t`` in [0, 1) of the shutter."""
    paths = paths_of(exposure, width, height, attributes=True)
    grid = Grid(0, 0, width, height)
    path, depth = slice_hits(paths, grid, t)
    seen = np.flatnonzero(path >= 0)
    path = path[seen]
    tau = paths.local(path, np.full(len(path), t))
    tau[paths.segments[path] == 0] = 0.0
    share, _ = exact.weights(paths, path, *grid.positions(seen), tau)
    first, last = paths.attributes[path].transpose(1, 0, 2, 3)
    values = np.einsum(
        "mv,mva->ma", share, (1.0 - tau)[:, None, None] * first + tau[:, None, None] * last
    )
    normal = paths.normals(path, np.full(len(path), t), values[:, NORMAL])
    view, ray = Shader(exposure, paths, (width, height)), np.zeros((len(path), 3))
    for mesh in np.unique(paths.mesh[path]):
        own = np.flatnonzero(paths.mesh[path] == mesh)
        place = [part[own] for part in grid.positions(seen)]
        ray[own] = view._view(mesh, path[own], *place, np.full(len(own), t))[1]
    away = ((normal * ray).sum(axis=1) > 0) & ~paths.single_sided[path]
    normal = np.where(away[:, None], -1.0, 1.0) * normal
    begin = np.searchsorted(paths.mesh, paths.mesh[path])
    face = (path - begin) // np.maximum(paths.segments[path], 1)

    def spread(found: np.ndarray, empty: float) -> np.ndarray:
        image = np.full((width * height, *found.shape[1:]), empty, dtype=found.dtype)
        image[seen] = found
        return image.reshape(height, width, *found.shape[1:])

    return Moment(
        mesh=spread(paths.mesh[path], -1),
        face=spread(face, -1),
        share=spread(share, 0.0),
        depth=depth.reshape(height, width),
        normal=spread(normal / np.linalg.norm(normal, axis=1, keepdims=True), 0.0),
        uv=spread(values[:, UV], 0.0),
    )


def flow(seen: Moment, exposure: Exposure, other: Exposure, key: int) -> np.ndarray:
    """Pixels ``(H, W, 2)`` to where what is seen is in ``other``, at its times' index ``key``."""
    height, width = seen.mesh.shape
    rows, columns = np.nonzero(seen.mesh >= 0)
    result = np.zeros((height, width, 2))
    for index, mesh in enumerate(exposure.meshes):
        (there,) = (m for m in other.meshes if m.index == mesh.index)
        world = there.positions[min(key, len(there.positions) - 1)]
        points = to_pixels(world, there.poses, key, width, height)
        here = seen.mesh[rows, columns] == index
        row, column = rows[here], columns[here]
        corners = points[mesh.mesh.faces[seen.face[row, column]]]
        point = np.einsum("mv,mvx->mx", seen.share[row, column], corners)
        place = point[:, :2] / point[:, 2:]
        place[point[:, 2] <= 0] = np.nan
        result[row, column] = place - np.stack([column + 0.5, row + 0.5], axis=1)
    return result
