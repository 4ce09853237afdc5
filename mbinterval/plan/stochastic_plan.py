"""The plan of the stochastic path and of accumulation: samples, culling, shading.

Accumulation is point sampling too: all samples of a slice share their time and their point of the
lens, so that each slice is the picture of a scene at rest.
"""

from __future__ import annotations

import math
from collections.abc import Set
from typing import TYPE_CHECKING

from mbinterval.errors import UsageError
from mbinterval.layout.appearance import casting
from mbinterval.plan.effects import Effect, active_macros, effects_of
from mbinterval.plan.plan import LIGHT_AROUND, Crop, Plan, sampling_macros, sampling_numbers
from mbinterval.plan.sampling import pattern_of, sample_count
from mbinterval.settings.settings import Settings

if TYPE_CHECKING:
    from mbinterval.exposure.exposure import Exposure
    from mbinterval.layout.motion import Motion

SLABS = 64
"""Samples of a pixel that a tile works on at a time: their arrays stay in the cache of one core.

The kernels have it as MOST_SLABS.
"""


def stochastic_plan(
    exposure: Exposure, motion: Motion, settings: Settings, width: int, height: int, crop: Crop
) -> Plan:
    """Plan the render of ``exposure``, laid out as ``motion``, by point samples."""
    shared = tuple(
        effect
        for effect in effects_of(exposure, motion, settings)
        if "stochastic" in effect.methods
    )
    effects = (*shared, *_own_effects(shared, settings))
    active = active_macros(effects)
    if "LENS" in active and settings.pattern == "rgss":
        raise UsageError("pattern='rgss' has no lens; use pattern='sobol', or leave f_stop out")
    if "LENS" in active and settings.test == "edges":
        raise UsageError("test='edges' has no lens; use test='vertices', or leave f_stop out")
    if "GLOSSY" in active and settings.test == "edges":
        raise UsageError(
            "test='edges' has no glossy mirrors; use test='vertices', or leave reflection_shear out"
        )
    if "WEIGHTED" in active and settings.pattern == "rgss":
        raise UsageError(f"pattern='rgss' has a filter of its own; leave out {settings.filter!r}")
    shadow_map = "SHADOWS" in active and settings.shadow_map is not None
    samples = sample_count(settings)
    slabs = min(samples, SLABS)
    # Slots of the fixed pattern are where the filter puts them; other places are put on the device.
    placed = set() if pattern_of(settings) == "fixed" else {"SCATTERED"}
    active |= sampling_macros(exposure, settings, active | placed)
    strata = _strata(settings, samples, active)
    sizes = {"STRATA": strata[0] ** 2 * strata[1]} if settings.cull == "pixar" else {}
    if "SHADOWS" in active:
        sizes["SHADOW_LIGHTS"] = len(casting(exposure, settings))
    if shadow_map:
        active |= {"SHADOW_MAP"}
    if settings.frameless > 1:
        active |= {"FRAMELESS"}
    if settings.cull_tile > 1:
        active |= {"CULL_TILES"}
    numbers = sampling_numbers(exposure, settings, width, height)
    numbers |= {
        "samples": samples,
        "layers": slabs,
        "slices": settings.slices,
        "columns": _nearest_divisor(samples),
        "shadow_size": settings.shadow_map or 0,
        "shadow_strata": settings.shadow_strata,
        "shadow_bias": settings.shadow_bias,
        "cull_tile": settings.cull_tile,
        "frameless": settings.frameless,
        "frameless_step": _step(settings.frameless),
        "strata_lens": strata[0],
        "strata_time": strata[1],
    }
    return Plan(
        width=width,
        height=height,
        crop=crop,
        region=_region(settings, crop),
        effects=effects,
        stages=(
            *(("cube_map",) if active & LIGHT_AROUND else ()),
            *("vertices", "bounds", "bin"),
            *(("shadow_map",) if shadow_map else ()),
            *("scatter", "sample", "shade", "resolve"),
            *(("rgss",) if settings.pattern == "rgss" else ()),
        ),
        active=active,
        sizes=tuple(sizes.items()),
        numbers=tuple(numbers.items()),
        settings=settings,
        tile=16,
        layers=slabs,
        capacity=0,
    )


