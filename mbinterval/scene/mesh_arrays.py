"""The arrays of a mesh, checked against each other."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene.field_values import check_finite, choice, numbers, refuse
from mbinterval.values import shown

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]


def check_positions(value: Any, where: str) -> Float64:
    """``(N, 3)`` or ``(K+1, N, 3)`` positions of at least one vertex; one time is static."""
    positions = numbers(value, np.float64, f"{where}: positions")
    if positions.ndim not in (2, 3) or positions.shape[-1] != 3:
        raise SceneError(
            f"{where}: positions have shape {positions.shape}, expected (N, 3) for a static "
            "mesh or (K+1, N, 3) for K motion segments"
        )
    if 0 in positions.shape:
        raise SceneError(f"{where}: positions hold no vertex; leave the mesh out")
    if positions.ndim == 3 and positions.shape[0] == 1:
        positions = positions[0]
    check_finite(positions, f"{where}: positions", "vertex")
    return positions


def check_faces(value: Any, count: int, where: str) -> NDArray[np.int32]:
    """``(F, 3)`` indices of ``count`` vertices; an empty list is no face."""
    try:
        faces = np.asarray(value)
    except (TypeError, ValueError):
        raise SceneError(
            f"{where}: faces={shown(value)}: rows of different lengths; triangulate polygons first"
        ) from None
    if faces.shape == (0,):
        return np.zeros((0, 3), np.int32)
    if faces.dtype.kind not in "iu":
        raise refuse(value, f"{where}: faces", "(F, 3) integers, from 0 on")
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise SceneError(
            f"{where}: faces have shape {faces.shape}, expected (F, 3); triangulate polygons first"
        )
    if faces.size and (faces.min() < 0 or faces.max() >= count):
        face = int(np.argwhere((faces < 0) | (faces >= count))[0][0])
        raise SceneError(
            f"{where}: face {face} is {faces[face].tolist()}, "
            f"but vertices run from 0 to {count - 1}"
        )
    return faces.astype(np.int32)


def check_attribute(value: Any, width: int, count: int, times: int, what: str) -> Float64 | None:
    """``(N, width)`` or ``(K+1, N, width)`` values of the vertices; None where there are none."""
    if value is None:
        return None
    array = numbers(value, np.float64, what)
    shapes = [(count, width)] + ([(times, count, width)] if times > 1 else [])
    if array.shape not in shapes:
        expected = " or ".join(map(str, shapes))
        raise SceneError(f"{what} have shape {array.shape}, expected {expected}")
    check_finite(array, what, "vertex")
    return array


def check_color(
    value: Any, domain: str, count: int, faces: int, times: int, where: str
) -> tuple[Float32 | None, str]:
    """Colour with its domain made explicit: ``"face"`` (F, 3) or ``"vertex"`` (..., N, 3).

    Or 4 columns, the last of which is alpha.
    """
    what = f"{where}: color"
    domain = choice(domain, ("auto", "face", "vertex"), f"{where}: color_domain")
    if value is None:
        return None, domain
    array = numbers(value, np.float32, what)
    width = array.shape[-1] if array.ndim and array.shape[-1] == 4 else 3
    if array.shape == (width,):
        array, domain = np.broadcast_to(array, (faces, width)), "face"
    shapes: dict[str, list[tuple[int, ...]]]
    shapes = {
        "face": [(faces, width)],
        "vertex": [(count, width)] + [(times, count, width)] * (times > 1),
    }
    fitting = [key for key in shapes if domain in ("auto", key) and array.shape in shapes[key]]
    if not fitting:
        raise SceneError(
            f"{what} has shape {array.shape}, expected (3,), {(faces, 3)} per face or "
            f"{(count, 3)} per vertex; or 4 columns, the last being alpha"
        )
    if len(fitting) == 2:
        raise SceneError(
            f"{what} of shape {array.shape} fits both faces and vertices; "
            'give color_domain="face" or "vertex"'
        )
    given = value if np.shape(value) == array.shape else np.broadcast_to(value, array.shape)
    check_finite(array, what, "vertex" if fitting[0] == "vertex" else "face", given)
    alpha = array[..., 3:]
    if np.any((alpha < 0.0) | (alpha > 1.0)):
        wrong = alpha[(alpha < 0.0) | (alpha > 1.0)][0]
        raise SceneError(f"{what}: alpha is {wrong:g}, expected 0 to 1")
    return array, fitting[0]
