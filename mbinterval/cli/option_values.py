"""What the texts of command-line options stand for; a wrong one is a ``UsageError``."""

from __future__ import annotations

import argparse
import re
from typing import Any

from mbinterval.errors import SceneError, UsageError
from mbinterval.settings.settings import SETTINGS, check_setting
from mbinterval.values import nearest, number


def argument(parse: Any) -> Any:
    """Turn a parser's UsageError into argparse's own error, which names the option."""

    def parsed(text: str) -> Any:
        try:
            return parse(text)
        except UsageError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return parsed


def pixels(text: str) -> int:
    """Width or height."""
    if not text.isdecimal() or not 1 <= int(text) <= 65536:
        raise UsageError(f"{text!r} is not a whole number from 1 to 65536")
    return int(text)


def shutter(text: str) -> tuple[float, float]:
    """Open and close, in frames relative to the frame."""
    try:
        low, high = map(float, text.split(","))
    except ValueError:
        raise UsageError(f"{text!r} is not OPEN,CLOSE, two numbers") from None
    if not low <= high:
        raise UsageError(f"{text!r}: the shutter must not close before it opens")
    return low, high


def shutter_angle(text: str) -> tuple[float, float]:
    """Open and close of an angle in degrees, and where it lies."""
    from mbinterval.scene.camera import Shutter

    angle, _, place = text.partition(",")
    try:
        angled = Shutter.from_angle(float(angle), place or "centre")
    except (ValueError, SceneError):
        raise UsageError(
            f"{text!r} is not degrees from 0 up, or these and centre, start or end, as in 180,start"
        ) from None
    return angled.open, angled.close


def rounds(text: str) -> int:
    """Renders of each row of a benchmark."""
    if not text.isdecimal() or not 1 <= int(text) <= 10_000:
        raise UsageError(f"{text!r} is not a whole number from 1 to 10000")
    return int(text)


def above_zero(text: str) -> float:
    """A number above 0."""
    return number(value(text), "value", above=0.0)


def frame(text: str) -> float:
    """A frame's number."""
    return number(value(text), "frame")


def names(text: str) -> list[str]:
    """Names with commas between them."""
    return [name.strip() for name in text.split(",")]


def level(text: str) -> float:
    """Probability of a false alarm."""
    return number(value(text), "level", above=0.0, below=1.0)


def variant(text: str) -> tuple[str, dict[str, Any]]:
    """Settings in one text, as in ``samples=16,pattern=sobol``."""
    found = {}
    for part in text.split(","):
        name, given, stated = part.partition("=")
        name = name.strip().replace("-", "_")
        if not given:
            raise UsageError(f"{part!r} is not NAME=VALUE, as in samples=16,pattern=sobol")
        if name not in SETTINGS:
            raise UsageError(f"unknown setting {name!r}, {nearest(name, SETTINGS)}")
        switches = {"true": True, "false": False}
        chosen = switches.get(stated.strip().lower(), value(stated.strip()))
        found[name] = check_setting(name, chosen)
    return text, found


def count(text: str) -> int:
    """Threads of the CPU device, or bands of a frame."""
    if not text.isdecimal() or not 1 <= int(text) <= 4096:
        raise UsageError(f"{text!r} is not a whole number from 1 to 4096")
    return int(text)


def size(text: str) -> int:
    """Bytes; 2G is 2 * 1024**3."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?) ?([KMGT]?)(?:i?B)?", text.strip(), re.IGNORECASE)
    if match is None or not float(match[1]):
        raise UsageError(f"{text!r} is not a size such as 800M or 2G")
    return int(float(match[1]) * 1024 ** " KMGT".index(match[2].upper() or " "))


def tolerance(text: str) -> float:
    """Part by which a row may be slower than in a baseline."""
    return number(value(text), "tolerance", low=0.0)


def crop(text: str) -> tuple[int, int, int, int]:
    """Column, row, width and height in pixels."""
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != 4 or not all(part.isdecimal() for part in parts):
        raise UsageError(f"{text!r} is not X,Y,W,H in whole pixels")
    x, y, width, height = map(int, parts)
    if not (width and height):
        raise UsageError(f"{text!r}: width and height must be 1 or more")
    return x, y, width, height


def clip(text: str) -> str | int:
    """Index of a clip of animation, or its name."""
    return int(text) if text.isdecimal() else text


def value(text: str) -> str | int | float | None:
    """Value of a setting as a scene file would hold it; `Settings` checks it."""
    if text.lower() == "none":
        return None
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def several_devices(text: str | None) -> bool:
    """Whether ``--device`` names several: with commas between them, or ``all``."""
    return text is not None and ("," in text or text.strip().lower() == "all")
