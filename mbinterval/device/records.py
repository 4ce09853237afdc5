"""Records shared with the kernels, as NumPy dtypes; ``cl/shared/records.h`` declares the same.

A test compiles a probe kernel that reports the sizes and offsets that the device uses.
"""

from __future__ import annotations

from collections.abc import Container
from typing import Any

import numpy as np
from numpy.typing import NDArray

_MAX_PLANES = 8

NUMBERS = np.dtype(
    [(name, "u4") for name in ("light_count", "static_paths", "path_count", "sky_count")]
    + [("leaf_nodes", "u4"), ("roll_start", "f4"), ("roll_step", "f4"), ("roll_length", "f4")]
    + [("shutter_keys", "u4"), ("seed", "u4"), ("width", "i4"), ("height", "i4")]
    + [("samples", "i4"), ("layers", "i4"), ("filter_places", "i4"), ("filter_zero", "f4")]
    + [("filter_mass", "f4"), ("reach_low", "f4"), ("reach_high", "f4"), ("blades", "i4")]
    + [("blade_rotation", "f4"), ("moment", "f4"), ("shading_error", "f4")]
    + [("shading_times", "i4"), ("anisotropy", "i4"), ("sample_spacing", "f4")]
    + [("most_intervals", "i4"), ("slices", "i4"), ("columns", "i4"), ("event_steps", "i4")]
    + [("shadow_size", "i4"), ("shadow_strata", "i4"), ("shadow_bias", "f4")]
    + [("cull_tile", "i4"), ("frameless", "i4"), ("frameless_step", "i4")]
    + [("strata_lens", "i4"), ("strata_time", "i4")]
)
_PLACED = [("x", "i4"), ("y", "i4")]
TILE_GRID = np.dtype(
    [*_PLACED, ("columns", "i4"), ("rows", "i4")]
    + [("queued", "u4"), ("capacity", "u4"), ("event_capacity", "u4")]
)
LIST_GRID = np.dtype(
    [*_PLACED, ("columns", "i4"), ("rows", "i4"), ("size", "i4"), ("paths", "u4"), ("chunk", "u4")]
    + [(name, "f4") for name in ("x_low", "x_high", "y_low", "y_high")]
)
FRAME = np.dtype([*_PLACED, ("width", "i4"), ("height", "i4"), ("background", "f4", 3)])
VERTEX = np.dtype([("x", "f8"), ("y", "f8"), ("w", "f8"), ("circle", "f8")])
VERTEX_JOB = np.dtype([("input", "u4"), ("output", "u4"), ("count", "u4"), ("camera", "u4")])
CAMERA = np.dtype(
    [("eye", "f8", 3), ("matrix", "f8", 9), ("inverse", "f8", 9), ("aperture", "f8")]
    + [(name, "f8") for name in ("focus", "sharp_near", "sharp_far", "foreground")]
    + [("plane", "f8", 4), ("tilt", "f8", 6)]
)
SLOT = np.dtype([(name, "f4") for name in ("x_low", "x_high", "y_low", "y_high")])
SHUTTER_KEY = np.dtype([(name, "f4") for name in ("t", "open", "passed", "unused")])
PATH = np.dtype(
    [("a", "u4"), ("b", "u4"), ("c", "u4"), ("step", "u4")]
    + [("face", "u4"), ("mesh", "u4"), ("open", "f4"), ("close", "f4")]
    + [("color", "f4", 3), ("alpha", "f4")]
)
MESH = np.dtype(
    [("vertex", "u4"), ("count", "u4"), ("uv", "u4"), ("uv_step", "u4")]
    + [("normal", "u4"), ("normal_step", "u4"), ("color", "u4"), ("color_step", "u4")]
    + [("material", "u4"), ("camera", "u4"), ("first", "u4"), ("map", "u4")]
    + [("world", "u4"), ("mirror", "u4"), ("reflectivity", "f4"), ("sheared", "u4")]
)
MATERIAL = np.dtype(
    [("specular", "f4", 3), ("shininess", "f4"), ("flags", "u4"), ("texture", "u4")]
    + [("cutoff", "f4"), ("turn", "f4"), ("metallic", "f4"), ("roughness", "f4")]
    + [("gloss_texture", "u4"), ("emission_texture", "u4"), ("emission", "f4", 3)]
)
TEXTURE = np.dtype(
    [("texel", "u4"), ("width", "u4"), ("height", "u4"), ("levels", "u4")]
    + [("wrap", "u4"), ("unused", "u4", 3)]
)
LIGHT = np.dtype(
    [("color", "f4", 3), ("kind", "u4"), ("vector", "f4", 3), ("shadow", "u4")]
    + [("axis", "f4", 3), ("cone", "f4", 2), ("unused", "u4", 3)]
)
SHAPE = np.dtype(
    [("c", "f8", _MAX_PLANES), ("a", "f4", _MAX_PLANES), ("b", "f4", _MAX_PLANES)]
    + [("y_min", "f4"), ("y_max", "f4"), ("facing_changes", "f4", 4), ("crossing", "f4", 6)]
    + [("planes", "u4"), ("flags", "u4"), ("scale", "f4"), ("near", "f4"), ("far", "f4")]
    + [("unused", "u4")]
)
DEPTH = np.dtype(
    [("d", "f8", 4), ("x", "f8", 3), ("y", "f8", 3), ("w", "f8", 3)]
    + [("near", "f4"), ("far", "f4"), ("open", "f4"), ("length", "f4"), ("unused", "u4", 2)]
)
BOUNDS = np.dtype([("near", "f4"), ("far", "f4"), ("scale", "f4"), ("flags", "u4")])
VISIT = np.dtype(
    [("t0", "f4"), ("t1", "f4"), ("near", "f4"), ("far", "f4"), ("path", "u4"), ("next", "i4")]
)
FRAGMENT = np.dtype([("t", "f4"), ("w", "f4"), ("part", "u4"), ("next", "i4")])
INTERVAL = np.dtype(
    [("t0", "f4"), ("t1", "f4"), ("w0", "f4"), ("w1", "f4"), ("first", "u4"), ("last", "u4")]
)
FRONT = np.dtype([(name, "f4") for name in ("t0", "t1", "near", "far")] + [("path", "u4")])
SPAN = np.dtype([("t0", "f4"), ("t1", "f4"), ("weight", "f4"), ("source", "u4")])
EVENT = np.dtype(
    [("pixel", "u4"), ("sample", "u4"), ("path", "u4"), ("t0", "f4"), ("t1", "f4")]
    + [("weight", "f4"), ("share", "f4"), ("z0", "f4"), ("z1", "f4"), ("color", "f4", 4)]
)
EVENT_WHOLE, EVENT_PART = 1 << 31, 1 << 30
"""Bits of an event's sample: parts of it follow, and it is such a part."""
SHADED_SPAN = np.dtype([*((name, SPAN[name]) for name in SPAN.names or ()), ("steps", "u4")])
"""A span where lights cast shadows (``SHADOWS``)."""
STEP = np.dtype([("t", "f4"), ("passed", "f4")])
SHADOW_LIGHT = np.dtype(
    [("vector", "f8", 3), ("origin", "f8", 3)]
    + [(name, "u4") for name in ("finite", "view", "views", "unused")]
)
LIGHT_VIEW = np.dtype(
    [("matrix", "f8", 16), ("size", "u4"), ("starts", "u4"), ("paths", "u4"), ("texel", "f4")]
)
OUTLINE = np.dtype(
    [(name, "f4", _MAX_PLANES) for name in "abc"] + [("near", "f4"), ("unused", "f4", 7)]
)
VIEW_RAYS = np.dtype([("from", "f8", 9), ("way", "f8", 9), ("depth", "f8")])
MAP_LEVELS = 12
CUBE_MAP = np.dtype(
    [("levels", "u4"), ("times", "u4"), ("stride", "u4"), ("irradiance", "u4")]
    + [("first", "u4", MAP_LEVELS), ("size", "u4", MAP_LEVELS)]
)
SKY = np.dtype(
    [("open", "f4"), ("close", "f4"), ("start", "f4", 9), ("end", "f4", 9)]
    + [("blur_start", "f4"), ("blur_end", "f4"), ("angle_start", "f4"), ("angle_end", "f4")]
)
PANORAMA = np.dtype(
    [("width", "i4"), ("height", "i4"), ("turn", "f4"), ("intensity", "f4"), ("unit", "f8")]
)
MIRROR_PLANE = np.dtype([("normal", "f4", 3), ("tangents", "f4", 6)])
TREE_NODE = np.dtype([("low", "f4", 3), ("high", "f4", 3), ("open", "f4"), ("close", "f4")])
SORTING = np.dtype([("words", "f4", 9)])
"""Scratch of the sort for one interval: a word in each of nine arrays."""
ORDERING = np.dtype([("words", "f4", 5)])
"""Scratch of the envelope for one interval: a word in each of five arrays."""
PLACE = np.dtype([(name, "f4") for name in "xyuv"])
GLOSSY_PLACE = np.dtype([(name, "f4") for name in "xyuvab"])
"""The place of a sample where mirrors are glossy (``GLOSSY``)."""
RUN = np.dtype([("start", "u4"), ("count", "u4")])

