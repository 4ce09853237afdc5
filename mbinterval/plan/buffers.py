"""What a plan asks of memory: its tiles, what a work-item holds of one, and the film.

A work-item has scratch, arrays of a fixed size for the samples and pixels of a tile, and with the
analytic path pools, records of as many path intervals as a tile happens to have.
"""

from __future__ import annotations

from mbinterval.device import records
from mbinterval.film.aovs import plane_count
from mbinterval.plan.plan import Plan
from mbinterval.plan.sampling import sample_count

LANES = 16
"""Records of every pool beyond its capacity, for each work-item: sorts write whole vectors."""
LEAST_CAPACITY = 4096
"""Records of the smallest pools that a render begins with where memory is short."""
LEAST_EVENTS = 1 << 12
"""Visible spans of the smallest pool of those that are recorded."""

_SAMPLES = {
    **{"sample_static_depth": "double", "sample_static_part": "uint", "sample_heads": "int"},
    **{"sample_met": "uint", "sample_spans": "Run", "sample_still": "float4"},
}
_PIXELS = {"pixel_color": "float4", "pixel_depth": "float", "pixel_met": "uint"}
_EXACT_POOLS = {"visits": "Visit", "fronts": "Front", "merged": "Front", "ordering": "Ordering"}
_TRIANGULATED_POOLS = {
    **{"fragments": "Fragment", "intervals": "Interval"},
    **{"sorting": "Sorting", "sorted": "Interval"},
}
_POINT_SAMPLES = {
    **dict.fromkeys(("sample_x", "sample_y", "sample_t", "sample_u", "sample_v"), "float"),
    **{"sample_depth": "float", "sample_owner": "uint"},
}
_GLOSSY_SAMPLES = {"sample_a": "float", "sample_b": "float"}
_MIRROR_SAMPLES = {"sample_mirror_depth": "float", "sample_mirror_owner": "uint"}
_POINT_PIXELS = {"pixel_color": "float4", "pixel_depth": "float", "pixel_seen": "uint"}
_SIGNED_PIXELS = {
    **{"pixel_signed_color": "float4", "pixel_signed_depth": "float", "pixel_signs": "float"},
}
_KEPT_SAMPLES = {"kept_color": "float4", "kept_depth": "float"}
_MOST_EVENTS, _EVENTS_PER_SAMPLE = 1 << 20, 4
_FILM_BYTES = 24  # of a pixel: colour, depth, intervals


def tile_grid(plan: Plan) -> tuple[int, int, int, int]:
    """Return the first pixel, and columns and rows, of the tiles that cover the region.

    Tiles lie on multiples of their size in the frame.
    """
    x, y, width, height = plan.region
    left, top = x // plan.tile * plan.tile, y // plan.tile * plan.tile
    columns = -(-(x + width - left) // plan.tile)
    return left, top, columns, -(-(y + height - top) // plan.tile)


def film_bytes(plan: Plan) -> int:
    """Bytes of the film with its layers, on the device and again on the host."""
    asked = plan.settings.aovs
    pixel = _FILM_BYTES + 16 * ("sharp" in asked) + 4 * plane_count(asked)
    return pixel * plan.region[2] * plan.region[3]


def scratch(plan: Plan) -> dict[str, tuple[str, int]]:
    """Return the scratch arrays by name: kind, and how many elements each work-item has."""
    if plan.settings.method == "analytic":
        return _analytic_scratch(plan)
    return _stochastic_scratch(plan)


def _analytic_scratch(plan: Plan) -> dict[str, tuple[str, int]]:
    pixels = plan.tile**2
    arrays = {name: (kind, plan.layers * pixels) for name, kind in _SAMPLES.items()}
    arrays |= {name: (kind, pixels) for name, kind in _PIXELS.items()}
    if plan.exact:
        arrays["sample_tails"] = "int", plan.layers * pixels
    else:
        arrays["sample_intervals"] = "Run", plan.layers * pixels
    if "PLACED" in plan.active:
        arrays["sample_places"] = "Place", plan.layers * pixels
    if "WEIGHTED" in plan.active:
        arrays["sample_weights"] = "float", plan.layers * pixels
    if "AOV_SHARP" in plan.active:
        arrays["pixel_sharp"] = "float4", pixels
    if "AOV_OPERATIONS" in plan.active:
        arrays["sample_tested"] = "uint", plan.layers * pixels
        arrays["pixel_operations"] = "uint", pixels
    return arrays


def _stochastic_scratch(plan: Plan) -> dict[str, tuple[str, int]]:
    pixels = plan.tile**2
    samples = plan.layers * pixels
    asked = [
        (_POINT_SAMPLES, True, samples),
        (_GLOSSY_SAMPLES, "GLOSSY" in plan.active, samples),
        (_MIRROR_SAMPLES, "MIRRORS" in plan.active, samples),
        (_POINT_PIXELS, True, pixels),
        (_SIGNED_PIXELS, "WEIGHTED" in plan.active, pixels),
        (_KEPT_SAMPLES, "PATTERN_RGSS" in plan.active, pixels * sample_count(plan.settings)),
    ]
    return {
        name: (kind, count)
        for arrays, there, count in asked
        if there
        for name, kind in arrays.items()
    }


def scratch_bytes(plan: Plan) -> int:
    """Return the bytes of a work-item's scratch."""
    return sum(
        records.element(kind, plan.active).itemsize * count
        for kind, count in scratch(plan).values()
    )


def pools(plan: Plan) -> dict[str, str]:
    """Pools of a work-item: kind of record of each."""
    if plan.settings.method != "analytic":
        return {}
    kinds = _EXACT_POOLS if plan.exact else _TRIANGULATED_POOLS
    steps = {"steps": "Step"} if "shadow" in plan.stages else {}
    added = {"added": "float4"} if "RECORDED" in plan.active else {}
    return {**kinds, **steps, **added, "spans": "Span"}


def pool_bytes(plan: Plan, capacity: int) -> int:
    """Bytes of the pools of a work-item, ``capacity`` records each."""
    return sum(record_bytes(plan).values()) * (capacity + LANES)


def record_bytes(plan: Plan) -> dict[str, int]:
    """Bytes of a record of each pool."""
    return {name: records.element(kind, plan.active).itemsize for name, kind in pools(plan).items()}


def least_bytes(plan: Plan) -> int:
    """Return the least that a work-item begins with of what is made for each by itself."""
    if plan.settings.method != "analytic":
        return scratch_bytes(plan)
    return pool_bytes(plan, min(plan.capacity, LEAST_CAPACITY))


def first_events(plan: Plan) -> int:
    """Visible spans that the first pool of those has room for, where memory is not short."""
    samples = plan.region[2] * plan.region[3] * plan.settings.samples
    return max(LEAST_EVENTS, min(_EVENTS_PER_SAMPLE * samples, _MOST_EVENTS))
