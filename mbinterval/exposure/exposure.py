"""A scene frozen over one frame's shutter: world positions and camera poses at shutter times.

A scene is animated; an exposure is not. Everything after this file sees only the exposure, so
that every source of motion (keys, arrays per time, the camera) is treated alike.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.exposure.asked import AS_FEW, Asked
from mbinterval.exposure.camera_path import CameraPath, View
from mbinterval.exposure.cut import Cut
from mbinterval.exposure.framing import framing_camera, headlight
from mbinterval.exposure.mesh_exposure import MeshExposure
from mbinterval.exposure.mirrors import Mirror, find_mirrors
from mbinterval.exposure.shutter_times import Window
from mbinterval.exposure.sky import Turning, turnings
from mbinterval.scene.camera import Camera, Shutter
from mbinterval.scene.environment import Environment, Reflections
from mbinterval.scene.model import Light, Mesh, Scene, Vector

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

    A mesh that is exposed in several stretches is in ``meshes`` once for each, and once more for
    each of the ``mirrors`` that it may be seen in, reflected. ``path`` is the camera over the
    shutter, by the chords that everything is seen along; ``camera`` is the animated one. ``sky`` is
    the camera for an ``environment`` that it sees. ``notes`` say what had to be assumed.
    """

    frame: float
    meshes: tuple[MeshExposure, ...]
    camera: Camera
    path: CameraPath
    lights: tuple[Light, ...]
    background: Vector | Float32
    shutter: Shutter
    roll: Roll | None
    mirrors: tuple[Mirror, ...] = ()
    notes: tuple[str, ...] = ()
    environment: Environment | None = None
    sky: tuple[Turning, ...] = ()


def expose(
    scene: Scene,
    frame: float,
    aspect: float,
    asked: Asked = AS_FEW,
    *,
    lines: int = 1,
    height: int = 1,
) -> Exposure:
    """Freeze ``scene`` over the shutter of ``frame``.

    ``aspect`` is the image's width over its height, ``height`` its height in pixels. ``asked``
    says how finely motion is cut; meshes may state a number of segments themselves
    (``Mesh.motion_segments``, positions per time). ``lines`` is the number of lines of a rolling
    shutter, rows or columns of pixels.
    """
    notes = list(scene.notes)
    camera = scene.camera
    if camera is None:
        camera = framing_camera(scene)
        notes.append("no camera: one that frames the scene was made")
    window = Window(frame, *scene.shutter.window(scene.fps, lines))
    if scene.shutter.rolling is not None and not window.open < window.close:
        raise SceneError(
            f"shutter: with fps={scene.fps:g} its lines take no time that numbers tell apart; "
            "give a longer line_exposure or line_offset"
        )
    view = View(camera, window, aspect, height)
    meshes = {
        index: mesh
        for index, mesh in enumerate(scene.meshes)
        if mesh.visible is not False and len(mesh.faces)
    }
    cut = Cut(view, meshes, asked)
    lights = tuple(light.at(frame) for light in scene.lights)
    materials = [mesh.material for mesh in meshes.values()]
    around = scene.environment
    if not lights and around is None and any(m is None or m.shading != "unlit" for m in materials):
        lights = headlight(cut.path.opening.rotation[0])
        notes.append("no lights: a headlight was added")

    mirrors = find_mirrors(list(cut.mirroring()))
    if mirrors:
        cut.see_in(mirrors)
    exposed = tuple(cut.exposed(mirrors))
    if not exposed:
        notes.append("no visible mesh: only the background is seen")
    notes += _outside(scene, window) + _without_mirrors(meshes.values()) + cut.notes()
    _check_scale(exposed, cut.path, lights)
    return Exposure(
        frame=frame,
        meshes=exposed,
        camera=camera,
        path=cut.path,
        lights=lights,
        background=scene.background,
        shutter=scene.shutter,
        roll=_roll(scene.shutter, scene.fps, lines),
        mirrors=mirrors,
        notes=tuple(notes),
        environment=around,
        sky=turnings(cut.path, aspect, height, asked)
        if around is not None and around.background
        else (),
    )


def mirrors_around(mesh: Mesh) -> bool:
    """Whether its material mirrors what is around it."""
    return mesh.material is not None and mesh.material.shading == "metallic_roughness"


def _without_mirrors(meshes: Iterable[Mesh]) -> list[str]:
    """Say it where reflections are asked for in vain."""
    names = [
        mesh.name for mesh in meshes if mesh.reflections is not None and not mirrors_around(mesh)
    ]
    if not names:
        return []
    more = f" and {len(names) - 1} more" if len(names) > 1 else ""
    return [f"mesh {names[0]!r}{more}: reflections need shading 'metallic_roughness'"]


def reflecting(exposure: Exposure) -> dict[Reflections, list[MeshExposure]]:
    """Meshes that mirror their surroundings, by what asks for it, in the order of the scene."""
    found: dict[Reflections, list[MeshExposure]] = {}
    for mesh in sorted(exposure.meshes, key=lambda mesh: mesh.index):
        asked = mesh.mesh.reflections
        if asked is not None and mesh.world == 0 and mirrors_around(mesh.mesh):
            found.setdefault(asked, []).append(mesh)
    return found


SCALES = (1e-30, 1e30)
"""Distances that can be rendered: their products must keep clear of the ends of float64."""
LIT_SCALES = (1e-15, 1e18)
"""Those with lights at a place: shading has squares of distances in float32."""


def _check_scale(
    meshes: tuple[MeshExposure, ...], path: CameraPath, lights: Sequence[Light]
) -> None:
    """Refuse what is too far away, at any time, and scenes all of which is too near the eye."""
    placed = [light for light in lights if light.kind in ("point", "spot")]
    low, high = LIT_SCALES if placed else SCALES
    lit = ", where a light has a place" if placed else ""
    size, eye, moving = 0.0, path.opening.eye[0], path.eyes
    for mesh in meshes:
        first, last = mesh.positions.min(axis=(0, 1)), mesh.positions.max(axis=(0, 1))
        eyes = np.concatenate([moving, mesh.poses.eye])
        away = max((last - eyes).max(), (eyes - first).max())
        size = max(size, (last - eye).max(), (eye - first).max())
        if away > high:
            farthest = eyes[np.argmax(np.maximum(last - eyes, eyes - first).max(axis=1))]
            far = np.abs(mesh.positions - farthest).max(axis=(0, 2))
            raise SceneError(
                f"mesh {mesh.mesh.name!r}: vertex {int(np.argmax(far))} is {away:.3g} from the "
                f"camera; at most {high:g} can be rendered{lit}: use larger units"
            )
    for number, light in enumerate(lights):
        away = np.abs(np.asarray(light.position) - moving).max()
        if light in placed and away > high:
            raise SceneError(
                f"light {number}: its position is {away:.3g} from the camera; at most {high:g} can "
                "be rendered: use larger units"
            )
    if 0.0 < size < low:
        raise SceneError(
            f"every vertex is within {size:.3g} of the camera; {low:g} is the least that can be "
            f"rendered{lit}: use smaller units"
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
