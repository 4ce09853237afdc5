"""An environment as it is seen behind everything: its picture, sums of its texels, and the camera.

``cl/shared/panorama.h`` says how it is looked up.
"""

from __future__ import annotations

import weakref
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.device import records
from mbinterval.exposure.sky import Turning, inverses
from mbinterval.layout.appearance import halved
from mbinterval.plan.plan import Plan
from mbinterval.plan.prepare import Prepared
from mbinterval.scene.environment import Environment

Float32 = NDArray[np.float32]
Int64 = NDArray[np.int64]

MOST_COLUMNS = 8192
"""Finer pictures are halved until they have no more: sums take 24 bytes for each texel."""
PANORAMA = {"panorama": "Panorama", "panorama_texels": "float", "panorama_sums": "long"}
"""What kernels take of it, and of which kind."""
_MOST = 2.0**62
"""Greatest sum, in units; their differences fit into 64 bits."""
_texels: weakref.WeakKeyDictionary[Environment, Float32] = weakref.WeakKeyDictionary()
_sums: weakref.WeakKeyDictionary[Environment, tuple[Int64, float]] = weakref.WeakKeyDictionary()


def add_environment(ready: Prepared, environment: Environment | None) -> Prepared:
    """Return the frame with the picture of the ``environment``, where it is looked at."""
    motion, behind = ready.motion, "SKY" in ready.plan.active
    if environment is None or not looks_at_picture(ready.plan):
        return ready
    made: dict[str, Any] = picture(environment, sums=behind)
    if behind:
        made["sky"] = sky_records(ready.exposure.sky, ready.plan.width, ready.plan.height)
    return replace(ready, motion=replace(motion, places={**motion.places, **made}))


def looks_at_picture(plan: Plan) -> bool:
    """Whether an environment is seen behind everything, or mirrored (``PANORAMA`` in ``cl/``)."""
    return "SKY" in plan.active or {"ENVIRONMENT", "METALLIC"} <= plan.active


def picture(environment: Environment, sums: bool = False) -> dict[str, NDArray[Any]]:
    """Return what kernels take of an environment's picture, with its sums if they are asked for.

    It is kept, since a batch asks for it every frame.
    """
    if environment not in _texels:
        texels = environment.image
        while texels.shape[1] > MOST_COLUMNS:
            texels = halved(halved(texels, 0), 1)
        _texels[environment] = np.ascontiguousarray(texels, np.float32)
    texels = _texels[environment]
    found: dict[str, NDArray[Any]] = {"panorama_texels": texels}
    unit = 0.0
    if sums:
        if environment not in _sums:
            _sums[environment] = sums_of(texels)
        found["panorama_sums"], unit = _sums[environment]
    found["panorama"] = records.pack(
        "Panorama",
        width=texels.shape[1],
        height=texels.shape[0],
        turn=np.radians(environment.rotation % 360.0),
        intensity=environment.intensity,
        unit=environment.intensity * unit,
    )
    return found


def picture_size(environment: Environment) -> tuple[int, int]:
    """Columns and rows of the picture that is looked up."""
    height, width = environment.image.shape[:2]
    while width > MOST_COLUMNS:
        height, width = height // 2, width // 2
    return width, height


def picture_bytes(environment: Environment, sums: bool) -> int:
    """Bytes of the picture, and of its sums."""
    width, height = picture_size(environment)
    return 12 * width * height + (24 * (width + 1) * (height + 1) if sums else 0)


def sums_of(texels: Float32) -> tuple[Int64, float]:
    """``(h + 1, w + 1, 3)``: sums of ``texels`` ``(h, w, 3)`` above and to the left; their unit.

    Whole numbers: each texel is rounded to one, and sums of any box are exact.
    """
    height, width = texels.shape[:2]
    total = float(texels.sum(axis=(0, 1), dtype=np.float64).max())
    unit = total / _MOST if total > 0.0 else 1.0
    sums = np.zeros((height + 1, width + 1, 3), np.int64)
    for row, line in enumerate(texels, start=1):
        sums[row, 1:] = np.rint(line / np.float64(unit)).astype(np.int64).cumsum(axis=0)
    np.cumsum(sums, axis=0, out=sums)
    return sums, unit


def sky_records(sky: tuple[Turning, ...], width: int, height: int) -> NDArray[np.void]:
    """``Sky`` records of the camera for a frame of ``width`` by ``height`` pixels."""
    found = []
    for turning in sky:
        rays = inverses(turning.poses, width, height).reshape(-1, 9)
        poses = turning.poses
        blur = poses.aperture * poses.focal * height / poses.focus
        angle = 1.0 / (poses.focal * height)
        count = len(rays) - 1
        rows = np.zeros(count, records.SKY)
        ends = turning.stretch.ends(count)
        rows["open"], rows["close"] = ends[:-1], ends[1:]
        rows["start"], rows["end"] = rays[:-1], rays[1:]
        rows["blur_start"], rows["blur_end"] = blur[:-1], blur[1:]
        rows["angle_start"], rows["angle_end"] = angle[:-1], angle[1:]
        found.append(rows)
    return np.concatenate(found) if found else np.zeros(0, records.SKY)
