"""The glTF reader: every kind of accessor, nodes, animation, materials, broken files."""

from __future__ import annotations

import io
import json
import struct

import numpy as np
import pytest
from PIL import Image
from support.gltf_files import Gltf

from mbinterval.errors import SceneError
from mbinterval.exposure.exposure import expose
from mbinterval.scene.formats.gltf.data import GltfData
from mbinterval.scene.formats.gltf.gltf import read_gltf
from mbinterval.scene.formats.load import load
from mbinterval.scene.model import Scene


def png(pixels):
    stream = io.BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8)).save(stream, "PNG")
    return stream.getvalue()


@pytest.mark.parametrize("code", "bBhHIf")
@pytest.mark.parametrize("width", [1, 2, 3, 4])
def test_accessors_of_every_component_type_and_width(tmp_path, code, width):
    gltf = Gltf()
    values = np.arange(5 * width).reshape(5, width) % 100
    index = gltf.accessor(values if width > 1 else values[:, 0], code)
    data = GltfData(gltf.write(tmp_path / "a.glb"))
    read = data.accessor(index)
    assert read.shape == ((5,) if width == 1 else (5, width))
    np.testing.assert_array_equal(read.reshape(5, width), values)


@pytest.mark.parametrize(
    ("code", "stored", "meant"),
    [
        ("B", [0, 51, 255], [0.0, 0.2, 1.0]),
        ("H", [0, 13107, 65535], [0.0, 0.2, 1.0]),
        ("b", [-128, -127, 127], [-1.0, -1.0, 1.0]),
        ("h", [-32768, -32767, 32767], [-1.0, -1.0, 1.0]),
    ],
)
def test_normalized_integers(tmp_path, code, stored, meant):
    gltf = Gltf()
    index = gltf.accessor(stored, code, normalized=True)
    plain = gltf.accessor(stored, code)
    data = GltfData(gltf.write(tmp_path / "a.glb"))
    np.testing.assert_allclose(data.accessor(index), meant, rtol=1e-15)
    np.testing.assert_array_equal(data.accessor(plain), stored)


def test_strides_and_offsets_of_interleaved_data(tmp_path):
    gltf = Gltf()
    rows = [(9, 1.5, 2.5, 3.5), (9, 4.5, 5.5, 6.5), (9, 7.5, 8.5, 9.5)]
    data = b"".join(struct.pack("<I3f", *row) for row in rows)
    index = gltf.raw_accessor(data, (3, 3), "f", stride=16, byteOffset=4)
    read = GltfData(gltf.write(tmp_path / "a.glb")).accessor(index)
    np.testing.assert_array_equal(read, [row[1:] for row in rows])


@pytest.mark.parametrize("with_base", [True, False])
def test_sparse_accessors(tmp_path, with_base):
    gltf = Gltf()
    index = gltf.accessor([[1, 1, 1]] * 4)
    sparse = {
        "count": 2,
        "indices": {"bufferView": gltf.view(bytes([1, 3])), "componentType": 5121},
        "values": {"bufferView": gltf.view(struct.pack("<6f", 2, 3, 4, 5, 6, 7))},
    }
    entry = gltf.json["accessors"][index]
    entry["sparse"] = sparse
    if not with_base:
        del entry["bufferView"]
    rest = [1.0] * 3 if with_base else [0.0] * 3
    read = GltfData(gltf.write(tmp_path / "a.glb")).accessor(index)
    np.testing.assert_array_equal(read, [rest, [2, 3, 4], rest, [5, 6, 7]])


def test_matrices_come_in_rows_and_columns(tmp_path):
    gltf = Gltf()
    index = gltf.raw_accessor(np.arange(32, dtype="<f4").tobytes(), (2,), "f")
    gltf.json["accessors"][index]["type"] = "MAT4"
    read = GltfData(gltf.write(tmp_path / "a.glb")).accessor(index)
    np.testing.assert_array_equal(read[1], np.arange(16, 32).reshape(4, 4).T)


def one_mesh(gltf, tmp_path, name="a.glb", **options):
    gltf.node(mesh=0)
    asset = read_gltf(gltf.write(tmp_path / name), 24.0, **options)
    assert len(asset.meshes) == 1
    return asset.meshes[0]


