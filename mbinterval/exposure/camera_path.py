"""The camera over the shutter, cut into segments that everything seen through it shares.

Between two knots the map from the world to homogeneous pixels is linear in time: P(s) =
(1 - s) P0 + s P1. While the determinant of its left part A keeps its sign, each P(s) is one true
pinhole camera at -A^-1 b, so what rests is never seen through what rests, at any error. What has
to be bounded is where that camera sees things: on screen, all that is in frame, from the nearest
surface to infinity; the place of the eye, in footprints of a pixel at that surface; and the circle
of confusion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mbinterval.exposure.asked import Asked
from mbinterval.exposure.knots import Followed, choose_knots
from mbinterval.exposure.looks import Looked, finer, look_times
from mbinterval.exposure.poses import CameraPoses, camera_poses
from mbinterval.exposure.shutter_times import Stretch, Window, stretches
from mbinterval.scene.camera import Camera
from mbinterval.scene.transforms import links_of

Float64 = NDArray[np.float64]

_GRID = np.linspace(-0.5, 0.5, 5)
"""Places in the frame, in its sizes, at which the camera's deviation is measured."""
_MOST_TURN = np.radians(60.0)
"""By which the camera may turn in one segment."""
_LOOKS = 9
"""Samples at least, of a camera that moves."""


@dataclass(frozen=True, eq=False)
class View:
    """The camera over the shutter, for an image of ``aspect`` and ``height`` pixels."""

    camera: Camera
    window: Window
    aspect: float
    height: int

    def poses(self, times: Float64) -> CameraPoses:
        """Poses at ``times`` of the shutter."""
        return camera_poses(self.camera, self.window.frames(times), self.aspect)

    def pixels(self, positions: Float64, times: Float64) -> Float64:
        """World positions ``(T, n, 3)`` at ``times`` (T,) in homogeneous pixels (x w, y w, w)."""
        poses = self.poses(times)
        seen = (positions - poses.eye[:, None]) @ poses.view.mT
        x, y, w = self.height * seen[..., 0], -self.height * seen[..., 1], -seen[..., 2]
        size = 0.5 * self.height * np.array([self.aspect, 1.0])
        return np.stack([x + size[0] * w, y + size[1] * w, w], axis=-1)


@dataclass(frozen=True, eq=False)
class Chords:
    """The camera's map in one stretch of the shutter, linear between ``knots`` (K+1,).

    ``view`` ``(K+1, 3, 3)``; ``offset`` ``(K+1, 3)`` is where the map takes ``origin``; ``lens``
    ``(K+1, 2)`` are the factors of w and of 1 in the circle of confusion, over the image's height.
    """

    stretch: Stretch
    knots: Float64
    origin: Float64
    view: Float64
    offset: Float64
    lens: Float64

    def at(self, times: Float64) -> CameraPoses:
        """Poses of the cameras on the chords at ``times`` (T,)."""
        key = np.clip(np.searchsorted(self.knots, times, side="right") - 1, 0, len(self.knots) - 2)
        share = (times - self.knots[key]) / (self.knots[key + 1] - self.knots[key])
        share = np.clip(share, 0.0, 1.0)

        def lerp(values: Float64) -> Float64:
            part = share.reshape(-1, *(1,) * (values.ndim - 1))
            return np.asarray((1.0 - part) * values[key] + part * values[key + 1])

        view, lens = lerp(self.view), lerp(self.lens)
        eye = self.origin - np.linalg.solve(view, lerp(self.offset)[..., None])[..., 0]
        focal = np.linalg.norm(view[:, 0], axis=1)
        wide = lens[:, 1] < 0.0
        focus = np.where(wide, -lens[:, 1] / np.where(lens[:, 0] > 0.0, lens[:, 0], 1.0), 1.0)
        return CameraPoses(eye, view, np.where(wide, -lens[:, 1] / focal, 0.0), focus)


def chords(poses: CameraPoses, knots: Float64, stretch: Stretch) -> Chords:
    """The camera's map through ``poses`` at ``knots``."""
    origin = poses.eye[0]
    offset = -(poses.view @ (poses.eye - origin)[..., None])[..., 0]
    wide = poses.aperture * poses.focal
    lens = np.stack([wide / poses.focus, -wide], axis=1)
    return Chords(stretch, knots, origin, poses.view, offset, lens)


