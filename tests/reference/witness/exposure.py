"""The shutter: instants drawn by its curve, for the frame or line by line."""

from __future__ import annotations

from typing import Any

import numpy as np


def corners(shutter: Any) -> tuple[np.ndarray, np.ndarray]:
    """Times in [0, 1], ascending, and openings of a curve that is linear between them."""
    if not isinstance(shutter.curve, str):
        values = np.asarray(shutter.curve, np.float64)
        return np.linspace(0.0, 1.0, len(values)), values
    if shutter.curve == "box":
        return np.array([0.0, 1.0]), np.array([1.0, 1.0])
    if shutter.curve == "triangle":
        return np.array([0.0, 0.5, 1.0]), np.array([0.0, 1.0, 0.0])
    times = [0.0, shutter.opening, 1.0 - shutter.closing, 1.0]
    return np.array(times), np.array([0.0, 1.0, 1.0, 0.0])


def drawn_times(shutter: Any, share: np.ndarray) -> np.ndarray:
    """Times in [0, 1] at which the given shares of the light have passed."""
    t, opening = corners(shutter)
    passed = np.append(0.0, np.cumsum(0.5 * (opening[1:] + opening[:-1]) * np.diff(t)))
    target = share * passed[-1]
    k = np.clip(np.searchsorted(passed, target, side="right") - 1, 0, len(t) - 2)
    length, low, high = t[k + 1] - t[k], opening[k], opening[k + 1]
    # low s + (high - low) s^2 / 2 = what is left, over the stretch's length; s in [0, 1].
    left = np.divide(target - passed[k], length, out=np.zeros_like(target), where=length > 0)
    root = np.sqrt(np.maximum(low**2 + 2.0 * (high - low) * left, 0.0))
    s = np.divide(2.0 * left, low + root, out=np.zeros_like(left), where=low + root > 0)
    return t[k] + np.clip(s, 0.0, 1.0) * length


def window(scene: Any, size: tuple[int, int]) -> tuple[float, float]:
    """From when to when anything is exposed, in frames relative to the frame."""
    shutter = scene.shutter
    if shutter.rolling is None:
        return shutter.open, shutter.close
    lines = size[0] if shutter.rolling in ("left", "right") else size[1]
    seconds = (lines - 1) * shutter.line_offset + shutter.line_exposure
    return shutter.open, shutter.open + seconds * scene.fps


def line_starts(scene: Any, size: tuple[int, int]) -> np.ndarray | None:
    """When each line, row or column, opens, in frames relative to the frame; None: all together."""
    shutter = scene.shutter
    if shutter.rolling is None:
        return None
    lines = size[0] if shutter.rolling in ("left", "right") else size[1]
    order = np.arange(lines)
    if shutter.rolling in ("up", "left"):
        order = order[::-1]
    return shutter.open + order * shutter.line_offset * scene.fps


def length(scene: Any) -> float:
    """How long the frame, or each line, is exposed, in frames."""
    shutter = scene.shutter
    if shutter.rolling is None:
        return float(shutter.close - shutter.open)
    return float(shutter.line_exposure * scene.fps)


def opened(scene: Any, share: np.ndarray) -> np.ndarray:
    """Frames after a line's opening, or the frame's, at which shares of its light have passed."""
    return length(scene) * drawn_times(scene.shutter, share)
