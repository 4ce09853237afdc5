"""Every knob of a render, in one frozen record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from mbinterval.errors import UsageError
from mbinterval.film.aovs import AOVS, EXPORTS, check_aovs
from mbinterval.settings.conflicts import Conflict, find_conflicts
from mbinterval.settings.rules import (
    ANALYTIC,
    CULLS,
    METHODS,
    OCCLUSIONS,
    PATTERNS,
    SAMPLED,
    Rule,
    one_of,
    or_none,
    real,
    rule_of,
    setting,
    switch,
    whole,
    words,
)
from mbinterval.values import nearest


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
        Equal linear motion segments per shutter, for each mesh that does not state its own and for
        the camera; None gives each source of motion as many as ``motion_error`` asks for.
    motion_error
        How far from their true place, in pixels, the linear motion of segments may take what is
        seen; without effect where ``motion_segments`` are given.
    most_segments
        Motion segments that one source of motion gets at most. Where that leaves a greater error,
        the film's notes say so.
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
        see `mbinterval.film.aovs.AOVS` and ``EXPORTS``. The image is the same with and without.
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

    method: str = setting(
        "analytic",
        "how visibility is solved",
        one_of(*METHODS),
    )
    paths: str = setting(
        "exact",
        "how motion paths become time intervals",
        one_of("exact", "triangulated"),
        methods=ANALYTIC,
    )
    pairing: str = setting(
        "time",
        "pair a path's fragments by time, or by depth as published",
        one_of("time", "depth"),
        methods=ANALYTIC,
    )
    occlusion: str | int = setting(
        "exact",
        "exact, or the bits of an occlusion mask: 32, 64, ... 1024",
        one_of(*OCCLUSIONS),
        methods=ANALYTIC,
    )
    partial_bits: bool = setting(
        False,
        "with a mask, let what is seen begin and end inside a bit",
        switch,
        methods=ANALYTIC,
    )
    max_intervals: int | None = setting(
        None,
        "keep only this many intervals per sample; 'none' keeps all",
        or_none(whole(1, 2**20)),
        methods=ANALYTIC,
    )
    samples: int = setting(
        4,
        "spatial samples per pixel; 1 is the pixel's centre",
        whole(1, 4096),
    )
    pattern: str | None = setting(
        None,
        "where a pixel's samples lie",
        or_none(one_of(*words(list(PATTERNS.values())))),
    )
    filter: str = setting(
        "box",
        "pixel filter",
        one_of("box", "five_point", "triangle", "gaussian", "blackman_harris", "mitchell"),
    )
    filter_radius: float | None = setting(
        None,
        "radius of the pixel filter in pixels",
        or_none(real(above=0.0, high=8.0)),
    )
    texture_samples: int | None = setting(
        None,
        "shading evaluations along each visible span; 'none' takes as many as "
        "--shading-error asks for",
        or_none(whole(1, 1024)),
        methods=ANALYTIC,
    )
    shading_error: float = setting(
        0.002,
        "greatest error of a visible span's colour, in linear colour",
        real(above=0.0),
        methods=ANALYTIC,
    )
    anisotropy: int = setting(
        0,
        "most texture look-ups over what a sample stands for in a texture; 0 reads one",
        whole(0, 16),
        methods=ANALYTIC,
    )
    motion_segments: int | None = setting(
        None,
        "linear motion segments per shutter, for meshes that state none; 'none' chooses "
        "them by --motion-error",
        or_none(whole(1, 4096)),
    )
    motion_error: float = setting(
        0.1,
        "greatest path error of chosen motion segments, in pixels",
        real(above=0.0),
    )
    most_segments: int = setting(
        128,
        "motion segments that one source of motion gets at most",
        whole(1, 4096),
    )
    shadows: str = setting(
        "lights",
        "which lights cast shadows: those that say so (lights), all, or none (off)",
        one_of("lights", "all", "off"),
    )
    seed: int = setting(
        0,
        "seed of every pseudo-random choice",
        whole(0, 2**32 - 1),
    )
    transparent: bool = setting(
        False,
        "leave the background out; PNG gets an alpha channel",
        switch,
    )
    tile_size: int = setting(
        16,
        "edge of a tile in pixels; it changes speed, never the image",
        one_of(8, 16, 32),
        methods=ANALYTIC,
        speed_only=True,
    )
    aovs: tuple[str, ...] = setting(
        (),
        "layers to find in the same pass, with commas between them: "
        f"{', '.join((*AOVS, *EXPORTS))}; 'none' overrules the scene file",
        check_aovs,
        methods=ANALYTIC,
    )
    aov_time: float = setting(
        0.5,
        "when the sharp frame is, from 0 where the shutter opens to 1 where it closes",
        real(0.0, 1.0),
        methods=ANALYTIC,
    )
    cryptomatte_levels: int = setting(
        6,
        "IDs that a Cryptomatte keeps of each pixel: 2, 4, ... 20",
        one_of(*range(2, 21, 2)),
        methods=ANALYTIC,
        of_aovs=("crypto_object", "crypto_material"),
    )
    deep_tolerance: float = setting(
        0.01,
        "thickness of a deep image's slices, as a part of their depth",
        real(above=0.0, high=1.0),
        methods=ANALYTIC,
        of_aovs=("deep",),
    )
    event_steps: int = setting(
        4,
        "parts of the shutter in which events have a colour of their own, where it changes",
        whole(1, 4096),
        methods=ANALYTIC,
        of_aovs=("events",),
    )
    cull: str = setting(
        "best",
        "which point samples a path is tested at",
        one_of(*CULLS),
        methods=SAMPLED,
        speed_only=True,
    )
    cull_tile: int = setting(
        1,
        "pixels along the edge of the tiles that culling bounds",
        whole(1, 16),
        methods=SAMPLED,
        speed_only=True,
    )
    test: str = setting(
        "vertices",
        "how a point sample is tested: vertices or edges",
        one_of("vertices", "edges"),
        methods=SAMPLED,
    )
    shading_rate: str = setting(
        "sample",
        "shade every point sample, or once per pixel and triangle",
        one_of("sample", "pixel"),
        methods=SAMPLED,
    )
    hybrid: bool = setting(
        False,
        "shade what does not move once per pixel",
        switch,
        methods=SAMPLED,
    )
    frameless: int = setting(
        1,
        "every n-th pixel sees its own part of the shutter",
        whole(1, 64),
        methods=("stochastic",),
    )
    shadow_map: int | None = setting(
        None,
        "look shadows of point samples up in maps of so many texels along an edge; "
        "'none' traces rays",
        or_none(whole(1, 8192)),
        methods=SAMPLED,
    )
    shadow_strata: int = setting(
        4,
        "times in each texel of a shadow map",
        whole(1, 64),
        methods=SAMPLED,
    )
    shadow_bias: float = setting(
        3.0,
        "widths of a texel by which a shadow map spares what lies behind a surface",
        real(0.0),
        methods=SAMPLED,
    )
    slices: int = setting(
        64,
        "pictures that accumulation averages",
        whole(1, 4096),
        methods=("accumulation",),
    )
    slice_times: str = setting(
        "uniform",
        "uniform, jittered or stochastic",
        one_of("uniform", "jittered", "stochastic"),
        methods=("accumulation",),
    )
    slice_lens: str = setting(
        "point",
        "through what of the lens a slice looks: a point of it, or a line across",
        one_of("point", "line"),
        methods=("accumulation",),
    )
    statistics: bool = setting(
        False,
        "count samples that were tested and hit",
        switch,
        speed_only=True,
    )

    def __post_init__(self) -> None:
        for name in SETTINGS:
            object.__setattr__(self, name, check_setting(name, getattr(self, name)))
        for conflict in conflicts({name: getattr(self, name) for name in SETTINGS}):
            raise UsageError(conflict.text)

    @property
    def given(self) -> dict[str, Any]:
        """What the image depends on, by name: the settings of this method, but for speed."""
        own = [
            setting
            for setting in fields(self)
            if self.method in rule_of(setting).methods and not rule_of(setting).speed_only
        ]
        values = {
            setting.name: getattr(self, setting.name)
            for setting in own
            if not rule_of(setting).of_aovs or set(rule_of(setting).of_aovs) & set(self.aovs)
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

RULES: Mapping[str, Rule] = {field.name: rule_of(field) for field in fields(Settings)}
"""What is known of each setting."""


def check_setting(name: str, value: Any) -> Any:
    """Return ``value`` as the setting ``name`` stores it.

    Raises ``UsageError`` where it is wrong whatever the other settings are.
    """
    return RULES[name].check(value, name)


def conflicts(values: Mapping[str, Any]) -> list[Conflict]:
    """Find settings that don't go together; those not among ``values`` have their defaults."""
    defaults: dict[str, Any] = {field.name: field.default for field in fields(Settings)}
    given = defaults | dict(values)
    owners = {name: RULES[name].methods for name in SETTINGS if given[name] != defaults[name]}
    return find_conflicts(given, owners)
