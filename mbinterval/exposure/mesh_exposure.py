"""One mesh at times of the shutter: positions and attributes in the world."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.device import records
from mbinterval.errors import CapacityError, SceneError
from mbinterval.exposure.cuts import Cuts
from mbinterval.exposure.poses import CameraPoses
from mbinterval.exposure.shutter_times import WHOLE, Stretch, Window
from mbinterval.scene.deform import ALL, Index, cofactors
from mbinterval.scene.model import Mesh

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]

_SHORT, _LONG = 1e-9, 1e9
"""Lengths of normals whose squares float32 holds well."""
_RIGID = 1e-9
"""Of a mesh's size: vertices that are no further off where a shift takes them only round."""


@dataclass(frozen=True, eq=False)
class MeshExposure:
    """One mesh over the shutter, or over a stretch of it.

    Each array is given at T = ``segments`` + 1 equally spaced times of the stretch, or at T = 1
    where it is constant.

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
    poses
        The camera at the K + 1 times.
    open, close
        The stretch, in the shutter's [0, 1]; the mesh is not there outside of it.
    index
        Which of the scene's meshes it is.
    world
        0, or the number, from 1 on, of the mirror that it is seen in: reflected.
    mirror
        The number of the mirror that it is; 0 if it is none.
    reason
        Why there are so many segments.
    cuts
        How its faces are cut where a lens's limits bend the blur; None where they are the mesh's.
    """

    mesh: Mesh
    segments: int
    positions: Float64
    normals: Float64 | None
    uv: Float64 | None
    color: Float32 | None
    face_color: Float32 | None
    poses: CameraPoses
    open: float = 0.0
    close: float = 1.0
    index: int = 0
    world: int = 0
    mirror: int = 0
    reason: str = ""
    cuts: Cuts | None = None

    @property
    def faces(self) -> NDArray[np.int32]:
        """``(F, 3)`` triangles of the vertices that it has."""
        return self.mesh.faces if self.cuts is None else self.cuts.faces

    @property
    def parents(self) -> NDArray[np.int64]:
        """``(F,)`` the face of the mesh that each is, or is a part of."""
        return np.arange(len(self.mesh.faces)) if self.cuts is None else self.cuts.parents

    @property
    def faces_turn(self) -> bool:
        """Whether faces turn or change their shape: whether it does more than shift as a whole."""
        rest = self.positions[0] - self.positions[0, :1]
        least = _RIGID * np.abs(rest).max()
        return any(np.abs((now - now[:1]) - rest).max() > least for now in self.positions[1:])