@dataclass(frozen=True, eq=False)
class CameraPath:
    """The camera over the whole shutter, a `Chords` for each stretch without a cut.

    ``deviation`` is the greatest that the chords leave, in pixels.
    """

    parts: tuple[Chords, ...]
    moves: bool
    deviation: float = 0.0

    @cached_property
    def opening(self) -> CameraPoses:
        """The camera as the shutter opens, T = 1."""
        return self.at(np.zeros(1), Stretch())

    @property
    def ends(self) -> tuple[CameraPoses, CameraPoses]:
        """The camera as the shutter opens and as it closes, T = 1 each."""
        return self.opening, self.parts[-1].at(np.ones(1))

    @property
    def cuts(self) -> tuple[float, ...]:
        """Times of the shutter at which it may jump."""
        return tuple(part.stretch.open for part in self.parts[1:])

    def knots(self, within: Stretch) -> Float64:
        """Its knots inside ``within``, without the ends; none where it stays."""
        knots = self.part(within).knots
        return knots[(knots > within.open) & (knots < within.close)]

    @property
    def lens(self) -> Float64:
        """Radii of the lens at all knots, as fractions of what is seen at its focal length."""
        return np.concatenate([-part.lens[:, 1] for part in self.parts])

    @property
    def eyes(self) -> Float64:
        """``(n, 3)``: where the eye is at all knots."""
        return np.concatenate([part.at(part.knots).eye for part in self.parts])

    def part(self, within: Stretch) -> Chords:
        """The chords of the stretch that ``within`` lies in; the first for the whole shutter."""
        middle = 0.5 * (within.open + within.close) if within != Stretch() else 0.0
        return next((p for p in self.parts if middle < p.stretch.close), self.parts[-1])

    def at(self, times: Float64, within: Stretch) -> CameraPoses:
        """Poses of the cameras on the chords at ``times`` (T,) in a stretch ``within`` one part."""
        return self.part(within).at(times)


def camera_path(view: View, nearest: float, asked: Asked, levels: int) -> CameraPath:
    """Cut the camera's motion, as ``asked``: the first of so many ``levels`` that errors add up in.

    ``nearest`` is how near to the eye anything in frame comes.
    """
    if not moves(view):
        poses = view.poses(np.zeros(1))
        still = CameraPoses(*(np.repeat(a, 2, axis=0) for a in vars(poses).values()))
        return CameraPath((chords(still, np.arange(2.0), Stretch()),), moves=False)
    parts, worst = [], 0.0
    for stretch in stretches(view.window.times_of(view.camera.jumps), [(0.0, 1.0)]):
        if asked.segments is not None:
            knots = stretch.ends(asked.segments).astype(np.float32).astype(np.float64)
        else:
            looks = _samples(view, stretch, asked.moments)
            knots, left = _choose(view, stretch, looks, nearest, asked, levels)
            worst = max(worst, left)
        poses = view.poses(stretch.inside(knots, view.window))
        parts.append(chords(poses, knots, stretch))
    return CameraPath(tuple(parts), True, worst)


def moves(view: View) -> bool:
    """Whether the camera moves while the shutter is open."""
    if not view.camera.animated or view.window.instant:
        return False
    times, _ = _samples(view, Stretch())
    jumps = view.window.times_of(view.camera.jumps)
    return view.poses(np.append(times, jumps)).moves


def _samples(
    view: View, stretch: Stretch, moments: tuple[float, ...] = ()
) -> tuple[Float64, NDArray[np.bool_]]:
    """Times in the stretch at which to look at the camera, and which of them are keys."""
    links = [link for link in links_of(view.camera.transform) if link.source is not None]
    movers: list[Looked] = [*links, *view.camera.tracks]
    return look_times(view.window, stretch, movers, 1.0, (), moments, _LOOKS)


