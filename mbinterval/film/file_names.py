"""Numbered file names, as film people write them.

Patterns belong to a file's name: what looks like one in the name of a folder is its name.
"""

from __future__ import annotations

import os
import re
from functools import lru_cache
from pathlib import Path

from mbinterval.errors import UsageError
from mbinterval.film.formats import format_of
from mbinterval.values import shown

FRAME_PLACE = "####"
CAMERA_PLACE = "{camera}"

MOST_DIGITS = 32
"""To more digits no frame's number is padded."""

_HASHES = re.compile(r"#+")
_PERCENT = re.compile(r"%(0?)(\d*)d")
_BRACES = re.compile(r"\{\{|\}\}|\{([^{}]*)\}")
_FRAME = re.compile(r"frame(?::(0?)(\d+)d?)?")
_UNFIT = re.compile(r"[^\w.\- ]+")


def parse_outputs(text: str) -> list[str]:
    """Files that ``text`` names, with commas between them; each of one of `FORMATS`.

    Raises
    ------
    UsageError
        With the one that is wrong.
    """
    outputs = [part.strip() for part in text.split(",")]
    for output in outputs:
        if not output:
            raise UsageError(f"output {text!r}: a file's name is empty; expected name.####.exr")
        if "\0" in output:
            raise UsageError(f"output {output!r}: no file has a 0 in its name")
        _parts(output)
        format_of(output)
    return outputs


def is_numbered(pattern: str) -> bool:
    """Whether the file's name has a place for the frame: ``####``, ``%04d`` or ``{frame:04}``."""
    return any(isinstance(part, int) for part in _parts(pattern))


def has_camera(pattern: str) -> bool:
    """Whether the file's name has a place for the camera: ``{camera}``."""
    return None in _parts(pattern)


def literal(text: str) -> str:
    """Return the pattern that stands for ``text`` as it is, beside a later ``####``."""
    return text.replace("{", "{{").replace("}", "}}")


def frame_path(pattern: str, frame: int, camera: str = "") -> Path:
    """File of ``frame``, seen by ``camera``.

    In the file's name every ``{frame:04}`` becomes the padded number, and so does the last run of
    ``#``, or else a ``%04d``; every ``{camera}`` becomes the camera's name, with ``_`` for what
    does not go into the name of a file; ``{{`` and ``}}`` are braces. Folders stay as they are.
    ``frame_path("shot#1/a.####.exr", 7)`` is ``shot#1/a.0007.exr``; longer numbers are never cut.

    Raises
    ------
    UsageError
        For other braces, and where a number is to have more than `MOST_DIGITS`.
    """

    def text_of(part: str | int | None) -> str:
        if part is None:
            return _file_name(camera)
        return part if isinstance(part, str) else f"{sign}{abs(frame):0{part}d}"

    sign = "-" if frame < 0 else ""
    return Path(os.path.dirname(pattern), "".join(map(text_of, _parts(pattern))))


@lru_cache
def _parts(pattern: str) -> tuple[str | int | None, ...]:
    """What the name of a file is made of: texts, digits of the frame's number, None: the camera."""
    parts: list[str | int | None] = []
    end = 0
    name = os.path.basename(pattern)
    for match in _BRACES.finditer(name):
        parts += [name[end : match.start()], _place(pattern, match)]
        end = match.end()
    parts.append(name[end:])
    for kind in (_HASHES, _PERCENT):
        found = [
            (index, match)
            for index, part in enumerate(parts)
            if isinstance(part, str)
            for match in kind.finditer(part)
        ]
        if found:
            index, match = found[-1]
            text, (start, end) = match.string, match.span()
            zeros = str(len(match[0])) if kind is _HASHES else match[1] and match[2]
            parts[index : index + 1] = [text[:start], _digits(pattern, zeros), text[end:]]
            break
    return tuple(parts)


def _place(pattern: str, match: re.Match[str]) -> str | int | None:
    """What stands for braces in the name of a file."""
    if match[1] is None:
        return match[0][0]
    if match[1] == "camera":
        return None
    number = _FRAME.fullmatch(match[1])
    if number is None:
        raise UsageError(
            f"output {pattern!r}: {match[0]} is unknown; known are {{frame}}, {{frame:04}} and "
            "{camera}; {{ and }} are braces"
        )
    return _digits(pattern, number[1] and number[2])


def _digits(pattern: str, text: str | None) -> int:
    """Digits that a number is padded to; 0 where it isn't."""
    digits = (text or "").lstrip("0")
    if len(digits) > 3 or int(digits or 0) > MOST_DIGITS:
        raise UsageError(
            f"output {shown(pattern)}: a frame's number is padded to {MOST_DIGITS} digits at most"
        )
    return int(digits or 0)


def _file_name(text: str) -> str:
    """``text`` as a part of a file's name: no folder, and no step up."""
    name = _UNFIT.sub("_", text)
    return name if name.strip(". ") else "_"
