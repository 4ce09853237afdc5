"""Keyed values and transforms, evaluated at any frame.

Before the first key and after the last one a track holds their values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene import field_values
from mbinterval.scene.frozen import Frozen
from mbinterval.values import shown

Float64 = NDArray[np.float64]

INTERPOLATIONS = ("linear", "step", "cubic")


@dataclass(frozen=True, eq=False)
class Track(Frozen):
    """Values at keys.

    Attributes
    ----------
    frames
        ``(n,)`` strictly increasing key times in frames.
    values
        ``(n,)`` or ``(n, d)``; for ``"cubic"`` ``(n, 3, d)``: at each key the tangent before it,
        the value, and the tangent after it, tangents per frame. Quaternions are x, y, z, w, as in
        glTF.
    interpolation
        ``"linear"``, ``"step"`` (the value of the latest key) or ``"cubic"`` (Hermite, as glTF's
        CUBICSPLINE).
    quaternion
        Interpolate by slerp along the shorter arc; a cubic is normalized instead.
    """

    frames: Float64
    values: Float64
    interpolation: str = "linear"
    quaternion: bool = False

    def __post_init__(self) -> None:
        frames = field_values.numbers(self.frames, np.float64, "track: frames")
        values = field_values.numbers(self.values, np.float64, "track: values")
        if frames.ndim != 1 or len(frames) == 0 or values.shape[:1] != frames.shape:
            raise SceneError(
                f"track: {frames.shape} key times for values of shape {values.shape}; "
                "expected as many times as values, at least one"
            )
        for name, array in (("frames", frames), ("values", values)):
            field_values.check_finite(array.reshape(len(frames), -1), f"track: {name}", "key")
        if np.any(np.diff(frames) <= 0):
            raise SceneError(f"track: key times must increase, got {shown(frames.tolist())}")
        interpolation = field_values.choice(
            self.interpolation, INTERPOLATIONS, "track: interpolation"
        )
        cubic = interpolation == "cubic"
        if cubic and (values.ndim != 3 or values.shape[1] != 3):
            raise SceneError(f"track: cubic values have shape {values.shape}, expected (n, 3, d)")
        if field_values.flag(self.quaternion, "track: quaternion"):
            values = _unit_keys(values, cubic)
        field_values.freeze(self, frames=frames, values=values, interpolation=interpolation)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of a value, ``()`` or ``(d,)``."""
        return self.values.shape[2 if self.interpolation == "cubic" else 1 :]

    @property
    def jumps(self) -> list[float]:
        """Frames at which the value jumps."""
        if self.interpolation != "step":
            return []
        changed = np.diff(self.values.reshape(len(self.values), -1), axis=0).any(axis=1)
        return [float(frame) for frame in self.frames[1:][changed]]

    def at(self, frame: float) -> Float64:
        """Value at ``frame``, shape ``(d,)`` or ``()``."""
        cubic = self.interpolation == "cubic"
        at_keys = self.values[:, 1] if cubic else self.values
        key = max(int(np.searchsorted(self.frames, frame, side="right")) - 1, 0)
        ends = frame <= self.frames[0] or key == len(self.frames) - 1
        if ends or self.interpolation == "step":
            return np.asarray(at_keys[key])
        step = self.frames[key + 1] - self.frames[key]
        part = (frame - self.frames[key]) / step
        if cubic:
            return self._hermite(key, step, part)
        if self.quaternion:
            return slerp(self.values[key], self.values[key + 1], part)
        return np.asarray((1.0 - part) * self.values[key] + part * self.values[key + 1])

    def _hermite(self, key: int, step: float, part: float) -> Float64:
        (_, start, leaving), (arriving, end, _) = self.values[key], self.values[key + 1]
        rest = 1.0 - part
        value = (
            (1.0 + 2.0 * part) * rest**2 * start
            + part * rest**2 * step * leaving
            + (3.0 - 2.0 * part) * part**2 * end
            - part**2 * rest * step * arriving
        )
        return np.asarray(value / np.linalg.norm(value) if self.quaternion else value)


def _unit_keys(values: Float64, cubic: bool) -> Float64:
    """Quaternion keys of length 1; of a cubic they keep their lengths, as tangents go with them."""
    at_keys = values[:, 1] if cubic else values
    if at_keys.shape[1:] != (4,) or not np.linalg.norm(at_keys, axis=-1).all():
        raise SceneError("track: rotation keys must be non-zero quaternions x, y, z, w")
    return values if cubic else values / np.linalg.norm(values, axis=-1, keepdims=True)


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


