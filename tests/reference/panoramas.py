"""Float64 twins of look-ups in pictures of all directions: shares of texels, summed one by one."""

from __future__ import annotations

import numpy as np


def places(image: np.ndarray, ways: np.ndarray, turn: float) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows, in texels, of directions ``(n, 3)``."""
    height, width = image.shape[:2]
    ways = np.asarray(ways, np.float64)
    x = (np.arctan2(ways[:, 0], -ways[:, 2]) + turn) / (2.0 * np.pi) + 0.5
    up = np.arctan2(ways[:, 1], np.hypot(ways[:, 0], ways[:, 2]))
    return (x % 1.0) * width, (0.5 - up / np.pi) * height


def boxes(image: np.ndarray, ways: np.ndarray, spread: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Widths and heights, in texels, of what samples stand for that are ``spread`` radians wide."""
    height, width = image.shape[:2]
    cosine = np.hypot(ways[:, 0], ways[:, 2]) / np.linalg.norm(ways, axis=1)
    wide = spread * width / (2.0 * np.pi * np.maximum(cosine, 1e-9))
    return _size(wide, width), _size(spread * height / np.pi, height)


def _size(texels: np.ndarray, most: int) -> np.ndarray:
    square = np.maximum(np.minimum(texels, most) ** 2, 1.0)
    return np.minimum(np.sqrt(square + 1.0 - 1.0 / square), most)


def mean_in_box(image: np.ndarray, x: float, y: float, wide: float, high: float) -> np.ndarray:
    """Mean colour ``(3,)`` over a box around a place; columns go around, rows end at the poles."""
    height, width = image.shape[:2]
    across = sum(_overlap(np.arange(width) + k * width, x, wide) for k in (-1, 0, 1))
    down = _overlap(np.arange(height), y, high)
    weight = down[:, None] * across
    return (weight[..., None] * image).sum(axis=(0, 1)) / weight.sum()


def _overlap(first: np.ndarray, middle: float, size: float) -> np.ndarray:
    low, high = middle - 0.5 * size, middle + 0.5 * size
    return np.clip(np.minimum(first + 1.0, high) - np.maximum(first, low), 0.0, None)


def interpolated(image: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Colours ``(n, 3)`` between the centres of texels."""
    height, width = image.shape[:2]
    x, y = x - 0.5, np.clip(y - 0.5, 0.0, height - 1.0)
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    across, down = (x - x0)[:, None], (y - y0)[:, None]
    left, right, below = x0 % width, (x0 + 1) % width, np.minimum(y0 + 1, height - 1)
    upper = (1.0 - across) * image[y0, left] + across * image[y0, right]
    lower = (1.0 - across) * image[below, left] + across * image[below, right]
    return (1.0 - down) * upper + down * lower
