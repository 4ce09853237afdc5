"""Motion paths in homogeneous pixel space, from an exposure of the scene.

A camera-space point is p = R (P - eye), the rows of R being the camera's axes. With w = -p_z,
f = focal * H, the homogeneous pixel is (x, y, w) = (f p_x + W/2 w, -f p_y + H/2 w, w), a linear
map: nothing is divided by w and nothing is clipped. Within motion segment k of K every vertex
moves linearly in this space; global time is t = (k + tau) / K.

In this space d = det(a, b, c) < 0 for a triangle that is seen from its front, the side from which
its vertices run counter-clockwise (x right, y down, and the determinant changes sign with y).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from mbinterval.exposure.exposure import Exposure
from mbinterval.exposure.mesh_exposure import MeshExposure
from mbinterval.exposure.poses import CameraPoses

UV, NORMAL, COLOR, ALPHA = slice(0, 2), slice(2, 5), slice(5, 8), slice(8, 9)
ATTRIBUTES = 9
"""Columns of attributes: uv, world normal, vertex colour and its alpha."""


@dataclass(frozen=True, eq=False)
class Paths:
    """P motion paths, ordered by mesh, face and segment; that order breaks ties of depth.

    Attributes
    ----------
    points
        ``(P, 2, 3, 3)``: end of the segment, vertex, (x, y, w).
    segment, segments
        ``(P,)`` k and K; K = 0 marks a static triangle, seen over the whole shutter.
    window
        ``(P, 2)`` times at which the path begins and ends.
    single_sided
        ``(P,)`` whether only the front is seen.
    color
        ``(P, 3)`` base colour times face colour.
    alpha
        ``(P,)`` opacity times the face colour's alpha; 1 where the material ignores it.
    opaque
        ``(P,)`` whether nothing behind it is ever seen through it.
    attributes
        ``(P, 2, 3, A)``; A = 0 where no mesh needs any, else ``ATTRIBUTES``.
    mesh
        ``(P,)`` index of the mesh in the exposure.
    """

    points: np.ndarray
    segment: np.ndarray
    segments: np.ndarray
    window: np.ndarray
    single_sided: np.ndarray
    color: np.ndarray
    alpha: np.ndarray
    opaque: np.ndarray
    attributes: np.ndarray
    mesh: np.ndarray

    def __len__(self) -> int:
        return len(self.points)

    def time(self, path: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Global time of local times ``tau`` of segments of ``path``."""
        first, last = self.window[path, 0], self.window[path, 1]
        return first + tau * (last - first)

    def local(self, path: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Local times in [0, 1] of global times ``t`` within segments of ``path``."""
        first, last = self.window[path, 0], self.window[path, 1]
        return np.clip((t - first) / (last - first), 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class Intervals:
    """I stretches of time [t0, t1) in which a path covers a sample.

    Attributes
    ----------
    sample, path
        ``(I,)`` indices.
    t
        ``(I, 2)`` global times.
    w
        ``(I, 2)`` depths at these times.
    attributes
        ``(I, 2, A)`` attributes at these times.
    """

    sample: np.ndarray
    path: np.ndarray
    t: np.ndarray
    w: np.ndarray
    attributes: np.ndarray = field(repr=False)

    def __len__(self) -> int:
        return len(self.path)

    def __getitem__(self, index: np.ndarray) -> Intervals:
        return Intervals(
            self.sample[index], self.path[index], self.t[index], self.w[index],
            self.attributes[index],
        )  # fmt: skip

    def depth(self, index: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Depth of intervals ``index`` at global times ``t``, linear between the ends."""
        (t0, t1), (w0, w1) = self.t[index].T, self.w[index].T
        return w0 + (t - t0) / (t1 - t0) * (w1 - w0)

    def values(self, index: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Attributes ``(M, A)`` of intervals ``index`` at global times ``t``, linear likewise."""
        t0, t1 = self.t[index].T
        first, last = self.attributes[index].transpose(1, 0, 2)
        return first + ((t - t0) / (t1 - t0))[:, None] * (last - first)

    def crossings(self, i: np.ndarray, j: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Times at which the depths of intervals i and j cross, each with its pair's index."""
        low = np.maximum(self.t[i, 0], self.t[j, 0])
        high = np.minimum(self.t[i, 1], self.t[j, 1])
        before = self.depth(i, low) - self.depth(j, low)
        after = self.depth(i, high) - self.depth(j, high)
        pair = np.flatnonzero((before < 0) & (after > 0) | (before > 0) & (after < 0))
        part = before[pair] / (before[pair] - after[pair])
        return pair, low[pair] + part * (high[pair] - low[pair])


def concatenate(parts: list[Intervals]) -> Intervals:
    """Join lists of intervals, ordered by sample, path and start."""
    names = ("sample", "path", "t", "w", "attributes")
    joined = Intervals(*(np.concatenate([getattr(p, name) for p in parts]) for name in names))
    return joined[np.lexsort((joined.t[:, 0], joined.path, joined.sample))]


def make_paths(
    points: np.ndarray,
    color: np.ndarray | None = None,
    single_sided: bool = False,
    segments: int = 1,
) -> Paths:
    """Paths of one segment from bare points ``(P, 2, 3, 3)``; for tests of single stages."""
    count = len(points)
    return Paths(
        points=np.asarray(points, dtype=np.float64),
        segment=np.zeros(count, dtype=np.int64),
        segments=np.full(count, segments),
        window=np.tile([0.0, 1.0], (count, 1)),
        single_sided=np.full(count, single_sided),
        color=np.ones((count, 3)) if color is None else np.asarray(color, dtype=np.float64),
        alpha=np.ones(count),
        opaque=np.ones(count, dtype=bool),
        attributes=np.zeros((count, 2, 3, 0)),
        mesh=np.zeros(count, dtype=np.int64),
    )


def paths_of(exposure: Exposure, width: int, height: int, attributes: bool | None = None) -> Paths:
    """Motion paths of everything in ``exposure``, for an image of ``width`` x ``height``.

    ``attributes`` forces them on or off; None makes them where a material calls for them.
    """
    meshes = exposure.meshes
    wanted = any(map(needs_attributes, meshes)) if attributes is None else attributes
    parts = [
        _mesh_paths(mesh, mesh.poses, index, (width, height), wanted)
        for index, mesh in enumerate(meshes)
    ]
    parts = parts or [make_paths(np.zeros((0, 2, 3, 3)))]
    names = Paths.__dataclass_fields__
    return Paths(**{name: np.concatenate([getattr(p, name) for p in parts]) for name in names})


def needs_attributes(mesh: MeshExposure) -> bool:
    """Whether anything but one flat colour per face is seen on ``mesh``."""
    material = mesh.mesh.material
    flat = material is not None and material.shading == "unlit" and material.texture is None
    return not flat or mesh.color is not None


def alpha_of(mesh: MeshExposure) -> tuple[np.ndarray, np.ndarray]:
    """Constant factor of the alpha of each face ``(F,)``, and whether the face is opaque."""
    count, material = len(mesh.mesh.faces), mesh.mesh.material
    mode = "opaque" if material is None else material.alpha_mode
    if mode == "auto":
        mode = "opaque" if material.opacity == 1.0 else "blend"
    if mode == "opaque":
        return np.ones(count), np.ones(count, dtype=bool)
    factor = np.full(count, material.opacity)
    if mesh.face_color is not None and mesh.face_color.shape[1] == 4:
        factor = factor * mesh.face_color[:, 3]
    least = factor
    if material.texture is not None:
        least = least * np.clip(material.texture.image[..., 3], 0, 1).min()
    if mesh.color is not None and mesh.color.shape[-1] == 4:
        least = least * mesh.color[..., 3].min()
    return factor, least >= (1.0 if mode == "blend" else material.alpha_cutoff)


def to_pixels(
    world: np.ndarray, poses: CameraPoses, index: int, width: int, height: int
) -> np.ndarray:
    """World points ``(N, 3)`` in homogeneous pixel space at pose ``index``."""
    x, y, z = height * ((world - poses.eye[index]) @ poses.view[index].T).T
    return np.stack([x - width / 2 / height * z, -y - z / 2, -z / height], 1)


def _mesh_paths(
    mesh: MeshExposure, poses: CameraPoses, index: int, size: tuple[int, int], attributes: bool
) -> Paths:
    faces, count = mesh.mesh.faces, max(mesh.segments, 1)
    ends = [min(time, mesh.segments) for time in range(count + 1)]
    world = [mesh.positions[min(time, len(mesh.positions) - 1)] for time in ends]
    pixels = [to_pixels(p, poses, t, *size)[faces] for p, t in zip(world, ends, strict=True)]
    values = [
        _attributes(mesh, time, p) if attributes else np.zeros((len(faces), 3, 0))
        for time, p in zip(ends, world, strict=True)
    ]
    material = mesh.mesh.material
    base = np.ones(3) if material is None else np.asarray(material.base_color)
    face_color = np.ones((len(faces), 3)) if mesh.face_color is None else mesh.face_color
    alpha, opaque = alpha_of(mesh)
    total = len(faces) * count
    return Paths(
        points=_per_segment(pixels),
        segment=np.tile(np.arange(count), len(faces)),
        segments=np.full(total, mesh.segments),
        window=np.tile(_windows(mesh), (len(faces), 1)),
        single_sided=np.full(total, material is not None and not material.double_sided),
        color=np.repeat(face_color[:, :3].astype(np.float64) * base, count, axis=0),
        alpha=np.repeat(alpha, count),
        opaque=np.repeat(opaque, count),
        attributes=_per_segment(values),
        mesh=np.full(total, index),
    )


def _windows(mesh: MeshExposure) -> np.ndarray:
    """Times ``(K, 2)`` at which segments begin and end; a static mesh is there all the time."""
    knots = mesh.knots if mesh.segments else mesh.knots[[0, -1]]
    return np.stack([knots[:-1], knots[1:]], axis=1)


def _per_segment(values: list[np.ndarray]) -> np.ndarray:
    """From K+1 arrays ``(F, 3, X)`` to ``(F * K, 2, 3, X)``, faces outermost."""
    pairs = np.stack([np.stack(pair, axis=1) for pair in pairwise(values)], axis=1)
    return pairs.reshape(pairs.shape[0] * pairs.shape[1], *pairs.shape[2:])


def _attributes(mesh: MeshExposure, time: int, world: np.ndarray) -> np.ndarray:
    """Attributes ``(F, 3, ATTRIBUTES)`` at shutter time ``time``; flat unit normals where none."""
    faces = mesh.mesh.faces
    result = np.zeros((len(faces), 3, ATTRIBUTES))
    result[..., COLOR] = result[..., ALPHA] = 1.0
    corners = world[faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(flat, axis=1, keepdims=True)
    result[..., NORMAL] = (flat / np.where(size > 0, size, 1.0))[:, None]
    for first, values in ((UV, mesh.uv), (NORMAL, mesh.normals), (COLOR, mesh.color)):
        if values is not None:
            columns = slice(first.start, first.start + values.shape[-1])
            result[..., columns] = values[min(time, len(values) - 1)][faces]
    return result
