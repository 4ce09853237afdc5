"""The camera over the shutter: where it is, how it is turned, and what its lens does.

An animated `Camera` is evaluated at the times that an exposure asks for; what is left are arrays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene import field_values
from mbinterval.scene.camera import Camera
from mbinterval.scene.field_values import LARGEST
from mbinterval.scene.tracks import value_at

Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CameraPoses:
    """The camera at T times.

    Attributes
    ----------
    eye
        ``(T, 3)`` world position.
    rotation
        ``(T, 3, 3)`` world to camera; rows are the camera's x, y and z axes in the world.
    focal
        ``(T,)`` focal length as a fraction of the image's height.
    aperture, focus
        ``(T,)`` radius of the lens, 0 for a pinhole, and distance in focus, in world units.
    """

    eye: Float64
    rotation: Float64
    focal: Float64
    aperture: Float64
    focus: Float64

    @property
    def moves(self) -> bool:
        """Whether any pose differs from the first."""
        parts = (self.eye, self.rotation, self.focal, self.aperture, self.focus)
        return any(np.any(part != part[:1]) for part in parts)

    def at(self, which: NDArray[np.int64]) -> CameraPoses:
        """Return some of the poses."""
        parts = (self.eye, self.rotation, self.focal, self.aperture, self.focus)
        return CameraPoses(*(part[which] for part in parts))


def camera_poses(camera: Camera, frames: Float64, aspect: float) -> CameraPoses:
    """Poses of ``camera`` at ``frames``, shape (T,)."""
    eyes, rotations, focals, apertures, focuses = [], [], [], [], []
    for frame in map(float, frames):
        if camera.transform is not None:
            with np.errstate(over="ignore", invalid="ignore"):  # the result is looked at
                matrix = camera.transform.at(frame)
                eye, axes = matrix[:3, 3], matrix[:3, :3].T
                lengths = np.linalg.norm(axes, axis=1, keepdims=True)
            if not lengths.all():
                raise SceneError("camera: its transform is singular; check the scale keys")
            if not (np.isfinite(lengths).all() and np.isfinite(eye).all()):
                raise SceneError("camera: its transform is not finite; check the scale keys")
            rotation = axes / lengths
        else:
            eye = value_at(camera.position, frame)
            target = None if camera.look_at is None else value_at(camera.look_at, frame)
            rotation = _looking(eye, target, value_at(camera.up, frame))
        eyes.append(eye)
        rotations.append(rotation)
        focals.append(_focal(camera, frame, aspect))
        aperture, focus = _lens(camera, frame, focals[-1])
        apertures.append(aperture)
        focuses.append(focus)
    lens = np.array(apertures), np.array(focuses)
    return CameraPoses(np.array(eyes), np.array(rotations), np.array(focals), *lens)


def _looking(eye: Float64, target: Float64 | None, up: Float64) -> Float64:
    """World-to-camera rotation that looks from ``eye`` at ``target``."""
    forward = np.array([0.0, 0.0, -1.0]) if target is None else target - eye
    distance = np.linalg.norm(forward)
    right = np.cross(forward, up)
    size = np.linalg.norm(right)
    if not distance:
        raise SceneError("camera: position and look_at are the same point; move one")
    if size <= 1e-9 * distance * np.linalg.norm(up):
        raise SceneError("camera: up is parallel to the view; give another up vector")
    forward, right = forward / distance, right / size
    return np.array([right, np.cross(right, forward), -forward])


def _focal(camera: Camera, frame: float, aspect: float) -> float:
    """Focal length as a fraction of the image's height."""
    if camera.focal_length is None:
        fov = 45.0 if camera.fov is None else float(value_at(camera.fov, frame))
        focal, height = 0.5, float(np.tan(np.radians(fov) / 2.0))
    else:
        focal, height = (
            float(value_at(camera.focal_length, frame)),
            camera.vertical_aperture or 24.0,
        )
        if camera.vertical_aperture is None and camera.horizontal_aperture is not None:
            focal, height = focal * aspect, camera.horizontal_aperture
    if not height / LARGEST <= focal <= height * LARGEST:
        fields = "fov" if camera.focal_length is None else "focal_length and aperture"
        raise SceneError(
            f"{field_values.named('camera', camera.name)}: {fields} make a focal length of "
            f"{focal:.3g} for {height:.3g} of the image's height, which float32 can't hold"
        )
    return focal / height


def _lens(camera: Camera, frame: float, focal: float) -> tuple[float, float]:
    """Radius of the lens and distance in focus, in world units; 0 and 1 for a pinhole."""
    if camera.f_stop is None:
        return 0.0, 1.0
    if camera.focal_length is None:
        millimetres = focal * 24.0
    else:
        millimetres = float(value_at(camera.focal_length, frame))
    f_stop = float(value_at(camera.f_stop, frame))
    with np.errstate(over="ignore"):
        radius = float(np.float64(millimetres * 1e-3) / camera.meters_per_unit / f_stop / 2.0)
    if radius > LARGEST:
        raise SceneError(
            f"{field_values.named('camera', camera.name)}: focal length, f_stop and "
            f"meters_per_unit make a lens of {radius:.3g} units, which float32 can't hold"
        )
    return radius, float(value_at(camera.focus_distance, frame))
