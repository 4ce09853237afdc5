"""OpenEXR files: named channels with attributes, whole or an error.

Guards against what the OpenEXR package does silently: it writes wrong pixels for arrays that
are not contiguous, stores whole numbers beyond 32 bits as 0, changes the mappings that it is
given, opens a truncated file as one without parts, and loses errors of the last that it writes.
"""

from __future__ import annotations

import hashlib
import io
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import OutputError
from mbinterval.files.atomic import write_file
from mbinterval.files.exr_header import least_bytes
from mbinterval.values import shown

AttributeValue = str | int | float | tuple[float, ...]

_FORMAT_ATTRIBUTES = (
    "channels",
    "chunkCount",
    "compression",
    "dataWindow",
    "displayWindow",
    "lineOrder",
    "pixelAspectRatio",
    "screenWindowCenter",
    "screenWindowWidth",
    "type",
    "version",
)
PIXEL_DIGEST = "pixelDigest"
"""Name of the attribute that holds the digest of a file's own pixels."""

_NAME_BYTES = 255
_MAGIC = b"\x76\x2f\x31\x01"


@dataclass(frozen=True, eq=False)
class ExrImage:
    """The first part of an EXR file.

    Attributes
    ----------
    channels
        ``(h, w)`` float32, float16 or uint32 by name, for the data window.
    resolution
        Width and height of the display window.
    origin
        Column and row of the data window's first pixel in the display window.
    attributes
        Everything that isn't part of the format itself.
    """

    channels: Mapping[str, NDArray[Any]]
    resolution: tuple[int, int]
    origin: tuple[int, int]
    attributes: Mapping[str, AttributeValue]


def write_exr(path: str | Path, image: ExrImage) -> None:
    """Write ``image``, losslessly (ZIP), and the digest of its pixels; equal images, equal bytes.

    Raises
    ------
    OutputError
        Where the file can't be written; nothing is left then.
    """
    import OpenEXR

    channels = {name: np.ascontiguousarray(pixels) for name, pixels in image.channels.items()}
    shape = next(iter(channels.values())).shape
    header = _header(image, shape) | {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        PIXEL_DIGEST: pixel_digest(channels),
    }
    _write(path, header, channels)


def write_deep(
    path: str | Path,
    counts: NDArray[np.uint32],
    channels: Mapping[str, NDArray[np.float32]],
    resolution: tuple[int, int],
    origin: tuple[int, int],
    attributes: Mapping[str, AttributeValue],
) -> None:
    """Write a deep image: ``counts`` ``(h, w)`` samples of each pixel, ``channels`` of all of them.

    Losslessly (ZIPS, the best that deep scanlines have), with the digest of its samples.

    Raises
    ------
    OutputError
        Where the file can't be written; nothing is left then.
    """
    import OpenEXR

    image = ExrImage({}, resolution, origin, attributes)
    header = _header(image, counts.shape) | {
        "compression": OpenEXR.ZIPS_COMPRESSION,
        "type": OpenEXR.deepscanline,
        PIXEL_DIGEST: pixel_digest({"": counts, **channels}),
    }
    ends = np.cumsum(counts.ravel(), dtype=np.int64)
    places = list(zip((ends - counts.ravel()).tolist(), ends.tolist(), strict=True))
    deep = {}
    for name, values in channels.items():
        given = np.ascontiguousarray(values)
        pixels = np.empty(counts.size, object)
        pixels[:] = [given[first:end] for first, end in places]
        deep[name] = pixels.reshape(counts.shape)
    _write(path, header, deep)


def _header(image: ExrImage, shape: tuple[int, ...]) -> dict[str, Any]:
    """Attributes and windows of an image of ``shape``."""
    header = {name: _encoded(name, value) for name, value in image.attributes.items()}
    first = np.array(image.origin, dtype=np.int32)
    size = np.array(image.resolution, dtype=np.int32)
    last = first + np.array([shape[1] - 1, shape[0] - 1], dtype=np.int32)
    display = np.zeros(2, dtype=np.int32), size - 1
    return {**header, "dataWindow": (first, last), "displayWindow": display}


def _write(path: str | Path, header: dict[str, Any], channels: dict[str, NDArray[Any]]) -> None:
    import OpenEXR

    written = io.BytesIO()
    try:
        OpenEXR.File(header, channels).write(written)
    except (RuntimeError, TypeError, ValueError) as error:
        raise OutputError(f"{path}: cannot be written as EXR ({error})") from error
    write_file(path, written.getvalue())


def read_exr(path: str | Path, data: bytes | None = None) -> ExrImage:
    """Read the first part of an EXR file that is not deep; from ``data`` if that was read before.

    Raises
    ------
    OutputError
        Where the file is missing, not an EXR, or not whole.
    """
    part = _read(path, data)
    pixels = {name: channel.pixels for name, channel in part.channels.items()}
    if not all(isinstance(values, np.ndarray) and values.ndim == 2 for values in pixels.values()):
        raise OutputError(f"{path}: subsampled pixels cannot be read")
    if any(values.dtype == object for values in pixels.values()):
        raise OutputError(f"{path}: is deep; mbinterval.DeepImage.read reads it")
    if not pixels:
        raise OutputError(f"{path}: the file is cut off or broken; render it again")
    return _image(part, pixels)


