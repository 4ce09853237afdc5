"""Places in the world over time: nodes of a hierarchy, whose values may be keyed."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene import field_values
from mbinterval.scene.frozen import Frozen
from mbinterval.scene.rotations import quaternion_matrix
from mbinterval.scene.tracks import Track, keyed, value_at

Float64 = NDArray[np.float64]


@runtime_checkable
class Placement(Protocol):
    """A place in the world over time; `Transform` is one."""

    @property
    def animated(self) -> bool:
        """Whether it may differ between frames."""

    @property
    def jumps(self) -> list[float]:
        """Frames at which it may jump."""

    def at(self, frame: float, base: float | None = None) -> Float64:
        """The ``(4, 4)`` matrix that maps to world space at ``frame``; it acts on columns.

        ``base`` is the exposure's frame, from which velocities lead on; None is ``frame``.
        """


class Mover(Protocol):
    """What changes over time by itself, and tells when it has to be looked at."""

    @property
    def source(self) -> Hashable | None:
        """What moves it: equal for those that move alike; None for one that never moves."""

    @property
    def jumps(self) -> list[float]:
        """Frames at which it may jump by itself."""

    def keys(self, first: float, last: float) -> Float64:
        """Frames from ``first`` to ``last`` at which its motion may bend."""

    def samples(self, first: float, last: float) -> Float64:
        """Frames from ``first`` to ``last``, keys among them, that tell its motion between them."""


class Link(Mover, Protocol):
    """A node of a placement's chain, from the root on: what it adds to the place of its parent.

    A placement with a method ``links()`` that returns them moves what hangs on one node by chords
    of one clock (`mbinterval.exposure.sources`); one without is a single link. Links are hashable,
    equal only if they are the same node.
    """

    def local(self, frames: Float64, base: float) -> Float64:
        """Matrices ``(T, 4, 4)`` at ``frames`` (T,), that act on columns."""


@dataclass(frozen=True, eq=False)
class Transform(Frozen):
    """A node of a hierarchy: parent * translation * rotation * scale * matrix.

    Each of translation, rotation and scale is constant or a ``Track``; ``matrix`` is a constant
    4x4 that applies first. Rotations are quaternions x, y, z, w; a track of them may be one of
    Euler angles instead.
    """

    translation: Track | tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation: Track | tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    scale: Track | tuple[float, float, float] = (1.0, 1.0, 1.0)
    matrix: Float64 | None = None
    parent: Transform | None = None

    def __post_init__(self) -> None:
        for name, count, expected in (
            ("translation", 3, "three finite numbers"),
            ("rotation", 4, "four finite numbers, a quaternion x, y, z, w"),
            ("scale", 3, "three finite numbers"),
        ):
            value, what = getattr(self, name), f"transform: {name}"
            size = 3 if isinstance(value, Track) and value.euler else count
            if keyed(value, (size,), what) is None:
                field_values.freeze(self, **{name: field_values.row(value, count, what, expected)})
        if isinstance(self.rotation, Track):
            if not (self.rotation.quaternion or self.rotation.euler):
                raise SceneError(
                    "transform: rotation is keyed without Track(quaternion=True) or euler=..."
                )
        elif not any(self.rotation):
            raise SceneError("transform: rotation is a quaternion of length 0; give x, y, z, w")
        if self.matrix is not None:
            field_values.freeze(self, matrix=_affine(self.matrix))
        if self.parent is not None:
            field_values.check_kind(self.parent, Transform, "transform: parent")

    def __reduce__(self) -> tuple[Any, ...]:
        # Pickle would go up to the root node by node, deeper than Python's stack: so, of every
        # thirty-second node, every thirty-second ancestor comes first, from the root on.
        above = self._chain()[:-1]
        stones = above[::_STRIDE] if len(above) % _STRIDE == 0 else []
        return _restored, (stones, vars(self))

    def _chain(self) -> list[Transform]:
        """Its ancestors, the root first, and itself."""
        chain: list[Transform] = []
        node: Transform | None = self
        while node is not None:
            chain.append(node)
            node = node.parent
        return chain[::-1]

    @property
    def fingerprint(self) -> list[Any]:
        """What tells it from others by contents, without its ancestors' records in one another."""
        return [(n.translation, n.rotation, n.scale, n.matrix) for n in self._chain()]

    @property
    def tracks(self) -> list[Track]:
        """Every track of this node and of its ancestors."""
        found: list[Track] = []
        for node in reversed(self._chain()):
            values = (node.translation, node.rotation, node.scale)
            found += [value for value in values if isinstance(value, Track)]
        return found

    @property
    def animated(self) -> bool:
        """Whether anything is keyed."""
        return bool(self.tracks)

    @property
    def jumps(self) -> list[float]:
        """Frames at which the transform may jump."""
        return [frame for track in self.tracks for frame in track.jumps]

    def links(self) -> list[Link]:
        """Its chain, the root first (`Link`)."""
        return [Node(node) for node in self._chain()]

    def at(self, frame: float, base: float | None = None) -> Float64:
        """The ``(4, 4)`` matrix that maps to world space at ``frame``; it acts on columns."""
        frames, world = np.array([frame]), np.eye(4)
        with np.errstate(over="ignore", invalid="ignore"):  # who asks looks at the result
            for node in self._chain():
                world = world @ node.local(frames)[0]
        return world

    def local(self, frames: Float64) -> Float64:
        """Matrices ``(T, 4, 4)`` of this node alone at ``frames`` (T,)."""
        local = np.zeros((len(frames), 4, 4))
        local[:, 3, 3] = 1.0
        turn = self.rotation
        rotations = turn.rotations(frames) if isinstance(turn, Track) else quaternion_matrix(turn)
        scales = np.broadcast_to(value_at(self.scale, frames), (len(frames), 3))
        local[:, :3, :3] = rotations * scales[:, None, :]
        local[:, :3, 3] = value_at(self.translation, frames)
        return local if self.matrix is None else local @ self.matrix


