"""Files of events read back: whole, and in order, or ``ValueError``."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.arrays import arrow_stream, read_arrays
from mbinterval.checks import shown
from mbinterval.errors import MbintervalError, OutputError

if TYPE_CHECKING:
    from mbinterval.events import Events

TEXTS = ("shape", "resolution", "origin", "metadata")
"""What a file says about its events, as JSON texts."""

_MOST, _FARTHEST = 65536, 2**31


def read_events(path: Path, columns: Mapping[str, str]) -> Events:
    """Read what `Events.write` wrote; ``columns`` are the types by name.

    Raises
    ------
    OutputError
        Where the file is missing, broken, cut off or of another kind.
    """
    if not path.is_file():
        raise OutputError(f"{path}: {'is a folder' if path.is_dir() else 'no such file'}")
    read = _read_parquet if path.suffix.lower() == ".parquet" else _read_npz
    try:
        return read(path, columns)
    except MbintervalError:
        raise
    except MemoryError:
        raise OutputError(
            f"{path}: does not fit into memory, or claims a size that can't"
        ) from None
    except Exception as error:  # readers of other projects raise anything on broken files
        raise OutputError(f"{path}: not a whole file of events ({error})") from error


def _read_npz(path: Path, columns: Mapping[str, str]) -> Events:
    arrays = read_arrays(path, ("offsets", *columns, *TEXTS))
    texts = {name: str(arrays.pop(name)) for name in TEXTS}
    return _events(texts, arrays.pop("offsets"), arrays, columns)


def _read_parquet(path: Path, columns: Mapping[str, str]) -> Events:
    from mbinterval.events import check_parquet

    check_parquet()
    import pyarrow.parquet

    with pyarrow.parquet.ParquetFile(arrow_stream(path)) as file:
        stored = file.schema_arrow.metadata or {}
        texts = {name.decode(): text.decode() for name, text in stored.items()}
        rows, width, samples = _shape(texts)
        # A pixel without events is nothing in the file, and yet an offset in memory.
        most = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        if 4 * 8 * rows * width * samples > most:
            raise MemoryError
        table = file.read()
    arrays = {name: table[name].to_numpy() for name in (*columns, "x", "y", "sample")}
    if any(table[name].null_count for name in arrays):
        raise ValueError("it has nulls")
    place = np.zeros(len(table), np.int64)
    for name, count in (("y", rows), ("x", width), ("sample", samples)):
        values = arrays.pop(name)
        if values.dtype.kind != "u" or values.max(initial=0) >= count:
            raise ValueError(f"{name} is beyond the film")
        place = place * count + values
    if (np.diff(place) < 0).any():
        raise ValueError("its events are not in the order of pixels")
    counts = np.bincount(place, minlength=rows * width * samples)
    return _events(texts, np.append(0, np.cumsum(counts)), arrays, columns)


def _shape(texts: Mapping[str, str]) -> tuple[int, int, int]:
    rows, width, samples = json.loads(texts["shape"])
    return _whole(rows, 1, _MOST), _whole(width, 1, _MOST), _whole(samples, 1, _MOST)


def _pair(text: str) -> tuple[int, int]:
    first, second = json.loads(text)
    return _whole(first, -_FARTHEST, _FARTHEST), _whole(second, -_FARTHEST, _FARTHEST)


def _whole(value: Any, low: int, high: int) -> int:
    if type(value) is not int or not low <= value <= high:
        raise ValueError(f"{shown(value)}: expected a whole number from {low} to {high}")
    return value


def _events(
    texts: Mapping[str, str],
    offsets: NDArray[Any],
    arrays: Mapping[str, NDArray[Any]],
    columns: Mapping[str, str],
) -> Events:
    """Make events of parts that fit together."""
    from mbinterval.events import Events

    rows, width, samples = _shape(texts)
    for name, kind in columns.items():
        if arrays[name].dtype != kind or arrays[name].shape != arrays["t0"].shape:
            raise ValueError(f"column {name} is {arrays[name].dtype} {arrays[name].shape}")
    if (
        offsets.dtype != np.int64
        or offsets.shape != (rows * width * samples + 1,)
        or (offsets[0], offsets[-1]) != (0, arrays["t0"].size)
        or (np.diff(offsets) < 0).any()
    ):
        raise ValueError("its parts do not fit together")
    resolution, origin = _pair(texts["resolution"]), _pair(texts["origin"])
    ends = origin[0] + width, origin[1] + rows
    if any(resolution) and not (min(origin) >= 0 and np.all(np.less_equal(ends, resolution))):
        raise ValueError(f"its {width} x {rows} pixels from {origin} on are not of {resolution}")
    metadata = {
        str(name): tuple(value) if isinstance(value, list) else value
        for name, value in json.loads(texts["metadata"]).items()
    }
    return Events(
        shape=(rows, width, samples),
        offsets=np.ascontiguousarray(offsets),
        columns={name: np.ascontiguousarray(arrays[name]) for name in columns},
        resolution=resolution,
        origin=origin,
        metadata=metadata,
    )
