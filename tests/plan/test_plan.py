"""Plans: what a scene calls for, why, and that the rest leaves no code behind."""

from __future__ import annotations

import dataclasses
import logging
import re

import numpy as np
import pytest
from support.closed_forms import UNIT_CAMERA
from support.effect_scenes import SIZE, UV, WAYS, mesh, plan
from support.kernels import builds_without, built, ready_for, warns

import mbinterval as mb
from mbinterval.errors import UsageError
from mbinterval.film.aovs import AOVS, MACROS, MOMENTARY, RECORDED, planar
from mbinterval.plan.buffers import film_bytes, scratch_bytes
from mbinterval.plan.plan import Plan, check_crop
from mbinterval.scene.model import Light, Material, Scene, Texture
from mbinterval.scene.tracks import Track

FUNCTIONS = ("rasterize", "sort", "occlude", "solve", "envelope", "append_owned_runs")
"""Functions of the stages of time."""
STAGES = {
    "triangulated": ("rasterize", "intervals", "sort", "occlude"),
    "triangulated, exact occlusion": ("rasterize", "intervals", "sort", "occlude"),
    "exact": ("solve", "envelope"),
    "exact, masked": ("solve", "mask"),
}


def active(of: Plan) -> dict[str, str]:
    """Names and reasons of the effects that are called for."""
    return {effect.name: effect.reason for effect in of.effects if effect.active}


PICTURE = Texture(np.random.default_rng(0).uniform(0, 1, (4, 4, 3)))
UNLIT_PICTURE = Material("poster", texture=PICTURE, shading="unlit")
VERTEX_COLOR = {"color": np.eye(4, 3), "color_domain": "vertex", "name": "flag"}
GLASS = Material("glass", shading="unlit", opacity=0.5)
SEE_THROUGH = Texture(np.random.default_rng(0).uniform(0, 1, (4, 4, 4)))
LEAF = Material("leaf", texture=SEE_THROUGH, shading="unlit", alpha_mode="mask")
FADING = Material("fading", shading="unlit", alpha_mode="blend")
VERTEX_ALPHA = {"color": np.eye(4), "color_domain": "vertex", "name": "veil"}
POOL = Material("pool", shading="unlit", reflectivity=0.5)
FACE_COLOR = {"color": np.eye(2, 3), "color_domain": "face", "name": "tiles"}

CALLED_FOR = {
    "motion": (mesh(), "2 motion paths, 1 motion segment"),
    "static geometry": (mesh(False), "2 triangles do not move"),
    "single-sided": (
        mesh(material=Material("leaf", shading="unlit", double_sided=False)), "material 'leaf'",
    ),
    "phong shading": (mesh(material=Material("clay")), "material 'clay'"),
    "texture": (mesh(material=UNLIT_PICTURE, uv=UV), "material 'poster'"),
    "vertex colour": (mesh(**VERTEX_COLOR), "mesh 'flag'"),
    "transparency": (mesh(material=GLASS), "blended: material 'glass'"),
    "alpha that varies": (mesh(name="leaf", material=LEAF, uv=UV), "mesh 'leaf'"),
    "mirrors": (mesh(False, name="pool", material=POOL), "mesh 'pool'; 0 triangles are seen"),
    "glossy mirrors": (
        mesh(False, name="pool", material=dataclasses.replace(POOL, reflection_shear=0.1)),
        "mesh 'pool'",
    ),
    "vertex alpha": (mesh(material=FADING, **VERTEX_ALPHA), "mesh 'veil'"),
}  # fmt: skip


@pytest.mark.parametrize("name", CALLED_FOR)
def test_an_effect_is_active_where_something_calls_for_it_and_says_what(name):
    source, reason = CALLED_FOR[name]
    assert reason in active(plan(source))[name]
    macro = next(effect.macro for effect in plan(source).effects if effect.name == name)
    assert f"-DMB_{macro}" in plan(source).options
    other = mesh() if name == "static geometry" else mesh(False)
    assert name not in active(plan(other))
    assert f"-DMB_{macro}" not in plan(other).options
    assert all(effect.reason for effect in plan(other).effects)


