"""Headers of EXR files that claim more pixels than the file's bytes can hold."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil
from typing import Any

_LINES = {
    **dict.fromkeys(("NO", "RLE", "ZIPS"), 1),
    **dict.fromkeys(("ZIP", "PXR24"), 16),
    **dict.fromkeys(("PIZ", "B44", "B44A", "DWAA"), 32),
}
"""Lines of a chunk by compression; no other one has more than `_MOST_LINES`."""
_MOST_LINES = 256
_CHUNK_BYTES = 16
"""Of each chunk, at least: its place in the table of all, its number and its size."""

_DEFLATE = 1032
_RATIO = {"NO": 1, "RLE": 64, "ZIPS": _DEFLATE, "ZIP": _DEFLATE, "PXR24": 2 * _DEFLATE}
"""How much smaller than its pixels a chunk may be, by compression."""
_MOST_RATIO = 2**18
"""Of those that transform blocks of pixels before."""


def least_bytes(parts: Sequence[Any]) -> int:
    """Bytes that the pixels of all ``parts`` take at the least, from their headers alone."""
    return sum(map(_least, parts))


def _least(part: Any) -> int:
    header = part.header
    (left, top), (right, bottom) = header["dataWindow"]
    width, height = int(right) - int(left) + 1, int(bottom) - int(top) + 1
    compression = str(getattr(header.get("compression"), "name", "")).removesuffix("_COMPRESSION")
    kind = str(getattr(header.get("type"), "name", ""))
    chunks = ceil(height / (1 if "deep" in kind else _LINES.get(compression, _MOST_LINES)))
    if "tile" in kind:
        tile = header["tiles"]
        chunks = ceil(width / tile.xSize) * ceil(height / tile.ySize)
    if "deep" in kind:  # a count of samples for each pixel, and any number of these
        pixels = 4 * width * height
    else:
        halves = sum(1 / (channel.xSampling * channel.ySampling) for channel in header["channels"])
        pixels = int(2 * halves * width * height)
    return _CHUNK_BYTES * chunks + pixels // _RATIO.get(compression, _MOST_RATIO)
