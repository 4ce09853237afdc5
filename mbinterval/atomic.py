"""Files that are there whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mbinterval.errors import OutputError


def prepare_output(path: str | Path) -> Path:
    """Make the folder of ``path`` and check that a file can be put there.

    Called before a long render, so that a mistyped path costs seconds and not the frame.

    Raises
    ------
    OutputError
        Where the folder can't be made or written to, or ``path`` is a folder itself.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        is_folder = path.is_dir()
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror})") from error
    if is_folder:
        raise OutputError(f"{path}: is a folder; give the name of a file")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise OutputError(f"{path}: its folder {path.parent} cannot be written to")
    return path


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Give a temporary path beside ``path``; what the block writes there replaces ``path``.

    The data is on the disk before the name changes. On any error, and on Ctrl-C, the temporary
    file is removed and an older file at ``path`` stays as it was. System errors become
    `OutputError`.
    """
    path = prepare_output(path)
    # A name of its own, not one from tempfile: that would take the user's umask from the file.
    temporary = path.with_name(f".mbinterval-{secrets.token_hex(8)}.part")
    try:
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        temporary.unlink(missing_ok=True)
