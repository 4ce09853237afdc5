"""All meshes of a scene at instants: triangles in the world, with what their corners have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .tracks import at, is_keyed, matrices


@dataclass(frozen=True, eq=False)
class Still:
    """A scene frozen at G instants; corners of F faces.

    Attributes
    ----------
    corners, normals
        ``(G, F, 3, 3)`` in the world; normals as they were given, blended by nobody yet, or the
        flat face's.
    uv, color
        ``(G, F, 3, 2)`` and ``(G, F, 3, 4)``: colour of face or vertices and its alpha, else 1.
    front
        ``(G, F)``: 1, or -1 where the transform mirrors, so that the other side is the front.
    there
        ``(G, F)`` whether the face is visible.
    mesh
        ``(F,)`` place of the mesh in the scene.
    frames
        ``(G,)``, of the instants.
    """

    corners: np.ndarray
    normals: np.ndarray
    uv: np.ndarray
    color: np.ndarray
    front: np.ndarray
    there: np.ndarray
    mesh: np.ndarray
    frames: np.ndarray


def freeze(scene: Any, frame: float, relative: np.ndarray, window: tuple[float, float]) -> Still:
    """Freeze ``scene`` at the instants ``frame + relative``, both in frames.

    ``window``, in frames relative to the frame, is what positions per time are spread over.
    """
    shown = [i for i, mesh in enumerate(scene.meshes) if mesh.visible is not False]
    parts = [_freeze_mesh(scene.meshes[i], frame, relative, window) for i in shown]
    count = len(relative)
    if not parts:
        parts = [_nothing(count)]
    joined = [np.concatenate([part[k] for part in parts], axis=1) for k in range(6)]
    sizes = [part[0].shape[1] for part in parts]
    return Still(*joined, np.repeat(np.array(shown or [0]), sizes), frame + relative)


def vertices_at(
    mesh: Any, frame: float, relative: np.ndarray, window: tuple[float, float]
) -> np.ndarray:
    """World positions ``(G, N, 3)`` of a mesh."""
    own, frames = _own_shutter(mesh, frame, relative, window)
    place = matrices(mesh.transform, frames)
    if mesh.deformer is not None:
        points, _ = _deformed(mesh.deformer, frames)
    else:
        points = per_time(mesh.positions, own)
    return points @ place[:, :3, :3].swapaxes(1, 2) + place[:, None, :3, 3]


def per_time(values: Any, own: np.ndarray) -> np.ndarray:
    """Values ``(K+1, N, d)`` at equal steps of the shutter, or constant ones, at its parts."""
    values = np.asarray(values, np.float64)
    if values.ndim == 2:
        return np.broadcast_to(values, (len(own), *values.shape))
    place = np.clip(own, 0.0, 1.0) * (len(values) - 1)
    k = np.minimum(place.astype(int), len(values) - 2)
    part = (place - k)[:, None, None]
    return (1.0 - part) * values[k] + part * values[k + 1]


def _own_shutter(
    mesh: Any, frame: float, relative: np.ndarray, window: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Parts of the shutter, and frames, at which a mesh is shown: its shutter may be scaled."""
    scaled = relative * (mesh.shutter_scale if mesh.motion_blur else 0.0)
    return (scaled - window[0]) / (window[1] - window[0]), frame + scaled


def _freeze_mesh(
    mesh: Any, frame: float, relative: np.ndarray, window: tuple[float, float]
) -> tuple[np.ndarray, ...]:
    own, frames = _own_shutter(mesh, frame, relative, window)
    place = matrices(mesh.transform, frames)
    faces = np.asarray(mesh.faces)
    points = vertices_at(mesh, frame, relative, window)
    corners = points[:, faces]
    # A mirroring transform would turn fronts to backs.
    front = np.where(np.linalg.det(place[:, :3, :3]) < 0.0, -1.0, 1.0)
    given = None if mesh.normals is None else per_time(mesh.normals, own)
    if mesh.deformer is not None:
        _, deformed = _deformed(mesh.deformer, frames)
        given = given if deformed is None else deformed
    if given is None:
        flat = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
        normals = (front[:, None, None] * flat)[:, :, None].repeat(3, axis=2)
    else:
        world = given @ (front[:, None, None] * adjugates(place[:, :3, :3]))
        normals = world[:, faces]
    uv = np.zeros((1, len(points[0]), 2)) if mesh.uv is None else per_time(mesh.uv, own)
    uv = np.broadcast_to(uv[:, faces], (len(own), len(faces), 3, 2))
    there = np.ones((len(own), len(faces)), bool)
    if is_keyed(mesh.visible):
        there &= at(mesh.visible, frame + relative)[:, None] > 0.0
    front = np.broadcast_to(front[:, None], there.shape)
    return corners, normals, uv, _colors(mesh, own, faces), front, there


def _colors(mesh: Any, own: np.ndarray, faces: np.ndarray) -> np.ndarray:
    color = np.ones((len(own), len(faces), 3, 4))
    if mesh.color is None:
        return color
    given = np.asarray(mesh.color, np.float64)
    width = given.shape[-1]
    if mesh.color_domain == "face":
        color[..., :width] = given[None, :, None, :]
    elif given.ndim == 1:
        color[..., :width] = given
    else:
        color[..., :width] = per_time(given, own)[:, faces]
    return color


def adjugates(matrices: np.ndarray) -> np.ndarray:
    """What rows of normals are multiplied by from the right: determinant times the inverse."""
    a, b, c = (matrices[..., k] for k in range(3))  # columns
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-2)


def _deformed(deformer: Any, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Positions and normals ``(G, N, 3)`` of morph targets and then joints (glTF 2.0, 3.7)."""
    points = np.repeat(np.asarray(deformer.rest, np.float64)[None], len(frames), axis=0)
    normals = None
    if deformer.rest_normals is not None:
        normals = np.repeat(np.asarray(deformer.rest_normals)[None], len(frames), axis=0)
    if deformer.morph is not None:
        weights = at(deformer.morph.weights, frames)
        points = points + np.einsum("gm,mni->gni", weights, deformer.morph.positions)
        if normals is not None and deformer.morph.normals is not None:
            normals = normals + np.einsum("gm,mni->gni", weights, deformer.morph.normals)
    if deformer.skin is not None:
        skin = deformer.skin
        nodes = np.stack([matrices(node, frames) for node in skin.joints.nodes], axis=1)
        bones = nodes @ skin.joints.inverse_bind  # (G, J, 4, 4)
        share = skin.weights / skin.weights.sum(axis=1, keepdims=True)
        blend = np.einsum("nk,gnkij->gnij", share, bones[:, skin.indices])
        ends = np.concatenate([points, np.ones((*points.shape[:2], 1))], axis=2)
        points = np.einsum("gnij,gnj->gni", blend, ends)[..., :3]
        if normals is not None:
            normals = np.einsum("gni,gnij->gnj", normals, adjugates(blend[..., :3, :3]))
    return points, normals


def _nothing(count: int) -> tuple[np.ndarray, ...]:
    three = np.zeros((count, 0, 3, 3))
    return (
        three,
        three,
        np.zeros((count, 0, 3, 2)),
        np.zeros((count, 0, 3, 4)),
        np.zeros((count, 0)),
        np.zeros((count, 0), bool),
    )
