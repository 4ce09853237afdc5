"""Time in a USD stage: time codes of frames, places of prims, keyed attributes, visibility.

USD reads values when they are asked for, so a damaged file may be found out in any frame.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene.field_values import number
from mbinterval.scene.formats.usd.layers import without_link
from mbinterval.scene.frozen import OfStage
from mbinterval.scene.tracks import Track
from mbinterval.scene.transforms import Link, Placement, chain_matrices, links_of

Float64 = NDArray[np.float64]

_REASON = re.compile(r" : '(.*?)'\n", re.DOTALL)
_MOST_REASON = 300


@contextmanager
def reading_prim(prim: Any) -> Iterator[None]:
    """Name the prim that cannot be read, and of what USD says the reasons without its own lines.

    What USD or its values raise on a damaged file is anything at all, as in `reading`.
    """
    try:
        yield
    except (SceneError, MemoryError):
        raise
    except Exception as error:
        said = dict.fromkeys(" ".join(text.split()) for text in _REASON.findall(f"{error}\n"))
        reason = without_link("; ".join(said) or f"{type(error).__name__}: {error}")
        place = f"{prim}: cannot be read" if str(prim) else "not a readable USD file"
        raise SceneError(f"{place} ({reason[:_MOST_REASON]}); export it again") from error


@dataclass(frozen=True)
class Clock:
    """``rate`` is time codes per frame. It keeps its ``stage`` open for whom it tells the time."""

    stage: Any
    rate: float

    @cached_property
    def fingerprint(self) -> tuple[str, float]:
        """What tells it from others by contents: a digest of the stage, and the rate."""
        text = without_link(self.stage.ExportToString(addSourceFileComment=False))
        return hashlib.sha256(text.encode()).hexdigest(), self.rate

    def code(self, frame: float) -> Any:
        """Return the ``Usd.TimeCode`` of ``frame``."""
        from pxr import Usd

        return Usd.TimeCode(frame * self.rate)

    def frames(self, attributes: list[Any]) -> list[float]:
        """Frames of the samples of ``attributes``, ascending."""
        times = {time for attribute in attributes for time in attribute.GetTimeSamples()}
        return [time / self.rate for time in sorted(times)]


def between(keys: Float64, first: float, last: float, pieces: int) -> Float64:
    """Frames from ``first`` to ``last``, ``keys`` among them, and others evenly between these."""
    inner = keys[(keys > first) & (keys < last)]
    ends = np.concatenate([[first], inner, [last]])
    parts = np.arange(pieces) / pieces
    return np.append((ends[:-1, None] + parts * np.diff(ends)[:, None]).ravel(), last)


@dataclass(frozen=True, eq=False)
class Sampled(OfStage):
    """What a stage moves, a `Mover` by the samples of its ``attributes``.

    USD interpolates them by rules of its own, so that it is looked at ``pieces`` times between two.
    """

    clock: Clock
    path: str
    attributes: tuple[Any, ...]

    pieces: ClassVar[int] = 4

    def _name(self) -> tuple[Any, ...]:
        return type(self), id(self.clock.stage), self.path

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sampled) and self._name() == other._name()

    def __hash__(self) -> int:
        return hash(self._name())

    @cached_property
    def _frames(self) -> Float64:
        return np.array(self.clock.frames(list(self.attributes)))

    @property
    def source(self) -> Hashable | None:
        """See `Mover`."""
        moves = any(attribute.ValueMightBeTimeVarying() for attribute in self.attributes)
        return self._name() if moves else None

    @property
    def jumps(self) -> list[float]:
        """See `Mover`: values are interpolated."""
        return []

    def keys(self, first: float, last: float) -> Float64:
        """See `Mover`."""
        frames = self._frames
        return frames[(frames >= first) & (frames <= last)]

    def samples(self, first: float, last: float) -> Float64:
        """See `Mover`."""
        return between(self._frames, first, last, self.pieces)


class PrimLink(Sampled):
    """What a prim's own xformOps add to the place of its parent, a `Link`."""

    def local(self, frames: Float64, base: float) -> Float64:
        """See `Link`."""
        from pxr import UsdGeom

        xformable, found = UsdGeom.Xformable(self._prim), []
        with reading_prim(self.path):
            for frame in frames:
                matrix = columns(xformable.GetLocalTransformation(self.clock.code(float(frame))))
                found.append(finite(matrix, self.path, float(frame)))
        return np.array(found)

    def samples(self, first: float, last: float) -> Float64:
        """See `Mover`: angles may run through many turns from one sample to the next."""
        return between(self._frames, first, last, self._turns)

    @property
    def _prim(self) -> Any:
        return self.clock.stage.GetPrimAtPath(self.path)

    @cached_property
    def _turns(self) -> int:
        """Pieces between two samples in which the prim turns little."""
        most = 0.0
        for attribute in self.attributes:
            if ":rotate" in attribute.GetName():
                values = [attribute.Get(time) for time in attribute.GetTimeSamples()]
                angles = np.array(values, np.float64).reshape(len(values), -1)
                most += float(np.abs(np.diff(angles, axis=0)).sum(axis=1).max(initial=0.0))
        return int(min(max(self.pieces, most / _TURN), _MOST_PIECES))


