"""A scene frozen over one frame's shutter: world positions and camera poses at shutter times.

A scene is animated; an exposure is not. Everything after this file sees only the exposure, so
that every source of motion (keys, arrays per time, the camera) is treated alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene.camera import Camera, Shutter
from mbinterval.scene.framing import framing_camera, headlight
from mbinterval.scene.mesh_exposure import MeshExposure, Window, expose_mesh
from mbinterval.scene.model import Light, Scene, Vector
from mbinterval.scene.poses import CameraPoses, camera_poses

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]


@dataclass(frozen=True)
class Roll:
    """A rolling shutter: when each line is exposed, in the exposure's time, [0, 1].

    Line i, a row of pixels or, with ``columns``, a column, is open from ``start + i * step`` for
    ``length``.
    """

    columns: bool
    start: float
    step: float
    length: float


@dataclass(frozen=True, eq=False)
class Exposure:
    """What happens while the shutter is open, at one frame.

    ``cameras[K]`` holds the camera at K + 1 equally spaced times, for every K in use; ``camera`` is
    the animated one that they are poses of. ``notes`` say what had to be assumed.
    """

    frame: float
    meshes: tuple[MeshExposure, ...]
    camera: Camera
    cameras: Mapping[int, CameraPoses]
    camera_moves: bool
    lights: tuple[Light, ...]
    background: Vector | Float32
    shutter: Shutter
    roll: Roll | None
    notes: tuple[str, ...] = ()


def expose(
    scene: Scene,
    frame: float,
    aspect: float,
    motion_segments: int | None = None,
    lines: int = 1,
) -> Exposure:
    """Freeze ``scene`` over the shutter of ``frame``.

    ``aspect`` is the image's width over its height. ``motion_segments`` is the number for meshes
    that don't state their own (``Mesh.motion_segments`` or positions per time). ``lines`` is the
    number of lines of a rolling shutter, rows or columns of pixels.
    """
    notes = list(scene.notes)
    camera = scene.camera
    if camera is None:
        camera = framing_camera(scene)
        notes.append("no camera: one that frames the scene was made")
    window = Window(frame, *scene.shutter.window(scene.fps, lines))
    meshes = [mesh for mesh in scene.meshes if mesh.visible and len(mesh.faces)]
    wanted = [mesh.motion_segments or (mesh.times - 1) or motion_segments or 1 for mesh in meshes]
    cameras = {
        count: camera_poses(camera, window.frames(np.arange(count + 1) / max(count, 1)), aspect)
        for count in {0, 1, *wanted}
    }
    camera_moves = any(poses.moves for poses in cameras.values())
    lights = tuple(light.at(frame) for light in scene.lights)
    if not lights and any(m.material is None or m.material.shading != "unlit" for m in meshes):
        lights = headlight(cameras[0].rotation[0])
        notes.append("no lights: a headlight was added")
    exposed = tuple(
        expose_mesh(mesh, window, count, camera_moves)
        for mesh, count in zip(meshes, wanted, strict=True)
    )
    notes += _outside(scene, window)
    _check_scale(exposed, cameras[0].eye[0])
    return Exposure(
        frame=frame,
        meshes=exposed,
        camera=camera,
        cameras=cameras,
        camera_moves=camera_moves,
        lights=lights,
        background=scene.background,
        shutter=scene.shutter,
        roll=_roll(scene.shutter, scene.fps, lines),
        notes=tuple(notes),
    )


SCALES = (1e-30, 1e30)
"""Distances that can be rendered: their products must keep clear of the ends of float64."""


def _check_scale(meshes: tuple[MeshExposure, ...], eye: Float64) -> None:
    """Refuse vertices that are too far away, and scenes all of which is too near the eye."""
    low, high = SCALES
    size = 0.0
    for mesh in meshes:
        away = np.abs(mesh.positions - eye).max(axis=(0, 2), initial=0.0)
        size = max(size, float(away.max(initial=0.0)))
        if size > high:
            raise SceneError(
                f"mesh {mesh.mesh.name!r}: vertex {int(np.argmax(away))} is {away.max():.3g} from "
                f"the camera; at most {high:g} can be rendered: use larger units"
            )
    if 0.0 < size < low:
        raise SceneError(
            f"every vertex is within {size:.3g} of the camera; {low:g} is the least that can be "
            "rendered: use smaller units"
        )


def _outside(scene: Scene, window: Window) -> list[str]:
    """Say it where the whole shutter lies before or after the animation."""
    if scene.animation is None:
        return []
    first, last = scene.animation
    if window.frame + window.close > first and window.frame + window.open < last:
        return []
    return [
        f"frame {window.frame:g} is outside the animation that was read, "
        f"frames {first:g} to {last:g}"
    ]


def _roll(shutter: Shutter, fps: float, lines: int) -> Roll | None:
    if shutter.rolling is None:
        return None
    low, high = shutter.window(fps, lines)
    offset, exposure = shutter.line_offset or 0.0, shutter.line_exposure or 0.0
    step, length = offset * fps / (high - low), exposure * fps / (high - low)
    columns = shutter.rolling in ("left", "right")
    if shutter.rolling in ("up", "left"):  # the last line comes first
        return Roll(columns, step * (lines - 1), -step, length)
    return Roll(columns, 0.0, step, length)
