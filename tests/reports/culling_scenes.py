"""Scenes in place of those of the papers on sample culling.

A city of boxes under a moving camera (large triangles, some tens of pixels), a crowd of finely
tessellated spheres that fly (triangles below a pixel), a disc with a texture that moves and turns,
and a floor and a wall with textures, out of focus. The camera is at the origin and looks along -Z;
its focal length is the image's height.
"""

from __future__ import annotations

from functools import cache

import numpy as np

import mbinterval as mb

ROWS = ("none", "motion", "motion x2", "defocus", "defocus x2", "both", "both x2")
_AMOUNTS = dict(zip(ROWS, ((0, 0), (1, 0), (2, 0), (0, 1), (0, 2), (1, 1), (2, 2)), strict=True))
_AMOUNTS["both x4"] = (4, 4)
_FOCUS = 6.0


def _city(motion: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Boxes on a grid; the camera moves sideways and forwards, so everything does."""
    rng = np.random.default_rng(3)
    corners = np.array(np.meshgrid([-1, 1], [0, 1], [-1, 1], indexing="ij"), float).reshape(3, 8).T
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    points, triangles = [], []
    for x in range(-9, 10):
        for z in range(1, 24):
            size = np.array([0.35, rng.uniform(0.3, 3.0), 0.35])
            triangles.append(faces + 8 * len(points))
            points.append(corners * size + [1.2 * x, -1.0, -1.2 * z - 2.0])
    start = np.concatenate(points)
    return start, start + np.array([0.10, 0.0, 0.18]) * motion, np.concatenate(triangles)


def _crowd(motion: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Spheres of 5,120 small triangles each, each flying its own way."""
    import trimesh

    rng = np.random.default_rng(4)
    ball = trimesh.creation.icosphere(subdivisions=4)
    starts, ends, triangles = [], [], []
    for k in range(10):
        at = rng.uniform((-2.6, -1.4, -9.0), (2.6, 1.4, -4.0))
        triangles.append(ball.faces + len(ball.vertices) * k)
        starts.append(0.35 * ball.vertices + at)
        ends.append(starts[-1] + motion * rng.normal(0, 0.12, 3))
    return np.concatenate(starts), np.concatenate(ends), np.concatenate(triangles)


SCENES = {"city": (_city, 7.0), "crowd": (_crowd, 10.0)}
"""What makes them, and how wide the lens is: focal length over f-stop, in millimetres over 24."""


def _camera(aperture: float) -> mb.Camera:
    lens = {"f_stop": 1.0 / aperture, "focus_distance": _FOCUS} if aperture else {}
    return mb.Camera(position=(0, 0, 0), focal_length=24.0, **lens)


@cache
def variant(name: str, row: str) -> mb.Scene:
    """``city`` or ``crowd`` with the effects of one of ``ROWS``, or with ``both x4``."""
    make, aperture = SCENES[name]
    motion, defocus = _AMOUNTS[row]
    start, end, faces = make(motion)
    colors = np.random.default_rng(5).uniform(0.2, 1.0, (len(faces), 3))
    positions = np.stack([start, end]) if motion else start
    mesh = mb.Mesh(
        positions=positions, faces=faces, color=colors, color_domain="face", shading="unlit"
    )
    camera = _camera(defocus * aperture)
    return mb.Scene(meshes=[mesh], camera=camera, background=(0.02, 0.02, 0.03))


@cache
def _poster(size: int) -> mb.Material:
    texture = mb.Texture(np.random.default_rng(6).uniform(0, 1, (size, size, 3)))
    return mb.Material("poster", texture=texture, shading="unlit")


_CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)
_QUAD = np.array([[0, 1, 2], [0, 2, 3]])
_APERTURE = 10.0


def disc(size: int, way: float, time: float | None = None) -> mb.Scene:
    """A wheel of 64 sectors that moves and turns; at one time of the shutter, or all of it.

    ``size`` is its texture's width and height, ``way`` how far it goes: at 1 three tenths of the
    picture's height, and a quarter of a radian.
    """
    angles = np.linspace(0, 2 * np.pi, 65)
    rim = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    flat = np.concatenate([np.zeros((1, 2)), rim])
    faces = np.array([[0, k, k + 1] for k in range(1, 65)])
    angle = 0.25 * way
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    ends = np.stack([flat * 0.9 - [0.3 * way, 0.0], flat @ turn.T * 0.9 + [0.3 * way, 0.0]])
    positions = np.concatenate([ends, np.full((*ends.shape[:2], 1), -2.0)], axis=-1)
    if time is not None:
        positions = positions[0] + time * (positions[1] - positions[0])
    mesh = mb.Mesh(positions=positions, faces=faces, uv=0.5 + 0.5 * flat, material=_poster(size))
    return mb.Scene(meshes=[mesh], camera=_camera(0.0))


def floor(size: int, lens: tuple[float, float] | None = None) -> mb.Scene:
    """A floor and a wall through a lens; or sharp, seen from one of its points in [-1, 1]."""
    ground = np.stack([2.0 * _CORNERS[:, 0], np.full(4, -0.8), 2.0 * _CORNERS[:, 1] - 4.5], axis=1)
    wall = np.stack([2.0 * _CORNERS[:, 0], _CORNERS[:, 1] + 0.3, np.full(4, -3.5)], axis=1)
    uv = 0.5 + 0.5 * _CORNERS
    meshes = []
    for points in (ground, wall):
        if lens is not None:
            # Seen from beside the lens's middle, what is in focus stays where it is.
            offset = np.array([*lens, 0.0]) * (0.5 * 0.024 * _APERTURE)
            points = points - offset * (1.0 + points[:, 2:] / _FOCUS)
        meshes.append(mb.Mesh(positions=points, faces=_QUAD, uv=uv, material=_poster(size)))
    return mb.Scene(meshes=meshes, camera=_camera(_APERTURE if lens is None else 0.0))


def slices_of(name: str, size: int, way: float = 1.0) -> list[mb.Scene]:
    """What an accumulation buffer of four passes shows of ``disc`` or ``floor``, pass by pass."""
    if name == "disc":
        return [disc(size, way, (k + 0.5) / 4) for k in range(4)]
    return [floor(size, point) for point in ((-0.5, -0.2), (0.2, -0.5), (0.5, 0.2), (-0.2, 0.5))]
