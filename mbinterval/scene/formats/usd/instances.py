"""Point instancers: where each instance is, and when."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene.formats.usd.times import Clock, columns, finite, reading_prim
from mbinterval.scene.frozen import OfStage
from mbinterval.scene.tracks import Placement, Track

Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Crowd(OfStage):
    """Transforms of all instances of a point instancer, kept for the times that were asked for."""

    source: Any
    clock: Clock
    known: dict[tuple[float, float], Float64]

    def at(self, frame: float, base: float) -> Float64:
        """``(n, 4, 4)`` of the instances, within the instancer; masked ones too."""
        from pxr import UsdGeom

        key = (frame, base)
        places = self.known.get(key)  # other threads may clear it at any time
        if places is None:
            if len(self.known) >= 1024:
                self.known.clear()
            path = self.source.GetPath()
            with reading_prim(path):
                found = self.source.ComputeInstanceTransformsAtTime(
                    self.clock.code(frame),
                    self.clock.code(base),
                    UsdGeom.PointInstancer.ExcludeProtoXform,
                    UsdGeom.PointInstancer.IgnoreMask,
                )
                places = np.array(found, dtype=np.float64).transpose(0, 2, 1)
            self.known[key] = finite(places, path, frame)
        return places


@dataclass(frozen=True, eq=False)
class InstancePlace(OfStage):
    """Place of a mesh in an instance: its own within the prototype, the instance's, the crowd's."""

    crowd: Crowd
    number: int
    place: Placement
    own: Placement
    prototype: Placement
    moving: bool

    @property
    def animated(self) -> bool:
        """See `Placement`."""
        parts = (self.place, self.own, self.prototype)
        return self.moving or any(part.animated for part in parts)

    @property
    def jumps(self) -> list[float]:
        """See `Placement`."""
        return [frame for part in (self.place, self.own) for frame in part.jumps]

    def at(self, frame: float, base: float | None = None) -> Float64:
        """See `Placement`."""
        instances = self.crowd.at(frame, frame if base is None else base)
        if self.number >= len(instances):
            raise SceneError(
                f"{self.crowd.source.GetPath()}: instance {self.number} is gone at frame "
                f"{frame:g}; the number of instances must stay"
            )
        # The prototype's own xformOps count, those of what it lies in don't.
        parent = self.prototype.at(frame) @ np.linalg.inv(_local(self.prototype, frame))
        within = np.linalg.inv(parent) @ self.own.at(frame)
        return np.asarray(self.place.at(frame) @ instances[self.number] @ within)


def _local(place: Any, frame: float) -> Float64:
    """Local transform of the prim of ``place``."""
    from pxr import UsdGeom

    xformable = UsdGeom.Xformable(place.prim)
    if not xformable:
        return np.eye(4)
    return columns(xformable.GetLocalTransformation(place.clock.code(frame)))


def instance_masks(source: Any, clock: Clock, count: int) -> list[bool | Track]:
    """When each instance is there: neither inactive nor among invisibleIds."""
    frames = clock.frames([source.GetInvisibleIdsAttr()])
    from pxr import Usd

    codes = [clock.code(frame) for frame in frames] or [Usd.TimeCode.EarliestTime()]
    given = [np.array(source.ComputeMaskAtTime(code), dtype=bool) for code in codes]
    masks = np.array([mask if len(mask) == count else np.ones(count, bool) for mask in given])
    result: list[bool | Track] = []
    for column in masks.T:
        constant = column.all() or not column.any()
        result.append(
            bool(column[0]) if constant else Track(np.array(frames), column.astype(float), "step")
        )
    return result
