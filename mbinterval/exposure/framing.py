"""What a scene without camera or lights gets, so that any model can be looked at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene.model import Camera, Light, Scene

_LOOKS = 9
"""Times of the animation at which the framing camera looks."""
_FARTHEST = 1e30  # as `exposure.SCALES` has it


def framing_camera(scene: Scene) -> Camera:
    """Make a camera that sees all that moves in ``scene``, from front and above.

    It looks at nine frames from the animation's first to its last; at frame 0 where nothing says
    which these are.
    """
    first, last = scene.animation or (0.0, 0.0)
    frames = np.linspace(first, last, _LOOKS) if last > first else np.array([first])
    corners = []
    for mesh in scene.meshes:
        if mesh.visible and len(mesh.faces):
            used = np.unique(mesh.faces)
            if mesh.deformer is None:
                points = _box_corners(mesh.positions[..., used, :])
            for frame in frames:
                if mesh.deformer is not None:
                    points = _box_corners(mesh.deformer.positions(float(frame), used))
                matrix = np.eye(4) if mesh.transform is None else mesh.transform.at(float(frame))
                with np.errstate(over="ignore", invalid="ignore"):
                    corners.append(points @ matrix[:3, :3].T + matrix[:3, 3])
                if not (np.abs(corners[-1]) <= _FARTHEST).all():
                    raise SceneError(
                        f"scene: no camera, and the bounds of mesh {mesh.name!r} reach beyond "
                        f"{_FARTHEST:g} at frame {frame:g}, or are not finite; give a camera, or "
                        "use larger units"
                    )
    if not corners:
        return Camera(position=(0.0, 0.0, 1.0), look_at=(0.0, 0.0, 0.0))
    points = np.concatenate(corners)
    centre = (points.min(axis=0) + points.max(axis=0)) / 2.0
    radius = max(float(np.linalg.norm(points - centre, axis=1).max()), 1e-6)
    fov = 40.0
    distance = 1.05 * radius / np.sin(np.radians(fov / 2.0))
    direction = np.array([0.35, 0.25, 1.0])
    eye = centre + direction / np.linalg.norm(direction) * distance
    return Camera(position=tuple(eye), look_at=tuple(centre), fov=fov, name="framing")


def _box_corners(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """``(8, 3)`` corners of the box around points ``(..., 3)``."""
    points = points.reshape(-1, 3)
    box = np.array([points.min(axis=0), points.max(axis=0)])
    return np.array([[box[i, 0], box[j, 1], box[k, 2]] for i, j, k in np.ndindex(2, 2, 2)])


def headlight(rotation: NDArray[np.float64]) -> tuple[Light, ...]:
    """Light along the view, from over the camera's left shoulder, and a little ambient light."""
    direction = rotation.T @ np.array([0.4, -0.5, -1.0])
    return (
        Light("ambient", intensity=0.15),
        Light("directional", intensity=0.85, direction=tuple(direction)),
    )
