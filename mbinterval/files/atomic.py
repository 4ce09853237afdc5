"""Files that are there whole or not at all.

What is to be written is made in memory and goes to the disk in one place, `write_file`: libraries
that write by themselves lose errors, OpenEXR that of its last part.
"""

from __future__ import annotations

import fcntl
import logging
import os
import re
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mbinterval.errors import OutputError

_log = logging.getLogger(__name__)

_PREFIX, _SUFFIX = ".mbinterval-", ".part"
_DESCRIPTORS = re.compile(r"/dev/fd|/proc/(\d+)(?:/task/\d+)?/fd")
_MOST_LINKS = 40


def output_place(path: str | Path) -> Path | None:
    """Return the file that is written for ``path``: itself, or what it is a link to in the end.

    None for what keeps no file: a pipe, a device that takes characters, such as /dev/null, and a
    descriptor of this process, such as /dev/stdout. Bytes are sent there.

    Raises
    ------
    OutputError
        Where nothing can be written: a folder, a socket, a disk's device, links in a circle.
    """
    with _told_of(path):
        return _place(Path(path))


def _place(path: Path) -> Path | None:
    if "\0" in str(path):
        raise OutputError(f"{str(path)!r}: no file has a 0 in its name")
    if _descriptor(path) is not None:
        return None
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):  # a link to what is not there yet, too
        mode = stat.S_IFREG
    if stat.S_ISFIFO(mode) or stat.S_ISCHR(mode):
        return None
    if stat.S_ISDIR(mode):
        raise OutputError(f"{path}: is a folder; give the name of a file")
    if not stat.S_ISREG(mode):
        raise OutputError(f"{path}: is a socket or a disk; give the name of a file, or a pipe")
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def _descriptor(path: Path) -> int | None:
    """Number of the descriptor of this process that ``path``, or what it links to, stands for."""
    text = os.fspath(path)
    for _ in range(_MOST_LINKS):
        folder, name = os.path.split(text)
        folder = os.path.realpath(folder or os.curdir)
        match = _DESCRIPTORS.fullmatch(folder)
        if match and match[1] in (None, str(os.getpid())) and name.isdecimal():
            return int(name)
        try:
            text = os.path.join(folder, os.readlink(os.path.join(folder, name)))
        except OSError:
            return None
    return None


def prepare_output(path: str | Path) -> Path:
    """Make the folder of ``path``, clear it up after killed processes, and check it for room.

    Called before a long render, so that a mistyped path costs seconds and not the frame.

    Raises
    ------
    OutputError
        Where the folder can't be made or written to, or nothing can be written to ``path``.
    """
    path = Path(path)
    place = output_place(path)
    with _told_of(path, place):
        if place is None:
            _check_stream(path)
            return path
        place.parent.mkdir(parents=True, exist_ok=True)
        for leftover in remove_leftovers(place.parent):
            _log.debug("removed %s, of a process that was killed", leftover)
        # Permission bits say nothing to root, and not all about a network's file system.
        temporary, descriptor = _claimed(place.parent)
        temporary.unlink()
        os.close(descriptor)
    return path


def _check_stream(path: Path) -> None:
    """Raise ``OSError`` where ``path`` is not open for writing, or may not be opened.

    It isn't opened here: a pipe waits then for who reads it, and its reader takes the end for all.
    """
    number = _descriptor(path)
    if number is None:
        if not os.access(path, os.W_OK):
            raise OSError("Permission denied")
    elif fcntl.fcntl(number, fcntl.F_GETFL) & os.O_ACCMODE == os.O_RDONLY:
        raise OSError("open for reading only")


def write_file(path: str | Path, data: bytes | memoryview) -> None:
    """Write ``data`` as the contents of ``path``: all of it, or an error.

    It is written beside the file, checked, on the disk before the name changes, and replaces what
    is there; a link stays, and what it links to is replaced. A pipe, a device or a descriptor gets
    the bytes.

    Raises
    ------
    OutputError
        Where the data can't be written, all of it. An older file stays as it was then.
    """
    path = Path(path)
    if output_place(path) is None:
        with _told_of(path):
            descriptor = open_stream(path)
            try:
                write_all(descriptor, data)
            finally:
                os.close(descriptor)
        return
    with replacing(path) as temporary:
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CLOEXEC)
        try:
            write_all(descriptor, data)
            size, expected = os.fstat(descriptor).st_size, memoryview(data).nbytes
        finally:
            os.close(descriptor)
        if size != expected:
            raise OSError(f"{size} of {expected} bytes are there")


def open_stream(path: Path) -> int:
    """Open what `output_place` has no file for; a pipe waits for its reader. Raises ``OSError``."""
    number = _descriptor(path)
    if number is not None:
        return os.dup(number)
    return os.open(path, os.O_WRONLY | os.O_NOCTTY | os.O_CLOEXEC)


def write_all(descriptor: int, data: bytes | memoryview) -> None:
    """Write all of ``data``, of which the system may take a part at a time; or ``OSError``."""
    rest = memoryview(data).cast("B")
    while rest:
        rest = rest[os.write(descriptor, rest) :]


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Give a temporary path beside ``path``; what the block writes there replaces ``path``.

    The data is on the disk before the name changes. On any error, and on Ctrl-C, the temporary
    file is removed and an older file at ``path`` stays as it was. System errors become
    `OutputError`. A process that is killed leaves the temporary file to `remove_leftovers`. A link
    stays; the file that it links to is replaced.
    """
    path = Path(path)
    place = output_place(path)
    with _told_of(path, place):
        if place is None:
            raise OSError("a pipe or a device is not replaced")
        place.parent.mkdir(parents=True, exist_ok=True)
        temporary, descriptor = _claimed(place.parent)
        try:
            yield temporary
            os.fsync(descriptor)
            os.replace(temporary, place)
        finally:
            temporary.unlink(missing_ok=True)
            os.close(descriptor)


def remove_leftovers(folder: Path) -> list[Path]:
    """Remove temporary files of processes that were killed; returns those that were there.

    A file whose writer lives, on this machine or on another one, is locked and stays.
    """
    removed = []
    for path in sorted(folder.glob(f"{_PREFIX}*{_SUFFIX}")):
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError:
            continue
        try:
            if stat.S_ISREG(os.fstat(descriptor).st_mode):
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
def _told_of(path: str | Path, place: Path | None = None) -> Iterator[None]:
    """Say of system errors that ``path``, a link to ``place`` maybe, cannot be written."""
    try:
        yield
    except OSError as error:
        link = f" to {place}" if place not in (None, Path(path)) else ""
        raise OutputError(f"{path}: cannot be written{link} ({error.strerror or error})") from error
