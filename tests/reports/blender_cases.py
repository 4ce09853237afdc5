"""The scenes of the comparison with Blender, and what each of them is for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from blender_handover import plain

import mbinterval as mb
from mbinterval.scene.generators import blades, fast_cubes

SCENES = Path(__file__).resolve().parents[2] / "scenes"


@dataclass(frozen=True)
class Case:
    """A scene, the frame of it, what it shows, and which of its meshes stay mirrors."""

    make: Callable[[], mb.Scene]
    frame: float
    shows: str
    mirrors: tuple[str, ...] = ()

    def scene(self) -> mb.Scene:
        """What of it both renderers can show."""
        return plain(self.make(), self.mirrors)


def shipped(name: str) -> Callable[[], mb.Scene]:
    """What reads a scene of ``scenes/``."""
    return lambda: mb.load(SCENES / f"{name}.toml")


def cubes_out_of_focus() -> mb.Scene:
    """Fast cubes, and a lens so open that most are out of focus."""
    scene = fast_cubes(150, seed=3)
    camera = mb.Camera(position=(0.0, 0.0, 16.0), fov=40.0, f_stop=0.05, focus_distance=18.0)
    return replace(scene, camera=camera)


def through_cubes() -> mb.Scene:
    """The camera flies through fast cubes, and into some, and turns by 45 degrees meanwhile."""
    scene = fast_cubes(60, seed=5, double_sided=True)
    times = np.array([0.75, 1.25])
    camera = mb.Camera(
        position=mb.Track(times, np.array([[-3.0, 0.0, 6.0], [2.0, 1.0, -2.0]])),
        look_at=mb.Track(times, np.array([[-5.0, 0.0, -9.0], [8.0, 0.0, -10.0]])),
        fov=70.0,
    )
    return replace(scene, camera=camera)


def under_the_sun(name: str) -> mb.Scene:
    """A shipped scene without lamps: Cycles asks one light at a time, by chance."""
    scene = mb.load(SCENES / f"{name}.toml")
    lights = [light for light in scene.lights if light.kind in ("ambient", "directional")]
    return replace(scene, lights=lights)


def shadows_of_the_sun() -> mb.Scene:
    """One blade of the fan is thinner than the other, so that no surfaces coincide."""
    scene = under_the_sun("shadows")
    meshes = [
        replace(mesh, positions=mesh.positions * [1.0, 0.8, 1.0])
        if mesh.name == "other blades"
        else mesh
        for mesh in scene.meshes
    ]
    return replace(scene, meshes=meshes)


CASES = {
    "fast cubes": Case(lambda: fast_cubes(400), 1, "cubes that fly and turn, unlit"),
    "through cubes": Case(through_cubes, 1, "a camera that flies into cubes and turns by 45°"),
    "cubes out of focus": Case(cubes_out_of_focus, 1, "a round open lens before fast cubes"),
    "blades": Case(blades, 1, "thin blades of a wheel that turns, unlit"),
    "crossing depth": Case(shipped("crossing_depth"), 1, "panels that pass through each other"),
    "rolling wheel": Case(shipped("rolling_wheel"), 12, "a turning wheel, texture, sun"),
    "propeller": Case(shipped("propeller"), 12, "a rolling shutter, sun"),
    "milk truck": Case(shipped("milk_truck"), 7, "a hierarchy of nodes, textures, sun"),
    "running fox": Case(shipped("running_fox"), 12, "a skin, texture, sun"),
    "walking fox": Case(shipped("walking_fox"), 12, "a skin, a camera that swings, sun"),
    "fly-by": Case(shipped("fly_by"), 12, "a camera that moves and zooms, point light"),
    "lanterns": Case(shipped("lanterns"), 6, "a lens of six blades, a marble that rolls"),
    "glass": Case(shipped("glass"), 6, "layers of opacity, a tested alpha, sun"),
    "shadows": Case(shadows_of_the_sun, 6, "shadows of the sun, through a pane too"),
    "mirror": Case(shipped("mirror"), 7, "a flat mirror", mirrors=("mirror",)),
    "metals": Case(lambda: under_the_sun("metals"), 6, "highlights of white metals (GGX), sun"),
}