def _choose(
    view: View,
    stretch: Stretch,
    looks: tuple[Float64, NDArray[np.bool_]],
    nearest: float,
    asked: Asked,
    levels: int,
) -> tuple[Float64, float]:
    """Choose knots among the times of ``looks``, or finer ones, and what deviation they leave."""
    limit = asked.error / levels
    times, corners = looks
    followed, every, poses = _followed(view, stretch, times, corners, nearest)
    fine = finer(times, followed.between(), limit)
    if len(fine) > len(times):
        corners, times = np.isin(fine, times[corners]), fine
        followed, every, poses = _followed(view, stretch, times, corners, nearest)
    turned = _turns(poses)

    def allowed(first: int, last: int) -> bool:
        return turned(first, last) and _invertible(every.view[first], every.view[last])

    wanted = np.flatnonzero(np.isin(times, asked.moments))
    chosen = choose_knots(followed, (0, len(times) - 1), wanted, limit, asked.most, allowed)
    return times[chosen.knots], chosen.deviation


def _followed(
    view: View, stretch: Stretch, times: Float64, corners: NDArray[np.bool_], nearest: float
) -> tuple[Followed, Chords, CameraPoses]:
    """The camera's map at ``times``, and the poses there."""
    poses = view.poses(stretch.inside(times, view.window))
    every = chords(poses, times, stretch)
    values = np.concatenate([every.view.reshape(-1, 9), every.offset, every.lens], axis=1)
    measure = _Seen(view, poses, every.origin, nearest)
    return Followed(times, values, corners, measure), every, poses


class _Seen:
    """Pixels that errors of the camera's map make, at points in frame, near and far."""

    def __init__(self, view: View, poses: CameraPoses, origin: Float64, nearest: float) -> None:
        self.height, self.nearest = view.height, nearest
        self.view, self.eye, self.focal = poses.view, poses.eye - origin, poses.focal
        x, y = (axis.ravel() for axis in np.meshgrid(_GRID * view.aspect, _GRID))
        self.seen = np.stack([x, y, -np.ones_like(x)], axis=1)  # (G, 3): what v is at w = 1
        self.rays = np.linalg.solve(self.view, self.seen.T).mT  # (S, G, 3) in the world

    def __call__(self, which: slice, errors: Float64) -> Float64:
        """See `knots.Measure`; errors are of ``view``, ``offset`` and ``lens``."""
        view, offset, lens = errors[:, :9].reshape(-1, 3, 3), errors[:, 9:12], errors[:, 12:]
        far = self.rays[which] @ view.mT
        at_eye = (view @ self.eye[which][..., None])[..., 0] + offset
        near = far + at_eye[:, None] / self.nearest
        places = [self._on_screen(part) for part in (far, near)]
        moved = np.linalg.solve(self.view[which], at_eye[..., None])[..., 0]
        eye = np.linalg.norm(moved, axis=1) * self.focal[which] / self.nearest
        blur = np.abs(lens[:, :1] + lens[:, 1:] * [0.0, 1.0 / self.nearest]).max(axis=1)
        return np.asarray(self.height * np.max([*places, eye, blur], axis=0))

    def _on_screen(self, errors: Float64) -> Float64:
        """Distance on screen, over the height, that errors ``(s, G, 3)`` of v make at w = 1."""
        away = errors[..., :2] + self.seen[:, :2] * errors[..., 2:]
        return np.asarray(np.linalg.norm(away, axis=2).max(axis=1))


def _turns(poses: CameraPoses) -> Callable[[int, int], bool]:
    """Whether the camera turns little enough from one sample to another."""
    axes = poses.rotation

    def little(first: int, last: int) -> bool:
        trace = np.sum(axes[first] * axes[last])
        return bool(trace >= 1.0 + 2.0 * np.cos(_MOST_TURN))

    return little


def _invertible(start: Float64, end: Float64) -> bool:
    """Whether the determinant of what is linear from ``start`` to ``end`` keeps its sign.

    It is a cubic; its Bernstein coefficients are mixed determinants of the rows.
    """
    rows = np.stack([start, end])
    mixed = np.array([
        np.linalg.det(rows[[i, j, k], [0, 1, 2]]) for i in (0, 1) for j in (0, 1) for k in (0, 1)
    ])  # fmt: skip
    order = np.array([i + j + k for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    bernstein = np.array([mixed[order == n].mean() for n in range(4)])
    return bool((bernstein > 0.0).all() or (bernstein < 0.0).all())
