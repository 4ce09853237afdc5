"""Motion cut into segments along parabolas, for ``tests/reports/quadratic_motion.py``."""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

import mbinterval as mb
from mbinterval.exposure import camera_path, sources
from mbinterval.exposure.asked import Asked
from mbinterval.exposure.exposure import Exposure, expose
from mbinterval.exposure.knots import Chosen, Followed, choose_knots
from mbinterval.exposure.mesh_exposure import MeshExposure
from mbinterval.exposure.poses import pixel_matrix

SCENES = Path(__file__).resolve().parents[2] / "scenes"
FRAME = 12.0


def middle_of(times: np.ndarray, first: int, last: int) -> int:
    """The sample between ``first`` and ``last`` that is nearest to the middle of their times."""
    off = np.abs(times[first + 1 : last] - 0.5 * (times[first] + times[last]))
    return first + 1 + int(np.argmin(off))


class Parabolas(Followed):
    """A motion whose segments are parabolas and not chords."""

    def _chord(self, first: int, inner: slice, last: int) -> np.ndarray:
        if last - first < 2:
            return super()._chord(first, inner, last)
        places = (first, middle_of(self.times, first, last), last)
        found = np.zeros_like(self.values[inner])
        for k in places:
            others = [self.times[i] for i in places if i != k]
            share = np.prod([(self.times[inner] - t) / (self.times[k] - t) for t in others], axis=0)
            found += share.reshape(-1, *(1,) * (found.ndim - 1)) * self.values[k]
        return found


class Cutter:
    """Takes the place of `choose_knots`: cuts parabolas, and leaves the motion as it truly is."""

    def __init__(self) -> None:
        self.camera, self.all = {0.0, 1.0}, {0.0, 1.0}

    def choose(self, camera: bool, followed: Followed, fixed: Any, *rest: Any) -> Chosen:
        times = followed.times
        own = [0, *(k for k in fixed if times[k] in self.all), len(times) - 1]
        knots = times[choose_knots(Parabolas(**vars(followed)), own, *rest).knots]
        self.all.update(knots)
        self.camera.update(knots if camera else ())
        return Chosen(np.arange(len(times)), 0.0)

    def knots_of(self, mesh: MeshExposure) -> np.ndarray:
        """Places of a mesh's knots in its times, which are all samples."""
        knots = self.all if len(mesh.positions) > 1 else self.camera
        return np.flatnonzero(np.isin(mesh.knots, list(knots)))


def exposed(name: str, size: tuple[int, int], cutter: Cutter | None = None) -> Exposure:
    """A shipped scene, cut as the product does, to 0.1 pixels; with a ``cutter``, uncut."""
    scene = mb.load(str(SCENES / f"{name}.toml"))
    asked = Asked(error=0.1, most=1 << 20)
    of_source, of_camera = (partial(cutter.choose, c) if cutter else choose_knots for c in (0, 1))
    with (
        mock.patch.object(sources, "choose_knots", of_source),
        mock.patch.object(camera_path, "choose_knots", of_camera),
    ):
        return expose(scene, FRAME, size[0] / size[1], asked, lines=size[1], height=size[1])


def curves(
    mesh: MeshExposure, size: tuple[int, int], cutter: Cutter | None
) -> tuple[np.ndarray, np.ndarray]:
    """Control points ``(P, 2 or 3, 3, 3)`` of faces in homogeneous pixels, and ``paths``."""
    seen = mesh.positions - mesh.poses.eye[:, None]
    points = (seen @ (pixel_matrix(*size) @ mesh.poses.view).mT)[:, mesh.mesh.faces]
    knots = cutter.knots_of(mesh) if cutter else np.arange(len(points))
    controls = [points[knots[:-1]], points[knots[1:]]]
    if cutter:
        middles = [middle_of(mesh.knots, *k) for k in pairwise(knots)]
        ends, middle = mesh.knots[knots], mesh.knots[middles]
        t = ((middle - ends[:-1]) / np.diff(ends))[:, None, None, None]
        bent = points[middles] - (1.0 - t) ** 2 * controls[0] - t**2 * controls[1]
        controls.insert(1, bent / (2.0 * t * (1.0 - t)))
    found = np.stack(controls, axis=2)
    paths = np.zeros((*found.shape[:2], 4), np.float32)
    paths[..., 0], paths[..., 1] = mesh.knots[knots[:-1], None], mesh.knots[knots[1:], None]
    paths[..., 2] = single = mesh.mesh.material is not None and not mesh.mesh.material.double_sided
    found, paths = found.reshape(-1, *found.shape[2:]), paths.reshape(-1, 4)
    kept = (found[..., 2] > 0.0).all(axis=(1, 2))
    if single:
        kept &= (np.linalg.det(found) < 0.0).any(axis=1)
    return found[kept], paths[kept]
