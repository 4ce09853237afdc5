"""Meshes as what hangs on sources of motion, and where their vertices are on these' chords."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.exposure.shutter_times import WHOLE, Stretch, Window
from mbinterval.exposure.sources import Place, Source
from mbinterval.exposure.true_motion import at_times, world_positions
from mbinterval.scene.deform import ALL, Index, MorphedSkin, Skin, cofactors
from mbinterval.scene.model import Mesh

Float64 = NDArray[np.float64]

_VERTICES = 96
"""Vertices of a mesh that are followed, at most, beside the outermost ones."""
_POINTS = 256
"""Points of a mesh with few faces, inside of them too, since the middle of one may be seen."""
MOMENTS = np.array([0.0, 0.5, 1.0])
"""At which points of what moves by itself are noted for what it hangs on."""


@dataclass(frozen=True, eq=False)
class Body:
    """A mesh, the ``sources`` that move it, none if it rests, and the ``places`` that carry it.

    There is one place, or one for each joint of its skin.
    """

    mesh: Mesh
    window: Window
    places: tuple[Place, ...]
    sources: tuple[Source, ...]

    def own_times(self, times: Float64, within: Stretch) -> Float64:
        """Times of its own shutter at ``times`` of the scene's, clear of jumps."""
        inside = within.inside(times, self.window)
        return self.window.scaled(inside, self.mesh.own_shutter)

    def frames(self, times: Float64, within: Stretch) -> Float64:
        """Frames at which its own shape is evaluated at ``times``."""
        return self.window.frames(within.inside(times, self.window), self.mesh.own_shutter)

    def matrices(self, times: Float64, within: Stretch) -> Float64:
        """World matrices ``(T, J, 4, 4)`` of its places, on the chords."""
        known: dict[Source, Float64] = {}
        found = []
        for place in self.places:
            source = place.source
            if source is None:
                found.append(place.at(times, within))
                continue
            if source not in known:
                known[source] = source.matrices(times, within)
            found.append(known[source][:, place.member])
        return np.stack(found, axis=1)

    def carriers(self, times: Float64, within: Stretch) -> Float64:
        """``(T, J, 4, 4)``: what takes vertices to the world: of joints, from the bind pose."""
        matrices, skin = self.matrices(times, within), skin_of(self.mesh)
        return matrices if skin is None else matrices @ skin.joints.inverse_bind

    def positions(self, times: Float64, within: Stretch, which: Index = ALL) -> Float64:
        """World positions ``(T, n, 3)`` of its vertices, or of some: own shape on the chords."""
        with np.errstate(over="ignore", invalid="ignore"):  # who asks looks at the result
            carriers = self.carriers(times, within)
            points = self._shape(times, within, which)
            skin = skin_of(self.mesh)
            if skin is not None:
                return np.array(
                    [skin.moved(p, c, which) for p, c in zip(points, carriers, strict=True)]
                )
            matrix = carriers[:, 0]
            return np.asarray(points @ matrix[:, :3, :3].mT + matrix[:, None, :3, 3])

    def normals(self, times: Float64, within: Stretch) -> Float64:
        """World normals ``(T, N, 3)``, not normalized, by cofactors."""
        deformer, frames = self.mesh.deformer, self.frames(times, within)
        if deformer is None:
            normals = at_times(np.asarray(self.mesh.normals), self.own_times(times, within))
        else:
            of = deformer.shape_normals if isinstance(deformer, MorphedSkin) else deformer.normals
            given = [of(float(frame)) for frame in frames]
            normals = np.array([self.mesh.normals if value is None else value for value in given])
        with np.errstate(over="ignore", invalid="ignore"):  # who asks looks at the result
            carriers, skin = self.carriers(times, within), skin_of(self.mesh)
            if skin is not None:
                return np.array([skin.turned(n, c) for n, c in zip(normals, carriers, strict=True)])
            return np.asarray(normals @ cofactors(carriers[:, 0, :3, :3]).mT)

    def _shape(self, times: Float64, within: Stretch, which: Index) -> Float64:
        """Positions ``(T, n, 3)``, or ``(1, n, 3)``, before its places carry them."""
        deformer = self.mesh.deformer
        if deformer is None:
            return at_times(self.mesh.positions[..., which, :], self.own_times(times, within))
        frames, base = self.frames(times, within), self.window.frame
        if isinstance(deformer, MorphedSkin):
            return np.array([deformer.shape(float(frame), which) for frame in frames])
        return np.array([deformer.positions(float(frame), which, base) for frame in frames])

    def mirrored(self, times: Float64, within: Stretch) -> NDArray[np.bool_]:
        """``(T,)``: whether fronts become backs, on the chords."""
        found = np.linalg.det(self.carriers(times, within)[:, 0, :3, :3]) < 0.0
        deformer = self.mesh.deformer
        if deformer is None or isinstance(deformer, MorphedSkin):
            return np.asarray(found)
        inside_out = [deformer.mirrors(float(frame)) for frame in self.frames(times, within)]
        return np.asarray(found != np.array(inside_out))

    def turns(self, knots: Float64, within: Stretch) -> list[float]:
        """Times inside the stretch at which its chords' determinant changes its sign."""
        if not self.sources:
            return []
        matrices = self.carriers(knots, within)[:, 0, :3, :3]
        lengths = np.diff(knots)
        zeros = [
            knot + length * np.array(_zeros(start, end))
            for knot, length, start, end in zip(
                knots, lengths, matrices, matrices[1:], strict=False
            )
        ]
        signs = np.sign(np.linalg.det(matrices))
        if not any(map(len, zeros)) and (signs == signs[0]).all() and signs[0]:
            return []
        times = np.unique(np.concatenate([knots, *zeros]).astype(np.float32).astype(np.float64))
        found: list[float] = []
        before = 0.0
        for first, last in itertools.pairwise(times):
            middle = self.carriers(np.array([0.5 * (first + last)]), within)[0, 0, :3, :3]
            sign = float(np.sign(np.linalg.det(middle)))
            if sign * before < 0.0:
                found.append(float(first))
            before = sign or before
        return found


