"""Scenes of translucent surfaces, and the twin of their films."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from reference.render import Image
from reference.stacks import render_stacks

import mbinterval as mb
from mbinterval.exposure.asked import Asked
from mbinterval.exposure.exposure import expose
from mbinterval.plan.sampling import fixed_pattern
from mbinterval.scene.model import Camera, Material, Mesh, Scene, Texture
from support.closed_forms import UNIT_CAMERA
from support.random_triangles import LIGHTS, MOVING_CAMERA, late, triangles

SIZE = (48, 32)


def glass(opacity: float = 0.5, **fields: object) -> Material:
    return Material(**{"name": "glass", "shading": "unlit", "opacity": opacity} | fields)


def blended(rng: np.random.Generator, count: int = 12, times: int = 2, **fields: object) -> Mesh:
    color = np.concatenate([rng.uniform(0, 1, (count, 3)), rng.uniform(0, 1, (count, 1))], axis=1)
    given = {"color": color, "color_domain": "face"} | fields
    return triangles(rng, count, times, material=glass(0.9), **given)


def picture(rng: np.random.Generator) -> Texture:
    return Texture(rng.uniform(0, 1, (8, 8, 4)))


def textured(rng: np.random.Generator, mode: str, times: int = 2) -> Mesh:
    material = glass(0.8, texture=picture(rng), alpha_mode=mode, alpha_cutoff=0.35)
    return triangles(rng, 12, times, material=material, uv=rng.uniform(0, 1.5, (36, 2)))


def vertex_alpha(rng: np.random.Generator) -> Mesh:
    return blended(rng, color=rng.uniform(0, 1, (2, 36, 4)), color_domain="vertex")


def lit(rng: np.random.Generator) -> Mesh:
    material = Material("lit glass", opacity=0.4, specular=(0.5, 0.5, 0.5), shininess=8.0)
    return triangles(rng, 12, material=material, normals=rng.normal(size=(2, 36, 3)))


@dataclass(frozen=True)
class Case:
    meshes: Callable[[np.random.Generator], list[Mesh]]
    settings: dict[str, object] = field(default_factory=dict)
    camera: Camera = UNIT_CAMERA


CASES = {
    "constant": Case(lambda rng: [blended(rng, 30)]),
    "over what moves": Case(lambda rng: [blended(rng, 20), triangles(rng, 20)]),
    "over what rests": Case(lambda rng: [blended(rng, 20), triangles(rng, 20, 1)]),
    "at rest": Case(lambda rng: [blended(rng, 20, 1), triangles(rng, 20), triangles(rng, 9, 1)]),
    "nothing moves": Case(lambda rng: [blended(rng, 20, 1), triangles(rng, 9, 1)]),
    "lit": Case(lambda rng: [lit(rng), triangles(rng, 9, 1)]),
    "textured": Case(lambda rng: [textured(rng, "blend"), triangles(rng, 9)]),
    "textured, at rest": Case(lambda rng: [textured(rng, "blend", 1), lit(rng)]),
    "tested": Case(lambda rng: [textured(rng, "mask"), triangles(rng, 9)]),
    "ignored": Case(lambda rng: [textured(rng, "opaque"), blended(rng)]),
    "vertices": Case(lambda rng: [vertex_alpha(rng), blended(rng)]),
    "behind the eye": Case(lambda rng: [blended(rng, 40, near=-1.0)]),
    "single-sided": Case(
        lambda rng: [triangles(rng, 30, material=glass(0.5, double_sided=False))]
    ),
    "everything": Case(
        lambda rng: [
            *(blended(rng), textured(rng, "blend"), textured(rng, "mask"), vertex_alpha(rng)),
            *(lit(rng), triangles(rng), triangles(rng, 9, 1), blended(rng, 9, 1)),
        ],
        {"samples": 2, "texture_samples": 20}, MOVING_CAMERA,
    ),
}  # fmt: skip


def made(name: str, seed: int) -> tuple[Scene, mb.Settings]:
    case = CASES[name]
    meshes = case.meshes(np.random.default_rng(seed))
    of = Scene(meshes=meshes, camera=case.camera, lights=LIGHTS, background=(0.18, 0.1, 0.3))
    return of, mb.Settings(**({"samples": 1, "texture_samples": 16} | case.settings))


def twin(of: Scene, settings: mb.Settings, by: float = 0.0) -> Image:
    exposure = expose(
        of, 1.0, SIZE[0] / SIZE[1], Asked(error=settings.motion_error), height=SIZE[1]
    )
    with np.errstate(invalid="ignore", divide="ignore"):  # what is seen edge-on
        return render_stacks(
            late(exposure, by) if by else exposure, *SIZE,
            fixed_pattern(settings.samples).astype(np.float64),
            texture_samples=settings.texture_samples,
        )  # fmt: skip
