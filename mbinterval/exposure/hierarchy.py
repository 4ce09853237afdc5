"""How meshes hang on sources of motion: along the chains of their transforms and their joints'."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from mbinterval.exposure.bodies import MOMENTS, Body, carried, skin_of, some_vertices
from mbinterval.exposure.shutter_times import WHOLE, Stretch, Window
from mbinterval.exposure.sources import Place, Source, spread
from mbinterval.scene.deform import Index, MorphedSkin
from mbinterval.scene.model import Mesh
from mbinterval.scene.transforms import Link, Mover, Opaque, chain_matrices, links_of

Float64 = NDArray[np.float64]

_POINTS = 256
"""Points that are handed on to what a source hangs on, at most."""


class Hierarchy:
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
        for place, points in carried(body):
            self._carry(place, points)
        if shape is None:
            return body
        shape.followers.append(partial(_followed, body, some_vertices(mesh)))
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
            frames = place.source.frames(MOMENTS, WHOLE)
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