@pytest.mark.parametrize("name", ["a.glb", "a.gltf"])
def test_buffers_in_the_file_and_in_a_data_uri(tmp_path, name):
    gltf = Gltf()
    gltf.triangle(indices=gltf.accessor([2, 0, 1], "B"))
    mesh = one_mesh(gltf, tmp_path, name)
    np.testing.assert_array_equal(mesh.positions, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    np.testing.assert_array_equal(mesh.faces, [[2, 0, 1]])
    assert mesh.normals is None  # missing normals mean flat shading
    assert not mesh.material.double_sided


def test_buffers_and_images_in_files_beside_the_model(tmp_path):
    gltf = Gltf()
    gltf.json["images"] = [{"uri": "my%20image.png"}]
    gltf.json["textures"] = [{"source": 0}]
    gltf.json["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    gltf.triangle(material=0)
    gltf.node(mesh=0)
    path = gltf.write(tmp_path / "a.gltf")
    document = json.loads(path.read_text())
    document["buffers"][0]["uri"] = "a%20b.bin"
    path.write_text(json.dumps(document))
    (tmp_path / "a b.bin").write_bytes(gltf.blob)
    (tmp_path / "my image.png").write_bytes(png([[[255, 0, 0]]]))
    mesh = read_gltf(path, 24.0).meshes[0]
    np.testing.assert_array_equal(mesh.material.texture.image, [[[1, 0, 0, 1]]])
    (tmp_path / "my image.png").unlink()
    asset = read_gltf(path, 24.0)
    assert asset.meshes[0].material.texture is None
    assert f"tried {tmp_path / 'my image.png'}" in asset.notes[0]
    (tmp_path / "a b.bin").unlink()
    with pytest.raises(SceneError, match=r"a\.gltf: file not found: tried .*a b\.bin"):
        read_gltf(path, 24.0)


@pytest.mark.parametrize(
    ("mode", "faces"),
    [
        (5, [[0, 1, 2], [1, 3, 2], [2, 3, 4]]),
        (6, [[1, 2, 0], [2, 3, 0], [3, 4, 0]]),
    ],
)
def test_strips_and_fans_keep_their_orientation(tmp_path, mode, faces):
    gltf = Gltf()
    gltf.mesh({"attributes": {"POSITION": gltf.accessor(np.eye(5, 3))}, "mode": mode})
    np.testing.assert_array_equal(one_mesh(gltf, tmp_path).faces, faces)


def test_points_and_lines_are_left_out_and_said(tmp_path):
    gltf = Gltf()
    gltf.triangle(mode=1)
    gltf.node(mesh=0)
    asset = read_gltf(gltf.write(tmp_path / "a.glb"), 24.0)
    assert asset.meshes == ()
    assert asset.notes == ("a.glb: points and lines are left out",)


def test_uv_is_flipped_and_the_material_chooses_the_set(tmp_path):
    gltf = Gltf()
    first, second = (gltf.accessor([[0, 0], [1, v], [0, 1]]) for v in (0.25, 0.75))
    view = gltf.view(png([[[0, 0, 0]]]))
    gltf.json["images"] = [{"bufferView": view, "mimeType": "image/png"}]
    gltf.json["samplers"] = [{"wrapS": 33071, "wrapT": 33071}]
    gltf.json["textures"] = [{"source": 0, "sampler": 0}]
    reference = {"index": 0, "texCoord": 1}
    gltf.json["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": reference}}]
    gltf.triangle(attributes={"TEXCOORD_0": first, "TEXCOORD_1": second}, material=0)
    mesh = one_mesh(gltf, tmp_path)
    np.testing.assert_array_equal(mesh.uv, [[0, 1], [1, 0.25], [0, 0]])
    assert mesh.material.texture.wrap == "clamp"


