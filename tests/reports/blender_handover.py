"""A scene handed to another renderer: what of it Blender can show, as arrays and JSON.

`plain` leaves out of a scene what Cycles has no equal of, in mbinterval's own render of it too;
`write` evaluates the rest over a frame's shutter and writes ``scene.json`` and ``arrays.npz`` for
`blender_render`.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import mbinterval as mb
from mbinterval.exposure.exposure import Exposure, expose
from mbinterval.exposure.mesh_exposure import MeshExposure
from mbinterval.exposure.poses import camera_poses

STEPS = 7
"""Of Blender's motion steps: it looks at ``2**STEPS + 1`` times where motion is not straight."""
LIGHTS = ("ambient", "directional", "point")


@dataclass(frozen=True)
class Work:
    """How Blender is to render: pixels, samples per pixel and seed, and threads."""

    width: int
    height: int
    samples: int
    seeds: tuple[int, ...]
    threads: int


def plain(scene: mb.Scene, mirrors: tuple[str, ...] = ()) -> mb.Scene:
    """Return what both renderers can show alike: Lambert's surfaces, facets, three kinds of lights.

    Left out are Phong's highlights, normals of what deforms, spot lights, environments, emission of
    what is lit, and mirrors but for those meshes that ``mirrors`` names. Metals become white, since
    Schlick's Fresnel has no equal, and faceted, since Cycles bends the normals of highlights. The
    background is black.
    """
    return replace(
        scene,
        meshes=[_plain_mesh(mesh, mirrors) for mesh in scene.meshes],
        lights=[light for light in scene.lights if light.kind in LIGHTS],
        background=(0.0, 0.0, 0.0),
        environment=None,
    )


def _plain_mesh(mesh: mb.Mesh, mirrors: tuple[str, ...]) -> mb.Mesh:
    material = mesh.material or mb.Material()
    if material.shading == "metallic_roughness" and material.metallic == 1.0:
        white = mb.Material(
            shading="metallic_roughness",
            metallic=1.0,
            roughness=material.roughness,
            double_sided=material.double_sided,
        )
        return replace(mesh, material=white, normals=None, reflections=None)
    kept = replace(
        material,
        shading="unlit" if material.shading == "unlit" else "phong",
        specular=(0.0, 0.0, 0.0),
        emission=(0.0, 0.0, 0.0),
        emission_texture=None,
        metallic_roughness_texture=None,
        reflectivity=material.reflectivity if mesh.name in mirrors else 0.0,
        reflection_shear=0.0,
    )
    normals = mesh.normals if mesh.deformer is None and mesh.times == 1 else None
    return replace(mesh, material=kept, normals=normals, reflections=None)


def write(scene: mb.Scene, frame: float, work: Work, folder: Path) -> None:
    """Write what Blender needs for ``frame`` of a `plain` scene, whose shutter opens at 0."""
    aspect = work.width / work.height
    lines = work.height
    exposure = expose(scene, frame, aspect, motion_segments=2**STEPS, lines=lines)
    arrays: dict[str, np.ndarray] = {}
    images: dict[int, int] = {}
    ambient = np.zeros(3)
    for light in exposure.lights:
        if light.kind == "ambient":
            ambient += np.array(light.color) * light.intensity
    meshes, materials = [], []
    for number, part in enumerate(part for part in exposure.meshes if part.world == 0):
        meshes.append(_mesh(part, number, exposure, scene, arrays))
        materials.append(_material(part, images, arrays))
    given = {
        "size": [work.width, work.height],
        "samples": work.samples,
        "seeds": list(work.seeds),
        "threads": work.threads,
        "bounces": 1 if any(one["reflectivity"] for one in materials) else 0,
        "rolling": None if exposure.roll is None else exposure.roll.length,
        "ambient": ambient.tolist(),
        "textures": len(images),
        "meshes": meshes,
        "materials": materials,
        "lights": [_light(light) for light in exposure.lights if light.kind != "ambient"],
        "camera": _camera(exposure, scene, aspect, arrays),
    }
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene.json").write_text(json.dumps(given, indent=1), encoding="utf-8")
    np.savez(folder / "arrays.npz", **arrays)


def _mesh(
    part: MeshExposure,
    number: int,
    exposure: Exposure,
    scene: mb.Scene,
    arrays: dict[str, np.ndarray],
) -> dict[str, Any]:
    """A mesh and its motion: at rest, matrices if it is rigid, else vertices at each time."""
    key = f"mesh{number}"
    positions, mesh = part.positions, scene.meshes[part.index]
    matrices = _rigid(mesh, exposure, part.segments, scene) if len(positions) > 1 else None
    bends = matrices is None and part.normals is not None and len(part.normals) > 1
    if bends or (part.open, part.close, mesh.own_shutter) != (0.0, 1.0, 1.0):
        raise ValueError(f"{mesh.name}: Blender is not told of normals that bend, nor of jumps")
    if matrices is not None:
        arrays[f"{key}.matrices"] = matrices
        positions = mesh.positions[None]
    arrays[f"{key}.positions"] = positions
    arrays[f"{key}.faces"] = part.mesh.faces
    if part.normals is not None:
        arrays[f"{key}.normals"] = part.normals[0] if matrices is None else mesh.normals
    if part.uv is not None:
        arrays[f"{key}.uv"] = part.uv[0]
    if part.color is not None:
        arrays[f"{key}.color"] = _rgba(part.color[0])[part.mesh.faces]
    elif part.face_color is not None:
        arrays[f"{key}.color"] = np.repeat(_rgba(part.face_color)[:, None], 3, axis=1)
    straight = len(part.positions) <= 2 and matrices is None
    steps = 1 if straight else STEPS
    return {"name": part.mesh.name, "material": number, "motion_steps": steps}


