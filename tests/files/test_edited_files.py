"""Files that are edited between, while and after they are read: a scene is what was read of them.

Every kind of file that a scene may come from is written twice, with the same times and
mostly of the same size, so that nothing but its contents tells the second from the first.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time

import numpy as np
import pytest
from PIL import Image
from pxr import Sdf, Usd
from support.batch_processes import finish, start
from support.gltf_files import Gltf
from support.nightly import nightly_but

import mbinterval as mb
from mbinterval.bench.cases import Case
from mbinterval.files.exr import ExrImage, write_exr
from mbinterval.scene.formats.load import load_file
from mbinterval.scene.formats.usd import layers
from mbinterval.study.reference import fingerprint

LOOK = """[camera]
position = [0, 0, 4]
look_at = [0, 0, 0]
fov = 40
[[lights]]
kind = "ambient"
[[objects]]
material.double_sided = true
"""
MESH = """def Mesh "{name}" {{
 point3f[] points = [(-1,-1,0), ({x:5.2f},-1,0), (-1,1,0)]
 int[] faceVertexCounts = [3]
 int[] faceVertexIndices = [0,1,2]
 texCoord2f[] primvars:st = [(.2,.2), (.2,.2), (.2,.2)] (interpolation = "vertex")
 uniform token subdivisionScheme = "none"
 uniform bool doubleSided = 1
{more}}}
"""
USDA = '#usda 1.0\n(upAxis="Y")\n'


def picture(path, value):
    colour = np.full((2, 4, 3), (0.25, 0.75)[value], np.float32)
    if path.suffix == ".exr":
        channels = dict.fromkeys("RGB", colour[..., 0])
        write_exr(path, ExrImage(channels, (4, 2), (0, 0), {"padding": 1}))
    else:
        Image.fromarray((255 * colour).astype(np.uint8)).save(path)


def scene(folder, more):
    (folder / "s.toml").write_text(LOOK + more)
    return folder / "s.toml"


def toml(folder, value):
    size = (1, 2)[value]
    return scene(folder, f'primitive = {{ kind = "plane", size = [{size}, {size}] }}')


def plain_json(folder, value):
    table = {"objects": [{"primitive": {"kind": "box", "size": [1, 1, 1 + value]}}]}
    table["camera"] = {"position": [2, 2, 4], "look_at": [0, 0, 0]}
    (folder / "s.json").write_text(json.dumps(table))
    return folder / "s.json"


def texture(folder, value):
    picture(folder / "t.png", value)
    return scene(folder, 'primitive = { kind = "plane" }\nmaterial.texture = "t.png"')


def exr_texture(folder, value):
    picture(folder / "t.exr", value)
    return scene(folder, 'primitive = { kind = "plane" }\nmaterial.texture = "t.exr"')


def background(folder, value):
    picture(folder / "t.png", value)
    (folder / "s.toml").write_text('background = "t.png"\n')
    return folder / "s.toml"


def environment(folder, value):
    picture(folder / "t.exr", value)
    (folder / "s.toml").write_text('[camera]\n[environment]\nfile = "t.exr"\n')
    return folder / "s.toml"


def gltf(folder, value):
    """Buffer and image are files of their own; both change."""
    model = Gltf()
    uv = model.accessor([[0.2, 0.2]] * 3)
    model.triangle(attributes={"TEXCOORD_0": uv}, material=0)
    model.node(mesh=0)
    blob = np.frombuffer(bytes(model.blob), "<f4").copy()
    blob[np.argmax(blob)] += value
    model.json |= {
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"uri": "t.png"}],
        "buffers": [{"byteLength": len(model.blob), "uri": "b.bin"}],
    }
    picture(folder / "t.png", value)
    (folder / "b.bin").write_bytes(blob.tobytes())
    (folder / "m.gltf").write_text(json.dumps(model.json))
    return scene(folder, 'file = "m.gltf"')


def obj(folder, value):
    """The mesh, its library and its texture change."""
    picture(folder / "t.png", value)
    (folder / "m.mtl").write_text(f"newmtl m\nmap_Kd t.png\nKd {value} 1 1\n")
    (folder / "m.obj").write_text(
        f"mtllib m.mtl\nv 0 0 0\nv {1 + value} 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\n"
        "f 1/1 2/2 3/3\n"
    )
    return scene(folder, 'file = "m.obj"')


def ply(folder, value):
    (folder / "m.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
        "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        f"0 0 0\n{1 + value} 0 0\n0 1 0\n3 0 1 2\n"
    )
    return scene(folder, 'file = "m.ply"')


def benchmark(folder, value):
    start = np.array([[-1.0, -1, 0], [1, -1, 0], [-1, 1 + value, 0]])
    arrays = {"V0": start, "V1": start, "F": [[0, 1, 2]], "C": [[1.0, 0, 0]], "eye": [0.0, 0, 4],
              "fov": 40.0, "bg": 0.0, "W": 32, "H": 24}  # fmt: skip
    np.savez(folder / "s.npz", **arrays)
    return folder / "s.npz"


def layer(path, value, name="q", more=""):
    path.write_text(USDA + MESH.format(name=name, x=(1, -0.5)[value], more=more))


def usda(folder, value):
    layer(folder / "m.usda", value)
    return scene(folder, 'file = "m.usda"')


def binary(suffix):
    def write(folder, value):
        layer(folder / "m.usda", value)
        Sdf.Layer.OpenAsAnonymous(str(folder / "m.usda")).Export(str(folder / f"m{suffix}"))
        (folder / "m.usda").unlink()
        return scene(folder, f'file = "m{suffix}"')

    return write


def package(folder, value):
    from pxr import UsdUtils

    layer(folder / "m.usda", value)
    assert UsdUtils.CreateNewUsdzPackage(str(folder / "m.usda"), str(folder / "m.usdz"))
    (folder / "m.usda").unlink()
    (folder / "top.usda").write_text(USDA + 'def "r" (references = @./m.usdz@</q>) {\n}\n')
    return scene(folder, 'file = "top.usda"')


def reference(folder, value):
    layer(folder / "m.usda", value)
    (folder / "top.usda").write_text(USDA + 'def "r" (references = @./m.usda@</q>) {\n}\n')
    return scene(folder, 'file = "top.usda"')


def sublayer(folder, value):
    """The stage is the scene itself; its layer lies in a folder beside."""
    (folder / "a").mkdir(exist_ok=True)
    (folder / "b").mkdir(exist_ok=True)
    layer(folder / "b" / "m.usda", value)
    (folder / "a" / "s.usda").write_text("#usda 1.0\n(subLayers = [@../b/m.usda@])\n")
    return folder / "a" / "s.usda"


def nested(folder, value):
    (folder / "a").mkdir(exist_ok=True)
    layer(folder / "a" / "m.usda", value)
    (folder / "a" / "n.usda").write_text(USDA + 'def "n" (references = @./m.usda@</q>) {\n}\n')
    top = f'def "t" (payload = @{folder}/a/n.usda@</n>) {{\n}}\n'
    (folder / "top.usda").write_text(USDA + top)
    return scene(folder, 'file = "top.usda"')


def clips(folder, value):
    """Points come from a layer of its own for each stretch of time, one by an absolute path."""
    for name in ("c1", "c2"):
        (folder / f"{name}.usda").write_text(
            '#usda 1.0\nover "q" {\n point3f[] points.timeSamples = {\n'
            f"  0: [(-1,-1,0), ({(1, -0.5)[value]:5.2f},-1,0), (-1,1,0)],\n"
            "  9: [(-1,-1,0), (1,-1,0), (-1,1,0)]\n }\n}\n"
        )
    (folder / "manifest.usda").write_text('#usda 1.0\nover "q" {\n point3f[] points\n}\n')
    layer(folder / "m.usda", 0)
    text = (folder / "m.usda").read_text()
    text = text.replace(" point3f[] points = [(-1,-1,0), ( 1.00,-1,0), (-1,1,0)]\n", "")
    given = f"""(clips = {{ dictionary default = {{
        asset[] assetPaths = [@./c1.usda@, @{folder}/c2.usda@]
        asset manifestAssetPath = @./manifest.usda@
        string primPath = "/q"
        double2[] active = [(0, 0), (5, 1)]
        double2[] times = [(0, 0), (9, 9)]
    }} }}) {{"""
    (folder / "m.usda").write_text(text.replace("{", given, 1))
    return scene(folder, 'file = "m.usda"')


SHADED = """ rel material:binding = </q/m>
 def Material "m" {{
  token outputs:surface.connect = </q/m/s.outputs:surface>
  def Shader "s" {{
   uniform token info:id = "UsdPreviewSurface"
   color3f inputs:diffuseColor.connect = </q/m/t.outputs:rgb>
   token outputs:surface
  }}
  def Shader "t" {{
   uniform token info:id = "UsdUVTexture"
   asset inputs:file = @{file}@
   float2 inputs:st.connect = </q/m/r.outputs:result>
   float3 outputs:rgb
  }}
  def Shader "r" {{
   uniform token info:id = "UsdPrimvarReader_float2"
   string inputs:varname = "st"
   float2 outputs:result
  }}
 }}
"""


def usd_texture(folder, value):
    picture(folder / "t.png", value)
    layer(folder / "m.usda", 0, more=SHADED.format(file="./t.png"))
    return scene(folder, 'file = "m.usda"')


def usd_absolute_texture(folder, value):
    """By an absolute path, of a layer that is found by one."""
    picture(folder / "t.png", value)
    layer(folder / "m.usda", 0, more=SHADED.format(file=folder / "t.png"))
    top = f'def "r" (references = @{folder}/m.usda@</q>) {{\n}}\n'
    (folder / "top.usda").write_text(USDA + top)
    return scene(folder, 'file = "top.usda"')


MAKERS = (
    *(toml, plain_json, texture, exr_texture, background, environment, gltf, obj, ply, benchmark),
    *(usda, package, reference, sublayer, nested, clips, usd_texture, usd_absolute_texture),
)
KINDS = {make.__name__: make for make in MAKERS} | {"usdc": binary(".usdc")}


def film(scene):
    return mb.render(scene, frame=2, width=32, height=24, settings=mb.Settings(samples=1))


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def rewrite(make, folder, value):
    """Write a scene over another one, with the times of its files."""
    before = {path: path.stat() for path in contents(folder)}
    main = make(folder, value)
    for path, state in before.items():
        os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))
    return main


@pytest.mark.parametrize("kind", KINDS)
def test_a_scene_is_what_its_files_were_when_it_was_read(tmp_path, kind):
    """The second is as if there had been no first, which stays as it was."""
    folder, apart = tmp_path / "edited", tmp_path / "apart"
    for made in (folder, apart):
        made.mkdir()
    main = KINDS[kind](folder, 0)
    first, read = load_file(main), contents(folder)
    before = film(first.scene)
    assert rewrite(KINDS[kind], folder, 1) == main
    second = load_file(main)
    after, alone = film(second.scene), film(load_file(KINDS[kind](apart, 1)).scene)
    assert after.rgba.tobytes() == alone.rgba.tobytes() != before.rgba.tobytes()
    assert film(first.scene).rgba.tobytes() == before.rgba.tobytes()
    for loaded, there in ((first, read), (second, contents(folder))):
        digests = {path: hashlib.sha256(data).hexdigest() for path, data in there.items()}
        assert loaded.files == digests
        assert next(iter(loaded.files)) == main


CUT = """
import sys
import mbinterval as mb
from pathlib import Path
scene, path = mb.load("s.toml"), Path("m.usdc")
film = mb.render(scene, frame=3, width=32, height=24).rgba.tobytes()
path.write_bytes(path.read_bytes()[:100])
assert mb.render(scene, frame=3, width=32, height=24).rgba.tobytes() == film
try:
    mb.load("s.toml")
except mb.SceneError as error:
    assert "m.usdc" in str(error)
    print("refused")
"""


def test_a_binary_layer_that_is_cut_while_its_scene_lives_ends_no_process(tmp_path):
    """usd-core maps binary layers into memory, where what is cut off is a bus error."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "m.usdc"))
    mesh = stage.DefinePrim("/m", "Mesh")
    mesh.CreateAttribute("faceVertexCounts", Sdf.ValueTypeNames.IntArray).Set([3])
    mesh.CreateAttribute("faceVertexIndices", Sdf.ValueTypeNames.IntArray).Set([0, 1, 2])
    points = mesh.CreateAttribute("points", Sdf.ValueTypeNames.Point3fArray)
    for code in range(6):
        random = np.random.default_rng(code).uniform(-1, 1, (20_000, 3))
        points.Set([tuple(map(float, point)) for point in random], code)
    stage.Save()
    scene(tmp_path, 'file = "m.usdc"')
    run = subprocess.run(
        [sys.executable, "-c", CUT], cwd=tmp_path, text=True, capture_output=True, check=False
    )
    assert (run.returncode, run.stdout) == (0, "refused\n"), run.stderr


def test_stages_of_the_caller_are_neither_read_nor_changed(tmp_path):
    """What is in memory and not in the file is the caller's alone."""
    main = usda(tmp_path, 0)
    alone = film(mb.load(main))
    own = Usd.Stage.Open(str(tmp_path / "m.usda"))
    points = own.GetPrimAtPath("/q").GetAttribute("points")
    points.Set([(-1, -1, 0), (-0.5, -1, 0), (-1, 1, 0)])
    assert film(mb.load(main)).rgba.tobytes() == alone.rgba.tobytes()
    assert own.GetRootLayer().dirty
    assert points.Get()[1][0] == -0.5


@pytest.mark.parametrize("kind", ["usda", "usdc", "nested", "usd_absolute_texture"])
def test_a_file_that_changes_while_it_is_read_is_read_again(tmp_path, kind, monkeypatch):
    """Between its reading and its digest: the scene is that of the digest."""
    KINDS[kind](tmp_path, 0)
    edits = []

    def record(layers, real=layers.Layers.record):
        if not edits:
            edits.append(rewrite(KINDS[kind], tmp_path, 1))
        return real(layers)

    monkeypatch.setattr(layers.Layers, "record", record)
    loaded = load_file(tmp_path / "s.toml")
    assert edits
    assert loaded.files == {
        path: hashlib.sha256(data).hexdigest() for path, data in contents(tmp_path).items()
    }
    assert film(loaded.scene).rgba.tobytes() == film(mb.load(tmp_path / "s.toml")).rgba.tobytes()


def test_a_file_that_never_rests_is_told_of(tmp_path, monkeypatch):
    main, count = usda(tmp_path, 0), iter(range(99))

    def record(layers, real=layers.Layers.record):
        usda(tmp_path, next(count) % 2)
        return real(layers)

    monkeypatch.setattr(layers.Layers, "record", record)
    with pytest.raises(mb.SceneError, match=r"m\.usda: changes while it is read"):
        mb.load(main)


def test_a_file_that_differs_between_two_readings_of_one_scene_is_told_of(tmp_path, monkeypatch):
    """Two objects of one file, which is edited after the first of them."""
    from mbinterval.scene.formats.toml import build

    texture(tmp_path, 0)
    main = tmp_path / "s.toml"
    more = '\n[[objects]]\nprimitive = { kind = "plane" }\nmaterial.texture = "t.png"\n'
    main.write_text(main.read_text() + more)

    def read_image(path, real=build.read_image):
        image = real(path)
        picture(tmp_path / "t.png", 1)
        return image

    monkeypatch.setattr(build, "read_image", read_image)
    with pytest.raises(mb.SceneError, match=r"t\.png: changed while the scene was read; load it"):
        mb.load(main)


def test_a_missing_layer_is_a_note_and_no_path_is_that_of_the_link(tmp_path, capfd):
    layer(tmp_path / "m.usda", 0, more=SHADED.format(file="/nowhere/t.png"))
    text = (tmp_path / "m.usda").read_text()
    (tmp_path / "m.usda").write_text(text + 'def "r" (references = @./none.usda@) {\n}\n')
    notes = mb.load(tmp_path / "m.usda").notes
    assert any(f"Could not open asset @{tmp_path}/none.usda@" in note for note in notes)
    assert any("texture not found: /nowhere/t.png" in note for note in notes)
    (tmp_path / "bad.usda").write_text("#usda 1.0\nnonsense {")
    with pytest.raises(mb.SceneError, match=r"bad\.usda") as caught:
        mb.load(tmp_path / "bad.usda")
    assert "mbinterval-usd" not in "".join((*notes, str(caught.value), *capfd.readouterr()))


@pytest.mark.parametrize("kind", ["usda", "clips", "gltf"])
def test_references_of_a_study_are_of_what_the_files_say(tmp_path, kind):
    """They are kept by a digest of all that was read, wherever it lies."""
    keys = []
    for number, value in enumerate((0, 1, 0)):
        (tmp_path / str(number)).mkdir()
        scene = mb.load(KINDS[kind](tmp_path / str(number), value))
        keys.append(fingerprint(Case("a", scene, 1.0, 8, 6), mb.Settings()))
    assert keys[0] == keys[2] != keys[1]


def test_what_is_not_known_by_contents_has_no_reference():
    mesh = mb.Mesh(np.eye(3), [[0, 1, 2]], deformer=object())
    with pytest.raises(mb.UsageError, match="not known by its contents"):
        fingerprint(Case("a", mb.Scene([mesh]), 1.0, 8, 6), mb.Settings())


def test_links_of_processes_that_were_killed_are_cleared_up(tmp_path, monkeypatch):
    """A day later; without a folder for them it is said what to do."""
    main = usda(tmp_path, 0)
    own = tmp_path / "temporary files"
    for name, age in (("old", 2 * 86400), ("new", 60)):
        folder = own / f"mbinterval-usd-{name}"
        folder.mkdir(parents=True)
        (folder / "root").symlink_to("/")
        os.utime(folder, (time.time() - age,) * 2)
    monkeypatch.setattr(tempfile, "tempdir", str(own))
    mb.load(main)
    assert [path.name for path in own.iterdir()] == ["mbinterval-usd-new"]
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "none"))
    with pytest.raises(mb.SceneError, match=r"m\.usda: .*cannot be made.*; set TMPDIR"):
        mb.load(main)


