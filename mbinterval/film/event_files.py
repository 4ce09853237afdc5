"""Files of events, .npz and .parquet.

What is written and read are ``parts``: the attributes of `Events` by name.
"""

from __future__ import annotations

import io
import json
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import MbintervalError, OutputError, UsageError
from mbinterval.files.arrays import arrow_stream, read_arrays
from mbinterval.files.atomic import write_file
from mbinterval.files.exr import PIXEL_DIGEST, pixel_digest
from mbinterval.values import shown

Parts = dict[str, Any]

COLUMNS: Mapping[str, str] = {
    **dict.fromkeys(("t0", "t1", "weight", "share"), "f4"),
    **dict.fromkeys(("object", "face"), "u4"),
    **dict.fromkeys(("z0", "z1", "r", "g", "b", "a"), "f4"),
}
"""What is known of each event, by name, and its type; see `Events`."""

TEXTS = ("shape", "resolution", "origin", "metadata")
"""What a file says about its events, as JSON texts."""

_MOST, _FARTHEST = 65536, 2**31
_EPOCH = (1980, 1, 1, 0, 0, 0)  # the day of every file in an archive: equal events, equal bytes


def digest_of(parts: Parts) -> str:
    """SHA-256 of all events."""
    return pixel_digest({"offsets": parts["offsets"], **parts["columns"]})


def _texts(parts: Parts) -> dict[str, str]:
    told = {**parts, "metadata": {**parts["metadata"], PIXEL_DIGEST: digest_of(parts)}}
    return {name: json.dumps(told[name], ensure_ascii=False) for name in TEXTS}


def write_npz(path: Path, parts: Parts) -> None:
    """Write an archive of ``offsets``, the columns, and the texts."""
    arrays = {"offsets": parts["offsets"], **parts["columns"]}
    arrays |= {name: np.array(text) for name, text in _texts(parts).items()}
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w") as archive:
        for name, array in arrays.items():
            info = zipfile.ZipInfo(f"{name}.npy", _EPOCH)
            content = io.BytesIO()
            np.lib.format.write_array(content, array, allow_pickle=False)
            archive.writestr(info, content.getvalue(), zipfile.ZIP_DEFLATED, 1)
    write_file(path, written.getvalue())


def check_parquet() -> None:
    """Raise ``UsageError`` where Parquet can't be written."""
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError:
        raise UsageError(
            "events as .parquet need pyarrow: pip install 'mbinterval[parquet]', or write .npz"
        ) from None


def write_parquet(path: Path, parts: Parts) -> None:
    """Write a table with a row for each event; the texts are metadata of its schema."""
    check_parquet()
    import pyarrow
    import pyarrow.parquet

    _, columns, samples = parts["shape"]
    offsets = parts["offsets"]
    place = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    pixel, sample = np.divmod(place, samples)
    y, x = np.divmod(pixel, columns)
    places = {"x": x, "y": y, "sample": sample}
    found = {name: values.astype(np.uint32) for name, values in places.items()}
    table = pyarrow.table({**found, **parts["columns"]}).replace_schema_metadata(_texts(parts))
    written = pyarrow.BufferOutputStream()
    pyarrow.parquet.write_table(table, written, compression="zstd")
    write_file(path, memoryview(written.getvalue()))


def read_parts(path: Path) -> Parts:
    """Read what was written.

    Raises
    ------
    OutputError
        Where the file is missing, broken, cut off or of another kind.
    """
    if not path.is_file():
        raise OutputError(f"{path}: {'is a folder' if path.is_dir() else 'no such file'}")
    read = _read_parquet if path.suffix.lower() == ".parquet" else _read_npz
    try:
        return read(path)
    except MbintervalError:
        raise
    except MemoryError:
        raise OutputError(
            f"{path}: does not fit into memory, or claims a size that can't"
        ) from None
    except Exception as error:  # readers of other projects raise anything on broken files
        raise OutputError(f"{path}: not a whole file of events ({error})") from error


def _read_npz(path: Path) -> Parts:
    arrays = read_arrays(path, ("offsets", *COLUMNS, *TEXTS))
    texts = {name: str(arrays.pop(name)) for name in TEXTS}
    return _parts(texts, arrays.pop("offsets"), arrays)


def _read_parquet(path: Path) -> Parts:
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
    arrays = {name: table[name].to_numpy() for name in (*COLUMNS, "x", "y", "sample")}
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
    return _parts(texts, np.append(0, np.cumsum(counts)), arrays)


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


def _parts(
    texts: Mapping[str, str], offsets: NDArray[Any], arrays: Mapping[str, NDArray[Any]]
) -> Parts:
    """Return what was read, if it fits together."""
    rows, width, samples = _shape(texts)
    for name, kind in COLUMNS.items():
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
    return {
        "shape": (rows, width, samples),
        "offsets": np.ascontiguousarray(offsets),
        "columns": {name: np.ascontiguousarray(arrays[name]) for name in COLUMNS},
        "resolution": resolution,
        "origin": origin,
        "metadata": metadata,
    }
