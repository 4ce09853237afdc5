"""Small scenes of what must stay stable: shared edges, slivers, the near plane, the eye."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mbinterval.scene.model import Camera, Mesh, Scene
from support.closed_forms import FACES, UNIT_CAMERA, rectangle, world

SIZE = (48, 32)
FAR = np.array([148376.0, 1234.0, -223423.0])
BACKGROUND = (0.2, 0.3, 0.4)
COLORS = np.random.default_rng(9).uniform(0.1, 1.0, (8192, 3))


def mesh(pixels: object, w: object = None, faces: object = None, shift: int = 0) -> Mesh:
    """Triangles ``(2, n, 3, 2)`` in pixels, each at its own depth, or a mesh of shared vertices."""
    pixels = np.asarray(pixels, dtype=float)
    w = 1.5 + 0.02 * np.arange(pixels.shape[1])[:, None] if w is None else w
    positions = world(pixels, w, SIZE).reshape(len(pixels), -1, 3)
    faces = np.arange(positions.shape[1]).reshape(-1, 3) if faces is None else np.asarray(faces)
    colors = COLORS[shift : shift + len(faces)]
    return Mesh(positions=positions, faces=faces, color=colors, color_domain="face",
                shading="unlit")  # fmt: skip


def scene(*meshes: Mesh, camera: Camera = UNIT_CAMERA) -> Scene:
    return Scene(meshes=meshes, camera=camera, background=BACKGROUND)


def random_triangles(seed: int, count: int, spread: float = 8.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform((0, 0), SIZE, (2, count, 1, 2)) + rng.normal(0, spread, (2, count, 3, 2))


def shared_edges(place: np.ndarray) -> Scene:
    """A sheet that deforms without a fold."""
    rng = np.random.default_rng(1)
    x, y = (c.ravel() for c in np.meshgrid(np.arange(-8, 60, 4.0), np.arange(-8, 44, 4.0)))
    ends = np.stack([x, y], -1) + rng.uniform(-0.9, 0.9, (2, len(x), 2))
    corner = np.arange(len(x)).reshape(13, 17)[:-1, :-1].ravel()
    low = corner + 17
    faces = np.concatenate([np.stack([corner, low, corner + 1], 1),
                            np.stack([corner + 1, low, low + 1], 1)])  # fmt: skip
    sheet = mesh(ends, 2.0, faces)
    sheet = replace(sheet, positions=sheet.positions + place)
    return scene(sheet, camera=replace(UNIT_CAMERA, position=tuple(place)))


def pivoting() -> Scene:
    points = random_triangles(2, 12, 12.0)
    points[1, :, 0] = points[0, :, 0]
    points[1, :4, 1] = points[0, :4, 1]
    return scene(mesh(points))


def turning_over(times: int) -> Scene:
    """Front to back: once through a line, or twice where the area's sign changes twice."""
    if times == 1:
        points = random_triangles(3, 8, 9.0)
        middle = points[0].mean(axis=1, keepdims=True)
        points[1] = 2 * middle - points[0][:, [1, 0, 2]] * [1, 0.3] - middle * [0, 0.7]
        return scene(mesh(points))
    rng, found = np.random.default_rng(4), []
    while len(found) < 8:
        ends = rng.normal(0, 9, (2, 3, 2))
        t = np.linspace(0, 1, 101)[:, None, None]
        now = (1 - t) * ends[0] + t * ends[1]
        (ux, uy), (vx, vy) = (now[:, 1] - now[:, 0]).T, (now[:, 2] - now[:, 0]).T
        signs = np.sign(ux * vy - uy * vx)
        if np.count_nonzero(np.diff(signs)) == 2:
            found.append(ends + rng.uniform(8, 28, 2))
    return scene(mesh(np.stack(found, axis=1)))


def crossing_edges() -> Scene:
    """Triangles whose moved edges cross where they were."""
    points = random_triangles(5, 10, 8.0)
    turn = np.array([[0.3, -0.95], [0.95, 0.3]])
    middle = points[0].mean(axis=1, keepdims=True)
    points[1] = (points[0] - middle) @ turn + middle
    return scene(mesh(points))