EDITED = """
import mbinterval.scene.formats.load as load
def load_file(*given, real=load.load_file, **more):
    loaded = real(*given, **more)
    {edit}
    return loaded
load.load_file = load_file
"""
EDIT = {
    "usda": "path = 'm.usda'; text = open(path).read().replace(' 1.00', '-0.50')",
    "ply": "path = 'm.ply'; text = open(path).read().replace('1 0 0', '2 0 0')",
    "toml": "path = 'own.toml'; text = open(path).read().replace('[1, 1]', '[2, 2]')",
}


@pytest.mark.parametrize("kind", nightly_but(EDIT, "usda", "ply"))
def test_a_frame_is_known_by_what_was_rendered_not_by_what_came_after(tmp_path, kind):
    """The file is edited when the job has read it; the next job sees that the frame is another."""
    KINDS[kind](tmp_path, 0).rename(tmp_path / "own.toml")
    edit = EDITED.format(edit=f"{EDIT[kind]}; open(path, 'w').write(text)")
    source = 'import sys\nsys.argv += ["--frames", "1"]\n'
    run = "from mbinterval import cli\nmain = cli.main\n"
    run += 'cli.main = lambda given: main(["render", "own.toml", *given[2:]])\n'
    code, said = finish(start(tmp_path, before=edit + source + run))
    assert code == 0, said
    code, said = finish(start(tmp_path, before=source + run))
    assert code == 0, said
    assert "complete" not in said
    edited = mb.Film.read(tmp_path / "a.0001.exr")
    alone = mb.render(mb.load(tmp_path / "own.toml"), frame=1, width=160, height=120)
    assert edited.rgba.tobytes() == alone.rgba.tobytes()
    code, said = finish(start(tmp_path, before=source + run))
    assert (code, said.count("is complete")) == (0, 1)