@dataclass(frozen=True, eq=False)
class Transform(Frozen):
    """A node of a hierarchy: parent * translation * rotation * scale * matrix.

    Each of translation, rotation and scale is constant or a ``Track``; ``matrix`` is a constant
    4x4 that applies first. Rotations are quaternions x, y, z, w.
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
            if keyed(value, (count,), what) is None:
                field_values.freeze(self, **{name: field_values.row(value, count, what, expected)})
        if isinstance(self.rotation, Track):
            if not self.rotation.quaternion:
                raise SceneError("transform: rotation is keyed without Track(quaternion=True)")
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

    def at(self, frame: float, base: float | None = None) -> Float64:
        """The ``(4, 4)`` matrix that maps to world space at ``frame``; it acts on columns."""
        world = self._local(frame)
        node = self.parent
        with np.errstate(over="ignore", invalid="ignore"):  # who asks looks at the result
            while node is not None:  # a loop, since files may nest deeper than Python's stack
                world = node._local(frame) @ world
                node = node.parent
        return world

    def _local(self, frame: float) -> Float64:
        local = np.eye(4)
        local[:3, :3] = quaternion_matrix(value_at(self.rotation, frame)) * value_at(
            self.scale, frame
        )
        local[:3, 3] = value_at(self.translation, frame)
        return local if self.matrix is None else local @ self.matrix


_STRIDE = 32


def _restored(_stones: list[Transform], state: dict[str, Any]) -> Transform:
    made = Transform.__new__(Transform)
    made.__setstate__(state)
    return made


def matrices_at(nodes: Sequence[Transform], frame: float) -> Float64:
    """World matrices ``(n, 4, 4)`` of ``nodes`` at ``frame``, shared ancestors evaluated once."""
    known: dict[int, Float64] = {}
    for node in nodes:
        chain = []
        step: Transform | None = node
        while step is not None and id(step) not in known:
            chain.append(step)
            step = step.parent
        with np.errstate(over="ignore", invalid="ignore"):  # who asks looks at the result
            for item in reversed(chain):
                local = item._local(frame)
                known[id(item)] = local if item.parent is None else known[id(item.parent)] @ local
    return np.array([known[id(node)] for node in nodes]).reshape(-1, 4, 4)


def keyed(value: Any, shape: tuple[int, ...], what: str) -> Track | None:
    """Return ``value`` if it is a track, of values that have ``shape``; None if it is none."""
    if not isinstance(value, Track):
        return None
    if value.shape != shape:
        expected = f"{shape[0]} numbers" if shape else "one number"
        raise SceneError(f"{what} is keyed with values of shape {value.shape}, expected {expected}")
    return value


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


def value_at(value: Any, frame: float) -> Float64:
    """Return a value at ``frame``: a track's, or the one that is always there, as an array."""
    return value.at(frame) if isinstance(value, Track) else np.asarray(value, dtype=np.float64)


# The core has no SciPy for rotations; trimesh, which has some, takes 0.6 s to load.
def slerp(a: Float64, b: Float64, part: float) -> Float64:
    """Spherical interpolation of unit quaternions along the shorter arc (Shoemake 1985)."""
    dot = float(a @ b)
    if dot < 0.0:
        b, dot = -b, -dot
    # atan2 of half chords keeps nearly equal and nearly opposite rotations accurate.
    angle = 2.0 * np.arctan2(np.linalg.norm(a - b), np.linalg.norm(a + b))
    if angle < 1e-9:
        result = (1.0 - part) * a + part * b
    else:
        result = (np.sin((1.0 - part) * angle) * a + np.sin(part * angle) * b) / np.sin(angle)
    return np.asarray(result / np.linalg.norm(result))


def quaternion_matrix(quaternion: Float64) -> Float64:
    """``(3, 3)`` rotation of a quaternion x, y, z, w of any non-zero length."""
    x, y, z, w = np.asarray(quaternion, dtype=np.float64) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_product(a: Float64, b: Float64) -> Float64:
    """Quaternion x, y, z, w of the rotation ``b`` followed by ``a``."""
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.append(vector, a[3] * b[3] - a[:3] @ b[:3])
