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

from mbinterval.aovs import FLOWS
from mbinterval.appearance import casting
from mbinterval.device import records
from mbinterval.device.kernel_effects import effect_options
from mbinterval.effects import Effect, active_macros, effects_of
from mbinterval.errors import UsageError
from mbinterval.sampling import filter_of, reach_of
from mbinterval.settings import Settings

if TYPE_CHECKING:
    from mbinterval.motion import Motion
    from mbinterval.scene.camera import Shutter
    from mbinterval.scene.exposure import Exposure
    from mbinterval.scene.model import Scene

_SAMPLES_AT_A_TIME = 1024
_POOL_RECORDS = 65536
AROUND = frozenset(("ENVIRONMENT", "SKY", "REFLECTIONS"))
"""Macros of effects that need cube maps: stage "cube_map" makes them."""

Crop = tuple[int, int, int, int]


@dataclass(frozen=True)
class Plan:
    """How one exposure is rendered. Frozen and hashable; equal plans run the same kernels.

    Attributes
    ----------
    stages
        Names of the stages that run, in order; each is a file in ``cl/analytic`` or ``cl/shared``.
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


def make_plan(
    exposure: Exposure,
    motion: Motion,
    settings: Settings,
    width: int,
    height: int,
    crop: Crop,
) -> Plan:
    """Plan the render of ``exposure``, laid out as ``motion``."""
    if settings.method != "analytic":
        from mbinterval.stochastic_plan import stochastic_plan

        return stochastic_plan(exposure, motion, settings, width, height, crop)
    effects = effects_of(exposure, motion, settings)
    active = active_macros(effects)
    active |= sampling_macros(exposure, settings, active) | _own_macros(settings, active)
    if "LENS" in active and settings.paths == "triangulated":
        raise UsageError("paths='triangulated' has no lens; use paths='exact', or leave f_stop out")
    if (settings.paths, settings.occlusion) != ("exact", "exact"):
        _refuse_stacks(settings, active)
    if "SHADOWS" in active and settings.paths != "exact":
        raise UsageError("shadows need paths='exact'; use that, or shadows='off'")
    if "REFLECTIONS" in active and settings.paths != "exact":
        raise UsageError("reflections of surroundings need paths='exact'; use that, or none")
    if exposure.roll is not None and set(FLOWS) & set(settings.aovs):
        raise UsageError(
            "aovs: forward and backward need all lines of a frame at one time, but the shutter "
            "rolls; leave them out, or leave out shutter.rolling"
        )
    tile = settings.tile_size
    layers = max(1, min(settings.samples, _SAMPLES_AT_A_TIME // tile**2))
    sizes = {"TILE": tile}
    if "BIT_MASK" in active:
        sizes["MASK_BITS"] = int(settings.occlusion)
    if "SHADOWS" in active:
        sizes["SHADOW_LIGHTS"] = len(casting(exposure, settings))
    numbers = sampling_numbers(exposure, settings, width, height) | {
        "samples": settings.samples,
        "layers": layers,
        "most_intervals": settings.max_intervals or 0,
        "shading_error": settings.shading_error,
        "shading_times": settings.shading_times or 0,
        "anisotropy": settings.anisotropy,
        "sample_spacing": settings.samples**-0.5,
        "moment": settings.aov_time,
        "event_steps": settings.event_steps,
    }
    timed = _time_stages(settings, active) if "MOVING" in active else ()
    return Plan(
        width=width,
        height=height,
        crop=crop,
        region=_around(crop, width, height) if "FIVE_POINT" in active else crop,
        effects=effects,
        stages=(
            *(("cube_map",) if active & AROUND else ()),
            "paths",
            "bin",
            *(("place",) if "PLACED" in active else ()),
            *(("nearest",) if "STATIC" in active else ()),
            *timed,
            *(("shadow",) if "SHADOWS" in active else ()),
            "shade",
            *(("record",) if "RECORDED" in active else ()),
            *(("moment",) if "MOMENTARY" in active else ()),
            "resolve",
            *(("share",) if "FIVE_POINT" in active else ()),
        ),
        active=active,
        sizes=tuple(sizes.items()),
        numbers=tuple(numbers.items()),
        settings=settings,
        tile=tile,
        layers=layers,
        capacity=_POOL_RECORDS if timed or "SHADOWS" in active else 1,
    )


def _refuse_stacks(settings: Settings, active: Set[str]) -> None:
    """Refuse what is seen at once with settings that know one surface at a time."""
    given = f"paths={settings.paths!r} and occlusion={settings.occlusion!r}"
    for macro, what, remedy in (
        ("TRANSLUCENT", "what is translucent needs", "alpha_mode='opaque'"),
        ("MIRRORS", "mirrors need", "reflectivity=0"),
    ):
        if macro in active:
            raise UsageError(
                f"{what} paths='exact' and occlusion='exact', not {given}; or give materials "
                f"{remedy}"
            )


def _own_macros(settings: Settings, active: Set[str]) -> set[str]:
    """Return macros of what settings add to effects of the analytic path."""
    varying = active & {"PHONG", "METALLIC", "TEXTURED", "VERTEX_COLOR", "SKY"}
    asked = {
        "BIT_MASK": "MOVING" in active and settings.occlusion != "exact",
        "MAX_INTERVALS": "MOVING" in active and settings.max_intervals is not None,
        "SHADING_ERROR": varying and settings.shading_times is None,
        "ANISOTROPY": "TEXTURED" in active and settings.anisotropy > 0,
        "EVENT_STEPS": "events" in settings.aovs,
    }
    return {name for name, wanted in asked.items() if wanted}


def _around(crop: Crop, width: int, height: int) -> Crop:
    """Grow a part of the frame by a pixel on all sides, as far as there is one."""
    left, top = max(crop[0] - 1, 0), max(crop[1] - 1, 0)
    right, bottom = min(crop[0] + crop[2] + 1, width), min(crop[1] + crop[3] + 1, height)
    return (left, top, right - left, bottom - top)


def sampling_macros(exposure: Exposure, settings: Settings, active: Set[str]) -> set[str]:
    """Return macros of what filter, lens and shutter add to their effects."""
    asked = {
        "FILTER_TABLE": "SCATTERED" in active and filter_of(settings) is not None,
        "BLADES": "LENS" in active and exposure.camera.blades,
        "SHUTTER_CURVE": "MOVING" in active and exposure.shutter.curve != "box",
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


def _time_stages(settings: Settings, active: Set[str]) -> tuple[str, ...]:
    if settings.paths == "triangulated":
        return ("rasterize", "intervals", "sort", "occlude")
    if active & {"TRANSLUCENT", "MIRRORS"}:
        return ("solve", "stack")
    return ("solve", "envelope" if settings.occlusion == "exact" else "mask")


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
