"""Which frames, and of what size, as film people write it."""

from __future__ import annotations

import re

from mbinterval.errors import UsageError

RESOLUTION = (1024, 768)
"""Width and height in pixels where nothing gives them."""

MOST_FRAMES = 1_000_000
"""More frames than this in one range are taken for a mistake."""

_RANGE = re.compile(r"(-?\d+)(?:-(-?\d+)(?:[x:](\d+))?)?")


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
