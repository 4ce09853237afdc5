"""What the pixels' centres see at one moment of the exposure, through the middle of the lens."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import camera as cameras
from . import exposure
from .cast import Triangles
from .film import primary
from .motion import freeze, vertices_at
from .shade import World

SEEN = 0.5
"""Alpha from which on a translucent surface is what is seen."""


def layers(scene: Any, frame: float, size: tuple[int, int], moment: float) -> dict[str, np.ndarray]:
    """Layers by name, ``(H, W)`` or ``(H, W, n)``, and ``edge``: how near an edge of a triangle is,

    as the least weight of a corner; there the last bit decides which side is seen.
    """
    width, height = size
    place = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    starts = exposure.line_starts(scene, size)
    columns = scene.shutter.rolling in ("left", "right")
    after = moment * exposure.length(scene)
    if starts is None:
        instants, pixels = np.array([scene.shutter.open + after]), place.reshape(1, -1, 2)
    else:
        instants, pixels = starts + after, place.swapaxes(0, 1) if columns else place
    window = exposure.window(scene, size)
    poses = cameras.poses_at(scene.camera, frame + instants, width / height)
    world = World(scene, Triangles(freeze(scene, frame, instants, window)))
    rays, hits = primary(world, scene.camera, poses, pixels + 0.5, None, size)
    found = {
        "depth": np.full(width * height, np.inf),
        "normal": np.zeros((width * height, 3)),
        "uv": np.zeros((width * height, 2)),
        "object": np.zeros(width * height, int),
        "material": np.zeros(width * height, int),
        "forward": np.zeros((width * height, 2)),
        "backward": np.zeros((width * height, 2)),
        "edge": np.ones(width * height),
    }
    used = list(dict.fromkeys(mesh.material for mesh in scene.meshes))
    distance = np.where(hits.front | world.double, hits.distance, np.inf)
    active = np.arange(len(distance)) if world.triangles.faces else np.zeros(0, int)
    while len(active):
        face = distance[active].argmin(axis=1)
        w = distance[active, face]
        active, face, w = (part[np.isfinite(w)] for part in (active, face, w))
        distance[active, face] = np.inf
        weights = hits.weights(active, face)
        _, alpha = world.surfaces(rays.chosen(active), face, weights, bounce=False)
        found["edge"][active] = np.minimum(found["edge"][active], weights.min(axis=1))
        found["edge"][active] = np.minimum(found["edge"][active], np.abs(alpha - SEEN))
        seen = alpha >= SEEN
        on, at, share = active[seen], face[seen], weights[seen]
        still, group = world.still, rays.group[on]
        mesh = still.mesh[at]
        found["depth"][on] = w[seen]
        found["object"][on] = 1 + mesh
        found["material"][on] = [1 + used.index(scene.meshes[m].material) for m in mesh]
        found["uv"][on] = np.einsum("ni,nik->nk", share, still.uv[group, at])
        normal = np.einsum("ni,nik->nk", share, still.normals[group, at])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        points = np.einsum("ni,nik->nk", share, still.corners[group, at])
        away = np.sum((rays.eye[on] - points) * normal, axis=1) < 0.0
        normal[away & world.double[at]] *= -1.0
        found["normal"][on] = normal
        for name, step in (("forward", 1), ("backward", -1)):
            if starts is None:
                there = _moved(scene, frame + step, instants, window, mesh, at, share, still.mesh)
                pose = cameras.poses_at(scene.camera, frame + step + instants, width / height)
                seen_there = cameras.projected(pose, there[None], size)[0]
                flow = seen_there[:, :2] - (pixels[0][on] + 0.5)
                found[name][on] = np.where(seen_there[:, 2:] > 0.0, flow, np.nan)
        active = active[~seen]
    if columns:
        return {
            name: values.reshape(width, height, *values.shape[1:]).swapaxes(0, 1)
            for name, values in found.items()
        }
    return {
        name: values.reshape(height, width, *values.shape[1:]) for name, values in found.items()
    }


def _moved(
    scene: Any,
    frame: float,
    instants: np.ndarray,
    window: tuple[float, float],
    mesh: np.ndarray,
    face: np.ndarray,
    weights: np.ndarray,
    owners: np.ndarray,
) -> np.ndarray:
    """Where points of faces are at another frame, ``(n, 3)`` in the world."""
    found = np.zeros((len(face), 3))
    for one in np.unique(mesh):
        on = mesh == one
        vertices = vertices_at(scene.meshes[one], frame, instants, window)[0]
        first = int(np.argmax(owners == one))
        corners = vertices[np.asarray(scene.meshes[one].faces)[face[on] - first]]
        found[on] = np.einsum("ni,nik->nk", weights[on], corners)
    return found
