"""Every knob of a render, in one frozen record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from mbinterval.checks import choice, instance, nearest, number, whole_number
from mbinterval.errors import UsageError

OCCLUSIONS = ("exact", 32, 64, 128, 256, 512, 1024)
"""Ways to decide visibility: exactly, or by a mask of so many bits."""

_CHOICES: dict[str, tuple[str | int, ...]] = {
    "method": ("analytic",),
    "paths": ("exact", "triangulated"),
    "pairing": ("time", "depth"),
    "occlusion": OCCLUSIONS,
    "pattern": ("fixed", "sobol"),
    "filter": ("box", "five_point", "triangle", "gaussian", "blackman_harris", "mitchell"),
    "tile_size": (8, 16, 32),
}
_RANGES = {"samples": (1, 256), "texture_samples": (1, 1024), "seed": (0, 2**32 - 1)}
_RANGES_OR_NONE = {"max_intervals": (1, 2**20), "motion_segments": (1, 4096)}


@dataclass(frozen=True, slots=True)
class Settings:
    """How to render; what to render is the scene's part.

    Attributes
    ----------
    method
        ``"analytic"``: visibility is solved as time intervals.
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
        Spatial samples per pixel, 1 to 256. One sample is the pixel's centre.
    pattern
        ``"fixed"``: the same well-spread rank-1 lattice in every pixel. ``"sobol"``: a net of
        its own in every pixel, Owen-scrambled by pixel and ``seed``.
    filter, filter_radius
        Pixel filter, ``"box"``, ``"triangle"``, ``"gaussian"`` (radius three standard
        deviations), ``"blackman_harris"`` or ``"mitchell"``, and its radius in pixels; None is
        0.5, 1, 1.5, 1.5 or 2. Mitchell's has negative lobes: near edges alpha and colour ring
        beyond 0 and 1 (by 0.2 where few samples fall into the lobes), and depth, an average with
        the same weights, may lie outside of what is seen. ``"five_point"`` is the box filter by a
        rule for ``samples=1``: a pixel's sample counts for a little in the four pixels next to it
        too, which makes one sample nearly as exact as two.
    texture_samples
        Shading evaluations along each visible span, 1 to 1024 (Hong & Oh 2017, 4.4).
    motion_segments
        Linear motion segments per shutter for each mesh that does not state its own; None gives
        each as many as ``motion_error`` asks for, up to 128.
    motion_error
        How far from their true place, in pixels, the linear motion of segments may take points
        of a mesh; without effect where ``motion_segments`` are given.
    seed
        Seed of every pseudo-random choice.
    transparent
        Leave the background out of colour; alpha is coverage either way.
    tile_size
        Edge of a square tile in pixels: 8, 16 or 32. It changes speed, never the image.
    """

    method: str = "analytic"
    paths: str = "exact"
    pairing: str = "time"
    occlusion: str | int = "exact"
    partial_bits: bool = False
    max_intervals: int | None = None
    samples: int = 4
    pattern: str = "fixed"
    filter: str = "box"
    filter_radius: float | None = None
    texture_samples: int = 16
    motion_segments: int | None = None
    motion_error: float = 0.1
    seed: int = 0
    transparent: bool = False
    tile_size: int = 16

    def __post_init__(self) -> None:
        for name in SETTINGS:
            object.__setattr__(self, name, check_setting(name, getattr(self, name)))
        for conflict in conflicts({name: getattr(self, name) for name in SETTINGS}):
            raise UsageError(conflict.text)

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Settings:
        """Settings from keyword values; an unknown name raises with the nearest known one."""
        for name in values:
            if name not in SETTINGS:
                raise UsageError(f"settings: unknown name {name!r}, {nearest(name, SETTINGS)}")
        return cls(**values)


SETTINGS = tuple(field.name for field in fields(Settings))
"""Names of all settings."""


def check_setting(name: str, value: Any) -> Any:
    """Return ``value`` as the setting ``name`` stores it.

    Raises ``UsageError`` where it is wrong whatever the other settings are.
    """
    if name in _CHOICES:
        return choice(value, _CHOICES[name], name)
    if name in _RANGES:
        return whole_number(value, name, *_RANGES[name])
    if name in _RANGES_OR_NONE:
        return None if value is None else whole_number(value, name, *_RANGES_OR_NONE[name])
    if name == "motion_error":
        return number(value, name, above=0.0)
    if name == "filter_radius":
        return None if value is None else number(value, name, above=0.0, high=8.0)
    return instance(value, bool, name)


@dataclass(frozen=True)
class Conflict:
    """Settings, by ``names``, that are each in order but not together; ``text`` says why."""

    names: tuple[str, str]
    text: str


def conflicts(values: Mapping[str, Any]) -> list[Conflict]:
    """Find settings that don't go together; those not among ``values`` have their defaults."""
    given = {field.name: field.default for field in fields(Settings)} | dict(values)
    found = []
    if given["paths"] == "triangulated" and given["pattern"] == "sobol":
        why = "triangulated paths are rasterized in rows of samples; use pattern='fixed'"
        found.append(("pattern", "paths", why))
    if given["paths"] == "exact" and given["max_intervals"] is not None:
        why = "exact paths lose no interval; max_intervals is for paths='triangulated'"
        found.append(("max_intervals", "paths", why))
    if given["partial_bits"] is True and given["occlusion"] == "exact":
        why = "exact occlusion has no bits; give occlusion a number of bits, 32 to 1024"
        found.append(("partial_bits", "occlusion", why))
    if given["filter"] == "five_point":
        why = "it is a rule for samples=1 with pattern='fixed'; use filter='box' with more"
        if given["samples"] != 1:
            found.append(("filter", "samples", why))
        if given["pattern"] != "fixed":
            found.append(("filter", "pattern", why))
        if given["filter_radius"] is not None:
            found.append(("filter_radius", "filter", "the five-point rule has none"))
    return [Conflict((a, b), f"{a}={given[a]!r} with {b}={given[b]!r}: {c}") for a, b, c in found]
