"""Every knob of a render, in one frozen record."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from mbinterval.checks import number
from mbinterval.errors import UsageError

OCCLUSIONS = ("exact", 32, 64, 128, 256, 512, 1024)
"""Ways to decide visibility: exactly, or by a mask of so many bits."""

_CHOICES: dict[str, tuple[str, ...]] = {
    "method": ("analytic",),
    "paths": ("exact", "triangulated"),
    "pairing": ("time", "depth"),
    "pattern": ("fixed", "sobol"),
    "filter": ("box", "five_point", "triangle", "gaussian", "blackman_harris", "mitchell"),
}


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
        for name, choices in _CHOICES.items():
            value = getattr(self, name)
            if value not in choices:
                raise UsageError(f"{name}={value!r}: expected one of {_listed(choices)}")
        if self.occlusion not in OCCLUSIONS:
            raise UsageError(f"occlusion={self.occlusion!r}: expected one of {_listed(OCCLUSIONS)}")
        _check_range("samples", self.samples, 1, 256)
        _check_range("texture_samples", self.texture_samples, 1, 1024)
        _check_range("seed", self.seed, 0, 2**32 - 1)
        if self.max_intervals is not None:
            _check_range("max_intervals", self.max_intervals, 1, 2**20)
        if self.motion_segments is not None:
            _check_range("motion_segments", self.motion_segments, 1, 4096)
        number(self.motion_error, "motion_error", above=0.0)
        if self.tile_size not in (8, 16, 32):
            raise UsageError(f"tile_size={self.tile_size!r}: expected 8, 16 or 32")
        if self.filter_radius is not None and not 0.0 < self.filter_radius <= 8.0:
            raise UsageError(
                f"filter_radius={self.filter_radius!r}: expected pixels, above 0 and at most 8"
            )
        self._check_combinations()

    def _check_combinations(self) -> None:
        if self.paths == "triangulated" and self.pattern != "fixed":
            raise UsageError(
                f"pattern={self.pattern!r}: triangulated paths are rasterized in rows of samples, "
                "which only pattern='fixed' has; use paths='exact'"
            )
        if self.paths == "exact" and self.max_intervals is not None:
            raise UsageError(
                f"max_intervals={self.max_intervals}: exact paths lose no interval; "
                "it is for paths='triangulated'"
            )
        if self.filter == "five_point" and (self.samples, self.pattern) != (1, "fixed"):
            raise UsageError(
                "filter='five_point': it is a rule for samples=1 with pattern='fixed'; "
                "use filter='box' with more"
            )
        if self.filter == "five_point" and self.filter_radius is not None:
            raise UsageError("filter_radius: filter='five_point' has none")
        if self.partial_bits and self.occlusion == "exact":
            raise UsageError("partial_bits=True: occlusion='exact' has no bits; give a number")

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Settings:
        """Settings from keyword values; an unknown name raises with the nearest known one."""
        known = [field.name for field in fields(cls)]
        for name in values:
            if name not in known:
                near = difflib.get_close_matches(name, known, n=1)
                hint = f", did you mean {near[0]}?" if near else f"; known: {', '.join(known)}"
                raise UsageError(f"settings: unknown name {name!r}{hint}")
        return cls(**values)


def _check_range(name: str, value: object, low: int, high: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise UsageError(f"{name}={value!r}: expected a whole number from {low} to {high}")


def _listed(choices: tuple[object, ...]) -> str:
    return ", ".join(repr(choice) for choice in choices)
