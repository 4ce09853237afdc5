"""Standard streams that are closed, full, gone, or of an encoding that lacks a name's letters."""

from __future__ import annotations

import io
import os
import sys
from typing import Any

from mbinterval.errors import OutputError


def prepare_streams() -> None:
    """Let every standard stream be there, and print what its encoding lacks with escapes.

    A closed one becomes the null device: the next file that is opened would take its number
    otherwise, and get what a library says there.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the least number that is free
    if sys.stdout is None or sys.stdout is sys.__stdout__:
        encoding = sys.stdout.encoding if sys.stdout else "utf-8"
        lines = bool(sys.stdout and sys.stdout.line_buffering)
        buffer = io.BufferedWriter(_StandardOutput(1, "w", closefd=False))
        sys.stdout = io.TextIOWrapper(
            buffer, encoding, errors="backslashreplace", line_buffering=lines
        )
    if sys.stderr is None:
        sys.stderr = os.fdopen(2, "w", encoding="utf-8", errors="backslashreplace", closefd=False)


class _StandardOutput(io.FileIO):
    """Standard output: an error to write is our own, and said once, though Python tries again."""

    _broken = False

    def write(self, data: Any, /) -> int:
        if self._broken:
            return len(data)
        try:
            return super().write(data) or 0
        except BrokenPipeError:
            self._broken = True
            raise
        except OSError as error:
            self._broken = True
            reason = error.strerror or error
            raise OutputError(f"standard output: cannot be written ({reason})") from error
