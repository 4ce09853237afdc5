"""Spatial samples: their pattern, and the pixel filter that they are drawn from.

Filters are sampled by importance: a sample's place is where the filter's cumulative weight takes
its random number, so every sample weighs the same and a pixel needs no other pixel's samples.
Splatting would use each sample for several pixels and save some noise, but it makes tiles depend
on each other and on the order of summation. A filter with negative lobes is drawn from its
absolute value, and samples in its lobes count negative.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from mbinterval.device import records
from mbinterval.settings.settings import Settings

Float64 = NDArray[np.float64]

_GRID = 1024
"""Box-filtered offsets are multiples of 1/1024, so that a sample's position is exact."""

_TABLE = 512
"""Steps of the inverse cumulative weight that the kernels interpolate in."""


def _gaussian(x: Float64) -> Float64:
    return np.asarray(np.exp(-4.5 * x * x) - np.exp(-4.5))


def _blackman_harris(x: Float64) -> Float64:
    phase = np.pi * (x + 1.0)
    terms = ((0.35875, 0.0), (-0.48829, 1.0), (0.14128, 2.0), (-0.01168, 3.0))
    return np.asarray(sum(weight * np.cos(order * phase) for weight, order in terms))


def _mitchell(x: Float64) -> Float64:
    """Mitchell & Netravali 1988 with B = C = 1/3, stretched from [-2, 2] to [-1, 1]."""
    x = np.abs(2.0 * x)
    near = (7.0 * x**3 - 12.0 * x**2 + 16.0 / 3.0) / 6.0
    far = (-7.0 / 3.0 * x**3 + 12.0 * x**2 - 20.0 * x + 32.0 / 3.0) / 6.0
    return np.where(x < 1.0, near, far)


_SHAPES: dict[str, Callable[[Float64], Float64]] = {
    "box": np.ones_like,
    "triangle": lambda x: 1.0 - np.abs(x),
    "gaussian": _gaussian,
    "blackman_harris": _blackman_harris,
    "mitchell": _mitchell,
}
RADII = {"box": 0.5, "triangle": 1.0, "gaussian": 1.5, "blackman_harris": 1.5, "mitchell": 2.0}
"""Filters and their default radii in pixels; the Gaussian's is three standard deviations."""


@dataclass(frozen=True, eq=False)
class PixelFilter:
    """A separable filter as it is sampled.

    Attributes
    ----------
    table
        ``(n + 1,)`` float64 offsets from the pixel's upper left corner, at equal steps of the
        cumulative absolute weight.
    zero
        Distance from the centre in pixels beyond which the filter is negative; infinity for none.
    mass
        Integral of the absolute value over that of the filter.
    """

    table: Float64
    zero: float
    mass: float

    def place(self, share: Float64) -> Float64:
        """Offsets of the given shares of the cumulative weight."""
        return np.interp(share, np.linspace(0.0, 1.0, len(self.table)), self.table)


@lru_cache(maxsize=16)
def pixel_filter(name: str, radius: float) -> PixelFilter:
    """Tabulate a filter of ``RADII`` with the given radius in pixels."""
    x = np.linspace(-1.0, 1.0, 2**14 + 1)
    weight = _SHAPES[name](x)
    size = np.abs(weight)
    passed = np.concatenate([[0.0], np.cumsum(0.5 * (size[1:] + size[:-1]))])
    # Ends of weight zero would make the inverse steep; a uniform trace keeps it defined.
    passed = passed / passed[-1] + 1e-12 * np.arange(len(passed))
    table = np.interp(np.linspace(0.0, passed[-1], _TABLE + 1), passed, x)
    negative = np.abs(x[weight < -1e-12])
    mass = size.sum() / weight.sum()
    return PixelFilter(
        table=0.5 + radius * table,
        zero=float(radius * negative.min()) if len(negative) else np.inf,
        mass=float(mass) if len(negative) else 1.0,
    )


_SMALL: dict[int, tuple[int, ...]] = {
    1: (0,),
    2: (0, 1),
    3: (0, 2, 1),
    4: (1, 3, 0, 2),
    5: (3, 0, 2, 4, 1),
    6: (2, 4, 0, 3, 5, 1),
    7: (4, 1, 6, 3, 0, 5, 2),
}
"""Columns of the samples, row by row, of least half-plane error among all permutations."""


@lru_cache(maxsize=64)
def fixed_pattern(count: int) -> NDArray[np.float32]:
    """Return ``(count, 2)`` offsets in [0, 1) of well-spread samples in a pixel.

    One sample is the pixel's centre. No two samples share a row or a column of a ``count`` by
    ``count`` grid. What an edge through the pixel covers is what counts, so the pattern is that of
    least error over half-planes (``half_plane_error``): among all permutations for few samples,
    among rank-1 lattices i -> (i, i g mod n) for many. Samples follow each other in Morton's order,
    so that points of the lens, a sequence, are well spread over every part of the pixel.
    """
    index = np.arange(count)
    if count in _SMALL:
        columns = np.array(_SMALL[count])
    else:
        generators = [g for g in range(1, count) if np.gcd(g, count) == 1]
        lattices = [index * generator % count for generator in generators]
        errors = [half_plane_error(_cell_centres(lattice)) for lattice in lattices]
        columns = lattices[int(np.argmin(errors))]
    grid = np.round(_cell_centres(columns) * _GRID).astype(np.int64)
    bits = np.arange(_GRID.bit_length())
    morton = ((grid[:, :, None] >> bits & 1) << 2 * bits).sum(axis=2) @ [1, 2]
    return (grid[np.argsort(morton)] / _GRID).astype(np.float32)


