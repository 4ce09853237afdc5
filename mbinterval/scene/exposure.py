"""A scene frozen over one frame's shutter: world positions and camera poses at shutter times.

A scene is animated; an exposure is not. Everything after this file sees only the exposure, so
that every source of motion (keys, arrays per time, the camera) is treated alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.device import records
from mbinterval.errors import CapacityError, SceneError
from mbinterval.scene.camera import Camera, Shutter
from mbinterval.scene.framing import framing_camera, headlight
from mbinterval.scene.model import Light, Mesh, Scene, Vector
from mbinterval.scene.poses import CameraPoses, camera_poses

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]


@dataclass(frozen=True)
class Roll:
    """A rolling shutter: when each line is exposed, in the exposure's time, [0, 1].

    Line i, a row of pixels or, with ``columns``, a column, is open from ``start + i * step`` for
    ``length``.
    """

    columns: bool
    start: float
    step: float
    length: float


@dataclass(frozen=True, eq=False)
class MeshExposure:
    """One mesh over the shutter.

    Each array is given at T = ``segments`` + 1 equally spaced times, or at T = 1 where it is
    constant.

    Attributes
    ----------
    segments
        Linear motion segments K; 0 where neither the mesh nor the camera moves.
    positions
        ``(T, N, 3)`` in the world.
    normals, uv, color
        World normals, not normalized, ``(T, N, 3)``; ``(T, N, 2)``; per-vertex colour
        ``(T, N, 3)``. None where absent.
    face_color
        ``(F, 3)`` or None.
    """

    mesh: Mesh
    segments: int
    positions: Float64
    normals: Float64 | None
    uv: Float64 | None
    color: Float32 | None
    face_color: Float32 | None


@dataclass(frozen=True, eq=False)
class Exposure:
    """What happens while the shutter is open, at one frame.

    ``cameras[K]`` holds the camera at K + 1 equally spaced times, for every K in use; ``camera`` is
    the animated one that they are poses of. ``notes`` say what had to be assumed.
    """

    frame: float
    meshes: tuple[MeshExposure, ...]
    camera: Camera
    cameras: Mapping[int, CameraPoses]
    camera_moves: bool
    lights: tuple[Light, ...]
    background: Vector | Float32
    shutter: Shutter
    roll: Roll | None
    notes: tuple[str, ...] = ()


def expose(
    scene: Scene,
    frame: float,
    aspect: float,
    motion_segments: int | None = None,
    lines: int = 1,
) -> Exposure:
    """Freeze ``scene`` over the shutter of ``frame``.

    ``aspect`` is the image's width over its height. ``motion_segments`` is the number for meshes
    that don't state their own (``Mesh.motion_segments`` or positions per time). ``lines`` is the
    number of lines of a rolling shutter, rows or columns of pixels.
    """
    notes = list(scene.notes)
    camera = scene.camera
    if camera is None:
        camera = framing_camera(scene)
        notes.append("no camera: one that frames the scene was made")
    window = scene.shutter.window(scene.fps, lines)
    meshes = [mesh for mesh in scene.meshes if mesh.visible and len(mesh.faces)]
    if not meshes:
        notes.append("no visible mesh: only the background is seen")
    wanted = [mesh.motion_segments or (mesh.times - 1) or motion_segments or 1 for mesh in meshes]
    cameras = {
        count: camera_poses(camera, _frames(window, frame, count), aspect)
        for count in {0, 1, *wanted}
    }
    camera_moves = any(poses.moves for poses in cameras.values())
    lights = tuple(scene.lights)
    if not lights and any(m.material is None or m.material.shading != "unlit" for m in meshes):
        lights = headlight(cameras[0].rotation[0])
        notes.append("no lights: a headlight was added")
    exposed = tuple(
        expose_mesh(mesh, _frames(window, frame, count), camera_moves)
        for mesh, count in zip(meshes, wanted, strict=True)
    )
    _check_scale(exposed, cameras[0].eye[0])
    return Exposure(
        frame=frame,
        meshes=exposed,
        camera=camera,
        cameras=cameras,
        camera_moves=camera_moves,
        lights=lights,
        background=scene.background,
        shutter=scene.shutter,
        roll=_roll(scene.shutter, scene.fps, lines),
        notes=tuple(notes),
    )


SCALES = (1e-30, 1e30)
"""Distances that can be rendered: their products must keep clear of the ends of float64."""


def _check_scale(meshes: tuple[MeshExposure, ...], eye: Float64) -> None:
    """Refuse vertices that are too far away, and scenes all of which is too near the eye."""
    low, high = SCALES
    size = 0.0
    for mesh in meshes:
        away = np.abs(mesh.positions - eye).max(axis=(0, 2), initial=0.0)
        size = max(size, float(away.max(initial=0.0)))
        if size > high:
            raise SceneError(
                f"mesh {mesh.mesh.name!r}: vertex {int(np.argmax(away))} is {away.max():.3g} from "
                f"the camera; at most {high:g} can be rendered: use larger units"
            )
    if 0.0 < size < low:
        raise SceneError(
            f"every vertex is within {size:.3g} of the camera; {low:g} is the least that can be "
            "rendered: use smaller units"
        )


def _frames(window: tuple[float, float], frame: float, segments: int) -> Float64:
    """Times in frames at the ends of the motion segments; the shutter's opening for none."""
    parts = np.arange(segments + 1) / max(segments, 1)
    return np.asarray(frame + window[0] + parts * (window[1] - window[0]))