def test_effects_of_camera_background_and_settings():
    moving = dataclasses.replace(UNIT_CAMERA, position=Track([0.75, 1.25], [[0, 0, 0], [0, 1, 0]]))
    moved = plan(scene=Scene(meshes=[mesh(False)], camera=moving))
    assert "the camera moves" in active(moved)["camera motion"]
    assert "motion" in active(moved)
    image = Scene(meshes=[mesh()], camera=UNIT_CAMERA, background=np.zeros((2, 2, 3)))
    assert "background image" in active(plan(scene=image))
    assert "background image" not in active(plan(scene=image, transparent=True))
    assert "transparent film" in active(plan(mesh(), transparent=True))
    by_depth = {"pairing": "depth", "paths": "triangulated"}
    assert "pairing by depth" in active(plan(mesh(), **by_depth))
    assert "pairing by depth" not in active(plan(mesh(False), **by_depth))


@pytest.mark.parametrize("way", WAYS)
def test_stages_are_those_of_the_method_and_none_of_time_where_nothing_moves(way):
    always = ("paths", "bin", "shade", "resolve")
    assert plan(mesh(), **WAYS[way]).stages == (*always[:2], *STAGES[way], *always[2:])
    both = plan(mesh(), mesh(False), **WAYS[way])
    assert both.stages == (*always[:2], "nearest", *STAGES[way], *always[2:])
    static = plan(mesh(False), **WAYS[way])
    assert static.stages == (*always[:2], "nearest", *always[2:])
    assert not {"-DMB_MOVING", "-DMASK_BITS=128", "-DMASK_BITS=64"} & set(static.options)
    assert static.capacity == 1  # no pools


@pytest.mark.parametrize("way", WAYS)
def test_a_films_timings_are_of_the_stages_that_ran(way):
    for meshes in ([mesh()], [mesh(False)], [mesh(), mesh(False)]):
        scene = Scene(meshes=meshes, camera=UNIT_CAMERA)
        settings = mb.Settings(samples=1, **WAYS[way])
        film = mb.render(scene, width=SIZE[0], height=SIZE[1], settings=settings)
        stages = ready_for(scene, settings, *SIZE).plan.stages
        assert [name for name in film.timings if name != "expose"] == list(stages)
        assert all(seconds >= 0 for seconds in film.timings.values())


@pytest.mark.parametrize("way", WAYS)
def test_what_does_not_move_has_no_stage_of_time_in_its_kernel(way):
    header = "analytic/tile_of_rows.h"  # which names some stages' lists as fields
    assert builds_without(plan(mesh(False), **WAYS[way]), FUNCTIONS, header)
    assert not builds_without(plan(mesh(), **WAYS[way]), FUNCTIONS, header)


def test_untextured_scenes_have_no_texture_code_and_unlit_ones_no_light():
    header = "shared/shading.h"
    for flat in (mesh(), mesh(False), mesh(**VERTEX_COLOR), mesh(**FACE_COLOR)):
        assert builds_without(plan(flat), ("texture_at", "reflected"), header)
    textured = plan(mesh(material=UNLIT_PICTURE, uv=UV))
    assert builds_without(textured, ("reflected",), header)
    assert not builds_without(textured, ("texture_at",), header)
    lit = plan(mesh(material=Material("clay")))
    assert builds_without(lit, ("texture_at",), header)
    assert not builds_without(lit, ("reflected",), header)
    gloss = ("facets_of", "facets_reflect", "load_gloss", "with_emission")
    assert builds_without(lit, gloss, "shared/records.h")
    metal = plan(mesh(material=Material("gold", shading="metallic_roughness")))
    assert not builds_without(metal, gloss[:3], "shared/records.h")
    assert builds_without(metal, gloss[3:], "shared/records.h")


