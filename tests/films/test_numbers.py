"""Numbers that float32 can't carry are refused by name, and no film has a NaN or an infinity.

Other than where it means that there is nothing: depth is infinite where nothing is seen, and flow
is no number where a point is behind the eye.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import subprocess
import sys

import numpy as np
import pytest
from support.gltf_files import Gltf
from support.nightly import nightly

import mbinterval as mb
from mbinterval.files.exr import ExrImage, write_exr
from mbinterval.rendering.finite import first_wrong
from mbinterval.scene.primitives import sphere

HOLDS = "up to 3.4e+38, the largest that float32 holds"
TRIANGLE = {"positions": [[-1, -1, 0], [1, -1, 0], [0, 1, 0]], "faces": [[0, 1, 2]], "name": "a"}
SMALL = {"width": 16, "height": 12}


def mesh(**fields):
    return mb.Mesh(**(TRIANGLE | fields))


def camera(**fields):
    return mb.Camera(**({"position": (0, 0, 4)} | fields))


def spoilt(shape, value, dtype=float):
    array = np.ones(shape, dtype)
    array.flat[1] = value
    return array


LENS = {"f_stop": 2.0, "focus_distance": 3.0}
FIELDS = {
    "mesh 'a': positions: {} at vertex 0": lambda v: mesh(positions=spoilt((3, 3), v)),
    "mesh 'a': normals: {} at vertex 0": lambda v: mesh(normals=spoilt((3, 3), v)),
    "mesh 'a': uv: {} at vertex 0": lambda v: mesh(uv=spoilt((3, 2), v)),
    "mesh 'a': color: {} at vertex 0": lambda v: mesh(
        color=spoilt((3, 3), v), color_domain="vertex"
    ),
    "mesh 'a': color: {} at face 0": lambda v: mesh(color=spoilt((1, 3), v)),
    "mesh 'a': shutter_scale={}": lambda v: mesh(shutter_scale=v),
    "texture: image: {} at pixel (row 0, column 0)": lambda v: mb.Texture(spoilt((2, 2, 3), v)),
    "material: base_color=({}": lambda v: mb.Material(base_color=(v, 1, 1)),
    "material: specular=({}": lambda v: mb.Material(specular=(v, 1, 1)),
    "material: emission=({}": lambda v: mb.Material(emission=(v, 1, 1)),
    "material: shininess={}": lambda v: mb.Material(shininess=v),
    "material: alpha_cutoff={}": lambda v: mb.Material(alpha_cutoff=v),
    "material: reflection_shear={}": lambda v: mb.Material(reflection_shear=v),
    "light: color=({}": lambda v: mb.Light("ambient", color=(v, 1, 1)),
    "light: intensity={}": lambda v: mb.Light("ambient", intensity=v),
    "light: position=({}": lambda v: mb.Light("point", position=(v, 1, 1)),
    "light: direction=({}": lambda v: mb.Light("directional", direction=(v, 1, 1)),
    "environment: image: {} at pixel": lambda v: mb.Environment(spoilt((2, 4, 3), v)),
    "environment: intensity={}": lambda v: mb.Environment(np.ones((2, 4, 3)), intensity=v),
    "environment: rotation={}": lambda v: mb.Environment(np.ones((2, 4, 3)), rotation=v),
    "scene: background=({}": lambda v: mb.Scene([], background=(v, 0, 0)),
    "scene: background: {} at pixel": lambda v: mb.Scene([], background=spoilt((2, 2, 3), v)),
    "scene: fps={}": lambda v: mb.Scene([], fps=v),
    "camera: position=({}": lambda v: camera(position=(v, 0, 0)),
    "camera: look_at=({}": lambda v: camera(look_at=(v, 0, 0)),
    "camera: up=({}": lambda v: camera(up=(v, 0, 0)),
    "camera: focal_length={}": lambda v: camera(focal_length=v),
    "camera: vertical_aperture={}": lambda v: camera(focal_length=50, vertical_aperture=v),
    "camera: f_stop={}": lambda v: camera(f_stop=v, focus_distance=1),
    "camera: focus_distance={}": lambda v: camera(f_stop=1, focus_distance=v),
    "camera: sharp_range=(1, {}": lambda v: camera(**LENS, sharp_range=(1, v)),
    "camera: foreground_blur={}": lambda v: camera(**LENS, foreground_blur=v),
    "camera: meters_per_unit={}": lambda v: camera(**LENS, meters_per_unit=v),
    "shutter: close={}": lambda v: mb.Shutter(0, v),
    "shutter: curve=array([1": lambda v: mb.Shutter(curve=[1, v]),
    "shutter: line_offset={}": lambda v: mb.Shutter(rolling="down", line_offset=v, line_exposure=1),
    "track: frames: {} at key 1": lambda v: mb.Track([0, v], [0, 1]),
    "track: values: {} at key 1": lambda v: mb.Track([0, 1], [[0, 0], [v, 0]]),
    "transform: translation=({}": lambda v: mb.Transform(translation=(v, 0, 0)),
    "transform: rotation=({}": lambda v: mb.Transform(rotation=(v, 0, 0, 1)),
    "transform: scale=({}": lambda v: mb.Transform(scale=(v, 1, 1)),
    "transform: matrix: {} at row 0": lambda v: mb.Transform(matrix=np.diag([v, 1, 1, 1])),
}


@pytest.mark.parametrize("value", [1e39, 1e308])
@pytest.mark.parametrize("start", FIELDS)
def test_a_number_that_float32_cannot_carry_is_refused_by_name(start, value):
    with pytest.raises(mb.SceneError) as caught:
        FIELDS[start](value)
    assert str(caught.value).startswith(start.format(value))
    assert HOLDS in str(caught.value)
    FIELDS[start](1e9)


TABLE = {
    "camera": {"position": [0, 0, 4]},
    "lights": [{"kind": "ambient"}],
    "objects": [{"name": "o", "primitive": {"kind": "sphere"}, "material": {}}],
}
PLACES = {
    "camera.position": [0, None, 4],
    "camera.focal_length": None,
    "lights[0].intensity": None,
    "lights[0].color": [1, None, 1],
    "background": [0, 0, None],
    "fps": None,
    "objects[0].material.specular": [None, 0.5, 0.5],
    "objects[0].material.shininess": None,
    "objects[0].transform.scale": None,
    "objects[0].transform.translation": [None, 0, 0],
    "objects[0].transform.euler": [None, 0, 0],
    "objects[0].transform.keys": [{"frame": 0, "scale": 1}, {"frame": 1, "scale": None}],
    "objects[0].primitive.radius": None,
}


def filled(given, value):
    """``given`` with ``value`` for None."""
    if isinstance(given, dict):
        return {name: filled(item, value) for name, item in given.items()}
    if isinstance(given, list):
        return [filled(item, value) for item in given]
    return value if given is None else given


@pytest.mark.parametrize("value", ["1e39", "1e308", "1" + 400 * "0"])
@pytest.mark.parametrize("place", PLACES)
def test_a_scene_file_is_told_where_such_a_number_is(tmp_path, place, value):
    """Whole numbers too, which have no end."""
    table = json.loads(json.dumps(TABLE))
    *path, last = place.replace("[0]", ".0").split(".")
    at = table
    for name in path:
        at = at[int(name)] if name.isdigit() else at.setdefault(name, {})
    at[last] = filled(PLACES[place], "NUMBER")
    text = json.dumps(table).replace('"NUMBER"', value)
    (tmp_path / "s.json").write_text(text)
    with pytest.raises(mb.SceneError) as caught:
        mb.load(tmp_path / "s.json")
    assert str(caught.value).startswith(f"{tmp_path}/s.json: {place.split('.keys')[0]}")
    assert "\n" not in str(caught.value)
    (tmp_path / "s.json").write_text(text.replace(value, "2"))
    mb.load(tmp_path / "s.json")


def gltf(edit):
    def write(path):
        model = Gltf()
        model.triangle(material=0)
        model.node(mesh=0)
        model.json["materials"] = [{}]
        model.json["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}]
        model.json["scenes"][0]["nodes"].append(model.node(camera=0, translation=[0, 0, 4]))
        edit(model)
        return model.write(path / "m.glb")

    return write


def edited(kind, index, **fields):
    def edit(model):
        model.json[kind][index] |= fields

    return edit


def lit(model):
    model.json["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "point", "intensity": 1e39}
    ]}}  # fmt: skip
    model.json["nodes"][0]["extensions"] = {"KHR_lights_punctual": {"light": 0}}
    model.json["extensions"]["KHR_lights_punctual"]["lights"][0]["intensity"] = 1.5e39


def nested(count, value):
    def edit(model):
        nodes = model.json["nodes"]
        for _ in range(count):
            child = model.json["scenes"][0]["nodes"][0]
            nodes.append({"scale": [value] * 3, "children": [child]})
            model.json["scenes"][0]["nodes"][0] = len(nodes) - 1

    return edit


def text(name, content):
    def write(path):
        (path / name).write_text(content)
        return path / name

    return write


OBJ = "v 0 0 0\nv {} 0 0\nv 0 1 0\nf 1 2 3\n"
PLY = """ply
format ascii 1.0
element vertex 3
property double x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
{} 0 0
0 1 0
3 0 1 2
"""
USDA = """#usda 1.0
def Mesh "q" {{
 point3f[] points = [(-1,-1,0), ({point},-1,0), (-1,1,0)]
 int[] faceVertexCounts = [3]
 int[] faceVertexIndices = [0,1,2]
 {mesh}
}}
def Camera "c" {{
 float focalLength = {focal}
 double3 xformOp:translate = (0, 0, 4)
 uniform token[] xformOpOrder = ["xformOp:translate"]
}}
{more}
"""


def usda(point=1, mesh="", focal=50, more=""):
    return text("m.usda", USDA.format(point=point, mesh=mesh, focal=focal, more=more))


def exr(channel, value):
    def write(path):
        channels = {name: np.ones((2, 3), np.float32) for name in "RGBA"}
        channels[channel][1, 2] = value
        write_exr(path / "t.exr", ExrImage(channels, (3, 2), (0, 0), {}))
        return text("s.json", json.dumps({"background": "t.exr"}))(path)

    return write


PLACED = "double3 xformOp:scale = ({}, 1, 1)\n uniform token[] xformOpOrder = ['xformOp:scale']"
CROWD = """def PointInstancer "i" {{
 rel prototypes = [</q>]
 int[] protoIndices = [0]
 point3f[] positions = [(0,0,0)]
 float3[] scales = [({}, 1, 1)]
}}"""
FILES = {
    "gltf position": (gltf(nested(0, 1)), None),
    "gltf infinite": (
        gltf(lambda model: model.json["meshes"][0]["primitives"][0]["attributes"].update(
            POSITION=model.accessor([[0, 0, 0], [np.inf, 0, 0], [0, 1, 0]]))),
        "m.glb: mesh 'mesh 0': positions: inf at vertex 1",
    ),
    "gltf node": (gltf(edited("nodes", 0, scale=[1e39, 1, 1])), "m.glb: transform: scale=(1e+39"),
    "gltf emission": (
        gltf(edited("materials", 0, emissiveFactor=[1e308, 0, 0])),
        "m.glb: material: emission=(1e+308",
    ),
    "gltf metal": (
        gltf(edited("materials", 0, pbrMetallicRoughness={"metallicFactor": 1e39})),
        "m.glb: material '': metallicFactor=1e+39",
    ),
    "gltf light": (gltf(lit), "m.glb: light: intensity=4.77"),
    "gltf keys": (
        gltf(lambda model: model.animate(0, "scale", [0, 1], [[1, 1, 1], [np.inf, 1, 1]])),
        "m.glb: animations[0].channels[0]: track: values: inf at key 1",
    ),
    "gltf nested": (gltf(nested(2, 1e20)), "mesh 'mesh 0': vertex 1 is 1e+40 from the camera"),
    "gltf nested deep": (gltf(nested(9, 1e38)), "mesh 'mesh 0': its transform"),
    "obj": (text("m.obj", OBJ.format("1e39")), "m.obj: mesh 'm.obj': positions: 1e+39 at vertex 1"),
    "ply": (text("m.ply", PLY.format("1e308")), "positions: 1e+308 at vertex 1"),
    "usd points": (usda(point="1e39"), "m.usda: mesh 'q': positions: inf at vertex 1"),
    "usd colour": (
        usda(mesh="color3f[] primvars:displayColor = [(1e39, 0, 0)]"),
        "m.usda: mesh 'q': color: inf at face 0",
    ),
    "usd place": (usda(mesh=PLACED.format("1e39")), "mesh 'q': vertex 0 is 1e+39 from the camera"),
    "usd speed": (
        usda(mesh="point3f[] points.timeSamples = {0: [(0,0,0), (1,0,0), (0,1,0)]}\n"
                  " vector3f[] velocities.timeSamples = {0: [(1e39,0,0), (0,0,0), (0,0,0)]}"),
        "mesh 'q': its deformer or transform takes vertices to infinity",
    ),
    "usd camera": (usda(focal="1e39"), "m.usda: /c.focalLength=inf: expected a finite number"),
    "usd instance": (usda(more=CROWD.format("1e39")), "/i: its place at frame"),
    "exr infinite": (exr("G", np.inf), "t.exr: G is inf in row 1, column 2; every value must"),
    "exr nan": (exr("R", np.nan), "t.exr: R is nan in row 1, column 2"),
    "exr alpha": (exr("A", np.nan), "t.exr: A is nan in row 1, column 2"),
    "exr faint": (exr("A", 1e-40), "t.exr: R is inf in row 1, column 2"),
}  # fmt: skip


@pytest.mark.parametrize("kind", FILES)
def test_a_file_of_any_kind_is_told_where_such_a_number_is(tmp_path, kind):
    """In the file, or, of what moves, when it is rendered."""
    write, said = FILES[kind]
    path = write(tmp_path)
    if said is None:
        assert np.isfinite(mb.render(mb.load(path), **SMALL).rgba).all()
        return
    with pytest.raises(mb.SceneError) as caught:
        mb.render(mb.load(path), frame=1, **SMALL)
    assert said in str(caught.value)


def test_turns_and_counts_without_end_are_refused(tmp_path):
    """They would take as long, or as much memory."""
    keys = [{"frame": 0, "euler": [0, 0, 0]}, {"frame": 1, "euler": [0, 1e12, 0]}]
    for table, said in (
        ({"objects": [{"primitive": {"kind": "box"}, "transform": {"keys": keys}}]},
         r"objects\[0\]: transform: euler turns by 1e\+12 degrees"),
        ({"generator": {"name": "blades", "count": 10**39}}, "generator: blades: count=1000"),
    ):  # fmt: skip
        with pytest.raises(mb.SceneError, match=said):
            mb.load(table)


# How far, how near


def ball(size, shading="phong", light="point"):
    """A ball that moves, all of it ``size`` times as large."""
    moved = mb.Track([0, 2], [[0, 0, 0], [0.5 * size, 0, 0]])
    made = dataclasses.replace(
        sphere(size, 12), name="b", transform=mb.Transform(translation=moved),
        material=mb.Material(shading=shading, specular=(0.5, 0.5, 0.5), metallic=0.5),
    )  # fmt: skip
    placed = {"position": (2 * size, 2 * size, 3 * size), "intensity": 9 * size * size}
    more = {} if light == "directional" else placed
    lights = [mb.Light(light, direction=(-1, -1, -1), **more)]
    return mb.Scene([made], mb.Camera(position=(0, 0, 4 * size)), lights)


SIZES = {
    "directional": (2.0**-97, 2.0**97), "point": (2.0**-48, 2.0**57), "spot": (2.0**57,),
}  # fmt: skip
EACH_ONCE = (
    *(("directional", "metallic_roughness", "analytic"), ("point", "phong", "analytic")),
    *(("point", "metallic_roughness", "stochastic"), ("spot", "phong", "stochastic")),
)


@pytest.mark.parametrize(
    ("light", "shading", "method"),
    [
        case if case in EACH_ONCE else nightly(*case)
        for case in itertools.product(
            SIZES, ("phong", "metallic_roughness"), ("analytic", "stochastic")
        )
    ],
)
def test_a_scene_of_any_size_that_is_rendered_looks_as_of_size_one(light, shading, method):
    """From 1e-30 to 1e30, and with lights at a place, whose squares count, from 1e-15 to 1e18."""
    settings = mb.Settings(samples=2, method=method)
    one = mb.render(ball(1.0, shading, light), frame=1, settings=settings, **SMALL).rgba
    assert one[..., :3].max() > 0.3
    for size in SIZES[light]:
        film = mb.render(ball(size, shading, light), frame=1, settings=settings, **SMALL)
        assert film.rgba == pytest.approx(one, abs=1e-5)


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        (ball(2.0**62), "mesh 'b': vertex"),
        (ball(2.0**-62), r"every vertex is within .*; 1e-15 is the least .*, where a light has"),
        (ball(2.0**110, light="directional"), r"at most 1e\+30 can be rendered: use larger units"),
        (dataclasses.replace(ball(1.0), lights=[mb.Light("point", position=(0, 1e20, 0))]),
         r"light 0: its position is 1e\+20 from the camera; at most 1e\+18"),
        (dataclasses.replace(ball(1.0), lights=[mb.Light("spot", position=(0, 1, 0), transform=mb.
            Transform(scale=(1e20,) * 3, parent=mb.Transform(scale=(1e10,) * 3)))]),
         r"light 0: its position is 1e\+30 from the camera"),
        (dataclasses.replace(ball(1.0, light="directional"), camera=mb.Camera(position=mb.Track(
            [0, 1], [[0, 0, 4], [0, 0, 1e36]]))), "mesh 'b': vertex"),
        (dataclasses.replace(ball(1.0), camera=mb.Camera(position=(0, 0, 4), fov=1e-60)),
         "camera: fov make a focal length"),
    ],
)  # fmt: skip
def test_what_is_too_far_or_too_near_is_refused_by_name(scene, said):
    with pytest.raises(mb.SceneError, match=said):
        mb.render(scene, frame=1, **SMALL)


@pytest.mark.parametrize("size", [2.0**-40, 2.0**33, 2.0**90])
def test_normals_shade_the_same_however_much_a_transform_scales(size):
    """They grow with the square of it, and their squares are taken once more."""
    flat = mesh(normals=[[0.3, 0, 1], [-0.3, 0, 1], [0, 0.3, 1]])
    light = [mb.Light("directional", direction=(-1, 0, -2))]
    films = []
    for by in (1.0, size):
        placed = dataclasses.replace(flat, transform=mb.Transform(scale=(by,) * 3))
        scene = mb.Scene([placed], mb.Camera(position=(0, 0, 4 * by)), light)
        films.append(mb.render(scene, **SMALL).rgba)
    assert films[1] == pytest.approx(films[0], abs=1e-6)
    assert np.ptp(films[0][..., 0][films[0][..., 3] == 1.0]) > 0.05


# What no number says beforehand


def bright(light=1.0, opacity=1.0, **material):
    surface = mesh(material=mb.Material(name="m", opacity=opacity, **material))
    lights = [mb.Light("ambient", intensity=light)]
    return mb.Scene([surface], camera(), lights)


ONE = np.ones((2, 2, 3), np.float32)
TOO_BRIGHT = {
    "light on colour": (bright(1e25, base_color=(1e20, 1, 1)), "light 0 (ambient) is up to 1e+25"),
    "texture": (
        bright(base_color=(1e20, 1, 1), texture=mb.Texture(1e20 * ONE)),
        "texture of mesh 'a' is up to 1e+20",
    ),
    "emission": (
        bright(shading="metallic_roughness", emission=(1e20,) * 3,
               emission_texture=mb.Texture(1e20 * ONE)),
        "emission_texture of mesh 'a' is up to 1e+20",
    ),
    "blended": (
        bright(1e25, 0.5, base_color=(1e20, 1, 1)),
        "base_color of mesh 'a' is up to 1e+20",
    ),
    "sum of lights": (
        dataclasses.replace(bright(), lights=[mb.Light("ambient", intensity=3e38)] * 2),
        "light 1 (ambient) is up to 3e+38",
    ),
}  # fmt: skip


METHODS = {
    "exact": {},
    "triangulated": {"paths": "triangulated"},  # which are opaque
    "stochastic": {"method": "stochastic"},
    "accumulation": {"method": "accumulation"},
}
DAILY = {
    "exact": ("light on colour", "blended", "sum of lights"), "triangulated": ("light on colour",),
    "stochastic": ("texture", "sum of lights"), "accumulation": ("emission", "sum of lights"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "method"),
    [
        (kind, method) if kind in DAILY[method] else nightly(kind, method)
        for kind in TOO_BRIGHT
        for method in METHODS
        if (kind, method) != ("blended", "triangulated")
    ],
)
def test_a_product_that_float32_cannot_carry_names_pixel_and_cause(kind, method):
    settings = METHODS[method]
    scene, said = TOO_BRIGHT[kind]
    with pytest.raises(mb.SceneError) as caught:
        mb.render(scene, settings=mb.Settings(**settings), **SMALL)
    text = str(caught.value)
    column, row = map(int, text.partition(": ")[0].removeprefix("pixel (")[:-1].split(", "))
    seen = mb.render(bright(), settings=mb.Settings(**settings), **SMALL).rgba
    assert seen[row, column, 3] > 0.0
    assert "its colour is inf" in text or "its colour is nan" in text
    assert "mesh 'a' is seen there" in text
    assert said in text
    with pytest.raises(mb.SceneError, match=rf"^pixel \({column}, {row}\)"):  # of the whole frame
        mb.render(scene, settings=mb.Settings(**settings), crop=(column, row, 2, 1), **SMALL)


def test_a_mesh_says_which_of_its_numbers_are_beyond_float32_together():
    material = mb.Material(base_color=(1e20, 1, 1))
    with pytest.raises(
        mb.SceneError, match=r"mesh 'a': color, up to 1e\+20, and base_color, up to"
    ):
        mesh(color=(1e20, 1, 1), material=material)
    with pytest.raises(mb.SceneError, match=r"light: color, up to 1e\+20, and intensity, up to"):
        mb.Light("point", color=(1, 1e20, 1), intensity=1e20)


@pytest.mark.parametrize("method", ["analytic", "stochastic"])
def test_what_is_bright_but_not_too_bright_is_rendered(method):
    """Squares of it are beyond float32."""
    settings = mb.Settings(method=method)
    film = mb.render(bright(1e15, base_color=(1e15, 1, 1)), settings=settings, **SMALL)
    assert film.rgba.max() == pytest.approx(1e30)
    assert first_wrong(film) is None


def test_every_array_of_a_film_is_looked_at():
    aovs = "sharp,depth,normal,uv,forward,backward,crypto_object,deep,events,object"
    flying = dataclasses.replace(
        mesh(), transform=mb.Transform(translation=mb.Track([0, 2], [[-1, 0, 0], [1, 0, 4]]))
    )  # which passes the eye, so that flow is no number there
    scene = mb.Scene([flying], camera(position=(0, 0, 3)))
    film = mb.render(scene, frame=1, settings=mb.Settings(samples=1, aovs=aovs), **SMALL)
    assert np.isinf(film.depth).any()
    assert np.isinf(film.layers["depth"]).any()
    assert np.isnan(film.layers["forward"]).any()
    assert first_wrong(film) is None
    for value in (np.nan, np.inf, -np.inf):
        for name in ("rgba", "depth"):
            wrong = getattr(film, name).copy()
            wrong[7, 8] = value
            found = first_wrong(dataclasses.replace(film, **{name: wrong}, origin=(30, 20)))
            if (name, value) == ("depth", np.inf):
                assert found is None
            else:
                assert found[1:3] == (38, 27)
                assert np.array_equal(found[3], value, equal_nan=True)
        for name, layer in film.layers.items():
            if name == "object":
                continue
            wrong = layer.copy()
            wrong[7, 8] = value
            found = first_wrong(dataclasses.replace(film, layers=film.layers | {name: wrong}))
            means = (name, value) == ("depth", np.inf)
            means |= name in ("forward", "backward") and np.isnan(value)
            assert (found is None) == means, (name, value)
            assert means or found[:3] == (name, 8, 7)
        columns = {name: column.copy() for name, column in film.events.columns.items()}
        columns["g"][5] = value
        events = dataclasses.replace(film.events, columns=columns)
        pixel = int(film.events.pixel[5])
        found = first_wrong(dataclasses.replace(film, events=events))
        assert found[:3] == ("events' g", pixel % 16, pixel // 16)
        z = film.deep.z.copy()
        z[0] = value
        found = first_wrong(dataclasses.replace(film, deep=dataclasses.replace(film.deep, z=z)))
        place = int(np.flatnonzero(film.deep.counts.ravel())[0])
        assert found[:3] == ("deep image", place % 16, place // 16)


def test_the_command_line_leaves_no_file_of_such_a_film(tmp_path):
    (tmp_path / "s.toml").write_text(
        '[camera]\nposition = [0, 0, 4]\n[[lights]]\nkind = "ambient"\nintensity = 1e25\n'
        '[[objects]]\nname = "o"\nprimitive = { kind = "sphere", radius = 1 }\n'
        "material.base_color = [1e20, 0.5, 0.5]\n"
    )
    command = [sys.executable, "-m", "mbinterval", "render", "s.toml", "-o", "a.exr"]
    command += ["--width", "32", "--height", "24"]
    run = subprocess.run(command, cwd=tmp_path, text=True, capture_output=True, check=False)
    assert run.returncode == 3
    assert "s.toml: frame 1: pixel (" in run.stderr
    assert "mesh 'o' is seen there" in run.stderr
    assert not (tmp_path / "a.exr").exists()
