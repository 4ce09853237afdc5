"""Films of random pixels for tests."""

import numpy as np

from mbinterval.film.film import Film

METADATA = {
    "frame": 12.0,
    "fps": 24000 / 1001,
    "shutter": (-0.25, 0.25),
    "third": 1 / 3,
    "settings.seed": 2**32 - 1,
    "settings.paths": "triangulated",
    "worldToCamera": tuple(float(i) for i in range(16)),
}


def make_film(height=21, width=34, seed=0, **fields):
    rng = np.random.default_rng(seed)
    rgba = rng.random((height, width, 4), dtype=np.float32) * 3
    rgba[..., 3] = rng.random((height, width))
    depth = rng.random((height, width), dtype=np.float32)
    depth[0, 0] = np.inf
    values = {
        "rgba": rgba,
        "depth": depth,
        "intervals": rng.integers(0, 2**32, (height, width), dtype=np.uint32),
        "timings": {"paths": 0.1},
        "resolution": (width, height),
        "metadata": METADATA,
    }
    return Film(**(values | fields))
