"""Point instancers: where each instance is, and when."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene.formats.usd.times import (
    Clock,
    PrimPlace,
    Sampled,
    finite,
    prim_links,
    reading_prim,
)
from mbinterval.scene.frozen import OfStage
from mbinterval.scene.tracks import Track
from mbinterval.scene.transforms import Link, Opaque, chain_matrices

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
class Instance(Sampled):
    """What an instancer adds to its own place for one of its instances, a `Link`."""

    crowd: Crowd
    number: int
    moving: bool

    @property
    def source(self) -> Hashable | None:
        """See `Mover`: all instances of one instancer move alike."""
        return self._name() if self.moving else None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Instance) and super().__eq__(other) and self.number == other.number

    def __hash__(self) -> int:
        return hash((self._name(), self.number))

    def local(self, frames: Float64, base: float) -> Float64:
        """See `Link`."""
        found = []
        for frame in map(float, frames):
            instances = self.crowd.at(frame, base)
            if self.number >= len(instances):
                raise SceneError(
                    f"{self.path}: instance {self.number} is gone at frame {frame:g}; the number "
                    "of instances must stay"
                )
            found.append(instances[self.number])
        return np.array(found)


@dataclass(frozen=True, eq=False)
class InstancePlace(OfStage):
    """Place of a mesh in an instance: its own within the prototype, the instance's, the crowd's."""

    instance: Instance
    place: PrimPlace
    own: PrimPlace
    prototype: PrimPlace

    def links(self) -> list[Link]:
        """See `Link`.

        The prototype's own xformOps count, those of what it lies in don't.
        """
        within = prim_links(self.own.prim, self.own.clock, self.prototype.prim)
        if within is None:
            return [Opaque(self)]
        return [*self.place.links(), self.instance, *within]

    @property
    def animated(self) -> bool:
        """See `Placement`."""
        parts = (self.place, self.own, self.prototype)
        return self.instance.moving or any(part.animated for part in parts)

    @property
    def jumps(self) -> list[float]:
        """See `Placement`."""
        return [frame for part in (self.place, self.own) for frame in part.jumps]

    def at(self, frame: float, base: float | None = None) -> Float64:
        """See `Placement`."""
        frames, base = np.array([frame]), frame if base is None else base
        # A prim that leaves out what it lies in counts from the world.
        parent = self.prototype.at(frame) @ np.linalg.inv(_local(self.prototype, frame))
        within = np.linalg.inv(parent) @ self.own.at(frame)
        instance = self.instance.local(frames, base)[0]
        return np.asarray(self.place.at(frame, base) @ instance @ within)


def _local(place: PrimPlace, frame: float) -> Float64:
    """Local transform of the prim of ``place``."""
    links = prim_links(place.prim, place.clock, place.prim) or []
    return np.asarray(chain_matrices([links], np.array([frame]), frame)[0, 0])


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
