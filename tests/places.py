"""Where the kernels put the samples of some pixels, and the points of the lens."""

from __future__ import annotations

import numpy as np
from kernels import run

import mbinterval as mb
from mbinterval.sampling import filter_of, slots_of
from mbinterval.scene.model import Camera

TILE = 16


def places(
    settings: mb.Settings, corner: tuple[int, int] = (0, 0), camera: Camera | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Of the 16 x 16 pixels at ``corner``: ``(16, 16, N, 4)`` x, y, u, v; weights ``(16, 16, N)``.

    Compiled as a plan compiles it; with a ``camera`` for its lens.
    """
    n, shape = settings.samples, filter_of(settings)
    defines = {"TILE": TILE, "SAMPLES": n, "LAYERS": n}
    flags = ["-DPLACED", "-DEXACT"]
    flags += ["-DSCATTERED"] if settings.pattern == "sobol" else []
    if shape is not None and settings.pattern == "sobol":
        defines["FILTER_TABLE"] = len(shape.table) - 1
    if shape is not None and shape.mass != 1.0:
        flags.append("-DWEIGHTED")
        defines["FILTER_ZERO"], defines["FILTER_MASS"] = f"{shape.zero}f", f"{shape.mass**2}f"
    if camera is not None:
        flags.append("-DLENS")
        if camera.blades:
            defines["BLADES"] = camera.blades
            defines["BLADE_ROTATION"] = f"{np.radians(camera.blade_rotation):.9e}f"
    options = (*flags, *(f"-D{name}={value}" for name, value in defines.items()))
    table = np.zeros(1, np.float32) if shape is None else shape.table.astype(np.float32)
    count = TILE * TILE * n
    arrays = [
        slots_of(settings), table, np.uint32(settings.seed), *np.int32(corner),
        np.zeros((count, 4), np.float32), np.ones(count, np.float32),
    ]  # fmt: skip
    *_, found, weights = run("place.cl", "place_tile", arrays, options)
    found = found.reshape(n, TILE, TILE, 4).transpose(1, 2, 0, 3)
    return found.astype(np.float64), weights.reshape(n, TILE, TILE).transpose(1, 2, 0)


def within(found: np.ndarray, corner: tuple[int, int] = (0, 0)) -> np.ndarray:
    """Places ``(..., N, 2)`` relative to their pixels' corners."""
    y, x = np.indices(found.shape[:2])
    return found[..., :2] - (np.stack([x, y], axis=-1) + corner)[:, :, None]