_TURN = 11.25
_MOST_PIECES = 4096


def prim_links(prim: Any, clock: Clock, top: Any = None) -> list[Link] | None:
    """Links of ``prim`` and its ancestors up to ``top``, the outermost first.

    None where one below ``top`` leaves out what lies above it.
    """
    from pxr import UsdGeom

    found: list[Link] = []
    step = prim
    while step and not step.IsPseudoRoot():
        xformable = UsdGeom.Xformable(step)
        if xformable:
            ops = tuple(op.GetAttr() for op in xformable.GetOrderedXformOps())
            found.append(PrimLink(clock, str(step.GetPath()), ops))
            if xformable.GetResetXformStack():
                return None if top is not None and step != top else found[::-1]
        if top is not None and step == top:
            break
        step = step.GetParent()
    return found[::-1]


@dataclass(frozen=True, eq=False)
class PrimPlace(OfStage):
    """The place of a prim: local to world by its xformOps, under ``root``."""

    prim: Any
    clock: Clock
    root: Placement | None

    def links(self) -> list[Link]:
        """See `Link`."""
        return links_of(self.root) + (prim_links(self.prim, self.clock) or [])

    @property
    def animated(self) -> bool:
        """See `Placement`."""
        return any(link.source is not None for link in self.links())

    @property
    def jumps(self) -> list[float]:
        """See `Placement`: xformOps are interpolated."""
        return [] if self.root is None else self.root.jumps

    def at(self, frame: float, base: float | None = None) -> Float64:
        """See `Placement`."""
        path = self.prim.GetPath()
        frames = np.array([frame])
        return finite(chain_matrices([self.links()], frames, frame)[0, 0], path, frame)


def prim_place(prim: Any, clock: Clock, root: Placement | None) -> PrimPlace:
    """Place of ``prim``; whether it moves follows from all its ancestors' xformOps."""
    from pxr import UsdGeom

    place = PrimPlace(prim, clock, root)
    with reading_prim(prim.GetPath()):  # broken xformOps are told of while the file is read
        UsdGeom.Imageable(prim).ComputeLocalToWorldTransform(clock.code(0.0))
        place.at(0.0)
    return place


def columns(matrix: Any) -> Float64:
    """Gf matrix, which acts on rows, as an array that acts on columns."""
    return np.array(matrix, dtype=np.float64).T


def finite(matrix: Float64, prim: Any, frame: float) -> Float64:
    """Return ``matrix``, the place of ``prim``, if it has one."""
    if not np.isfinite(matrix).all():
        raise SceneError(f"{prim}: its place at frame {frame:g} is not finite")
    return matrix


def keyed(attribute: Any, clock: Clock) -> float | Track | None:
    """Value of a number's attribute, a track where it has several samples; None without value."""
    if attribute.GetNumTimeSamples() > 1:
        times = attribute.GetTimeSamples()
        values = np.array([attribute.Get(time) for time in times], dtype=np.float64)
        return Track(np.array(times) / clock.rate, values)
    from pxr import Usd

    value = attribute.Get(Usd.TimeCode.EarliestTime())
    return None if value is None else number(float(value), str(attribute.GetPath()))


def visibility(prim: Any, clock: Clock) -> bool | Track:
    """Whether ``prim`` is to be seen, over time where it or an ancestor appears and vanishes."""
    from pxr import Usd, UsdGeom

    imageable = UsdGeom.Imageable(prim)
    if imageable.ComputePurpose() in (UsdGeom.Tokens.proxy, UsdGeom.Tokens.guide):
        return False
    attributes = []
    step = prim
    while step and not step.IsPseudoRoot():
        if step.IsA(UsdGeom.Imageable):
            attributes.append(UsdGeom.Imageable(step).GetVisibilityAttr())
        step = step.GetParent()
    frames = clock.frames(attributes)
    codes = [clock.code(frame) for frame in frames] or [Usd.TimeCode.EarliestTime()]
    hidden = UsdGeom.Tokens.invisible
    seen = [imageable.ComputeVisibility(code) != hidden for code in codes]
    if all(seen) or not any(seen):
        return bool(seen[0])
    return Track(np.array(frames), np.array(seen, float), "step")
