"""A UsdGeomMesh as triangles: topology, primvars, points over time.

Polygons are cut into fans. Where normals, texture coordinates or colours belong to the corners of
faces, every corner becomes a vertex of its own; ``points`` says which point each vertex is.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene.deform import ALL, Index
from mbinterval.scene.formats.usd.times import Sampled, reading_prim

Float64 = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Topology:
    """Triangles of a mesh: ``(F, 3)`` places among its face corners, and their polygon ``(F,)``.

    ``points`` ``(C,)`` are the points of all corners.
    """

    triangles: Ints
    polygon: Ints
    points: Ints


def read_topology(mesh: Any, time: Any) -> Topology:
    """Triangles of ``mesh`` at ``time``; left-handed faces are turned round, holes left out."""
    from pxr import UsdGeom

    counts = _ints(mesh.GetFaceVertexCountsAttr().Get(time))
    points = _ints(mesh.GetFaceVertexIndicesAttr().Get(time))
    if counts.sum() != len(points) or (counts < 0).any():
        raise SceneError(
            f"{mesh.GetPath()}: faceVertexCounts add up to {counts.sum()}, "
            f"but there are {len(points)} faceVertexIndices"
        )
    size = len(mesh.GetPointsAttr().Get(time) or ())
    if len(points) and not 0 <= points.min() <= points.max() < size:
        raise SceneError(
            f"{mesh.GetPath()}: faceVertexIndices run from {points.min()} to {points.max()}, "
            f"but points from 0 to {size - 1}"
        )
    fans = np.maximum(counts - 2, 0)
    fans[_ints(mesh.GetHoleIndicesAttr().Get(time))] = 0
    polygon = np.repeat(np.arange(len(counts)), fans)
    first = np.repeat(np.cumsum(counts) - counts, fans)
    step = np.arange(len(polygon)) - np.repeat(np.cumsum(fans) - fans, fans)
    triangles = np.stack([first, first + step + 1, first + step + 2], axis=1)
    if mesh.GetOrientationAttr().Get(time) == UsdGeom.Tokens.leftHanded:
        triangles = triangles[:, ::-1]
    return Topology(triangles, polygon, points)


@dataclass(frozen=True, eq=False)
class Primvar:
    """Values ``(n, width)``, one for all, each polygon, each point or each corner."""

    values: Float64
    domain: str

    def at_corners(self, topology: Topology) -> Float64:
        """``(C, width)`` values at all corners; not of a domain that is each polygon."""
        if self.domain == "corner":
            return self.values
        if self.domain == "point":
            return self.values[topology.points]
        return np.broadcast_to(self.values[:1], (len(topology.points), self.values.shape[1]))


_DOMAINS = {
    "constant": "all",
    "uniform": "polygon",
    "vertex": "point",
    "varying": "point",
    "faceVarying": "corner",
}


def read_primvar(mesh: Any, name: str, topology: Topology, time: Any) -> Primvar | None:
    """Primvar ``name`` of ``mesh``, inherited ones too; None without a value."""
    from pxr import UsdGeom

    found = UsdGeom.PrimvarsAPI(mesh).FindPrimvarWithInheritance(name)
    if not found or not found.HasValue():
        return None
    return _primvar(mesh, name, found.ComputeFlattened(time), found.GetInterpolation(), topology)


def read_normals(mesh: Any, topology: Topology, time: Any) -> Primvar | None:
    """Normals: the primvar before the attribute; None for a subdivision cage, which has none."""
    from pxr import UsdGeom

    if mesh.GetSubdivisionSchemeAttr().Get() != UsdGeom.Tokens.none:
        return None
    found = read_primvar(mesh, "normals", topology, time)
    if found is None:
        values = mesh.GetNormalsAttr().Get(time)
        kind = mesh.GetNormalsInterpolation()
        found = _primvar(mesh, "normals", values, kind, topology) if values else None
    return found


def _primvar(mesh: Any, name: str, values: Any, kind: str, topology: Topology) -> Primvar:
    array = np.array(values, dtype=np.float64)
    array = array.reshape(len(array), -1) if array.ndim else array.reshape(1, 1)
    domain = _DOMAINS.get(kind, "all")
    needed = {
        "all": 1,
        "polygon": int(topology.polygon.max(initial=-1)) + 1,
        "point": int(topology.points.max(initial=-1)) + 1,
        "corner": len(topology.points),
    }[domain]
    if len(array) < needed:
        raise SceneError(
            f"{mesh.GetPath()}: primvar {name!r} has {len(array)} values, {kind} asks for {needed}"
        )
    return Primvar(array, domain)


@dataclass(frozen=True, eq=False)
class MovingPoints(Sampled):
    """Points of a mesh over time: sampled, and led on by velocities and accelerations.

    ``vertices`` ``(N,)`` are the points that the mesh's vertices are.
    """

    mesh: Any
    vertices: Ints

    @property
    def source(self) -> Hashable | None:
        """See `Mover`: all parts of one mesh move alike."""
        return MovingPoints, id(self.clock.stage), self.path

    def positions(self, frame: float, which: Index = ALL, base: float | None = None) -> Float64:
        """See `Deformer`. Velocities lead on from the sample at or before ``base``."""
        code = self.clock.code(frame)
        start = self.clock.code(frame if base is None else base)
        with reading_prim(self.path):
            points = np.array(self.mesh.ComputePointsAtTime(code, start), dtype=np.float64)
        chosen = self.vertices[which]
        if len(points) <= int(chosen.max(initial=-1)):
            raise SceneError(f"{self.path}: only {len(points)} points at frame {frame:g}")
        return points[chosen]

    def normals(self, frame: float) -> Float64 | None:
        """See `Deformer`; None keeps those at rest."""
        return None

    def mirrors(self, frame: float) -> bool:
        """See `Deformer`."""
        return False


@dataclass(frozen=True, eq=False)
class MovingNormals(MovingPoints):
    """Points with normals that are sampled over time, one for each vertex."""

    topology: Topology
    corners: Ints

    def normals(self, frame: float) -> Float64 | None:
        """See `Deformer`."""
        with reading_prim(self.path):
            found = read_normals(self.mesh, self.topology, self.clock.code(frame))
        return None if found is None else found.at_corners(self.topology)[self.corners]


def _ints(values: Any) -> Ints:
    return np.array(() if values is None else values, dtype=np.int64)
