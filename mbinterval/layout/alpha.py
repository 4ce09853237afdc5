"""Alpha of meshes over an exposure: which triangles are translucent, and which everywhere alike.

Alpha is opacity times that of the texture and of the mesh's colour, as in glTF 2.0 (3.9.4).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mbinterval.exposure.mesh_exposure import MeshExposure
from mbinterval.layout.appearance import DEFAULT_MATERIAL


def face_alpha(mesh: MeshExposure) -> NDArray[np.float32]:
    """Return what ``Path.alpha`` is for the faces of ``mesh``: ``(F,)``, or ``()`` for all alike.

    1 is opaque, less is translucent, 0 is never seen. Below 0 alpha varies over the face, and this
    is minus the constant factor of it. A test of alpha that has one result is made here.
    """
    material = mesh.mesh.material or DEFAULT_MATERIAL
    if material.alpha == "opaque":
        return np.ones((), np.float32)
    factor = np.asarray(material.opacity, np.float32)
    if mesh.face_color is not None and mesh.face_color.shape[-1] == 4:
        factor = factor * mesh.face_color[:, 3]
    least = _least_varying(mesh)
    if material.alpha == "blend":
        return np.where((least < 1.0) & (factor > 0.0), -factor, factor)
    cutoff = np.float32(material.alpha_cutoff)
    mixed = (factor >= cutoff) & (factor * np.float32(least) < cutoff)
    return np.where(mixed, -factor, (factor >= cutoff).astype(np.float32))


def is_translucent(mesh: MeshExposure) -> bool:
    """Whether alpha of any face can be below 1."""
    return bool(np.any(face_alpha(mesh) < 1.0))


def varies(mesh: MeshExposure) -> bool:
    """Whether alpha varies over any face."""
    return bool(np.any(face_alpha(mesh) < 0.0))


def has_vertex_alpha(mesh: MeshExposure) -> bool:
    """Whether vertices have an alpha that counts."""
    return varies(mesh) and mesh.color is not None and mesh.color.shape[-1] == 4


def _least_varying(mesh: MeshExposure) -> float:
    """Least alpha of texture times vertices, from 0 to 1."""
    material = mesh.mesh.material
    texture = None if material is None else material.texture
    least = 1.0 if texture is None else float(np.clip(texture.alpha_range[0], 0.0, 1.0))
    if mesh.color is not None and mesh.color.shape[-1] == 4 and mesh.color.size:
        least *= float(mesh.color[..., 3].min())
    return least
