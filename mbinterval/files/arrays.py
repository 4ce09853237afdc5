"""Files of arrays: NumPy archives (.npz) without trust in their headers, and bytes for Arrow."""

from __future__ import annotations

import math
import os
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

_DEFLATE, _HEAD = 1032, 4096
"""How much smaller deflate makes bytes at the most, and what is too small to ask."""
_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def read_arrays(source: str | Path | BinaryIO, names: Iterable[str]) -> dict[str, NDArray[Any]]:
    """Arrays of an archive by name; nothing is allocated that the file has no bytes for.

    Raises ``KeyError`` with the name of an array that is missing, ``OSError`` where the file cannot
    be read, and ``ValueError`` for everything else that is wrong with it.
    """
    try:
        with zipfile.ZipFile(source) as archive:
            return {name: _array(archive, name) for name in names}
    except (OSError, ValueError, KeyError):
        raise
    except MemoryError:
        raise ValueError("does not fit into memory") from None
    except Exception as error:  # zipfile and zlib have errors of their own
        raise ValueError(str(error)) from error


def _array(archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    member = f"{name}.npy"
    if member not in archive.namelist():
        raise KeyError(name)
    info = archive.getinfo(member)
    held = info.compress_size
    if info.compress_type == zipfile.ZIP_DEFLATED:
        held = _DEFLATE * held + _HEAD
    elif info.compress_type != zipfile.ZIP_STORED:
        raise ValueError(f"{name} is compressed in another way than NumPy does")
    stream: Any = archive.fp
    if info.file_size > held or info.header_offset + info.compress_size > stream.seek(0, 2):
        raise ValueError(f"{name} claims {info.file_size} bytes, more than the file holds")
    with archive.open(info) as file:
        version = np.lib.format.read_magic(file)
        if version not in _HEADERS:
            raise ValueError(f"{name} is of version {version}")
        shape, _, dtype = _HEADERS[version](file)
        size = math.prod(shape) * dtype.itemsize
        if min(shape, default=0) < 0 or size != info.file_size - file.tell():
            raise ValueError(f"{name} claims {dtype} {shape}, which is not what it holds")
    with archive.open(info) as file:
        return np.asarray(np.lib.format.read_array(file, allow_pickle=False))


def arrow_stream(path: Path) -> Any:
    """Contents of a file as a stream of Arrow's (``pyarrow.BufferReader``). Raises ``OSError``.

    All in memory of Arrow's own. Of a file of Python's, or bytes, its threads may hold a part for
    longer than Python lives, and that ends in abort; by name it opens none that is not UTF-8.
    """
    import pyarrow

    with path.open("rb") as file:
        buffer = pyarrow.allocate_buffer(os.fstat(file.fileno()).st_size)
        if file.readinto(memoryview(buffer)) != buffer.size:
            raise OSError("changed while it was read")
    return pyarrow.BufferReader(buffer)
