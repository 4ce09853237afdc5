"""What people get wrong with files, typed as they type it: what is said, and what is made of it."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from support.gltf_files import Gltf

from mbinterval import cli
from mbinterval.film.film import Film

FOX = Path(__file__).parents[2] / "scenes" / "assets" / "Fox.glb"
BOX = '[[objects]]\nname = "box"\nprimitive = { kind = "box", size = [1, 2, 3] }\n'
QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
ARRAYS = "[[objects]]\npositions = [[0,0,0],[1,0,0],[1,1,0],[0,1,0]]\nfaces = {}"
NO_CAMERA = "note: no camera: one that frames the scene was made"


@pytest.fixture
def render(tmp_path, monkeypatch, capsys):
    """Write a scene and render it; gives exit code, what was said, and the film."""
    monkeypatch.chdir(tmp_path)

    def run(name, text, *arguments):
        if text is not None:
            Path(name).write_text(text)
        size = ("--width", "24", "--height", "16", "--samples", "1", "--overwrite")
        code = cli.main(["render", name, *size, "-o", "x.exr", *arguments])
        said = capsys.readouterr().err
        assert "Traceback" not in said
        return code, said, None if code else Film.read("x.exr")

    return run


def textured(gltf: Gltf) -> Gltf:
    uv = gltf.accessor([[0, 0], [1, 0], [0, 1]])
    gltf.triangle(attributes={"TEXCOORD_0": uv}, material=0)
    gltf.node(mesh=0)
    gltf.json |= {
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"uri": "bark.png"}],
    }
    return gltf


def test_a_missing_texture_is_an_error_in_a_scene_file_and_a_note_in_a_model(
    render,
):
    code, said, _ = render("s.toml", BOX + 'material.texture = "bark.png"')
    assert code == 3
    assert "s.toml: objects[0].material.texture: file not found: tried bark.png; a relative" in said
    textured(Gltf()).write(Path("a.glb"))
    code, said, film = render("a.glb", None)
    assert code == 0
    assert "note: a.glb: texture not found: tried bark.png; left out" in said
    assert film.rgba[..., 3].max() > 0.0
    (Path("a.mtl")).write_text("newmtl m\nmap_Kd bark.png\n")
    code, said, film = render("a.obj", f"mtllib a.mtl\n{QUAD}usemtl m\nf 1 2 3\n")
    assert code == 0
    assert "note: a.obj: not found: tried bark.png; left out" in said


@pytest.mark.parametrize("clip", ["Wlak", "7"])
def test_an_unknown_clip_is_said_with_those_that_there_are(render, clip):
    shutil.copy(FOX, "Fox.glb")
    code, said, _ = render("Fox.glb", None, "--clip", clip)
    assert code == 3
    assert "Fox.glb: no clip " in said
    assert said.endswith("the file has: Survey, Walk, Run\n")


def test_a_frame_outside_of_the_animation_is_said_and_shows_its_end(render):
    shutil.copy(FOX, "Fox.glb")
    code, said, late = render("Fox.glb", None, "--frames", "500", "--clip", "Walk")
    assert code == 0
    assert "note: frame 500 is outside the animation that was read, frames 0 to 17" in said
    _, said, end = render("Fox.glb", None, "--frames", "18", "--clip", "Walk")
    assert "is outside" in said
    assert np.array_equal(late.rgba, end.rgba)
    assert "is outside" not in render("Fox.glb", None, "--frames", "10", "--clip", "Walk")[1]


def test_without_a_camera_one_is_made_and_said(render):
    code, said, film = render("s.toml", BOX)
    assert code == 0
    assert NO_CAMERA in said
    assert film.rgba[..., 3].max() == 1.0
    edge = np.ones((16, 24), bool)
    edge[1:-1, 1:-1] = False
    assert not film.rgba[edge, 3].any()
    code, said, _ = render("s.toml", None, "--camera", "side")
    assert code == 2
    assert "no camera 'side'; the scene has none: one that frames it is made" in said


def test_a_negative_scale_mirrors_and_turns_no_face_inside_out(render):
    camera = "[camera]\nposition = [1, 2, 8]\nlook_at = [0, 0, 0]\n"
    lights = '[[lights]]\nkind = "directional"\ndirection = [0, -1, -1]\n'
    single = f"{camera}{lights}{BOX}material.double_sided = false\n"
    turned = "transform = {{ euler = [20, 30, 0], scale = [{}, 1, 1] }}"
    films = [render("s.toml", single + turned.format(scale))[2] for scale in (1, -1)]
    # A box is its own mirror image; a face that was inside out would show the far side.
    assert films[0].rgba[..., 3].sum() > 20
    assert np.abs(films[0].rgba - films[1].rgba).max() < 1e-5
    np.testing.assert_allclose(films[0].depth, films[1].depth, atol=1e-5)


def test_an_empty_mesh_is_said(render):
    code, said, film = render("s.toml", ARRAYS.format("[]"))
    assert code == 0
    assert "note: no visible mesh: only the background is seen" in said
    assert not film.rgba[..., 3].any()
    code, said, _ = render("a.obj", QUAD)
    assert (code, said) == (3, "mbinterval: error: a.obj: holds no triangles\n")
    gltf = Gltf()
    gltf.node(name="nothing")
    gltf.write(Path("a.glb"))
    code, said, _ = render("a.glb", None)
    assert code == 0
    assert "note: no visible mesh" in said


def test_a_face_of_four_corners_is_cut_where_the_format_has_such_and_refused_where_not(render):
    code, _, quad = render("quad.obj", QUAD + "f 1 2 3 4\n")
    assert code == 0
    _, _, cut = render("cut.obj", QUAD + "f 1 2 3\nf 1 3 4\n")
    assert np.array_equal(quad.rgba, cut.rgba)
    assert not np.array_equal(quad.rgba, render("half.obj", QUAD + "f 1 2 3\n")[2].rgba)
    code, said, _ = render("s.toml", ARRAYS.format("[[0, 1, 2, 3]]"))
    assert code == 3
    assert "s.toml: objects[0].faces: have shape (1, 4), expected (F, 3); triangulate" in said


def test_a_mistyped_name_of_a_file_is_said(render):
    code, said, _ = render("nope.glb", None)
    assert (code, said) == (3, "mbinterval: error: nope.glb: no such file\n")
    textured(Gltf()).write(Path("a.gltf"))
    text = Path("a.gltf").read_text().replace("data:application/octet-stream;base64,", "x.bin?")
    code, said, _ = render("b.gltf", text)
    assert code == 3
    assert "b.gltf: file not found: tried x.bin?" in said