def expose_mesh(
    mesh: Mesh,
    window: Window,
    segments: int,
    poses: CameraPoses,
    stretch: Stretch = WHOLE,
    reason: str = "",
) -> MeshExposure:
    """Evaluate ``mesh`` at the ends of ``segments`` equal parts of ``stretch``, in the world.

    ``poses`` is the camera at these times. A transform that mirrors would turn the front of every
    face to the back, so the order of the vertices is reversed with it. The sign at the first time
    decides: a scale that passes through zero within the shutter shows the backs from then on.
    """
    arrays = (mesh.positions, mesh.normals, mesh.uv, mesh.color)
    varies = mesh.animated or any(a is not None and a.ndim == 3 for a in arrays)
    _check_room(mesh, segments + 1 if varies or poses.moves else 1)
    times = mesh_times(mesh, window, stretch.inside(stretch.ends(segments), window))
    frames = window.frames(times)
    matrices = _matrices(mesh, frames, window.frame)
    mirrored = bool(np.linalg.det(matrices[0, :3, :3]) < 0.0)
    inside_out = mesh.deformer is not None and mesh.deformer.mirrors(float(frames[0]))
    if mirrored != inside_out:
        mesh = replace(mesh, faces=mesh.faces[:, ::-1])
    positions = _merge_equal(world_positions(mesh, window, times))
    normals = uv = color = face_color = None
    if mesh.normals is not None:
        normals = _merge_equal(_world_normals(mesh, frames, times, matrices))
    if mesh.uv is not None:
        uv = _merge_equal(_at_times(mesh.uv, times))
    if mesh.color is not None and mesh.color_domain == "face":
        face_color = mesh.color
    elif mesh.color is not None:
        color = _merge_equal(_at_times(mesh.color, times)).astype(np.float32)
    changes = any(a is not None and len(a) > 1 for a in (positions, normals, uv, color))
    whole = (stretch.open, stretch.close) == (0.0, 1.0)
    return MeshExposure(
        mesh=mesh,
        segments=segments if poses.moves or changes or not whole else 0,
        positions=positions,
        normals=normals,
        uv=uv,
        color=color,
        face_color=face_color,
        poses=poses,
        open=stretch.open,
        close=stretch.close,
        reason=reason,
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


def mesh_times(mesh: Mesh, window: Window, times: Float64) -> Float64:
    """Times of the shutter at which ``mesh`` is evaluated at ``times``: its own shutter's."""
    scale = mesh.own_shutter
    return times if scale == 1.0 else window.scaled(times, scale)


def world_positions(mesh: Mesh, window: Window, times: Float64, which: Index = ALL) -> Float64:
    """World positions of all vertices, or of some, at ``times`` (T,): ``(T, n, 3)``.

    ``(1, n, 3)`` stands for all times where only positions per time or a transform could move
    them, and don't.
    """
    frames = window.frames(times)
    matrices = _matrices(mesh, frames, window.frame)
    with np.errstate(over="ignore", invalid="ignore"):  # the result is looked at
        if mesh.deformer is None:
            points = _at_times(mesh.positions[..., which, :], times)
        else:
            points = np.array(
                [mesh.deformer.positions(float(frame), which, window.frame) for frame in frames]
            )
        positions = points @ matrices[:, :3, :3].mT + matrices[:, None, :3, 3]
    if not np.isfinite(positions).all():
        moved = "transform" if mesh.deformer is None else "deformer or transform"
        raise SceneError(f"mesh {mesh.name!r}: its {moved} takes vertices to infinity")
    return np.asarray(positions)


def _matrices(mesh: Mesh, frames: Float64, base: float) -> Float64:
    """World matrices ``(T, 4, 4)``, or ``(1, 4, 4)`` where they are equal."""
    if mesh.transform is None:
        return np.eye(4)[None]
    if not mesh.transform.animated:
        frames = frames[:1]
    matrices = np.array([mesh.transform.at(float(frame), base) for frame in frames])
    if not np.isfinite(matrices).all():
        raise SceneError(f"mesh {mesh.name!r}: its transform is not finite")
    return _merge_equal(matrices)


def _world_normals(mesh: Mesh, frames: Float64, times: Float64, matrices: Float64) -> Float64:
    """Normals on the side from which vertices run counter-clockwise after the transform.

    Cofactors transform normals for any matrix, a mirrored or a singular one too.
    """
    if mesh.deformer is not None:
        given = [mesh.deformer.normals(float(frame)) for frame in frames]
        normals = np.array([mesh.normals if value is None else value for value in given])
    else:
        normals = _at_times(np.asarray(mesh.normals), times)
    sign = -1.0 if np.linalg.det(matrices[0, :3, :3]) < 0.0 else 1.0
    found = np.asarray(normals @ (sign * cofactors(matrices[:, :3, :3])).mT)
    longest = max(float(found.max(initial=0.0)), -float(found.min(initial=0.0)))
    if not np.isfinite(longest):
        raise SceneError(f"mesh {mesh.name!r}: its normals are not finite")
    if longest == 0.0 or _SHORT < longest < _LONG:
        return found
    return np.asarray(np.ldexp(found, -int(np.frexp(longest)[1])))  # lengths count for nothing


def _at_times(values: NDArray[Any], times: Float64) -> NDArray[Any]:
    """Values ``(G, N, width)`` at equally spaced times, at ``times`` (T,); one time if constant."""
    if values.ndim == 2:
        return values[None]
    place = np.clip(times, 0.0, 1.0) * (len(values) - 1)
    whole = np.rint(place)
    place = np.where(np.abs(place - whole) < 1e-9, whole, place)
    key = np.minimum(place.astype(int), len(values) - 2)
    part = (place - key)[:, None, None]
    return np.asarray((1.0 - part) * values[key] + part * values[key + 1])


def _merge_equal(values: NDArray[Any]) -> NDArray[Any]:
    """Keep only the first time where all times are equal."""
    return values[:1] if len(values) > 1 and np.all(values == values[:1]) else values
