"""Where the kernels put the samples of some pixels, and the points of the lens."""

from __future__ import annotations

import numpy as np

import mbinterval as mb
from mbinterval.device.kernel_effects import effect_options
from mbinterval.exposure.exposure import expose
from mbinterval.plan.plan import sampling_numbers
from mbinterval.plan.sampling import filter_of, slots_of
from mbinterval.scene.model import Camera
from support.kernels import numbers, run

TILE = 16


def places(
    settings: mb.Settings, corner: tuple[int, int] = (0, 0), camera: Camera | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Of the 16 x 16 pixels at ``corner``: ``(16, 16, N, 4)`` x, y, u, v; weights ``(16, 16, N)``.

    Compiled as a plan compiles it; with a ``camera`` for its lens.
    """
    n, shape = settings.samples, filter_of(settings)
    scattered = settings.pattern == "sobol"
    flags = {
        "PLACED": True,
        "EXACT": True,
        "SCATTERED": scattered,
        "FILTER_TABLE": scattered and shape is not None,
        "WEIGHTED": shape is not None and shape.mass != 1.0,
        "LENS": camera is not None,
        "BLADES": camera is not None and camera.blades,
    }
    options = [f"-DTILE={TILE}", *effect_options(name for name, there in flags.items() if there)]
    scene = mb.Scene([], camera=camera or Camera())
    told = sampling_numbers(expose(scene, 1.0, 1.0), settings, TILE, TILE)
    table = np.zeros(1, np.float32) if shape is None else shape.table.astype(np.float32)
    count = TILE * TILE * n
    arrays = [
        slots_of(settings), table, numbers(**told, samples=n, layers=n), *np.int32(corner),
        np.zeros((count, 4), np.float32), np.ones(count, np.float32),
    ]  # fmt: skip
    *_, found, weights = run("place.cl", "place_tile", arrays, options)
    found = found.reshape(n, TILE, TILE, 4).transpose(1, 2, 0, 3)
    return found.astype(np.float64), weights.reshape(n, TILE, TILE).transpose(1, 2, 0)


def within(found: np.ndarray, corner: tuple[int, int] = (0, 0)) -> np.ndarray:
    """Places ``(..., N, 2)`` relative to their pixels' corners."""
    y, x = np.indices(found.shape[:2])
    return found[..., :2] - (np.stack([x, y], axis=-1) + corner)[:, :, None]
