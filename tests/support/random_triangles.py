"""Random scenes of triangles for comparisons with twins."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import chain

import numpy as np

from mbinterval.exposure.exposure import Exposure
from mbinterval.scene.model import Camera, Light, Material, Mesh, Texture
from mbinterval.scene.tracks import Track
from support.closed_forms import UNIT_CAMERA, world

SIZE = (48, 32)

LIGHTS = (
    Light("ambient", intensity=0.2),
    Light("directional", color=(1, 0.8, 0.6), direction=(0.4, -0.5, -1)),
    Light("point", intensity=2.0, position=(0.5, 0.5, 0.0)),
)


@dataclass(frozen=True)
class Case:
    """A scene made by ``meshes(rng)``, and how it is rendered."""

    meshes: Callable[[np.random.Generator], list[Mesh]]
    settings: dict[str, object] = field(default_factory=dict)
    camera: Camera = UNIT_CAMERA
    background: object = (0.18, 0.1, 0.3)


def corners(
    rng: np.random.Generator, count: int, times: int, near: float, layers: range | None
) -> np.ndarray:
    """World positions ``(times, 3 count, 3)`` of triangles that deform as they move.

    With ``layers`` each keeps to a range of depths of its own: nothing passes through anything.
    """
    middle = rng.uniform((-4, -4), (SIZE[0] + 4, SIZE[1] + 4), (times, count, 1, 2))
    pixels = middle + rng.normal(0, 7, (1, count, 3, 2)) + rng.normal(0, 2, (times, count, 3, 2))
    w = rng.uniform(near, 4.0, (1, count, 1)) + rng.uniform(-0.3, 0.3, (times, count, 3))
    if layers is not None:
        place = rng.permutation(len(layers))[:count, None] + layers[0]
        w = 1.0 + 0.05 * place + 0.045 * rng.uniform(0, 1, (times, count, 3))
    return world(pixels, w, SIZE).reshape(times, -1, 3)


def triangles(
    rng: np.random.Generator,
    count: int = 40,
    times: int = 2,
    near: float = 1.0,
    layers: range | None = None,
    **fields: object,
) -> Mesh:
    """Separate triangles; one per-face colour each unless ``fields`` say otherwise."""
    positions = corners(rng, count, times, near, layers)
    if not {"color", "material"} & fields.keys():
        fields |= {"color": rng.uniform(0, 1, (count, 3)), "color_domain": "face"}
    if "material" not in fields:
        fields["shading"] = "unlit"
    return Mesh(
        positions=positions[0] if times == 1 else positions,
        faces=np.arange(3 * count).reshape(-1, 3),
        **fields,
    )


def single(rng: np.random.Generator) -> list[Mesh]:
    material = Material(shading="unlit", double_sided=False)
    color = rng.uniform(0, 1, (60, 3))
    return [triangles(rng, 60, material=material, color=color, color_domain="face")]


def apart(index: int, crossing: bool) -> range | None:
    """Depths of the mesh ``index`` of 20 triangles, unless they may cross."""
    return None if crossing else range(20 * index, 20 * index + 20)


def vertex_colored(rng: np.random.Generator, crossing: bool = False) -> list[Mesh]:
    fixed, changing = rng.uniform(0, 1, (60, 3)), rng.uniform(0, 1, (2, 60, 3))
    return [
        triangles(
            rng, 20, color=color, color_domain="vertex", material=Material(shading="unlit"),
            layers=apart(index, crossing),
        )
        for index, color in enumerate((fixed, changing))
    ]  # fmt: skip


def textured(rng: np.random.Generator, crossing: bool = False) -> list[Mesh]:
    meshes = []
    for index, (wrap, uv) in enumerate(
        (
            ("repeat", rng.uniform(-1, 2, (60, 2))),
            ("mirror", rng.uniform(-1, 2, (2, 60, 2))),
            ("clamp", rng.uniform(-1, 2, (60, 2))),
        )
    ):
        image = rng.uniform(0, 1, (16, 24, 3))
        material = Material(
            wrap, texture=Texture(image, wrap=wrap), shading="unlit", base_color=(1, 0.5, 0.8)
        )
        meshes.append(triangles(rng, 20, material=material, uv=uv, layers=apart(index, crossing)))
    return meshes


def lit(rng: np.random.Generator, crossing: bool = False) -> list[Mesh]:
    normals = rng.normal(size=(2, 60, 3))
    glossy = Material("glossy", specular=(0.5, 0.4, 0.3), shininess=8.0)
    one_sided = Material("one", double_sided=False, base_color=(0.3, 0.9, 0.4))
    return [
        triangles(rng, 20, material=material, normals=normal, layers=apart(index, crossing))
        for index, (material, normal) in enumerate(
            ((glossy, None), (glossy, normals[0]), (one_sided, normals))
        )
    ]


def everything(rng: np.random.Generator) -> list[Mesh]:
    shaded = [part(rng, crossing=True) for part in (vertex_colored, textured, lit)]
    return [*single(rng), *chain(*shaded), triangles(rng, 20, 1)]


def resting(mesh: Mesh) -> Mesh:
    uv = None if mesh.uv is None else mesh.uv.reshape(-1, 60, 2)[0]
    return Mesh(positions=mesh.positions[0], faces=mesh.faces, material=mesh.material, uv=uv)


WALK = Track([0.75, 1.25], [[0.0, 0, 0], [0.3, -0.2, 0.25]])
TURN = Track([0.75, 1.25], [[0.2, 0.1, -3], [-0.4, 0.2, -3]])
MOVING_CAMERA = Camera(position=WALK, look_at=TURN, focal_length=24.0)

CASES = {
    "two-sided": Case(lambda rng: [triangles(rng)]),
    "single-sided": Case(single),
    "vertex colour": Case(vertex_colored),
    "texture": Case(textured),
    "four samples of a span": Case(textured, {"texture_samples": 4}),
    "phong": Case(lit),
    "static and moving": Case(lambda rng: [triangles(rng, 30), triangles(rng, 30, 1, near=2.0)]),
    "static": Case(lambda rng: [triangles(rng, 60, 1)]),
    "static, all effects": Case(lambda rng: [resting(m) for m in [*textured(rng), *lit(rng)]]),
    "moving camera": Case(
        lambda rng: [triangles(rng), triangles(rng, 30, 1)], camera=MOVING_CAMERA
    ),
    "lit, moving camera": Case(lit, camera=Camera(position=WALK, focal_length=24.0)),
    "near and behind the eye": Case(lambda rng: [triangles(rng, 60, near=-1.0)]),
    "static behind the eye": Case(lambda rng: [triangles(rng, 80, 1, near=-1.0)]),
    "three motion segments": Case(lambda rng: [triangles(rng, 30, 4)]),
    "three segments of linear motion": Case(
        lambda rng: [triangles(rng, 30)], {"motion_segments": 3}, MOVING_CAMERA
    ),
    "paired by depth": Case(lambda rng: [triangles(rng)], {"pairing": "depth"}),
    "at most six intervals": Case(lambda rng: [triangles(rng, 80)], {"max_intervals": 6}),
    "32 bits": Case(lambda rng: [triangles(rng)], {"occlusion": 32}),
    "256 bits": Case(lambda rng: [triangles(rng)], {"occlusion": 256}),
    "five samples": Case(lambda rng: [triangles(rng), triangles(rng, 10, 1)], {"samples": 5}),
    "background image": Case(
        lambda rng: [triangles(rng, 15)],
        background=np.random.default_rng(9).uniform(0, 1, (*SIZE[::-1], 3)),
    ),
}


def late(exposure: Exposure, part: float) -> Exposure:
    """The same exposure, its shutter moved by ``part`` of its length."""
    meshes = []
    for mesh in exposure.meshes:
        step = part * (mesh.positions[-1] - mesh.positions[0])
        meshes.append(replace(mesh, positions=mesh.positions + step))
    return replace(exposure, meshes=tuple(meshes))


CROPS = {
    "cubes1000": (480, 360, 48, 32),
    "cubes2000": (500, 400, 32, 24),
    "wheel": (360, 300, 48, 32),
    "sphere82k": (400, 300, 24, 12),
}
"""Crops over dense and fast parts of the scenes that errors are quoted against."""
