"""Simple shapes for scene files: plane, box, sphere, cylinder, centred on the origin."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.scene.model import Mesh

Float64 = NDArray[np.float64]


def plane(size: tuple[float, float] = (1.0, 1.0)) -> Mesh:
    """Make a rectangle in x and y that faces +Z; its uv run from the lower left to (1, 1)."""
    uv = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    corners = np.column_stack([(uv - 0.5) * size, np.zeros(4)])
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), _constant(4, (0, 0, 1)), uv)


def box(size: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Mesh:
    """Make a box; each of its six sides has the uv of a `plane`."""
    side = plane()
    sides = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            # Columns: where the plane's x, y and z go; a rotation, so that fronts look outwards.
            turn = np.zeros((3, 3))
            turn[axis, 2] = sign
            turn[(axis + 1) % 3, 0] = sign
            turn[(axis + 2) % 3, 1] = 1.0
            sides.append((side.positions @ turn.T + turn[:, 2] / 2.0, turn[:, 2]))
    return Mesh(
        np.concatenate([corners for corners, _ in sides]) * size,
        np.concatenate([side.faces + 4 * index for index in range(6)]),
        np.concatenate([_constant(4, tuple(normal)) for _, normal in sides]),
        np.tile(side.uv, (6, 1)) if side.uv is not None else None,
    )


def sphere(radius: float = 0.5, segments: int = 32) -> Mesh:
    """Make a sphere of ``segments`` meridians and half as many rings, its axis along y."""
    rings = max(segments // 2, 2)
    v, u = np.meshgrid(np.linspace(0, 1, rings + 1), np.linspace(0, 1, segments + 1), indexing="ij")
    around, up = 2.0 * np.pi * u, np.pi * (v - 0.5)
    normals = np.stack(
        [np.cos(up) * np.sin(around), np.sin(up), np.cos(up) * np.cos(around)], axis=2
    ).reshape(-1, 3)
    faces = _grid(rings, segments)
    # At the poles one of the two triangles of a quad has no area.
    lower, upper = np.arange(segments), np.arange(segments) + (rings - 1) * segments
    kept = np.delete(np.arange(len(faces)), np.concatenate([2 * lower, 2 * upper + 1]))
    uv = np.stack([u, v], axis=2).reshape(-1, 2)
    return Mesh(radius * normals, faces[kept], normals, uv)


def cylinder(radius: float = 0.5, height: float = 1.0, segments: int = 32) -> Mesh:
    """Make a closed cylinder, its axis along z; the uv of its caps are the disc seen from outside.

    A wheel that rolls along x with z to the viewer is one without further rotation.
    """
    part = np.linspace(0.0, 1.0, segments + 1)
    around = 2.0 * np.pi * part
    ring = np.column_stack([np.cos(around), np.sin(around), np.zeros(segments + 1)])
    half = np.array([0.0, 0.0, height / 2.0])
    wall = np.concatenate([radius * ring - half, radius * ring + half])
    wall_uv = np.column_stack([np.tile(part, 2), np.repeat([0.0, 1.0], segments + 1)])
    fan = np.column_stack(
        [np.zeros(segments, int), np.arange(segments) + 1, np.arange(segments) + 2]
    )
    positions, normals, uv = [wall], [np.tile(ring, (2, 1))], [wall_uv]
    faces = [_grid(1, segments)]
    for sign in (1.0, -1.0):
        disc = np.concatenate([np.zeros((1, 3)), ring])
        faces.append((fan if sign > 0 else fan[:, ::-1]) + sum(map(len, positions)))
        positions.append(radius * disc + sign * half)
        normals.append(_constant(len(disc), (0.0, 0.0, sign)))
        uv.append(disc[:, :2] * (sign, 1.0) / 2.0 + 0.5)
    return Mesh(
        np.concatenate(positions),
        np.concatenate(faces),
        np.concatenate(normals),
        np.concatenate(uv),
    )


PRIMITIVES: dict[str, Callable[..., Mesh]] = {
    "plane": plane,
    "box": box,
    "sphere": sphere,
    "cylinder": cylinder,
}


def _grid(rows: int, columns: int) -> NDArray[Any]:
    """``(2 * rows * columns, 3)`` faces of a grid of (rows + 1) x (columns + 1) vertices."""
    row, column = np.divmod(np.arange(rows * columns), columns)
    a = row * (columns + 1) + column
    b, c, d = a + 1, a + columns + 2, a + columns + 1
    return np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)


def _constant(count: int, vector: tuple[float, ...]) -> Float64:
    return np.tile(np.array(vector, dtype=np.float64), (count, 1))