def _rgba(color: np.ndarray) -> np.ndarray:
    alpha = np.ones((*color.shape[:-1], 4 - color.shape[-1]), color.dtype)
    return np.concatenate([color, alpha], axis=-1)


def _rigid(mesh: mb.Mesh, exposure: Exposure, segments: int, scene: mb.Scene) -> np.ndarray | None:
    """Matrices ``(T, 4, 4)`` of a mesh that turns and moves only; None of any other."""
    if mesh.transform is None or mesh.deformer is not None or mesh.times > 1:
        return None
    times = _frames(scene, exposure, segments)
    matrices = np.array([mesh.transform.at(float(time), exposure.frame) for time in times])
    turns = matrices[:, :3, :3]
    straight = np.allclose(turns @ turns.mT, np.eye(3), atol=1e-9)
    return matrices if straight and (np.linalg.det(turns) > 0.0).all() else None


def _frames(scene: mb.Scene, exposure: Exposure, segments: int) -> np.ndarray:
    """Frames ``(segments + 1,)`` from where the shutter opens to where it closes."""
    first, last = scene.shutter.window(scene.fps, _lines(exposure))
    return exposure.frame + first + (last - first) * np.arange(segments + 1) / max(segments, 1)


def _lines(exposure: Exposure) -> int:
    roll = exposure.roll
    return 1 if roll is None or roll.step == 0.0 else round((1.0 - roll.length) / roll.step) + 1


def _material(
    part: MeshExposure, images: dict[int, int], arrays: dict[str, np.ndarray]
) -> dict[str, Any]:
    material = part.mesh.material or mb.Material()
    texture = None
    if material.texture is not None:
        texture = images.setdefault(id(material.texture), len(images))
        arrays[f"texture{texture}"] = material.texture.image
    return {
        "name": material.name,
        "base_color": material.base_color,
        "texture": texture,
        "colored": part.color is not None or part.face_color is not None,
        "unlit": material.shading == "unlit",
        "metal": material.shading == "metallic_roughness",
        "roughness": material.roughness,
        "double_sided": material.double_sided,
        "opacity": material.opacity,
        "alpha": material.alpha,
        "alpha_cutoff": material.alpha_cutoff,
        "reflectivity": material.reflectivity,
    }


def _light(light: mb.Light) -> dict[str, Any]:
    """A light; ``matrix`` turns Blender's sun, which shines down its own -Z, to its direction."""
    back = -np.array(light.direction) / np.linalg.norm(light.direction)
    aside = np.cross([0.0, 1.0, 0.0] if abs(back[1]) < 0.9 else [1.0, 0.0, 0.0], back)
    aside /= np.linalg.norm(aside)
    return {
        "kind": light.kind,
        "color": light.color,
        "intensity": light.intensity,
        "position": light.position,
        "matrix": np.stack([aside, np.cross(back, aside), back], axis=1).tolist(),
        "shadows": light.shadows,
    }


def _camera(
    exposure: Exposure, scene: mb.Scene, aspect: float, arrays: dict[str, np.ndarray]
) -> dict[str, Any]:
    """The camera's places and focal lengths over the shutter, and its lens."""
    segments = 2**STEPS if exposure.camera_moves else 0
    poses = camera_poses(exposure.camera, _frames(scene, exposure, segments), aspect)
    matrices = np.tile(np.eye(4), (len(poses.eye), 1, 1))
    matrices[:, :3, :3] = poses.rotation.mT
    matrices[:, :3, 3] = poses.eye
    arrays["camera.matrices"] = matrices
    arrays["camera.lens"] = poses.focal * 24.0
    camera = exposure.camera
    radius, focus = float(poses.aperture[0]), float(poses.focus[0])
    # Blender's lens is its focal length in metres over the f-stop wide, in the scene's units.
    f_stop = poses.focal[0] * 24e-3 / (2.0 * radius) if radius else None
    points = np.concatenate([part.positions.reshape(-1, 3) for part in exposure.meshes])
    far = float(np.abs(points - poses.eye[0]).max())
    return {
        "f_stop": f_stop,
        "focus_distance": focus,
        "blades": camera.blades,
        "blade_rotation": float(np.radians(camera.blade_rotation)),
        "clip": [1e-4 * far, 10.0 * far],
        "motion_steps": STEPS if exposure.camera_moves else 1,
    }
