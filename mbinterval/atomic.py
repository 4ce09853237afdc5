"""Files that are there whole or not at all."""

from __future__ import annotations

import fcntl
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mbinterval.errors import OutputError

_PREFIX, _SUFFIX = ".mbinterval-", ".part"


def prepare_output(path: str | Path) -> Path:
    """Make the folder of ``path`` and check that a file can be put there.

    Called before a long render, so that a mistyped path costs seconds and not the frame.

    Raises
    ------
    OutputError
        Where the folder can't be made or written to, or ``path`` is a folder itself.
    """
    path = Path(path)
    with _told_of(path):
        _make_folder(path)
        # Permission bits say nothing to root, and not all about a network's file system.
        temporary, descriptor = _claimed(path.parent)
        temporary.unlink()
        os.close(descriptor)
    return path


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Give a temporary path beside ``path``; what the block writes there replaces ``path``.

    The data is on the disk before the name changes. On any error, and on Ctrl-C, the temporary
    file is removed and an older file at ``path`` stays as it was. System errors become
    `OutputError`. A process that is killed leaves the temporary file to `remove_leftovers`.
    """
    path = Path(path)
    with _told_of(path):
        _make_folder(path)
        temporary, descriptor = _claimed(path.parent)
        try:
            yield temporary
            os.fsync(descriptor)
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
            os.close(descriptor)


def _make_folder(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.is_dir():
        raise OutputError(f"{path}: is a folder; give the name of a file")


def remove_leftovers(folder: Path) -> list[Path]:
    """Remove temporary files of processes that were killed; returns those that were there.

    A file whose writer lives, on this machine or on another one, is locked and stays.
    """
    removed = []
    for path in sorted(folder.glob(f"{_PREFIX}*{_SUFFIX}")):
        try:
            descriptor = os.open(path, os.O_RDWR)
        except OSError:
            continue
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            path.unlink()
            removed.append(path)
        except OSError:
            continue
        finally:
            os.close(descriptor)
    return removed


def _claimed(folder: Path) -> tuple[Path, int]:
    """Make an empty temporary file, and open and lock it as long as its writer lives."""
    while True:
        # A name of its own, not one from tempfile: that would take the user's umask from the file.
        path = folder / f"{_PREFIX}{secrets.token_hex(8)}{_SUFFIX}"
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.fstat(descriptor).st_nlink:
                return path, descriptor
        except OSError as error:
            if not isinstance(error, BlockingIOError):  # a file system that knows no locks
                return path, descriptor
        os.close(descriptor)  # taken for a leftover in the moment before it was locked


@contextmanager
def _told_of(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error