def test_what_is_opaque_leaves_no_code_of_transparency():
    """Alpha that materials ignore, or that is 1 everywhere, calls for nothing."""
    names = ("TRANSLUCENT_BIT", "stack_size", "sweep", "counted_alpha", "unpremultiplied")
    solid = Texture(np.ones((4, 4, 4)))
    for opaque in (
        mesh(),
        mesh(material=Material(shading="unlit", texture=SEE_THROUGH, opacity=1.0), uv=UV),
        mesh(material=Material(shading="unlit", opacity=0.5, alpha_mode="opaque")),
        mesh(material=Material(shading="unlit", texture=solid, alpha_mode="blend"), uv=UV),
        mesh(material=Material(shading="unlit", opacity=0.6, alpha_mode="mask")),
        mesh(material=Material(shading="unlit"), **VERTEX_ALPHA),
    ):
        planned = plan(opaque)
        assert builds_without(planned, names, "shared/records.h")
        assert not [option for option in planned.options if "ALPHA" in option]
        assert planned.stages == ("paths", "bin", "solve", "envelope", "shade", "resolve")
    # To the letter what a scene has that knows of no alpha.
    of_alpha = plan(mesh(material=Material(shading="unlit", opacity=0.5, alpha_mode="opaque")))
    assert of_alpha.options == plan(mesh()).options == (
        *("-DMB_EXACT", "-DMB_MOVING", "-DTILE=16"),
    )  # fmt: skip


def test_lights_without_shadows_leave_no_code_of_them():
    """The host has no buffers for them either: they are arguments of the kernel."""
    names = ("ShadowLight", "LightView", "light_along", "caster_functions", "shadow_lights")
    clay = [mesh(material=Material("clay")), mesh(False, material=Material("clay"))]
    for casts, chosen in ((False, "lights"), (True, "off")):
        lights = [Light("directional", shadows=casts), Light("spot", shadows=casts)]
        of = Scene(meshes=clay, camera=UNIT_CAMERA, lights=lights)
        assert builds_without(plan(scene=of, shadows=chosen), names, "shared/records.h")
        assert not builds_without(plan(scene=of, shadows="all"), names, "shared/records.h")
    plain = plan(scene=Scene(meshes=clay, camera=UNIT_CAMERA, lights=[Light("directional")]))
    assert not [option for option in plain.options if "SHADOW" in option]
    assert "shadow" not in plain.stages
    ambient = [Light("ambient", shadows=True)]
    none = plan(scene=Scene(meshes=clay, camera=UNIT_CAMERA, lights=ambient), shadows="all")
    assert "shadows" not in active(none)


def test_without_an_environment_there_is_no_code_of_it_and_with_one_what_the_scene_calls_for():
    """The host has no buffers for it either: they are arguments of the kernel."""
    maps, pictures = ("CubeMap", "cube_light", "map_texels"), ("Panorama", "texels_around")
    sums = ("Sky", "sky_behind", "texels_in_box", "panorama_sums")
    names = (*maps, *pictures, *sums, "light_around")
    clay = [mesh(material=Material("clay")), mesh(False, material=Material("clay"))]
    chrome = Material("chrome", shading="metallic_roughness", metallic=1.0)
    sky = mb.Environment(np.ones((4, 8, 3)))
    unseen = mb.Environment(np.ones((4, 8, 3)), background=False)
    plain = Scene(meshes=clay, camera=UNIT_CAMERA, lights=[Light("directional")])
    for method in ("analytic", "stochastic"):
        without = plan(scene=plain, method=method)
        lit = plan(scene=dataclasses.replace(plain, environment=unseen), method=method)
        if method == "analytic":
            assert builds_without(without, names, "shared/records.h")
            assert not builds_without(lit, names, "shared/records.h")
            assert builds_without(lit, (*pictures, *sums, "shares_at"), "shared/records.h")
        assert set(lit.options) == {*without.options, "-DMB_ENVIRONMENT"}
        assert lit.stages == ("cube_map", *without.stages)
        seen = plan(mesh(), scene=dataclasses.replace(plain, meshes=[mesh()], environment=sky),
                    method=method)  # fmt: skip
        flat = plan(mesh(), method=method)
        more = {name.split("=")[0] for name in set(seen.options) - set(flat.options)}
        assert more == {"-DMB_SKY", *(["-DMB_SHADING_ERROR"] if method == "analytic" else [])}
        assert set(flat.options) < set(seen.options)
        assert seen.stages == flat.stages
        if method == "analytic":
            assert builds_without(seen, (*maps, "light_around"), "shared/records.h")
            assert not builds_without(seen, sums, "shared/records.h")
    # Nothing mirrors but metallic-roughness materials, whatever asks for it.
    asked = dataclasses.replace(clay[0], reflections=mb.Reflections())
    assert plan(scene=dataclasses.replace(plain, meshes=[asked])).options == plan(
        scene=dataclasses.replace(plain, meshes=clay[:1])
    ).options  # fmt: skip
    mirror = dataclasses.replace(asked, material=chrome)
    mirrored = plan(scene=dataclasses.replace(plain, meshes=[mirror], environment=unseen))
    assert builds_without(mirrored, sums, "shared/records.h")
    assert not builds_without(mirrored, pictures, "shared/records.h")
    assert "-DMB_REFLECTIONS" in plan(scene=dataclasses.replace(plain, meshes=[mirror])).options
    clear = dataclasses.replace(plain, meshes=[mesh()], environment=sky)
    assert plan(scene=clear, transparent=True).stages[0] == "paths"


