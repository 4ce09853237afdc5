"""What a new user gets wrong: each is one short error that names object, field and remedy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import mbinterval as mb

TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
LENS = {"f_stop": 2.8, "focus_distance": 3.0}
NAN = float("nan")
ROLL = {"rolling": "down", "line_offset": 1e-5, "line_exposure": 1e-2}


def mesh(**fields):
    return mb.Mesh(**({"positions": TRIANGLE, "faces": [[0, 1, 2]], "name": "a"} | fields))


def scene(**fields):
    return mb.Scene(**({"meshes": [mesh()]} | fields))


def keyed(*values, **options):
    return mb.Track(range(len(values)), values, **options)


def camera(**fields):
    return mb.Camera(name="c", **fields)


WRONG = [
    (mesh, {"faces": [[0, 1, 2], [0, 1]]}, "mesh 'a': faces=", "rows of different lengths"),
    (mesh, {"faces": [[0, 1, 2, 0]]}, "mesh 'a': faces have shape (1, 4)", "triangulate"),
    (mesh, {"faces": [0, 1, 2]}, "mesh 'a': faces have shape (3,)", "expected (F, 3)"),
    (mesh, {"faces": [[0.0, 1, 2]]}, "mesh 'a': faces=", "(F, 3) integers"),
    (mesh, {"faces": None}, "mesh 'a': faces=None", "(F, 3) integers"),
    (mesh, {"faces": [[0, 1, 3]]}, "mesh 'a': face 0 is [0, 1, 3]", "from 0 to 2"),
    (mesh, {"faces": [[0, 1, -1]]}, "mesh 'a': face 0 is [0, 1, -1]", "from 0 to 2"),
    (mesh, {"positions": [[0, 0, 0], [1]]}, "mesh 'a': positions=", "as long as the others"),
    (mesh, {"positions": "box"}, "mesh 'a': positions='box'", "array of numbers"),
    (mesh, {"positions": TRIANGLE + 1j}, "mesh 'a': positions=", "array of numbers"),
    (mesh, {"positions": TRIANGLE[:, :2]}, "mesh 'a': positions have shape (3, 2)", "(N, 3)"),
    (mesh, {"positions": np.zeros((0, 3))}, "mesh 'a': positions hold no vertex", "leave"),
    (mesh, {"positions": np.zeros((2, 0, 3))}, "mesh 'a': positions hold no vertex", "leave"),
    (mesh, {"positions": TRIANGLE * NAN}, "mesh 'a': positions: nan at vertex 0", "finite"),
    (mesh, {"normals": "up"}, "mesh 'a': normals='up'", "array of numbers"),
    (mesh, {"uv": TRIANGLE}, "mesh 'a': uv have shape (3, 3)", "expected (3, 2)"),
    (mesh, {"color": "red"}, "mesh 'a': color='red'", "array of numbers"),
    (mesh, {"color": (1, 0)}, "mesh 'a': color has shape (2,)", "4 columns, the last being alpha"),
    (mesh, {"color": (1, 0, 0, 1.5)}, "mesh 'a': color: alpha is 1.5", "expected 0 to 1"),
    (mesh, {"color_domain": np.ones(2)}, "mesh 'a': color_domain=", "'vertex'"),
    (mesh, {"material": "red"}, "mesh 'a': material='red'", "expected a Material"),
    (mesh, {"material": mb.Material(), "shading": "unlit"}, "mesh 'a': material and sh", "one"),
    (mesh, {"shading": "flat"}, "mesh 'a': shading='flat'", "'unlit', 'phong'"),
    (mesh, {"motion_segments": 2.0}, "mesh 'a': motion_segments=2.0", "whole number"),
    (mesh, {"motion_segments": True}, "mesh 'a': motion_segments=True", "whole number"),
    (mesh, {"visible": "no"}, "mesh 'a': visible='no'", "True or False"),
    (mesh, {"name": 3}, "mesh: name=3", "expected a text"),
    (mesh, {"name": "", "uv": 1}, "mesh: uv have shape ()", "expected (3, 2)"),
    (mesh, {"transform": np.eye(4)}, "mesh 'a': transform=", "expected a Transform"),
    (mb.Texture, {"image": "a.png"}, "texture: image='a.png'", "read_image('a.png')"),
    (mb.Texture, {"image": Path("a.png")}, "texture: image=", "read_image('a.png')"),
    (mb.Texture, {"image": np.ones((2, 2))}, "texture: image has shape (2, 2)", "(h, w, 3)"),
    (mb.Texture, {"image": np.ones((2, 2, 3), np.uint8)}, "texture: image holds uint8", "linear"),
    (mb.Texture, {"image": np.full((1, 1, 3), 1e300)}, "texture: image: 1e+300", "up to 3.4e+38"),
    (mb.Texture, {"image": np.ones((1, 1, 3)), "wrap": ["a"]}, "texture: wrap=['a']", "'clamp'"),
    (mb.Material, {"texture": "a.png"}, "material: texture='a.png'", "read_image"),
    (mb.Material, {"texture": np.ones((2, 2, 3))}, "material: texture=", "a Texture, made of"),
    (mb.Material, {"base_color": "red"}, "material: base_color='red'", "three finite"),
    (mb.Material, {"base_color": (1, 0, 0, 1)}, "material: base_color=", "three finite"),
    (mb.Material, {"shininess": "high"}, "material: shininess='high'", "a number above 0"),
    (mb.Material, {"shininess": None}, "material: shininess=None", "a number above 0"),
    (mb.Material, {"shading": np.ones(2)}, "material: shading=", "'unlit'"),
    (mb.Material, {"double_sided": "no"}, "material: double_sided='no'", "True or False"),
    (mb.Material, {"opacity": 1.5}, "material: opacity=1.5", "up to 1"),
    (mb.Material, {"reflectivity": 1.5}, "material: reflectivity=1.5", "up to 1"),
    (mb.Material, {"reflection_shear": -0.1}, "material: reflection_shear=-0.1", "from 0"),
    (mb.Material, {"alpha_mode": "clip"}, "material: alpha_mode='clip'", "'mask'"),
    (mb.Material, {"alpha_cutoff": -1}, "material: alpha_cutoff=-1", "0"),
    (mb.Material, {"name": (1, 0, 0)}, "material: name=(1, 0, 0)", "a text"),
    (mb.Light, {"kind": "sun"}, "light: kind='sun'", "'directional'"),
    (mb.Light, {"kind": "point", "color": (1, 1, 1, 1)}, "light: color=", "three finite"),
    (
        mb.Light,
        {"kind": "spot", "inner_angle": 30, "outer_angle": 30},
        "light: inner_angle=30",
        "<",
    ),
    (mb.Light, {"kind": "spot", "outer_angle": 91}, "light: outer_angle=91", "90"),
    (mb.Light, {"kind": "spot", "direction": (0, 0, 0)}, "light: direction is zero", "the way"),
    (mb.Light, {"kind": "point", "intensity": "5"}, "light: intensity='5'", "a number from 0"),
    (mb.Light, {"kind": "directional", "direction": (0, 0)}, "light: direction=", "three"),
    (mb.Light, {"kind": "point", "position": keyed((0, 0, 0))}, "light: position=", "three"),
    (camera, {"position": (0, 0)}, "camera 'c': position=(0, 0)", "three finite"),
    (camera, {"position": None}, "camera 'c': position=None", "three finite"),
    (camera, {"up": None}, "camera 'c': up=None", "three finite"),
    (camera, {"fov": "45"}, "camera 'c': fov='45'", "above 0 and below 180"),
    (camera, {"fov": True}, "camera 'c': fov=True", "above 0 and below 180"),
    (camera, {"fov": [45]}, "camera 'c': fov=[45]", "above 0 and below 180"),
    (camera, {"fov": keyed((40, 1))}, "camera 'c': fov is keyed", "expected one number"),
    (camera, {"fov": keyed(40, 180)}, "camera 'c': fov has keys", "below 180"),
    (camera, {"position": keyed((0, 0))}, "camera 'c': position is keyed", "expected 3"),
    (camera, {"transform": np.eye(4)}, "camera 'c': transform=", "expected a Transform"),
    (camera, {"transform": mb.Transform(), "position": (1, 0, 0)}, "camera 'c': tran", "one"),
    (camera, {"transform": mb.Transform(), "up": (1, 0, 0)}, "camera 'c': transform and up", "one"),
    (camera, {"meters_per_unit": None}, "camera 'c': meters_per_unit=None", "above 0"),
    (camera, {"meters_per_unit": keyed(1)}, "camera 'c': meters_per_unit=", "above 0"),
    (camera, {"f_stop": 2.8}, "camera 'c': f_stop without focus_distance", "give"),
    (camera, LENS | {"blades": 5.5}, "camera 'c': blades=5.5", "whole number"),
    (camera, LENS | {"blades": 2}, "camera 'c': blades=2", "3 to 64"),
    (camera, LENS | {"blade_rotation": "x"}, "camera 'c': blade_rotation='x'", "finite number"),
    (camera, LENS | {"sharp_range": (1, 2, 3)}, "camera 'c': sharp_range=", "nearest and"),
    (camera, LENS | {"sharp_range": 1}, "camera 'c': sharp_range=1", "nearest and"),
    (camera, LENS | {"foreground_blur": NAN}, "camera 'c': foreground_blur=nan", "from 0"),
    (mb.Camera, {"name": 3}, "camera: name=3", "a text"),
    (mb.Shutter, {"open": "a"}, "shutter: open='a'", "finite number"),
    (mb.Shutter, {"open": 0.5, "close": 0}, "shutter: open=0.5, close=0", "open <= close"),
    (mb.Shutter, {"curve": None}, "shutter: curve=None", "array of numbers"),
    (mb.Shutter, {"curve": [1]}, "shutter: curve=[1]", "2 to 1024 values"),
    (mb.Shutter, {"opening": "x"}, "shutter: opening='x'", "up to 1"),
    (mb.Shutter, {"rolling": True}, "shutter: rolling=True", "'down', 'up'"),
    (mb.Shutter, {"rolling": "down"}, "shutter: rolling without line_offset", "seconds"),
    (mb.Shutter, ROLL | {"line_offset": "1"}, "shutter: line_offset='1'", "from 0"),
    (mb.Shutter, ROLL | {"line_exposure": NAN}, "shutter: line_exposure=nan", "above 0"),
    (mb.Track, {"frames": [0, 1], "values": [[0], [1, 1]]}, "track: values=", "as long"),
    (mb.Track, {"frames": "ab", "values": [1, 2]}, "track: frames='ab'", "array of numbers"),
    (mb.Track, {"frames": 0, "values": 1}, "track: () key times", "at least one"),
    (mb.Track, {"frames": [0, 1], "values": [1]}, "track: (2,) key times", "as many"),
    (mb.Track, {"frames": [1, 0], "values": [1, 2]}, "track: key times must inc", "[1.0, 0.0]"),
    (mb.Track, {"frames": [0], "values": [1], "interpolation": 3}, "track: interp", "'linear'"),
    (mb.Track, {"frames": [0], "values": [1], "quaternion": 1}, "track: quaternion=1", "True or"),
    (mb.Track, {"frames": [0], "values": [[0, 0, 1]], "quaternion": True}, "track: rot", "x, y"),
    (mb.Transform, {"translation": (1, 2)}, "transform: translation=(1, 2)", "three finite"),
    (mb.Transform, {"scale": 2}, "transform: scale=2", "three finite"),
    (mb.Transform, {"rotation": (0, 90, 0)}, "transform: rotation=", "a quaternion x, y, z, w"),
    (mb.Transform, {"rotation": (0, 0, 0, 0)}, "transform: rotation is a quaternion of", "give"),
    (mb.Transform, {"rotation": keyed((0, 90, 0))}, "transform: rotation is keyed", "expected 4"),
    (mb.Transform, {"rotation": keyed((0, 0, 0, 1))}, "transform: rotation is k", "quaternion=T"),
    (mb.Transform, {"translation": keyed((0, 0))}, "transform: translation is k", "expected 3"),
    (mb.Transform, {"matrix": np.eye(3)}, "transform: matrix=", "4 x 4 finite"),
    (mb.Transform, {"matrix": np.eye(4) * NAN}, "transform: matrix=", "4 x 4 finite"),
    (mb.Transform, {"matrix": np.eye(4)[[3, 0, 1, 2]]}, "transform: the last row", "transpose"),
    (mb.Transform, {"parent": np.eye(4)}, "transform: parent=", "a Transform"),
    (scene, {"meshes": None}, "scene: meshes is NoneType", "a list of Mesh"),
    (scene, {"meshes": mesh()}, "scene: meshes is Mesh", "into a list"),
    (scene, {"meshes": [TRIANGLE]}, "scene: meshes[0] is ndarray", "expected Mesh"),
    (scene, {"lights": mb.Light("point")}, "scene: lights is Light", "into a list"),
    (scene, {"camera": (0, 0, 0)}, "scene: camera=(0, 0, 0)", "a Camera"),
    (scene, {"shutter": (-0.25, 0.25)}, "scene: shutter=", "a Shutter"),
    (scene, {"fps": "24"}, "scene: fps='24'", "a number above 0"),
    (scene, {"fps": None}, "scene: fps=None", "a number above 0"),
    (scene, {"background": "sky.exr"}, "scene: background='sky.exr'", "read_image('sky.exr')"),
    (scene, {"background": (1, 1, 1, 1)}, "scene: background=(1, 1, 1, 1)", "three finite"),
    (scene, {"background": None}, "scene: background=None", "or an image"),
    (scene, {"background": np.ones((2, 2, 2))}, "scene: background has shape", "(h, w, 3)"),
    (scene, {"name": 3}, "scene: name=3", "a text"),
    (mb.load, {"source": None}, "None", "the path of a file"),
    (mb.load, {"source": "a\0b"}, "'a\\x00b'", "the path of a file"),
    (mb.load, {"source": {}, "base": 3}, "base=3", "a folder"),
    (mb.read_image, {"path": None}, "image None", "the path of a file"),
]


@pytest.mark.parametrize(
    ("make", "fields", "start", "remedy"), WRONG, ids=[f"{w[2]}-{n}" for n, w in enumerate(WRONG)]
)
def test_a_wrong_input_is_an_error_that_names_object_field_and_remedy(make, fields, start, remedy):
    with pytest.raises(mb.SceneError) as caught:
        make(**fields)
    text = str(caught.value)
    assert text.startswith(start)
    assert remedy in text
    assert "\n" not in text
    assert len(text) < 240
    assert caught.value.__suppress_context__ or caught.value.__context__ is None


@pytest.mark.parametrize(
    ("arguments", "start"),
    [
        ({"scene": "a.toml"}, "scene is str: expected a Scene; mbinterval.load reads"),
        ({"settings": {"samples": 4}}, "settings is dict: expected mbinterval.Settings"),
        ({"frame": "1"}, "frame='1': expected a finite number"),
        ({"frame": 10**400}, "frame=1000"),
        ({"width": 8.0}, "width=8.0: expected a whole number from 1 to 65536"),
        ({"height": True}, "height=True: expected a whole number"),
        ({"width": 65537}, "width=65537: expected a whole number"),
        ({"crop": "0,0,4,4"}, "crop='0,0,4,4': expected four whole numbers"),
        ({"progress": True}, "progress=True: expected a function"),
    ],
)
def test_wrong_arguments_of_render_are_usage_errors(arguments, start):
    with pytest.raises(mb.UsageError) as caught:
        mb.render(**({"scene": scene(), "width": 8, "height": 8} | arguments))
    assert str(caught.value).startswith(start)


def test_what_is_right_but_unusual_is_taken_and_stored_plainly():
    assert mesh(faces=[]).faces.shape == (0, 3)
    assert mesh(motion_segments=np.int64(3)).motion_segments == 3
    assert scene(fps=np.float32(25)).fps == 25.0
    assert mb.Camera(fov=np.int32(40)).fov == 40.0
    assert mb.Camera(**LENS, sharp_range=[1, 2]).sharp_range == (1.0, 2.0)
    assert mb.Transform(translation=np.ones(3), matrix=np.eye(4).tolist()).at(0)[0, 3] == 1.0
    assert mb.Shutter(curve=np.ones(3)).curve == (1.0, 1.0, 1.0)
    assert scene(background=[0, 0.5, 1]).background == (0.0, 0.5, 1.0)


def test_an_image_file_becomes_a_texture_or_a_background(tmp_path):
    Image.new("RGBA", (3, 2), (255, 0, 0, 128)).save(tmp_path / "red.png")
    pixels = mb.read_image(tmp_path / "red.png")
    assert mb.Texture(pixels).image.shape == (2, 3, 4)
    background = scene(background=pixels).background
    assert background.shape == (2, 3, 3)
    assert np.array_equal(background[..., 0], np.ones((2, 3)))
    (tmp_path / "bad.png").write_bytes(b"\x89PNG nonsense")
    with pytest.raises(mb.SceneError, match=r"bad\.png: not a kind of image") as caught:
        mb.read_image(tmp_path / "bad.png")
    assert "object at" not in str(caught.value)


def test_a_scene_without_anything_visible_says_so_and_renders_its_background():
    for empty in (
        scene(meshes=[]),
        scene(meshes=[mesh(visible=False)]),
        scene(meshes=[mesh(faces=[])]),
    ):
        film = mb.render(empty, width=4, height=3, settings=mb.Settings(samples=1))
        assert "no visible mesh: only the background is seen" in film.notes
    film = mb.render(scene(), width=4, height=3, settings=mb.Settings(samples=1))
    assert film.notes == (
        "no camera: one that frames the scene was made", "no lights: a headlight was added",
    )  # fmt: skip
