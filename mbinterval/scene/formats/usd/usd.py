"""Reader of USD: meshes, instances, skeletons, materials, the camera and its shutter.

A frame is a time code, unless other frames per second are asked for. A stage whose up axis is Z is
turned so that Y is up. USD itself evaluates attributes, xformOps and skeletons at every time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene import field_values
from mbinterval.scene.asset import Asset, reading, several_cameras
from mbinterval.scene.formats.usd.instances import Crowd, Instance, InstancePlace, instance_masks
from mbinterval.scene.formats.usd.layers import Layers, read_layers
from mbinterval.scene.formats.usd.material import MaterialReader
from mbinterval.scene.formats.usd.mesh import (
    MovingNormals,
    MovingPoints,
    Primvar,
    Topology,
    read_normals,
    read_primvar,
    read_topology,
)
from mbinterval.scene.formats.usd.skel import SkelReader
from mbinterval.scene.formats.usd.times import Clock, keyed, prim_place, reading_prim, visibility
from mbinterval.scene.model import Camera, Mesh, Shutter, Viewpoint
from mbinterval.scene.tracks import Track
from mbinterval.scene.transforms import Transform

Float64 = NDArray[np.float64]

_Z_UP = Transform(rotation=(-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))
_TENTH = 0.01
"""What makes millimetres of a lens tenths of a world unit, as USD has them."""


def read_usd(path: Path, fps: float | None = None, root: Transform | None = None) -> Asset:
    """Read the default scene of a USD file.

    Parameters
    ----------
    path
        A .usd, .usda, .usdc or .usdz file.
    fps
        Frames per second: what is at s seconds is at frame s * fps. None takes the file's time
        codes per second, so that a frame is a time code.
    root
        Places the whole file in the world.

    Raises
    ------
    SceneError
        Where usd-core is not installed; for a broken file, and for one without meshes.
    """
    try:
        import pxr  # noqa: F401
    except ImportError:
        raise SceneError(
            f"{path}: USD files need usd-core: pip install 'mbinterval[usd]'"
        ) from None
    with reading(path, "USD"), reading_prim(""):
        return read_layers(path, lambda layers: _StageReader(layers, path, fps, root).asset())


class _StageReader:
    def __init__(
        self, layers: Layers, path: Path, fps: float | None, root: Transform | None
    ) -> None:
        from pxr import Usd, UsdGeom

        stage = layers.stage
        self.layers, self.stage, self.path = layers, stage, path
        self.notes: list[str] = []
        self.start = Usd.TimeCode.EarliestTime()
        codes = stage.GetTimeCodesPerSecond()
        self.fps = codes if fps is None else fps
        self.clock = Clock(stage, codes / self.fps)
        self.root: Transform | None = root
        if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z:
            self.root = replace(_Z_UP, parent=root)
        self.materials = MaterialReader(self._note, layers)
        self.skeletons = SkelReader(stage, self.clock)

    def asset(self) -> Asset:
        from pxr import UsdGeom

        meshes: list[Mesh] = []
        cameras: list[Viewpoint] = []
        others: set[str] = set()
        for prim in self._prims():
            with reading_prim(str(prim.GetPath())):
                if prim.IsA(UsdGeom.Mesh):
                    meshes += self._meshes(prim)
                elif prim.IsA(UsdGeom.PointInstancer):
                    meshes += self._instances(UsdGeom.PointInstancer(prim))
                elif prim.IsA(UsdGeom.Camera):
                    cameras += self._camera(UsdGeom.Camera(prim))
                elif prim.IsA(UsdGeom.Gprim):
                    others.add(str(prim.GetTypeName()))
        for text in self.layers.warnings():
            self._note(text)
        if others:
            self._note(f"only meshes are read; left out: {', '.join(sorted(others))}")
        if not meshes:
            found = f", only {', '.join(sorted(others))}" if others else ""
            raise SceneError(f"holds no mesh{found}; export its objects as meshes")
        if len(cameras) > 1:
            self._note(several_cameras([view.camera.name for view in cameras]))
        return Asset(
            tuple(meshes),
            tuple(cameras),
            notes=tuple(self.notes),
            animation=self._animation(),
            fps=self.fps,
        )

    def _note(self, text: str) -> None:
        note = f"{self.path.name}: {text}"
        if note not in self.notes:
            self.notes.append(note)

    def _prims(self) -> Iterator[Any]:
        """Prims to draw, in instances too; what a point instancer has below it is its own."""
        from pxr import Usd, UsdGeom

        predicate = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
        prims = iter(Usd.PrimRange(self.stage.GetPseudoRoot(), predicate))
        for prim in prims:
            if prim.IsA(UsdGeom.PointInstancer):
                prims.PruneChildren()
            yield prim

    def _animation(self) -> tuple[float, float] | None:
        if not self.stage.HasAuthoredTimeCodeRange():
            return None
        first, last = self.stage.GetStartTimeCode(), self.stage.GetEndTimeCode()
        return (first / self.clock.rate, last / self.clock.rate) if last > first else None

    def _meshes(self, prim: Any) -> list[Mesh]:
        """Read the mesh of ``prim`` where it is, one part for each of its materials."""
        shown = visibility(prim, self.clock)
        if shown is False:
            return []
        parts = _MeshReader(self, prim).parts()
        return [replace(part, visible=shown) for part in parts]

    def _camera(self, source: Any) -> list[Viewpoint]:
        from pxr import UsdGeom

        name = source.GetPrim().GetName()
        if source.GetProjectionAttr().Get(self.start) == UsdGeom.Tokens.orthographic:
            self._note(f"camera {name!r} is orthographic and left out")
            return []
        for side in ("Horizontal", "Vertical"):
            if getattr(source, f"Get{side}ApertureOffsetAttr")().Get(self.start):
                self._note(f"camera {name!r}: its aperture's offset is left out")
        stop = keyed(source.GetFStopAttr(), self.clock)
        focus = keyed(source.GetFocusDistanceAttr(), self.clock)
        lens: dict[str, Any] = {}
        if _positive(stop) and _positive(focus):
            lens = {"f_stop": stop, "focus_distance": focus}
        elif _positive(stop):
            self._note(f"camera {name!r} has an fStop, but no focusDistance: it is a pinhole")
        camera = Camera(
            transform=prim_place(source.GetPrim(), self.clock, self.root),
            focal_length=keyed(source.GetFocalLengthAttr(), self.clock),
            vertical_aperture=float(source.GetVerticalApertureAttr().Get(self.start)),
            meters_per_unit=_TENTH,
            name=name,
            **lens,
        )
        opens, closes = (
            field_values.number(float(attribute.Get(self.start) or 0.0), str(attribute.GetPath()))
            / self.clock.rate
            for attribute in (source.GetShutterOpenAttr(), source.GetShutterCloseAttr())
        )
        return [Viewpoint(camera, Shutter(opens, closes) if closes > opens else Shutter())]

    def _instances(self, source: Any) -> list[Mesh]:
        """Every mesh of every prototype, once for each instance that shows it."""
        from pxr import Usd, UsdGeom

        shown = visibility(source.GetPrim(), self.clock)
        kinds = np.array(source.GetProtoIndicesAttr().Get(self.start) or (), dtype=np.int64)
        if shown is False or not len(kinds):
            return []
        roots = [self.stage.GetPrimAtPath(p) for p in source.GetPrototypesRel().GetTargets()]
        if kinds.min() < 0 or kinds.max() >= len(roots):
            raise SceneError(f"{source.GetPath()}: protoIndices name prototype {kinds.max()}")
        attributes = [
            getattr(source, f"Get{name}Attr")()
            for name in ("Positions", "Orientations", "Scales", "Velocities", "AngularVelocities")
        ]
        moving = any(attribute.ValueMightBeTimeVarying() for attribute in attributes) or any(
            attribute.HasValue() for attribute in attributes[3:]
        )
        place = prim_place(source.GetPrim(), self.clock, self.root)
        crowd = Crowd(source, self.clock, {})
        sampled = self.clock, str(source.GetPath()), tuple(attributes)
        seen = instance_masks(source, self.clock, len(kinds))
        predicate = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
        meshes: list[Mesh] = []
        for kind in np.unique(kinds):
            parts = [
                (part, prim_place(prim, self.clock, None))
                for prim in Usd.PrimRange(roots[kind], predicate)
                if prim.IsA(UsdGeom.Mesh)
                for part in self._meshes(prim)
            ]
            inner = prim_place(roots[kind], self.clock, None)
            for number in np.flatnonzero(kinds == kind):
                visible = seen[number]
                if visible is False:
                    continue
                for part, own in parts:
                    instance = Instance(*sampled, crowd, int(number), moving)
                    at = InstancePlace(instance, place, own, inner)
                    name = f"{source.GetPrim().GetName()}[{number}]/{part.name}"
                    if visible is True:
                        visible = part.visible if shown is True else shown
                    meshes.append(replace(part, transform=at, name=name, visible=visible))
        return meshes


class _MeshReader:
    """Reads one UsdGeomMesh."""

    def __init__(self, reader: _StageReader, prim: Any) -> None:
        from pxr import UsdGeom

        self.reader, self.prim, self.mesh = reader, prim, UsdGeom.Mesh(prim)
        self.clock, self.start = reader.clock, reader.start
        topology = (self.mesh.GetFaceVertexCountsAttr(), self.mesh.GetFaceVertexIndicesAttr())
        if any(attribute.ValueMightBeTimeVarying() for attribute in topology):
            raise SceneError(
                f"{prim.GetPath()}: its faces change over time; only points may move: "
                "export it with topology that stays"
            )
        self.topology: Topology = read_topology(self.mesh, self.start)
        scheme = self.mesh.GetSubdivisionSchemeAttr().Get()
        if scheme != UsdGeom.Tokens.none and len(self.topology.triangles):
            reader._note(f"{scheme} subdivision cages are shown as polygons")

    def parts(self) -> list[Mesh]:
        """Read the mesh, cut into its subsets of materials."""
        from pxr import UsdShade

        if not len(self.topology.triangles):
            self.reader._note(f"mesh {self.prim.GetName()!r} has no faces")
            return []
        rest = np.ones(len(self.topology.triangles), dtype=bool)
        meshes = []
        for subset in UsdShade.MaterialBindingAPI(self.prim).GetMaterialBindSubsets():
            polygons = np.array(subset.GetIndicesAttr().Get(self.start) or (), dtype=np.int64)
            chosen = np.isin(self.topology.polygon, polygons) & rest
            if chosen.any():
                name = f"{self.prim.GetName()}.{subset.GetPrim().GetName()}"
                meshes.append(self._part(chosen, subset.GetPrim(), name))
                rest &= ~chosen
        if rest.any():
            meshes.append(self._part(rest, self.prim, self.prim.GetName()))
        return meshes

    def _part(self, chosen: NDArray[np.bool_], bound: Any, name: str) -> Mesh:
        double_sided = bool(self.mesh.GetDoubleSidedAttr().Get())
        use = self.reader.materials.use(bound, double_sided)
        uv = color = None
        if use.material.textures:
            uv = read_primvar(self.mesh, use.uv, self.topology, self.start)
        if use.color:
            color = read_primvar(self.mesh, use.color, self.topology, self.start)
        normals = read_normals(self.mesh, self.topology, self.start)
        if normals is not None and normals.domain in ("polygon", "all"):
            normals = None  # flat faces are what the renderer makes of none
        vertices, corners, faces = self._vertices(chosen, (uv, color, normals))
        fields: dict[str, Any] = {}
        if uv is not None:
            values = uv.at_corners(self.topology)[corners, :2]
            fields["uv"] = values @ use.uv_linear.T + use.uv_offset
        if color is not None:
            fields |= self._color(color, corners, chosen)
        if normals is not None:
            fields["normals"] = normals.at_corners(self.topology)[corners]
        points = np.array(self.mesh.GetPointsAttr().Get(self.start), dtype=np.float64)
        mesh = Mesh(points[vertices], faces, material=use.material, name=name, **fields)
        return replace(self._moved(mesh, vertices, corners, normals), **self._blur())

    def _vertices(
        self, chosen: NDArray[np.bool_], given: tuple[Primvar | None, ...]
    ) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Points ``(N,)`` of the vertices, a corner of each, and faces ``(F, 3)`` of vertices."""
        triangles = self.topology.triangles[chosen]
        if any(primvar is not None and primvar.domain == "corner" for primvar in given):
            corners, faces = np.unique(triangles, return_inverse=True)
            return self.topology.points[corners], corners, faces.reshape(-1, 3)
        vertices, first, faces = np.unique(
            self.topology.points[triangles], return_index=True, return_inverse=True
        )
        return vertices, triangles.ravel()[first], faces.reshape(-1, 3)

    def _color(
        self, color: Primvar, corners: NDArray[Any], chosen: NDArray[np.bool_]
    ) -> dict[str, Any]:
        if color.domain == "all":
            return {"color": color.values[0, :3]}
        if color.domain == "polygon":
            values = color.values[self.topology.polygon[chosen], :3]
            return {"color": values, "color_domain": "face"}
        values = color.at_corners(self.topology)[corners, :3]
        return {"color": values, "color_domain": "vertex"}

    def _moved(
        self, mesh: Mesh, vertices: NDArray[Any], corners: NDArray[Any], normals: Primvar | None
    ) -> Mesh:
        """``mesh`` with what moves it."""
        place = prim_place(self.prim, self.clock, self.reader.root)
        found = self.reader.skeletons.deformer(self.mesh, vertices, mesh.positions, mesh.normals)
        if found is not None:
            deformer, skeleton = found
            if skeleton is not None:
                place = prim_place(skeleton, self.clock, self.reader.root)
            return replace(mesh, deformer=deformer, transform=place)
        points, speeds = self.mesh.GetPointsAttr(), self.mesh.GetVelocitiesAttr()
        if not points.ValueMightBeTimeVarying() and not speeds.HasValue():
            return replace(mesh, transform=place)
        sampled = self.clock, str(self.mesh.GetPath()), (points, speeds)
        moving = MovingPoints(*sampled, self.mesh, vertices)
        if normals is not None:
            moving = MovingNormals(*sampled, self.mesh, vertices, self.topology, corners)
        return replace(mesh, deformer=moving, transform=place)

    def _blur(self) -> dict[str, Any]:
        """motion:blurScale and motion:nonlinearSampleCount, where they are given."""
        motion, step = {}, self.prim
        while step and not step.IsPseudoRoot():
            for name in ("motion:blurScale", "motion:nonlinearSampleCount"):
                attribute = step.GetAttribute(name)
                if name not in motion and attribute and attribute.HasAuthoredValue():
                    motion[name] = attribute.Get(self.start)
            step = step.GetParent()
        fields: dict[str, Any] = {}
        if "motion:blurScale" in motion:
            fields["shutter_scale"] = max(float(motion["motion:blurScale"]), 0.0)
        if "motion:nonlinearSampleCount" in motion:
            fields["motion_segments"] = max(int(motion["motion:nonlinearSampleCount"]) - 1, 1)
        return fields


def _positive(value: float | Track | None) -> bool:
    """Whether a number, at every key, is above zero."""
    if value is None:
        return False
    return bool(np.all((value.values if isinstance(value, Track) else value) > 0.0))
