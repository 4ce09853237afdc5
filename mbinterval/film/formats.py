"""Kinds of files that a film is written to: one table of all that depends on the ending."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mbinterval.errors import UsageError
from mbinterval.values import shown

Stored = tuple[Mapping[str, Any], str]
"""What a file says about itself, by name, and the digest of the pixels that it has."""


def _nothing() -> None:
    pass


@dataclass(frozen=True)
class Format:
    """A kind of file.

    Attributes
    ----------
    ending
        Of the file's name, in small letters.
    part
        What of a film it has: "deep", "events", or "" for the film itself.
    write
        Writes that, a `DeepImage`, `Events` or an `ExrImage`, to a path: all of it, or
        ``OutputError``.
    stored
        Decodes a file in full; ``OutputError`` where it is not whole.
    check
        Raises ``UsageError`` where a package is missing that such files need.
    """

    ending: str
    part: str
    write: Callable[[Path, Any], object]
    stored: Callable[[Path], Stored]
    check: Callable[[], None] = _nothing


def _write_exr(path: Path, image: Any) -> None:
    from mbinterval.files.exr import write_exr

    write_exr(path, image)


def _stored_exr(path: Path) -> Stored:
    from mbinterval.files.exr import pixel_digest, read_exr

    image = read_exr(path)
    return image.attributes, pixel_digest(image.channels)


def _write_png(path: Path, image: Any) -> None:
    import numpy as np

    from mbinterval.files.images import write_png

    rgba = np.stack([image.channels[name] for name in "RGBA"], axis=2)
    text = {name: value for name, value in image.attributes.items() if name != "transparent"}
    write_png(path, rgba, image.attributes.get("transparent") == 1, text)


def _stored_png(path: Path) -> Stored:
    from mbinterval.files.exr import pixel_digest
    from mbinterval.files.images import read_png

    pixels, text = read_png(path)
    return text, pixel_digest({"": pixels})


def _write_deep(path: Path, image: Any) -> None:
    image.write(path)


def _stored_deep(path: Path) -> Stored:
    from mbinterval.files.exr import pixel_digest, read_deep
    from mbinterval.film.deep import CHANNELS

    counts, channels, image = read_deep(path, CHANNELS)
    return image.attributes, pixel_digest({"": counts, **channels})


def _write_npz(path: Path, events: Any) -> None:
    from mbinterval.film.event_files import write_npz

    write_npz(path, events.parts())


def _write_parquet(path: Path, events: Any) -> None:
    from mbinterval.film.event_files import write_parquet

    write_parquet(path, events.parts())


def _stored_events(path: Path) -> Stored:
    from mbinterval.film.event_files import digest_of, read_parts

    parts = read_parts(path)
    return parts["metadata"], digest_of(parts)


def _check_parquet() -> None:
    from mbinterval.film.event_files import check_parquet

    check_parquet()


FORMATS = (
    Format(".exr", "", _write_exr, _stored_exr),
    Format(".png", "", _write_png, _stored_png),
    Format(".npz", "events", _write_npz, _stored_events),
    Format(".parquet", "events", _write_parquet, _stored_events, _check_parquet),
    Format(".deep.exr", "deep", _write_deep, _stored_deep),
)
"""All kinds; the first of a part is the one that messages propose."""


def format_of(path: str | Path) -> Format:
    """Return the kind of file that ``path`` is by its ending.

    Raises
    ------
    UsageError
        Where no film can be written to such a file.
    """
    if not isinstance(path, str | Path):
        raise UsageError(f"{shown(path)}: expected the path of a file")
    ending, name = Path(path).suffix, Path(path).name.lower()
    found = [kind for kind in FORMATS if ending and name.endswith(kind.ending)]
    if not found:
        has = f"unknown ending {ending!r}" if ending else "no ending"
        known = [kind.ending for kind in FORMATS if kind.ending.count(".") == 1]
        raise UsageError(f"{path}: {has}; expected {', '.join(known[:-1])} or {known[-1]}")
    return max(found, key=lambda kind: len(kind.ending))


def ending_for(part: str) -> str:
    """Return the ending of the files that are proposed for a part of a film."""
    return next(kind.ending for kind in FORMATS if kind.part == part)
