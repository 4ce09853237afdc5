"""Deep images: how coverage and colour are spread over depth, in pixels with many samples.

Visible spans that are apart in time cover a pixel by shares that **add up**: c_k of the exposure
and of the pixel's area, as far as alpha goes. "Over" takes the alphas of layers for independent:
what lies behind a layer is dimmed by 1 - alpha. So of layers in order of depth the alpha is

    a_k = c_k / T_k,   T_k = 1 - (c_1 + ... + c_{k-1}),

the part that layer k has of what those before it leave open, and its colour C_k, premultiplied
with c_k, becomes C_k / T_k. By induction (1 - a_1) ... (1 - a_{k-1}) = T_k, and "over" gives back
the sums of c_k and of C_k, the beauty's alpha and colour, whatever the layers are. What is blended
at one time is a special case: a surface of alpha a behind others that let through T adds a T.

Layers are slices of depth. Slice i goes from (1 + tolerance)^i to the next such depth, the same in
every pixel; all spans of a slice are one sample, from the least depth Z to the greatest ZBack of
what is in it. A span whose depth changes lies in all slices that it passes, with the share of its
coverage that falls to each if its depth changes evenly. So samples never overlap (they are "tidy":
Kainz, *Interpreting OpenEXR Deep Pixels*, 2013); surfaces less than ``tolerance`` times their depth
apart may be one; and ``tolerance`` bounds how far a sample's depth is from the span's it was made
from, but for depth within a span that is not even in time. Samples of which others leave less than
a millionth are joined with the one before.

What is put between samples later is dimmed by those before it as if it were there at other times
than they with a probability of their alpha: a deep image does not tell when.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.files.exr import AttributeValue, read_deep, write_deep

_CLOSED = 1e-6  # what is left open, below which nothing more is told apart
_NEAREST, _FARTHEST = 1e-30, 1e30
CHANNELS = ("R", "G", "B", "A", "Z", "ZBack")


@dataclass(frozen=True, eq=False)
class DeepImage:
    """Samples in depth of every pixel, near ones first.

    Attributes
    ----------
    counts
        ``(H, W)`` uint32: samples of each pixel; those of all pixels follow each other, row by row.
    z, z_back
        ``(N,)`` float32: where each begins and ends, as distance along the view axis.
    rgba
        ``(N, 4)`` float32: colour, premultiplied, and alpha, for "over"; without background.
    resolution, origin, metadata
        As of a `Film`.
    """

    counts: NDArray[np.uint32]
    z: NDArray[np.float32]
    z_back: NDArray[np.float32]
    rgba: NDArray[np.float32]
    resolution: tuple[int, int] = (0, 0)
    origin: tuple[int, int] = (0, 0)
    metadata: Mapping[str, AttributeValue] = field(default_factory=dict)

    def flatten(self) -> NDArray[np.float32]:
        """Lay all samples over each other: ``(H, W, 4)``, premultiplied, without background."""
        counts = self.counts.ravel().astype(np.int64)
        first = np.cumsum(counts) - counts
        flat, left = np.zeros((len(counts), 4)), np.ones(len(counts))
        for place in range(int(counts.max(initial=0))):
            pixel = np.flatnonzero(counts > place)
            sample = self.rgba[first[pixel] + place].astype(np.float64)
            flat[pixel] += left[pixel, None] * sample
            left[pixel] *= 1.0 - sample[:, 3]
        return flat.reshape(*self.counts.shape, 4).astype(np.float32)

    def write(self, path: str | Path) -> Path:
        """Write a deep EXR (scanlines, ZIPS, 32-bit float), all of it or nothing.

        Its channels are R, G, B, A, Z and ZBack. Equal images give equal bytes.

        Raises
        ------
        OutputError
            Where the file can't be written; nothing is left then, and an older file stays.
        """
        values = (*self.rgba.T, self.z, self.z_back)
        channels = dict(zip(CHANNELS, values, strict=True))
        write_deep(path, self.counts, channels, self.resolution, self.origin, self.metadata)
        return Path(path)

    @classmethod
    def read(cls, path: str | Path) -> DeepImage:
        """Read a deep EXR with these channels, as this or another program wrote it.

        Raises
        ------
        OutputError
            Where the file is missing, broken, cut off, not deep, or lacks a channel.
        """
        counts, channels, image = read_deep(path, CHANNELS)
        return cls(
            counts=counts,
            z=channels["Z"],
            z_back=channels["ZBack"],
            rgba=np.stack([channels[name] for name in "RGBA"], axis=1),
            resolution=image.resolution,
            origin=image.origin,
            metadata=image.attributes,
        )


class Slices:
    """Makes a deep image of visible spans.

    ``tolerance`` is the thickness of a slice as a part of its depth, ``shape`` rows and columns.
    """

    parts = False

    def __init__(self, tolerance: float, shape: tuple[int, int]) -> None:
        self._step, self._shape = np.log1p(tolerance), shape
        self._counts = np.zeros(shape[0] * shape[1], np.int64)
        self._parts: list[tuple[NDArray[np.int64], NDArray[np.float32]]] = []

    def take(self, events: NDArray[np.void]) -> None:
        """Slice the ``events`` of some pixels."""
        added = events["color"].astype(np.float64) * events["weight"][:, None]
        seen = np.flatnonzero(added[:, 3] > 0.0)
        pixel, added = events["pixel"][seen].astype(np.int64), added[seen]
        ends = np.stack([events["z0"][seen], events["z1"][seen]]).astype(np.float64)
        near, far = np.clip([ends.min(axis=0), ends.max(axis=0)], _NEAREST, _FARTHEST)
        first = np.floor(np.log(near) / self._step).astype(np.int64)
        count = np.floor(np.log(far) / self._step).astype(np.int64) - first + 1
        which = np.repeat(np.arange(len(pixel)), count)
        place = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
        number = first[which] + place
        low = np.where(place > 0, np.exp(number * self._step), near[which])
        inside = place < count[which] - 1
        high = np.where(inside, np.exp((number + 1) * self._step), far[which])
        length = (far - near)[which]
        share = np.divide(high - low, length, out=np.ones(len(which)), where=count[which] > 1)
        self._add(pixel[which], number, low, high, share[:, None] * added[which])

    def _add(
        self,
        pixel: NDArray[np.int64],
        number: NDArray[np.int64],
        near: NDArray[np.float64],
        far: NDArray[np.float64],
        added: NDArray[np.float64],
    ) -> None:
        """Join what lies in one slice of a pixel, and make samples for "over" of the sums."""
        if not len(pixel):
            return
        low = number.min()
        key = pixel * (number.max() - low + 1) + (number - low)
        order = np.argsort(key, kind="stable")  # which is quick where much is in order
        key = key[order]
        first = np.flatnonzero(np.append(True, np.diff(key) != 0))
        added = _summed(added[order], first)
        near = np.minimum.reduceat(near[order], first)
        far = np.maximum.reduceat(far[order], first)
        pixel = pixel[order[first]]
        left = _left_open(pixel, added[:, 3])
        first = np.flatnonzero(left > _CLOSED)
        added = _summed(added, first)
        far = np.maximum.reduceat(far, first)
        rgba = added / np.maximum(left[first], added[:, 3])[:, None]  # rounding may close it early
        samples = np.concatenate([near[first, None], far[:, None], rgba], axis=1)
        self._parts.append((pixel[first], samples.astype(np.float32)))
        self._counts += np.bincount(pixel[first], minlength=len(self._counts))

    def result(self) -> DeepImage:
        """Return the image of all pixels that were taken."""
        starts = np.cumsum(self._counts) - self._counts
        samples = np.zeros((int(self._counts.sum()), 6), np.float32)
        for pixel, part in self._parts:
            first = np.flatnonzero(np.append(True, np.diff(pixel) != 0))
            place = np.arange(len(pixel)) - np.repeat(first, np.diff(np.append(first, len(pixel))))
            samples[starts[pixel] + place] = part
        return DeepImage(
            counts=self._counts.reshape(self._shape).astype(np.uint32),
            z=np.ascontiguousarray(samples[:, 0]),
            z_back=np.ascontiguousarray(samples[:, 1]),
            rgba=np.ascontiguousarray(samples[:, 2:]),
        )


def _summed(values: NDArray[np.float64], first: NDArray[np.int64]) -> NDArray[np.float64]:
    """Sums of rows of ``values``, from each ``first`` to the next."""
    run = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(values))))
    return np.stack([np.bincount(run, column, len(first)) for column in values.T], axis=1)


def _left_open(pixel: NDArray[np.int64], coverage: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what the samples before each leave open; ``pixel`` ascends."""
    first = np.flatnonzero(np.append(True, np.diff(pixel) != 0))
    before: NDArray[Any] = np.cumsum(coverage) - coverage
    sizes = np.diff(np.append(first, len(pixel)))
    return np.asarray(1.0 - (before - np.repeat(before[first], sizes)))
