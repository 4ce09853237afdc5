"""Scene files: every error at once, each with its path; relative paths; equal formats."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from mbinterval.errors import SceneError
from mbinterval.scene import generators
from mbinterval.scene.formats.load import load, load_file

QUAD = {
    "positions": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]],
    "faces": [[0, 1, 2], [0, 2, 3]],
}


def problems(table, **options):
    """Lines of the error that ``table`` raises, without the file's name."""
    with pytest.raises(SceneError) as caught:
        load(table, **options)
    head, *lines = str(caught.value).split("\n  ")
    if lines:
        assert head == f"scene: {len(lines)} errors"
        return lines
    return [head.removeprefix("scene: ")]


def test_a_misspelt_field_has_its_path_and_the_nearest_name():
    key = {"frame": 1, "rotaton": [0, 0, 0, 1]}
    table = {"objects": [QUAD, QUAD, QUAD | {"transform": {"keys": [key]}}]}
    assert problems(table) == [
        "objects[2].transform.keys[0].rotaton: unknown field, did you mean rotation?"
    ]


def test_every_error_is_reported_at_once():
    table = {
        "fsp": 24,
        "fps": "many",
        "camera": {"fov": 200, "focal_length": 35, "look_att": [0, 0, 0]},
        "shutter": {"open": 0.5, "close": 0.5},
        "lights": [{"kind": "sun"}, {"color": [1, 1, 1]}],
        "objects": [
            QUAD | {"visible": "yes", "material": {"shading": "flat", "shininess": 0}},
            {"file": "nowhere.obj", "positions": [[0, 0, 0]]},
            {"primitive": {"kind": "box", "radius": 1}},
            {},
            7,
        ],
        "settings": {"oclusion": 64, "samples": 0},
        "render": {"width": 0, "height": 1.5},
    }
    found = {line.split(": ")[0]: line.split(": ", 1)[1] for line in problems(table)}
    expected = {
        "fsp": "unknown field, did you mean fps?",
        "fps": "expected a number, got 'many'",
        "camera": "fov and focal_length both given",
        "camera.fov": "expected less than 180, got 200",
        "camera.look_att": "unknown field, did you mean look_at?",
        "shutter": "close must come after open",
        "lights[0].kind": "expected 'ambient', 'directional', 'point' or 'spot', got 'sun'",
        "lights[1].kind": "is missing",
        "objects[0].visible": "expected true or false, got 'yes'",
        "objects[0].material.shading": "expected 'unlit', 'phong' or 'metallic_roughness'",
        "objects[0].material.shininess": "expected greater than 0, got 0",
        "objects[1].file": "file not found: tried nowhere.obj",
        "objects[1]": "give one of file, positions (with faces) and primitive, found file and",
        "objects[2].primitive.radius": "a box has only size",
        "objects[3]": "give one of file, positions (with faces) and primitive, found none",
        "objects[4]": "expected a table, got 7",
        "settings.oclusion": "unknown field, did you mean occlusion?",
        "settings.samples": "0: expected a whole number from 1 to 4096",
        "render.width": "expected greater than or equal to 1, got 0",
        "render.height": "expected a whole number, got 1.5",
    }
    for path, text in expected.items():
        assert found[path].startswith(text), (path, found[path])
    extra = set(found) - set(expected)
    assert not extra


@pytest.mark.parametrize(
    ("fields", "path", "text"),
    [
        ({"translation": [1, 2]}, "translation", "expected a list of 3 finite numbers, got [1, 2]"),
        ({"translation": [1, 2, float("nan")]}, "translation", "expected a list of 3 finite"),
        ({"translation": [1, 2, True]}, "translation", "expected a list of 3 finite"),
        ({"rotation": [0, 0, 0, 0]}, "rotation", "a quaternion [x, y, z, w] of length 0"),
        ({"rotation": [0, 0, 0, 1], "euler": [0, 0, 0]}, "", "rotation and euler both given"),
        ({"interpolation": "cubic"}, "interpolation", "expected 'linear' or 'step', got 'cubic'"),
        ({"keys": [{"translation": [0, 0, 0]}]}, "keys[0].frame", "is missing"),
        ({"keys": {}}, "keys", "expected a list, got {}"),
        (
            {"keys": [{"frame": 5}, {"frame": 5}]},
            "keys[1].frame",
            "5 must come after 5, the key before it",
        ),
        (
            {"scale": 2, "keys": [{"frame": 1, "scale": 1}]},
            "scale",
            "is given here and in keys; give it in one place",
        ),
    ],
)
def test_errors_of_a_transform(fields, path, text):
    place = "objects[0].transform" + (f".{path}" if path else "")
    lines = problems({"objects": [QUAD | {"transform": fields}]})
    assert len(lines) == 1
    assert lines[0].startswith(f"{place}: {text}")


