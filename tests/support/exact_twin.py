"""Cases of exact films, and the exact twin of them."""

from __future__ import annotations

import numpy as np
from reference.render import Image, render
from reference.stacks import render_stacks

import mbinterval as mb
from mbinterval.exposure.asked import Asked
from mbinterval.exposure.exposure import Exposure, expose
from mbinterval.plan.sampling import fixed_pattern
from mbinterval.scene.model import Scene
from support.random_triangles import CASES, LIGHTS, MOVING_CAMERA, everything

SIZE = (48, 32)

Crop = tuple[int, int, int, int]


def twin(
    exposure: Exposure,
    settings: mb.Settings,
    size: tuple[int, int] = SIZE,
    crop: Crop | None = None,
) -> Image:
    given = fixed_pattern(settings.samples).astype(np.float64), crop
    materials = [mesh.mesh.material for mesh in exposure.meshes]
    with np.errstate(invalid="ignore", divide="ignore"):  # what is seen edge-on
        if any(material and material.alpha != "opaque" for material in materials):
            return render_stacks(exposure, *size, *given, texture_samples=settings.texture_samples)
        return render(
            exposure, *size, *given, paths="exact", texture_samples=settings.texture_samples
        )


def exposed(scene: Scene, settings: mb.Settings, size: tuple[int, int] = SIZE) -> Exposure:
    asked = Asked(settings.motion_segments, settings.motion_error, moment=settings.aov_time)
    return expose(scene, 1.0, size[0] / size[1], asked, height=size[1])


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


def case_of(name: str, seed: int) -> tuple[Scene, mb.Settings]:
    rng = np.random.default_rng(seed)
    if name == "everything":
        scene = Scene(meshes=everything(rng), camera=MOVING_CAMERA, lights=LIGHTS)
        return scene, mb.Settings(samples=2, texture_samples=16)
    case = CASES[name]
    scene = Scene(
        meshes=case.meshes(rng), camera=case.camera, lights=LIGHTS, background=case.background
    )
    return scene, mb.Settings(**({"samples": 1, "texture_samples": 16} | case.settings))
