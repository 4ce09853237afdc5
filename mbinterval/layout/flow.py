"""Optical flow: where the vertices of an exposure are in the frames before and after.

They are evaluated there by the animation's own rules, each frame with its own camera; what lies
between them follows perspective in the kernels (stage "moment").
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbinterval.exposure.camera_path import View
from mbinterval.exposure.exposure import Exposure
from mbinterval.exposure.shutter_times import Window
from mbinterval.exposure.true_motion import world_positions
from mbinterval.film.aovs import FLOWS
from mbinterval.layout.motion import Motion, in_order
from mbinterval.scene.model import Scene
from mbinterval.settings.settings import Settings


def add_flow(
    motion: Motion, scene: Scene, exposure: Exposure, settings: Settings, width: int, height: int
) -> Motion:
    """Return ``motion`` with ``places`` for the flows that ``settings`` ask for.

    Each is at the same time of the shutter as the moment itself, which must not roll.
    """
    times, meshes, places = np.array([settings.aov_time]), in_order(exposure), {}
    for name in FLOWS.keys() & set(settings.aovs):
        window = Window(exposure.frame + FLOWS[name], scene.shutter.open, scene.shutter.close)
        view = View(exposure.camera, window, width / height, height)
        parts = [np.zeros((0, 3))]
        for mesh in (exposed.mesh for exposed in meshes):
            points = world_positions(mesh, window, times)
            parts.append(view.pixels(points, times)[0])
        places[name] = np.concatenate(parts)
    return replace(motion, places=places)


def flow_notes(scene: Scene, settings: Settings) -> tuple[str, ...]:
    """Say it where a mesh has no motion from frame to frame to be seen."""
    if not set(FLOWS) & set(settings.aovs):
        return ()
    given = [mesh.name for mesh in scene.meshes if mesh.times > 1]
    if not given:
        return ()
    more = f" and {len(given) - 1} more" if len(given) > 1 else ""
    return (
        f"optical flow: mesh {given[0]!r}{more}: positions per time are the same in every frame, "
        "so that only the camera moves it from frame to frame",
    )