def _zeros(start: Float64, end: Float64) -> list[float]:
    """Zeros in [0, 1] of the determinant of what is linear from ``start`` to ``end``, a cubic."""
    parts = np.array([0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0])
    values = np.linalg.det(start + parts[:, None, None] * (end - start))
    if ((values > 0.0).all() and values.min() > 0.25 * values.max()) or not values.any():
        return []  # no cubic through such values comes near zero between them
    cubic = np.linalg.solve(np.vander(parts, 4, increasing=True), values / np.abs(values).max())
    roots = np.polynomial.polynomial.polyroots(cubic)
    real = roots.real[np.abs(roots.imag) < 1e-9]
    return [float(part) for part in np.sort(real) if 0.0 < part < 1.0]


def skin_of(mesh: Mesh) -> Skin | None:
    """The skin that moves the mesh, if one does."""
    return mesh.deformer.skin if isinstance(mesh.deformer, MorphedSkin) else None


def carried(body: Body) -> Iterable[tuple[Place, Float64]]:
    """Points ``(n, 3)`` of a mesh in the spaces of the places that carry them."""
    mesh, skin = body.mesh, skin_of(body.mesh)
    vertices = some_vertices(mesh)
    if skin is not None:
        rest = mesh.positions[vertices]
        indices, weights = skin.indices[vertices], skin.weights[vertices]
        for joint, place in enumerate(body.places):
            bound = ((indices == joint) & (weights > _LEAST_WEIGHT)).any(axis=1)
            if place.source is not None and bound.any():
                bind = skin.joints.inverse_bind[joint]
                yield place, rest[bound] @ bind[:3, :3].T + bind[:3, 3]
        return
    place = body.places[0]
    if place.source is None:
        return
    if mesh.deformer is None and mesh.times == 1:
        yield place, _with_inner(mesh, mesh.positions[vertices], vertices)
        return
    local = Body(mesh, body.window, (Place(None, 0, np.eye(4)),), ())
    yield place, local.positions(MOMENTS, WHOLE, vertices).reshape(-1, 3)


_LEAST_WEIGHT = 0.02


def some_vertices(mesh: Mesh) -> NDArray[np.integer[Any]]:
    """Vertices of faces: all, or of very many some, with the outermost ones."""
    used = np.flatnonzero(np.bincount(mesh.faces.ravel()))
    if len(used) <= _VERTICES:
        return used
    rest = mesh.positions[0] if mesh.positions.ndim == 3 else mesh.positions
    ways = np.array(list(np.ndindex(3, 3, 3))) - 1.0
    extremes = used[np.argmax(rest[used] @ ways.T, axis=0)]
    some = used[np.linspace(0, len(used) - 1, _VERTICES).astype(int)]
    return np.union1d(extremes, some)


def some_points(mesh: Mesh, window: Window, times: Float64) -> Float64:
    """Some true world positions ``(T, n, 3)`` of a mesh, inside of its faces too if it has few."""
    vertices = some_vertices(mesh)
    points = world_positions(mesh, window, times, vertices)
    inner = inner_points(mesh, _POINTS)
    if inner is None:
        return points
    corners, shares = inner
    return np.asarray(
        np.einsum("pc,tpcx->tpx", shares, points[:, np.searchsorted(vertices, corners)])
    )


def inner_points(mesh: Mesh, most: int) -> tuple[NDArray[np.integer[Any]], Float64] | None:
    """Points spread over the faces of a mesh that has few, since the middle of one may be seen.

    Corners ``(P, 3)`` and barycentric coordinates ``(P, 3)``; None where there is no room.
    """
    steps = 1
    while len(mesh.faces) * (steps + 2) * (steps + 3) // 2 <= most:
        steps += 1
    if steps == 1:
        return None
    grid = [(i, j, steps - i - j) for i in range(steps + 1) for j in range(steps + 1 - i)]
    corners = np.repeat(mesh.faces, len(grid), axis=0)
    return corners, np.tile(np.array(grid) / steps, (len(mesh.faces), 1))


def _with_inner(mesh: Mesh, points: Float64, vertices: NDArray[np.integer[Any]]) -> Float64:
    inner = inner_points(mesh, _POINTS)
    if inner is None:
        return points
    corners, shares = inner
    places = np.searchsorted(vertices, corners)
    return np.asarray(np.einsum("pc,pcx->px", shares, points[places]))