def through_the_camera_plane(low: float, high: float) -> Scene:
    """w from below zero to above it, at each end of the shutter or at both."""
    rng = np.random.default_rng(6)
    w = rng.uniform(low, high, (2, 16, 3))
    return scene(mesh(random_triangles(6, 16), w))


def through_the_eye() -> Scene:
    """A big triangle from before to behind the eye, and the other way round."""
    corners = np.array([[-3.0, -2.0], [4.0, -2.5], [0.5, 4.0]])
    ends = [[np.c_[corners, np.full(3, z)] for z in (s, -0.7 * s)] for s in (1.0, -1.0)]
    looks = {"faces": [[0, 1, 2]], "color_domain": "face", "shading": "unlit"}
    return scene(
        *(Mesh(positions=np.array(e), color=COLORS[i : i + 1], **looks) for i, e in enumerate(ends))
    )


def hardly_moving(step: float) -> Scene:
    points = random_triangles(7, 12)
    points[1] = points[0] + np.random.default_rng(7).normal(0, step, points[0].shape)
    if step == 0.0:
        points[1, 0] += 30.0  # one moves, so that the mesh has motion paths
    return scene(mesh(points))


def degenerate() -> Scene:
    """Points, segments, repeated vertices, among triangles."""
    points = random_triangles(8, 16)
    points[:, 0:4, 1] = points[:, 0:4, 0]
    points[:, 4:6, 1:] = points[:, 4:6, :1]
    points[:, 6:8, 2] = 0.5 * (points[:, 6:8, 0] + points[:, 6:8, 1])
    points[:, 8] = np.rint(points[:, 8]) + 0.5
    points[:, 8, 1:] = points[:, 8, :1]  # a point that passes over samples
    points[1, 9:11, 1] = points[1, 9:11, 0]
    return scene(mesh(points))


def needles() -> Scene:
    points = random_triangles(9, 60, 20.0)
    wide = 10.0 ** np.random.default_rng(9).uniform(-6, -0.5, (1, 60, 1))
    part = np.random.default_rng(10).uniform(0, 1, (1, 60, 1))
    points[:, :, 2] = points[:, :, 0] * part + points[:, :, 1] * (1 - part) + wide
    return scene(mesh(points))


def small_and_fast() -> Scene:
    rng = np.random.default_rng(11)
    middle = rng.uniform((-300, 0), (0, 32), (400, 1, 2))
    speed = rng.uniform((300, -60), (600, 60), (400, 1, 2))
    corners = rng.normal(0, 0.4, (400, 3, 2))
    return scene(mesh(np.stack([middle + corners, middle + speed + corners])))


def order_swaps(times: int) -> Scene:
    """Slabs of which the nearer one changes: once, or twice by two motions of different speed."""
    whole = np.stack([rectangle(-90, 140, -90, 120)] * 2)
    still = mesh(whole + np.array([1.0, 0])[None] * [[[0]], [[1]]], 2.0, FACES)
    if times == 1:
        return scene(still, mesh(whole, np.array([[1.0], [3.0]]), FACES, 4))
    # Turned about the vertical axis, its middle passes before the other and behind it again.
    tilted = np.array([[1.9, 2.02, 2.02, 1.9], [2.3, 1.85, 1.85, 2.3]])
    bent = mesh(np.stack([rectangle(0, 48, -9, 41), rectangle(-40, 50, -9, 41)]), tilted, FACES, 4)
    return scene(still, bent)


def interpenetrating() -> Scene:
    rng = np.random.default_rng(12)
    points = random_triangles(12, 24, 14.0)
    return scene(mesh(points, rng.uniform(1.0, 3.0, (2, 24, 3))))


