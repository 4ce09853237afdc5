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
from mbinterval.scene.transforms import chain_matrices, links_of

Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CameraPoses:
    """The camera at T times.

    Attributes
    ----------
    eye
        ``(T, 3)`` world position.
    view
        ``(T, 3, 3)``: from the world, relative to the eye, to x and y times the focal length as a
        fraction of the image's height, and z; x to the right, y up, z away from the view. A
        negative determinant mirrors the picture.
    aperture, focus
        ``(T,)`` radius of the lens, 0 for a pinhole, and distance in focus, in world units.
    """

    eye: Float64
    view: Float64
    aperture: Float64
    focus: Float64

    @property
    def focal(self) -> Float64:
        """``(T,)`` focal length as a fraction of the image's height."""
        return np.asarray(np.linalg.norm(self.view[:, 0], axis=1))

    @property
    def rotation(self) -> Float64:
        """``(T, 3, 3)`` world to camera; rows are the camera's x, y and z axes in the world."""
        return np.asarray(self.view / np.linalg.norm(self.view, axis=2, keepdims=True))

    @property
    def moves(self) -> bool:
        """Whether any pose differs from the first."""
        parts = (self.eye, self.view, self.aperture, self.focus)
        return any(np.any(part != part[:1]) for part in parts)


def pixel_matrix(width: float, height: float) -> Float64:
    """``(3, 3)``: from `CameraPoses.view` to homogeneous pixels x w, y w, w."""
    return np.array([[height, 0, -width / 2], [0, -height, -height / 2], [0, 0, -1.0]])


def camera_poses(camera: Camera, frames: Float64, aspect: float) -> CameraPoses:
    """Poses of ``camera`` at ``frames``, shape (T,)."""
    if camera.transform is None:
        eye, rotation = _looking(camera, frames)
    else:
        eye, rotation = _placed(camera, frames)
    focal = _focal(camera, frames, aspect)
    zoom = np.stack([focal, focal, np.ones_like(focal)], axis=1)
    return CameraPoses(eye, rotation * zoom[:, :, None], *_lens(camera, frames, focal))


def _placed(camera: Camera, frames: Float64) -> tuple[Float64, Float64]:
    """Eye and rotation of a camera that a transform places.

    The view's axis stays; the others are made orthogonal to it, and to each other. Each keeps its
    sign, and no scale counts.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # the result is looked at
        matrices = chain_matrices([links_of(camera.transform)], frames, float(frames[0]))[:, 0]
        x, y, z = np.moveaxis(matrices[:, :3, :3], 2, 0)
        z = _unit(z)
        y = _unit(y - np.sum(y * z, axis=1, keepdims=True) * z)
        across = np.cross(y, z)
        side = np.sum(x * across, axis=1, keepdims=True)
    eye = matrices[:, :3, 3]
    axes = np.stack([np.sign(side) * across, y, z], axis=1)
    if not np.isfinite(matrices).all():
        raise SceneError("camera: its transform is not finite; check the scale keys")
    if not (np.isfinite(axes).all() and side.all()):
        raise SceneError("camera: its transform is singular; check the scale keys")
    return eye, axes


def bent_axes(camera: Camera, frame: float) -> str:
    """Say what a picture leaves out of the transform of ``camera``; nothing if it is all there."""
    if camera.transform is None:
        return ""
    axes = chain_matrices([links_of(camera.transform)], np.array([frame]), frame)[0, 0, :3, :3]
    lengths = np.linalg.norm(axes, axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        products = (axes / lengths).T @ (axes / lengths) - np.eye(3)
    if np.abs(products).max() > _EVEN:
        return "its axes, which its transform shears, are made orthogonal"
    if np.ptp(lengths) > _EVEN * lengths.max():
        return "the uneven scale of its transform is left out"
    return ""


_EVEN = 1e-5


def _unit(vectors: Float64) -> Float64:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def _looking(camera: Camera, frames: Float64) -> tuple[Float64, Float64]:
    """Eye and rotation of a camera that looks from its position at a point, or along -z."""
    shape = (len(frames), 3)
    eye = np.broadcast_to(value_at(camera.position, frames), shape)
    up = np.broadcast_to(value_at(camera.up, frames), shape)
    forward = np.broadcast_to((0.0, 0.0, -1.0), shape)
    if camera.look_at is not None:
        forward = value_at(camera.look_at, frames) - eye
    distance = np.linalg.norm(forward, axis=1)
    right = np.cross(forward, up)
    size = np.linalg.norm(right, axis=1)
    if not distance.all():
        raise SceneError("camera: position and look_at are the same point; move one")
    if np.any(size <= 1e-9 * distance * np.linalg.norm(up, axis=1)):
        raise SceneError("camera: up is parallel to the view; give another up vector")
    forward, right = forward / distance[:, None], right / size[:, None]
    return np.array(eye), np.stack([right, np.cross(right, forward), -forward], axis=1)


def _focal(camera: Camera, frames: Float64, aspect: float) -> Float64:
    """Focal length ``(T,)`` as a fraction of the image's height."""
    if camera.focal_length is None:
        fov = value_at(45.0 if camera.fov is None else camera.fov, frames)
        given = np.asarray(0.5), np.tan(np.radians(fov) / 2.0)
    else:
        given = value_at(camera.focal_length, frames), np.asarray(camera.vertical_aperture or 24.0)
        if camera.vertical_aperture is None and camera.horizontal_aperture is not None:
            given = given[0] * aspect, np.asarray(camera.horizontal_aperture)
    focal, height, _ = np.broadcast_arrays(*given, np.zeros(len(frames)))
    wrong = ~((height / LARGEST <= focal) & (focal <= height * LARGEST))
    if wrong.any():
        fields = "fov" if camera.focal_length is None else "focal_length and aperture"
        raise SceneError(
            f"{field_values.named('camera', camera.name)}: {fields} make a focal length of "
            f"{focal[wrong][0]:.3g} for {height[wrong][0]:.3g} of the image's height, which "
            "float32 can't hold"
        )
    return np.asarray(focal / height)


def _lens(camera: Camera, frames: Float64, focal: Float64) -> tuple[Float64, Float64]:
    """Radii ``(T,)`` of the lens and distances in focus, in world units; 0 and 1 for a pinhole."""
    if camera.f_stop is None:
        return np.zeros(len(frames)), np.ones(len(frames))
    millimetres = focal * 24.0
    if camera.focal_length is not None:
        millimetres = value_at(camera.focal_length, frames) + np.zeros(len(frames))
    with np.errstate(over="ignore"):
        f_stop = value_at(camera.f_stop, frames)
        radius = millimetres * 1e-3 / camera.meters_per_unit / f_stop / 2.0
    if radius.max() > LARGEST:
        raise SceneError(
            f"{field_values.named('camera', camera.name)}: focal length, f_stop and "
            f"meters_per_unit make a lens of {radius.max():.3g} units, which float32 can't hold"
        )
    focus = np.broadcast_to(value_at(camera.focus_distance, frames), radius.shape)
    return radius, np.array(focus)
