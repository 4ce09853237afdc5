"""Whether two films have equal expectations, where both are known by independent repeats.

Noise is not known but estimated. So Student's t is taken over repeats, whose sums over any pixels
are independent of each other whatever ties pixels: of single pixels (with the variance pooled over
their neighbours), of tiles and of the whole image, and of a few random sums of pixels, which see
patterns that sums hide. Bonferroni's correction is for the number of them all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

TILES = (1, 4, 1 << 20)
PATTERNS = 8


@dataclass(frozen=True, eq=False)
class Verdict:
    """``p`` of equal expectations; ``rmse`` and ``worst`` of the difference of means, and what

    noise alone would make of the RMSE; the worst pixel's deviation, place and what is there.
    """

    p: float
    rmse: float
    noise: float
    worst: float
    spread: float
    pixel: tuple[int, ...]
    values: tuple[float, float]
    by: str

    def __str__(self) -> str:
        return (
            f"p = {self.p:.1e} by {self.by}; RMSE {self.rmse:.2e} (noise {self.noise:.2e}), worst "
            f"{self.worst:.2e} at {self.pixel}: {self.values[0]:.5f} and {self.values[1]:.5f}"
        )


def judge(
    given: np.ndarray,
    witness: np.ndarray,
    allowed: np.ndarray | float = 0.0,
    rare: float = 0.0,
    along: np.ndarray | None = None,
) -> Verdict:
    """Compare repeats ``(R, H, W, C)`` of a film with the witness's ``(S, H, W, C)``.

    ``allowed`` is a difference that is no error, of any pixel; where R is 1 the film has no noise.
    ``rare`` is the most that one of all a pixel's samples can change it by: what few samples see
    may be missed by all repeats of one side, so that nothing tells its variance. Of a tile it is a
    quarter of that, which is where an edge of what is missed leads through it. ``along`` ``(H, W,
    C)`` is a difference that is looked for besides.
    """
    sides = [np.asarray(side, np.float64) for side in (given, witness)]
    means = [side.mean(axis=0) for side in sides]
    difference = means[0] - means[1]
    variance = sum(_variance(side) for side in sides)
    degrees = min(len(side) - 1 for side in sides if len(side) > 1)
    found: list[tuple[float, str]] = []
    for size in TILES:
        name = {1: "a pixel", TILES[-1]: "the image"}.get(size, f"{size} x {size} pixels")
        merged = [np.stack([_tiles(image, size) for image in side]) for side in sides]
        away = merged[0].mean(axis=0) - merged[1].mean(axis=0)
        spread, df = sum(_variance(side) for side in merged), degrees
        if size == 1:
            spread, df = _pooled(spread), 9 * degrees
        slack = np.broadcast_to(allowed, difference.shape)
        slack = _tiles(slack, size) + {1: rare, 4: rare / 4.0}.get(size, 0.0)
        found.append((_smallest(away, spread, slack, df), name))
    rng = np.random.default_rng(7)
    signs = rng.choice([-1.0, 1.0], size=(PATTERNS, *difference.shape[:2], 1))
    sums = [np.einsum("rhwc,khwd->rkc", side, signs) / difference[..., 0].size for side in sides]
    away = sums[0].mean(axis=0) - sums[1].mean(axis=0)
    slack = np.broadcast_to(allowed, difference.shape).mean(axis=(0, 1))
    found.append((_smallest(away, sum(_variance(s) for s in sums), slack, degrees), "a pattern"))
    if along is not None:
        shape = along / np.abs(along).sum()
        sums = [np.einsum("rhwc,hwc->r", side, shape) for side in sides]
        away = np.atleast_1d(sums[0].mean() - sums[1].mean())
        spread = np.atleast_1d(sum(_variance(s) for s in sums))
        slack = np.sum(np.broadcast_to(allowed, difference.shape) * np.abs(shape))
        found.append((_smallest(away, spread, slack, degrees), "the error that is asked for"))
    p, by = min(found)
    place = np.unravel_index(np.abs(difference).argmax(), difference.shape)
    return Verdict(
        p=min(1.0, p * len(found)),
        rmse=float(np.sqrt(np.mean(difference**2))),
        noise=float(np.sqrt(np.mean(variance))),
        worst=float(np.abs(difference[place])),
        spread=float(np.sqrt(variance[place])),
        pixel=(int(place[1]), int(place[0]), int(place[2])),
        values=(float(means[0][place]), float(means[1][place])),
        by=by,
    )


def _variance(side: np.ndarray) -> np.ndarray:
    """Of the mean over repeats."""
    if len(side) == 1:
        return np.zeros(side.shape[1:])
    return side.var(axis=0, ddof=1) / len(side)


def _tiles(image: np.ndarray, size: int) -> np.ndarray:
    if size == 1:
        return image
    for axis in (0, 1):
        starts = np.arange(0, image.shape[axis], size)
        lengths = np.diff(np.append(starts, image.shape[axis]))
        image = np.add.reduceat(image, starts, axis=axis)
        image = image / np.expand_dims(lengths, tuple(a for a in range(3) if a != axis))
    return image


def _pooled(variance: np.ndarray) -> np.ndarray:
    """The mean over a pixel and its eight neighbours, but no less than its own."""
    padded = np.pad(variance, ((1, 1), (1, 1), (0, 0)), mode="edge")
    height, width = variance.shape[:2]
    mean = sum(padded[i : i + height, j : j + width] for i in range(3) for j in range(3)) / 9.0
    return np.maximum(mean, variance)


def _smallest(away: np.ndarray, variance: np.ndarray, slack: np.ndarray, degrees: int) -> float:
    beyond = np.maximum(np.abs(away) - slack, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(beyond > 0.0, beyond / np.sqrt(variance), 0.0)
    return float(2.0 * stats.t.sf(t.max(), degrees) * t.size)
