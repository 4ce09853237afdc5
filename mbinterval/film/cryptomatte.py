"""Cryptomatte: which objects or materials a pixel shows and how much of it each covers.

After Friedman & Jones, *Cryptomatte Specification*, version 1.2.0 (Psyop, 2018). An ID is the
MurmurHash3 of a name (Appleby, x86, 32 bits, seed 0) as the bits of a float32. A pixel has pairs
of an ID and its coverage, the largest first and equal ones by ID; what has no rank left is dropped.
Coverage here is no estimate: it is the share of the pixel's samples and of the exposure over which
the object is seen, times what its surfaces add where they are translucent.

The hash is written out: a package for twelve lines would be one more of the core's.
"""

from __future__ import annotations

import json
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

_C1, _C2, _M = 0xCC9E2D51, 0x1B873593, 0xFFFFFFFF


def murmur3(data: bytes) -> int:
    """Return the MurmurHash3_x86_32 of ``data`` with seed 0."""
    h = 0
    for start in range(0, len(data), 4):
        block = data[start : start + 4]
        k = _rotated(int.from_bytes(block, "little") * _C1 & _M, 15) * _C2 & _M
        h ^= k
        if len(block) == 4:
            h = (_rotated(h, 13) * 5 + 0xE6546B64) & _M
    h ^= len(data)
    h = (h ^ h >> 16) * 0x85EBCA6B & _M
    h = (h ^ h >> 13) * 0xC2B2AE35 & _M
    return h ^ h >> 16


def _rotated(x: int, bits: int) -> int:
    return (x << bits | x >> 32 - bits) & _M


def id_of(name: str) -> int:
    """Return the ID of ``name``: its hash, one bit changed where the float would be no number.

    That is the specification's ``uint32_to_float32``: floats with an exponent of 0 or 255 are
    denormal, infinite or NaN, and programs change them.
    """
    found = murmur3(name.encode())
    return found ^ 1 << 23 if found >> 23 & 255 in (0, 255) else found


def metadata(layer: str, names: Iterable[str]) -> dict[str, str]:
    """Return the attributes that tell programs of a Cryptomatte ``layer`` and of its ``names``."""
    key = f"cryptomatte/{id_of(layer):08x}"[:-1]
    manifest = {name: f"{id_of(name):08x}" for name in names}
    return {
        f"{key}/name": layer,
        f"{key}/hash": "MurmurHash3_32",
        f"{key}/conversion": "uint32_to_float32",
        f"{key}/manifest": json.dumps(manifest, ensure_ascii=False, separators=(",", ":")),
    }


class Ranks:
    """Ranks IDs by coverage, from visible spans.

    Parameters
    ----------
    ids
        ``(paths,)`` uint32: the ID of each motion path.
    levels
        How many IDs are kept of a pixel.
    shape
        Rows and columns of pixels.
    """

    parts = False

    def __init__(self, ids: NDArray[np.uint32], levels: int, shape: tuple[int, int]) -> None:
        self._ids, self._of_path = np.unique(ids, return_inverse=True)
        self._levels, self._shape = levels, shape
        self._layer = np.zeros((shape[0] * shape[1], 2 * levels), np.float32)

    def take(self, events: NDArray[np.void]) -> None:
        """Rank what the ``events`` of some pixels cover."""
        pixel, number, coverage = self._covered(events)
        order = np.lexsort((number, -coverage, pixel))  # numbers are in the order of IDs
        pixel, number, coverage = pixel[order], number[order], coverage[order]
        rank = np.arange(len(pixel)) - np.repeat(*_runs(pixel))
        kept = (rank < self._levels) & (coverage > 0.0)
        pixel, rank = pixel[kept], 2 * rank[kept]
        self._layer[pixel, rank] = self._ids[number[kept]].view(np.float32)
        self._layer[pixel, rank + 1] = coverage[kept]

    def _covered(
        self, events: NDArray[np.void]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        """Pixels, numbers of IDs, and coverage by both, in the order of pixels and numbers."""
        count = max(len(self._ids), 1)
        number = self._of_path[events["path"]]
        key = events["pixel"].astype(np.int64) * count + number
        coverage = events["weight"].astype(np.float64) * events["color"][:, 3]
        # Neighbours of one sample first: they are many, and need no sorting.
        first = np.flatnonzero(
            np.append(True, (np.diff(key) != 0) | (np.diff(events["sample"]) != 0))[: len(key)]
        )
        key, coverage = key[first], np.add.reduceat(coverage, first) if len(first) else coverage
        order = np.argsort(key, kind="stable")
        key, coverage = key[order], coverage[order]
        first, _ = _runs(key)
        coverage = np.add.reduceat(coverage, first) if len(first) else coverage
        return *np.divmod(key[first], count), coverage

    def result(self) -> NDArray[np.float32]:
        """Return ``(H, W, 2 * levels)``: pairs of ID and coverage."""
        return self._layer.reshape(*self._shape, -1)


def _runs(keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where each run of equal ``keys`` begins, and how long it is."""
    first = np.flatnonzero(np.append(True, np.diff(keys) != 0)[: len(keys)])
    return first, np.diff(np.append(first, len(keys)))
