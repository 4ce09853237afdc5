"""Texture coordinates of thousands of repeats: what is whole repeats away looks the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from reference.witness import film as witness
from support.kernels import ready_for

import mbinterval as mb
from mbinterval.exposure.exposure import expose
from mbinterval.layout.motion import has_large_uv

AWAY = 30_000.0
"""Repeats that a texture is shifted by: float32 is a 512th of one there."""
SIZE = (24, 18)
LENS = {"f_stop": 1.0, "focus_distance": 4.0, "meters_per_unit": 0.05}
KINDS: dict[str, dict[str, object]] = {
    "exact": {"samples": 2},
    "exact, moments given": {"samples": 1, "texture_samples": 5},
    "footprints": {"samples": 1, "anisotropy": 4},
    "triangulated": {"samples": 1, "paths": "triangulated"},
    "points": {"method": "stochastic", "samples": 8, "statistics": True},
    "points by pixel": {"method": "stochastic", "samples": 8, "shading_rate": "pixel"},
    "slices": {"method": "accumulation", "slices": 4, "samples": 1},
    "layers": {"samples": 2, "aovs": ("sharp", "uv", "object", "deep")},
}


def textured(alpha_mode: str, wrap: str, rng: np.random.Generator) -> mb.Material:
    pictures = {
        name: mb.Texture(rng.uniform(0, 1, (16, 12, channels)), wrap=wrap)
        for name, channels in (
            ("texture", 4), ("metallic_roughness_texture", 3), ("emission_texture", 3)
        )
    }  # fmt: skip
    return mb.Material(
        shading="metallic_roughness", emission=(0.2, 0.2, 0.2), alpha_mode=alpha_mode, **pictures
    )


def scene(shift: float, wrap: str = "repeat", blended: bool = True) -> mb.Scene:
    """What moves, rests and turns its texture; alpha that is blended, tested and casts shadows."""
    rng = np.random.default_rng(2)
    modes = ("blend", "mask", "opaque") if blended else ("opaque",) * 3
    materials = [textured(mode, wrap, rng) for mode in modes]
    triangle = np.array([[-1.0, -0.8, 0], [0.9, -0.7, 0.3], [0.1, 0.9, 0]])
    uv = rng.uniform(0, 2, (2, 3, 2))
    wall = np.array([[-4.0, -3, -3], [4, -3, -3], [0, 5, -2.5]])
    meshes = [
        mb.Mesh(np.stack([triangle, triangle + [0.5, 0.1, 0]]), [[0, 1, 2]], uv=uv[0] + shift,
                material=materials[0], normals=[[0, 0, 1]] * 3),
        mb.Mesh(np.stack([triangle * 0.6 + [-0.6, 0.2, -1.2]] * 2), [[0, 1, 2]], uv=uv + shift,
                material=materials[1], normals=[[0, 0, 1]] * 3),
        mb.Mesh(wall, [[0, 1, 2]], uv=wall[:, :2] * 1.5 + shift, material=materials[2]),
    ]  # fmt: skip
    lights = [mb.Light("ambient", intensity=0.3),
              mb.Light("directional", direction=(0.3, -0.4, -1), shadows=blended)]  # fmt: skip
    return mb.Scene(meshes, mb.Camera(position=(0, 0, 4), fov=40.0), lights=lights)


def film(of: mb.Scene, **settings: object) -> mb.Film:
    return mb.render(of, width=SIZE[0], height=SIZE[1], settings=mb.Settings(**settings))


@pytest.mark.parametrize(
    ("kind", "wrap"),
    [*((kind, "repeat") for kind in KINDS), ("exact", "mirror"), ("footprints", "mirror")],
)
def test_whole_repeats_change_nothing(kind, wrap):
    blended = kind != "triangulated"
    near, far = (film(scene(shift, wrap, blended), **KINDS[kind]) for shift in (0.0, AWAY))
    change = np.abs(near.rgba - far.rgba)
    # Tests of alpha and of visibility are sudden.
    assert np.quantile(change, 0.99) < 5e-4
    assert np.sqrt(np.mean(change**2)) < 2e-3
    shifted = film(scene(AWAY + 1.0 / 64, wrap, blended), **KINDS[kind])
    assert np.sqrt(np.mean((shifted.rgba - near.rgba) ** 2)) > 5e-3
    if kind == "layers":
        uv = np.where(near.layers["object"][..., None] > 0, near.layers["uv"] + AWAY, 0.0)
        assert np.abs(far.layers["uv"] - uv).max() < 2e-3  # a float32 number holds them
    if kind == "points":
        assert far.stats["texels"] == near.stats["texels"]


def test_shutters_and_lenses_see_it_too():
    of = scene(0.0), scene(AWAY)
    moving = mb.Track([0.75, 1.25], [[0.0, 0, 4], [0.6, 0.1, 3.8]])
    camera = mb.Camera(position=moving, fov=40.0, **LENS)
    near, far = (film(replace(each, camera=camera), samples=4) for each in of)
    assert np.sqrt(np.mean((near.rgba - far.rgba) ** 2)) < 1e-3


@pytest.mark.parametrize("method", ["analytic", "stochastic"])
def test_what_is_clamped_is_seen_once_far_out_on_a_large_ground(method):
    """A texture over one of 20,000 squares of a ground, where the camera stands."""
    image = np.random.default_rng(5).uniform(0, 1, (64, 64, 3))
    half, at = 10_000.0, np.array([7000.25, 3000.5])
    corners = np.array([[-half, 0, half], [half, 0, half], [half, 0, -half], [-half, 0, -half]])
    uv = corners[:, [0, 2]] * [1.0, -1.0] - at
    ground = mb.Mesh(
        corners, [[0, 1, 2], [0, 2, 3]], uv=uv,
        material=mb.Material(shading="unlit", texture=mb.Texture(image, wrap="clamp")),
    )  # fmt: skip
    middle = np.array([at[0] + 0.5, 0.0, -at[1] - 0.5])
    camera = mb.Camera(position=tuple(middle + [0, 1.2, 0.6]), look_at=tuple(middle), fov=50.0)
    given = film(mb.Scene([ground], camera), method=method, samples=1, filter_radius=1e-3)
    asked = witness.Asked(strata=1, repeats=1, centre=True)
    right = witness.film(mb.Scene([ground], camera), 0.0, SIZE, asked).rgba[0]
    away = given.rgba - right
    assert np.sqrt(np.mean(away[..., :3] ** 2)) < 2e-3


def test_only_what_float32_is_too_coarse_for_calls_for_the_effect():
    for shift, large in ((0.0, False), (500.0, False), (AWAY, True)):
        meshes = expose(scene(shift), 1.0, 1.0).meshes
        assert all(has_large_uv(mesh) == large for mesh in meshes)
        effects = ready_for(scene(shift), mb.Settings(), *SIZE).plan.effects
        assert ("LARGE_UV" in {e.macro for e in effects if e.active}) == large
