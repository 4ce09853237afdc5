"""A scene that `blender_handover` wrote, rendered by Blender's Cycles: runs in Python with bpy.

    PYTHON tests/reports/blender_render.py FOLDER

Reads ``scene.json`` and ``arrays.npz`` of FOLDER and writes ``SEED.exr`` there for each seed, the
frame that Cycles makes of it: film transparent, colour scene-linear and premultiplied. The shutter
is open from Blender's frame 1 on for SHUTTER frames, since Blender joins keys that are less than a
hundredth of a frame apart; motion is keyed at the steps at which Cycles looks at it, and linear
between them. Nothing of mbinterval is imported.
"""

from __future__ import annotations

import json
import math
import struct
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from blender_materials import image, make_material
from mathutils import Matrix

SHUTTER = 128.0


def load(folder: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """What was handed over."""
    with np.load(folder / "arrays.npz") as file:
        arrays = {name: file[name] for name in file.files}
    return json.loads((folder / "scene.json").read_text(encoding="utf-8")), arrays


def make_mesh(
    given: dict[str, Any], arrays: dict[str, np.ndarray], key: str, mirrored: bool
) -> Any:
    """A mesh at its first time as an object; ``mirrored`` says whether mirrors show it."""
    faces = arrays[f"{key}.faces"]
    mesh = bpy.data.meshes.new(given["name"] or key)
    mesh.from_pydata(arrays[f"{key}.positions"][0].tolist(), [], faces.tolist())
    if f"{key}.uv" in arrays:
        layer = mesh.uv_layers.new(name="uv")
        uv = arrays[f"{key}.uv"][faces].reshape(-1)
        layer.uv.foreach_set("vector", uv.astype(np.float32))
    if f"{key}.color" in arrays:
        layer = mesh.attributes.new("color", "FLOAT_COLOR", "CORNER")
        layer.data.foreach_set("color", arrays[f"{key}.color"].astype(np.float32).ravel())
    mesh.update()
    if f"{key}.normals" in arrays:
        mesh.shade_smooth()
        normals = arrays[f"{key}.normals"]
        mesh.normals_split_custom_set_from_vertices(
            (normals / np.linalg.norm(normals, axis=1, keepdims=True)).tolist()
        )
    made = bpy.data.objects.new(given["name"] or key, mesh)
    bpy.context.scene.collection.objects.link(made)
    made.visible_diffuse = False  # what glows lights nothing
    made.visible_glossy = mirrored
    return made


def frames(count: int) -> list[float]:
    """Blender's frames of ``count`` equally spaced times of the shutter."""
    return [1.0 + SHUTTER * k / (count - 1) for k in range(count)]


def straighten(made: Any) -> None:
    """Let keys be joined by straight lines; Blender's own are curved."""
    for layer in made.animation_data.action.layers:
        for bag in (bag for strip in layer.strips for bag in strip.channelbags):
            for key in (key for curve in bag.fcurves for key in curve.keyframe_points):
                key.interpolation = "LINEAR"


def key_matrices(made: Any, matrices: np.ndarray) -> None:
    """Keys for a rigid motion, ``(T, 4, 4)`` over the shutter."""
    made.rotation_mode = "QUATERNION"
    before = None
    for frame, matrix in zip(frames(len(matrices)), matrices, strict=True):
        place, turn, _size = Matrix(matrix.tolist()).decompose()
        if before is not None and before.dot(turn) < 0.0:
            turn.negate()
        made.location, made.rotation_quaternion, before = place, turn, turn.copy()
        for path in ("location", "rotation_quaternion"):
            made.keyframe_insert(path, frame=frame)
    straighten(made)


def key_points(made: Any, positions: np.ndarray, path: Path) -> None:
    """Vertices from a point cache ``(T, N, 3)`` over the shutter."""
    times, count = positions.shape[:2]
    head = struct.pack("<12siiffi", b"POINTCACHE2\0", 1, count, 0.0, 1.0, times)
    path.write_bytes(head + positions.astype("<f4").tobytes())
    cache = made.modifiers.new("points", "MESH_CACHE")
    cache.cache_format, cache.filepath = "PC2", str(path)
    cache.interpolation, cache.play_mode, cache.time_mode = "LINEAR", "CUSTOM", "FRAME"
    cache.forward_axis, cache.up_axis = "POS_Y", "POS_Z"
    for frame, row in zip(frames(2), (0.0, times - 1.0), strict=True):
        cache.eval_frame = row
        cache.keyframe_insert("eval_frame", frame=frame)
    straighten(made)


def make_light(given: dict[str, Any]) -> None:
    """A light without extent; white that faces a light of colour 1 has colour 1 in mbinterval."""
    point = given["kind"] == "point"
    light = bpy.data.lights.new(given["kind"], "POINT" if point else "SUN")
    largest = max(given["color"]) or 1.0
    light.color = [value / largest for value in given["color"]]
    light.energy = largest * given["intensity"] * (4.0 * math.pi**2 if point else math.pi)
    light.use_shadow = given["shadows"]
    made = bpy.data.objects.new(given["kind"], light)
    if point:
        light.shadow_soft_size = 0.0
        made.location = given["position"]
    else:
        light.angle = 0.0
        made.rotation_mode = "QUATERNION"
        made.rotation_quaternion = Matrix(given["matrix"]).to_quaternion()
    bpy.context.scene.collection.objects.link(made)


def make_camera(given: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    """The camera, with its lens and its motion."""
    camera = bpy.data.cameras.new("camera")
    made = bpy.data.objects.new("camera", camera)
    scene = bpy.context.scene
    scene.collection.objects.link(made)
    scene.camera = made
    camera.sensor_fit, camera.sensor_height = "VERTICAL", 24.0
    camera.clip_start, camera.clip_end = given["clip"]
    matrices, lens = arrays["camera.matrices"], arrays["camera.lens"]
    made.rotation_mode = "QUATERNION"
    made.matrix_world = Matrix(matrices[0].tolist())
    camera.lens = lens[0]
    made.cycles.motion_steps = given["motion_steps"]
    if len(matrices) > 1:
        key_matrices(made, matrices)
    if np.any(lens != lens[0]):
        for frame, value in zip(frames(len(lens)), lens, strict=True):
            camera.lens = value
            camera.keyframe_insert("lens", frame=frame)
        straighten(camera)
    if given["f_stop"]:
        camera.dof.use_dof = True
        camera.dof.focus_distance = given["focus_distance"]
        camera.dof.aperture_fstop = given["f_stop"]
        camera.dof.aperture_blades = given["blades"]
        camera.dof.aperture_rotation = given["blade_rotation"]


def set_up(given: dict[str, Any]) -> None:
    """Every setting that bears on the picture."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles, render = scene.cycles, scene.render
    render.resolution_x, render.resolution_y = given["size"]
    render.resolution_percentage = 100
    render.film_transparent = True
    render.use_motion_blur = True
    render.motion_blur_shutter, render.motion_blur_position = SHUTTER, "START"
    render.threads_mode, render.threads = "FIXED", given["threads"]
    render.use_persistent_data = True
    render.dither_intensity = 0.0
    kind = render.image_settings
    kind.file_format, kind.color_mode, kind.color_depth = "OPEN_EXR", "RGBA", "32"
    cycles.device, cycles.samples = "CPU", given["samples"]
    cycles.use_adaptive_sampling = cycles.use_denoising = cycles.use_light_tree = False
    cycles.pixel_filter_type, cycles.sampling_pattern = "BOX", "TABULATED_SOBOL"
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.light_sampling_threshold = cycles.blur_glossy = 0.0
    cycles.max_bounces = cycles.glossy_bounces = given["bounces"]
    cycles.diffuse_bounces = cycles.transmission_bounces = cycles.volume_bounces = 0
    cycles.transparent_max_bounces = 64
    if given["rolling"] is not None:
        cycles.rolling_shutter_type = "TOP"
        cycles.rolling_shutter_duration = given["rolling"]


def build(given: dict[str, Any], arrays: dict[str, np.ndarray], folder: Path) -> None:
    """The whole scene."""
    names = [f"texture{k}" for k in range(given["textures"])]
    images = [image(arrays[name], name) for name in names]
    materials = [make_material(m, images, given["ambient"]) for m in given["materials"]]
    for number, mesh in enumerate(given["meshes"]):
        key = f"mesh{number}"
        made = make_mesh(mesh, arrays, key, given["bounces"] > 0)
        made.data.materials.append(materials[mesh["material"]])
        made.cycles.motion_steps = mesh["motion_steps"]
        if f"{key}.matrices" in arrays:
            key_matrices(made, arrays[f"{key}.matrices"])
        elif len(arrays[f"{key}.positions"]) > 1:
            key_points(made, arrays[f"{key}.positions"], folder / f"{key}.pc2")
    for light in given["lights"]:
        make_light(light)
    make_camera(given["camera"], arrays)


def main() -> None:
    """Build the scene and render it with each seed."""
    folder = Path(sys.argv[1]).resolve()
    given, arrays = load(folder)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    set_up(given)
    build(given, arrays, folder)
    scene = bpy.context.scene
    scene.frame_set(1)
    for seed in given["seeds"]:
        scene.cycles.seed = seed
        scene.render.filepath = str(folder / f"{seed}.exr")
        bpy.ops.render.render(write_still=True)
    (folder / "version.txt").write_text(bpy.app.version_string, encoding="utf-8")


if __name__ == "__main__":
    main()
