"""One mesh at times of the shutter: positions and attributes in the world."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.device import records
from mbinterval.errors import CapacityError, SceneError
from mbinterval.exposure.bodies import Body
from mbinterval.exposure.poses import CameraPoses
from mbinterval.exposure.shutter_times import Stretch
from mbinterval.exposure.true_motion import at_times, finite
from mbinterval.scene.model import Mesh

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]

_SHORT, _LONG = 1e-9, 1e9
"""Lengths of normals whose squares float32 holds well."""


@dataclass(frozen=True, eq=False)
class MeshExposure:
    """One mesh over the shutter, or over a stretch of it.

    Each array is given at the T = K + 1 ``knots``, or at T = 1 where it is constant.

    Attributes
    ----------
    knots
        ``(K+1,)`` ascending times of the shutter's [0, 1], between which motion is linear; such as
        float32 holds. The mesh is not there before the first and after the last.
    moves
        Whether it or the camera moves.
    positions
        ``(T, N, 3)`` in the world.
    normals, uv, color
        World normals, not normalized, ``(T, N, 3)``; ``(T, N, 2)``; per-vertex colour
        ``(T, N, 3)``. None where absent.
    face_color
        ``(F, 3)`` or None.
    poses
        The camera at the knots, on its chords.
    index
        Which of the scene's meshes it is.
    world
        0, or the number, from 1 on, of the mirror that it is seen in: reflected.
    mirror
        The number of the mirror that it is; 0 if it is none.
    reason
        Why there are so many segments.
    """

    mesh: Mesh
    knots: Float64
    moves: bool
    positions: Float64
    normals: Float64 | None
    uv: Float64 | None
    color: Float32 | None
    face_color: Float32 | None
    poses: CameraPoses
    index: int = 0
    world: int = 0
    mirror: int = 0
    reason: str = ""

    @property
    def segments(self) -> int:
        """Linear motion segments K; 0 where neither the mesh nor the camera moves."""
        return len(self.knots) - 1 if self.moves else 0

    @property
    def open(self) -> float:
        """When it begins to be there, in the shutter's [0, 1]."""
        return float(self.knots[0])

    @property
    def close(self) -> float:
        """When it ends to be there."""
        return float(self.knots[-1])


def expose_body(
    body: Body, stretch: Stretch, knots: Float64, poses: CameraPoses, reason: str = ""
) -> MeshExposure:
    """Evaluate a mesh at ``knots`` of ``stretch``, in the world.

    ``poses`` is the camera there. A transform that mirrors, the mesh's or the camera's, would turn
    the front of every face to the back, so the order of the vertices is reversed with it; in all of
    the stretch it mirrors or does not (`Body.turns`).
    """
    mesh = body.mesh
    _check_room(mesh, len(knots) if body.sources or poses.moves else 1)
    times = knots if body.sources else knots[:1]
    positions = _merge_equal(finite(mesh, body.positions(times, stretch)))
    middle = np.array([0.5 * (stretch.open + stretch.close)])
    mirrored = bool(body.mirrored(middle, stretch)[0]) != bool(np.linalg.det(poses.view[0]) < 0.0)
    if mirrored:
        mesh = replace(mesh, faces=mesh.faces[:, ::-1])
    own = body.own_times(knots, stretch)
    normals = uv = color = face_color = None
    if mesh.normals is not None:
        sign = np.sign(np.linalg.det(body.carriers(middle, stretch)[0, 0, :3, :3])) or 1.0
        normals = _merge_equal(_world_normals(body, times, stretch, float(sign)))
    if mesh.uv is not None:
        uv = _merge_equal(at_times(mesh.uv, own))
    if mesh.color is not None and mesh.color_domain == "face":
        face_color = mesh.color
    elif mesh.color is not None:
        color = _merge_equal(at_times(mesh.color, own)).astype(np.float32)
    changes = any(a is not None and len(a) > 1 for a in (positions, normals, uv, color))
    whole = (knots[0], knots[-1]) == (0.0, 1.0)
    return MeshExposure(
        mesh=mesh,
        knots=knots,
        moves=poses.moves or changes or not whole,
        positions=positions,
        normals=normals,
        uv=uv,
        color=color,
        face_color=face_color,
        poses=poses,
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


def _world_normals(body: Body, times: Float64, stretch: Stretch, sign: float) -> Float64:
    """Normals on the side from which vertices run counter-clockwise after the transform.

    Cofactors transform normals for any matrix, a mirrored or a singular one too.
    """
    found = sign * body.normals(times, stretch)
    longest = max(float(found.max(initial=0.0)), -float(found.min(initial=0.0)))
    if not np.isfinite(longest):
        raise SceneError(f"mesh {body.mesh.name!r}: its normals are not finite")
    if longest == 0.0 or _SHORT < longest < _LONG:
        return found
    return np.asarray(np.ldexp(found, -int(np.frexp(longest)[1])))  # lengths count for nothing


def _merge_equal(values: NDArray[Any]) -> NDArray[Any]:
    """Keep only the first time where all times are equal."""
    return values[:1] if len(values) > 1 and np.all(values == values[:1]) else values