def _cell_centres(columns: NDArray[np.int64]) -> Float64:
    count = len(columns)
    return np.stack([np.arange(count), columns], axis=1) / count + 0.5 / count


def half_plane_error(points: Float64) -> float:
    """RMS error with which ``points``, ``(n, 2)`` in the unit square, measure half-planes.

    Over 16 directions and 129 offsets; the true area is that of a square cut by a line.
    """
    angles = (np.arange(16) + 0.4) * (np.pi / 16)
    normals = np.stack([np.cos(angles), np.sin(angles)])
    offsets = np.linspace(-0.71, 0.71, 129)
    inside = (points - 0.5) @ normals
    measured = (inside[:, :, None] < offsets).mean(axis=0)
    # The area is the integral of a trapezoid, whose legs are as wide as the smaller extent.
    wide, narrow = np.maximum(*np.abs(normals)), np.minimum(*np.abs(normals))
    ramps = [
        sign * np.maximum(offsets[None] + edge[:, None], 0.0) ** 2
        for sign, edge in (
            (1.0, (wide + narrow) / 2),
            (-1.0, (wide - narrow) / 2),
            (-1.0, (narrow - wide) / 2),
            (1.0, -(wide + narrow) / 2),
        )
    ]
    area = sum(ramps) / (2.0 * wide * narrow)[:, None]
    return float(np.sqrt(np.mean((measured - area) ** 2)))


def sample_slots(pattern: str, count: int, shape: PixelFilter | None) -> NDArray[np.void]:
    """Return where each of a pixel's ``count`` samples may lie, as ``Slot`` records.

    ``shape`` is the pixel filter, None for a box of one pixel.
    """
    slots = np.zeros(count, records.SLOT)
    if pattern == "fixed":
        x, y = fixed_pattern(count).astype(np.float64).T
        x_low = x_high = x
        y_low = y_high = y
    else:
        row = np.arange(count)  # each sample has a row of its own (cl/analytic/place.cl)
        x_low, x_high = np.zeros(count), np.ones(count)
        y_low, y_high = row / count, (row + 1) / count
    if shape is not None:
        x_low, x_high, y_low, y_high = map(shape.place, (x_low, x_high, y_low, y_high))
    slots["x_low"], slots["x_high"] = x_low, x_high
    slots["y_low"], slots["y_high"] = y_low, y_high
    if pattern != "fixed":  # places are rounded on the device
        for name, away in (("x_low", -1e-3), ("x_high", 1e-3), ("y_low", -1e-3), ("y_high", 1e-3)):
            slots[name] += away
    return slots


def filter_of(settings: Settings) -> PixelFilter | None:
    """Return the pixel filter that samples are drawn from; None for a box of one pixel."""
    if settings.filter == "five_point":
        return None  # samples at the centres, which stage "share" makes averages of
    radius = RADII[settings.filter] if settings.filter_radius is None else settings.filter_radius
    if (settings.filter, radius) == ("box", 0.5):
        return None
    return pixel_filter(settings.filter, radius)


def pattern_of(settings: Settings) -> str:
    """Return the sampling pattern: where none is given, the one that suits the method."""
    sampled = settings.method == "stochastic" or settings.slice_times == "stochastic"
    return settings.pattern or ("sobol" if sampled else "fixed")


def sample_count(settings: Settings) -> int:
    """Return the number of samples per pixel: with accumulation those of all slices."""
    return settings.samples * (settings.slices if settings.method == "accumulation" else 1)


def sample_spacing(settings: Settings) -> float:
    """Return the edge, in pixels, of the square that a sample stands for.

    All slices have their samples at the same places, but for those that are sampled stochastically.
    """
    alike = settings.method == "accumulation" and settings.slice_times != "stochastic"
    return float((settings.samples if alike else sample_count(settings)) ** -0.5)


def slots_of(settings: Settings) -> NDArray[np.void]:
    """Return where each of a pixel's samples may lie, as ``Slot`` records."""
    pattern = pattern_of(settings)
    if settings.method != "analytic" and pattern != "fixed":
        pattern = "sobol"  # anywhere in the pixel
    return sample_slots(pattern, settings.samples, filter_of(settings))


def reach_of(settings: Settings) -> tuple[float, float, float, float]:
    """Return where samples may lie relative to their pixels: x from and to, y from and to."""
    slots = slots_of(settings)
    x_low, y_low = float(slots["x_low"].min()), float(slots["y_low"].min())
    return x_low, float(slots["x_high"].max()), y_low, float(slots["y_high"].max())
