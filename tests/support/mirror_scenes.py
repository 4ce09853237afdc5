"""Mirrors, and what flies before them."""

from __future__ import annotations

import numpy as np

from mbinterval.scene.model import Light
from support.mirror_rays import Surface

CENTRE = np.array([0.3, 0.0, -6.0])
LIGHTS = (
    Light("ambient", intensity=0.2),
    Light("directional", direction=(0.4, -1.0, -0.8), intensity=0.7),
    Light("point", position=(1.0, 1.5, -2.0), color=(1.0, 0.8, 0.6), intensity=4.0),
    Light("spot", position=(-1.0, 2.0, -1.0), direction=(1, -1, -2), intensity=9.0,
          inner_angle=10.0, outer_angle=40.0),
)  # fmt: skip


def turned(degrees: float) -> np.ndarray:
    """Rotation about y, (3, 3)."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def still(corners: np.ndarray) -> np.ndarray:
    """The two triangles of a rectangle ``(4, 3)``, at both ends of the shutter."""
    return np.stack([np.stack([corners[[0, 1, 2]]] * 2), np.stack([corners[[0, 2, 3]]] * 2)])


def plane(degrees: float, centre: np.ndarray = CENTRE, size: float = 2.0) -> np.ndarray:
    """A rectangle that is turned about y: ``(2, 2, 3, 3)``."""
    corners = np.array([[-1, -0.8, 0], [1, -0.8, 0], [1, 0.8, 0], [-1, 0.8, 0.0]]) * size
    return still(corners @ turned(degrees).T + centre)


def flying(rng: np.random.Generator, low: list[float], high: list[float], size: float) -> Surface:
    corners = rng.uniform(low, high) + rng.normal(0, size, (3, 3))
    moved = corners + rng.normal(0, 0.25, (3, 3)) + rng.normal(0, 0.8, 3)
    return Surface(np.stack([corners, moved])[None], tuple(rng.uniform(0.2, 1, 3)))


def mirror(reflectivity: float = 1.0, degrees: float = 25.0, **fields: object) -> Surface:
    return Surface(plane(degrees), (0.9, 0.8, 0.1), reflectivity=reflectivity, **fields)


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))
