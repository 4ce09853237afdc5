"""A scene's motion cut once: the camera, then every source of motion, then the meshes on them."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mbinterval.exposure.asked import Asked
from mbinterval.exposure.bodies import Body, some_points
from mbinterval.exposure.camera_path import View, camera_path, moves
from mbinterval.exposure.hierarchy import Hierarchy
from mbinterval.exposure.mesh_exposure import MeshExposure, expose_body
from mbinterval.exposure.mirrors import Mirror, reflected, seen_in
from mbinterval.exposure.poses import CameraPoses, bent_axes
from mbinterval.exposure.shutter_times import Stretch, stretches
from mbinterval.exposure.sources import Seeing, knots_of, nearest_of
from mbinterval.scene.model import Mesh
from mbinterval.scene.tracks import Track

Float64 = NDArray[np.float64]

_MOMENTS = np.linspace(0.0, 1.0, 5)
"""Times of the shutter at which it is looked how near to the eye things come."""


class Cut:
    """Motion of all ``meshes``, by their place in the scene, in segments that they share."""

    def __init__(self, view: View, meshes: Mapping[int, Mesh], asked: Asked) -> None:
        self.view, self.meshes, self.asked = view, meshes, asked
        self.hierarchy = Hierarchy(view.window, list(meshes.values()))
        self.levels = max((source.level for source in self.hierarchy.sources), default=0)
        self.path = camera_path(view, self._nearest(), asked, 1 + self.levels)
        self._poses: dict[tuple[bytes, Stretch], CameraPoses] = {}
        self.see_in(())

    def see_in(self, mirrors: Sequence[Mirror]) -> None:
        """Cut all sources, as they are seen in ``mirrors`` too."""
        matrices = np.array([mirror.matrix for mirror in mirrors]).reshape(-1, 4, 4)
        seeing = Seeing(self.path, self.view.aspect, self.view.height, matrices)
        for source in self.hierarchy.sources:
            source.cut(seeing, self.asked)

    def mirroring(self) -> Iterator[MeshExposure]:
        """Yield exposures of meshes whose material mirrors."""
        for index, mesh in self.meshes.items():
            if mesh.material is not None and mesh.material.reflectivity > 0.0:
                yield from self._mesh(index, mesh)

    def exposed(self, mirrors: Sequence[Mirror]) -> Iterator[MeshExposure]:
        """Yield all meshes and then, for each mirror, what is seen in it: all of them but itself.

        What is seen in mirrors has the knots of what it is the image of.
        """
        of = {mirror.index: number for number, mirror in enumerate(mirrors, start=1)}
        parts = [
            replace(part, mirror=of.get(index, 0))
            for index, mesh in self.meshes.items()
            for part in self._mesh(index, mesh)
        ]
        yield from parts
        for world, mirror in enumerate(mirrors, start=1):
            for part in parts:
                if part.mirror != world:
                    yield from seen_in(mirror, reflected(mirror, world, part))

    def notes(self) -> list[str]:
        """Say it where motion is not met as closely as asked for, and what of a camera is not."""
        found = []
        camera = self.view.camera
        left_out = bent_axes(camera, self.view.window.frame)
        if left_out:
            found.append(f"camera{f' {camera.name!r}' if camera.name else ''}: {left_out}")
        worst = self.path.deviation
        named = "the camera"
        for mesh in self.meshes.values():
            for source in self.hierarchy.of(mesh).sources:
                if source.deviation > worst:
                    worst, named = source.deviation, f"mesh {mesh.name!r}"
        if self.asked.segments is None and worst > self.asked.error:
            found.append(
                f"motion is off by up to {worst:.2g} pixels ({named}), more than "
                f"motion_error={self.asked.error:g}, with most_segments={self.asked.most} motion "
                "segments; raise that, and the frame takes so many times as long"
            )
        return found

    def _mesh(self, index: int, mesh: Mesh) -> Iterator[MeshExposure]:
        body = self.hierarchy.of(mesh)
        for stretch in self._stretches(body):
            knots = self._knots(body, stretch)
            turns = body.turns(knots, stretch)
            for part in _split(stretch, turns):
                inner = knots[(knots > part.open) & (knots < part.close)]
                times = np.concatenate([[part.open], inner, [part.close]])
                part_of = expose_body(body, part, times, self._seen(times, part), self._why(body))
                yield replace(part_of, index=index)

    def _stretches(self, body: Body) -> list[Stretch]:
        """Stretches of the shutter in which it is visible and neither it nor the camera jumps."""
        cuts = set(self.path.cuts)
        cuts.update(*(source.breaks(self.path) for source in body.sources))
        visible, window = body.mesh.visible, self.view.window
        if not isinstance(visible, Track):
            return stretches(cuts, [(0.0, 1.0)])
        bounds = sorted({0.0, *window.times_of(visible.jumps), 1.0})
        parts = itertools.pairwise(bounds)
        middles = window.frames((np.array(bounds[1:]) + bounds[:-1]) / 2.0)
        shown = visible.at(middles) > 0.0
        return stretches(cuts, [part for part, seen in zip(parts, shown, strict=True) if seen])

    def _knots(self, body: Body, stretch: Stretch) -> Float64:
        found = [self.path.knots(stretch), knots_of(body.sources, stretch)]
        segments = body.mesh.motion_segments or self.asked.segments
        if segments is not None and (self.path.moves or body.sources):
            found.append(stretch.knots(segments))
        found.append(np.array([stretch.open, stretch.close]))
        return np.unique(np.concatenate(found))

    def _seen(self, knots: Float64, stretch: Stretch) -> CameraPoses:
        """The camera at ``knots``, one object for all meshes that have the same."""
        key = knots.tobytes(), stretch
        if key not in self._poses:
            self._poses[key] = self.path.at(knots, stretch)
        return self._poses[key]

    def _why(self, body: Body) -> str:
        if (body.mesh.motion_segments or self.asked.segments) is not None:
            return "as asked for"
        if any(source.fixed for source in body.sources):
            return "its positions per time"
        left = self.path.deviation + sum(s.total for s in body.sources[:1])
        return f"off by {left:.2g} px at most" if left else ""

    def _nearest(self) -> float:
        """How near to the eye anything comes that is in frame; 1 where nothing is."""
        if not moves(self.view):
            return 1.0
        depths = [np.zeros(0)]
        poses = self.view.poses(_MOMENTS)
        reach = 0.5 * np.array([self.view.aspect, 1.0]) + 0.05
        for mesh in self.meshes.values():
            points = some_points(mesh, self.view.window, _MOMENTS)
            seen = (points - poses.eye[:, None]) @ poses.view.mT
            w = -seen[..., 2]
            with np.errstate(divide="ignore", invalid="ignore"):
                inside = (w > 0.0) & (np.abs(seen[..., :2]) / w[..., None] < reach).all(axis=-1)
            depths.append(w[inside])
        return nearest_of(np.concatenate(depths))


def _split(stretch: Stretch, turns: Sequence[float]) -> list[Stretch]:
    ends = [stretch.open, *turns, stretch.close]
    return [
        Stretch(a, b, stretch.after and a == stretch.open, stretch.before and b == stretch.close)
        for a, b in itertools.pairwise(ends)
    ]
