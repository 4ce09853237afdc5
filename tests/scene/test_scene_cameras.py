"""Several cameras in one scene, chosen by name or place; and which files a scene was read from."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pxr import Gf, Sdf, Usd, UsdGeom
from support.gltf_files import Gltf

import mbinterval as mb
from mbinterval.errors import SceneError, UsageError
from mbinterval.exposure.framing import framing_camera
from mbinterval.scene.formats.load import load_file
from mbinterval.scene.model import Mesh, Scene, Viewpoint


def two_cameras(path: Path) -> Path:
    gltf = Gltf()
    gltf.triangle()
    gltf.node(mesh=0)
    lenses = [{"type": "perspective", "perspective": {"yfov": y, "znear": 0.1}} for y in (0.5, 1.0)]
    gltf.json["cameras"] = lenses
    gltf.node(camera=0, name="front", translation=[0, 0, 5])
    gltf.node(camera=1, name="side", translation=[5, 0, 0])
    gltf.json["scenes"][0]["nodes"] = [0, 1, 2]
    return gltf.write(path)


def eye(scene):
    return scene.camera.transform.at(0.0)[:3, 3].tolist()


def test_all_cameras_of_a_gltf_file_can_be_chosen(tmp_path):
    scene = mb.load(two_cameras(tmp_path / "a.glb"))
    assert scene.camera.name == "front"
    assert scene.notes == (
        "a.glb: has cameras front, side; the first is used unless another is asked for",
    )
    assert [eye(scene.through(name)) for name in ("front", "side")] == [[0, 0, 5], [5, 0, 0]]
    assert eye(scene.through("1")) == eye(scene.through(1)) == [5, 0, 0]
    for wrong in ("Side", "2", "-1"):
        with pytest.raises(UsageError, match=f"no camera '{wrong}'; the scene has front, side"):
            scene.through(wrong)
    with pytest.raises(UsageError, match="the scene has none"):
        mb.Scene(meshes=()).through("front")


def test_a_name_goes_before_a_place():
    cameras = [Viewpoint(mb.Camera(name=name)) for name in ("1", "b", "b")]
    scene = mb.Scene(meshes=(), cameras=cameras)
    assert [scene.camera_index(name) for name in ("0", "1", "b", "2")] == [0, 0, 1, 2]


def test_a_camera_of_a_usd_file_brings_its_own_shutter(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    mesh = UsdGeom.Mesh.Define(stage, "/m")
    mesh.CreatePointsAttr([Gf.Vec3f(*p) for p in ((0, 0, 0), (1, 0, 0), (0, 1, 0))])
    mesh.CreateFaceVertexCountsAttr([3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2])
    for name, closes in (("a", 0.75), ("b", 0.0)):
        camera = UsdGeom.Camera.Define(stage, f"/{name}")
        camera.CreateShutterCloseAttr(closes)
    stage.Save()
    scene = mb.load(tmp_path / "a.usda")
    windows = [
        (s.shutter.open, s.shutter.close) for s in (scene, scene.through("a"), scene.through("b"))
    ]
    assert windows == [(0.0, 0.75), (0.0, 0.75), (-0.25, 0.25)]
    (tmp_path / "s.toml").write_text('shutter.close = 1.0\n[[objects]]\nfile = "a.usda"')
    scene = mb.load(tmp_path / "s.toml")
    assert {scene.through(name).shutter.close for name in ("a", "b")} == {1.0}


def test_cameras_of_a_scene_file_come_before_those_of_its_models(tmp_path):
    two_cameras(tmp_path / "a.glb")
    table = {
        "cameras": [{"name": "near", "position": [0, 0, 1]}, {"position": [0, 0, 2]}],
        "objects": [{"file": "a.glb"}],
    }
    scene = mb.load(table, tmp_path)
    assert [view.camera.name for view in scene.cameras] == ["near", "", "front", "side"]
    assert scene.camera.position == (0, 0, 1)
    assert scene.through("1").camera.position == (0, 0, 2)
    one = mb.load({"camera": table["cameras"][1], "objects": table["objects"]}, tmp_path)
    assert [view.camera.name for view in one.cameras] == ["", "front", "side"]


def test_what_is_wrong_with_several_cameras_is_said_with_its_path():
    wrong = {
        "camera": {},
        "cameras": [
            {"name": "a", "fov": 30, "focal_length": 50},
            {"name": "a", "keys": [{"frame": 2, "fov": 1.0}, {"frame": 1, "fov": 2.0}]},
            {"lens": 3},
        ],
    }
    with pytest.raises(SceneError) as caught:
        mb.load(wrong)
    text = str(caught.value)
    assert "cameras: is given beside camera; give one of them" in text
    assert "cameras[0]: fov and focal_length both given; give one" in text
    assert "cameras[1].name: 'a' is the name of another camera" in text
    assert "cameras[1].keys[1].frame: 1 must come after 2" in text
    assert "cameras[2].lens: unknown field" in text


def names(loaded, folder):
    return [str(path.relative_to(folder)) for path in loaded.files]


def test_all_files_that_a_scene_is_read_from_are_known(tmp_path):
    """Whatever they are named by: the scene, a glTF file, or the material of an OBJ file."""
    image = Image.fromarray(np.full((2, 2, 3), 99, np.uint8))
    for name in ("sky", "own", "kd", "base"):
        image.save(tmp_path / f"{name}.png")
    two_cameras(tmp_path / "a.glb")
    gltf = Gltf()
    uv = gltf.accessor([[0, 0], [1, 0], [0, 1]])
    gltf.triangle(attributes={"TEXCOORD_0": uv}, material=0)
    gltf.node(mesh=0)
    texture = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    gltf.json |= {
        "materials": [texture],
        "textures": [{"source": 0}],
        "images": [{"uri": "base.png"}],
        "buffers": [{"byteLength": len(gltf.blob), "uri": "b.bin"}],
    }
    (tmp_path / "b.bin").write_bytes(gltf.blob)
    (tmp_path / "b.gltf").write_text(json.dumps(gltf.json))
    (tmp_path / "c.mtl").write_text("newmtl m\nmap_Kd kd.png\n")
    (tmp_path / "c.obj").write_text(
        "mtllib c.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"
    )
    (tmp_path / "s.toml").write_text(
        'background = "sky.png"\n[[objects]]\nfile = "a.glb"\nmaterial.texture = "own.png"\n'
        '[[objects]]\nfile = "b.gltf"\n[[objects]]\nfile = "c.obj"\n'
    )
    found = names(load_file(tmp_path / "s.toml"), tmp_path)
    assert found[0] == "s.toml"
    own = {"a.glb", "b.gltf", "b.bin", "base.png", "c.obj", "c.mtl", "kd.png"}
    assert set(found[1:]) == own | {"own.png", "sky.png"}
    assert len(found) == len(set(found))


def test_layers_and_textures_of_usd_are_known(tmp_path):
    from support.usd_files import bind, new_stage, quad, texture_file, textured

    below = new_stage(tmp_path)
    texture_file(tmp_path, [[[255, 0, 0]]])
    image = quad(below, "/world/image")
    bind(image, textured(below))
    uv = UsdGeom.PrimvarsAPI(image).CreatePrimvar(
        "map1", Sdf.ValueTypeNames.TexCoord2fArray, "vertex"
    )
    uv.Set([Gf.Vec2f(0, 0)] * 4)
    below.Save()
    inner = Path(below.GetRootLayer().realPath)
    top = Usd.Stage.CreateNew(str(tmp_path / "top.usda"))
    top.GetRootLayer().subLayerPaths.append(f"./{inner.name}")
    top.Save()
    found = names(load_file(tmp_path / "top.usda"), tmp_path)
    assert found[0] == "top.usda"
    assert sorted(found[1:]) == [inner.name, "t.png"]


@pytest.mark.parametrize("size", [1e31, 1e38])
def test_bounds_that_no_camera_can_see_are_refused(size):
    mesh = Mesh(positions=[[0, 0, 0], [size, 0, 0], [0, size, 0]], faces=[[0, 1, 2]])
    with pytest.raises(SceneError, match=r"bounds of mesh '' reach beyond 1e\+30.*give a camera"):
        framing_camera(Scene(meshes=[mesh]))
