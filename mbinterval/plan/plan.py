"""What follows from the effects that a scene calls for: stages, compiler options and sizes.

An effect that is not called for leaves no code, no buffer and no stage.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Set
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.device import records
from mbinterval.device.kernel_effects import effect_options
from mbinterval.errors import UsageError
from mbinterval.plan.effects import Effect
from mbinterval.plan.sampling import filter_of, reach_of, sample_spacing
from mbinterval.settings.settings import Settings

if TYPE_CHECKING:
    from mbinterval.exposure.exposure import Exposure
    from mbinterval.scene.camera import Shutter
    from mbinterval.scene.model import Scene

LIGHT_AROUND = frozenset(("ENVIRONMENT", "REFLECTIONS"))
"""Macros of effects that need cube maps: stage "cube_map" makes them."""

Crop = tuple[int, int, int, int]


@dataclass(frozen=True)
class Plan:
    """How one exposure is rendered. Frozen and hashable; equal plans run the same kernels.

    Attributes
    ----------
    stages
        Names of the stages that run, in order; each is a file in ``cl/analytic``,
        ``cl/stochastic`` or ``cl/shared``, but "sample", the culling methods of
        ``cl/stochastic/cull``.
    active
        Macros of what is called for: of effects, and of what is left of others.
    sizes
        Sizes that the kernels are compiled with, by the name of their macro.
    numbers
        Fields of the record ``Numbers`` that the plan decides.
    crop, region
        Column, row, width and height, in the frame, of the film, and of what is rendered for it.
    tile, layers
        Edge of a tile in pixels; samples per pixel that a tile works on at a time.
    capacity
        Records in each of a work-item's pools at first; a pool that runs full is not an error.
    memory
        Bytes that buffers and film may take together; None is what the device has.
    """

    width: int
    height: int
    crop: Crop
    region: Crop
    effects: tuple[Effect, ...]
    active: frozenset[str]
    stages: tuple[str, ...]
    sizes: tuple[tuple[str, int], ...]
    numbers: tuple[tuple[str, int | float], ...]
    settings: Settings
    tile: int
    layers: int
    capacity: int
    memory: int | None = None

    @property
    def exact(self) -> bool:
        """Whether depth and attributes are exact functions of time."""
        return "EXACT" in self.active

    def size(self, name: str) -> int:
        """Return one of ``sizes``, 0 where it is none of them."""
        return dict(self.sizes).get(name, 0)

    @cached_property
    def options(self) -> tuple[str, ...]:
        """Compiler options of the kernels: one ``-D`` for each active effect and each size."""
        sizes = (f"-D{name}={value}" for name, value in self.sizes)
        return (*effect_options(self.active), *sizes)

    def flags(self, *names: str) -> tuple[str, ...]:
        """Compiler options of a kernel that knows only these effects."""
        return effect_options(self.active & set(names))


def sampling_macros(exposure: Exposure, settings: Settings, active: Set[str]) -> set[str]:
    """Return macros of what filter and lens add to their effects."""
    asked = {
        "FILTER_TABLE": "SCATTERED" in active and filter_of(settings) is not None,
        "BLADES": "LENS" in active and exposure.camera.blades,
    }
    return {name for name, wanted in asked.items() if wanted}


def sampling_numbers(
    exposure: Exposure, settings: Settings, width: int, height: int
) -> dict[str, int | float]:
    """Return what the kernels of all methods are told in numbers of frame, samples and shutter."""
    shape, camera, roll = filter_of(settings), exposure.camera, exposure.roll
    reach = reach_of(settings)
    return {
        "width": width,
        "height": height,
        "seed": settings.seed,
        "sample_spacing": sample_spacing(settings),
        "roll_start": roll.start if roll else 0.0,
        "roll_step": roll.step if roll else 0.0,
        "roll_length": roll.length if roll else 1.0,
        "shutter_keys": len(shutter_keys(exposure.shutter)),
        "filter_places": len(shape.table) - 1 if shape else 0,
        "filter_zero": shape.zero if shape else 0.0,
        "filter_mass": shape.mass**2 if shape else 1.0,
        "reach_low": min(reach),
        "reach_high": max(reach),
        "blades": camera.blades or 0,
        "blade_rotation": float(np.radians(math.fmod(camera.blade_rotation, 360.0))),
    }


def shutter_keys(shutter: Shutter) -> NDArray[np.void]:
    """Return the shutter's curve as ``ShutterKey`` records, times strictly ascending."""
    corners = shutter.keys()
    corners = corners[np.append(True, np.diff(corners[:, 0]) > 0.0)]
    t, opening = corners.T
    passed = np.append(0.0, np.cumsum(0.5 * (opening[1:] + opening[:-1]) * np.diff(t)))
    keys = np.zeros(len(t), records.SHUTTER_KEY)
    keys["t"], keys["open"], keys["passed"] = t, opening, passed / passed[-1]
    return keys


def roll_lines(scene: Scene, width: int, height: int) -> int:
    """Return the number of lines of the scene's shutter, rows or columns, if it rolls."""
    return width if scene.shutter.rolling in ("left", "right") else height


def check_crop(crop: Any, width: int, height: int) -> Crop:
    """Return ``crop`` as four whole numbers inside the frame, or the whole frame for None."""
    if crop is None:
        return (0, 0, width, height)
    try:
        x, y, columns, rows = (operator.index(value) for value in crop)
    except (TypeError, ValueError):
        raise UsageError(
            f"crop={crop!r}: expected four whole numbers: column, row, width and height"
        ) from None
    if min(x, y) < 0 or min(columns, rows) < 1 or x + columns > width or y + rows > height:
        raise UsageError(
            f"crop {x},{y},{columns},{rows} does not lie in the frame of {width} x {height} pixels"
        )
    return (x, y, columns, rows)
