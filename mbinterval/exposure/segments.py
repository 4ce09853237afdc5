"""How many linear motion segments a mesh needs, so that its path on screen follows its motion.

Between the ends of a motion segment a vertex moves linearly in homogeneous pixel space. The *path
error* is how far that is, in pixels, from where the vertex is at the same time. It is measured in
the middle of each segment, where a smooth motion is farthest from its chord, and at probes spread
unevenly over the shutter, which see turns that the middles would take for rest. Segments are
doubled until the error is small enough; since it falls with the square of their number, a number
between the last two is tried then.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.exposure.mesh_exposure import mesh_times, world_positions
from mbinterval.exposure.poses import CameraPoses, camera_poses
from mbinterval.exposure.shutter_times import WHOLE, Stretch, Window
from mbinterval.scene.camera import Camera
from mbinterval.scene.model import Mesh

Float64 = NDArray[np.float64]
Places = NDArray[np.integer[Any]]

MOST_SEGMENTS = 128
"""More are never chosen for a stretch of the shutter, only asked for."""

PROBES = np.array([0.0573, 0.125, 0.25, 0.2871, 0.375, 0.5, 0.618, 0.625, 0.75, 0.8431, 0.875])
"""Parts of a stretch at which its path is always compared with the motion."""

_SHARE = 0.9
"""Of the error that is allowed, for what lies between the places and times that are looked at."""
_POINTS = 4096
"""Points of a mesh that are looked at, at most."""
BORDER = 0.5
"""How far beyond the frame, in its sizes, the error counts: parts of what is there may be seen."""


@dataclass(frozen=True)
class Choice:
    """A number of segments, why, and the path error in pixels where it was measured."""

    segments: int
    reason: str
    error: float | None = None


@dataclass(frozen=True, eq=False)
class View:
    """The camera over the shutter, for an image of ``aspect`` and ``height`` pixels."""

    camera: Camera
    window: Window
    aspect: float
    height: int
    _known: dict[float, CameraPoses] = field(default_factory=dict)

    @cached_property
    def moves(self) -> bool:
        """Whether the camera moves while the shutter is open."""
        times = np.append(PROBES, [0.0, 1.0])
        return self.camera.animated and self.poses(times).moves

    def poses(self, times: Float64) -> CameraPoses:
        """Poses at ``times`` of the shutter."""
        return camera_poses(self.camera, self.window.frames(times), self.aspect)

    def pixels(self, positions: Float64, times: Float64) -> Float64:
        """World positions ``(T, n, 3)`` at ``times`` (T,) in homogeneous pixels (x w, y w, w)."""
        for time in map(float, times):
            if time not in self._known:
                self._known[time] = self.poses(np.array([time]))
        poses = [self._known[time] for time in map(float, times)]
        eye, rotation, focal = (
            np.concatenate([getattr(pose, name) for pose in poses])
            for name in ("eye", "rotation", "focal")
        )
        seen = (positions - eye[:, None]) @ rotation.mT
        scale = focal[:, None] * self.height
        x, y, w = scale * seen[..., 0], -scale * seen[..., 1], -seen[..., 2]
        size = 0.5 * self.height * np.array([self.aspect, 1.0])
        return np.stack([x + size[0] * w, y + size[1] * w, w], axis=-1)


def choose_segments(mesh: Mesh, view: View, stretch: Stretch, motion_error: float) -> Choice:
    """Choose the segments of ``mesh`` over ``stretch`` for a path error of ``motion_error`` pixels.

    Positions per time keep their times: the number is a multiple of theirs.
    """
    given = max(mesh.times - 1, 1)
    straight = stretch == WHOLE or given == 1
    if straight and not (view.moves or mesh.animated) and mesh.own_shutter in (0.0, 1.0):
        return Choice(given, "its positions per time" if mesh.times > 1 else "")
    path = _Path(mesh, view, stretch)
    limit = _SHARE * motion_error
    first = last = path.error(given)
    before, segments = given, given
    while last > limit and 2 * segments <= MOST_SEGMENTS:
        before, previous, segments = segments, last, 2 * segments
        last = path.error(segments)
    if segments > given and last <= limit:
        wanted = given * int(np.ceil(before * np.sqrt(previous / limit) / given))
        if before < wanted < segments and (error := path.error(wanted)) <= limit:
            segments, last = wanted, error
    reason = f"path error {last:.2g} px"
    if segments > given:
        reason += f", {first:.2g} px with {given}"
    if last > limit:
        reason += f"; motion_error asks for more than {segments}"
    return Choice(segments, reason, last)


class _Path:
    """Points of a mesh over a stretch of the shutter, in homogeneous pixels, as they are needed."""

    def __init__(self, mesh: Mesh, view: View, stretch: Stretch) -> None:
        self.mesh, self.view, self.stretch = mesh, view, stretch
        self.size = np.array([view.aspect, 1.0]) * view.height
        self.vertices = _some_vertices(mesh)
        self.known: dict[float, Float64] = {}
        self.inner: tuple[Places, Float64] | None = None
        if not self._in_sight():
            self.inner = _inner_points(mesh, self.vertices)

    def _in_sight(self) -> bool:
        """Whether all vertices are seen, or nearly, whenever it is probed."""
        points = self.at(PROBES)
        if not (points[..., 2] > 0.0).all():
            return False
        places = points[..., :2] / points[..., 2:]
        return bool(_near_frame(places, self.size).all())

    def at(self, parts: Float64) -> Float64:
        """``(T, n, 3)`` true places at ``parts`` (T,) of the stretch."""
        missing = np.array([part for part in parts if float(part) not in self.known])
        if len(missing):
            window = self.view.window
            times = self.stretch.inside(self.stretch.at(missing), window)
            own = mesh_times(self.mesh, window, times)
            points = world_positions(self.mesh, window, own, self.vertices)
            pixels = self.view.pixels(points, times)
            self.known |= dict(zip(map(float, missing), pixels, strict=True))
        found = np.array([self.known[float(part)] for part in parts])
        if self.inner is None:
            return found
        corners, shares = self.inner
        return np.asarray(np.einsum("pc,tpcx->tpx", shares, found[:, corners]))

    def error(self, segments: int) -> float:
        """Path error in pixels with so many segments."""
        ends = np.arange(segments + 1) / segments
        middles = (np.arange(segments) + 0.5) / segments
        parts = np.setdiff1d(np.append(PROBES, middles), ends)
        key = np.minimum((parts * segments).astype(int), segments - 1)
        share = (parts * segments - key)[:, None, None]
        places = self.at(ends)
        path = (1.0 - share) * places[key] + share * places[key + 1]
        return _deviation(self.at(parts), path, self.size)


def _some_vertices(mesh: Mesh) -> Places:
    """Vertices of faces: all, or of very many some thousands with the outermost ones."""
    used = np.unique(mesh.faces)
    if len(used) <= _POINTS:
        return used
    rest = mesh.positions[0] if mesh.positions.ndim == 3 else mesh.positions
    ways = np.array(list(np.ndindex(3, 3, 3))) - 1.0
    extremes = used[np.argmax(rest[used] @ ways.T, axis=0)]
    spread = used[np.linspace(0, len(used) - 1, _POINTS).astype(int)]
    return np.union1d(extremes, spread)


def _inner_points(mesh: Mesh, vertices: Places) -> tuple[Places, Float64] | None:
    """Points spread over the faces of a mesh that has few, since the middle of one may be seen.

    Corners ``(P, 3)``, places among ``vertices``, and barycentric coordinates ``(P, 3)``.
    """
    steps = 1
    while len(mesh.faces) * (steps + 2) * (steps + 3) // 2 <= _POINTS // 2:
        steps += 1
    if steps == 1:
        return None
    grid = [(i, j, steps - i - j) for i in range(steps + 1) for j in range(steps + 1 - i)]
    corners = np.repeat(np.searchsorted(vertices, mesh.faces), len(grid), axis=0)
    return corners, np.tile(np.array(grid) / steps, (len(mesh.faces), 1))


def _near_frame(places: Float64, size: Float64) -> NDArray[np.bool_]:
    """Which of ``places`` ``(..., 2)`` in pixels are in the frame or its surroundings."""
    inside = (places > -BORDER * size) & (places < (1.0 + BORDER) * size)
    return np.asarray(inside.all(axis=-1))


def _deviation(true: Float64, path: Float64, size: Float64) -> float:
    """Greatest distance on screen in pixels between places in homogeneous pixels ``(..., 3)``."""
    ahead = (true[..., 2] > 0.0) & (path[..., 2] > 0.0)
    a, b = (points[ahead][:, :2] / points[ahead][:, 2:] for points in (true, path))
    seen = _near_frame(a, size) | _near_frame(b, size)
    return float(np.linalg.norm(a[seen] - b[seen], axis=1).max(initial=0.0))
