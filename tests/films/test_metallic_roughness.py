"""glTF's metallic-roughness model and emission: closed forms, the twin, point samples, files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from reference import shading as twin_shading
from reference.render import render
from support.closed_forms import FACES, UNIT_CAMERA, rectangle, world
from support.exact_twin import exposed, rms
from support.kernels import run
from support.nightly import nightly
from support.random_triangles import LIGHTS, MOVING_CAMERA, SIZE, late, triangles

import mbinterval as mb
from mbinterval.errors import SceneError
from mbinterval.exposure.exposure import expose
from mbinterval.layout.appearance import appearance
from mbinterval.layout.motion import lay_out
from mbinterval.plan.prepare import make_plan
from mbinterval.plan.sampling import fixed_pattern
from mbinterval.scene.model import Camera, Light, Material, Mesh, Scene, Texture

METAL = Material("metal", shading="metallic_roughness", base_color=(0.9, 0.6, 0.3), metallic=1.0)


def response(material: Material, normal, view, towards) -> np.ndarray:
    """What the kernel makes of one directional light of colour 1, ``(M, 3)``."""
    found = []
    color = np.broadcast_to(material.base_color, normal.shape)
    given = np.stack([color, np.zeros_like(normal), normal, view], axis=1).astype(np.float32)
    for direction in np.atleast_2d(towards):
        light = Light("directional", direction=tuple(-direction))
        tables = appearance([material], [light])
        arrays = [
            *(tables.materials, given, np.uint32(len(given)), tables.lights, np.uint32(1)),
            np.zeros((len(given), 3), np.float32),
        ]
        found.append(run("shading.cl", "reflections", arrays, ["-DMB_METALLIC"])[-1])
    return np.array(found)


@pytest.mark.parametrize("metallic", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("roughness", [0.0, 0.1, 0.5, 1.0])
def test_reflected_light_is_gltfs_formula(metallic, roughness):
    rng = np.random.default_rng(5)
    material = replace(METAL, metallic=metallic, roughness=roughness)
    normal, view = (twin_shading.unit(rng.normal(size=(2000, 3))) for _ in range(2))
    normal *= np.sign((normal * view).sum(axis=1, keepdims=True))
    towards = np.array([0.3, 0.8, 0.5])
    half = twin_shading.unit(view + towards / np.linalg.norm(towards))
    normal[::3] = twin_shading.unit(half + rng.normal(0, 0.05, half.shape))[::3]
    normal, view = normal.astype(np.float32), view.astype(np.float32)
    found = response(material, normal, view, towards)[0]
    light = Light("directional", direction=tuple(-towards))
    gloss = np.broadcast_to([metallic, roughness], (2000, 2))
    color = np.broadcast_to(material.base_color, (2000, 3))
    normal, view = (twin_shading.unit(v.astype(np.float64)) for v in (normal, view))
    truth = twin_shading.metallic_roughness(gloss, color, np.zeros((2000, 3)), normal, view, light)
    rounding = 3e-6 / max(roughness, 0.03) ** 2  # of directions, as the highlight is narrow
    assert np.abs(found - truth).max() < rounding * truth.max()
    assert np.median(np.abs(found - truth)[truth > 0]) < 1e-6 * max(truth.max(), 1.0)
    assert np.abs(found - 1.01 * truth).max() > 1e-3


def test_a_highlight_head_on_has_its_closed_form():
    # N = V = L: D / pi times alpha^4 is 1, masking is 1, Fresnel is f0.
    axis = np.array([[0.0, 0.0, 1.0]], np.float32)
    for roughness in (0.2, 0.6, 1.0):
        material = replace(METAL, roughness=roughness)
        found = response(material, axis, axis, axis[0].astype(float))[0, 0]
        closed = np.array(material.base_color) / (4.0 * roughness**4)
        assert found == pytest.approx(closed, rel=1e-5)
    plastic = replace(METAL, metallic=0.0, roughness=1.0)
    found = response(plastic, axis, axis, axis[0].astype(float))[0, 0]
    assert found == pytest.approx(0.96 * np.array(METAL.base_color) + 0.04 / 4.0, rel=1e-5)


@pytest.mark.parametrize("roughness", [0.3, 0.6, 1.0])
def test_no_more_light_leaves_than_comes_from_all_sides(roughness):
    # Sum over light from the whole hemisphere: pi BRDF cosine / pi over solid angle.
    count = 24
    z = (np.arange(count) + 0.5) / count
    turn = 2 * np.pi * (np.arange(2 * count) + 0.5) / (2 * count)
    zz, turns = np.meshgrid(z, turn)
    r = np.sqrt(1 - zz**2)
    towards = np.stack([r * np.cos(turns), r * np.sin(turns), zz], axis=-1).reshape(-1, 3)
    view = twin_shading.unit(np.array([[0.5, 0.1, 0.8]])).astype(np.float32)
    normal = np.array([[0.0, 0.0, 1.0]], np.float32)
    white = replace(METAL, base_color=(1, 1, 1), roughness=roughness)
    total = response(white, normal, view, towards)[:, 0, 0].mean() * 2.0
    assert total < 1.001  # what facets reflect to each other is lost
    if roughness == 1.0:  # D pi is 1, masking 1 / (1 + cosine) on either side
        assert total == pytest.approx(2.0 * (1.0 - np.log(2.0)) / (1.0 + view[0, 2]), rel=1e-3)
    else:
        assert total > (0.95 if roughness == 0.3 else 0.7)


def bodies(rng: np.random.Generator) -> list[Mesh]:
    gloss = Texture(rng.uniform(0.3, 1, (8, 6, 3)))
    glow = Texture(rng.uniform(0, 1, (5, 7, 3)))
    materials = (
        replace(METAL, metallic=0.5, roughness=0.5),
        replace(
            METAL, roughness=0.9, metallic_roughness_texture=gloss, emission=(0.3, 0.1, 0.2),
            emission_texture=glow, double_sided=False,
        ),
        replace(METAL, metallic=0.0, texture=glow, metallic_roughness_texture=gloss),
        Material("phong that glows", emission=(0.1, 0.0, 0.3)),
    )  # fmt: skip
    return [
        triangles(
            rng, 10, times, material=material, uv=rng.uniform(-1, 2, (30, 2)),
            normals=rng.normal(size=(30, 3)) if index < 2 else None,
        )
        for index, material in enumerate(materials)
        for times in (1, 2)
    ]  # fmt: skip


def scene_of(seed: int, camera: Camera = UNIT_CAMERA) -> Scene:
    meshes = bodies(np.random.default_rng(seed))
    return Scene(meshes=meshes, camera=camera, lights=LIGHTS, background=(0.1, 0.2, 0.3))


@pytest.mark.parametrize("camera", [MOVING_CAMERA, nightly(UNIT_CAMERA)])
def test_films_agree_with_the_twin(camera):
    scene, settings = scene_of(2, camera), mb.Settings(samples=2, texture_samples=16)
    film = mb.render(scene, width=SIZE[0], height=SIZE[1], settings=settings)
    offsets = fixed_pattern(2).astype(np.float64)
    frozen = exposed(scene, settings)
    truth = render(frozen, *SIZE, offsets, paths="exact")
    assert rms(film.rgba - truth.rgba) < 2e-6 * truth.rgba.max()
    assert rms(film.rgba - render(late(frozen, 0.01), *SIZE, offsets, paths="exact").rgba) > 1e-4


def test_point_samples_come_to_the_same_film():
    scene = scene_of(3)
    size = {"width": SIZE[0], "height": SIZE[1]}
    exact = mb.Settings(samples=64, pattern="sobol")
    truth = mb.render(scene, **size, settings=exact).rgba
    errors = [
        rms(
            mb.render(scene, **size, settings=mb.Settings(method="stochastic", samples=count)).rgba
            - truth
        )
        for count in (16, 1024)
    ]
    assert errors[1] < 0.3 * errors[0]
    assert errors[1] < 0.01


def test_a_surface_that_only_glows_shows_its_emission():
    corners = world(rectangle(4, 20, 4, 20), 2.0, SIZE)
    texture = Texture(np.full((2, 2, 3), 0.5))
    lamp = Material(
        shading="metallic_roughness", base_color=(0, 0, 0), metallic=1.0, emission=(2.0, 1.0, 0.5),
        emission_texture=texture,
    )  # fmt: skip
    mesh = Mesh(positions=corners, faces=FACES, material=lamp, uv=np.zeros((4, 2)))
    dark = Light("directional", intensity=0.0)
    scene = Scene(meshes=[mesh], camera=UNIT_CAMERA, lights=[dark])
    film = mb.render(scene, width=SIZE[0], height=SIZE[1])
    assert film.rgba[10, 10, :3] == pytest.approx([1.0, 0.5, 0.25], abs=1e-6)


def options_of(material: Material) -> tuple[str, ...]:
    corners = world(rectangle(4, 20, 4, 20), 2.0, SIZE)
    mesh = Mesh(positions=corners, faces=FACES, material=material)
    scene = Scene(meshes=[mesh], camera=UNIT_CAMERA, lights=LIGHTS[:1])
    frozen = expose(scene, 0, 1.5)
    return make_plan(frozen, lay_out(frozen, *SIZE), mb.Settings(), *SIZE, (0, 0, *SIZE)).options


def test_each_model_is_compiled_where_it_is_called_for():
    phong, metal = options_of(Material()), options_of(METAL)
    assert "-DMB_PHONG" in phong
    assert not {"-DMB_METALLIC", "-DMB_EMISSION"} & set(phong)
    assert "-DMB_METALLIC" in metal
    assert not {"-DMB_PHONG", "-DMB_EMISSION"} & set(metal)
    assert "-DMB_EMISSION" in options_of(replace(METAL, emission=(1, 0, 0)))
    assert "-DMB_EMISSION" not in options_of(Material(shading="unlit", emission=(1, 0, 0)))


@pytest.mark.parametrize(
    ("field", "value"),
    [("metallic", 1.5), ("roughness", -0.1), ("emission", (1, 2)),
     ("metallic_roughness_texture", "m.png"), ("emission_texture", 3)],
)  # fmt: skip
def test_wrong_fields_are_refused_by_name(field, value):
    with pytest.raises(SceneError, match=f"'gear'.*{field}"):
        Material("gear", **{field: value})