def test_texture_transform_scales_turns_and_moves(tmp_path):
    gltf = Gltf()
    uv = gltf.accessor([[0, 0], [1, 0], [0, 1]])
    gltf.json["images"] = [{"bufferView": gltf.view(png([[[0, 0, 0]]])), "mimeType": "image/png"}]
    gltf.json["textures"] = [{"source": 0}]
    move = {"scale": [2, 3], "rotation": np.pi / 2, "offset": [0.5, 0.25]}
    reference = {"index": 0, "extensions": {"KHR_texture_transform": move}}
    gltf.json["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": reference}}]
    gltf.triangle(attributes={"TEXCOORD_0": uv}, material=0)
    uv = one_mesh(gltf, tmp_path).uv
    # In glTF's v-down coordinates (1, 0) is scaled to (2, 0) and turned counter-clockwise, as
    # seen, to (0, -2).
    expected = np.array([[0.5, 0.25], [0.5, 0.25 - 2.0], [0.5 + 3.0, 0.25]])
    np.testing.assert_allclose(uv, expected * (1, -1) + (0, 1), atol=1e-12)


def test_colours_factors_are_linear_and_textures_srgb(tmp_path):
    gltf = Gltf()
    view = gltf.view(png([[[188, 0, 255]]]))
    gltf.json["images"] = [{"bufferView": view, "mimeType": "image/png"}]
    gltf.json["textures"] = [{"source": 0}]
    pbr = {"baseColorTexture": {"index": 0}, "baseColorFactor": [0.5, 0.25, 0.125, 1]}
    gltf.json["materials"] = [{"pbrMetallicRoughness": pbr, "doubleSided": True}]
    color = gltf.accessor([[255, 51, 0, 255]] * 3, "B", normalized=True)
    gltf.triangle(attributes={"COLOR_0": color}, material=0)
    mesh = one_mesh(gltf, tmp_path)
    assert mesh.material.base_color == (0.5, 0.25, 0.125)
    decoded = ((188 / 255 + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(mesh.material.texture.image[0, 0], [decoded, 0, 1, 1], rtol=1e-6)
    np.testing.assert_allclose(mesh.color, [[1, 0.2, 0, 1]] * 3, rtol=1e-6)
    assert mesh.color_domain == "vertex"
    assert mesh.material.double_sided


def test_alpha_modes_cutoffs_and_factors(tmp_path):
    gltf = Gltf()
    factor = {"baseColorFactor": [1, 1, 1, 0.25]}
    given = [
        {"pbrMetallicRoughness": factor},
        {"pbrMetallicRoughness": factor, "alphaMode": "OPAQUE"},
        {"pbrMetallicRoughness": factor, "alphaMode": "BLEND"},
        {"pbrMetallicRoughness": factor, "alphaMode": "MASK"},
        {"pbrMetallicRoughness": factor, "alphaMode": "MASK", "alphaCutoff": 0.125},
        {"alphaMode": "BLEND"},
    ]
    gltf.json["materials"] = given
    for index in range(len(given)):
        color = gltf.accessor([[1, 1, 1, 0.5], [1, 1, 1, 1], [1, 1, 1, 1.5]])
        gltf.node(mesh=gltf.triangle(attributes={"COLOR_0": color}, material=index))
    gltf.json["scenes"][0]["nodes"] = list(range(len(given)))
    asset = read_gltf(gltf.write(tmp_path / "a.glb"), 24.0)
    found = [mesh.material for mesh in asset.meshes]
    assert [m.alpha for m in found] == ["opaque", "opaque", "blend", "mask", "mask", "blend"]
    assert [m.opacity for m in found] == [1, 1, 0.25, 0.25, 0.25, 1]
    assert [m.alpha_cutoff for m in found[3:5]] == [0.5, 0.125]
    assert asset.meshes[2].color[:, 3].tolist() == [0.5, 1, 1]
    assert not [note for note in asset.notes if "alpha" in note]


def test_unlit_extension(tmp_path):
    gltf = Gltf()
    gltf.json["materials"] = [{"extensions": {"KHR_materials_unlit": {}}}, {}]
    gltf.triangle(material=0)
    gltf.triangle(material=1)
    gltf.json["scenes"][0]["nodes"] = [gltf.node(mesh=0), gltf.node(mesh=1)]
    lit = [m.material.shading for m in read_gltf(gltf.write(tmp_path / "a.glb"), 24.0).meshes]
    assert lit == ["unlit", "metallic_roughness"]


def test_metallic_roughness_and_emission(tmp_path):
    gltf = Gltf()
    pixels = np.array([[[0, 51, 255], [255, 102, 0]]], np.uint8)
    view = gltf.view(png(pixels))
    gltf.json["images"] = [{"bufferView": view, "mimeType": "image/png"}]
    gltf.json["textures"] = [{"source": 0}]
    texture = {"index": 0}
    gltf.json["materials"] = [
        {"pbrMetallicRoughness": {"metallicFactor": 0.25, "roughnessFactor": 0.5,
                                  "metallicRoughnessTexture": texture}},
        {"emissiveFactor": [1, 0.5, 0], "emissiveTexture": texture},
    ]  # fmt: skip
    gltf.triangle(material=0)
    gltf.triangle(material=1)
    gltf.json["scenes"][0]["nodes"] = [gltf.node(mesh=0), gltf.node(mesh=1)]
    gloss, lamp = (m.material for m in read_gltf(gltf.write(tmp_path / "a.glb"), 24.0).meshes)
    assert (gloss.metallic, gloss.roughness) == (0.25, 0.5)
    stored = gloss.metallic_roughness_texture.image[..., :3] * 255.0  # as in the file, not sRGB
    assert np.array_equal(np.rint(stored), pixels)
    assert (lamp.metallic, lamp.roughness, lamp.emission) == (1.0, 1.0, (1.0, 0.5, 0.0))
    assert lamp.emission_texture.image[0, 0, 1] == pytest.approx(0.0331, abs=1e-3)  # from sRGB


def test_hierarchy_of_animated_nodes(tmp_path):
    """A child's world matrix is its parent's at the same time, times its own."""
    gltf = Gltf()
    gltf.triangle()
    half = np.sqrt(0.5)
    gltf.node(children=[1], translation=[0, 0, 5])
    gltf.node(mesh=0, translation=[2, 0, 0], scale=[1, 2, 3])
    gltf.animate(0, "rotation", [0, 1], [[0, 0, 0, 1], [0, 0, half, half]])
    gltf.animate(1, "translation", [0.5, 1.0], [[2, 0, 0], [4, 0, 0]])
    mesh = read_gltf(gltf.write(tmp_path / "a.glb"), fps=10.0).meshes[0]
    at_end = mesh.transform.at(10.0)  # one second
    np.testing.assert_allclose(at_end[:3, 3], [0, 4, 5], atol=1e-6)
    middle = mesh.transform.at(7.5)  # turned by 67.5 degrees; halfway from 2 to 4
    turn = np.radians(67.5)
    np.testing.assert_allclose(middle[:3, 3], [3 * np.cos(turn), 3 * np.sin(turn), 5], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(middle[:3, :3], axis=0), [1, 2, 3], atol=1e-6)
    np.testing.assert_allclose(mesh.transform.at(-3.0), mesh.transform.at(0.0))


def test_step_and_cubic_channels(tmp_path):
    gltf = Gltf()
    gltf.triangle()
    gltf.json["scenes"][0]["nodes"] = [0, 1]
    gltf.node(mesh=0)
    gltf.node(mesh=0)
    gltf.animate(0, "translation", [0, 1], [[0, 0, 0], [1, 0, 0]], "STEP")
    tangents = [[0, 0, 0], [0, 0, 0], [2, 0, 0], [-1, 0, 0], [1, 0, 0], [0, 0, 0]]
    gltf.animate(1, "translation", [0, 2], tangents, "CUBICSPLINE")
    step, cubic = read_gltf(gltf.write(tmp_path / "a.glb"), fps=10.0).meshes
    assert [step.transform.at(f)[0, 3] for f in (0, 9.99, 10, 11)] == [0, 0, 1, 1]
    for seconds in (0.0, 0.3, 1.0, 1.7, 2.0):
        s = seconds / 2
        hermite = (s**3 - 2 * s**2 + s) * 2 * 2 + (-2 * s**3 + 3 * s**2) + (s**3 - s**2) * 2 * -1
        assert cubic.transform.at(10 * seconds)[0, 3] == pytest.approx(hermite, abs=1e-12)


def test_clip_by_name_and_index(tmp_path):
    gltf = Gltf()
    gltf.triangle()
    gltf.node(mesh=0)
    gltf.animate(0, "translation", [0, 1], [[0, 0, 0], [1, 0, 0]])
    gltf.json["animations"].append({"name": "other", "channels": [], "samplers": []})
    gltf.animate(0, "translation", [0, 1], [[0, 0, 0], [0, 3, 0]])
    path = gltf.write(tmp_path / "a.glb")
    ends = {
        clip: read_gltf(path, 1.0, clip).meshes[0].transform.at(1.0)[:3, 3].tolist()
        for clip in (None, "first", 0, "other", 1)
    }
    assert ends[None] == ends["first"] == ends[0] == [1, 0, 0]
    assert ends["other"] == ends[1] == [0, 3, 0]
    assert read_gltf(path, 1.0).notes == ("a.glb: clip 'first' of first, other",)
    for clip in ("walk", 2):
        with pytest.raises(SceneError, match=f"no clip {clip!r}; the file has: first, other"):
            read_gltf(path, 1.0, clip)


def signed_side(mesh, frame=0.0):
    """z of the geometric normal in the world, and of the shading normal."""
    exposed = expose(Scene([mesh]), frame, 1.0).meshes[0]
    a, b, c = exposed.positions[0][exposed.mesh.faces[0]]
    shading = None if exposed.normals is None else float(exposed.normals[0, 0, 2])
    return float(np.cross(b - a, c - a)[2]), shading


@pytest.mark.parametrize("scale", [[1, 1, 1], [-1, 1, 1], [-1, -1, -1], [2, 3, 4], [-1, -1, 1]])
def test_fronts_stay_fronts_under_mirrored_nodes(tmp_path, scale):
    """The spec's rule: a negative determinant turns the winding round; normals keep their side."""
    gltf = Gltf()
    normal = gltf.accessor([[0, 0, 1]] * 3)
    gltf.triangle(attributes={"NORMAL": normal})
    gltf.node(mesh=0, scale=scale)
    mesh = read_gltf(gltf.write(tmp_path / "a.glb"), 24.0).meshes[0]
    side, shading = signed_side(mesh)
    assert np.sign(side) == np.sign(shading) == np.sign(scale[2])


def test_mirroring_follows_a_keyed_scale(tmp_path):
    gltf = Gltf()
    gltf.triangle()
    gltf.node(mesh=0)
    gltf.animate(0, "scale", [0, 1], [[1, 1, 1], [-1, 1, 1]], "STEP")
    mesh = read_gltf(gltf.write(tmp_path / "a.glb"), fps=10.0).meshes[0]
    assert signed_side(mesh, 2.0)[0] > 0
    assert signed_side(mesh, 12.0)[0] > 0


def test_camera_moves_with_its_node(tmp_path):
    gltf = Gltf()
    gltf.triangle()
    perspective = {"yfov": np.radians(50.0), "znear": 0.1}
    gltf.json["cameras"] = [{"type": "perspective", "perspective": perspective}]
    gltf.json["scenes"][0]["nodes"] = [0, 1]
    gltf.node(mesh=0)
    gltf.node(camera=0, name="cam", translation=[0, 0, 3])
    gltf.animate(1, "translation", [0, 1], [[0, 0, 3], [1, 0, 3]])
    scene = load(gltf.write(tmp_path / "a.glb"))
    assert scene.camera.name == "cam"
    assert scene.camera.fov == pytest.approx(50.0)
    exposure = expose(scene, 12.0, 1.5)
    assert exposure.path.moves
    eyes = [poses.eye[0] for poses in exposure.path.ends]
    np.testing.assert_allclose(eyes, [[11.75 / 24, 0, 3], [12.25 / 24, 0, 3]], atol=1e-7)


def test_lights_in_lux_and_candela(tmp_path):
    gltf = Gltf()
    gltf.triangle()
    lights = [
        {"type": "directional", "intensity": np.pi, "color": [1, 0.5, 0]},
        {"type": "point", "intensity": 2 * np.pi},
        {"type": "spot", "intensity": np.pi, "spot": {"innerConeAngle": 0.1}},
        {"type": "spot", "spot": {"outerConeAngle": np.pi / 2}},
        {"type": "area"},
    ]
    gltf.json["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
    half = np.sqrt(0.5)
    turned = {"rotation": [-half, 0, 0, half]}
    places = [turned, {"translation": [1, 2, 3]}, {"translation": [4, 5, 6], **turned}, {}, {}]
    for index, place in enumerate(places):
        gltf.node(extensions={"KHR_lights_punctual": {"light": index}}, **place)
    gltf.json["scenes"][0]["nodes"] = [0, 1, 2, 3, 4]
    asset = read_gltf(gltf.write(tmp_path / "a.glb"), 24.0)
    sun, lamp, spot, wide = (light.at(0.0) for light in asset.lights)
    np.testing.assert_allclose(sun.direction, [0, -1, 0], atol=1e-6)
    assert (sun.intensity, sun.color) == (1.0, (1.0, 0.5, 0.0))
    assert (lamp.position, lamp.intensity) == ((1.0, 2.0, 3.0), 2.0)
    assert (spot.kind, spot.intensity, spot.position) == ("spot", 1.0, (4.0, 5.0, 6.0))
    np.testing.assert_allclose(spot.direction, [0, -1, 0], atol=1e-6)
    assert np.radians([spot.inner_angle, spot.outer_angle]) == pytest.approx([0.1, np.pi / 4])
    assert (wide.inner_angle, wide.outer_angle) == (0.0, 90.0)
    assert asset.notes == ("a.glb: area lights are left out",)


def test_lights_move_with_their_nodes(tmp_path):
    gltf = Gltf()
    gltf.triangle()
    gltf.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    gltf.json["scenes"][0]["nodes"] = [0, 1]
    gltf.node(mesh=0)
    gltf.node(extensions={"KHR_lights_punctual": {"light": 0}}, rotation=[0, 0, 1, 0])
    gltf.animate(1, "translation", [0, 1], [[0, 0, 0], [24, 0, 0]])
    scene = load(gltf.write(tmp_path / "a.glb"))
    for frame in (0.0, 6.0, 24.0):
        assert expose(scene, frame, 1.0).lights[0].position == (frame, 0.0, 0.0)


def test_quantized_positions(tmp_path):
    gltf = Gltf()
    gltf.json["extensionsRequired"] = gltf.json["extensionsUsed"] = ["KHR_mesh_quantization"]
    position = gltf.accessor([[0, 0, 0], [32767, 0, 0], [0, -32767, 0]], "h", normalized=True)
    gltf.mesh({"attributes": {"POSITION": position}})
    np.testing.assert_array_equal(
        one_mesh(gltf, tmp_path).positions, [[0, 0, 0], [1, 0, 0], [0, -1, 0]]
    )


def test_required_extensions_are_named(tmp_path):
    gltf = Gltf()
    gltf.triangle()
    gltf.json["extensionsRequired"] = ["KHR_draco_mesh_compression", "KHR_materials_unlit"]
    with pytest.raises(SceneError, match=r"a\.glb: needs KHR_draco_mesh_compression, not supp"):
        one_mesh(gltf, tmp_path)


def break_accessor(gltf):
    gltf.json["accessors"][0]["count"] = 10**7


def break_view(gltf):
    gltf.json["bufferViews"][0].update(byteOffset=-36)


def break_index(gltf):
    gltf.json["nodes"][0]["mesh"] = -1


def break_cycle(gltf):
    gltf.json["nodes"][0]["children"] = [0]


def break_type(gltf):
    gltf.json["meshes"] = [3]


def break_version(gltf):
    gltf.json["asset"]["version"] = "1.0"


@pytest.mark.parametrize(
    "damage", [break_accessor, break_view, break_index, break_cycle, break_type, break_version]
)
def test_damaged_documents_are_scene_errors(tmp_path, damage):
    gltf = Gltf()
    gltf.triangle()
    gltf.node(mesh=0)
    damage(gltf)
    with pytest.raises(SceneError, match=r"a\.gltf: "):
        read_gltf(gltf.write(tmp_path / "a.gltf"), 24.0)


@pytest.mark.parametrize(
    ("place", "value", "said"),
    [
        ("nodes 0 mesh", "x", r"nodes\[0\].mesh: expected a whole number from 0 up, got 'x'"),
        ("nodes 0 mesh", True, r"nodes\[0\].mesh: expected a whole number from 0 up, got True"),
        ("nodes 0 translation", [1, 2], r"nodes\[0\].translation: expected a list of 3 numbers"),
        ("nodes 0 name", 7, r"nodes\[0\].name: expected a string, got 7"),
        ("nodes 0 scale", [1, "a", 1], r"nodes\[0\].scale\[1\]: expected a finite number"),
        ("nodes 0 scale", [1, float("nan"), 1], r"scale\[1\]: expected a finite number, got nan"),
        ("accessors 0 type", "VEC5", r"accessors\[0\].type: expected SCALAR, VEC2, .*'VEC5'"),
        ("accessors 0 count", None, r"accessors\[0\].count: is missing"),
        ("accessors 0 count", 10**30, r"accessors\[0\].count: expected a whole number from 0 up"),
        ("accessors 0 bufferView", None, r"accessors\[0\] has 4294967295 elements and no data"),
        ("meshes", {}, "meshes: expected a list, got {}"),
        ("meshes 0 primitives 0 attributes", None, r"primitives\[0\].attributes: is missing"),
        ("meshes 0 primitives 0 attributes", [], r"primitives\[0\].attributes: expected an object"),
        (
            "extensions",
            {"KHR_lights_punctual": {"lights": [3]}},
            r"lights\[0\]: expected an object",
        ),
        ("extensions", {"KHR_lights_punctual": {"lights": [{}]}}, r"lights\[0\].type: is missing"),
        ("nodes 0 extensions", 1.5, r"nodes\[0\].extensions: expected an object, got 1.5"),
    ],
)
def test_what_is_not_gltf_is_named_with_its_place(tmp_path, place, value, said):
    gltf = Gltf()
    gltf.triangle()
    gltf.node(mesh=0)
    if place == "accessors 0 bufferView":
        gltf.json["accessors"][0]["count"] = 2**32 - 1
    *names, last = (int(name) if name.isdigit() else name for name in place.split())
    within = gltf.json
    for name in names:
        within = within[name]
    within[last] = value
    with pytest.raises(SceneError, match=rf"a\.gltf: .*{said}"):
        read_gltf(gltf.write(tmp_path / "a.gltf"), 24.0)


def test_what_other_programs_write_otherwise_is_read(tmp_path):
    """Null where there is nothing, and extensions that nobody knows."""
    gltf = Gltf()
    gltf.triangle()
    gltf.node(mesh=0, camera=None, extensions={"EXT_unknown": {"light": "x"}}, extras={"a": [1]})
    (mesh,) = read_gltf(gltf.write(tmp_path / "a.gltf"), 24.0).meshes
    assert mesh.positions.shape == (3, 3)


def test_a_syntax_error_has_its_line_and_column(tmp_path):
    (tmp_path / "a.gltf").write_text('{"asset":\n {"version": }}')
    with pytest.raises(SceneError, match=r"Expecting value \(at line 2, column 14 of its JSON\)"):
        read_gltf(tmp_path / "a.gltf", 24.0)


def test_a_file_whose_first_chunk_is_another_is_refused(tmp_path):
    gltf = Gltf()
    gltf.node(mesh=gltf.triangle())
    data = gltf.write(tmp_path / "a.glb").read_bytes()
    (tmp_path / "a.glb").write_bytes(data.replace(b"JSON", b"JSOX", 1))
    with pytest.raises(SceneError, match=r"a\.glb: its first chunk is not JSON"):
        read_gltf(tmp_path / "a.glb", 24.0)


def test_a_broken_channel_is_named(tmp_path):
    gltf = Gltf()
    node = gltf.node(mesh=gltf.triangle())
    gltf.animate(node, "translation", [0.0, 1.0], np.zeros((2, 3)))
    gltf.json["animations"][0]["samplers"][0]["input"] = 0  # positions, not times
    with pytest.raises(SceneError, match=r"animations\[0\]\.channels\[0\]: times .* no SCALAR"):
        read_gltf(gltf.write(tmp_path / "a.gltf"), 24.0)


def test_cut_off_files_are_scene_errors(tmp_path):
    gltf = Gltf()
    gltf.triangle()
    gltf.node(mesh=0)
    whole = gltf.write(tmp_path / "a.glb").read_bytes()
    read_gltf(tmp_path / "a.glb", 24.0)
    for length in [0, 3, 11, 15, 40, len(whole) // 2, len(whole) - 9]:
        (tmp_path / "cut.glb").write_bytes(whole[:length])
        with pytest.raises(SceneError, match=r"cut\.glb: "):
            read_gltf(tmp_path / "cut.glb", 24.0)
