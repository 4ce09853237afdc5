"""What is in focus depends neither on how a mesh is cut nor on its motion segments.

Between vertices, and between the knots of their motion, the kernels take the circle of confusion
times depth for linear. A lens with limits bends it (`mbinterval.exposure.limits`): so meshes are
cut there, and get more motion segments where their vertices pass a bend, until radii of blur are
within ``motion_error`` pixels of what they are at each point (`mbinterval.exposure.blur_errors`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from mbinterval.exposure.blur_errors import KnotErrors, knot_errors
from mbinterval.exposure.cuts import Cuts, Faces
from mbinterval.exposure.limits import Bends, bends_of
from mbinterval.exposure.mesh_exposure import MeshExposure
from mbinterval.exposure.mirrors import Mirror
from mbinterval.exposure.refine import Refined, refine
from mbinterval.exposure.segments import MOST_SEGMENTS, View
from mbinterval.exposure.sight import Sight, sight_of

Copies = dict[int, MeshExposure]
"""One mesh over one stretch of the shutter: itself, 0, and as mirrors show it, by their number."""

_SPACE, _TIME = 1.0 / 3.0, 2.0 / 3.0
"""Of the error that is allowed: cuts cost less than motion segments."""
_MOST_FACES = 1 << 20
"""That cuts make more of a mesh, in all its motion segments; a new vertex makes up to two."""
_TRIES, _STEP = 8, 1.125
"""How often more motion segments are tried, and how many times as many at least."""


@dataclass(frozen=True, eq=False)
class _Found:
    """How copies are cut; how far blur is off between knots, and the segments that call for."""

    refined: Refined
    late: float = 0.0
    wanted: int = 0


@dataclass(frozen=True, eq=False)
class Focus:
    """A lens with limits, the mirrors of its scene, and how far its blur may be off in pixels.

    ``light`` is the greatest density of a pixel's light over the shutter; 1 if it is even.
    """

    view: View
    mirrors: tuple[Mirror, ...]
    error: float
    light: float

    def keep(
        self, copies: Copies, again: Callable[[int, str], Copies] | None
    ) -> tuple[Copies, float]:
        """Return ``copies`` as they are to be rendered, and their error where it is too large yet.

        ``again`` exposes them with another number of motion segments, for a reason; None where
        that is not to be chosen.
        """
        before, found = copies[0], self._look(copies)
        first, given = found.late, max(before.mesh.times - 1, 1)
        for _ in range(_TRIES if again is not None else 0):
            count = -(-found.wanted // given) * given
            count = min(count, MOST_SEGMENTS // given * given)
            if again is None or count <= copies[0].segments:
                break
            copies = again(count, before.reason)
            found = self._look(copies)
            reason = f"blur within {found.late:.2g} px, {first:.2g} px with {before.segments}"
            copies = {
                world: replace(mesh, reason=f"{before.reason}; {reason}")
                for world, mesh in copies.items()
            }
        if found.refined.cuts is not None:
            faces, cuts = copies[0].mesh.faces, found.refined.cuts
            copies = {world: _cut(mesh, cuts, faces) for world, mesh in copies.items()}
        late = found.late if again is not None and found.late > _TIME * self.error else 0.0
        return copies, found.refined.error + late

    def _look(self, copies: Copies) -> _Found:
        sights = tuple(self._sight(world, mesh) for world, mesh in sorted(copies.items()))
        segments = copies[0].segments
        most = _MOST_FACES // max(segments, 1) // 2
        refined = refine(sights, copies[0].mesh.faces, _SPACE * self.error, most)
        if segments == 0:
            return _Found(refined)
        errors = KnotErrors()
        for (_, mesh), sight in zip(sorted(copies.items()), sights, strict=True):
            faces, shown = copies[0].mesh.faces, sight
            if refined.cuts is not None:
                faces, shown = refined.cuts.faces, sight.of(refined.cuts.extended(mesh.positions))
            errors = errors.most(knot_errors(shown, faces, self._between(sight, mesh)))
        limit = _TIME * self.error
        more = max(errors.more(limit), _STEP) if errors.error > limit else 1.0
        return _Found(refined, errors.error, ceil(min(segments * more, MOST_SEGMENTS)))

    def _sight(self, world: int, mesh: MeshExposure) -> Sight:
        mirror = self.mirrors[world - 1] if world else None
        return sight_of(mesh, self.view, self.light, mirror)

    def _between(self, sight: Sight, mesh: MeshExposure) -> Bends | None:
        """How the lens is in the middle of each segment; None for one that does not change."""
        bends = sight.bends
        if not any(np.ptp(values) for values in (bends.slope, bends.near, bends.far)):
            return None
        parts = (np.arange(mesh.segments) + 0.5) / mesh.segments
        poses = self.view.poses(mesh.open + parts * (mesh.close - mesh.open))
        return bends_of(self.view.camera, poses, self.view.height)


def _cut(mesh: MeshExposure, cuts: Cuts, faces: Faces) -> MeshExposure:
    """Return ``mesh`` with its faces cut as ``faces`` are, which mirrors turn round."""
    if not np.array_equal(mesh.mesh.faces, faces):
        cuts = replace(cuts, faces=cuts.faces[:, ::-1])
    face_color = None if mesh.face_color is None else mesh.face_color[cuts.parents]
    return replace(
        mesh,
        positions=cuts.extended(mesh.positions),
        normals=None if mesh.normals is None else cuts.extended(mesh.normals),
        uv=None if mesh.uv is None else cuts.extended(mesh.uv),
        color=None if mesh.color is None else cuts.extended(mesh.color),
        face_color=face_color,
        cuts=cuts,
    )
