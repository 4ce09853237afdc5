"""Environments that are known in closed form, and sums over directions that share no code."""

from __future__ import annotations

import numpy as np

import mbinterval as mb


def smooth(d: np.ndarray) -> np.ndarray:
    """A glow, waves and a smaller glow, by unit direction ``(..., 3)``; from 0 to 5."""
    x, y = d[..., 0], d[..., 1]
    return np.stack(
        [
            2.0 * np.exp(2.0 * (d @ [0.6, 0.64, -0.48] - 1.0)),
            0.5 + 0.5 * np.sin(7.0 * x) * np.cos(5.0 * y),
            5.0 * np.exp(20.0 * (d @ [0.0, 0.6, 0.8] - 1.0)),
        ],
        axis=-1,
    )


def stripes(d: np.ndarray) -> np.ndarray:
    """Three waves around the horizon, the same at every height."""
    wave = 0.5 + 0.4 * np.sin(3.0 * np.arctan2(d[..., 0], -d[..., 2]) + 0.3)
    return np.stack([wave, 1.0 - wave, 0.5 * wave], axis=-1)


def environment(light: object, rows: int = 128, **fields: object) -> mb.Environment:
    """``light`` by longitude and latitude: up on top, -Z in the middle, +X on the right."""
    up = (0.5 - (np.arange(rows) + 0.5) / rows) * np.pi
    turn = ((np.arange(2 * rows) + 0.5) / (2 * rows) - 0.5) * 2.0 * np.pi
    out = np.cos(up)[:, None]
    ways = [out * np.sin(turn), np.sin(up)[:, None] + 0.0 * turn, -out * np.cos(turn)]
    return mb.Environment(light(np.stack(ways, axis=-1)), **fields)


def around(normal: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """Directions about +z turned to be about ``normal``."""
    aside = np.eye(3)[np.argmin(np.abs(normal))]
    across = np.cross(aside, normal)
    across /= np.linalg.norm(across)
    return ways @ np.stack([across, np.cross(normal, across), normal])


def hemisphere(steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit directions about +z ``(n, 3)`` and their solid angles."""
    height = (np.arange(steps) + 0.5) / steps
    turn = 2.0 * np.pi * (np.arange(2 * steps) + 0.5) / (2 * steps)
    out = np.sqrt(1.0 - height**2)[:, None]
    parts = [out * np.cos(turn), out * np.sin(turn), height[:, None] + 0.0 * turn]
    ways = np.stack(parts, axis=-1).reshape(-1, 3)
    return ways, np.full(len(ways), 2.0 * np.pi / len(ways))


def metallic_roughness(
    view: np.ndarray, ways: np.ndarray, color: np.ndarray, metallic: float, roughness: float
) -> np.ndarray:
    """glTF 2.0, appendix B.3: what a surface with its normal along +z reflects, by direction."""
    half = ways + view
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    nl, nv, nh, vh = ways[:, 2], view[2], half[:, 2], half @ view
    square = roughness**4
    spread = square / (np.pi * (nh**2 * (square - 1.0) + 1.0) ** 2)
    masks = [2.0 * c / (c + np.sqrt(square + (1.0 - square) * c**2)) for c in (nl, nv)]
    shine = spread * masks[0] * masks[1] / (4.0 * nl * nv)
    facing = 0.04 * (1.0 - metallic) + np.asarray(color) * metallic
    fresnel = facing + (1.0 - facing) * ((1.0 - vh) ** 5)[:, None]
    diffuse = (1.0 - metallic) * np.asarray(color) / np.pi
    return (1.0 - fresnel) * diffuse + fresnel * shine[:, None]
