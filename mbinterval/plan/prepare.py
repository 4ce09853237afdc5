"""A frame made ready to render: what is exposed, laid out for the device, and planned."""

from __future__ import annotations

from dataclasses import dataclass, replace

from mbinterval.exposure.asked import Asked
from mbinterval.exposure.exposure import Exposure, expose
from mbinterval.layout import ids
from mbinterval.layout.flow import add_flow, flow_notes
from mbinterval.layout.motion import Motion, lay_out
from mbinterval.plan.analytic_plan import analytic_plan
from mbinterval.plan.memory import check_paths
from mbinterval.plan.plan import Crop, Plan, check_crop, roll_lines
from mbinterval.plan.stochastic_plan import stochastic_plan
from mbinterval.scene.model import Scene
from mbinterval.settings.settings import Settings


@dataclass(frozen=True, eq=False)
class Prepared:
    """A frame that is ready to be rendered; ``notes`` say what had to be assumed for it."""

    exposure: Exposure
    motion: Motion
    plan: Plan
    notes: tuple[str, ...]

    def exposed_as(self, exposure: Exposure) -> Prepared:
        """Return the same paths in another exposure of them, such as a part of the shutter's."""
        plan = self.plan
        again = make_plan(exposure, self.motion, plan.settings, plan.width, plan.height, plan.crop)
        return replace(self, exposure=exposure, plan=replace(again, memory=plan.memory))


def make_plan(
    exposure: Exposure,
    motion: Motion,
    settings: Settings,
    width: int,
    height: int,
    crop: Crop,
) -> Plan:
    """Plan the render of ``exposure``, laid out as ``motion``, by the method of ``settings``."""
    planned = analytic_plan if settings.method == "analytic" else stochastic_plan
    return planned(exposure, motion, settings, width, height, crop)


def prepare(
    scene: Scene,
    frame: float,
    width: int,
    height: int,
    settings: Settings,
    crop: Crop | None = None,
    *,
    lines: int | None = None,
    room: int | None = None,
) -> Prepared:
    """Expose ``scene`` at ``frame``, lay it out for ``width`` by ``height`` pixels, and plan that.

    ``crop`` is the part to render, column, row, width and height; None is the whole frame.
    ``lines`` are those of a rolling shutter, None those of the picture; ``room`` the bytes that
    buffers and film may take together (`Plan.memory`).

    Raises
    ------
    UsageError, SceneError, CapacityError
    """
    region = check_crop(crop, width, height)
    exposure = expose(
        scene,
        frame,
        width / height,
        Asked(
            segments=settings.motion_segments,
            error=settings.motion_error,
            most=settings.most_segments,
            moment=settings.aov_time,
        ),
        lines=roll_lines(scene, width, height) if lines is None else lines,
        height=height,
    )
    check_paths(exposure, settings.method, room)
    motion = lay_out(exposure, width, height)
    plan = replace(make_plan(exposure, motion, settings, width, height, region), memory=room)
    motion = add_flow(motion, scene, exposure, settings, width, height)
    motion = ids.add_hashes(motion, scene, settings.aovs)
    notes = exposure.notes + flow_notes(scene, settings) + ids.notes(scene, settings.aovs)
    return Prepared(exposure, motion, plan, notes)
