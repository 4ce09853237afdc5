"""Where the kernels are, in a checkout, an editable install, and an installed wheel."""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
from functools import cache
from pathlib import Path

from mbinterval.errors import DeviceError

_PACKAGE = Path(__file__).resolve().parent.parent
_INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"', re.MULTILINE)
_DESCRIPTOR = 200
"""First number to try for the descriptor of the kernels' folder, above those that programs use."""


def kernel_root(package: Path = _PACKAGE) -> Path:
    """Folder ``cl`` with the kernels: the root of kernel names.

    A wheel holds it inside the package; a checkout and an editable install have it beside the
    package.

    Raises
    ------
    DeviceError
        Where neither is there, with both places.
    """
    places = (package / "cl", package.parent / "cl")
    for place in places:
        if next(place.glob("**/*.cl"), None) is not None:
            return place
    tried = " and ".join(map(str, places))
    raise DeviceError(f"no kernels (.cl files) in {tried}; install mbinterval again")


@cache
def include_folder() -> str:
    """What ``-I`` names: the kernels' folder, by an open descriptor where the system has that.

    PoCL splits its options at blanks, whatever the quotes, and no driver agrees with another on
    ``#`` and the like. Such a name is the same wherever the package is installed, too, so that
    equal kernels are one entry of PoCL's cache.
    """
    root = kernel_root()
    if not Path("/proc/self/fd").is_dir():
        return str(root)
    opened = os.open(root, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        descriptor = fcntl.fcntl(opened, fcntl.F_DUPFD_CLOEXEC, _DESCRIPTOR)
    except OSError:  # fewer descriptors are allowed
        return f"/proc/self/fd/{opened}"
    os.close(opened)
    return f"/proc/self/fd/{descriptor}"


def source_digest(source: str) -> str:
    """SHA-256 of a kernel's ``source`` and of all files that it includes, by way of others too."""
    root = kernel_root()
    texts: dict[Path, bytes] = {}
    waiting = [(root, source.encode())]
    digest = hashlib.sha256(source.encode())
    while waiting:
        folder, text = waiting.pop()
        for name in _INCLUDE.findall(text.decode("utf-8", "replace")):
            beside = folder / name
            path = beside if beside.is_file() else root / name
            if path not in texts and path.is_file():
                texts[path] = path.read_bytes()
                waiting.append((path.parent, texts[path]))
    for path in sorted(texts):
        digest.update(f"{os.path.relpath(path, root)} {len(texts[path])}\n".encode())
        digest.update(texts[path])
    return digest.hexdigest()