def test_what_is_translucent_has_the_stage_of_stacks_and_only_the_code_that_it_needs():
    planned = plan(mesh(material=GLASS))
    assert planned.stages == ("paths", "bin", "solve", "stack", "shade", "resolve")
    assert builds_without(planned, ("counted_alpha", "blend_over_time"), "shared/records.h")
    varying = plan(mesh(material=LEAF, uv=UV))
    assert builds_without(varying, ("load_color",), "shared/records.h")
    assert not builds_without(varying, ("counted_alpha",), "shared/records.h")
    # At rest it goes through the lists too, in a plan of its own.
    resting = plan(mesh(False, material=GLASS))
    assert resting.stages == planned.stages
    assert "motion" not in active(resting)
    assert "2 translucent triangles do not move" in active(resting)["transparency at rest"]
    assert "transparency at rest" not in active(planned)


def test_a_scene_without_mirrors_leaves_no_code_of_them():
    """To the letter the options of a scene whose materials know of no mirror."""
    names = ("mirror_among", "mirrored_background", "mirror_seen", "reflectivity", "enter_mirrors")
    for material in (Material(shading="unlit"), GLASS):
        dull = mesh(False, material=dataclasses.replace(material, reflectivity=0.0))
        without = mesh(False, material=material)
        planned = plan(mesh(), dull)
        assert planned.options == plan(mesh(), without).options
        assert not [option for option in planned.options if "MIRROR" in option]
        poisoned = names if material is not GLASS else names[1:]  # what a stack is asked for
        assert builds_without(planned, poisoned, "shared/records.h")
    assert not builds_without(plan(mesh(), mesh(False, material=POOL)), names, "shared/records.h")


CODE = {"sharp": "add_moment"} | {
    name: MACROS[name].replace("AOV_", "PLANE_") for name in planar(AOVS)
}
"""Something that only the code of a layer uses, past the tile's header."""


@pytest.mark.parametrize("name", CODE)
def test_a_layer_that_is_not_asked_for_leaves_no_code_no_buffer_and_no_stage(name):
    header = "analytic/tile_of_rows.h"
    others = tuple(other for other in AOVS if MACROS[other] != MACROS[name])
    assert builds_without(plan(mesh(), aovs=others), (CODE[name],), header)
    assert not builds_without(plan(mesh(), aovs=name), (CODE[name],), header)
    asked, none = plan(mesh(), aovs=name), plan(mesh())
    assert film_bytes(asked) - film_bytes(none) == 32 * 16 * 4 * len(AOVS[name].channels)
    assert ("moment" in asked.stages) == (name in MOMENTARY)
    assert asked.stages[-2:] == ("moment", "resolve") or asked.stages == none.stages
    assert not [option for option in none.options if re.search("AOV|MOMENT|PLANE", option)]


