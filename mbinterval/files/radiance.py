"""Radiance's pictures (.hdr): four bytes a pixel, one of them the exponent of all three colours.

Ward 1991, "Real Pixels", and the run lengths that its programs write since then, one channel of a
row after the other. Nothing that the core needs reads them: Pillow does not, and imageio would look
for a FreeImage that was downloaded before.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError

_SIZE = re.compile(rb"-Y (\d{1,6}) \+X (\d{1,6})\n")
_RUNS = range(8, 32768)
"""Widths of rows that may be written in runs."""
_LONGEST = 127
"""Bytes of a run."""


def decode_radiance(data: bytes, what: str) -> NDArray[np.float32]:
    """Decode a picture, rows from top to bottom: ``(h, w, 3)`` float32, scene-linear.

    Raises
    ------
    SceneError
        Naming the image by ``what`` where it is cut off, damaged or of another kind.
    """
    head, blank, rest = data.partition(b"\n\n")
    size = _SIZE.match(rest)
    if not head.startswith(b"#?") or b"FORMAT=32-bit_rle_rgbe" not in head or not blank:
        raise SceneError(f"image {what}: not a Radiance picture in RGBE; save it as EXR")
    if size is None:
        raise SceneError(
            f"image {what}: its rows do not run from top to bottom and left to right; save it so"
        )
    height, width = int(size[1]), int(size[2])
    body = np.frombuffer(rest, np.uint8, offset=size.end())
    pixels = _pixels(body, height, width)
    if pixels is None:
        raise SceneError(f"image {what}: {width} x {height} pixels expected, but it is cut off")
    exponent = pixels[..., 3:].astype(np.int32)
    scale = np.where(exponent > 0, np.ldexp(np.float32(1.0), exponent - (128 + 8)), 0.0)
    found: NDArray[np.float32] = (pixels[..., :3] * scale).astype(np.float32)
    if not np.isfinite(found).all() or 0 in found.shape:
        raise SceneError(f"image {what}: has no pixels, or some that are not finite")
    return found


def _pixels(body: NDArray[np.uint8], height: int, width: int) -> NDArray[np.uint8] | None:
    """Bytes ``(h, w, 4)``, or None where there are too few."""
    runs = width in _RUNS and body[:4].tolist() == [2, 2, width >> 8, width & 255]
    if not runs:
        flat = body[: 4 * height * width]
        return flat.reshape(height, width, 4) if len(flat) == 4 * height * width else None
    if len(body) < height * (4 + 8 * -(-width // _LONGEST)):  # a run has two bytes
        return None
    pixels = np.empty((height, width, 4), np.uint8)
    at, data = 0, body.tobytes()
    for row in pixels:
        at += 4
        for channel in range(4):
            end = _channel(data, at, row[:, channel])
            if end is None:
                return None
            at = end
    return pixels


def _channel(data: bytes, at: int, row: NDArray[np.uint8]) -> int | None:
    """Fill one channel of a row from runs; return where they end, or None where they don't fit."""
    column = 0
    while column < len(row):
        if at + 1 >= len(data):
            return None
        count = data[at]
        if count > 128:
            count -= 128
            part, at = data[at + 1 : at + 2] * count, at + 2
        else:
            part, at = data[at + 1 : at + 1 + count], at + 1 + count
        if not count or len(part) < count or column + count > len(row):
            return None
        row[column : column + count] = np.frombuffer(part, np.uint8)
        column += count
    return at
