"""Where a mesh truly is at any time of the shutter, before its motion is cut into chords."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.exposure.shutter_times import Window
from mbinterval.scene.deform import ALL, Index
from mbinterval.scene.model import Mesh
from mbinterval.scene.transforms import chain_matrices, links_of

Float64 = NDArray[np.float64]


def mesh_times(mesh: Mesh, window: Window, times: Float64) -> Float64:
    """Times of the shutter at which ``mesh`` is evaluated at ``times``: its own shutter's."""
    scale = mesh.own_shutter
    return times if scale == 1.0 else window.scaled(times, scale)


def world_positions(mesh: Mesh, window: Window, times: Float64, which: Index = ALL) -> Float64:
    """True world positions of all vertices, or of some, at ``times`` (T,): ``(T, n, 3)``."""
    own = mesh_times(mesh, window, times)
    frames = window.frames(times, mesh.own_shutter)
    with np.errstate(over="ignore", invalid="ignore"):  # the result is looked at
        if mesh.deformer is None:
            points = at_times(mesh.positions[..., which, :], own)
        else:
            points = np.array(
                [mesh.deformer.positions(float(frame), which, window.frame) for frame in frames]
            )
        matrices = chain_matrices([links_of(mesh.transform)], frames, window.frame)[:, 0]
        positions = points @ matrices[:, :3, :3].mT + matrices[:, None, :3, 3]
    return finite(mesh, positions)


def finite(mesh: Mesh, positions: Float64) -> Float64:
    """``positions`` of the mesh, if its motion keeps them finite."""
    if not np.isfinite(positions).all():
        moved = "transform" if mesh.deformer is None else "deformer or transform"
        raise SceneError(f"mesh {mesh.name!r}: its {moved} takes vertices to infinity")
    return positions


def at_times(values: NDArray[Any], times: Float64) -> NDArray[Any]:
    """Values ``(G, N, width)`` at equally spaced times, at ``times`` (T,); one time if constant."""
    if values.ndim == 2:
        return values[None]
    place = np.clip(times, 0.0, 1.0) * (len(values) - 1)
    whole = np.rint(place)
    place = np.where(np.abs(place - whole) < 1e-6, whole, place)
    key = np.minimum(place.astype(int), len(values) - 2)
    part = (place - key)[:, None, None]
    return np.asarray((1.0 - part) * values[key] + part * values[key + 1])
