"""Whether a file that is there is of mbinterval, so that a command may replace it unasked.

It is where the file says so and is there to its end. Files of mbinterval appear under their names
whole: by whom one is that is cut off nobody knows.
"""

from __future__ import annotations

import json
import os
import struct
import zipfile
import zlib
from pathlib import Path
from typing import Any, BinaryIO

from mbinterval.errors import OutputError
from mbinterval.files.atomic import output_place
from mbinterval.version import __version__

MADE_BY = "mbinterval "
SOFTWARE = f"{MADE_BY}{__version__}"
"""What files of this version have under ``software``."""

_PNG = b"\x89PNG\r\n\x1a\n"
_EXR = b"\x76\x2f\x31\x01\x02"
_TILES, _DEEP, _PARTS = 0x02, 0x08, 0x10  # flags of an EXR's sixth byte
_MOST_TEXT = 1 << 26  # bytes of a header or of a text that are looked at
_UNKNOWN = (
    *(OSError, ValueError, LookupError, TypeError, EOFError, RuntimeError, MemoryError),
    *(struct.error, zipfile.BadZipFile, zlib.error),
)
"""What reading a file of another kind, or a part of one, raises."""


def check_replaceable(path: str | Path, kind: str, remedy: str) -> None:
    """Refuse to replace a file that is not provably of mbinterval.

    Nothing is lost of an empty file, nor of what keeps nothing, such as a pipe. ``kind`` is the
    ending of such files, as ".exr"; ``remedy`` ends the message.

    Raises
    ------
    OutputError
        Where the file is to stay.
    """
    place = output_place(path)
    if place is None or not place.exists() or not place.stat().st_size:
        return
    software = software_of(place, kind)
    if software is None:
        raise OutputError(
            f"{path}: is there, not a whole {kind} file, and not known to be by mbinterval; "
            f"{remedy}"
        )
    if not software.startswith(MADE_BY):
        raise OutputError(f"{path}: is there, and not by mbinterval; {remedy}")


def software_of(path: Path, kind: str) -> str | None:
    """Software that a file of ``kind`` says to be by, empty where it says nothing.

    None where the file is of no such kind, or cut off. Pixels and events are not decoded.
    """
    try:
        if kind == ".parquet":
            return _of_parquet(path)
        readers = {".exr": _of_exr, ".png": _of_png, ".npz": _of_npz, ".json": _of_json}
        with path.open("rb") as file:
            return readers[kind](file)
    except _UNKNOWN:
        return None


def _of_exr(file: BinaryIO) -> str:
    """Follow the header, and the table of blocks to the end of the last one."""
    data = file.read(_MOST_TEXT)
    if data[:5] != _EXR:
        raise ValueError("no EXR")
    software, place, deep = "", 8, data[5] & _DEEP
    while data[place]:
        kind = data.index(0, place) + 1
        value = data.index(0, kind) + 5
        size = int.from_bytes(data[value - 4 : value], "little")
        if data[place:kind] == b"software\0":
            software = data[value : value + size].decode()
        place = value + size
    if data[5] & (_TILES | _PARTS):
        return ""
    table = place + 1
    first = int.from_bytes(data[table : table + 8], "little")
    blocks = [place for (place,) in struct.iter_unpack("<q", data[table:first])]
    if min(blocks) < first:
        raise ValueError("blocks are missing")
    file.seek(max(blocks) + 4)
    sizes = struct.unpack("<qq8x", file.read(24)) if deep else struct.unpack("<i", file.read(4))
    _check_end(file, file.tell() + sum(sizes))
    return software


def _of_png(file: BinaryIO) -> str:
    """Follow the chunks to the last one."""
    if file.read(8) != _PNG:
        raise ValueError("no PNG")
    software, kind = "", b""
    while kind != b"IEND":
        size, kind = struct.unpack(">I4s", file.read(8))
        end = file.tell() + size + 4
        if kind == b"iTXt":
            name, _, text = file.read(min(size, _MOST_TEXT)).partition(b"\0")
            if name == b"software":
                software = text.rpartition(b"\0")[2].decode()
        file.seek(end)
    _check_end(file, end)
    return software


def _check_end(file: BinaryIO, end: int) -> None:
    if end > os.fstat(file.fileno()).st_size:
        raise ValueError("cut off")


def _of_npz(file: BinaryIO) -> str:
    from mbinterval.files.arrays import read_arrays

    try:
        metadata = read_arrays(file, ("metadata",))["metadata"]
    except KeyError:
        return ""
    return _stated(json.loads(str(metadata)))


def _of_parquet(path: Path) -> str:
    import pyarrow.parquet

    from mbinterval.files.arrays import arrow_stream

    stored = pyarrow.parquet.read_schema(arrow_stream(path)).metadata or {}
    return _stated(json.loads(stored.get(b"metadata", b"{}")))


def _of_json(file: BinaryIO) -> str:
    found = json.load(file)
    return _stated(found[0] if isinstance(found, list) else found)


def _stated(facts: Any) -> str:
    return str(facts.get("software", "")) if isinstance(facts, dict) else ""