def _roll(shutter: Shutter, fps: float, lines: int) -> Roll | None:
    if shutter.rolling is None:
        return None
    low, high = shutter.window(fps, lines)
    offset, exposure = shutter.line_offset or 0.0, shutter.line_exposure or 0.0
    step, length = offset * fps / (high - low), exposure * fps / (high - low)
    columns = shutter.rolling in ("left", "right")
    if shutter.rolling in ("up", "left"):  # the last line comes first
        return Roll(columns, step * (lines - 1), -step, length)
    return Roll(columns, 0.0, step, length)


def expose_mesh(mesh: Mesh, frames: Float64, camera_moves: bool) -> MeshExposure:
    """Evaluate ``mesh`` at ``frames``, shape (K+1,), in the world.

    A transform that mirrors would turn the front of every face to the back, so the order of the
    vertices is reversed with it. The sign at the first of ``frames`` decides: a scale that passes
    through zero within the shutter shows the backs from then on.
    """
    count = len(frames)
    matrices = np.eye(4)[None]
    if mesh.transform is not None:
        matrices = np.array([mesh.transform.at(float(frame)) for frame in frames])
        if not np.isfinite(matrices).all():
            raise SceneError(f"mesh {mesh.name!r}: its transform is not finite")
    matrices = _merge_equal(matrices)
    arrays = (mesh.positions, mesh.normals, mesh.uv, mesh.color)
    changes = len(matrices) > 1 or any(a is not None and a.ndim == 3 for a in arrays)
    _check_room(mesh, count if camera_moves or changes else 1)
    mirrored = bool(np.linalg.det(matrices[0, :3, :3]) < 0.0)
    if mirrored:
        mesh = replace(mesh, faces=mesh.faces[:, ::-1])
    linear, shift = matrices[:, :3, :3], matrices[:, None, :3, 3]
    positions = _merge_equal(_at_times(mesh.positions, 3, count) @ linear.mT + shift)
    if not np.isfinite(positions).all():
        raise SceneError(f"mesh {mesh.name!r}: its transform takes vertices to infinity")
    moves = camera_moves or len(positions) > 1
    normals = uv = color = face_color = None
    if mesh.normals is not None:
        # Cofactors transform normals for any matrix, a mirrored or a singular one too.
        # They point to the side from which vertices run counter-clockwise after the transform.
        cofactors = np.array([_cofactors(matrix) for matrix in linear])
        cofactors = -cofactors if mirrored else cofactors
        normals = _merge_equal(_at_times(mesh.normals, 3, count) @ cofactors.mT)
    if mesh.uv is not None:
        uv = _merge_equal(_at_times(mesh.uv, 2, count))
    if mesh.color is not None and mesh.color_domain == "face":
        face_color = mesh.color
    elif mesh.color is not None:
        color = _merge_equal(_at_times(mesh.color, 3, count)).astype(np.float32)
    changes = any(a is not None and len(a) > 1 for a in (normals, uv, color))
    return MeshExposure(
        mesh=mesh,
        segments=count - 1 if moves or changes else 0,
        positions=positions,
        normals=normals,
        uv=uv,
        color=color,
        face_color=face_color,
    )


def _check_room(mesh: Mesh, times: int) -> None:
    """Refuse a mesh with more vertices or faces, ``times`` over, than indices of 32 bits reach."""
    count = times * max(mesh.positions.shape[-2], len(mesh.faces))
    if count > records.MOST_PATHS:
        raise CapacityError(
            f"mesh {mesh.name!r}: {mesh.positions.shape[-2]} vertices and {len(mesh.faces)} faces "
            f"at {times} times; at most {records.MOST_PATHS} of each can be rendered: use fewer "
            "motion segments or a smaller mesh"
        )


def _at_times(values: NDArray[Any], width: int, count: int) -> NDArray[Any]:
    """``(T, N, width)`` values interpolated to ``count`` times, or ``(1, N, width)``."""
    if values.ndim == 2:
        return values[None]
    given = len(values)
    if given == count:
        return values
    place = np.arange(count) * (given - 1) / (count - 1)
    key = np.minimum(place.astype(int), given - 2)
    part = (place - key)[:, None, None]
    return np.asarray((1.0 - part) * values[key] + part * values[key + 1])


def _merge_equal(values: NDArray[Any]) -> NDArray[Any]:
    """Keep only the first time where all times are equal."""
    return values[:1] if len(values) > 1 and np.all(values == values[:1]) else values


def _cofactors(matrix: Float64) -> Float64:
    a, b, c = matrix
    return np.array([np.cross(b, c), np.cross(c, a), np.cross(a, b)])
