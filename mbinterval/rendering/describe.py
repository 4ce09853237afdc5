"""A plan in words: which effects a scene calls for and why, and what follows from it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from mbinterval.device.runtime import Runtime, runtime
from mbinterval.errors import DeviceError
from mbinterval.exposure.exposure import Exposure, reflecting
from mbinterval.exposure.mesh_exposure import MeshExposure
from mbinterval.layout.motion import Motion
from mbinterval.plan.memory import buffer_bytes, textures_of
from mbinterval.plan.plan import Crop, Plan
from mbinterval.plan.prepare import prepare
from mbinterval.plan.sampling import sample_count
from mbinterval.rendering.cube_maps import environment_size, map_texels
from mbinterval.rendering.panorama import looks_at_picture, picture_bytes, picture_size
from mbinterval.scene.model import Scene
from mbinterval.settings.settings import Settings

_MOST_LISTED = 8


def describe(
    scene: Scene,
    frame: float,
    width: int,
    height: int,
    settings: Settings,
    crop: Crop | None = None,
    device: Any = None,
) -> str:
    """Describe the plan of ``frame`` in lines for people: effects, reasons, stages, sizes.

    Raises ``DeviceError`` where ``device`` is given and can't be had; with None and no device at
    all the description says so.
    """
    ready = prepare(scene, frame, width, height, settings, crop)
    exposure, motion, plan = ready.exposure, ready.motion, ready.plan
    part = "" if crop is None else f", of which {','.join(map(str, plan.crop))} is rendered"
    samples = _count(sample_count(settings), "sample")
    lines = [f"frame {frame:g}, {width} x {height} pixels{part}, {samples} per pixel"]
    lines += [f"note: {note}" for note in ready.notes]
    lines += [f"shutter: {_shutter(exposure, scene.fps)}", f"lens: {_lens(exposure)}"]
    lines += [f"occlusion: {_occlusion(plan)}", "effects"]
    for effect in plan.effects:
        lines.append(f"  {'on ' if effect.active else 'off'} {effect.name}: {effect.reason}")
    lines += _mesh_lines(scene, exposure)
    lines += [f"lights: {_lights(exposure, motion)}", f"textures: {_textures(motion)}"]
    lines += _environment(exposure, plan) + _cube_maps(exposure, plan)
    lines.append(f"stages: {' '.join(plan.stages)}")
    lines.append(f"kernel options: {' '.join(plan.options)}")
    lines.append(
        f"tiles of {plan.tile} x {plan.tile} pixels, {_count(plan.layers, 'sample')} at a time"
        + (f", pools of {plan.capacity} records per work-item" if plan.capacity else "")
    )
    return "\n".join([*lines, *_device_lines(motion, plan, device)])


def _count(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _shutter(exposure: Exposure, fps: float) -> str:
    shutter, roll = exposure.shutter, exposure.roll
    curve = f"{shutter.curve} curve"
    if shutter.curve == "trapezoid":
        curve += f" that opens in {shutter.opening:g} and closes in {shutter.closing:g} of it"
    elif not isinstance(shutter.curve, str):
        curve = f"a curve of {len(shutter.curve)} values"
    if roll is not None:
        line = "column" if roll.columns else "row"
        return (
            f"rolls {shutter.rolling}, from {shutter.open:g} frames on, {shutter.line_offset:g} s "
            f"from {line} to {line}, each open for {shutter.line_exposure:g} s; {curve}"
        )
    seconds = (shutter.close - shutter.open) / fps
    return f"open from {shutter.open:g} to {shutter.close:g} frames, {seconds:.4g} s; {curve}"


def _lens(exposure: Exposure) -> str:
    poses, camera = exposure.cameras[0], exposure.camera
    if not poses.aperture[0] > 0.0:
        return "a pinhole"
    text = f"{2.0 * poses.aperture[0]:.4g} wide, in focus at {poses.focus[0]:g}"
    if camera.sharp_range is not None:
        text = f"{text}, sharp from {camera.sharp_range[0]:g} to {camera.sharp_range[1]:g}"
    if camera.foreground_blur is not None:
        text = f"{text}, blur before it up to {camera.foreground_blur:g} of the height"
    shape = f"{camera.blades} blades" if camera.blades else "round"
    return f"{text} (scene units), {shape}"


def _occlusion(plan: Plan) -> str:
    if plan.settings.method != "analytic":
        return "at point samples"
    if not {"envelope", "mask", "stack", "occlude"} & set(plan.stages):
        return "by depth alone, since nothing moves"
    if plan.settings.occlusion == "exact":
        return "exact in time"
    partial = ", that begin and end inside a bit" if plan.settings.partial_bits else ""
    return f"a mask of {plan.settings.occlusion} bits over the shutter{partial}"


def _mesh_lines(scene: Scene, exposure: Exposure) -> list[str]:
    count = len({mesh.index for mesh in exposure.meshes})
    left_out = len(scene.meshes) - count
    hidden = f", {left_out} more without faces or not visible" if left_out else ""
    lines = [f"{count} mesh{'' if count == 1 else 'es'}{hidden}"]
    for mesh in exposure.meshes[:_MOST_LISTED]:
        name = mesh.mesh.name or f"mesh {mesh.index}"
        if mesh.world:
            mirror = exposure.mirrors[mesh.world - 1]
            name += f", seen in {mirror.name or f'mesh {mirror.index}'}"
        lines.append(f"  {name}: {len(mesh.mesh.faces)} faces, {_motion(mesh)}")
    if len(exposure.meshes) > _MOST_LISTED:
        lines.append(f"  and {len(exposure.meshes) - _MOST_LISTED} more")
    return lines


def _motion(mesh: MeshExposure) -> str:
    if not mesh.segments:
        return "static"
    text = _count(mesh.segments, "motion segment")
    if (mesh.open, mesh.close) != (0.0, 1.0):
        text += f" from {mesh.open:.4g} to {mesh.close:.4g} of the shutter"
    return f"{text}: {mesh.reason}" if mesh.reason else text


def _lights(exposure: Exposure, motion: Motion) -> str:
    kinds = Counter(light.kind for light in exposure.lights)
    text = ", ".join(f"{count} {kind}" for kind, count in kinds.items()) or "none"
    unlit = all(material.shading == "unlit" for material in motion.materials)
    return f"{text}; no surface reflects them" if unlit and kinds else text


def _textures(motion: Motion) -> str:
    used = textures_of(motion)
    texts = [
        f"{texture.image.shape[1]} x {texture.image.shape[0]}"
        + (f" {texture.name}" if texture.name else "")
        for texture in used[:_MOST_LISTED]
    ]
    more = [f"and {len(used) - _MOST_LISTED} more"] if len(used) > _MOST_LISTED else []
    return ", ".join(texts + more) or "none"


def _environment(exposure: Exposure, plan: Plan) -> list[str]:
    """The picture of the environment, where it is looked at, and its memory."""
    if exposure.environment is None or not looks_at_picture(plan):
        return []
    width, height = picture_size(exposure.environment)
    behind = "SKY" in plan.active
    sums = " with sums of its texels" if behind else ""
    size = picture_bytes(exposure.environment, behind) / 2**20
    return [f"environment: {width} x {height} texels{sums}, {size:.1f} MiB"]


def _cube_maps(exposure: Exposure, plan: Plan) -> list[str]:
    """What cube maps the frame needs, and what they cost: memory, and pictures to render."""
    if "cube_map" not in plan.stages:
        return []
    texts, texels = [], 0
    if exposure.environment is not None:
        size = environment_size(exposure.environment)
        texels += map_texels(size)
        texts.append(f"the environment's, 6 x {size + 1} x {size + 1} texels")
    for asked, meshes in reflecting(exposure).items():
        name = meshes[0].mesh.name or f"mesh {meshes[0].index}"
        texels += asked.times * map_texels(asked.size)
        pictures = f"{6 * asked.times} pictures of {asked.size + 1} x {asked.size + 1} pixels"
        texts.append(f"of {name}, up to {pictures} rendered before the frame")
    return [f"cube maps: {'; '.join(texts)}; with all levels {16 * texels / 2**20:.1f} MiB"]


def _device_lines(motion: Motion, plan: Plan, device: Any) -> list[str]:
    """Device and memory; pools depend on how many work-items the device runs."""
    on: Runtime | None = None
    try:
        on = runtime(device)
        named = on.device.name.strip()
    except DeviceError as error:
        if device is not None:
            raise
        named = f"none ({error})"
    sizes = buffer_bytes(motion, plan, on.workers if on else 1)
    each = "" if on else " for one work-item"
    return [f"device: {named}", f"memory: {_memory(sizes)}{each}; lists of paths by tile on top"]


def _memory(sizes: Mapping[str, int]) -> str:
    parts = ", ".join(f"{name} {size / 2**20:.1f}" for name, size in sizes.items())
    return f"{sum(sizes.values()) / 2**20:.1f} MiB in buffers ({parts})"