@pytest.mark.parametrize(
    ("item", "path", "text"),
    [
        ({"positions": QUAD["positions"]}, ".faces", "is missing; positions need faces"),
        ({"positions": [[0, 0], [1]], "faces": [[0]]}, ".positions", "expected rows of numbers"),
        ({"primitive": {"kind": "plane", "size": [1, 2, 3]}}, ".primitive.size", "a plane has 2"),
        ({"primitive": {"kind": "sphere", "segments": 2}}, ".primitive.segments", "expected great"),
        (QUAD | {"clip": "walk"}, ".clip", "only a glTF file"),
        ({"primitive": {"kind": "box"}, "uv": [[0, 0]]}, ".uv", "only goes with positions"),
        (QUAD | {"color": [1, 1]}, ".color", "has shape (2,), expected (3,)"),
        (QUAD | {"name": "x", "uv": [[0, 0]]}, ".uv", "have shape (1, 2), expected (4, 2)"),
        (QUAD | {"faces": [[0, 1, 2.5]]}, ".faces", "array([[0. , 1. , 2.5]]): expected (F, 3)"),
        (QUAD | {"motion_segments": 0}, ".motion_segments", "expected greater than or equal to 1"),
    ],
)
def test_errors_of_an_object(item, path, text):
    lines = problems({"objects": [item]})
    assert len(lines) == 1
    assert lines[0].startswith(f"objects[0]{path}: {text}")


def test_what_the_files_hold_is_reported_for_all_objects_at_once(tmp_path):
    (tmp_path / "broken.glb").write_bytes(b"glTF nonsense")
    (tmp_path / "empty.obj").write_text("# nothing\n")
    (tmp_path / "notes.txt").write_text("not a mesh\n")
    (tmp_path / "broken.png").write_bytes(b"\x89PNG nonsense")
    table = {
        "background": "broken.png",
        "objects": [{"file": "broken.glb"}, QUAD, {"file": "empty.obj"}, {"file": "notes.txt"}]
        + [QUAD | {"material": {"texture": "broken.png"}}],
    }
    lines = problems(table, base=tmp_path)
    starts = [f"objects[{index}].file" for index in (0, 2, 3)]
    starts += ["objects[4].material.texture", "background"]
    assert [line.split(":")[0] for line in lines] == starts
    names = ["broken.glb", "empty.obj", "notes.txt", "broken.png", "broken.png"]
    for line, name in zip(lines, names, strict=True):
        assert str(tmp_path / name) in line
    assert "can't be read; known: " in lines[2]
    assert lines[4].endswith("not a kind of image that is known, or broken; save it as PNG or EXR")


def test_what_records_refuse_has_its_path_in_the_file_all_of_it_at_once():
    table = {
        "camera": {"sharp_range": [2, 1], "f_stop": 2, "focus_distance": 3},
        "shutter": {"rolling": "down", "line_exposure": 0.1},
        "lights": [{"kind": "ambient"}, {"kind": "directional", "direction": [0, 0, 1]}],
        "objects": [QUAD, QUAD | {"name": "a", "normals": [[0, 0, 1]]}],
        "generator": {"name": "ho17_cubes", "count": 2},
    }
    assert problems(table) == [
        "objects[1].normals: have shape (1, 3), expected (4, 3)",
        "camera.sharp_range: (2.0, 1.0): expected nearest and farthest distance, above 0",
        "shutter: rolling without line_offset; give it in seconds",
    ]


