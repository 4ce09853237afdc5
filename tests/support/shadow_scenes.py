"""Small scenes with shadows in motion, for tests of both paths."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mbinterval.scene.model import Camera, Light, Material, Mesh, Scene
from mbinterval.scene.primitives import box, sphere
from mbinterval.scene.tracks import Track
from mbinterval.scene.transforms import Transform

SUN = Light("directional", direction=(0.4, -1.0, 0.15), intensity=0.8, shadows=True)
LAMP = Light("point", position=(0.3, 2.6, 0.4), intensity=4.0, shadows=True)
SPOT = Light(
    "spot", position=(-1.0, 2.8, 0.6), direction=(0.35, -1.0, -0.2), intensity=5.0,
    inner_angle=20.0, outer_angle=32.0, shadows=True,
)  # fmt: skip
AMBIENT = Light("ambient", intensity=0.1)
ALL = (AMBIENT, SUN, LAMP, SPOT)
MATT = Material(specular=(0.0, 0.0, 0.0))
CAMERA = Camera(position=(0.0, 2.2, 4.0), look_at=(0.0, 0.2, 0.0), fov=40.0)
SQUARE = np.array([[-0.5, 0, 0.5], [0.5, 0, 0.5], [0.5, 0, -0.5], [-0.5, 0, -0.5]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def plate(at: tuple[float, float, float], size: float, by: object = None, **fields: object) -> Mesh:
    """A level square at ``at``, which moves ``by`` over the shutter."""
    corners = size * SQUARE + at
    positions = corners if by is None else np.stack([corners, corners + np.asarray(by)])
    fields.setdefault("material", MATT)
    return Mesh(positions=positions, faces=FACES, **fields)


def scene(*meshes: Mesh, lights: tuple[Light, ...] = ALL, camera: Camera = CAMERA) -> Scene:
    return Scene(meshes=meshes, camera=camera, lights=lights, background=(0.2, 0.3, 0.4))


def turning(mesh: Mesh, degrees: float, **fields: object) -> Mesh:
    """The mesh, turned about an oblique axis while the shutter of frame 1 is open."""
    half = np.radians(degrees) / 2
    axis = np.array([0.3, 0.9, 0.2]) / np.linalg.norm([0.3, 0.9, 0.2])
    ends = [[0.0, 0, 0, 1], [*(np.sin(half) * axis), np.cos(half)]]
    track = Track([0.75, 1.25], ends, quaternion=True)
    return replace(mesh, transform=Transform(rotation=track, translation=(0, 0.6, 0)), **fields)


def solid(kind: str, **fields: object) -> Mesh:
    made = box((0.9, 0.9, 0.9)) if kind == "box" else sphere(0.6, 12)
    return Mesh(positions=made.positions, faces=made.faces, normals=made.normals, **fields)


CASES: dict[str, Callable[[], Scene]] = {
    "moving caster on static receiver": lambda: scene(
        plate((0, 0, 0), 4.0), plate((-0.6, 0.9, 0), 0.8, (1.1, 0.2, 0.3))
    ),
    "static caster on moving receiver": lambda: scene(
        plate((-0.4, 0, 0), 2.0, (0.7, 0.25, 0)), plate((0, 0.9, 0), 0.8)
    ),
    "both": lambda: scene(
        plate((-0.3, 0, 0), 2.0, (0.5, 0.2, 0.2)), plate((0.5, 0.9, 0), 0.7, (-1.0, -0.2, 0))
    ),
    "static on static": lambda: scene(plate((0, 0, 0), 4.0), plate((0, 0.9, 0), 0.8)),
    "a turning box shades itself and the floor": lambda: scene(
        plate((0, 0, 0), 4.0), turning(solid("box", material=MATT), 40.0, motion_segments=3)
    ),
    "a turning sphere with smooth normals": lambda: scene(
        plate((0, -0.1, 0), 4.0), turning(solid("sphere", material=MATT), 60.0, motion_segments=2)
    ),
    "a camera that turns and moves": lambda: scene(
        plate((0, 0, 0), 4.0),
        plate((-0.5, 0.9, 0), 0.8, (1.0, 0.1, 0.2)),
        camera=replace(
            CAMERA, position=Track([0.75, 1.25], [[0.0, 2.2, 4.0], [0.3, 2.3, 3.9]])
        ),
    ),
    "casters behind the light and around it": lambda: scene(
        plate((0, 0, 0), 4.0),
        plate((0.3, 3.4, 0.4), 2.0, (0.4, 0, 0)),
        plate((0.3, 2.4, 0.4), 0.2, (0.5, 0.3, 0.1)),
        lights=(AMBIENT, LAMP),
    ),
}  # fmt: skip
