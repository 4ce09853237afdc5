"""The meshes of a scene over one shutter: in each stretch of it, and once more in each mirror."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from mbinterval.exposure.focus import Copies, Focus
from mbinterval.exposure.limits import has_limits
from mbinterval.exposure.mesh_exposure import MeshExposure, expose_mesh
from mbinterval.exposure.mirrors import Mirror, seen_in
from mbinterval.exposure.poses import CameraPoses
from mbinterval.exposure.segments import View, choose_segments
from mbinterval.exposure.shutter_times import WHOLE, Stretch, Window, stretches
from mbinterval.scene.camera import Camera
from mbinterval.scene.model import Mesh
from mbinterval.scene.tracks import Track


@dataclass(eq=False)
class Worlds:
    """Exposes ``meshes``, by their place in the scene, as the camera of ``view`` sees them.

    Attributes
    ----------
    cameras
        Poses over the whole shutter by the number of segments; those in use are kept here.
    segments
        Of meshes that don't state their own; None is as many as ``error``, in pixels, asks for.
    light
        Greatest density of a pixel's light over the shutter; 1 if it is even.
    """

    meshes: Mapping[int, Mesh]
    view: View
    cameras: dict[int, CameraPoses]
    segments: int | None
    error: float
    light: float
    _left: dict[int, float] = field(default_factory=dict)

    def as_they_are(self) -> Iterator[MeshExposure]:
        """Yield the meshes as they are in the world."""
        for index, mesh in self.meshes.items():
            for stretch in mesh_stretches(mesh, self.view.window, self.view.camera):
                yield replace(self._expose(mesh, stretch), index=index)

    def with_mirrored(self, mirrors: tuple[Mirror, ...]) -> Iterator[MeshExposure]:
        """Yield the meshes and then, for each mirror, what is seen in it: all of them but itself.

        A mesh is cut alike and has as many segments in each mirror as outside, the most that any
        of these asks for, so that what is seen in mirrors is in the same place as what shades it.
        """
        worlds: list[list[MeshExposure]] = [[] for _ in range(len(mirrors) + 1)]
        focus = None
        if has_limits(self.view.camera):
            focus = Focus(self.view, mirrors, self.error, self.light)
        for index, mesh in self.meshes.items():
            number = next((n for n, mirror in enumerate(mirrors, 1) if mirror.index == index), 0)
            forms = {0: mesh} | {
                world: mirror.mesh(mesh)
                for world, mirror in enumerate(mirrors, start=1)
                if world != number
            }
            for stretch in mesh_stretches(mesh, self.view.window, self.view.camera):
                found = self._copies(forms, stretch)
                if focus is not None:
                    found, left = self._focused(focus, found, forms, stretch)
                    if left > 0.0:
                        self._left[index] = max(left, self._left.get(index, 0.0))
                for world, part in found.items():
                    part = replace(part, index=index, world=world, mirror=0 if world else number)
                    worlds[world] += seen_in(mirrors[world - 1], part) if world else [part]
        for parts in worlds:
            yield from parts

    def notes(self) -> list[str]:
        """Say it where cuts and segments don't suffice for a lens's limits."""
        if not self._left:
            return []
        worst = max(self._left, key=lambda index: self._left[index])
        name = self.meshes[worst].name or f"mesh {worst}"
        more = f" and {len(self._left) - 1} more" if len(self._left) > 1 else ""
        return [
            f"lens: where its limits begin, blur is up to {self._left[worst]:.2g} pixels off on "
            f"{name!r}{more}; motion_error={self.error:g} asks for more cuts or motion segments "
            "than are made"
        ]

    def _copies(self, forms: Mapping[int, Mesh], stretch: Stretch) -> Copies:
        """Expose ``forms`` of one mesh in as many segments each."""
        found = {world: self._expose(form, stretch) for world, form in forms.items()}
        most = max(found.values(), key=lambda part: part.segments)
        for world, part in found.items():
            if part.segments < most.segments:
                found[world] = self._expose_in(most.segments, most.reason, forms[world], stretch)
        return found

    def _focused(
        self, focus: Focus, copies: Copies, forms: Mapping[int, Mesh], stretch: Stretch
    ) -> tuple[Copies, float]:
        """Return ``copies`` as the lens's limits ask for, and the error where that is too much."""

        def again(count: int, reason: str) -> Copies:
            return {
                world: self._expose_in(count, reason, form, stretch)
                for world, form in forms.items()
            }

        return focus.keep(copies, again if self._chooses(forms[0]) else None)

    def _chooses(self, mesh: Mesh) -> bool:
        """Whether its motion segments are to be chosen."""
        return mesh.motion_segments is None and self.segments is None and self.error < np.inf

    def _expose(self, mesh: Mesh, stretch: Stretch) -> MeshExposure:
        """Expose ``mesh`` over ``stretch`` in the segments that its path asks for."""
        count, reason = mesh.motion_segments or (mesh.times - 1) or self.segments, "as asked for"
        if self._chooses(mesh):
            choice = choose_segments(mesh, self.view, stretch, self.error)
            count, reason = choice.segments, choice.reason
        return self._expose_in(count or 1, reason, mesh, stretch)

    def _expose_in(self, count: int, reason: str, mesh: Mesh, stretch: Stretch) -> MeshExposure:
        """Expose ``mesh`` in ``count`` segments; poses of the whole shutter are kept."""
        window = self.view.window
        if stretch != WHOLE:
            poses = self.view.poses(stretch.inside(stretch.ends(count), window))
        else:
            if count not in self.cameras:
                self.cameras[count] = self.view.poses(stretch.ends(count))
            poses = self.cameras[count]
        return expose_mesh(mesh, window, count, poses, stretch, reason)


def mesh_stretches(mesh: Mesh, window: Window, camera: Camera) -> list[Stretch]:
    """Stretches of the shutter in which ``mesh`` is visible and neither it nor the camera jumps."""
    jumps = window.times_of(camera.jumps) + window.times_of(mesh.jumps, mesh.own_shutter)
    if not isinstance(mesh.visible, Track):
        return stretches(jumps, [(0.0, 1.0)])
    changes = window.times_of(mesh.visible.jumps)
    bounds = sorted({0.0, *changes, 1.0})
    parts = itertools.pairwise(bounds)
    middles = window.frames((np.array(bounds[1:]) + bounds[:-1]) / 2.0)
    shown = [mesh.visible.at(float(frame)) > 0.0 for frame in middles]
    return stretches(jumps, [part for part, seen in zip(parts, shown, strict=True) if seen])
