"""An exposure's geometry laid out for the device: vertices to transform, paths, attributes.

What does not move comes first, so that the kernels tell it from a path's index alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.device import records
from mbinterval.errors import CapacityError
from mbinterval.exposure.exposure import Exposure
from mbinterval.exposure.mesh_exposure import MeshExposure
from mbinterval.exposure.mirrors import Mirror
from mbinterval.exposure.poses import CameraPoses
from mbinterval.layout.alpha import face_alpha, has_vertex_alpha, is_translucent
from mbinterval.layout.appearance import DEFAULT_MATERIAL
from mbinterval.scene.model import Material

_JOB_VERTICES = 4096
_TEXEL_PART = 2.0**-10
"""Most that float32 may round texture coordinates by, in texels."""

Record = NDArray[np.void]


@dataclass(frozen=True, eq=False)
class Motion:
    """Arrays as the kernels read them (``cl/shared/records.h``).

    Attributes
    ----------
    positions
        ``(n, 3)`` float64 world positions, mesh by mesh and time by time; ``jobs`` say what is
        transformed by which of the ``cameras``, into ``vertex_count`` vertices. ``world_jobs`` say
        where these are in the world: what is seen in a mirror is where it is mirrored from.
    paths
        ``static_paths`` opaque triangles that do not move, then the motion paths, translucent
        triangles, mirrors and what is seen in them, mesh by mesh, segment by segment, face by face.
    meshes
        One record per mesh, which points into ``color`` (three floats, or four where any mesh has
        an alpha of its vertices that counts), ``uv`` (two) and ``normal`` (three). ``uv`` is
        float64 where a texture is looked up so far away that float32 is too coarse for its texels.
    materials
        The materials that the mesh records name, by index.
    objects
        0, and for each mesh record 1 and its place in the scene's meshes.
    places
        For each optical flow asked for, by name, ``(n, 3)`` float64: where the vertices of all
        mesh records are in another frame, in homogeneous pixels (`mbinterval.layout.flow`).
    hashes
        For each Cryptomatte asked for, by name, ``(meshes,)`` uint32: the ID of each mesh record
        (`mbinterval.layout.ids`).
    """

    positions: NDArray[np.float64]
    jobs: Record
    world_jobs: Record
    cameras: Record
    vertex_count: int
    paths: Record
    static_paths: int
    meshes: Record
    materials: tuple[Material, ...]
    color: NDArray[np.float32]
    uv: NDArray[np.float32] | NDArray[np.float64]
    normal: NDArray[np.float32]
    objects: NDArray[np.uint32]
    places: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    hashes: Mapping[str, NDArray[np.uint32]] = field(default_factory=dict)


def lay_out(exposure: Exposure, width: int, height: int) -> Motion:
    """Lay out ``exposure`` for a frame of ``width`` by ``height`` pixels."""
    _check_room(exposure)
    meshes = in_order(exposure)
    cameras, camera_index = _camera_table(exposure, width, height)
    materials = {id(_material(mesh)): _material(mesh) for mesh in meshes}
    material_index = {key: index for index, key in enumerate(materials)}
    sizes = {"color": 4 if any(map(has_vertex_alpha, meshes)) else 3, "uv": 2, "normal": 3}
    pools = {name: _Pool(size) for name, size in sizes.items()}
    if any(map(has_large_uv, meshes)):
        pools["uv"].dtype = np.float64
    table = np.zeros(len(meshes), records.MESH)
    jobs, world_jobs, paths = [], [], []
    unmirrored: dict[tuple[int, float], tuple[MeshExposure, int]] = {}
    first = vertex = once = 0
    for index, mesh in enumerate(meshes):
        sheared = _shearing(exposure, mesh)
        row, camera = table[index], 0
        if mesh.segments or sheared is not None:
            camera = camera_index[id(mesh.poses), mesh.world if sheared else 0]
        row["vertex"], row["count"] = vertex, mesh.positions.shape[1]
        row["camera"], row["material"] = camera, material_index[id(_material(mesh))]
        row["first"], row["world"], row["mirror"] = once, mesh.world, mesh.mirror
        row["sheared"] = sheared is not None
        if mesh.mirror:
            row["reflectivity"] = exposure.mirrors[mesh.mirror - 1].reflectivity
        _add_attributes(row, mesh, pools)
        jobs.append(_vertex_jobs(mesh, first, vertex, camera))
        origin = unmirrored.setdefault((mesh.index, mesh.open), (mesh, first))
        world_jobs.append(_vertex_jobs(*origin, vertex, camera))
        paths.append(_motion_paths(mesh, index, vertex))
        first += mesh.positions.shape[0] * mesh.positions.shape[1]
        vertex += (mesh.segments + 1) * mesh.positions.shape[1]
        once += mesh.positions.shape[1]
    return Motion(
        positions=_joined([mesh.positions.reshape(-1, 3) for mesh in meshes], np.float64),
        jobs=_joined(jobs, records.VERTEX_JOB),
        world_jobs=_joined(world_jobs, records.VERTEX_JOB),
        cameras=cameras,
        vertex_count=vertex,
        paths=_joined(paths, records.PATH),
        static_paths=sum(len(mesh.mesh.faces) for mesh in meshes if _is_static(mesh)),
        meshes=table,
        materials=tuple(materials.values()),
        objects=np.array([0, *(mesh.index + 1 for mesh in meshes)], np.uint32),
        color=_joined(pools["color"].arrays, np.float32),
        uv=_joined(pools["uv"].arrays, pools["uv"].dtype),
        normal=_joined(pools["normal"].arrays, np.float32),
    )


def in_order(exposure: Exposure) -> list[MeshExposure]:
    """Return the meshes in the order of their records: those of ``static_paths`` first."""
    return sorted(exposure.meshes, key=lambda mesh: not _is_static(mesh))


def has_large_uv(mesh: MeshExposure) -> bool:
    """Whether its texture coordinates, in float32, would miss texels by ``_TEXEL_PART`` or more."""
    if mesh.uv is None or not mesh.uv.size:
        return False
    sizes = [texture.image.shape[1::-1] for texture in _material(mesh).textures]
    farthest = np.abs(mesh.uv).max(axis=(0, 1))
    return any(np.any(farthest * size > _TEXEL_PART * 2.0**24) for size in sizes)


def _is_static(mesh: MeshExposure) -> bool:
    """Whether a z-buffer is enough for it: it stands still, and hides what is behind it.

    A mirror shows something else, and what is seen in it hides that alone.
    """
    return not (mesh.segments or mesh.world or mesh.mirror or is_translucent(mesh))


def _check_room(exposure: Exposure) -> None:
    """Refuse a scene that indices of 32 bits don't reach, before its arrays are built."""
    meshes = exposure.meshes
    paths = [len(mesh.mesh.faces) * max(mesh.segments, 1) for mesh in meshes]
    vertices = [mesh.positions.shape[1] * (mesh.segments + 1) for mesh in meshes]
    if max(sum(paths), sum(vertices)) > records.MOST_PATHS:
        most = max(range(len(meshes)), key=lambda index: paths[index] + vertices[index])
        raise CapacityError(
            f"{sum(paths)} motion paths and {sum(vertices)} vertices, {paths[most]} and "
            f"{vertices[most]} of them of mesh {meshes[most].mesh.name!r}; at most "
            f"{records.MOST_PATHS} of each can be rendered: use fewer motion segments or a "
            "smaller scene"
        )


