"""One copy of a mesh as a lens with limits sees it at the knots of its motion."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mbinterval.exposure.limits import Bends, bends_of
from mbinterval.exposure.mesh_exposure import MeshExposure
from mbinterval.exposure.mirrors import Mirror
from mbinterval.exposure.poses import CameraPoses
from mbinterval.exposure.segments import BORDER, View

Float64 = NDArray[np.float64]
Places = NDArray[np.int64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Sight:
    """Where the camera sees a mesh at the knots of its motion, one after the other.

    Attributes
    ----------
    positions
        ``(T, n, 3)`` in the world, at all K + 1 knots or, with T = 1, the same at each.
    poses
        The camera at the knots; a mesh at rest has two that are equal.
    size
        Of the image in pixels.
    light
        Greatest share of a pixel's light that comes in one segment.
    mirror
        The glossy mirror that it is seen in, if it is.
    """

    positions: Float64
    poses: CameraPoses
    bends: Bends
    size: tuple[float, float]
    light: float
    mirror: Mirror | None = None

    @property
    def knots(self) -> int:
        """K + 1."""
        return len(self.poses.eye)

    def of(self, positions: Float64) -> Sight:
        """Return how other ``positions`` are seen."""
        return replace(self, positions=positions)

    @property
    def depths(self) -> Float64:
        """``(K+1, n)`` depths along the view: the same bits for the same positions, anywhere."""
        return np.array([self.depth_at(knot) for knot in range(self.knots)])

    def depth_range(self) -> tuple[Float64, Float64]:
        """Least and greatest depth of each vertex, ``(n,)``."""
        low = high = self.depth_at(0)
        for knot in range(1, self.knots):
            depth = self.depth_at(knot)
            low, high = np.minimum(low, depth), np.maximum(high, depth)
        return low, high

    def depth_at(self, knot: int) -> Float64:
        """``(n,)`` depths at one knot."""
        return -self._along(knot, 2)

    def _along(self, knot: int, axis: int) -> Float64:
        """Coordinates of the camera, ``(n,)``. A product of matrices could round by the place."""
        x, y, z = (self._points(knot) - self.poses.eye[knot]).T
        row = self.poses.rotation[knot, axis]
        return np.asarray(row[0] * x + row[1] * y + row[2] * z)

    def _points(self, knot: int) -> Float64:
        return np.asarray(self.positions[min(knot, len(self.positions) - 1)])

    def outside(self) -> Flags:
        """``(n, 5)``: what is outside of the frame, to one side, throughout (`outside_at`)."""
        found = self.outside_at(0)
        for knot in range(1, self.knots):
            found &= self.outside_at(knot)
        return found

    def outside_at(self, knot: int) -> Flags:
        """``(n, 5)``: what is left, right, above, below of the frame, behind the eye, at a knot.

        With the blur that it may have. Between vertices on one side all is on that side.
        """
        w, bends = self.depth_at(knot), self.bends
        near, far, focal = bends.near[knot], bends.far[knot], self.poses.focal[knot] * self.size[1]
        blur = bends.slope[knot] * np.maximum(np.maximum(near - w, w - far), 0.0)
        spread = np.zeros_like(w)
        if self.mirror is not None:
            spread = self.mirror.shear * np.abs(self.mirror.heights(self._points(knot)))
        found = np.empty((len(w), 5), bool)
        for axis, size in enumerate(self.size):
            reach = (0.5 + BORDER) * size
            place = focal * self._along(knot, axis)
            room = reach * w + blur + (np.hypot(focal, size) + reach) * spread
            found[:, 2 * axis], found[:, 2 * axis + 1] = place < -room, place > room
        found[:, 4] = w + spread <= 0.0
        return found


def sight_of(mesh: MeshExposure, view: View, light: float, mirror: Mirror | None) -> Sight:
    """How ``mesh`` is seen by the camera of ``view``, in ``mirror`` if that is glossy.

    ``light`` is the greatest density of a pixel's light over the shutter; 1 if it is even.
    """
    knots = np.arange(mesh.segments + 1) if mesh.segments else np.zeros(2, int)
    poses = mesh.poses.at(knots)
    return Sight(
        positions=mesh.positions,
        poses=poses,
        bends=bends_of(view.camera, poses, view.height),
        size=(view.aspect * view.height, float(view.height)),
        light=light * (mesh.close - mesh.open) / max(mesh.segments, 1),
        mirror=mirror if mirror is not None and mirror.shear > 0.0 else None,
    )
