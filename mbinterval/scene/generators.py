"""Generated scenes: seeded random cubes as in figures 14 to 16 of Hong & Oh 2017.

All of them look from (0, 0, 16) along -Z with a vertical field of view of 40 degrees; every cube
moves and turns on a straight path per vertex over the shutter, the same in every frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene.model import Camera, Material, Mesh, Scene

Float64 = NDArray[np.float64]

_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
# Two triangles per side, counter-clockwise seen from outside.
_SIDES = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)
_FACES = _SIDES[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3).astype(np.int32)
_LOW, _HIGH = np.array([-9.0, -6.5, -14.0]), np.array([9.0, 6.5, 4.0])


@dataclass(frozen=True)
class _Recipe:
    """Edges in world units, standard deviation of the displacement per axis, largest turn."""

    edge: tuple[float, float]
    displacement: float
    turn: float


def ho17_cubes(count: int = 1000, seed: int = 1) -> Scene:
    """Cubes as sparse on the screen as Hong & Oh's (2017, figure 15): 1,000 to 2,000 of them.

    Edges are 0.1 to 0.3, displacements over the shutter normal with standard deviation 0.146 per
    axis, turns up to 0.6 radians. The paper does not say how its cubes move; size and motion were
    chosen so that the mean number of intervals per pixel is that of its figure 15, 1.67 with 1,000
    cubes and 3.39 with 2,000. Counted for seed 1 at 1024 x 768 at pixel centres: 1.66 and 3.41,
    where an interval is one maximal time for which one triangle, seen from the front or the back,
    covers the centre, whether or not something else hides it; no interval is too short to count.
    """
    return _cubes("ho17_cubes", count, seed, _Recipe((0.1, 0.3), 0.146, 0.6))


def fast_cubes(count: int = 1000, seed: int = 1, double_sided: bool = False) -> Scene:
    """Larger and faster cubes: 29 intervals per pixel with 1,000, counted as for `ho17_cubes`.

    Edges are 0.3 to 0.9, displacements over the shutter normal with standard deviation 1 per axis,
    turns up to 0.6 radians. Not the same cubes as other benchmarks of that recipe. Back faces, half
    of the intervals, are never seen; unless `double_sided`, they are culled.
    """
    return _cubes("fast_cubes", count, seed, _Recipe((0.3, 0.9), 1.0, 0.6), double_sided)


def _cubes(name: str, count: int, seed: int, recipe: _Recipe, double_sided: bool = True) -> Scene:
    if count < 1:
        raise SceneError(f"{name}: count={count!r}, expected a number from 1 up")
    random = np.random.default_rng(seed)
    centres = random.uniform(_LOW, _HIGH, (count, 3))
    edges = random.uniform(*recipe.edge, count)
    corners = _CORNERS * edges[:, None, None] @ _rotations(random, count, np.pi).mT
    start = corners + centres[:, None]
    turned = corners @ _rotations(random, count, recipe.turn).mT
    moved = centres + random.normal(0.0, recipe.displacement, (count, 3))
    end = turned + moved[:, None]
    faces = _FACES + 8 * np.arange(count, dtype=np.int32)[:, None, None]
    color = random.uniform(0.15, 0.95, (count, 1, 3)) * random.uniform(0.6, 1.0, (count, 6, 1))
    mesh = Mesh(
        positions=np.stack([start, end]).reshape(2, -1, 3),
        faces=faces.reshape(-1, 3),
        color=np.repeat(color.reshape(-1, 3), 2, axis=0).astype(np.float32),
        color_domain="face",
        material=Material(shading="unlit", double_sided=double_sided),
        name=name,
    )
    return Scene(
        meshes=[mesh],
        camera=Camera(position=(0.0, 0.0, 16.0), fov=40.0),
        background=(0.18, 0.18, 0.18),
        name=name,
    )


def _rotations(random: np.random.Generator, count: int, largest: float) -> Float64:
    """``(count, 3, 3)`` turns about random axes by angles up to ``largest`` (Rodrigues)."""
    axes = random.normal(size=(count, 3))
    x, y, z = (axes / np.linalg.norm(axes, axis=1, keepdims=True)).T
    zero = np.zeros(count)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(count, 3, 3)
    angle = random.uniform(0.0, largest, count)[:, None, None]
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)
