"""Small scenes that run every stage and effect of the kernels; ``python oclgrind_scenes.py NAME``.

Renders some of ``SCENES`` on the first device and writes what it sees as ``NAME.npy`` into the
folder ``OCLGRIND_FILMS``. ``test_oclgrind`` runs it in an environment whose only device is
Oclgrind's.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING
from unittest.mock import patch

import numpy as np

import mbinterval as mb
from mbinterval.film.aovs import FLOWS, MOMENTARY, RECORDED
from mbinterval.scene.model import (
    Camera,
    Environment,
    Light,
    Material,
    Mesh,
    Reflections,
    Scene,
    Shutter,
    Texture,
)
from mbinterval.scene.tracks import Track

if TYPE_CHECKING:
    from mbinterval.plan.prepare import Prepared

SIZE = (9, 7)
LENS = {"focal_length": 50.0, "vertical_aperture": 50.0, "f_stop": 0.5, "focus_distance": 2.0}


def triangles(count: int, moving: bool = True, near: float = 1.0, **fields: object) -> Mesh:
    rng = np.random.default_rng(count)
    w = rng.uniform(near, 4.0, (2, count, 3))
    xy = rng.uniform(-0.8, 0.8, (2, count, 1, 2)) + rng.normal(0, 0.3, (1, count, 3, 2))
    ends = np.concatenate([xy * w[..., None], -w[..., None]], axis=-1).reshape(2, -1, 3)
    if "material" not in fields:
        fields["shading"] = "unlit"
    return Mesh(
        positions=ends if moving else ends[0], faces=np.arange(3 * count).reshape(-1, 3), **fields
    )


def colorful() -> list[Mesh]:
    """Textures, vertex and face colours, Phong, one side and two, moving and at rest."""
    rng = np.random.default_rng(1)
    picture = Texture(rng.uniform(0, 1, (4, 4, 3)))
    poster = Material("poster", texture=picture, shading="unlit")
    glossy = Material("glossy", specular=(0.5, 0.5, 0.5), shininess=8.0, double_sided=False)
    return [
        triangles(3, material=poster, uv=rng.uniform(0, 2, (9, 2))),
        triangles(4, material=glossy, normals=rng.normal(size=(2, 12, 3))),
        triangles(2, color=rng.uniform(0, 1, (6, 3)), color_domain="vertex"),
        triangles(3, moving=False, color=rng.uniform(0, 1, (3, 3)), color_domain="face"),
    ]


def seen_through() -> list[Mesh]:
    """Alpha that is constant, of a texture, of vertices, blended and tested; something opaque."""
    rng = np.random.default_rng(2)
    picture = Texture(rng.uniform(0, 1, (4, 4, 4)))
    glass = Material("glass", shading="unlit", opacity=0.5)
    veil = Material("veil", texture=picture, alpha_mode="blend")
    leaf = Material("leaf", texture=picture, shading="unlit", alpha_mode="mask")
    return [
        triangles(6, material=glass),
        triangles(3, moving=False, material=glass),
        triangles(4, material=veil, uv=rng.uniform(0, 2, (12, 2))),
        triangles(5, material=leaf, uv=rng.uniform(0, 2, (2, 15, 2))),
        triangles(2, material=glass, color=rng.uniform(0, 1, (6, 4)), color_domain="vertex"),
        triangles(1, moving=False, color=(0.5, 0.6, 0.7)),
    ]


def repeated(meshes: list[Mesh]) -> list[Mesh]:
    """The same, their textures thousands of repeats away."""
    return [mesh if mesh.uv is None else replace(mesh, uv=mesh.uv + 3e4) for mesh in meshes]


def chromed() -> list[Mesh]:
    """Metals that mirror the environment and their own surroundings, moving and at rest; glass."""
    rng = np.random.default_rng(4)
    metal = {"shading": "metallic_roughness", "metallic": 1.0}
    rough = Material("rough", emission=(0.2, 0.1, 0.0), **metal)
    chrome = Material("chrome", roughness=0.0, **metal)
    asked = Reflections(size=16, times=2)
    return [
        triangles(2, material=rough, normals=rng.normal(size=(6, 3))),
        triangles(3, material=chrome, reflections=asked),
        triangles(2, moving=False, material=chrome, reflections=asked),
        triangles(2, moving=False, material=Material("clay")),
        triangles(2, material=Material("glass", shading="unlit", opacity=0.5)),
    ]


def mirrored(shear: float = 0.0) -> list[Mesh]:
    """Two mirrors, one with light of its own, and what moves, rests and is seen through in them."""
    rng = np.random.default_rng(4)
    veil = Material("veil", texture=Texture(rng.uniform(0, 1, (4, 4, 4))), alpha_mode="blend")
    corners = np.array([[-2.0, -2, -2.5], [2, -2, -4], [2, 2, -4], [-2, 2, -2.5]])
    glass = [
        Mesh(positions=corners + [x, 0, 0], faces=[[0, 1, 2], [0, 2, 3]], material=material)
        for x, material in (
            (0.5, Material("pool", reflectivity=0.7, reflection_shear=shear)),
            (-2.5, Material("pane", shading="unlit", reflectivity=1.0)),
        )
    ]
    return [
        *glass,
        triangles(3),
        triangles(2, moving=False, material=veil, uv=rng.uniform(0, 2, (6, 2))),
        triangles(1, near=-1.0, material=Material("clay")),
    ]


def glassy_crowd() -> list[Mesh]:
    return [triangles(60, material=Material("glass", shading="unlit", opacity=0.1))]


def shaded() -> list[Mesh]:
    """What shades and is shaded: flat and smooth, moving and at rest, translucent."""
    rng = np.random.default_rng(3)
    return [
        triangles(3),
        triangles(4, moving=False, material=Material("clay")),
        triangles(5, material=Material("clay"), normals=rng.normal(size=(15, 3))),
        triangles(2, material=Material("glass", opacity=0.5)),
    ]


def crowd() -> list[Mesh]:
    """One pixel with more intervals than small pools hold, in front of each other."""
    return [triangles(60)]


@dataclass(frozen=True)
class Small:
    meshes: Callable[[], list[Mesh]]
    settings: dict[str, object] = field(default_factory=dict)
    camera: Camera = field(default_factory=lambda: Camera(focal_length=24.0))
    scene: dict[str, object] = field(default_factory=dict)
    capacity: int | None = None


POINTS = {"method": "stochastic"}
LAYERS = ("sharp", *(name for name in MOMENTARY if name not in FLOWS), "operations")
SKY = {"environment": Environment(np.random.default_rng(6).uniform(0, 1, (4, 8, 3)), rotation=40.0)}
ROLL = Shutter(rolling="left", line_offset=0.01, line_exposure=0.2, curve="triangle")
LAMPS = (
    Light("ambient", intensity=0.2),
    Light("directional", direction=(0.3, -1.0, -0.5), shadows=True),
    Light("point", position=(0.2, 0.5, -1.5), shadows=True),
    Light("spot", position=(0.0, 0.0, 0.0), outer_angle=30.0, shadows=True),
)
SCENES = {
    "exact": Small(colorful, {"samples": 2}),
    "exact, crowded": Small(crowd, {"samples": 1}, capacity=400),
    "exact, pools grow": Small(crowd, {"samples": 1}, capacity=24),
    "exact, behind the eye": Small(lambda: [triangles(8, near=-1.0)], {"samples": 1}),
    "exact, segments": Small(
        colorful, {"samples": 1, "motion_segments": 3},
        Camera(position=Track([0.75, 1.25], [[0.0, 0, 0], [0.2, 0.1, 0]]), focal_length=24.0),
    ),
    "mask": Small(colorful, {"samples": 2, "occlusion": 64, "partial_bits": True}),
    "five points": Small(
        colorful, {"samples": 1, "filter": "five_point", "aovs": ("sharp",), "aov_time": 0.5}
    ),
    "lens": Small(colorful, {"samples": 3}, Camera(**LENS)),
    "lens, scattered": Small(
        colorful, {"samples": 4, "pattern": "sobol", "filter": "mitchell"},
        Camera(**LENS, blades=5, sharp_range=(1.8, 2.5), foreground_blur=0.05),
    ),
    "lens, behind the eye": Small(
        lambda: [triangles(8, near=-1.0)], {"samples": 1}, Camera(**LENS)
    ),
    "shutter": Small(colorful, {"samples": 1}, scene={"shutter": Shutter(curve=(1.0, 0.0, 2.0))}),
    "rolling": Small(
        colorful, {"samples": 2}, scene={"shutter": ROLL, "background": np.eye(3)[None]}
    ),
    "layers": Small(
        colorful, {"samples": 2, "aovs": LAYERS, "aov_time": 1.0}, scene={"shutter": ROLL}
    ),
    "layers, behind the eye": Small(
        lambda: [triangles(8, near=-1.0)], {"samples": 1, "aovs": (*LAYERS, *FLOWS)}
    ),
    "recorded": Small(
        colorful, {"samples": 2, "aovs": RECORDED, "event_steps": 3}, scene={"shutter": ROLL}
    ),
    "recorded, translucent": Small(seen_through, {"samples": 1, "aovs": RECORDED}),
    "recorded, triangulated": Small(
        colorful, {"samples": 1, "aovs": "crypto_object", "paths": "triangulated"}
    ),
    "translucent": Small(seen_through, {"samples": 2, "texture_samples": 18}),
    "textures over footprints": Small(colorful, {"samples": 1, "anisotropy": 3}, Camera(**LENS)),
    "textures repeated": Small(
        lambda: repeated(seen_through()), {"samples": 1, "anisotropy": 2, "aovs": LAYERS},
        scene={"lights": LAMPS[:2]},
    ),
    "translucent, adaptive": Small(seen_through, {"samples": 1, "shading_error": 0.02}),
    "translucent, layers": Small(
        seen_through, {"samples": 1, "aovs": LAYERS}, Camera(**LENS), {"shutter": ROLL}
    ),
    "translucent, at rest": Small(
        lambda: [triangles(6, moving=False, material=Material("glass", opacity=0.5))]
    ),
    "translucent, pools grow": Small(glassy_crowd, {"samples": 1}, capacity=24),
    "mirrors": Small(mirrored, {"samples": 1}),
    "mirrors, glossy": Small(lambda: mirrored(0.2), {"samples": 1, "anisotropy": 2}),
    "mirrors, recorded": Small(mirrored, {"samples": 1, "aovs": ("object", "crypto_object")}),
    "mirrors, with shadows": Small(
        lambda: mirrored(0.2), {"samples": 1}, scene={"lights": LAMPS[:2]}
    ),
    "shadows": Small(
        shaded, {"samples": 2, "texture_samples": 18, "motion_segments": 2}, scene={"lights": LAMPS}
    ),
    "shadows, layers": Small(
        colorful, {"samples": 1, "aovs": LAYERS}, Camera(**LENS), {"shutter": ROLL, "lights": LAMPS}
    ),
    "shadows, at rest": Small(
        lambda: [triangles(6, moving=False, material=Material("clay"))], {"samples": 1},
        scene={"lights": LAMPS},
    ),
    "shadows, pools grow": Small(
        lambda: [triangles(12, material=Material("clay"))], {"samples": 1}, capacity=10,
        scene={"lights": LAMPS[:2]},
    ),
    "stochastic, shadows": Small(shaded, {"samples": 3} | POINTS, scene={"lights": LAMPS}),
    "stochastic, shadow map": Small(
        shaded, {"samples": 3, "shadow_map": 17, "shadow_strata": 3} | POINTS,
        scene={"lights": LAMPS},
    ),
    "static": Small(lambda: [triangles(6, moving=False)], {"samples": 2}),
    "empty": Small(list, {"samples": 1}),
    "transparent": Small(colorful, {"samples": 1, "transparent": True, "tile_size": 8}),
    "triangulated": Small(colorful, {"samples": 2, "paths": "triangulated", "occlusion": 32}),
    "triangulated, exact occlusion": Small(
        colorful, {"samples": 1, "paths": "triangulated", "occlusion": "exact"}
    ),
    "triangulated, by depth": Small(
        lambda: [triangles(8, near=-1.0)],
        {"samples": 1, "paths": "triangulated", "pairing": "depth", "occlusion": 32,
         "max_intervals": 3},
    ),
    "triangulated, crowded": Small(
        crowd, {"samples": 1, "paths": "triangulated", "occlusion": 32}, capacity=800
    ),
    "triangulated, pools grow": Small(
        crowd, {"samples": 1, "paths": "triangulated", "occlusion": 32}, capacity=48
    ),
    "triangulated, textures repeated": Small(
        lambda: repeated(colorful()), {"samples": 1, "paths": "triangulated", "occlusion": 32}
    ),
    "stochastic": Small(colorful, {"samples": 3} | POINTS),
    "stochastic, lens": Small(
        colorful, {"samples": 4, "cull": "hull", "cull_tile": 4} | POINTS, Camera(**LENS, blades=5)
    ),
    "stochastic, behind the eye": Small(
        lambda: [triangles(8, near=-1.0)], {"samples": 3, "pattern": "random"} | POINTS
    ),
    "stochastic, filter": Small(
        colorful, {"samples": 3, "pattern": "jittered", "filter": "mitchell"} | POINTS
    ),
    "stochastic, groups": Small(crowd, {"samples": 66, "pattern": "fixed"} | POINTS),
    "stochastic, rotated grid": Small(colorful, {"samples": 4, "pattern": "rgss"} | POINTS),
    "stochastic, interleaved": Small(
        colorful,
        {"samples": 3, "pattern": "interleave_uvt", "cull": "interleave_uvt"} | POINTS,
        Camera(**LENS),
    ),
    "stochastic, edges": Small(
        colorful, {"samples": 2, "test": "edges", "shading_rate": "pixel"} | POINTS
    ),
    "stochastic, texels counted": Small(
        colorful, {"samples": 2, "statistics": True} | POINTS
    ),
    "stochastic, frameless": Small(
        colorful, {"samples": 2, "frameless": 3, "hybrid": True} | POINTS,
        scene={"shutter": ROLL},
    ),
    "stochastic, translucent": Small(seen_through, {"samples": 3} | POINTS),
    "stochastic, textures repeated": Small(
        lambda: repeated(seen_through() + mirrored(0.2)), {"samples": 3} | POINTS, Camera(**LENS),
        {"lights": LAMPS[:2]},
    ),
    "stochastic, mirrors": Small(mirrored, {"samples": 3} | POINTS),
    "stochastic, glossy mirrors": Small(
        lambda: mirrored(0.2), {"samples": 3} | POINTS, Camera(**LENS)
    ),
    "accumulation, glossy mirrors": Small(
        lambda: mirrored(0.2),
        {"method": "accumulation", "slices": 3, "samples": 2, "slice_times": "jittered"},
    ),
    "stochastic, empty": Small(list, {"samples": 1} | POINTS),
    **{
        f"culling, {cull}": Small(
            lambda: [triangles(8, near=-1.0)],
            {"samples": 4, "cull": cull, "statistics": True} | POINTS,
            Camera(**LENS),
        )
        for cull in ("bbox", "hull", "obb", "pixar", "dual_space", "clip_space",
                     "clip_space_printed", "trim", "zmax", "zmax_strata", "zmin",
                     "zmin_strata")
    },
    "environment": Small(chromed, {"samples": 2}, Camera(**LENS), scene=SKY),
    "stochastic, environment": Small(
        chromed, {"samples": 3, "filter": "mitchell"} | POINTS, Camera(**LENS), scene=SKY
    ),
    "accumulation": Small(
        colorful, {"method": "accumulation", "slices": 3, "samples": 2, "motion_segments": 1}
    ),
    "accumulation, lines": Small(
        lambda: [triangles(4)],
        {"method": "accumulation", "slices": 3, "samples": 2, "motion_segments": 1,
         "slice_lens": "line"},
        Camera(**LENS),
    ),
}  # fmt: skip


def with_cube_maps(ready: Prepared) -> Prepared:
    """Cube maps of few directions, around objects of pictures of noise."""
    from mbinterval.device.runtime import runtime
    from mbinterval.exposure.exposure import reflecting
    from mbinterval.rendering import cube_maps
    from mbinterval.rendering.reflections import add_cube_maps

    pictures = [
        np.random.default_rng(5).uniform(0, 1, (2, 6, 17, 17, 3))
        for _ in reflecting(ready.exposure)
    ]
    if "cube_map" not in ready.plan.stages:
        return ready
    with patch.object(cube_maps, "_DIRECTIONS", (2, 2)):
        maps = cube_maps.gather(runtime(), ready.exposure.environment, pictures)
    return add_cube_maps(ready, maps)


def prepared(small: Small) -> Prepared:
    """Frame 1 of a scene, ready to be rendered but for its cube maps."""
    from mbinterval.plan.prepare import prepare

    lights = (Light("ambient", intensity=0.3), Light("point", intensity=2.0),
              Light("directional", direction=(0.0, -1.0, -1.0)))  # fmt: skip
    options = {"lights": lights, "background": (0.1, 0.2, 0.3)} | small.scene
    scene = Scene(meshes=small.meshes(), camera=small.camera, **options)
    fast = {} if "method" in small.settings else {"tile_size": 16, "texture_samples": 2}
    settings = mb.Settings(**fast | small.settings)
    return prepare(scene, 1.0, *SIZE, settings)


def ready_for(small: Small) -> Prepared:
    """Frame 1 of a scene, ready to be rendered."""
    ready = with_cube_maps(prepared(small))
    if small.capacity is None:
        return ready
    return replace(ready, plan=replace(ready.plan, capacity=small.capacity))


def render(name: str) -> np.ndarray:
    """The film's pixels ``(9, 13, 4)`` of one of ``SCENES``."""
    from mbinterval.device.runtime import runtime
    from mbinterval.rendering.analytic import render_analytic
    from mbinterval.rendering.stochastic import render_stochastic

    small = SCENES[name]
    run = render_stochastic if "method" in small.settings else render_analytic
    return run(runtime(), ready_for(small)).rgba


def suit_oclgrind() -> None:
    """Work around what Oclgrind 19.10 with newer clang can't do.

    It has no ``llvm.experimental.noalias.scope.decl``, which optimized and inlined code contains,
    and takes buffers that ``clEnqueueFillBuffer`` filled for uninitialized.
    """
    import pyopencl as cl

    from mbinterval.device.programs import Programs
    from mbinterval.device.runtime import DeviceArray, Runtime

    plain = Programs._from_source
    Programs._from_source = lambda self, source, flags: plain(
        self, source, [*flags, "-cl-opt-disable", "-DINLINED=inline"]
    )

    def fill(self: Runtime, array: DeviceArray, value: int = 0) -> None:
        if array.nbytes:
            cl.enqueue_copy(self.queue, array.buffer, np.full(array.nbytes // 4, value, np.int32))

    Runtime.fill = fill


if __name__ == "__main__":
    suit_oclgrind()
    for chosen in sys.argv[1:]:
        np.save(Path(os.environ["OCLGRIND_FILMS"]) / f"{chosen}.npy", render(chosen))
