"""What a scene without camera or lights gets, so that any model can be looked at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene.model import Camera, Light, Scene


def framing_camera(scene: Scene) -> Camera:
    """Make a camera that sees all that is visible in ``scene`` at frame 0, from front and above."""
    corners = []
    for mesh in scene.meshes:
        if mesh.visible and len(mesh.faces):
            points = mesh.positions[..., np.unique(mesh.faces), :].reshape(-1, 3)
            box = np.array([points.min(axis=0), points.max(axis=0)])
            corner = np.array(
                [[box[i, 0], box[j, 1], box[k, 2]] for i, j, k in np.ndindex(2, 2, 2)]
            )
            if mesh.transform is not None:
                matrix = mesh.transform.at(0.0)
                corner = corner @ matrix[:3, :3].T + matrix[:3, 3]
            corners.append(corner)
    if not corners:
        return Camera(position=(0.0, 0.0, 1.0), look_at=(0.0, 0.0, 0.0))
    points = np.concatenate(corners)
    if not np.isfinite(points).all():
        raise SceneError("scene: no camera, and its bounds are not finite; give a camera")
    centre = (points.min(axis=0) + points.max(axis=0)) / 2.0
    radius = max(float(np.linalg.norm(points - centre, axis=1).max()), 1e-6)
    fov = 40.0
    distance = 1.05 * radius / np.sin(np.radians(fov / 2.0))
    direction = np.array([0.35, 0.25, 1.0])
    eye = centre + direction / np.linalg.norm(direction) * distance
    return Camera(position=tuple(eye), look_at=tuple(centre), fov=fov, name="framing")


def headlight(rotation: NDArray[np.float64]) -> tuple[Light, ...]:
    """Light along the view, from over the camera's left shoulder, and a little ambient light."""
    direction = rotation.T @ np.array([0.4, -0.5, -1.0])
    return (
        Light("ambient", intensity=0.15),
        Light("directional", intensity=0.85, direction=tuple(direction)),
    )
