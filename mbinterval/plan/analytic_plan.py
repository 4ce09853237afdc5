"""The plan of the analytic path: what is solved in time, and by which stages."""

from __future__ import annotations

from collections.abc import Set
from typing import TYPE_CHECKING

from mbinterval.errors import UsageError
from mbinterval.film.aovs import FLOWS, plane_sizes
from mbinterval.layout.appearance import casting
from mbinterval.plan.effects import active_macros, effects_of
from mbinterval.plan.plan import LIGHT_AROUND, Crop, Plan, sampling_macros, sampling_numbers
from mbinterval.settings.settings import Settings

if TYPE_CHECKING:
    from mbinterval.exposure.exposure import Exposure
    from mbinterval.layout.motion import Motion

_SAMPLES_AT_A_TIME = 1024
_POOL_RECORDS = 65536


def analytic_plan(
    exposure: Exposure,
    motion: Motion,
    settings: Settings,
    width: int,
    height: int,
    crop: Crop,
) -> Plan:
    """Plan the render of ``exposure``, laid out as ``motion``, exact in time."""
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
    sizes = {"TILE": tile} | plane_sizes(settings.aovs)
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
            *(("cube_map",) if active & LIGHT_AROUND else ()),
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


# A setting is an effect where it adds code, and a number where it only changes what code reckons.
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


def _time_stages(settings: Settings, active: Set[str]) -> tuple[str, ...]:
    if settings.paths == "triangulated":
        return ("rasterize", "intervals", "sort", "occlude")
    if active & {"TRANSLUCENT", "MIRRORS"}:
        return ("solve", "stack")
    return ("solve", "envelope" if settings.occlusion == "exact" else "mask")


def _around(crop: Crop, width: int, height: int) -> Crop:
    """Grow a part of the frame by a pixel on all sides, as far as there is one."""
    left, top = max(crop[0] - 1, 0), max(crop[1] - 1, 0)
    right, bottom = min(crop[0] + crop[2] + 1, width), min(crop[1] + crop[3] + 1, height)
    return (left, top, right - left, bottom - top)
