"""Meshes as what hangs on sources of motion, and where their vertices are on these' chords."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from mbinterval.exposure.shutter_times import WHOLE, Stretch, Window
from mbinterval.exposure.sources import Place, Source, spread
from mbinterval.exposure.true_motion import at_times, world_positions
from mbinterval.scene.deform import ALL, Index, MorphedSkin, Skin, cofactors
from mbinterval.scene.model import Mesh
from mbinterval.scene.transforms import Link, Mover, Opaque, chain_matrices, links_of

Float64 = NDArray[np.float64]

_VERTICES = 96
"""Vertices of a mesh that are followed, at most, beside the outermost ones."""
_POINTS = 256
"""Points of a mesh with few faces, inside of them too, since the middle of one may be seen."""
_MOMENTS = np.array([0.0, 0.5, 1.0])
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
        """Times between ``knots``, at which its chords' determinant passes through zero."""
        if not self.sources:
            return []
        matrices = self.carriers(knots, within)[:, 0, :3, :3]
        found = []
        ends = itertools.pairwise(zip(matrices, knots, strict=True))
        for (start, first), (end, last) in ends:
            for part in _zeros(start, end):
                time = float(np.float32(first + part * (last - first)))
                if within.open < time < within.close:
                    found.append(time)
        return sorted(set(found))


def _zeros(start: Float64, end: Float64) -> list[float]:
    """Where in [0, 1] the determinant of what is linear from ``start`` to ``end`` changes sign."""
    parts = np.array([0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0])
    values = np.linalg.det(start + parts[:, None, None] * (end - start))
    if not values.any():
        return []
    cubic = np.linalg.solve(np.vander(parts, 4, increasing=True), values / np.abs(values).max())
    roots = np.polynomial.polynomial.polyroots(cubic)
    real = np.sort(roots.real[np.abs(roots.imag) < 1e-9])
    inner = real[(real > 1e-9) & (real < 1.0 - 1e-9)]
    edges = np.concatenate([[0.0], inner, [1.0]])
    between = 0.5 * (edges[1:] + edges[:-1])
    middles = np.linalg.det(start + between[:, None, None] * (end - start))
    changes = middles[1:] * middles[:-1] < 0.0
    return [float(part) for part in inner[changes]]


class Bodies:
    """Meshes of a scene as bodies, and all sources of their motion, parents before children."""

    def __init__(self, window: Window, meshes: Sequence[Mesh]) -> None:
        self.window = window
        self._sources: dict[Hashable, Source] = {}
        self._places: dict[Hashable, Place] = {}
        self._skeletons = _skeletons(meshes)
        self._bodies = {id(mesh): self._made(mesh) for mesh in meshes}

    @property
    def sources(self) -> Iterable[Source]:
        """All sources, what hangs on others after these."""
        return self._sources.values()

    def of(self, mesh: Mesh) -> Body:
        """Return the body of one of the meshes."""
        return self._bodies[id(mesh)]

    def _made(self, mesh: Mesh) -> Body:
        timing = _Timing(mesh.own_shutter, mesh.motion_segments)
        skin, chains = skin_of(mesh), [links_of(mesh.transform)]
        if skin is not None:
            chains = [chains[0] + chain for chain in skin.joints.chains()]
        places = tuple(self._place(chain, timing) for chain in chains)
        sources = tuple(dict.fromkeys(p.source for p in places if p.source is not None))
        body = Body(mesh, self.window, places, sources)
        shape = self._shape(body, timing) if self._moves(timing) else None
        for place, points in _carried(body):
            self._carry(place, points)
        if shape is None:
            return body
        shape.followers.append(partial(_followed, body, _some_vertices(mesh)))
        return Body(mesh, self.window, places, (shape,))

    def _place(self, chain: Sequence[Link], timing: _Timing) -> Place:
        """Where the last of ``chain`` is: on the last source of its motion, or at rest."""
        runs: list[tuple[Hashable, list[Link]]] = [(None, [])]
        for link in chain:
            key = None
            if link.source is not None and self._moves(timing):
                key = self._skeletons.get(link, link.source)
            joins = key == runs[-1][0] and link in self._skeletons  # of one skeleton: one motion
            if key is None or joins:
                runs[-1][1].append(link)
            elif runs[-1][0] is None:
                runs[-1] = (key, [*runs[-1][1], link])
            else:
                runs.append((key, [link]))
        place = self._known((), lambda: Place(None, 0, np.eye(4)))
        for key, links in runs:
            place = self._on(place, key, tuple(links), timing)
        return place

    def _moves(self, timing: _Timing) -> bool:
        return timing.scale != 0.0 and not self.window.instant

    def _on(self, place: Place, key: Hashable, links: tuple[Link, ...], timing: _Timing) -> Place:
        """What ``links`` carry on top of ``place``, moved by the source that ``key`` names."""
        if key is None:
            return self._known((links, timing), lambda: Place(None, 0, self._rest(links, timing)))
        parents = () if place.source is None else (place.source,)
        source = self._source(parents, key, timing)
        member = source.member(place, links)
        return self._known((source, member), lambda: Place(source, member, np.eye(4)))

    def _known(self, name: Hashable, make: Callable[[], Place]) -> Place:
        if name not in self._places:
            self._places[name] = make()
        return self._places[name]

    def _rest(self, links: tuple[Link, ...], timing: _Timing) -> Float64:
        frames = self.window.frames(np.zeros(1), timing.scale)
        return np.asarray(chain_matrices([links], frames, self.window.frame)[0, 0])

    def _source(self, parents: tuple[Source, ...], key: Hashable, timing: _Timing) -> Source:
        name = (parents, key, timing)
        if name not in self._sources:
            self._sources[name] = Source(self.window, parents, timing.scale, timing.segments)
        return self._sources[name]

    def _shape(self, body: Body, timing: _Timing) -> Source | None:
        """The source of a mesh's own change of shape; None where it keeps its shape."""
        mesh = body.mesh
        if mesh.times > 1:
            source = self._source(body.sources, ("times", mesh.times), timing)
            parts = np.arange(mesh.times) / (mesh.times - 1)
            source.fixed = tuple(self.window.unscaled(parts, timing.scale).tolist())
            return source
        mover = _mover_of(mesh.deformer)
        if mover is None:
            return None
        source = self._source(body.sources, mover.source, timing)
        source.movers[mover] = None
        source.jumps.update(mover.jumps)
        return source

    def _carry(self, place: Place, points: Float64) -> None:
        """Have ``points`` ``(n, 3)`` in the space of ``place`` followed by all that moves them."""
        while place.source is not None:
            place.source.tracked.append((place.member, points))
            frames = place.source.frames(_MOMENTS, WHOLE)
            place, links = list(place.source.members)[place.member]
            own = chain_matrices([links], frames, self.window.frame)[:, 0]
            own = own[:1] if np.array_equal(own, np.broadcast_to(own[:1], own.shape)) else own
            moved = points @ own[:, :3, :3].mT + own[:, None, :3, 3]
            points = spread(moved.reshape(1, -1, 3), _POINTS)[0]