NONE = 0xFFFFFFFF
"""An index that points nowhere."""

MATERIAL_PHONG, MATERIAL_SINGLE_SIDED, MATERIAL_MASK, MATERIAL_METALLIC = 1, 2, 4, 8
WRAP = {"repeat": 0, "clamp": 1, "mirror": 2}
LIGHT_KIND = {"ambient": 0, "directional": 1, "point": 2, "spot": 3}
PART_BITS = 4
MOST_PATHS = (1 << (32 - PART_BITS)) - 1
"""Most motion paths, and most vertices, that one exposure may have: indices have 32 bits."""

BY_NAME = {
    "Numbers": NUMBERS,
    "TileGrid": TILE_GRID,
    "ListGrid": LIST_GRID,
    "Frame": FRAME,
    "Vertex": VERTEX,
    "VertexJob": VERTEX_JOB,
    "Camera": CAMERA,
    "Slot": SLOT,
    "ShutterKey": SHUTTER_KEY,
    "Path": PATH,
    "Mesh": MESH,
    "Material": MATERIAL,
    "Texture": TEXTURE,
    "Light": LIGHT,
    "Shape": SHAPE,
    "Depth": DEPTH,
    "Bounds": BOUNDS,
    "Visit": VISIT,
    "Fragment": FRAGMENT,
    "Interval": INTERVAL,
    "Front": FRONT,
    "Span": SPAN,
    "Event": EVENT,
    "Step": STEP,
    "ShadowLight": SHADOW_LIGHT,
    "LightView": LIGHT_VIEW,
    "Outline": OUTLINE,
    "ViewRays": VIEW_RAYS,
    "CubeMap": CUBE_MAP,
    "Sky": SKY,
    "Panorama": PANORAMA,
    "MirrorPlane": MIRROR_PLANE,
    "TreeNode": TREE_NODE,
    "Place": PLACE,
    "Ordering": ORDERING,
    "Sorting": SORTING,
    "Run": RUN,
}
"""Every record by its name in ``records.h``."""

