"""What moves meshes: the sources of motion of a scene, each cut once for all that hangs on it.

A *source* is an animation with its time mapping: a node's own motion, the skeleton of a skin, an
instancer, a mesh's own deformation. It is cut on top of the *cut* motion of what it hangs on,
and has knots wherever that has some, and the camera too; so whatever hangs on one source moves by
the same chords, however it is cut into meshes, and stays in order. Its deviation is measured
against its own true motion on top of its parents' chords, as far as these and the camera's lead
it, in all directions of space, in footprints of a pixel: so the products of chords that lie on one
another are part of it, and what the parents are off by is not. Each of n levels may add its n-th of
what is allowed in all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mbinterval.exposure.asked import Asked
from mbinterval.exposure.camera_path import CameraPath
from mbinterval.exposure.knots import Followed, choose_knots
from mbinterval.exposure.looks import finer, look_times
from mbinterval.exposure.shutter_times import Stretch, Window, stretches
from mbinterval.scene.transforms import Link, Mover, chain_matrices

Float64 = NDArray[np.float64]

_BORDER = 0.5
"""How far beyond the frame, in its sizes, deviation counts: parts of what is there may be seen."""
_POINTS = 512
"""Points that are followed for one source, at most, and `_NUMBERS` times and points together."""
_NUMBERS = 1 << 20
_LOOKS = 3

Follower = Callable[[Float64, Stretch], Float64]
"""World positions ``(T, n, 3)`` at times in a stretch: own motion on chords of what it is on."""


@dataclass(frozen=True, eq=False)
class Seeing:
    """Through what sources are seen: the camera's chords, and reflections ``(V, 4, 4)`` too."""

    camera: CameraPath
    aspect: float
    height: int
    mirrors: Float64

    def followed(self, times: Float64, points: Float64, within: Stretch) -> tuple[Float64, Float64]:
        """Values and scales, as `Followed` has them, of world ``points`` ``(T, n, 3)``."""
        poses = self.camera.at(times, within)
        images = [points, *(points @ m[:3, :3].T + m[:3, 3] for m in self.mirrors)]
        points = np.concatenate(images, axis=1)
        seen = (points - poses.eye[:, None]) @ poses.view.mT
        w = -seen[..., 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            across = np.abs(seen[..., :2]) / w[..., None]
        reach = (0.5 + _BORDER) * np.array([self.aspect, 1.0])
        inside = (w > 0.0) & (across < reach).all(axis=-1)
        pixels = np.where(inside, self.height / np.maximum(w, nearest_of(w[inside])), 0.0)
        deep = pixels * poses.focal[:, None]
        return seen, np.stack([pixels, pixels, deep], axis=-1)


@dataclass(frozen=True, eq=False)
class Part:
    """A stretch of a source: its knots ``(K+1,)``, and what its members are there."""

    stretch: Stretch
    knots: Float64
    matrices: Float64


@dataclass(eq=False)
class Source:
    """A source of motion; ``cut`` chooses its knots, parents before children.

    ``level`` is the number of sources from the root to it, ``deepest`` the greatest of any that
    hangs on it; ``fixed`` times are knots in any case. Its own shutter is ``scale`` times as long.
    ``tracked`` are points ``(n, 3)`` that members carry, ``followers`` other points.
    """

    window: Window
    parents: tuple[Source, ...]
    scale: float
    segments: int | None = None
    fixed: tuple[float, ...] = ()
    movers: dict[Mover, None] = field(default_factory=dict)
    jumps: set[float] = field(default_factory=set)
    members: dict[tuple[Place, tuple[Link, ...]], int] = field(default_factory=dict)
    tracked: list[tuple[int, Float64]] = field(default_factory=list)
    followers: list[Follower] = field(default_factory=list)
    parts: tuple[Part, ...] = ()
    deviation: float = 0.0
    level: int = 1
    deepest: int = 1

    def __post_init__(self) -> None:
        self.level += max((parent.level for parent in self.parents), default=0)
        self._deepen(self.level)

    @property
    def total(self) -> float:
        """Deviation of it and of all that it hangs on, in pixels."""
        return self.deviation + max((parent.total for parent in self.parents), default=0.0)

    def _deepen(self, level: int) -> None:
        self.deepest = max(level, self.deepest)
        for parent in self.parents:
            parent._deepen(level)

    def part(self, within: Stretch) -> Part:
        """The part that ``within`` lies in."""
        middle = 0.5 * (within.open + within.close)
        return next((p for p in self.parts if middle < p.stretch.close), self.parts[-1])

    def breaks(self, camera: CameraPath) -> set[float]:
        """Times at which it, what it hangs on, or the camera may jump."""
        found = set(self.window.times_of(self.jumps, self.scale))
        found.update(camera.cuts, *(parent.breaks(camera) for parent in self.parents))
        return found

    def cut(self, seeing: Seeing, asked: Asked) -> None:
        """Choose the knots of all stretches, and keep what is there."""
        camera, parts = seeing.camera, []
        for stretch in stretches(self.breaks(camera), [(0.0, 1.0)]):
            shared = np.union1d(camera.knots(stretch), knots_of(self.parents, stretch))
            fixed = np.asarray(self.fixed, np.float32).astype(np.float64)
            own = [time for time in fixed if stretch.open < time < stretch.close]
            segments = self.segments or asked.segments
            if segments is not None:
                own += list(stretch.knots(segments))
            if segments is None and not self.fixed:
                knots, left = self._choose(stretch, shared, seeing, asked)
                self.deviation = max(self.deviation, left)
            else:
                ends = (stretch.open, stretch.close)
                knots = np.unique(np.concatenate([shared, own, ends]))
            parts.append(Part(stretch, knots, self.true(knots, stretch)))
        self.parts = tuple(parts)

    def _choose(
        self, stretch: Stretch, shared: Float64, seeing: Seeing, asked: Asked
    ) -> tuple[Float64, float]:
        """Knots in one stretch, the shared ones among them, and the deviation that they leave."""
        times, corners = look_times(
            self.window, stretch, self.movers, self.scale, shared, asked.moments, _LOOKS
        )
        limit = asked.error / (self.deepest + seeing.camera.moves)
        followed = self._followed(times, corners, stretch, seeing)
        between = followed.between()
        fine = finer(times, between, limit)
        if len(fine) > len(times):
            corners = np.isin(fine, times[corners])
            followed, times = self._followed(fine, corners, stretch, seeing), fine
        fixed = np.searchsorted(times, np.concatenate([shared, [stretch.open, stretch.close]]))
        wanted = np.flatnonzero(np.isin(times, asked.moments))
        chosen = choose_knots(followed, map(int, fixed), wanted, limit, asked.most)
        return times[chosen.knots], chosen.deviation

    def _followed(
        self, times: Float64, corners: NDArray[np.bool_], stretch: Stretch, seeing: Seeing
    ) -> Followed:
        room = max(_NUMBERS // len(times), 27)
        points = spread(self.follow(times, stretch), min(room, _POINTS))
        values, scales = seeing.followed(times, points, stretch)

        def measure(which: slice, errors: Float64) -> Float64:
            pixels = errors * scales[which]
            squares = np.einsum("snx,snx->sn", pixels, pixels)
            return np.asarray(np.sqrt(squares.max(axis=1, initial=0.0)))

        return Followed(times, values, corners, measure)

    def follow(self, times: Float64, within: Stretch) -> Float64:
        """World positions ``(T, n, 3)`` of all that is followed."""
        found = [follower(times, within) for follower in self.followers]
        matrices = self.true(times, within) if self.tracked else np.zeros(0)
        for member, points in self.tracked:
            matrix = matrices[:, member]
            found.append(points @ matrix[:, :3, :3].mT + matrix[:, None, :3, 3])
        return np.concatenate(found, axis=1) if found else np.zeros((len(times), 0, 3))

    def member(self, place: Place, links: Sequence[Link]) -> int:
        """Number of what ``links`` move on top of ``place``, as a member."""
        key = (place, tuple(links))
        if key not in self.members:
            self.members[key] = len(self.members)
            moving = [link for link in links if link.source is not None]
            self.movers.update(dict.fromkeys(moving))
            self.jumps.update(jump for link in moving for jump in link.jumps)
        return self.members[key]

    def true(self, times: Float64, within: Stretch) -> Float64:
        """``(T, M, 4, 4)``: own motion of all members on the chords of what they are on."""
        frames = self.frames(times, within)
        chains = [links for _, links in self.members]
        own = chain_matrices(chains, frames, self.window.frame)
        for index, (place, _) in enumerate(self.members):
            own[:, index] = place.at(times, within) @ own[:, index]
        return own

    def frames(self, times: Float64, within: Stretch) -> Float64:
        """Frames at which it is evaluated, clear of jumps at the stretch's ends."""
        return self.window.frames(within.inside(times, self.window), self.scale)

    def matrices(self, times: Float64, within: Stretch) -> Float64:
        """``(T, M, 4, 4)`` of all members on the chords at ``times``."""
        part = self.part(within)
        knots = part.knots
        key = np.clip(np.searchsorted(knots, times, side="right") - 1, 0, len(knots) - 2)
        share = (times - knots[key]) / (knots[key + 1] - knots[key])
        share = np.clip(share, 0.0, 1.0)[:, None, None, None]
        return np.asarray((1.0 - share) * part.matrices[key] + share * part.matrices[key + 1])


@dataclass(frozen=True, eq=False)
class Place:
    """Where something hangs: on a ``member`` of a source, or, without one, at rest in the world."""

    source: Source | None
    member: int
    rest: Float64

    def at(self, times: Float64, within: Stretch) -> Float64:
        """``(T, 4, 4)``: on the chords, its place in the world."""
        if self.source is None:
            return np.broadcast_to(self.rest, (len(times), 4, 4))
        return np.asarray(self.source.matrices(times, within)[:, self.member])


def nearest_of(depths: Float64) -> float:
    """How near to the eye what is seen at ``depths`` counts for nearest.

    What passes the eye is infinitely large there; it counts no more than at a thousandth of the
    middle distance, by logarithms.
    """
    if not depths.size:
        return 1.0
    return float(max(depths.min(), 1e-3 * np.exp(np.log(depths).mean())))


def knots_of(sources: Iterable[Source], within: Stretch) -> Float64:
    """Knots of all ``sources`` inside ``within``, without its ends."""
    found = [np.zeros(0), *(source.part(within).knots for source in sources)]
    knots = np.unique(np.concatenate(found))
    return knots[(knots > within.open) & (knots < within.close)]


def spread(points: Float64, most: int) -> Float64:
    """At most about so many of points ``(T, n, 3)``, the outermost at the first time among them."""
    if points.shape[1] <= most:
        return points
    ways = np.array(list(np.ndindex(3, 3, 3))) - 1.0
    extremes = np.argmax(points[0] @ ways.T, axis=0)
    some = np.linspace(0, points.shape[1] - 1, max(most - 27, 1)).astype(int)
    return points[:, np.union1d(extremes, some)]