def test_point_lights_are_called_for_by_lit_materials_under_them():
    clay = mesh(material=Material("clay"))
    for lights, meshes, called_for in (
        ([Light("point")], [clay], ["POINT"]),
        ([Light("spot")], [clay], ["POINT", "SPOT"]),
        ([Light("directional")], [clay], []),
        ([Light("point"), Light("spot")], [mesh()], []),
    ):
        planned = plan(scene=Scene(meshes=meshes, camera=UNIT_CAMERA, lights=lights))
        for kind in ("POINT", "SPOT"):
            assert (f"{kind.lower()} lights" in active(planned)) == (kind in called_for)
            assert (f"-DMB_{kind}_LIGHTS" in planned.options) == (kind in called_for)


def test_scratch_counts_what_effects_add_to_its_records():
    of = ready_for(Scene([], camera=UNIT_CAMERA), mb.Settings(samples=4), 32, 16).plan
    placed, glossy = (
        scratch_bytes(dataclasses.replace(of, active=of.active | {"PLACED", *more}))
        for more in ((), ("GLOSSY",))
    )
    assert glossy - placed == 8 * of.layers * of.tile**2


def test_plans_are_values():
    same = [plan(mesh(), samples=3) for _ in range(2)]
    assert same[0] == same[1]
    assert hash(same[0]) == hash(same[1])
    assert len({*same, plan(mesh(), samples=2), plan(mesh(False), samples=3)}) == 3
    with pytest.raises(dataclasses.FrozenInstanceError):
        same[0].samples = 9


@pytest.mark.parametrize("crop", [(-1, 0, 4, 4), (0, 0, 33, 4), (30, 0, 4, 4), (0, 0, 0, 4)])
def test_a_crop_outside_the_frame_is_a_usage_error(crop):
    with pytest.raises(UsageError, match="crop"):
        check_crop(crop, *SIZE)
    assert check_crop(None, *SIZE) == (0, 0, *SIZE)
    assert check_crop((31, 15, 1, 1), *SIZE) == (31, 15, 1, 1)


