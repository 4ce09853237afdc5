"""Where a lens's limits bend its blur: `Camera.sharp_range` and `Camera.foreground_blur`.

The circle of confusion times the depth w, in pixels, is affine in w for a thin lens. With limits
(Wu et al. 2015, 3.4) it is affine in parts. It is what it is nearest to the eye, plus the sum over
*bends* of ``change * max(0, w - place)``, each added or taken off.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbinterval.exposure.poses import CameraPoses
from mbinterval.scene.camera import Camera

Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Bends:
    """The lens of a camera with limits at T times.

    Attributes
    ----------
    places
        ``(J, T)`` depths above 0 at which the blur bends.
    changes
        ``(J, T)`` by how much its slope changes there, in pixels: at least 0.
    slope
        ``(T,)`` of the circle without limits: its radius in pixels at infinity.
    near, far
        ``(T,)`` ends of the range in focus.
    limit
        Greatest radius of blur in pixels before the focus.
    """

    places: Float64
    changes: Float64
    slope: Float64
    near: Float64
    far: Float64
    limit: float

    def at(self, which: slice) -> Bends:
        """Return some of the times."""
        parts = (self.slope[which], self.near[which], self.far[which])
        return Bends(self.places[:, which], self.changes[:, which], *parts, self.limit)

    def circle(self, w: Float64) -> Float64:
        """Radius of blur times depth, in pixels, at depths ``(T, ...)``: ``cl/shared/vertices.cl``.

        Behind the eye it goes on as it is next to it, so that it is affine there too.
        """
        shape = (-1,) + (1,) * (w.ndim - 1)
        slope, near, far = (a.reshape(shape) for a in (self.slope, self.near, self.far))
        free = slope * (w - np.clip(w, near, far))
        return free if np.isinf(self.limit) else np.maximum(free, -self.limit * w)


def has_limits(camera: Camera) -> bool:
    """Whether limits bend the blur of ``camera``."""
    return camera.sharp_range is not None or camera.foreground_blur is not None


def bends_of(camera: Camera, poses: CameraPoses, height: int) -> Bends:
    """Return where the blur of ``camera`` bends at ``poses``, for an image of ``height`` pixels."""
    slope = poses.aperture * poses.focal * height / poses.focus
    ends = camera.sharp_range or (poses.focus, poses.focus)
    near, far = (np.broadcast_to(np.asarray(end), slope.shape) for end in ends)
    blur = camera.foreground_blur
    limit = np.inf if blur is None else blur * height
    bends = [(near, -slope), (far, slope)]
    if limit == 0.0:
        bends.append((near, slope))
    elif limit < np.inf:
        bends.append((slope * near / (slope + limit), slope + limit))
    found = _merged(bends)
    count = len(slope)
    return Bends(
        places=np.array([place for place, _ in found]).reshape(-1, count),
        changes=np.abs([change for _, change in found]).reshape(-1, count),
        slope=slope,
        near=near,
        far=far,
        limit=limit,
    )


def _merged(bends: list[tuple[Float64, Float64]]) -> list[tuple[Float64, Float64]]:
    """Add up bends in one place at all times; leave out what is no bend then."""
    found: list[tuple[Float64, Float64]] = []
    for place, change in bends:
        same = next((i for i, (at, _) in enumerate(found) if np.array_equal(at, place)), None)
        if same is None:
            found.append((place, change))
        else:
            found[same] = place, found[same][1] + change
    return [(place, change) for place, change in found if change.any()]