def _region(settings: Settings, crop: Crop) -> Crop:
    """Return what is sampled for the film: with "rgss" a pixel more on all sides."""
    x, y, width, height = crop
    return (x - 1, y - 1, width + 2, height + 2) if settings.pattern == "rgss" else crop


def _own_effects(shared: tuple[Effect, ...], settings: Settings) -> tuple[Effect, ...]:
    active = active_macros(shared)
    slices = settings.method == "accumulation" and settings.slice_times != "stochastic"
    pattern = "slices" if slices else pattern_of(settings)
    times = f"slice_times={settings.slice_times!r}"
    in_order = pattern in ("sobol", "jittered", "fixed", "rgss", "interleave_uvt", "slices")
    reordered = "LENS" in active or ("MOVING" in active and not in_order)
    varying = bool(active & {"PHONG", "METALLIC", "TEXTURED", "VERTEX_COLOR"})
    rate = f"shading_rate={settings.shading_rate!r}"
    return (
        Effect(
            "sampling pattern",
            True,
            f"{settings.slices} slices, {times}" if slices else f"pattern={pattern!r}",
            f"PATTERN_{pattern.upper()}",
        ),
        Effect("slices at random times", slices and settings.slice_times == "jittered", times,
               "SLICES_JITTERED"),
        Effect(
            "samples reordered",
            reordered,
            "so that those of a slab look through a part of the lens"
            if "LENS" in active
            else "so that those of a slab are close in time"
            if reordered
            else "they come in order of time",
            "REORDERED",
        ),
        Effect("lines across the lens",
               bool(active & {"LENS", "GLOSSY"}) and settings.slice_lens == "line",
               f"slice_lens={settings.slice_lens!r}", "SLICE_LINES"),
        Effect("culling", True, f"cull={settings.cull!r}", f"CULL_{settings.cull.upper()}"),
        Effect("edge functions over time", settings.test == "edges", f"test={settings.test!r}",
               "TEST_EDGES"),
        Effect("shading once per pixel and triangle",
               varying and settings.shading_rate == "pixel", rate, "SHADE_PIXEL"),
        Effect("shading once per pixel at rest", varying and settings.hybrid,
               f"hybrid={settings.hybrid}", "SHADE_HYBRID"),
        Effect("shadow map", "SHADOWS" in active and settings.shadow_map is not None,
               f"shadow_map={settings.shadow_map}"),
        Effect("statistics", settings.statistics, f"statistics={settings.statistics}",
               "STATISTICS"),
        Effect("point samples", True, f"method={settings.method!r}", "STOCHASTIC"),
    )  # fmt: skip


def _strata(settings: Settings, samples: int, active: Set[str]) -> tuple[int, int]:
    if settings.cull != "pixar":
        return 0, 0
    return pixar_strata(samples, "MOVING" in active, "LENS" in active)


def pixar_strata(samples: int, moving: bool, lens: bool) -> tuple[int, int]:
    """Strata along each axis of the lens, and of time, as Laine et al. 2011, 4, divide them."""
    if not lens:
        return 1, min(samples, 256) if moving else 1
    if not moving:
        return min(math.isqrt(samples), 16), 1
    along = 1 if samples < 4 else 2 if samples < 64 else 4
    return along, max(1, min(samples, 256) // along**2)


def _nearest_divisor(count: int) -> int:
    """Return the divisor of ``count`` next to its square root, not above it."""
    return next(d for d in range(math.isqrt(count), 0, -1) if count % d == 0)


def _step(count: int) -> int:
    """Return a number without a common divisor with ``count``, near its golden section."""
    wanted = count * 0.618
    fits = (step for step in range(1, count + 1) if math.gcd(step, count) == 1)
    return min(fits, key=lambda step: abs(step - wanted))
