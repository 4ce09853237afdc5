"""Compiled kernels, kept from one process to the next and checked before they are used.

PoCL trusts its cache: where a file in it is damaged, where the disk is full, or where nothing may
be executed, it ends the process. So each process gives PoCL an empty folder of its own, in a place
that was tried (`RunFolder`). What is kept (`KernelStore`) is one file for each program with a
digest of its contents, and is unpacked into that folder, or handed to the drivers of other devices
as a binary. A store that can't be read or written costs time and one line, and never a render.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import logging
import mmap
import os
import secrets
import shutil
import tempfile
from collections.abc import Iterable, Mapping
from multiprocessing.util import Finalize
from pathlib import Path, PurePosixPath

from mbinterval.errors import DeviceError

_log = logging.getLogger(__name__)

_MAGIC = b"mbinterval kernels 1\n"
_PREFIX = "mbinterval-run-"
_ROOM = 8 << 20
"""Bytes that must be free where a program is compiled: several times what the largest takes."""


def store_folder() -> Path | None:
    """Where kernels are kept: ``POCL_CACHE_DIR``, or else the user's cache; None without a home."""
    if os.environ.get("POCL_CACHE_DIR"):
        return Path(os.environ["POCL_CACHE_DIR"])
    base = os.environ.get("XDG_CACHE_HOME")
    try:
        return (Path(base) if base else Path.home() / ".cache") / "mbinterval" / "kernels"
    except RuntimeError:
        return None


class KernelStore:
    """Files of compiled programs, by key; what is wrong with it is said in one line."""

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder
        self._used = folder is not None
        self._damage_said = False

    def load(self, key: str) -> dict[str, bytes]:
        """Files of program ``key`` by name; none where it is not kept, or not as it was written."""
        if not self._used:
            return {}
        path = self._path(key)
        try:
            content = path.read_bytes()
        except FileNotFoundError:
            return {}
        except IsADirectoryError:
            content = b""
        except OSError as error:
            self._leave_out("read", error)
            return {}
        files = _unpacked(content)
        if files is not None:
            return files
        if not self._damage_said:
            self._damage_said = True
            _log.warning(
                "%s holds damaged files; their kernels are compiled anew", self._described()
            )
        with contextlib.suppress(OSError):
            path.unlink()
        return {}

    def save(self, key: str, files: Mapping[str, bytes]) -> None:
        """Keep ``files`` of program ``key``, whole or not at all."""
        if not self._used:
            return
        path = self._path(key)
        temporary = path.with_name(f".{secrets.token_hex(8)}.part")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            try:
                temporary.write_bytes(_packed(files))
                os.replace(temporary, path)
            finally:
                temporary.unlink(missing_ok=True)
        except IsADirectoryError:
            return
        except OSError as error:
            self._leave_out("written", error)

    def _path(self, key: str) -> Path:
        assert self.folder is not None
        return self.folder / key[:2] / f"{key}.kernels"

    def _leave_out(self, done: str, error: OSError) -> None:
        self._used = False
        reason = error.strerror or error
        _log.warning(
            "%s cannot be %s (%s); kernels are compiled anew", self._described(), done, reason
        )

    def _described(self) -> str:
        return f"mbinterval: note: the cache of compiled kernels {self.folder}"


def _packed(files: Mapping[str, bytes]) -> bytes:
    """One file with all contents, after a digest and a line with names and sizes."""
    sizes = json.dumps({name: len(files[name]) for name in sorted(files)}).encode() + b"\n"
    body = sizes + b"".join(files[name] for name in sorted(files))
    return _MAGIC + hashlib.sha256(body).hexdigest().encode() + b"\n" + body


def _unpacked(content: bytes) -> dict[str, bytes] | None:
    """What `_packed` packed; None if it is not that, to the byte."""
    start = len(_MAGIC) + 65
    body = content[start:]
    if content[:start] != _MAGIC + hashlib.sha256(body).hexdigest().encode() + b"\n":
        return None
    line, _, rest = body.partition(b"\n")
    files = {}
    for name, size in json.loads(line).items():
        files[name], rest = rest[:size], rest[size:]
    return files


