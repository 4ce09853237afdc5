"""Mirror planes: which meshes mirror, and what is seen in them as reflected copies of the rest.

What a plane mirror shows is what the eye would see through a window into a world that is reflected
in its plane (Diefenbach & Badler 1997, cited by Akenine-Möller et al. 2007, 4.3). So every mesh is
there once more for each mirror, reflected, and goes through the same stages as all else; kernels
tell it by the number of its world, and show it only behind its mirror. Its motion, its distance and
so the blur of a lens follow by themselves.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene import field_values

if TYPE_CHECKING:
    from mbinterval.exposure.mesh_exposure import MeshExposure
    from mbinterval.scene.model import Light, Mesh
    from mbinterval.scene.transforms import Placement

Float64 = NDArray[np.float64]

_FLATNESS = 1e-5
"""Of a mirror's size: how far its vertices may lie off its plane; files round to float32."""
_CONTACT = 1e-9
"""Likewise of a scene's size: what touches a mirror's plane is not behind it."""


@dataclass(frozen=True, eq=False)
class Mirror:
    """The plane of one mesh that mirrors, over one exposure.

    Attributes
    ----------
    index
        Which of the scene's meshes it is.
    point, normal
        Of the plane, in the world; the normal has length 1.
    reflectivity
        Share of the light that it shows of what it mirrors, above 0.
    shear
        Radius of the disc over which it spreads what is at distance 1 from it.
    """

    index: int
    name: str
    point: Float64
    normal: Float64
    reflectivity: float
    shear: float = 0.0

    @property
    def matrix(self) -> Float64:
        """The ``(4, 4)`` reflection in the plane; it acts on columns."""
        matrix = np.eye(4)
        matrix[:3, :3] -= 2.0 * np.outer(self.normal, self.normal)
        matrix[:3, 3] = 2.0 * (self.normal @ self.point) * self.normal
        return matrix

    @property
    def tangents(self) -> Float64:
        """Two orthogonal directions within the plane, as long as ``shear``: ``(2, 3)``."""
        across = np.cross(self.normal, np.eye(3)[np.argmin(np.abs(self.normal))])
        across /= np.linalg.norm(across)
        return self.shear * np.stack([across, np.cross(self.normal, across)])

    def heights(self, points: Float64) -> Float64:
        """Return signed distances of ``points`` ``(..., 3)`` from the plane."""
        return np.asarray((points - self.point) @ self.normal)

    def light(self, light: Light) -> Light:
        """Return ``light``, which is in the world, as what is seen in the mirror has it."""
        position = self.matrix @ np.append(light.position, 1.0)
        direction = self.matrix[:3, :3] @ np.asarray(light.direction)
        return replace(light, position=tuple(position[:3]), direction=tuple(direction))

    def mesh(self, mesh: Mesh) -> Mesh:
        """Return ``mesh`` as it is reflected."""
        return replace(mesh, transform=Reflected(self.matrix, mesh.transform))


@dataclass(frozen=True, eq=False)
class Reflected:
    """A place in the world over time, then reflected by ``matrix``; None is the world's origin."""

    matrix: Float64
    place: Placement | None

    @property
    def animated(self) -> bool:
        """Whether it may differ between frames."""
        return self.place is not None and self.place.animated

    @property
    def jumps(self) -> list[float]:
        """Frames at which it may jump."""
        return [] if self.place is None else self.place.jumps

    def at(self, frame: float, base: float | None = None) -> Float64:
        """The ``(4, 4)`` matrix that maps to world space at ``frame``; it acts on columns."""
        return self.matrix if self.place is None else self.matrix @ self.place.at(frame, base)


def find_mirrors(meshes: Sequence[MeshExposure]) -> tuple[Mirror, ...]:
    """Return the mirrors among ``meshes`` in order, each once, whatever stretches it is seen in."""
    found: dict[int, list[MeshExposure]] = {}
    for mesh in meshes:
        if mesh.mesh.material is not None and mesh.mesh.material.reflectivity > 0.0:
            found.setdefault(mesh.index, []).append(mesh)
    return tuple(_mirror_of(parts) for parts in found.values())


def _mirror_of(parts: Sequence[MeshExposure]) -> Mirror:
    """Return the mirror that one mesh is; refuse one that is not flat, or whose plane moves."""
    mesh = parts[0].mesh
    where, material = field_values.named("mesh", mesh.name), mesh.material
    if material is None or material.alpha != "opaque":
        raise SceneError(
            f"{where}: a material with reflectivity is translucent too, which no mirror can be; "
            "leave opacity and alpha_mode out, or reflectivity"
        )
    used = np.unique(mesh.faces)
    corners = parts[0].positions[0][mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    largest = int(np.argmax(np.linalg.norm(normals, axis=1)))
    area = float(np.linalg.norm(normals[largest]))
    size = float(np.ptp(parts[0].positions[0][used], axis=0).max())
    if not area > 0.0:
        raise SceneError(
            f"{where}: its faces have no area, so that a mirror has no plane; leave reflectivity "
            "out of its material"
        )
    mirror = Mirror(
        index=parts[0].index,
        name=mesh.name,
        point=corners[largest, 0],
        normal=normals[largest] / area,
        reflectivity=material.reflectivity,
        shear=material.reflection_shear,
    )
    off = float(np.abs(mirror.heights(parts[0].positions[0][used])).max())
    if off > _FLATNESS * size:
        raise SceneError(
            f"{where}: its material has reflectivity, but its vertices lie up to {off:.3g} off one "
            "plane; mirrors are flat: make the flat part that mirrors an object of its own, or "
            "leave reflectivity out"
        )
    moved = max(float(np.abs(mirror.heights(part.positions[:, used])).max()) for part in parts)
    if moved > _FLATNESS * size:
        raise SceneError(
            f"{where}: the plane of this mirror moves while the shutter is open, by up to "
            f"{moved:.3g}; give it motion_blur = false, or leave reflectivity out of its material"
        )
    return mirror


def reflected(mirror: Mirror, world: int, part: MeshExposure) -> MeshExposure:
    """``part`` as it is in the ``world`` behind ``mirror``, seen from the back of its faces."""
    matrix = mirror.matrix
    normals = None if part.normals is None else part.normals @ matrix[:3, :3].T
    mesh = mirror.mesh(part.mesh)
    return replace(
        part,
        mesh=replace(mesh, faces=mesh.faces[:, ::-1]),
        positions=part.positions @ matrix[:3, :3].T + matrix[:3, 3],
        normals=normals,
        world=world,
        mirror=0,
    )


def seen_in(mirror: Mirror, copy: MeshExposure) -> Iterator[MeshExposure]:
    """Yield a reflected ``copy`` without the faces that stand before the mirror, if any are left.

    They do where the eye stays on one side of the plane, and they on the same.
    """
    sides = np.sign(mirror.heights(copy.poses.eye))
    if np.any(sides != sides[0]) or sides[0] == 0.0:
        yield copy
        return
    heights = sides[0] * mirror.heights(copy.positions)
    behind = (heights < -_CONTACT * np.abs(heights).max(initial=0.0)).any(axis=0)
    keep = behind[copy.mesh.faces].any(axis=1)
    if keep.all():
        yield copy
    elif keep.any():
        mesh, by_face = copy.mesh, copy.mesh.color_domain == "face"
        color = mesh.color[keep] if mesh.color is not None and by_face else mesh.color
        face_color = None if copy.face_color is None else copy.face_color[keep]
        kept = replace(mesh, faces=mesh.faces[keep], color=color)
        yield replace(copy, mesh=kept, face_color=face_color)
