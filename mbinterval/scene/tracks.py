"""Keyed values, evaluated at any frame.

Before the first key and after the last one a track holds their values.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene import field_values
from mbinterval.scene.frozen import Frozen
from mbinterval.scene.rotations import EULER_ORDERS, arc, euler_matrix, quaternion_matrix, slerp
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
        ``(n,)`` or ``(n, d)``; for ``"cubic"`` ``(n, 3)`` or ``(n, 3, d)``: at each key the tangent
        before it, the value, and the tangent after it, tangents per frame. Quaternions are x, y, z,
        w, as in glTF; Euler angles degrees.
    interpolation
        ``"linear"``, ``"step"`` (the value of the latest key) or ``"cubic"`` (Hermite, as glTF's
        CUBICSPLINE).
    quaternion
        Interpolate by slerp along the shorter arc; a cubic is normalized instead.
    euler
        Values are Euler angles, turns about the fixed axes x, y and z in this order, the first
        letter first (``"xyz"`` is USD's ``rotateXYZ``); each angle goes its own way between keys.
        ``""`` for all other values.
    """

    frames: Float64
    values: Float64
    interpolation: str = "linear"
    quaternion: bool = False
    euler: str = ""

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
        if cubic and values.shape[1:2] != (3,):
            raise SceneError(
                f"track: cubic values have shape {values.shape}, expected (n, 3) or (n, 3, d)"
            )
        if field_values.flag(self.quaternion, "track: quaternion"):
            values = _unit_keys(values, cubic)
        field_values.freeze(self, frames=frames, values=values, interpolation=interpolation)
        if self.euler != "":
            self._check_euler()

    def _check_euler(self) -> None:
        field_values.choice(self.euler, EULER_ORDERS, "track: euler")
        if self.quaternion or self.shape != (3,):
            raise SceneError(
                f"track: euler keys have values of shape {self.shape}"
                f"{', and are quaternions' if self.quaternion else ''}; expected three angles"
            )
        turns = np.abs(np.diff(self._at_keys, axis=0)).max(axis=1, initial=0.0)
        if turns.size and turns.max() > _MOST_TURN:
            key = int(np.argmax(turns)) + 1
            raise SceneError(
                f"transform: euler turns by {turns.max():g} degrees up to the key at frame "
                f"{self.frames[key]:g}; at most {_MOST_TURN:g} may lie between keys"
            )

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

    @property
    def range(self) -> tuple[float, float]:
        """Numbers that no value is below or above: of a cubic those of its Bezier handles."""
        values = self.values
        if self.interpolation == "cubic":
            thirds = np.diff(self.frames).reshape(-1, *(1,) * (values.ndim - 2)) / 3.0
            leaving = values[:-1, 1] + thirds * values[:-1, 2]
            arriving = values[1:, 1] - thirds * values[1:, 0]
            values = np.concatenate([values[:, 1], leaving, arriving])
        return float(values.min()), float(values.max())

    @property
    def source(self) -> tuple[Any, ...]:
        """What tells it from others that give other values at some time."""
        arrays = (self.frames.tobytes(), self.values.tobytes())
        return (*arrays, self.values.shape, self.interpolation, self.quaternion, self.euler)

    @property
    def _at_keys(self) -> Float64:
        return self.values[:, 1] if self.interpolation == "cubic" else self.values

    def at(self, frames: Float64 | float) -> Float64:
        """Values at ``frames`` (T,): ``(T, d)`` or ``(T,)``; at one frame ``(d,)`` or ``()``."""
        frames = np.asarray(frames, np.float64)
        at_keys = self._at_keys
        key = np.clip(np.searchsorted(self.frames, frames, side="right") - 1, 0, None)
        if self.interpolation == "step" or len(self.frames) == 1:
            return np.asarray(at_keys[key])
        key = np.minimum(key, len(self.frames) - 2)
        step = self.frames[key + 1] - self.frames[key]
        part = np.clip((frames - self.frames[key]) / step, 0.0, 1.0)
        if self.interpolation == "linear" and self.quaternion:
            found = slerp(at_keys[key], at_keys[key + 1], part)
        else:
            wide = (part[..., None], step[..., None]) if self.shape else (part, step)
            found = self._between(key, *wide)
        # What is at a key is that key's value to the last bit.
        exact = (part == 0.0) | (part == 1.0)
        near = at_keys[np.where(part == 1.0, key + 1, key)]
        return np.asarray(np.where(exact[..., None] if self.shape else exact, near, found))

    def _between(self, key: Any, part: Float64, step: Float64) -> Float64:
        if self.interpolation == "linear":
            return np.asarray((1.0 - part) * self.values[key] + part * self.values[key + 1])
        start, leaving = self.values[key, 1], self.values[key, 2]
        arriving, end = self.values[key + 1, 0], self.values[key + 1, 1]
        rest = 1.0 - part
        value = (
            (1.0 + 2.0 * part) * rest**2 * start
            + part * rest**2 * step * leaving
            + (3.0 - 2.0 * part) * part**2 * end
            - part**2 * rest * step * arriving
        )
        if self.quaternion:
            value = value / np.linalg.norm(value, axis=-1, keepdims=True)
        return np.asarray(value)

    def rotations(self, frames: Float64) -> Float64:
        """Rotations ``(T, 3, 3)`` at ``frames`` (T,), of a track of quaternions or Euler angles."""
        values = self.at(frames)
        return euler_matrix(values, self.euler) if self.euler else quaternion_matrix(values)

    def keys(self, first: float, last: float) -> Float64:
        """Frames of the keys from ``first`` to ``last``."""
        return self.frames[(self.frames >= first) & (self.frames <= last)]

    def samples(self, first: float, last: float) -> Float64:
        """Frames from ``first`` to ``last``, with the keys there, that tell its motion between.

        From one to the next it is linear, or smooth and turns by no more than `_FINE` radians.
        """
        frames = self.frames
        low = max(int(np.searchsorted(frames, first, side="right")) - 1, 0)
        high = min(int(np.searchsorted(frames, last)), len(frames) - 1)
        parts = [frames[low : high + 1]]
        if self.interpolation != "step":
            for key in range(low, high):
                count = self._pieces(key)
                ends = frames[key : key + 2]
                parts.append(ends[0] + (ends[1] - ends[0]) * (np.arange(1, count) / count))
        found = np.unique(np.concatenate(parts))
        return found[(found >= first) & (found <= last)]

    def _pieces(self, key: int) -> int:
        """Into how many equal parts the motion from ``key`` to the next one is to be cut."""
        start, end = self._at_keys[key], self._at_keys[key + 1]
        if self.interpolation == "cubic":
            return _CUBIC_PIECES
        turn = 0.0
        if self.quaternion:
            turn = 2.0 * min(float(arc(start, end)), float(arc(start, -end)))
        elif self.euler:
            turn = float(np.radians(np.abs(end - start).sum()))
        return 1 if turn == 0.0 else max(2, int(np.ceil(min(turn / _FINE, _MOST_PIECES))))