EVERYTHING = Scene(
    meshes=[
        mesh(material=UNLIT_PICTURE, uv=UV),
        mesh(material=Material("leaf", double_sided=False)),
        mesh(**VERTEX_COLOR),
        mesh(**FACE_COLOR),
        mesh(False),
    ],
    camera=UNIT_CAMERA,
    lights=[Light("ambient")],
    background=np.zeros((2, 2, 3)),
)
SEEN_THROUGH = dataclasses.replace(
    EVERYTHING,
    meshes=[*EVERYTHING.meshes, mesh(material=LEAF, uv=UV), mesh(material=FADING, **VERTEX_ALPHA)],
)
SHARP = {"aovs": "sharp"}
ONLY_EXACT = (
    *("glass", "leaf", "everything, seen through", "everything, recorded"),
    *("shaded", "shaded, at rest", "shaded, seen through", "mirrored", "everything, mirrored"),
    *("everything, in a glossy mirror", "around", "around, empty", "around, at rest"),
)
HALL = mb.Environment(np.ones((4, 8, 3)))
CHROME = Material("chrome", shading="metallic_roughness", metallic=1.0)
CRYPTO = ("crypto_object", "deep")
LAMPS = [Light("point", shadows=True), Light("directional", shadows=True)]
BUILT = {
    "empty": (Scene(meshes=[], camera=UNIT_CAMERA), {}),
    "static": (Scene(meshes=[mesh(False)], camera=UNIT_CAMERA), {}),
    "flat": (Scene(meshes=[mesh()], camera=UNIT_CAMERA), {}),
    "lit": (Scene(meshes=[mesh(material=Material())], camera=UNIT_CAMERA), {}),
    "textured": (Scene(meshes=[mesh(material=UNLIT_PICTURE, uv=UV)], camera=UNIT_CAMERA), {}),
    "everything": (EVERYTHING, {}),
    "glass": (Scene(meshes=[mesh(material=GLASS)], camera=UNIT_CAMERA), SHARP),
    "leaf": (Scene(meshes=[mesh(material=LEAF, uv=UV), mesh(False)], camera=UNIT_CAMERA), SHARP),
    "everything, seen through": (SEEN_THROUGH, SHARP),
    "everything, recorded": (SEEN_THROUGH, {"aovs": RECORDED}),
    "static, recorded": (Scene(meshes=[mesh(False)], camera=UNIT_CAMERA), {"aovs": CRYPTO}),
    "empty, recorded": (Scene(meshes=[], camera=UNIT_CAMERA), {"aovs": CRYPTO}),
    "flat, recorded": (Scene(meshes=[mesh()], camera=UNIT_CAMERA), {"aovs": CRYPTO}),
    "shaded": (dataclasses.replace(EVERYTHING, lights=LAMPS), SHARP),
    "shaded, at rest": (
        Scene(meshes=[mesh(False, material=Material())], camera=UNIT_CAMERA, lights=LAMPS),
        {},
    ),
    "shaded, seen through": (dataclasses.replace(SEEN_THROUGH, lights=LAMPS), SHARP),
    "around": (
        dataclasses.replace(
            SEEN_THROUGH,
            lights=LAMPS,
            environment=HALL,
            meshes=[*SEEN_THROUGH.meshes, mesh(material=CHROME, reflections=mb.Reflections())],
        ),
        SHARP | {"anisotropy": 4},
    ),
    "around, empty": (Scene(meshes=[], camera=UNIT_CAMERA, environment=HALL), SHARP),
    "around, at rest": (
        Scene(meshes=[mesh(False, material=CHROME)], camera=UNIT_CAMERA, environment=HALL),
        SHARP,
    ),
    "around, lit": (
        Scene(meshes=[mesh(material=Material())], camera=UNIT_CAMERA, environment=HALL),
        {},
    ),
    "mirrored": (
        Scene(meshes=[mesh(), mesh(False, material=POOL)], camera=UNIT_CAMERA),
        {},
    ),
    "everything, mirrored": (
        dataclasses.replace(
            SEEN_THROUGH, meshes=[*SEEN_THROUGH.meshes, mesh(False, material=POOL)]
        ),
        {"aovs": (*RECORDED, "sharp", *MOMENTARY)},
    ),
    "everything, in a glossy mirror": (
        dataclasses.replace(
            SEEN_THROUGH,
            meshes=[
                *SEEN_THROUGH.meshes,
                mesh(False, material=dataclasses.replace(POOL, reflection_shear=0.1)),
            ],
        ),
        SHARP | {"anisotropy": 2},
    ),
    "everything, clear": (EVERYTHING, {"transparent": True, "samples": 1, "tile_size": 8}),
    "empty, with layers": (Scene(meshes=[], camera=UNIT_CAMERA), {"aovs": MOMENTARY}),
    "static, with layers": (Scene(meshes=[mesh(False)], camera=UNIT_CAMERA), {"aovs": MOMENTARY}),
    "everything, with layers": (EVERYTHING, {"aovs": MOMENTARY}),
    "everything, sharp": (EVERYTHING, {"aovs": "sharp", "occlusion": "exact"}),
}


@pytest.mark.parametrize(
    ("name", "way"),
    [(name, way) for name in BUILT for way in WAYS if way == "exact" or name not in ONLY_EXACT],
)
def test_kernels_build_without_a_warning(name, way, caplog):
    scene, settings = BUILT[name]
    if way == "triangulated":
        settings = settings | {"pairing": "depth", "max_intervals": 90}
    options = ready_for(scene, mb.Settings(**(WAYS[way] | settings)), *SIZE).plan.options
    others = ("analytic/paths.cl", "analytic/bin.cl") if name == "flat" else ()
    assert not any(warns(file, options) for file in ("analytic/tile.cl", *others))
    assert not [record for record in caplog.records if record.levelno >= logging.WARNING]


def test_a_warning_of_the_compiler_is_logged(caplog):
    built("#warning so\nkernel void f(global int *p) { p[0] = 1; }", "warned.cl", ())
    assert "warned.cl" in caplog.text
