"""Reader of benchmark scenes (.npz): two positions per vertex, unlit colour per face.

Arrays: V0, V1 ``(n, 3)`` world positions at shutter open and close, F ``(m, 3)`` vertex indices,
C ``(m, 3)`` linear colour, eye ``(3,)`` of a camera that looks along -Z with +Y up, fov in degrees
(vertical), bg a grey or a colour, W and H the size in pixels.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.files.arrays import read_arrays
from mbinterval.files.contents import read_file
from mbinterval.scene.asset import reading
from mbinterval.scene.model import Camera, Mesh, Scene

_NAMES = ("V0", "V1", "F", "C", "eye", "fov", "bg", "W", "H")


def read_benchmark(path: Path) -> tuple[Scene, int, int]:
    """Read the scene and its width and height in pixels."""
    with reading(path, "benchmark"):
        arrays = _arrays(path)
        mesh = Mesh(
            positions=np.stack([arrays["V0"], arrays["V1"]]).astype(np.float64),
            faces=arrays["F"],
            color=arrays["C"],
            color_domain="face",
            shading="unlit",
            name=path.stem,
        )
        x, y, z = arrays["eye"].astype(float)
        scene = Scene(
            meshes=[mesh],
            camera=Camera(position=(x, y, z), fov=float(arrays["fov"])),
            background=tuple(np.broadcast_to(arrays["bg"], 3).astype(float)),
            name=path.stem,
        )
        return scene, int(arrays["W"]), int(arrays["H"])


def _arrays(path: Path) -> dict[str, NDArray[Any]]:
    try:
        return read_arrays(io.BytesIO(read_file(path)), _NAMES)
    except KeyError as error:
        raise SceneError(f"has no array {error.args[0]}; it needs {', '.join(_NAMES)}") from None
