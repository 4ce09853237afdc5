"""What a frame is made of, as a digest, and whether a file on the disk is that frame, whole.

A written frame says in its metadata what it is: ``identity``, the digest of all that can change
the image, and ``pixelDigest``, that of its own pixels. Files are compared by contents and by names
relative to the scene's folder, so that a project may move as a whole.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

from mbinterval.device.sources import kernel_root
from mbinterval.errors import OutputError
from mbinterval.files.atomic import output_place
from mbinterval.files.exr import PIXEL_DIGEST
from mbinterval.files.ownership import SOFTWARE
from mbinterval.film.formats import format_of
from mbinterval.scene.camera import Shutter
from mbinterval.settings.settings import Settings

IDENTITY = "identity"
"""Name of the attribute that holds a frame's identity."""


def named_digests(files: Mapping[Path, str]) -> dict[str, str]:
    """Digests of ``files`` by their paths relative to the folder of the first."""
    folder = next(iter(files), Path()).parent
    return {os.path.relpath(path, folder): digest for path, digest in dict(files).items()}


@cache
def program_digest() -> str:
    """Digest of this program: of its modules and its kernels, whatever their version says."""
    package = Path(__file__).resolve().parents[1]
    sources = [(package, "*.py"), (kernel_root(), "*.cl"), (kernel_root(), "*.h")]
    digest = hashlib.sha256()
    for root, pattern in sources:
        for path in sorted(root.rglob(pattern)):
            content = path.read_bytes()
            digest.update(f"{path.relative_to(root)} {len(content)}\n".encode() + content)
    return digest.hexdigest()


def frame_identity(
    files: Mapping[str, str],
    *,
    animation: tuple[str | int | None, float | None],
    frame: int,
    camera: int | None,
    shutter: Shutter,
    resolution: tuple[int, int],
    crop: Sequence[int] | None,
    settings: Settings,
) -> str:
    """Digest of all that can change a frame's image; equal identities are equal images.

    ``files`` are the digests of the scene's files, ``animation`` the clip and the frames per second
    that were asked for, ``camera`` is the place of the camera among the scene's. Settings that
    change speed alone are not part of it, nor is the device: its last bits may differ.
    """
    content: dict[str, Any] = {
        "program": program_digest(),
        "files": dict(files),
        "animation": animation,
        "frame": frame,
        "camera": camera,
        "shutter": {item.name: getattr(shutter, item.name) for item in fields(shutter)},
        "resolution": resolution,
        "crop": crop,
        "settings": settings.given,
    }
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def why_not(path: Path, identity: str) -> str:
    """Say why ``path`` is not the whole frame of that ``identity``; empty where it is.

    The file is decoded in full and its pixels are compared with their digest.
    """
    if output_place(path) is None:
        return "keeps nothing"
    if not path.exists():
        return "is missing"
    try:
        attributes, digest = format_of(path).stored(path)
    except OutputError as error:
        return str(error).removeprefix(f"{path}: ")
    if not identity or attributes.get(IDENTITY) != identity:
        return _difference(attributes)
    return "" if attributes.get(PIXEL_DIGEST) == digest else "has pixels that were changed"


def _difference(attributes: Mapping[str, Any]) -> str:
    if IDENTITY not in attributes:
        return "does not say what it was rendered from"
    if attributes.get("software") != SOFTWARE:
        return f"is by {attributes.get('software')}"
    return "was rendered from another scene, or with other settings"
