"""Frame ranges, numbered file names and sizes, as film people write them."""

from __future__ import annotations

import re
from pathlib import Path

from mbinterval.checks import shown
from mbinterval.errors import UsageError

ENDINGS = (".exr", ".png", ".npz", ".parquet")
"""Endings of the files that a film can be written to."""

DEEP = ".deep.exr"
"""Ending of the files that its deep image is written to."""

RESOLUTION = (1024, 768)
"""Width and height in pixels where nothing gives them."""

MOST_FRAMES = 1_000_000
"""More frames than this in one range are taken for a mistake."""

FRAME_PLACE = "####"
CAMERA_PLACE = "{camera}"

_RANGE = re.compile(r"(-?\d+)(?:-(-?\d+)(?:[x:](\d+))?)?")
_HASHES = re.compile(r"#+")
_PERCENT = re.compile(r"%(0?)(\d*)d")
_BRACES = re.compile(r"\{([^{}]*)\}")
_FRAME = re.compile(r"frame(?::(0?)(\d+)d?)?")
_UNFIT = re.compile(r"[^\w.\- ]+")


def parse_frames(text: str) -> list[int]:
    """Frames of a range such as ``7``, ``1-24``, ``1-24x2`` or ``1,5,9-12``; the last one counts.

    A step is written ``1-24x2`` or ``1-24:2``.

    Frames come in the order given, each once. Negative frames are allowed: ``-5--1``.

    Raises
    ------
    UsageError
        With the part that is wrong.
    """
    frames: dict[int, None] = {}
    for part in text.split(","):
        match = _RANGE.fullmatch(part.strip())
        if match is None:
            raise UsageError(
                f"frames {text!r}: {part.strip()!r} is no frame or range; "
                "expected for example 7, 1-24, 1-24x2 or 1,5,9-12"
            )
        first = int(match[1])
        last = first if match[2] is None else int(match[2])
        step = 1 if match[3] is None else int(match[3])
        if last < first:
            raise UsageError(f"frames {text!r}: {part.strip()!r} ends before it starts")
        if step < 1:
            raise UsageError(f"frames {text!r}: the step of {part.strip()!r} must be 1 or more")
        if len(frames) + (last - first) // step >= MOST_FRAMES:
            raise UsageError(f"frames {text!r}: more than {MOST_FRAMES:,} frames")
        frames |= dict.fromkeys(range(first, last + 1, step))
    return list(frames)


def parse_outputs(text: str) -> list[str]:
    """Files that ``text`` names, with commas between them; each has one of ``ENDINGS``.

    Raises
    ------
    UsageError
        With the one that is wrong.
    """
    outputs = [part.strip() for part in text.split(",")]
    for output in outputs:
        if not output:
            raise UsageError(f"output {text!r}: a file's name is empty; expected name.####.exr")
        for name in _BRACES.findall(output):
            if name != "camera" and not _FRAME.fullmatch(name):
                raise UsageError(
                    f"output {output!r}: {{{name}}} is unknown; known are {{frame}}, {{frame:04}} "
                    "and {camera}"
                )
        check_ending(output)
    return outputs


def check_ending(path: str | Path) -> None:
    """Raise ``UsageError`` for a file that no film can be written to."""
    if not isinstance(path, str | Path):
        raise UsageError(f"{shown(path)}: expected the path of a file")
    ending = Path(path).suffix
    if ending.lower() not in ENDINGS:
        has = f"unknown ending {ending!r}" if ending else "no ending"
        raise UsageError(f"{path}: {has}; expected {', '.join(ENDINGS[:-1])} or {ENDINGS[-1]}")


def export_of(path: str | Path) -> str:
    """Return what of a film goes to ``path``: "deep", "events", or "" for the film itself."""
    name = str(path).lower()
    if name.endswith(DEEP):
        return "deep"
    return "events" if name.endswith((".npz", ".parquet")) else ""


def is_numbered(pattern: str) -> bool:
    """Whether ``pattern`` has a place for the frame: ``####``, ``%04d`` or ``{frame:04}``."""
    braces = any(_FRAME.fullmatch(name) for name in _BRACES.findall(pattern))
    return bool(braces or _HASHES.search(pattern) or _PERCENT.search(pattern))


def frame_path(pattern: str, frame: int, camera: str = "") -> Path:
    """File of ``frame``, seen by ``camera``.

    Every ``{frame:04}`` becomes the padded number, and so does the last run of ``#``, or else a
    ``%04d``; every ``{camera}`` becomes the camera's name, with ``_`` for what does not go into the
    name of a file. ``frame_path("shot.####.exr", 7)`` is ``shot.0007.exr``; longer numbers are
    never cut.
    """

    def named(match: re.Match[str]) -> str:
        number = _FRAME.fullmatch(match[1])
        if number is None:
            return _file_name(camera)
        return _padded(frame, number[1], number[2])

    hashes, percents = list(_HASHES.finditer(pattern)), list(_PERCENT.finditer(pattern))
    if hashes or percents:
        place = hashes[-1] if hashes else percents[-1]
        padding = f"0{len(place[0])}" if hashes else f"{place[1]}{place[2] or 1}"
        pattern = f"{pattern[: place.start()]}{{frame:{padding}}}{pattern[place.end() :]}"
    return Path(_BRACES.sub(named, pattern))


def resolution(
    width: int | None, height: int | None, stored_width: int | None, stored_height: int | None
) -> tuple[int, int]:
    """Width and height in pixels; where only one is given, the other keeps the stored shape."""
    base_width, base_height = stored_width or RESOLUTION[0], stored_height or RESOLUTION[1]
    if width is None:
        width = base_width if height is None else max(1, round(height * base_width / base_height))
        height = base_height if height is None else height
    elif height is None:
        height = max(1, round(width * base_height / base_width))
    return width, height


def _file_name(text: str) -> str:
    """``text`` as a part of a file's name: no folder, and no step up."""
    name = _UNFIT.sub("_", text)
    return name if name.strip(". ") else "_"


def _padded(frame: int, zero: str | None, width: str | None) -> str:
    return f"{'-' if frame < 0 else ''}{abs(frame):0{width}d}" if zero else str(frame)
