"""Every knob of a render, in one frozen record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from mbinterval.aovs import RECORDED, check_aovs
from mbinterval.checks import choice, instance, nearest, number, whole_number
from mbinterval.errors import UsageError

OCCLUSIONS = ("exact", 32, 64, 128, 256, 512, 1024)
"""Ways to decide visibility: exactly, or by a mask of so many bits."""

CULLS = (
    *("best", "bbox", "hull", "obb", "pixar", "interleave_uvt", "dual_space", "clip_space"),
    *("clip_space_printed", "trim", "zmax", "zmax_strata", "zmin", "zmin_strata"),
)
"""Ways to leave out point samples that a path cannot cover."""

PATTERNS: dict[str, tuple[str, ...]] = {
    "analytic": ("fixed", "sobol"),
    "stochastic": ("sobol", "jittered", "random", "fixed", "rgss", "interleave_uvt"),
    "accumulation": ("fixed", "sobol", "jittered", "random"),
}
"""Sampling patterns of each method."""

_BELONGS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("paths", "pairing", "occlusion", "partial_bits"), ("analytic",)),
    **dict.fromkeys(("max_intervals", "tile_size"), ("analytic",)),
    **dict.fromkeys(("texture_samples", "shading_error", "anisotropy"), ("analytic",)),
    **dict.fromkeys(("aovs", "aov_time", "cryptomatte_levels"), ("analytic",)),
    **dict.fromkeys(("deep_tolerance", "event_steps"), ("analytic",)),
    **dict.fromkeys(("cull", "cull_tile", "test"), ("stochastic", "accumulation")),
    **dict.fromkeys(("shading_rate", "hybrid"), ("stochastic", "accumulation")),
    **dict.fromkeys(("shadow_map", "shadow_strata"), ("stochastic", "accumulation")),
    **dict.fromkeys(("shadow_bias",), ("stochastic", "accumulation")),
    **dict.fromkeys(("frameless",), ("stochastic",)),
    **dict.fromkeys(("slices", "slice_times", "slice_lens"), ("accumulation",)),
}
"""Settings that are of some methods only."""

_ALL_PATTERNS = tuple(dict.fromkeys(name for names in PATTERNS.values() for name in names))
_SPEED_ONLY = ("tile_size", "cull", "cull_tile", "statistics")

_CHOICES: dict[str, tuple[str | int, ...]] = {
    "method": ("analytic", "stochastic", "accumulation"),
    "paths": ("exact", "triangulated"),
    "pairing": ("time", "depth"),
    "occlusion": OCCLUSIONS,
    "filter": ("box", "five_point", "triangle", "gaussian", "blackman_harris", "mitchell"),
    "tile_size": (8, 16, 32),
    "cull": CULLS,
    "test": ("vertices", "edges"),
    "shading_rate": ("sample", "pixel"),
    "slice_times": ("uniform", "jittered", "stochastic"),
    "cryptomatte_levels": tuple(range(2, 21, 2)),
    "shadows": ("lights", "all", "off"),
    "slice_lens": ("point", "line"),
}
_OF_AOVS = {
    "cryptomatte_levels": ("crypto_object", "crypto_material"),
    "deep_tolerance": ("deep",),
    "event_steps": ("events",),
}
"""Settings that say something about some ``aovs`` only."""
_RANGES = {
    "samples": (1, 4096),
    "anisotropy": (0, 16),
    "seed": (0, 2**32 - 1),
    "cull_tile": (1, 16),
    "frameless": (1, 64),
    "slices": (1, 4096),
    "event_steps": (1, 4096),
    "shadow_strata": (1, 64),
}
_RANGES_OR_NONE = {
    "max_intervals": (1, 2**20),
    "motion_segments": (1, 4096),
    "shadow_map": (1, 8192),
    "texture_samples": (1, 1024),
}
_ABOVE_ZERO = ("motion_error", "shading_error")


@dataclass(frozen=True, slots=True)
class Settings:
    """How to render; what to render is the scene's part.

    Attributes
    ----------
    method
        ``"analytic"``: visibility is solved as time intervals. ``"stochastic"``: it is found at
        point samples in time, place and lens (Akenine-Möller et al. 2007). ``"accumulation"``: it
        is the mean of pictures at rest (Haeberli & Akeley 1990).
    paths
        ``"exact"``: the times at which a triangle covers a sample are the roots of its moving
        edges. ``"triangulated"``: the motion path of a triangle is two caps and twelve side
        triangles, or two per side where a moving edge's two positions cross (Hong & Oh 2017,
        4.2), and depth is linear in time along an interval.
    pairing
        How the fragments of one triangulated path become intervals: ``"time"`` pairs them in
        order of time, ``"depth"`` in order of depth, as published (Hong & Oh 2017, 3.3).
    occlusion
        ``"exact"``, or the bits of an occlusion mask: 32, 64, 128, 256, 512 or 1024 (Hong & Oh
        2017, 3.3). A bit stands for its part of the shutter and belongs to an interval when its
        centre does.
    partial_bits
        With a mask, let what is seen begin and end inside a bit, where its interval does.
    max_intervals
        Triangulated paths only: keep this many intervals per sample, those of least minimum
        depth; None keeps all. Hong & Oh use 90.
    samples
        Spatial samples per pixel, 1 to 256. One sample is the pixel's centre. Of the stochastic
        method: samples in time, place and lens, 1 to 4096. Of accumulation: per slice.
    pattern
        ``"fixed"``: the same well-spread rank-1 lattice in every pixel. ``"sobol"``: a net of
        its own in every pixel, Owen-scrambled by pixel and ``seed``. Of the stochastic method
        also ``"jittered"``, ``"random"``, ``"rgss"`` (four samples on a rotated grid, and a
        filter of eight; Akenine-Möller et al. 2007, 3.2; no lens) and ``"interleave_uvt"``
        (``4 * samples`` times and lens points for the whole frame; Fatahalian et al. 2009). With
        "fixed" the stochastic method's times are stratified in each pixel. None is "sobol" for
        the stochastic method, else "fixed".
    filter, filter_radius
        Pixel filter, ``"box"``, ``"triangle"``, ``"gaussian"`` (radius three standard
        deviations), ``"blackman_harris"`` or ``"mitchell"``, and its radius in pixels; None is
        0.5, 1, 1.5, 1.5 or 2. Mitchell's has negative lobes: near edges alpha and colour ring
        beyond 0 and 1 (by 0.2 where few samples fall into the lobes), and depth, an average with
        the same weights, may lie outside of what is seen. ``"five_point"`` is the box filter by a
        rule for ``samples=1``: a pixel's sample counts for a little in the four pixels next to it
        too, which makes one sample nearly as exact as two.
    texture_samples
        Shading evaluations along each visible span, 1 to 1024 (Hong & Oh 2017, 4.4). None is as
        many as ``shading_error`` asks for, from 15 to 960, or with triangulated paths 16.
    shading_error
        How far the mean colour of a visible span may be from the truth, as estimated from how its
        colours bend in time; in linear colour. The error of a pixel is no greater, since its spans
        weigh at most 1 together. Without effect where ``texture_samples`` are given, or paths are
        triangulated.
    anisotropy
        Most texture look-ups along the longer side of what a sample stands for in a texture, 1 to
        16; their mip level is that of the shorter side. 0 leaves this out: what rests is looked up
        at the finest level, and what moves at that of its motion.
    motion_segments
        Linear motion segments per shutter for each mesh that does not state its own; None gives
        each as many as ``motion_error`` asks for, up to 128.
    motion_error
        How far from their true place, in pixels, the linear motion of segments may take points
        of a mesh; without effect where ``motion_segments`` are given.
    shadows
        ``"lights"``: those lights cast shadows that say so. ``"all"``: all but ambient ones do.
        ``"off"``: none does.
    seed
        Seed of every pseudo-random choice.
    transparent
        Leave the background out of colour; alpha is coverage either way.
    tile_size
        Edge of a square tile in pixels: 8, 16 or 32. It changes speed, never the image.
    aovs
        Names of what else is found in the same pass, a list or a text with commas between them:
        see `mbinterval.aovs.AOVS` and ``EXPORTS``. The image is the same with and without.
    aov_time
        When the sharp frame and what goes with it is: a part of the shutter, from 0 where it
        opens to 1 where it closes; of a rolling shutter, of each line's own exposure.
    cryptomatte_levels
        How many IDs of a pixel a Cryptomatte keeps, those of most coverage: an even number, 2 to
        20.
    deep_tolerance
        Thickness of the slices of depth whose surfaces a deep image joins, as a part of the depth,
        above 0 and up to 1.
    event_steps
        Equal parts of the shutter, 1 to 4096, in each of which events have a colour of their own
        where it changes along a visible span; when they begin and end is exact whatever it is.
    cull
        Which samples a path is tested at, one of ``CULLS``; it changes speed and counts, never the
        image, but for ``"clip_space_printed"``, which loses hits (see ``cl/stochastic/cull``).
        ``"interleave_uvt"`` is for the pattern of that name.
    cull_tile
        Bounds of ``cull`` are found for tiles of so many pixels along an edge, 1 to 16.
    test
        Whether a sample is covered: ``"vertices"``, from the vertices at its time (after Laine &
        Karras 2011), or ``"edges"``, from time-dependent edge functions (Akenine-Möller et al.
        2007, 3.3.2; no lens).
    shading_rate
        ``"sample"``, or ``"pixel"``: once for all samples of a pixel that see one triangle, its
        shadows included.
    hybrid
        Shade what does not move once per pixel, and only what moves at each sample.
    frameless
        Every ``frameless``-th pixel sees its own part of the shutter only, 1 to 64 parts.
    shadow_map, shadow_strata, shadow_bias
        Look shadows of point samples up in maps of ``shadow_map`` texels along an edge, with
        ``shadow_strata`` times in each texel (Akenine-Möller et al. 2007, 3.5), 1 to 64; a surface
        hides what lies behind it by more than ``shadow_bias`` widths of a texel. None: rays are
        traced at each sample's time, without bias.
    slices, slice_times
        Pictures that accumulation averages, 1 to 4096, at ``"uniform"`` or ``"jittered"`` times;
        ``"stochastic"``: each is sampled stochastically over its own part of the shutter.
    slice_lens
        What of an open lens each slice looks through: ``"point"``, one of its points (with
        stochastic slices each sample has its own), or ``"line"``, a line across it, of which each
        sample has a point of its own (Akenine-Möller et al. 2007, 4.2); and likewise what of the
        disc over which glossy mirrors spread what they show (4.3).
    statistics
        Count the samples that were tested and hit (``Film.stats``); it costs time.
    """

    method: str = "analytic"
    paths: str = "exact"
    pairing: str = "time"
    occlusion: str | int = "exact"
    partial_bits: bool = False
    max_intervals: int | None = None
    samples: int = 4
    pattern: str | None = None
    filter: str = "box"
    filter_radius: float | None = None
    texture_samples: int | None = None
    shading_error: float = 0.002
    anisotropy: int = 0
    motion_segments: int | None = None
    motion_error: float = 0.1
    shadows: str = "lights"
    seed: int = 0
    transparent: bool = False
    tile_size: int = 16
    aovs: tuple[str, ...] = ()
    aov_time: float = 0.5
    cryptomatte_levels: int = 6
    deep_tolerance: float = 0.01
    event_steps: int = 4
    cull: str = "best"
    cull_tile: int = 1
    test: str = "vertices"
    shading_rate: str = "sample"
    hybrid: bool = False
    frameless: int = 1
    shadow_map: int | None = None
    shadow_strata: int = 4
    shadow_bias: float = 3.0
    slices: int = 64
    slice_times: str = "uniform"
    slice_lens: str = "point"
    statistics: bool = False

    def __post_init__(self) -> None:
        for name in SETTINGS:
            object.__setattr__(self, name, check_setting(name, getattr(self, name)))
        for conflict in conflicts({name: getattr(self, name) for name in SETTINGS}):
            raise UsageError(conflict.text)

    @property
    def given(self) -> dict[str, Any]:
        """What the image depends on, by name: the settings of this method, but for speed."""
        names = [
            setting.name
            for setting in fields(self)
            if self.method in _BELONGS.get(setting.name, (self.method,))
            and setting.name not in _SPEED_ONLY
        ]
        values = {
            name: getattr(self, name)
            for name in names
            if name not in _OF_AOVS or set(_OF_AOVS[name]) & set(self.aovs)
        }
        aovs, aov_time = values.pop("aovs", ()), values.pop("aov_time", None)
        if aovs:
            values |= {"aovs": ",".join(aovs), "aov_time": aov_time}
        if self.shadows == "lights":
            del values["shadows"]
        if self.shadow_map is None:
            values = {name: values[name] for name in values if not name.startswith("shadow_")}
        if self.cull == "clip_space_printed":
            values["cull"] = self.cull
        return values

    @property
    def shading_times(self) -> int | None:
        """Shading evaluations along each visible span; None where ``shading_error`` decides."""
        published = 16 if self.paths == "triangulated" else None
        return published if self.texture_samples is None else self.texture_samples

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Settings:
        """Settings from keyword values; an unknown name raises with the nearest known one."""
        for name in values:
            if name not in SETTINGS:
                raise UsageError(f"settings: unknown name {name!r}, {nearest(name, SETTINGS)}")
        return cls(**values)


SETTINGS = tuple(field.name for field in fields(Settings))
"""Names of all settings."""


def methods_of(name: str) -> tuple[str, ...]:
    """Return the methods that have the setting ``name``."""
    return _BELONGS.get(name, tuple(PATTERNS))


def check_setting(name: str, value: Any) -> Any:
    """Return ``value`` as the setting ``name`` stores it.

    Raises ``UsageError`` where it is wrong whatever the other settings are.
    """
    if name in _CHOICES:
        return choice(value, _CHOICES[name], name)
    if name == "pattern":
        return None if value is None else choice(value, _ALL_PATTERNS, name)
    if name in _RANGES:
        return whole_number(value, name, *_RANGES[name])
    if name in _RANGES_OR_NONE:
        return None if value is None else whole_number(value, name, *_RANGES_OR_NONE[name])
    if name in _ABOVE_ZERO:
        return number(value, name, above=0.0)
    if name == "shadow_bias":
        return number(value, name, 0.0)
    if name == "filter_radius":
        return None if value is None else number(value, name, above=0.0, high=8.0)
    if name == "aovs":
        return check_aovs(value, name)
    if name == "aov_time":
        return number(value, name, 0.0, 1.0)
    if name == "deep_tolerance":
        return number(value, name, above=0.0, high=1.0)
    return instance(value, bool, name)


@dataclass(frozen=True)
class Conflict:
    """Settings, by ``names``, that are each in order but not together; ``text`` says why."""

    names: tuple[str, str]
    text: str


def conflicts(values: Mapping[str, Any]) -> list[Conflict]:
    """Find settings that don't go together; those not among ``values`` have their defaults."""
    given: dict[str, Any] = {field.name: field.default for field in fields(Settings)}
    given |= values
    found = [*_conflicts_of_methods(given), *_conflicts_of_samples(given)]
    if given["paths"] == "triangulated" and given["pattern"] == "sobol":
        why = "triangulated paths are rasterized in rows of samples; use pattern='fixed'"
        found.append(("pattern", "paths", why))
    if given["paths"] == "exact" and given["max_intervals"] is not None:
        why = "exact paths lose no interval; max_intervals is for paths='triangulated'"
        found.append(("max_intervals", "paths", why))
    if given["partial_bits"] is True and given["occlusion"] == "exact":
        why = "exact occlusion has no bits; give occlusion a number of bits, 32 to 1024"
        found.append(("partial_bits", "occlusion", why))
    if given["paths"] == "triangulated" and "operations" in (given["aovs"] or ()):
        found.append(("aovs", "paths", "operations are counted for paths='exact'"))
    if given["occlusion"] != "exact" and "sharp" in (given["aovs"] or ()):
        found.append(("aovs", "occlusion", "a mask does not tell what is seen at a moment"))
    found += _conflicts_of_spans(given)
    if given["filter"] == "five_point":
        why = "it is a rule for samples=1 with pattern='fixed'; use filter='box' with more"
        if given["samples"] != 1:
            found.append(("filter", "samples", why))
        if given["pattern"] not in (None, "fixed"):
            found.append(("filter", "pattern", why))
        if given["filter_radius"] is not None:
            found.append(("filter_radius", "filter", "the five-point rule has none"))
    return [Conflict((a, b), f"{a}={given[a]!r} with {b}={given[b]!r}: {c}") for a, b, c in found]