@dataclass(frozen=True)
class Node:
    """A node of a hierarchy by itself, a `Link`."""

    node: Transform

    @property
    def _tracks(self) -> list[Track]:
        values = (self.node.translation, self.node.rotation, self.node.scale)
        return [value for value in values if isinstance(value, Track)]

    @property
    def source(self) -> Hashable | None:
        """See `Link`: nodes with the same tracks move alike, wherever they rest."""
        return tuple(track.source for track in self._tracks) or None

    @property
    def jumps(self) -> list[float]:
        """See `Link`."""
        return [frame for track in self._tracks for frame in track.jumps]

    def local(self, frames: Float64, base: float) -> Float64:
        """See `Link`."""
        return self.node.local(frames)

    def keys(self, first: float, last: float) -> Float64:
        """See `Link`."""
        found = [track.keys(first, last) for track in self._tracks]
        return np.unique(np.concatenate([[], *found]))

    def samples(self, first: float, last: float) -> Float64:
        """See `Link`."""
        found = [track.samples(first, last) for track in self._tracks]
        return np.unique(np.concatenate([[], *found]))


_STRIDE = 32


def _restored(_stones: list[Transform], state: dict[str, Any]) -> Transform:
    made = Transform.__new__(Transform)
    made.__setstate__(state)
    return made


@dataclass(frozen=True)
class Opaque:
    """A placement, or anything else that moves, that tells nothing about itself, as a `Link`."""

    thing: Any

    @property
    def source(self) -> Hashable | None:
        """See `Mover`."""
        return id(self.thing) if getattr(self.thing, "animated", True) else None

    @property
    def jumps(self) -> list[float]:
        """See `Mover`."""
        return list(self.thing.jumps)

    def local(self, frames: Float64, base: float) -> Float64:
        """See `Link`."""
        return np.array([self.thing.at(float(frame), base) for frame in frames])

    def keys(self, first: float, last: float) -> Float64:
        """See `Mover`: none are known."""
        return np.zeros(0)

    def samples(self, first: float, last: float) -> Float64:
        """See `Mover`: it is looked at often."""
        return np.linspace(first, last, _LOOKS)


_LOOKS = 33


def links_of(place: Placement | None) -> list[Link]:
    """Return the chain of ``place``, the root first; none for the world itself."""
    if place is None:
        return []
    links = getattr(place, "links", None)
    return [Opaque(place)] if links is None else list(links())


def chain_matrices(chains: Sequence[Sequence[Link]], frames: Float64, base: float) -> Float64:
    """Products ``(T, n, 4, 4)`` of n ``chains`` at ``frames`` (T,); what they share is made once.

    ``base`` is the exposure's frame, from which velocities lead on.
    """
    world = np.broadcast_to(np.eye(4), (len(frames), 4, 4))
    places: dict[tuple[int, Link], int] = {}
    local: dict[Link, Float64] = {}
    made: list[Float64] = [world]
    found = []
    with np.errstate(over="ignore", invalid="ignore"):  # who asks looks at the result
        for chain in chains:
            at = 0
            for link in chain:
                if (at, link) not in places:
                    if link not in local:
                        local[link] = link.local(frames, base)
                    places[at, link] = len(made)
                    made.append(made[at] @ local[link])
                at = places[at, link]
            found.append(made[at])
    return np.stack(found, axis=1) if found else np.zeros((len(frames), 0, 4, 4))


def check_place(value: Any, what: str) -> None:
    """Refuse what is no place in the world over time."""
    if not isinstance(value, Placement):
        raise field_values.refuse(value, what, "a Transform")


def _affine(value: Any) -> Float64:
    matrix = field_values.numbers(value, np.float64, "transform: matrix")
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise field_values.refuse(value, "transform: matrix", "4 x 4 finite numbers")
    field_values.check_finite(matrix, "transform: matrix", "row")
    if not np.allclose(matrix[3], (0.0, 0.0, 0.0, 1.0), rtol=0.0, atol=1e-6):
        raise SceneError(
            f"transform: the last row of matrix is {matrix[3].tolist()}, expected [0, 0, 0, 1]; it "
            "acts on columns: transpose one that acts on rows"
        )
    return matrix