class _Pool:
    """Attribute arrays one after the other; positions are counted in vectors of ``size``."""

    def __init__(self, size: int) -> None:
        self.size, self.count = size, 0
        self.dtype: type[np.floating[Any]] = np.float32
        self.arrays: list[NDArray[Any]] = []

    def add(self, values: NDArray[Any]) -> int:
        """Append values, cut to the pool's size or filled up with ones; returns their place."""
        start, missing = self.count, self.size - values.shape[-1]
        if missing > 0:
            values = np.concatenate([values, np.ones((*values.shape[:-1], missing))], axis=-1)
        values = values[..., : self.size]
        self.arrays.append(values.astype(self.dtype, copy=False).ravel())
        self.count += values.size // self.size
        return start


def _add_attributes(row: Any, mesh: MeshExposure, pools: dict[str, _Pool]) -> None:
    """Put the mesh's attributes into the pools and their places into its record."""
    for name, values in (("uv", mesh.uv), ("normal", mesh.normals), ("color", mesh.color)):
        row[name], row[f"{name}_step"] = records.NONE, 0
        if values is not None:
            row[name] = pools[name].add(values)
            row[f"{name}_step"] = values.shape[1] if len(values) > 1 else 0


def _material(mesh: MeshExposure) -> Material:
    return mesh.mesh.material or DEFAULT_MATERIAL