def read_deep(
    path: str | Path, names: Sequence[str]
) -> tuple[NDArray[np.uint32], dict[str, NDArray[np.float32]], ExrImage]:
    """Read the first part of a deep EXR file.

    Returns counts ``(h, w)`` of samples, the channels ``names`` of all samples, and what else the
    image has.

    Raises
    ------
    OutputError
        Where the file is missing, not a deep EXR, not whole, or has other channels.
    """
    part = _read(path)
    pixels = {name: channel.pixels for name, channel in part.channels.items()}
    if any(values.dtype != object for values in pixels.values()):
        raise OutputError(f"{path}: is not a deep EXR")
    if not set(names) <= pixels.keys():
        found = ", ".join(sorted(pixels)) or "none"
        raise OutputError(f"{path}: needs channels {', '.join(names)}; the file has {found}")
    shape = pixels[names[0]].shape
    counts = np.array([0 if p is None else len(p) for p in pixels[names[0]].flat], np.uint32)
    channels = {}
    for name in names:
        parts = [np.zeros(0, np.float32), *(p for p in pixels[name].flat if p is not None)]
        channels[name] = np.concatenate(parts).astype(np.float32)
        if len(channels[name]) != counts.sum():
            raise OutputError(f"{path}: the file is cut off or broken; render it again")
    return counts.reshape(shape), channels, _image(part, {})


def _read(path: str | Path, data: bytes | None = None) -> Any:
    """Return the first part of an EXR file; one that is cut off may have no channels."""
    if not isinstance(path, str | Path):
        raise OutputError(f"{shown(path)}: expected the path of a file")
    path = Path(path)
    if not path.is_file():
        raise OutputError(f"{path}: {'is a folder' if path.is_dir() else 'no such file'}")
    try:
        # OpenEXR opens no file whose name is not UTF-8.
        with path.open("rb") if data is None else io.BytesIO(data) as file:
            return _first_part(path, file)
    except OSError as error:
        raise OutputError(f"{path}: cannot be read ({error.strerror or error})") from error


def _first_part(path: Path, file: BinaryIO) -> Any:
    """Read a file, which is ``path`` in messages."""
    import OpenEXR

    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    if file.read(len(_MAGIC)) != _MAGIC:
        raise OutputError(f"{path}: not an EXR file, the only kind that can be read back")
    try:
        file.seek(0)
        if least_bytes(OpenEXR.File(file, header_only=True).parts) > size:
            raise OutputError(
                f"{path}: its header claims more pixels than the file holds; it is broken or cut "
                "off: render it again"
            )
        file.seek(0)
        parts = OpenEXR.File(file, separate_channels=True).parts
    except (RuntimeError, TypeError, ValueError, KeyError) as error:
        raise OutputError(f"{path}: cannot be read as EXR ({error})") from error
    except MemoryError:
        raise OutputError(f"{path}: does not fit into memory") from None
    if not parts:
        raise OutputError(f"{path}: the file is cut off or broken; render it again")
    return parts[0]


def _image(part: Any, channels: Mapping[str, NDArray[Any]]) -> ExrImage:
    header = part.header
    (left, top), (right, bottom) = header["displayWindow"]
    first = header["dataWindow"][0]
    return ExrImage(
        channels=channels,
        resolution=(int(right - left) + 1, int(bottom - top) + 1),
        origin=(int(first[0] - left), int(first[1] - top)),
        attributes={
            name: _decoded(value)
            for name, value in header.items()
            if name not in _FORMAT_ATTRIBUTES
        },
    )


def pixel_digest(channels: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 of named pixels: of names, types, shapes and values."""
    digest = hashlib.sha256()
    for name in sorted(channels):
        pixels = np.ascontiguousarray(channels[name])
        digest.update(f"{name} {pixels.dtype.str} {pixels.shape}\n".encode())
        digest.update(pixels.data)
    return digest.hexdigest()


def _encoded(name: str, value: AttributeValue) -> Any:
    """Value as the OpenEXR package wants it: numbers keep 64 bits, matrices do not."""
    if not name or len(name.encode()) > _NAME_BYTES:
        raise OutputError(f"attribute {name[:40]!r}: a name has 1 to {_NAME_BYTES} bytes in EXR")
    if isinstance(value, str):
        return value
    if isinstance(value, int):
        return int(value) if -(2**31) <= value < 2**31 else str(value)
    if isinstance(value, float):
        # 64 bits, but for the one standard attribute that is always 32.
        return value if name == "expTime" else np.array(value, dtype=np.float64)
    if len(value) in (9, 16):
        edge = math.isqrt(len(value))
        with np.errstate(over="ignore"):  # a camera at 1e200 is infinitely far for other programs
            return np.array(value, dtype=np.float32).reshape(edge, edge)
    if len(value) in (2, 3):
        return np.array(value, dtype=np.float64)
    return " ".join(map(repr, value))


def _decoded(value: Any) -> AttributeValue:
    if isinstance(value, str | int | float):
        return value
    if isinstance(value, np.ndarray):
        numbers = tuple(value.ravel().tolist())
        return numbers[0] if len(numbers) == 1 else numbers
    if hasattr(value, "n") and hasattr(value, "d"):
        return float(value.n) / float(value.d or 1)
    try:
        return str(value)
    except UnicodeDecodeError:  # bytes of a type that the package does not know
        return f"({type(value).__name__})"