def test_settings_that_do_not_go_together_are_reported_beside_other_errors():
    """Each by the field that the file gives; beside a partner that is wrong itself, nothing."""
    table = {"fps": 0, "settings": {"max_intervals": 90, "partial_bits": True, "samples": 0}}
    found = dict(line.split(": ", 1) for line in problems(table))
    assert set(found) == {"fps"} | {
        f"settings.{name}" for name in ("max_intervals", "partial_bits", "samples")
    }
    assert found["settings.max_intervals"].startswith("max_intervals=90 with paths='exact': exact")
    assert found["settings.partial_bits"].endswith("give occlusion a number of bits, 32 to 1024")
    table = {"settings": {"max_intervals": 90, "paths": "exakt"}}
    assert [line.split(":")[0] for line in problems(table)] == ["settings.paths"]
    table = {"settings": {"pattern": "sobol", "paths": "triangulated"}}
    assert problems(table)[0].startswith("settings.pattern: pattern='sobol' with paths='triang")
    # What a caller overrules is judged by Settings, once it is joined with the caller's values.
    table = {"settings": {"max_intervals": 90}}
    assert load_file(table, overruled=["paths"]).settings == {"max_intervals": 90}
    with pytest.raises(SceneError, match=r"settings\.max_intervals"):
        load_file(table, overruled=["occlusion"])


TOML = """
fps = 30
background = "sky.png"
[camera]
position = [0, 0, 4]
look_at = [0, 0, 0]
[shutter]
open = 0
close = 0.5
[[lights]]
kind = "point"
position = [1, 2, 3]
intensity = 5
[[objects]]
name = "part"
file = "parts/quad.obj"
transform = { translation = [1, 0, 0], scale = 2 }
material = { base_color = [1, 0, 0], double_sided = false }
[settings]
samples = 9
[render]
width = 64
frames = "1-3"
"""


@pytest.fixture
def folder(tmp_path):
    import tomllib

    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "quad.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    Image.new("RGB", (3, 2), (188, 0, 0)).save(tmp_path / "sky.png")
    (tmp_path / "scene.toml").write_text(TOML)
    (tmp_path / "scene.json").write_text(json.dumps(tomllib.loads(TOML)))
    return tmp_path


def test_toml_json_and_dict_are_the_same_scene(folder, monkeypatch):
    """Paths are relative to the file, from whatever folder the program runs in."""
    import tomllib

    monkeypatch.chdir(folder / "parts")
    table = tomllib.loads(TOML)
    loaded = [
        load_file(folder / "scene.toml"),
        load_file(str(folder / "scene.json")),
        load_file(table, base=folder),
    ]
    for file in loaded:
        scene = file.scene
        assert scene.fps == 30
        assert (scene.shutter.open, scene.shutter.close) == (0, 0.5)
        assert scene.background.shape == (2, 3, 3)
        assert scene.background[0, 0, 0] == pytest.approx(((188 / 255 + 0.055) / 1.055) ** 2.4)
        assert scene.camera.look_at == (0, 0, 0)
        assert scene.lights[0].position == (1, 2, 3)
        (mesh,) = scene.meshes
        assert mesh.name == "part/quad.obj"
        assert mesh.material.base_color == (1, 0, 0)
        assert not mesh.material.double_sided
        np.testing.assert_array_equal(mesh.transform.at(0) @ [1, 1, 0, 1], [3, 2, 0, 1])
        assert dict(file.settings) == {"samples": 9}
        assert (file.render.width, file.render.height, file.render.frames) == (64, None, "1-3")
    assert (loaded[0].scene.name, loaded[2].scene.name) == ("scene", "scene")
    monkeypatch.chdir(folder)
    assert load(table).meshes  # without a base: relative to the current folder


def test_a_missing_file_names_the_path_that_was_tried(folder):
    (folder / "parts" / "quad.obj").unlink()
    tried = folder / "parts" / "quad.obj"
    with pytest.raises(SceneError) as caught:
        load(folder / "scene.toml")
    assert str(caught.value) == (
        f"{folder / 'scene.toml'}: objects[0].file: file not found: tried {tried}; "
        "a relative path is relative to the scene file"
    )


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.toml", "fps = 24\nname = = 3\n", r"not valid TOML: .*line 2, column 8"),
        ("a.json", '{"fps": 24,\n "name" 3}', r"not valid JSON: .*line 2, column 9"),
        ("a.json", "[1]", r"expected a table of fields, got list"),
        ("a.json", "[" * 100000, "nested too deeply"),
        ("a.json", '{"fps": ' + "9" * 5000 + "}", "digits"),
        ("a.json", '{"fps": NaN}', "fps: expected a finite number"),
        ("a.toml", b"name = '\xff'", "not UTF-8 text"),
    ],
    ids=["toml", "json", "list", "deep", "digits", "nan", "encoding"],
)
def test_syntax_errors_give_file_line_and_column(tmp_path, name, text, message):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(SceneError, match=message) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_missing_files_and_folders(tmp_path):
    with pytest.raises(SceneError, match=r"no\.toml: no such file"):
        load(tmp_path / "no.toml")
    with pytest.raises(SceneError, match="is a folder"):
        load(tmp_path)
    (tmp_path / "a.xyz123").write_text("")
    with pytest.raises(SceneError, match=r"'xyz123' can't be read; known: .*obj.*ply"):
        load(tmp_path / "a.xyz123")


