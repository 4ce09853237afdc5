"""Time in a USD stage: time codes of frames, places of prims, keyed attributes, visibility.

USD reads values when they are asked for, so a damaged file may be found out in any frame.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene.field_values import number
from mbinterval.scene.formats.usd.layers import without_link
from mbinterval.scene.frozen import OfStage
from mbinterval.scene.tracks import Placement, Track

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


@dataclass(frozen=True, eq=False)
class PrimPlace(OfStage):
    """The place of a prim: local to world by its xformOps, under ``root``."""

    prim: Any
    clock: Clock
    root: Placement | None
    animated: bool

    @property
    def jumps(self) -> list[float]:
        """See `Placement`: xformOps are interpolated."""
        return [] if self.root is None else self.root.jumps

    def at(self, frame: float, base: float | None = None) -> Float64:
        """See `Placement`."""
        from pxr import UsdGeom

        path = self.prim.GetPath()
        with reading_prim(path):
            imageable = UsdGeom.Imageable(self.prim)
            local = columns(imageable.ComputeLocalToWorldTransform(self.clock.code(frame)))
        return under(self.root, finite(local, path, frame), frame)


def prim_place(prim: Any, clock: Clock, root: Placement | None) -> PrimPlace:
    """Place of ``prim``; whether it moves follows from all its ancestors' xformOps."""
    from pxr import UsdGeom

    ops: list[Any] = []
    step = prim
    while step and not step.IsPseudoRoot():
        xformable = UsdGeom.Xformable(step)
        if xformable:
            ops += [op.GetAttr() for op in xformable.GetOrderedXformOps()]
            if xformable.GetResetXformStack():
                break
        step = step.GetParent()
    moving = [op for op in ops if op.ValueMightBeTimeVarying()]
    animated = bool(moving) or (root is not None and root.animated)
    place = PrimPlace(prim, clock, root, animated)
    place.at(0.0)  # broken xformOps are told of while the file is read
    return place


def columns(matrix: Any) -> Float64:
    """Gf matrix, which acts on rows, as an array that acts on columns."""
    return np.array(matrix, dtype=np.float64).T


def finite(matrix: Float64, prim: Any, frame: float) -> Float64:
    """Return ``matrix``, the place of ``prim``, if it has one."""
    if not np.isfinite(matrix).all():
        raise SceneError(f"{prim}: its place at frame {frame:g} is not finite")
    return matrix


def under(root: Placement | None, matrix: Float64, frame: float) -> Float64:
    """``matrix`` in the space of ``root`` at ``frame``."""
    return matrix if root is None else root.at(frame) @ matrix


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
