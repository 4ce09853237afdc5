"""A plan in words: which effects a scene calls for and why, and what follows from it."""

from __future__ import annotations

from mbinterval.motion import lay_out
from mbinterval.plan import Crop, check_crop, make_plan, roll_lines
from mbinterval.scene.exposure import Exposure, expose
from mbinterval.scene.model import Scene
from mbinterval.settings import Settings


def describe(
    scene: Scene,
    frame: float,
    width: int,
    height: int,
    settings: Settings,
    crop: Crop | None = None,
) -> str:
    """Describe the plan of ``frame`` in lines for people: effects, reasons, stages, sizes."""
    rolled = roll_lines(scene, width, height)
    exposure = expose(
        scene,
        frame,
        width / height,
        settings.motion_segments,
        rolled,
        settings.motion_error,
        height,
    )
    motion = lay_out(exposure, width, height)
    plan = make_plan(exposure, motion, settings, width, height, check_crop(crop, width, height))
    lines = [f"frame {frame:g}, {width} x {height} pixels, {settings.samples} samples per pixel"]
    lines += [f"note: {note}" for note in exposure.notes]
    for effect in plan.effects:
        lines.append(f"  {'on ' if effect.active else 'off'} {effect.name}: {effect.reason}")
    lines += _mesh_lines(exposure)
    lines.append(f"stages: {' '.join(plan.stages)}")
    lines.append(f"kernel options: {' '.join(plan.options)}")
    lines.append(
        f"tiles of {plan.tile} x {plan.tile} pixels, {plan.layers} samples at a time, "
        f"pools of {plan.capacity} records per work-item"
    )
    return "\n".join(lines)


def _mesh_lines(exposure: Exposure) -> list[str]:
    lines = [f"{len(exposure.meshes)} mesh{'es' if len(exposure.meshes) != 1 else ''}"]
    for mesh in exposure.meshes[:20]:
        plural = "s" if mesh.segments > 1 else ""
        motion = f"{mesh.segments} motion segment{plural}" if mesh.segments else "static"
        if (mesh.open, mesh.close) != (0.0, 1.0):
            motion += f" from {mesh.open:.4g} to {mesh.close:.4g} of the shutter"
        if mesh.segments and mesh.reason:
            motion += f": {mesh.reason}"
        lines.append(f"  {mesh.mesh.name or '(unnamed)'}: {len(mesh.mesh.faces)} faces, {motion}")
    if len(exposure.meshes) > 20:
        lines.append(f"  and {len(exposure.meshes) - 20} more")
    return lines
