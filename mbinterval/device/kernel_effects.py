"""The effects that kernels know, and the compiler options that call for them.

``cl/shared/effects.h`` has the same list, with what each is.
"""

from __future__ import annotations

from collections.abc import Iterable

KERNEL_EFFECTS = frozenset((
    *("MOVING", "EXACT", "STATIC"),
    *("PAIR_BY_DEPTH", "BIT_MASK", "PARTIAL_BITS", "MAX_INTERVALS"),
    *("PLACED", "SCATTERED", "FIVE_POINT", "WEIGHTED", "FILTER_TABLE"),
    *("LENS", "BLADES", "SHUTTER_CURVE", "ROLLING", "ROLLING_COLUMNS"),
    *("SINGLE_SIDED", "TRANSLUCENT", "ALPHA_VARIES", "VERTEX_ALPHA", "MIRRORS", "GLOSSY"),
    *("TEXTURED", "LARGE_UV", "VERTEX_COLOR", "PHONG", "METALLIC", "EMISSION", "SHADING_ERROR"),
    "ANISOTROPY",
    *("POINT_LIGHTS", "SPOT_LIGHTS", "SHADOWS", "SHADOW_MAP"),
    *("ENVIRONMENT", "SKY", "REFLECTIONS", "BACKGROUND_IMAGE", "TRANSPARENT"),
    *("MOMENTARY", "AOV_SHARP", "AOV_DEPTH", "AOV_NORMAL", "AOV_UV", "AOV_FORWARD"),
    *("AOV_BACKWARD", "AOV_MESH", "AOV_OPERATIONS", "RECORDED", "RECORDED_COLOR", "EVENT_STEPS"),
    *("STOCHASTIC", "PATTERN_SOBOL", "PATTERN_RANDOM", "PATTERN_JITTERED", "PATTERN_FIXED"),
    *("PATTERN_RGSS", "PATTERN_INTERLEAVE_UVT", "PATTERN_SLICES", "SLICES_JITTERED"),
    *("SLICE_LINES", "REORDERED", "FRAMELESS", "TEST_EDGES", "SHADE_PIXEL", "SHADE_HYBRID"),
    *("STATISTICS", "CULL_BBOX", "CULL_HULL", "CULL_OBB", "CULL_PIXAR", "CULL_INTERLEAVE_UVT"),
    *("CULL_DUAL_SPACE", "CULL_CLIP_SPACE", "CULL_CLIP_SPACE_PRINTED", "CULL_TRIM"),
    *("CULL_ZMAX", "CULL_ZMAX_STRATA", "CULL_ZMIN", "CULL_ZMIN_STRATA", "CULL_BEST"),
    "CULL_TILES",
    "CLANG_BUILTINS",
))  # fmt: skip


def effect_options(effects: Iterable[str]) -> tuple[str, ...]:
    """Return one compiler option for each of ``effects``, in alphabetical order.

    Raises
    ------
    LookupError
        Where ``KERNEL_EFFECTS`` lacks one: kernels would pass over it in silence.
    """
    named = sorted(set(effects))
    unknown = [name for name in named if name not in KERNEL_EFFECTS]
    if unknown:
        raise LookupError(f"no effect of the kernels: {', '.join(unknown)}")
    return tuple(f"-DMB_{name}" for name in named)
