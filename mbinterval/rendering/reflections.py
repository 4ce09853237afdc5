"""Pictures of what moving objects mirror: time-dependent environment cube maps.

After Akenine-Möller et al. 2007, 3.5. The six faces around the middle of an object are rendered for
each part of the shutter, by the method that the frame is rendered by: exact in time they are the
averages over that part, and point samples lie in it. The middle moves with the object, the object
itself is left out, and what is seen mirrors the environment alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.device.runtime import Runtime
from mbinterval.exposure.exposure import Exposure, Roll, reflecting
from mbinterval.exposure.mesh_exposure import MeshExposure
from mbinterval.exposure.shutter_times import Window
from mbinterval.layout.motion import in_order
from mbinterval.plan.plan import roll_lines
from mbinterval.plan.prepare import Prepared, prepare
from mbinterval.rendering.cube_maps import CubeMaps, gather
from mbinterval.rendering.panorama import add_environment
from mbinterval.scene.model import Camera, Reflections, Scene, Shutter
from mbinterval.scene.tracks import Track, Transform

if TYPE_CHECKING:
    from mbinterval.rendering.shared_steps import Pixels

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Render = Callable[[Prepared], "Pixels"]

_CURVE_VALUES = 129


def add_cube_maps(ready: Prepared, made: CubeMaps) -> Prepared:
    """Return the frame with cube maps, and who mirrors which of them."""
    exposure, motion = ready.exposure, ready.motion
    groups = {id(asked): 1 + index for index, asked in enumerate(reflecting(exposure))}
    meshes = motion.meshes.copy()
    if len(made.maps) > 1:
        meshes["map"] = [groups.get(id(mesh.mesh.reflections), 0) for mesh in in_order(exposure)]
    made_of: dict[str, Any] = {"maps": made.maps, "map_texels": made.texels}
    changed = replace(motion, meshes=meshes, places={**motion.places, **made_of})
    return replace(ready, motion=changed)


def surroundings(on: Runtime, scene: Scene, ready: Prepared, render: Render) -> list[Float32]:
    """Render what each object of a frame sees that asks for it: ``(times, 6, n + 1, n + 1, 3)``."""
    made = gather(on, ready.exposure.environment, [])
    return [
        _surroundings(made, scene, ready, render, asked, meshes)
        for asked, meshes in reflecting(ready.exposure).items()
    ]


def _surroundings(
    made: CubeMaps,
    scene: Scene,
    ready: Prepared,
    render: Render,
    asked: Reflections,
    meshes: Sequence[MeshExposure],
) -> Float32:
    exposure, plan = ready.exposure, ready.plan
    others = _others(scene, exposure, asked)
    settings = replace(plan.settings, aovs=(), transparent=False, statistics=False)
    lines = roll_lines(scene, plan.width, plan.height)
    middle = _middle(meshes, Window(exposure.frame, *scene.shutter.window(scene.fps, lines)))
    size = asked.size + 1
    faces = []
    for face in range(6):
        seen = prepare(
            replace(others, camera=face_camera(face, asked.size, *middle)),
            *(exposure.frame, size, size, settings),
            lines=lines,
            room=plan.memory,
        )
        pictures = []
        for part in _parts(seen.exposure, asked.times):
            one = add_environment(add_cube_maps(seen.exposed_as(part), made), exposure.environment)
            rgb = render(one).rgba[..., :3]
            pictures.append(rgb[:, ::-1] if face % 2 else rgb)
        faces.append(pictures)
    # Where one face sees no motion and another does, the still one has one picture for all times.
    times = max(map(len, faces))
    return np.stack([[face[part % len(face)] for face in faces] for part in range(times)])


def _others(scene: Scene, exposure: Exposure, asked: Reflections) -> Scene:
    """Return the scene without those that ``asked``; nothing else mirrors more than the sky."""
    around, background = exposure.environment, scene.background
    if not isinstance(background, tuple):
        background = tuple(np.asarray(background, np.float64).mean(axis=(0, 1)).tolist())
    return replace(
        scene,
        meshes=[
            replace(mesh, reflections=None)
            for mesh in scene.meshes
            if mesh.reflections is not asked
        ],
        lights=exposure.lights,
        background=background,
        environment=None if around is None else replace(around, background=True),
    )


def _parts(seen: Exposure, times: int) -> list[Exposure]:
    """Return the exposure of each part of the shutter, as lines of a shutter that rolls are."""
    rolls = seen.roll is not None
    if times == 1 or not any(mesh.segments for mesh in seen.meshes):
        return [replace(seen, roll=Roll(False, 0.0, 0.0, 1.0)) if rolls else seen]
    return [
        replace(
            seen,
            roll=Roll(False, part / times, 0.0, 1.0 / times),
            shutter=replace(
                seen.shutter, curve="box" if rolls else _part_of_curve(seen.shutter, part, times)
            ),
        )
        for part in range(times)
    ]


def _part_of_curve(shutter: Shutter, part: int, times: int) -> str | tuple[float, ...]:
    """Return the shutter's curve over a part of its time; where it is shut, a box."""
    if shutter.curve == "box":
        return "box"
    corners = shutter.keys()
    at = np.linspace(part / times, (part + 1) / times, _CURVE_VALUES)
    values = np.interp(at, corners[:, 0], corners[:, 1])
    return tuple(values.tolist()) if values.any() else "box"


def _middle(meshes: Sequence[MeshExposure], window: Window) -> tuple[Float64, Float64]:
    """Middle of the bounds of ``meshes`` over the shutter: frames ``(T,)``, places ``(T, 3)``."""
    times = np.linspace(0.0, 1.0, 1 + max(1, *(mesh.segments for mesh in meshes)))
    lows, highs = [], []
    for index in {mesh.index: None for mesh in meshes}:
        at: list[float] = []
        low: list[Float64] = []
        high: list[Float64] = []
        for mesh in (mesh for mesh in meshes if mesh.index == index):
            count = len(mesh.positions)
            at += np.linspace(mesh.open, mesh.close, count).tolist() if count > 1 else [mesh.open]
            low += list(mesh.positions.min(axis=1))
            high += list(mesh.positions.max(axis=1))
        lows.append([np.interp(times, at, axis) for axis in np.transpose(low)])
        highs.append([np.interp(times, at, axis) for axis in np.transpose(high)])
    middle = 0.5 * (np.min(lows, axis=0) + np.max(highs, axis=0))
    return window.frames(times), middle.T


def face_camera(face: int, size: int, frames: Float64, middle: Float64) -> Camera:
    """Return the camera of a face of a cube map, whose outermost pixels have their middle on edges.

    Those of the odd faces look along the negative axes, and see the columns in reverse order.
    """
    forward = np.eye(3)[face // 2] * (-1.0 if face % 2 else 1.0)
    up = -np.eye(3)[(face // 2 + 2) % 3]
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([np.cross(forward, up), up, -forward], axis=1)
    fov = 2.0 * np.degrees(np.arctan(1.0 + 1.0 / size))
    frames, first = np.unique(frames, return_index=True)
    moves = len(frames) > 1 and bool(np.any(middle != middle[0]))
    at = Track(frames, middle[first]) if moves else tuple(middle[0].tolist())
    return Camera(transform=Transform(translation=at, matrix=matrix), fov=fov)