def _conflicts_of_spans(given: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Find settings with which what is made from visible spans can't be had."""
    names = given["aovs"] or ()
    names = names.replace(" ", "").split(",") if isinstance(names, str) else names
    asked = {name for name in RECORDED if name in names}
    found = []
    if asked and given["filter"] == "five_point":
        why = "samples are shared by pixels, spans are not; use filter='box'"
        found.append(("aovs", "filter", why))
    if asked - {"events"} and given["filter"] == "mitchell":
        why = "coverage below 0 has no place in a Cryptomatte or a deep image; use another filter"
        found.append(("aovs", "filter", why))
    if "events" in asked and given["paths"] != "exact":
        found.append(("aovs", "paths", "events are exact in time; use paths='exact'"))
    if "events" in asked and given["occlusion"] != "exact":
        found.append(("aovs", "occlusion", "a mask does not tell when something is seen"))
    return found


def _conflicts_of_methods(given: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Find settings that the method does not have: two names, and why."""
    method, found = given["method"], []
    for field in fields(Settings):
        owners = _BELONGS.get(field.name, (method,))
        if given[field.name] != field.default and method not in owners:
            found.append(
                (field.name, "method", f"it is for method={' or '.join(map(repr, owners))}")
            )
    patterns = PATTERNS[method]
    if given["pattern"] is not None and given["pattern"] not in patterns:
        found.append(("pattern", "method", f"that has {', '.join(map(repr, patterns))}"))
    if method != "stochastic" and given["samples"] > 256:
        found.append(("samples", "method", "that has 1 to 256"))
    return found


def _conflicts_of_samples(given: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Likewise for settings of point sampling."""
    if given["method"] == "analytic":
        return []
    found = []
    if given["filter"] == "five_point":
        found.append(("filter", "method", "it is for method='analytic'; use filter='box'"))
    if given["pattern"] == "rgss" and given["samples"] != 4:
        found.append(("samples", "pattern", "the rotated grid has 4"))
    if given["pattern"] == "rgss" and given["filter"] != "box":
        found.append(("filter", "pattern", "the rotated grid has a filter of its own"))
    if given["pattern"] == "rgss" and given["filter_radius"] is not None:
        found.append(("filter_radius", "pattern", "the rotated grid has a filter of its own"))
    if given["cull"] == "interleave_uvt" and given["pattern"] != "interleave_uvt":
        found.append(("cull", "pattern", "it is for pattern='interleave_uvt'"))
    if given["cull_tile"] != 1 and given["cull"] == "best":
        found.append(("cull_tile", "cull", "that has tiles of its own"))
    if given["hybrid"] is True and given["shading_rate"] == "pixel":
        found.append(("hybrid", "shading_rate", "nothing is left to it"))
    if given["method"] == "accumulation":
        found += _conflicts_of_slices(given)
    return found


def _conflicts_of_slices(given: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    found = []
    if given["slice_times"] != "stochastic" and given["pattern"] not in (None, "fixed"):
        why = "slices at rest have the same samples in every pixel; use slice_times='stochastic'"
        found.append(("pattern", "slice_times", why))
    if given["slices"] * given["samples"] > 65536:
        found.append(("slices", "samples", "at most 65536 samples per pixel together"))
    return found