def tangential() -> Scene:
    """Turning edges whose lines touch pixel centres, exactly or to 1e-9 pixels."""
    rng, found = np.random.default_rng(13), []
    while len(found) < 60:
        ends = rng.normal(0, 9, (2, 3, 2))
        t = rng.uniform(0.3, 0.7)
        now, rate = (1 - t) * ends[0] + t * ends[1], ends[1] - ends[0]
        a, b = (np.append(v, 1.0) for v in now[:2])
        line = np.cross(a, b)
        slope = np.cross(np.append(rate[0], 0), b) + np.cross(a, np.append(rate[1], 0))
        touch = np.cross(line, slope)
        touch = touch[:2] / touch[2]
        if np.abs(touch).max() < 10:
            centre = np.floor(rng.uniform((8, 8), (40, 24))) + 0.5
            found.append(ends - touch + centre + rng.normal(0, 1e-9, 2) * rng.integers(0, 2))
    return scene(mesh(np.stack(found, axis=1)))


def scaled(scale: float) -> Scene:
    whole = interpenetrating()
    meshes = [replace(m, positions=m.positions * scale) for m in whole.meshes]
    return replace(whole, meshes=meshes)


def crowded() -> Scene:
    """More than a thousand intervals on each of some samples."""
    rng = np.random.default_rng(14)
    points = rng.uniform((20, 12), (28, 20), (2, 1500, 1, 2)) + rng.normal(0, 60, (2, 1500, 3, 2))
    return scene(mesh(points, 1.0 + np.arange(1500)[:, None] / 700))


def swinging() -> Scene:
    """Half a turn in eight segments: the way leaves the hull of its ends."""
    angle = np.linspace(0, np.pi, 9)[:, None]
    arm = np.array([[12.0, -4.0], [22.0, 0.0], [12.0, 5.0]])
    turn = np.stack([np.cos(angle), np.sin(angle), -np.sin(angle), np.cos(angle)], -1)
    points = np.einsum("kij,vj->kvi", turn.reshape(9, 2, 2), arm) + [24, 26]
    return scene(mesh(points[:, None]))


@dataclass(frozen=True)
class Case:
    """A scene, the RMS error of triangulated paths, and the part of the frame that is compared."""

    make: Callable[[], Scene]
    split: float
    crop: tuple[int, int, int, int] = (0, 0, *SIZE)


CASES = {
    "shared edges": Case(lambda: shared_edges(np.zeros(3)), 0.016),
    "shared edges far from the origin": Case(lambda: shared_edges(FAR), 0.016),
    "pivoting edges": Case(pivoting, 0.045),
    "front to back": Case(lambda: turning_over(1), 0.052),
    "front to back and back again": Case(lambda: turning_over(2), 0.048),
    "edges that cross on screen": Case(crossing_edges, 0.068),
    "through the camera plane": Case(lambda: through_the_camera_plane(-1.0, 2.0), 0.083),
    "near the camera plane": Case(lambda: through_the_camera_plane(1e-6, 2.0), 0.086),
    "through the eye": Case(through_the_eye, 0.0),
    "zero motion": Case(lambda: hardly_moving(0.0), 0.0),
    "nearly zero motion": Case(lambda: hardly_moving(1e-9), 0.0),
    "small motion": Case(lambda: hardly_moving(1e-3), 0.0),
    "degenerate triangles": Case(degenerate, 0.07),
    "needles": Case(needles, 0.16),
    "sub-pixel triangles that move hundreds of pixels": Case(small_and_fast, 0.0),
    "order that swaps once": Case(lambda: order_swaps(1), 0.0),
    "order that swaps twice": Case(lambda: order_swaps(2), 0.076),
    "interpenetrating meshes": Case(interpenetrating, 0.061),
    "tangential roots": Case(tangential, 0.06),
    "huge scale": Case(lambda: scaled(1e18), 0.061),
    "tiny scale": Case(lambda: scaled(1e-18), 0.061),
    "a thousand intervals on a pixel": Case(crowded, 0.018, (23, 15, 2, 1)),
    "a way that leaves the hull of its ends": Case(swinging, 0.0039),
}