@dataclass(frozen=True)
class _Timing:
    """Time mapping of a mesh: the length of its shutter, and how many segments it states."""

    scale: float
    segments: int | None


def _followed(body: Body, which: Index, times: Float64, within: Stretch) -> Float64:
    return body.positions(times, within, which)


def skin_of(mesh: Mesh) -> Skin | None:
    """The skin that moves the mesh, if one does."""
    return mesh.deformer.skin if isinstance(mesh.deformer, MorphedSkin) else None


def _mover_of(deformer: Any) -> Mover | None:
    """What changes the shape that a mesh has beside its joints; None where nothing does."""
    if deformer is None:
        return None
    if not isinstance(deformer, MorphedSkin):
        return deformer if hasattr(deformer, "samples") else Opaque(deformer)
    weights = None if deformer.morph is None else deformer.morph.weights
    if weights is None or isinstance(weights, np.ndarray):
        return None
    mover: Any = weights if hasattr(weights, "samples") else Opaque(weights)
    return cast(Mover, mover)


def _skeletons(meshes: Iterable[Mesh]) -> dict[Link, Hashable]:
    """The nodes of each skeleton's joints and between them, as one source of motion each.

    What all joints hang on is left out. Skeletons that share nodes are one.
    """
    found: dict[Link, Hashable] = {}
    for mesh in meshes:
        skin = skin_of(mesh)
        if skin is None:
            continue
        chains = skin.joints.chains()
        common = 0
        while len({chain[common] if common < len(chain) - 1 else None for chain in chains}) == 1:
            if common >= min(map(len, chains)) - 1:
                break
            common += 1
        nodes = list(dict.fromkeys(link for chain in chains for link in chain[common:]))
        known = {found[node] for node in nodes if node in found}
        name = ("skeleton", nodes[0])
        found.update(dict.fromkeys(nodes, name))
        found.update({node: name for node, other in found.items() if other in known})
    return found


def _carried(body: Body) -> Iterable[tuple[Place, Float64]]:
    """Points ``(n, 3)`` of a mesh in the spaces of the places that carry them."""
    mesh, skin = body.mesh, skin_of(body.mesh)
    vertices = _some_vertices(mesh)
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
    yield place, local.positions(_MOMENTS, WHOLE, vertices).reshape(-1, 3)


_LEAST_WEIGHT = 0.02


def _some_vertices(mesh: Mesh) -> NDArray[np.integer[Any]]:
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
    vertices = _some_vertices(mesh)
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