def test_numpy_arrays_are_welcome_in_a_dict():
    positions = np.stack([np.array(QUAD["positions"], dtype=np.float32)] * 3)
    positions[2] += 1
    table = {
        "background": np.array([0.1, 0.2, 0.3]),
        "camera": {"position": np.array([0, 0, 5])},
        "objects": [{"positions": positions, "faces": np.array(QUAD["faces"])}],
    }
    scene = load(table)
    assert scene.meshes[0].times == 3
    assert scene.camera.position == (0, 0, 5)
    assert scene.background == (0.1, 0.2, 0.3)


def test_material_overrides_leave_the_rest_of_the_material(tmp_path):
    (tmp_path / "a.mtl").write_text("newmtl m\nKd 0.5 0.25 0.125\n")
    (tmp_path / "a.obj").write_text(
        "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n"
    )
    Image.new("RGB", (1, 1), (255, 255, 255)).save(tmp_path / "white.png")
    change = {"shading": "unlit", "texture": "white.png", "wrap": "mirror"}
    change |= {"alpha_mode": "mask", "alpha_cutoff": 0.25, "opacity": 0.75}
    plain, changed = load(
        {"objects": [{"file": "a.obj"}, {"file": "a.obj", "material": change}]}, base=tmp_path
    ).meshes
    assert plain.material.base_color == changed.material.base_color == (0.5, 0.25, 0.125)
    assert (plain.material.shading, changed.material.shading) == ("phong", "unlit")
    assert plain.material.texture is None
    assert changed.material.texture.wrap == "mirror"
    found = changed.material.alpha, changed.material.alpha_cutoff, changed.material.opacity
    assert found == ("mask", 0.25, 0.75)
    assert plain.material.alpha == "opaque"


def test_opacity_alone_blends_and_colours_may_have_alpha():
    glass = QUAD | {"material": {"opacity": 0.5}, "color": [1, 0, 0, 0.25]}
    mesh = load({"objects": [glass]}).meshes[0]
    assert mesh.material.alpha == "blend"
    assert mesh.color[:, 3].tolist() == [0.25] * len(mesh.faces)
    (problem,) = problems({"objects": [QUAD | {"material": {"opacity": 2}}]})
    assert problem.startswith("objects[0].material.opacity: expected less than or equal to 1")


def test_an_empty_file_is_an_empty_scene():
    scene = load({})
    assert scene.meshes == ()
    assert scene.camera is None


def test_camera_keys_may_be_given_field_by_field():
    keys = [
        {"frame": 0, "position": [0, 0, 5], "fov": 40},
        {"frame": 10, "position": [10, 0, 5]},
        {"frame": 20, "fov": 20},
    ]
    camera = load({"camera": {"look_at": [0, 0, 0], "keys": keys}}).camera
    assert camera.position.at(5).tolist() == [5, 0, 5]
    assert camera.fov.at(10) == 30
    assert camera.look_at == (0, 0, 0)


def test_importing_mbinterval_loads_no_file_library():
    code = "import sys, mbinterval.scene.formats.load; print(*sys.modules)"
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    loaded = set(result.stdout.split())
    assert "numpy" in loaded
    assert not loaded & {"pydantic", "trimesh", "pygltflib", "PIL", "OpenEXR"}


def test_what_does_not_fit_into_memory_is_named(monkeypatch):
    def make(**_):
        raise MemoryError

    monkeypatch.setitem(generators.GENERATORS, "fast_cubes", make)
    said = "generator: does not fit into memory; ask for less of it"
    assert problems({"generator": {"name": "fast_cubes"}}) == [said]


def test_an_empty_name_is_shown():
    (said,) = problems({"camera": {"": 3}})
    assert said.startswith("camera.'': unknown field")
