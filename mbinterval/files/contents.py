"""Files that a scene is read from, known by their contents: by the very bytes that were read.

All readers of scenes, models and images take bytes through `read_file`, so that a file that is
edited while it is read, or ever after, is known as what the scene has of it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from mbinterval.errors import SceneError

_files: ContextVar[dict[Path, str] | None] = ContextVar("files", default=None)


@contextmanager
def recording() -> Iterator[dict[Path, str]]:
    """Give a mapping that fills with the SHA-256 of each file that the block reads, by its path."""
    found: dict[Path, str] = {}
    token = _files.set(found)
    try:
        yield found
    finally:
        _files.reset(token)


def read_file(path: Path) -> bytes:
    """Return the bytes of a file, and record them; raises ``OSError``."""
    data = path.read_bytes()
    if _files.get() is not None:
        record(path, hashlib.sha256(data).hexdigest())
    return data


def record(path: Path, digest: str) -> None:
    """Add a file that was read, as what has this ``digest``, to what is recorded.

    Raises ``SceneError`` where it was read before, as something else.
    """
    found = _files.get()
    if found is not None and found.setdefault(path, digest) != digest:
        raise SceneError(f"{path}: changed while the scene was read; load it again")
