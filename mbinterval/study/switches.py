"""What takes each effect out of a scene, so that its cost can be measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from mbinterval.rendering.cube_maps import irradiance
from mbinterval.scene.model import Camera, Environment, Light, Material, Scene, Shutter, Vector
from mbinterval.scene.tracks import Track
from mbinterval.scene.transforms import Transform


def at_middle(values: Any) -> Any:
    """Of values at K+1 times over the shutter those at its middle."""
    last = len(values) - 1
    return 0.5 * (values[last // 2] + values[(last + 1) // 2])


def _still(scene: Scene, frame: float) -> Scene:
    meshes = []
    for mesh in scene.meshes:
        changed: dict[str, Any] = {"motion_blur": False}
        for name in ("positions", "normals", "uv", "color"):
            values = getattr(mesh, name)
            if values is not None and values.ndim == 3:
                changed[name] = at_middle(values)
        meshes.append(replace(mesh, **changed))
    return replace(_still_camera(scene, frame), meshes=meshes)


def _still_camera(scene: Scene, frame: float) -> Scene:
    camera = scene.camera
    if camera is None or not camera.animated:
        return scene
    names = ("position", "look_at", "up", "fov", "focal_length", "f_stop", "focus_distance")
    changed: dict[str, Any] = {}
    for name in names:
        value = getattr(camera, name)
        if isinstance(value, Track):
            at = value.at(frame)
            changed[name] = tuple(at.tolist()) if at.ndim else float(at)
    if camera.transform is not None:
        changed["transform"] = Transform(matrix=camera.transform.at(frame))
    return replace(scene, camera=replace(camera, **changed))


def _pinhole(scene: Scene, _frame: float) -> Scene:
    camera = replace(
        scene.camera or Camera(),
        f_stop=None,
        focus_distance=None,
        sharp_range=None,
        foreground_blur=None,
    )
    return replace(scene, camera=camera)


def _box_shutter(scene: Scene, _frame: float) -> Scene:
    return replace(scene, shutter=replace(scene.shutter, curve="box"))


def _global_shutter(scene: Scene, _frame: float) -> Scene:
    shutter = scene.shutter
    length = (shutter.line_exposure or 0.0) * scene.fps
    return replace(scene, shutter=Shutter(shutter.open, shutter.open + length, curve=shutter.curve))


def _with_materials(scene: Scene, **changed: Any) -> Scene:
    meshes = [
        replace(mesh, material=replace(mesh.material or Material(), **changed))
        for mesh in scene.meshes
    ]
    return replace(scene, meshes=meshes)


def _two_sided(scene: Scene, _frame: float) -> Scene:
    return _with_materials(scene, double_sided=True)


def _opaque(scene: Scene, _frame: float) -> Scene:
    return _with_materials(scene, alpha_mode="opaque")


def _dull(scene: Scene, _frame: float) -> Scene:
    return _with_materials(scene, reflectivity=0.0)


def _clear_mirrors(scene: Scene, _frame: float) -> Scene:
    return _with_materials(scene, reflection_shear=0.0)


def _unlit(scene: Scene, _frame: float) -> Scene:
    return _with_materials(scene, shading="unlit")


def _phong(scene: Scene, _frame: float) -> Scene:
    metallic = "metallic_roughness"
    meshes = [
        replace(mesh, material=replace(mesh.material, shading="phong"))
        if mesh.material is not None and mesh.material.shading == metallic
        else mesh
        for mesh in scene.meshes
    ]
    return replace(scene, meshes=meshes)


def _dark(scene: Scene, _frame: float) -> Scene:
    return _with_materials(scene, emission=(0.0, 0.0, 0.0))


def _no_point_lights(scene: Scene, _frame: float) -> Scene:
    lights: list[Light] = [light for light in scene.lights if light.kind not in ("point", "spot")]
    return replace(scene, lights=lights)


def _round_lights(scene: Scene, _frame: float) -> Scene:
    """Spot lights shine to all sides."""
    lights = [
        replace(light, kind="point") if light.kind == "spot" else light for light in scene.lights
    ]
    return replace(scene, lights=lights)


def _shadowless(scene: Scene, _frame: float) -> Scene:
    return replace(scene, lights=[replace(light, shadows=False) for light in scene.lights])


def _untextured(scene: Scene, _frame: float) -> Scene:
    return _with_materials(
        scene, texture=None, metallic_roughness_texture=None, emission_texture=None
    )


def _one_colour(scene: Scene, _frame: float) -> Scene:
    meshes = [replace(mesh, color=None, color_domain="auto") for mesh in scene.meshes]
    return replace(scene, meshes=meshes)


def _plain_background(scene: Scene, _frame: float) -> Scene:
    mean = np.mean(np.asarray(scene.background, np.float64), axis=(0, 1))
    return replace(scene, background=tuple(mean.tolist()))


def _from_above(environment: Environment) -> Vector:
    """The light that it sheds on a level floor."""
    red, green, blue = irradiance(environment, np.array([0.0, 1.0, 0.0])).tolist()
    return red, green, blue


def _no_environment(scene: Scene, _frame: float) -> Scene:
    around = scene.environment
    if around is None:
        return scene
    mean = _from_above(around)
    behind = mean if around.background else scene.background
    lights = [*scene.lights, Light("ambient", color=mean)]
    return replace(scene, environment=None, lights=lights, background=behind)


def _plain_sky(scene: Scene, _frame: float) -> Scene:
    around = scene.environment
    if around is None:
        return scene
    plain = replace(around, background=False)
    return replace(scene, environment=plain, background=_from_above(around))


def _no_reflections(scene: Scene, _frame: float) -> Scene:
    return replace(scene, meshes=[replace(mesh, reflections=None) for mesh in scene.meshes])


SWITCHES: dict[str, tuple[str, Callable[[Scene, float], Scene]]] = {
    "motion": ("everything as it is at the frame", _still),
    "camera motion": ("the camera as it is at the frame", _still_camera),
    "lens": ("a pinhole", _pinhole),
    "shutter curve": ("a shutter that is fully open throughout", _box_shutter),
    "rolling shutter": ("all lines exposed together, as long as one line was", _global_shutter),
    "single-sided": ("both sides of every surface seen", _two_sided),
    "transparency": ("alpha ignored", _opaque),
    "mirrors": ("surfaces that mirror nothing", _dull),
    "glossy mirrors": ("mirrors without shear", _clear_mirrors),
    "phong shading": ("colours without light", _unlit),
    "metallic-roughness shading": ("Phong's model instead", _phong),
    "emission": ("nothing glows", _dark),
    "point lights": ("without its point lights", _no_point_lights),
    "spot lights": ("point lights for its spot lights", _round_lights),
    "shadows": ("lights that shine through everything", _shadowless),
    "texture": ("without textures", _untextured),
    "vertex colour": ("one colour for each material", _one_colour),
    "background image": ("the background's mean colour", _plain_background),
    "light of the environment": ("light from all sides alike", _no_environment),
    "environment as background": ("one colour behind everything", _plain_sky),
    "reflections of surroundings": ("the environment alone mirrored", _no_reflections),
}
"""What takes each effect (of `mbinterval.plan.effects`) out of a scene: in words, and how."""