class RunFolder:
    """The folder in which PoCL compiles for this process alone; it goes when the process ends."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @classmethod
    def make(cls, store: Path | None) -> tuple[RunFolder | None, str]:
        """Make one, and clear up after killed processes; or say why none can be made.

        The system's folder for temporary files comes first, then ``store``, then shared memory.
        """
        refused = []
        for place in _places(store):
            try:
                place.mkdir(parents=True, exist_ok=True)
                _remove_leftovers(place)
                path = _claimed(place)
            except OSError as error:
                refused.append(f"{place} cannot be written ({error.strerror or error})")
                continue
            reason = _unfit(path)
            if not reason:
                return cls(path), ""
            refused.append(f"{place} {reason}")
            shutil.rmtree(path, ignore_errors=True)
        return None, (
            f"PoCL has no folder to compile kernels in: {'; '.join(refused) or 'none is known'}. "
            f"Set TMPDIR to a folder with {_ROOM >> 20} MiB of room from which files may be "
            "executed"
        )

    def check_room(self) -> None:
        """Raise `DeviceError` where a program can't be compiled for want of room."""
        with contextlib.suppress(OSError):
            self.path.mkdir(exist_ok=True)  # a cleaner of temporary files may have been here
        reason = _unfit(self.path)
        if reason:
            raise DeviceError(
                f"kernels cannot be compiled: {self.path} {reason}; make room there, or set TMPDIR "
                "to another folder"
            )

    def programs(self) -> set[str]:
        """Folders of compiled programs, relative to this one."""
        return {str(path.parent.relative_to(self.path)) for path in self.path.glob("*/*/*.bc")}

    def put(self, files: Mapping[str, bytes]) -> None:
        """Write what a `KernelStore` kept of a program where PoCL looks for it."""
        for name, content in files.items():
            place = PurePosixPath(name)
            if place.is_absolute() or ".." in place.parts:
                continue
            path = self.path / place
            if not path.exists():  # PoCL may have mapped it into memory
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)

    def files(self, program: str) -> dict[str, bytes]:
        """Files of a compiled program by name, relative to this folder."""
        found = (self.path / program).rglob("*")
        paths = [path for path in found if path.suffix in (".bc", ".so") and path.is_file()]
        return {path.relative_to(self.path).as_posix(): path.read_bytes() for path in paths}


def _places(store: Path | None) -> Iterable[Path]:
    with contextlib.suppress(OSError):  # no folder for temporary files can be written to
        yield Path(tempfile.gettempdir())
    if store is not None:
        yield store
    if Path("/dev/shm").is_dir():
        yield Path("/dev/shm")


def _unfit(folder: Path) -> str:
    """Say why kernels can't be compiled in ``folder``; permission bits and sizes say little."""
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(secrets.token_bytes(1 << 16) * (_ROOM >> 16))
            file.flush()
            mmap.mmap(file.fileno(), mmap.PAGESIZE, prot=mmap.PROT_READ | mmap.PROT_EXEC).close()
    except PermissionError:
        return "is mounted so that nothing in it may be executed (noexec)"
    except OSError as error:
        return f"has no room ({error.strerror or error})"
    return ""


def _claimed(place: Path) -> Path:
    """Make a folder that is locked as long as this process lives, and goes with it."""
    while True:
        path = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=place))
        descriptor = _locked(path)
        if path.exists():
            break
        os.close(descriptor)  # taken for a leftover in the moment before it was locked
    # Runs in workers of multiprocessing, too, which skip atexit, and never in a forked child.
    Finalize(None, shutil.rmtree, (path, True), exitpriority=0)
    return path


def _locked(folder: Path) -> int:
    """Open ``folder`` and lock it, where its file system knows locks; an `OSError` if taken."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise
    except OSError as error:
        _log.debug("%s cannot be locked: %s", folder, error)
    return descriptor


def _remove_leftovers(place: Path) -> None:
    """Remove folders of this user's processes that were killed; those that live are locked."""
    for path in place.glob(f"{_PREFIX}*"):
        try:
            descriptor = _locked(path)
        except OSError:  # in use, or another user's
            continue
        shutil.rmtree(path, ignore_errors=True)
        os.close(descriptor)
