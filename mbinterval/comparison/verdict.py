"""Statistical verdicts: whether the difference of two images is explained by sampling noise.

Either side is one image, taken as free of noise, or independent repeats of one: the same render
with other seeds. The null hypothesis is that both have the same expectation in every pixel and
channel. It is tested on tiles of several sizes, single pixels first: a wrong triangle shows in its
pixels, a picture that is one per cent too bright only in averages over many. Repeats are
independent whatever ties pixels together, so a tile's mean has as many degrees of freedom as a
pixel.

A difference of means is split into three. Up to ``tolerance`` it is rounding. Up to an allowance
it may be due to what no sample has met: in N samples an event of probability p is missed with a
probability below exp(-p N), so one that is missed in any of m tests with a probability of at most
a adds up to ln(m / a) / N of the contrast, and no variance tells of it. What is above both is
tested by Student's t (Welch 1947, with the fewer degrees of freedom of both sides).

A small difference all over the image, of either sign, shows in none of these: it is tested by the
sum of squares of the differences of means over the trace of their covariance, which has nearly
Fisher's distribution, with the degrees of freedom that the traces of the covariance and of its
square give (Brunner, Dette & Munk 1997, as Box 1954 has it; the traces after Bai & Saranadasa
1996). They fall where noise is tied between pixels.

The level, the probability that equal images are called different, is shared out equally to the
sizes of tile and the sum of squares, and half of a size's share goes to the allowance. The p-values
of one size, over tiles and channels, are corrected after Holm 1979: the verdict is about whether
*any* pixel differs, which is the family-wise error; Holm's holds it whatever the dependence of
neighbouring pixels and channels, and rejects all that Bonferroni's would. Benjamini and Hochberg's
rule bounds another thing, the part of the listed pixels that is listed wrongly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.comparison.distributions import (
    fisher_above,
    holm,
    student_quantile,
    student_two_sided,
)

Float64 = NDArray[np.float64]

LEVEL = 0.01
TOLERANCE = 1e-5
_TILES = (1, 8, 64)
_POWER_QUANTILE = 1.2815515655446004  # of the normal distribution, at 90 %


@dataclass(frozen=True, eq=False)
class Repeats:
    """Independent repeats of one image; a single one is free of noise.

    Attributes
    ----------
    images
        Arrays ``(H, W, 3)``, scene-linear.
    samples
        Independent samples per pixel in each repeat.
    shared
        Samples of different pixels are at the same times, so that a tile has no more of them than
        a pixel.
    """

    images: Sequence[NDArray[Any]]
    samples: int = 1
    shared: bool = False

    @property
    def noisy(self) -> bool:
        """Whether repeats differ at all."""
        first = self.images[0]
        return any(not np.array_equal(first, image) for image in self.images[1:])


@dataclass(frozen=True)
class Region:
    """A tile that says no: ``size`` pixels square, cut off at the image's edges.

    ``difference`` is image minus reference, mean over the tile, in the channel of least p-value;
    ``p_value`` is corrected within the tiles of this size.
    """

    column: int
    row: int
    size: int
    difference: float
    p_value: float


@dataclass(frozen=True, eq=False)
class Verdict:
    """What the repeats say about a difference.

    Attributes
    ----------
    level
        Probability with which images of equal expectation are called different.
    p_value
        Corrected for pixels, channels and sizes; the difference is not noise where it is at most
        ``level``.
    overall
        The p-value, corrected, of the sum of squares over the image.
    pixels
        ``(H, W)`` bool: single pixels that say no.
    regions
        Tiles of more than one pixel that say no, surest first.
    detectable
        By size of tile: a difference of a tile's mean that is found with a probability of 90 %, in
        the tile and channel where it is median.
    degrees
        Degrees of freedom of the t test.
    """

    level: float
    p_value: float
    overall: float
    pixels: NDArray[np.bool_]
    regions: tuple[Region, ...]
    detectable: Mapping[int, float]
    degrees: int

    @property
    def explained(self) -> bool:
        """The difference is explained by sampling noise."""
        return self.p_value > self.level

    def __str__(self) -> str:
        power = ", ".join(f"{v:.1e} over {self._area(s)}" for s, v in self.detectable.items())
        power = f"at level {self.level:g} it would show, nine times of ten, {power}"
        if self.explained:
            return f"explained by sampling noise (p = {self.p_value:.2g}); {power}"
        counts = dict.fromkeys(self.detectable, 0)
        counts[1] = int(self.pixels.sum())
        for region in self.regions:
            counts[region.size] += 1
        found = [f"{n} x {self._area(size)}" for size, n in counts.items() if n]
        if self.overall <= self.level:
            found.append("the sum of squares")
        by = f"(p = {self.p_value:.2g}): {', '.join(found)} say no"
        return f"not explained by sampling noise {by}; {power}"

    def _area(self, size: int) -> str:
        if size >= max(self.pixels.shape):
            return "the image"
        return "one pixel" if size == 1 else f"{size} x {size} pixels"


def judge(
    image: Repeats, reference: Repeats, level: float = LEVEL, tolerance: float = TOLERANCE
) -> Verdict | None:
    """Test whether ``image`` and ``reference`` have equal expectations.

    Parameters
    ----------
    image, reference
        Of one shape. A side whose repeats are all equal counts as free of noise.
    level
        Probability, above 0 and below 1, of calling equal images different.
    tolerance
        Absolute difference of colour up to which it is rounding.

    Returns
    -------
    None where neither side has repeats that differ: nothing is known about noise then.
    """
    sides = [side for side in (image, reference) if side.noisy]
    if not sides:
        return None
    height, width = np.shape(image.images[0])[:2]
    largest = max(height, width)
    sizes = [*(size for size in _TILES if size < largest), largest]
    contrast = _contrast(image, reference)
    degrees = min(len(side.images) for side in sides) - 1
    share = len(sizes) + 1
    tests = [
        _test(image, reference, size, contrast, degrees, level / share / 2, tolerance)
        for size in sizes
    ]
    overall = min(1.0, share * _sum_of_squares(image, reference, tolerance))
    # Twice, for the half of its share that a size leaves to the allowance.
    p_value = min(overall, *(2.0 * share * float(test.adjusted.min()) for test in tests))
    return Verdict(
        level=level,
        p_value=p_value,
        overall=overall,
        pixels=np.asarray(tests[0].rejected.any(axis=2)),
        regions=tuple(region for test in tests if test.size > 1 for region in test.regions()),
        detectable={test.size: test.detectable for test in tests},
        degrees=degrees,
    )


@dataclass(frozen=True, eq=False)
class _Test:
    """The tests of all tiles of one size: arrays are (rows, columns, channels) of tiles."""

    size: int
    difference: Float64
    adjusted: Float64
    rejected: NDArray[np.bool_]
    detectable: float

    def regions(self) -> list[Region]:
        found = []
        for row, column in np.argwhere(self.rejected.any(axis=2)):
            channel = int(self.adjusted[row, column].argmin())
            p_value = float(self.adjusted[row, column, channel])
            difference = float(self.difference[row, column, channel])
            place = int(column) * self.size, int(row) * self.size
            found.append(Region(*place, self.size, difference, p_value))
        return sorted(found, key=lambda region: (region.p_value, -abs(region.difference)))


def _test(
    image: Repeats,
    reference: Repeats,
    size: int,
    contrast: Float64,
    degrees: int,
    level: float,
    tolerance: float,
) -> _Test:
    mean, variance, scarcity = _moments(image, size)
    other_mean, other_variance, other_scarcity = _moments(reference, size)
    difference, error = mean - other_mean, np.sqrt(variance + other_variance)
    rare = math.log(difference.size / level) * contrast * (scarcity + other_scarcity)
    beyond = np.abs(difference) - rare - tolerance
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(beyond > 0.0, beyond / error, 0.0)
    p_values = student_two_sided(t, degrees)
    adjusted = holm(p_values.ravel()).reshape(p_values.shape)
    quantile = student_quantile(level / difference.size, degrees)
    # A noncentral t, as a normal distribution (Johnson & Welch 1940).
    needed = quantile + _POWER_QUANTILE * math.sqrt(1.0 + quantile**2 / (2.0 * degrees))
    detectable = float(np.median(rare + tolerance + needed * error))
    return _Test(size, difference, adjusted, adjusted <= level, detectable)


def _moments(side: Repeats, size: int) -> tuple[Float64, Float64, Float64]:
    """Mean over repeats of each tile's mean, the variance of that, and one over its samples.

    Of a side without noise the last two are 0.
    """
    first, counts = _tile_means(side.images[0], size)
    if not side.noisy:
        return first, np.zeros_like(first), np.zeros_like(counts)
    count = len(side.images)
    total, squares = np.zeros_like(first), np.zeros_like(first)
    for repeat in side.images:
        offset = _tile_means(repeat, size)[0] - first  # small, so that its square loses nothing
        total += offset
        squares += offset**2
    mean = total / count
    variance = np.maximum(squares / count - mean**2, 0.0) / (count - 1)
    samples = np.ones_like(counts) if side.shared else counts
    return first + mean, variance, 1.0 / (samples * count * side.samples)


def _tile_means(image: NDArray[Any], size: int) -> tuple[Float64, Float64]:
    """Mean of each tile, and the number of its pixels, ``(rows, columns, 1)``."""
    values = np.asarray(image, np.float64)
    edges = [np.arange(0, length, size) for length in values.shape[:2]]
    for axis, starts in enumerate(edges):
        if size > 1:
            values = np.add.reduceat(values, starts, axis=axis)
    spans = [np.minimum(size, np.shape(image)[axis] - edges[axis]) for axis in (0, 1)]
    counts = np.outer(*spans)[..., None].astype(np.float64)
    return values / counts, counts


def _contrast(image: Repeats, reference: Repeats) -> Float64:
    """Range of each channel over all pixels and repeats: the most that a sample may change."""
    images = [*image.images, *reference.images]
    high = np.max([np.max(values, axis=(0, 1)) for values in images], axis=0)
    low = np.min([np.min(values, axis=(0, 1)) for values in images], axis=0)
    return np.asarray(high, np.float64) - np.asarray(low, np.float64)


def _sum_of_squares(image: Repeats, reference: Repeats, tolerance: float) -> float:
    """P-value of the squared differences of means, summed over pixels and channels."""
    means, covariances = [], []
    for side in (image, reference):
        total = sum(np.asarray(values, np.float64) for values in side.images)
        means.append(np.asarray(total).ravel() / len(side.images))
        covariances.append(_centred(side, means[-1]) if side.noisy else None)
    beyond = np.maximum(np.abs(means[0] - means[1]) - tolerance, 0.0)
    traces = [_traces(centred) for centred in covariances if centred is not None]
    trace = sum(first for first, _square, _count in traces)
    squares = sum(square for _first, square, _count in traces)
    spread = sum(square / (count - 1) for _first, square, count in traces)
    if len(traces) == 2 and covariances[0] is not None and covariances[1] is not None:
        product = covariances[0] @ covariances[1].T
        counts = [count for _first, _square, count in traces]
        scale = math.prod(count * (count - 1) for count in counts)
        squares += 2.0 * float(np.sum(product.astype(np.float64) ** 2)) / scale
    return fisher_above(float(beyond @ beyond) / trace, trace**2 / squares, trace**2 / spread)


def _centred(side: Repeats, mean: Float64) -> NDArray[np.float32]:
    """Repeats ``(n, H * W * 3)`` less their mean."""
    rows = [np.asarray(image, np.float64).ravel() - mean for image in side.images]
    return np.array(rows, np.float32)


def _traces(centred: NDArray[np.float32]) -> tuple[float, float, int]:
    """Traces of the covariance of the repeats' mean and of its square, and their number.

    Of two repeats nothing tells the second: then noise is taken to be tied all over the image.
    """
    count = len(centred)
    gram = (centred @ centred.T).astype(np.float64) / (count - 1)
    trace = float(np.trace(gram))
    if count < 3:
        square = trace**2
    else:
        biased = float(np.sum(gram**2)) - trace**2 / (count - 1)
        square = biased * (count - 1) ** 2 / ((count + 1) * (count - 2))
    square = min(max(square, trace**2 / centred.shape[1]), trace**2)
    return trace / count, square / count**2, count