_NUMBERS: dict[str, np.dtype[Any]] = {
    **{"int": np.dtype("i4"), "uint": np.dtype("u4"), "ulong": np.dtype("u8")},
    "long": np.dtype("i8"),
    **{"float": np.dtype("f4"), "double": np.dtype("f8"), "float4": np.dtype(("f4", 4))},
}


_VARIANTS = {("Span", "SHADOWS"): SHADED_SPAN, ("Place", "GLOSSY"): GLOSSY_PLACE}


def element(name: str, active: Container[str] = ()) -> np.dtype[Any]:
    """Return the dtype of what the kernels call ``name``: a record, a number, or a vector.

    Some records are larger where an effect is ``active``.
    """
    for (record, effect), dtype in _VARIANTS.items():
        if record == name and effect in active:
            return dtype
    return BY_NAME[name] if name in BY_NAME else _NUMBERS[name]


def pack(name: str, **values: Any) -> NDArray[np.void]:
    """Return one record; a field that it does not have, and one that is left out, is an error."""
    record = np.zeros(1, BY_NAME[name])
    if values.keys() != set(record.dtype.names or ()):
        wrong = sorted(values.keys() ^ set(record.dtype.names or ()))
        raise TypeError(f"{name}: fields that it has not, or that are left out: {wrong}")
    for field, value in values.items():
        record[0][field] = value
    return record