_FINE = np.pi / 16
_CUBIC_PIECES = 8
_MOST_PIECES = 4096
"""More are never looked at between two keys: whoever turns so fast is past any number of knots."""
_MOST_TURN = 3.6e7
"""Degrees between two Euler keys: a hundred thousand turns."""


def _unit_keys(values: Float64, cubic: bool) -> Float64:
    """Quaternion keys of length 1; of a cubic they keep their lengths, as tangents go with them."""
    at_keys = values[:, 1] if cubic else values
    if at_keys.shape[1:] != (4,) or not np.linalg.norm(at_keys, axis=-1).all():
        raise SceneError("track: rotation keys must be non-zero quaternions x, y, z, w")
    return values if cubic else values / np.linalg.norm(values, axis=-1, keepdims=True)


def keyed(value: Any, shape: tuple[int, ...], what: str) -> Track | None:
    """Return ``value`` if it is a track, of values that have ``shape``; None if it is none."""
    if not isinstance(value, Track):
        return None
    if value.shape != shape:
        expected = f"{shape[0]} numbers" if shape else "one number"
        raise SceneError(f"{what} is keyed with values of shape {value.shape}, expected {expected}")
    return value


def value_at(value: Any, frames: Float64 | float) -> Float64:
    """Return values at ``frames``: a track's, or the one that is always there, as an array."""
    return value.at(frames) if isinstance(value, Track) else np.asarray(value, dtype=np.float64)