def _vertex_jobs(mesh: MeshExposure, first: int, vertex: int, camera: int) -> Record:
    """Transform the mesh's positions at each end of a segment, some thousand at a time."""
    times, count = mesh.positions.shape[:2]
    starts = np.arange(0, count, _JOB_VERTICES)
    jobs = np.zeros((mesh.segments + 1, len(starts)), records.VERTEX_JOB)
    for time in range(mesh.segments + 1):
        jobs[time]["input"] = first + (time if times > 1 else 0) * count + starts
        jobs[time]["output"] = vertex + time * count + starts
        jobs[time]["camera"] = camera + time
    jobs["count"] = np.minimum(count - starts, _JOB_VERTICES)
    return jobs.ravel()


def _motion_paths(mesh: MeshExposure, index: int, vertex: int) -> Record:
    faces, count = mesh.mesh.faces, mesh.positions.shape[1]
    segments = max(mesh.segments, 1)
    paths = np.zeros((segments, len(faces)), records.PATH)
    base = vertex + count * np.arange(segments)[:, None]
    for corner, name in enumerate("abc"):
        paths[name] = base + faces[None, :, corner]
    paths["step"] = count if mesh.segments else 0
    paths["face"] = np.arange(len(faces))
    paths["mesh"] = index
    base = np.asarray(_material(mesh).base_color, np.float32)
    paths["color"] = base if mesh.face_color is None else base * mesh.face_color[:, :3]
    paths["alpha"] = face_alpha(mesh)
    ends = mesh.open + (mesh.close - mesh.open) * (np.arange(segments + 1) / segments)
    paths["open"], paths["close"] = ends[:-1, None], ends[1:, None]
    return paths.ravel()


def _shearing(exposure: Exposure, mesh: MeshExposure) -> Mirror | None:
    """Return the glossy mirror that ``mesh`` is seen in, if it is."""
    mirror = exposure.mirrors[mesh.world - 1] if mesh.world else None
    return mirror if mirror is not None and mirror.shear > 0.0 else None


def _camera_table(
    exposure: Exposure, width: int, height: int
) -> tuple[Record, dict[tuple[int, int], int]]:
    """The camera at all times that meshes ask for, and where the poses of each begin.

    The first record is the camera at the shutter's opening, for what does not move. Poses are
    named by their identity and by the glossy mirror, or 0, whose shear they have.
    """
    asked = {}
    for mesh in exposure.meshes:
        mirror = _shearing(exposure, mesh)
        asked[id(mesh.poses), mesh.world if mirror else 0] = mesh.poses, mirror
    tables = [_camera_records(exposure, exposure.cameras[0], width, height)]
    index, count = {}, 1
    for key, (poses, mirror) in asked.items():
        index[key] = count
        tables.append(_camera_records(exposure, poses, width, height, mirror))
        count += len(tables[-1])
    return np.concatenate(tables), index


def _camera_records(
    exposure: Exposure, poses: CameraPoses, width: int, height: int, mirror: Mirror | None = None
) -> Record:
    """Matrices from the world, relative to the eye, to homogeneous pixels, and back; the lens.

    With the shear of a glossy ``mirror`` (``cl/shared/shear.h``).
    """
    camera = exposure.camera
    table = np.zeros(len(poses.eye), records.CAMERA)
    table["aperture"] = poses.aperture * poses.focal * height
    table["focus"] = poses.focus
    table["sharp_near"], table["sharp_far"] = camera.sharp_range or (poses.focus, poses.focus)
    blur = camera.foreground_blur
    table["foreground"] = np.inf if blur is None else blur * height
    for row, eye, rotation, focal in zip(
        table, poses.eye, poses.rotation, poses.focal * height, strict=True
    ):
        to_pixels = np.array([[focal, 0, -width / 2], [0, -focal, -height / 2], [0, 0, -1.0]])
        row["eye"] = eye
        row["matrix"] = (to_pixels @ rotation).ravel()
        inverse = rotation.T @ np.linalg.inv(to_pixels)
        row["inverse"] = inverse.ravel()
        if mirror is not None:
            row["plane"] = *(mirror.normal @ inverse), mirror.heights(eye)
            row["tilt"] = (to_pixels @ rotation @ mirror.tangents.T).T.ravel()
    return table


def _joined(arrays: Sequence[NDArray[Any]], dtype: Any) -> NDArray[Any]:
    if len(arrays) == 1:
        return np.ascontiguousarray(arrays[0], dtype)
    return np.concatenate(arrays) if arrays else np.zeros(0, dtype)
