"""Generated scenes to measure on: random cubes, thin blades of a wheel, a dense sphere.

All of them look from (0, 0, 16) along -Z with a vertical field of view of 40 degrees; every vertex
moves on a straight path over the shutter, the same in every frame. The cubes are those of figures
14 to 16 of Hong & Oh 2017, or faster.
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
_QUAD = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
_FACES = _SIDES[:, _QUAD].reshape(-1, 3).astype(np.int32)
_MOST = 10_000_000
_RINGS = 12  # blades one behind the other along a spoke
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
    _check_count(name, count)
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
    positions = np.stack([start, end]).reshape(2, -1, 3)
    face_color = np.repeat(color.reshape(-1, 3), 2, axis=0)
    return _scene(name, positions, faces.reshape(-1, 3), face_color, double_sided)


def blades(count: int = 48, seed: int = 1) -> Scene:
    """Thin blades on the spokes of a wheel that turns by 0.25 radians: 24 triangles per spoke.

    ``count`` spokes of 12 blades each, from radius 1 to 5.2, 0.04 to 0.21 wide with 48 spokes,
    pitched so that a blade's ends lie 0.4 apart in depth. The wheel moves by (0.28, 0, 0) and tilts
    by 0.05 radians about y meanwhile. Triangles are long and thin, and little hides behind others.
    """
    _check_count("blades", count)
    random = np.random.default_rng(seed)
    along = 1.0 + 0.35 * np.arange(_RINGS + 1)
    half = 0.96 / count * along  # grows with the radius, so that gaps are as wide as blades
    ones = np.ones(_RINGS)
    corners = np.stack(
        [
            np.stack([along[:-1], -half[:-1], 0.2 * ones], axis=1),
            np.stack([along[1:], -half[1:], -0.2 * ones], axis=1),
            np.stack([along[1:], half[1:], -0.2 * ones], axis=1),
            np.stack([along[:-1], half[:-1], 0.2 * ones], axis=1),
        ],
        axis=1,
    )
    angles = 2.0 * np.pi * np.arange(count) / count
    around = np.tile([0.0, 0.0, 1.0], (count, 1))
    start = (corners.reshape(1, -1, 3) @ _turns(around, angles).mT).reshape(-1, 3)
    turned = start @ _turns(np.array([[0.0, 0.0, 1.0]]), np.array([0.25]))[0].T
    end = turned @ _turns(np.array([[0.0, 1.0, 0.0]]), np.array([0.05]))[0].T + [0.28, 0.0, 0.0]
    faces = _QUAD + 4 * np.arange(count * _RINGS, dtype=np.int32)[:, None, None]
    color = random.uniform(0.15, 0.95, (count * _RINGS, 3))
    positions = np.stack([start, end])
    return _scene("blades", positions, faces.reshape(-1, 3), np.repeat(color, 2, axis=0))


def dense_sphere(count: int = 6, seed: int = 1, travel: float = 1.0) -> Scene:
    """A sphere of small triangles that moves by a third of the frame's height: 270 pixels of 768.

    An icosahedron whose faces were split in four ``count`` times, 20 * 4**count triangles (81,920),
    of radius 4, most below a pixel at 1024 x 768, lit from a random side. Everything moves by
    ``travel`` times (4, 1, 1). Back faces are never seen and are culled. Each sample of the middle
    meets about 60 short intervals.
    """
    _check_count("dense_sphere", count)
    if count > 9:
        raise SceneError(f"dense_sphere: count={count!r}, expected a number from 1 to 9")
    points, faces = _icosphere(count)
    light = np.random.default_rng(seed).normal(size=3)
    normals = points[faces].mean(axis=1)
    shade = 0.5 + 0.4 * normals @ light / np.linalg.norm(light)
    color = np.clip(0.5 + 0.4 * normals, 0.1, 0.9) * shade[:, None]
    start = 4.0 * points + [-2.0, 0.0, 0.0]
    positions = np.stack([start, start + travel * np.array([4.0, 1.0, 1.0])])
    return _scene("dense_sphere", positions, faces, color, double_sided=False)


def _icosphere(splits: int) -> tuple[Float64, NDArray[np.int32]]:
    """Vertices on the unit sphere and faces, counter-clockwise seen from outside."""
    g = (1.0 + 5.0**0.5) / 2.0
    points = np.array(
        [[-1, g, 0], [1, g, 0], [-1, -g, 0], [1, -g, 0], [0, -1, g], [0, 1, g]]
        + [[0, -1, -g], [0, 1, -g], [g, 0, -1], [g, 0, 1], [-g, 0, -1], [-g, 0, 1]]
    ) / np.hypot(1.0, g)  # fmt: skip
    faces = np.array(
        [[0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4]]
        + [[11, 10, 2], [10, 7, 6], [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8]]
        + [[3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1]]
    )
    for _ in range(splits):
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        unique, middle = np.unique(edges, axis=0, return_inverse=True)
        between = points[unique].sum(axis=1)
        ab, bc, ca = (middle.reshape(-1, 3) + len(points)).T
        a, b, c = faces.T
        points = np.concatenate([points, between / np.linalg.norm(between, axis=1, keepdims=True)])
        parts = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        faces = np.concatenate([np.stack(part, axis=1) for part in parts])
    return points, faces.astype(np.int32)


def _scene(
    name: str,
    positions: Float64,
    faces: NDArray[np.int32],
    color: Float64,
    double_sided: bool = True,
) -> Scene:
    mesh = Mesh(
        positions=positions,
        faces=faces,
        color=color.astype(np.float32),
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


def _check_count(name: str, count: int) -> None:
    if not 1 <= count <= _MOST:
        raise SceneError(f"{name}: count={count!r}, expected a number from 1 to {_MOST}")


def _rotations(random: np.random.Generator, count: int, largest: float) -> Float64:
    """``(count, 3, 3)`` turns about random axes by angles up to ``largest``."""
    axes = random.normal(size=(count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return _turns(axes, random.uniform(0.0, largest, count))


def _turns(axes: Float64, angles: Float64) -> Float64:
    """``(count, 3, 3)`` turns about unit vectors ``axes`` by ``angles`` in radians (Rodrigues)."""
    x, y, z = axes.T
    zero = np.zeros(len(axes))
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    angle = angles[:, None, None]
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


GENERATORS = {make.__name__: make for make in (ho17_cubes, fast_cubes, blades, dense_sphere)}
"""Every generator of a scene by its name; all take ``count`` and ``seed``."""
