"""Mesh files through trimesh, simple shapes, benchmark files, generated scenes."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from mbinterval.errors import SceneError
from mbinterval.scene.formats.load import load, load_file
from mbinterval.scene.generators import GENERATORS, blades, dense_sphere, fast_cubes, ho17_cubes
from mbinterval.scene.primitives import PRIMITIVES, box, cylinder, plane, sphere

OBJ = """mtllib m.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 2 0 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vn 0 0 1
usemtl red
f 1/1/1 2/2/1 3/3/1 4/4/1
usemtl textured
f 2/1 5/2 3/3
"""
MTL = "newmtl red\nKd 0.01 0.2 0.3\nnewmtl textured\nKd 0.5 0.5 0.5\nmap_Kd t.png\n"


@pytest.fixture
def obj(tmp_path):
    (tmp_path / "m.mtl").write_text(MTL)
    Image.new("RGB", (2, 2), (188, 255, 0)).save(tmp_path / "t.png")
    (tmp_path / "a.obj").write_text(OBJ)
    return tmp_path / "a.obj"


def by_material(scene):
    return {mesh.material.name: mesh for mesh in scene.meshes}


def test_obj_with_materials_textures_and_polygons(obj):
    meshes = by_material(load(obj))
    red, textured = meshes["red"], meshes["textured"]
    assert red.faces.shape == (2, 3)  # a quad is two triangles
    assert red.positions[red.faces].min(axis=(0, 1)).tolist() == [0, 0, 0]
    assert red.material.base_color == (0.01, 0.2, 0.3)  # Kd is linear, to full precision
    np.testing.assert_array_equal(red.uv, red.positions[:, :2])
    np.testing.assert_array_equal(red.normals, [[0, 0, 1]] * 4)
    assert red.material.texture is None
    decoded = ((188 / 255 + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(textured.material.texture.image[0, 0], [decoded, 1, 0, 1], rtol=1e-6)
    assert textured.material.base_color == (0.5, 0.5, 0.5)
    assert textured.transform is None


def test_obj_without_normals_gets_none(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv .5 2 0\nv 0 1 0\nf 1 2 3 4 5\n")
    (mesh,) = load(tmp_path / "a.obj").meshes
    assert mesh.normals is None
    assert mesh.uv is None
    assert mesh.color is None
    assert mesh.positions.shape == (5, 3)
    corners = mesh.positions[mesh.faces]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert len(mesh.faces) == 3
    assert areas[:, 2].sum() / 2 == pytest.approx(1.5)


def test_text_files_in_an_8_bit_code(obj):
    plain = by_material(load(obj))["red"]
    for path in (obj, obj.parent / "m.mtl"):
        path.write_bytes(b"# caf\xe9\n" + path.read_bytes().replace(b"red", b"r\xf6d"))
    read = by_material(load(obj))["r\xf6d"]
    np.testing.assert_array_equal(read.positions, plain.positions)
    assert read.material.base_color == plain.material.base_color


@pytest.mark.parametrize("name", ["t.png", "m.mtl"])
def test_a_missing_texture_or_library_is_noted_with_the_path_tried(obj, name):
    assert load(obj).notes == ()
    (obj.parent / name).unlink()
    notes = load(obj).notes
    assert notes == (f"a.obj: not found: tried {obj.parent / name}; left out",)


PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
{normals}property uchar red
property uchar green
property uchar blue
{uv}element face 1
property list uchar int vertex_indices
end_header
0 0 0{n} 255 0 0{t}
1 0 0{n} 0 188 0{t}
0 1 0{n} 0 0 51{t}
3 0 1 2
"""


@pytest.mark.parametrize("with_uv", [False, True])
@pytest.mark.parametrize("with_normals", [False, True])
def test_ply_vertex_colours_are_decoded(tmp_path, with_uv, with_normals):
    text = PLY.format(
        normals="".join(f"property float n{a}\n" for a in "xyz") if with_normals else "",
        uv="property float s\nproperty float t\n" if with_uv else "",
        n=" 0 0 1" if with_normals else "",
        t=" 0.5 0.25" if with_uv else "",
    )
    (tmp_path / "a.ply").write_text(text)
    (mesh,) = load(tmp_path / "a.ply").meshes
    expected = np.diag([1.0, ((188 / 255 + 0.055) / 1.055) ** 2.4, ((0.2 + 0.055) / 1.055) ** 2.4])
    assert mesh.color_domain == "vertex"
    np.testing.assert_allclose(mesh.color, expected, rtol=1e-6)
    assert (mesh.normals is not None) == with_normals
    assert (mesh.uv is not None) == with_uv


def test_ply_face_colours(tmp_path):
    import trimesh

    source = trimesh.creation.box()
    source.visual.face_colors = [[index * 20, 255, 0, 255] for index in range(12)]
    source.export(tmp_path / "a.ply")
    (mesh,) = load(tmp_path / "a.ply").meshes
    assert mesh.color_domain == "face"
    assert mesh.color.shape == (12, 3)
    assert mesh.color[0].tolist() == [0, 1, 0]
    assert mesh.color[11, 0] == pytest.approx(((220 / 255 + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("kind", ["stl", "off", "ply", "obj"])
def test_a_box_through_every_kind_of_file_is_closed_and_looks_outwards(tmp_path, kind):
    import trimesh

    path = tmp_path / f"a.{kind}"
    trimesh.creation.box(extents=(1, 2, 3)).export(path)
    (mesh,) = load({"objects": [{"file": str(path), "transform": {"scale": 2}}]}).meshes
    assert volume(mesh) == pytest.approx(6)
    np.testing.assert_array_equal(mesh.transform.at(0), np.diag([2, 2, 2, 1]))


def test_broken_mesh_files_are_scene_errors(tmp_path):
    (tmp_path / "a.ply").write_bytes(b"ply\nformat binary_little_endian 1.0\nelement vertex 9\n")
    (tmp_path / "b.stl").write_bytes(b"\0" * 30)
    (tmp_path / "c.obj").write_text("v 0 0 0\nv 1 0 0\nf 1 2 9\n")
    (tmp_path / "d.xyz").write_text("0 0 0\n1 1 1\n")
    for path in sorted(tmp_path.iterdir()):
        with pytest.raises(SceneError, match=path.name) as caught:
            load(path)
        assert "module" not in str(caught.value)


def volume(mesh):
    corners = mesh.positions[mesh.faces]
    return float(np.linalg.det(corners).sum() / 6)


def unmatched_edges(mesh):
    """Directed edges without a partner, vertices at the same place being one."""
    _, place = np.unique(mesh.positions.round(9), axis=0, return_inverse=True)
    faces = place.ravel()[mesh.faces]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    forward = {tuple(edge) for edge in edges.tolist()}
    assert len(forward) == len(edges)
    return {edge for edge in forward if edge[::-1] not in forward}


@pytest.mark.parametrize(
    ("mesh", "expected"),
    [
        (box((1.0, 2.0, 3.0)), 6.0),
        (sphere(0.5, 24), 0.125 * 4 / 3 * np.pi),
        (cylinder(0.5, 2.0, 48), np.pi / 2),
    ],
    ids=["box", "sphere", "cylinder"],
)
def test_shapes_are_closed_and_look_outwards(mesh, expected):
    assert not unmatched_edges(mesh)
    assert volume(mesh) == pytest.approx(expected, rel=0.03)
    corners = mesh.positions[mesh.faces]
    geometric = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.linalg.norm(geometric, axis=1).min() > 1e-6
    assert (np.einsum("fi,fki->fk", geometric, mesh.normals[mesh.faces]) > 0).all()
    assert mesh.uv.min() == pytest.approx(0)
    assert mesh.uv.max() == pytest.approx(1)


@pytest.mark.parametrize("kind", sorted(PRIMITIVES))
def test_uv_are_not_mirrored_on_any_shape(kind):
    """Seen from outside, u runs to the right of v: a texture's letters can be read."""
    mesh = PRIMITIVES[kind]()
    uv = mesh.uv[mesh.faces]
    first, second = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    assert (first[:, 0] * second[:, 1] > first[:, 1] * second[:, 0]).all()


def test_a_plane_faces_the_viewer():
    mesh = plane((2.0, 1.0))
    assert unmatched_edges(mesh)
    np.testing.assert_array_equal(mesh.normals, [[0, 0, 1]] * 4)
    np.testing.assert_array_equal(mesh.positions[np.argmin(mesh.uv.sum(axis=1))], [-1, -0.5, 0])


def write_benchmark(path, **changes):
    arrays = {
        "V0": np.eye(3, dtype="f4"),
        "V1": np.eye(3, dtype="f4") + 1,
        "F": np.array([[0, 1, 2]], "i4"),
        "C": np.array([[0.1, 0.2, 0.3]], "f4"),
        "eye": np.array([0, 0, 16], "f4"),
        "fov": 40.0,
        "bg": 0.18,
        "W": 320,
        "H": 240,
    } | changes
    np.savez(path, **{name: value for name, value in arrays.items() if value is not None})


def test_benchmark_files(tmp_path):
    write_benchmark(tmp_path / "a.npz")
    file = load_file(tmp_path / "a.npz")
    (mesh,) = file.scene.meshes
    np.testing.assert_array_equal(mesh.positions, [np.eye(3), np.eye(3) + 1])
    assert mesh.material.shading == "unlit"
    assert mesh.material.double_sided
    assert mesh.color_domain == "face"
    assert file.scene.background == (0.18, 0.18, 0.18)
    assert (file.scene.camera.fov, file.scene.camera.position) == (40.0, (0.0, 0.0, 16.0))
    assert (file.render.width, file.render.height) == (320, 240)


def test_broken_benchmark_files_are_scene_errors(tmp_path):
    write_benchmark(tmp_path / "a.npz", V1=None)
    with pytest.raises(SceneError, match=r"a\.npz: has no array V1; it needs V0"):
        load(tmp_path / "a.npz")
    write_benchmark(tmp_path / "b.npz", F=np.array([[0, 1, 3]]))
    with pytest.raises(SceneError, match=r"b\.npz: mesh 'b': face 0"):
        load(tmp_path / "b.npz")
    (tmp_path / "c.npz").write_bytes(b"PK\3\4 nonsense")
    with pytest.raises(SceneError, match=r"c\.npz: not a readable benchmark file"):
        load(tmp_path / "c.npz")


@pytest.mark.parametrize("make", [ho17_cubes, fast_cubes])
def test_generated_cubes_are_seeded_and_closed(make):
    first, again, other = make(20, seed=3), make(20, seed=3), make(20, seed=4)
    positions = first.meshes[0].positions
    assert positions.shape == (2, 160, 3)
    np.testing.assert_array_equal(positions, again.meshes[0].positions)
    assert np.abs(positions - other.meshes[0].positions).max() > 1
    corners = positions[0][first.meshes[0].faces]
    volumes = np.linalg.det(
        corners - positions[0].reshape(20, 8, 3).mean(axis=1).repeat(12, 0)[:, None]
    )
    assert (volumes > 0).all()
    with pytest.raises(SceneError, match="count=0"):
        make(0)


def mean_intervals(scene, width, height, times=65):
    """Mean number of (triangle, maximal time) per pixel centre, by dense sampling in time."""
    mesh = scene.meshes[0]
    points = mesh.positions - scene.camera.position
    focal = height / 2 / np.tan(np.radians(scene.camera.fov) / 2)
    w = -points[..., 2]
    x = points[..., 0] * focal + width / 2 * w
    y = height / 2 * w - points[..., 1] * focal
    corners = np.stack([x, y, w], axis=-1)[:, mesh.faces]
    t = np.linspace(0, 1, times)[:, None, None]
    met = 0
    for start, end in zip(*corners, strict=True):
        screen = np.concatenate([start, end])
        screen = screen[:, :2] / screen[:, 2:]
        low = np.clip(np.round(screen.min(axis=0)), 0, (width, height)).astype(int)
        high = np.clip(np.round(screen.max(axis=0)), 0, (width, height)).astype(int)
        if (low == high).any():
            continue  # no pixel centre between
        column, row = np.meshgrid(*(np.arange(a, b) + 0.5 for a, b in zip(low, high, strict=True)))
        moved = ((1 - t) * start + t * end)[..., None]
        px, py = (moved[:, :, i] - p.ravel() * moved[:, :, 2] for i, p in ((0, column), (1, row)))
        edges = px * np.roll(py, -1, axis=1) - np.roll(px, -1, axis=1) * py
        inside = (edges > 0).all(axis=1) | (edges < 0).all(axis=1)
        met += np.count_nonzero(inside[0]) + np.count_nonzero(inside[1:] & ~inside[:-1])
    return met / (width * height)


def test_ho17_cubes_have_the_interval_count_of_the_paper():
    """Figure 15: 1.67 intervals per pixel with 1,000 cubes; point sampling in time finds most."""
    assert mean_intervals(ho17_cubes(1000, 1), 96, 72) == pytest.approx(1.67, rel=0.08)
    assert mean_intervals(ho17_cubes(500, 1), 96, 72) < 1.0


def test_generated_blades_are_thin_and_turn_with_their_wheel():
    first, again, other = blades(48, seed=3), blades(48, seed=3), blades(48, seed=4)
    mesh = first.meshes[0]
    assert mesh.faces.shape == (1152, 3)
    np.testing.assert_array_equal(mesh.color, again.meshes[0].color)
    assert (mesh.color != other.meshes[0].color).any()
    start, end = (positions[mesh.faces] for positions in mesh.positions)
    sides = np.linalg.norm(start - np.roll(start, 1, axis=1), axis=2)
    assert sides.min() == pytest.approx(0.04, rel=0.01)
    assert np.median(sides.max(axis=1) / sides.min(axis=1)) > 4
    np.testing.assert_allclose(
        np.linalg.norm(end - np.roll(end, 1, axis=1), axis=2), sides, rtol=1e-9
    )  # rigid
    reach = np.hypot(*np.moveaxis(start[..., :2], -1, 0))
    assert (reach.min(), reach.max()) == pytest.approx((1.0, 5.2), abs=0.01)
    turn = np.angle(np.exp(1j * (0.25 + np.arctan2(start[..., 1], start[..., 0]))))
    moved = end - [0.28, 0, 0]
    apart = np.angle(np.exp(1j * (np.arctan2(moved[..., 1], moved[..., 0]) - turn)))
    assert np.abs(apart).max() < 0.02  # the tilt is small


def test_the_generated_sphere_is_closed_and_every_vertex_moves_alike():
    mesh = dense_sphere(2).meshes[0]
    assert mesh.faces.shape == (20 * 4**2, 3)
    start, end = mesh.positions
    np.testing.assert_allclose(np.linalg.norm(start + [2, 0, 0], axis=1), 4.0)
    np.testing.assert_allclose(end - start, np.tile([4.0, 1.0, 1.0], (len(start), 1)))
    slow = dense_sphere(2, travel=0.25).meshes[0].positions
    np.testing.assert_allclose(slow[1] - slow[0], (end - start) / 4)
    edges = mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).tolist()
    assert len(set(map(tuple, edges))) == len(edges)
    assert {(b, a) for a, b in edges} == set(map(tuple, edges))
    volume = np.linalg.det(start[mesh.faces] + [2, 0, 0]).sum() / 6
    assert 0.9 < volume / (4 / 3 * np.pi * 4**3) < 1.0
    with pytest.raises(SceneError, match="count=10, expected a number from 1 to 9"):
        dense_sphere(10)


def test_a_sphere_of_81920_triangles_moves_270_pixels():
    mesh = dense_sphere().meshes[0]
    assert len(mesh.faces) == 81920
    w = 16.0 - mesh.positions[..., 2]
    x, y = (mesh.positions[..., axis] / w for axis in (0, 1))
    pixels = 768 / 2 / np.tan(np.radians(20))
    moved = np.hypot(x[1] - x[0], y[1] - y[0]) * pixels
    assert np.median(moved) == pytest.approx(277, rel=0.03)


@pytest.mark.parametrize("name", GENERATORS)
def test_every_generator_can_be_named_in_a_scene_file(name):
    scene = load({"generator": {"name": name, "count": 2, "seed": 5}})
    want = GENERATORS[name](2, 5)
    np.testing.assert_array_equal(scene.meshes[0].positions, want.meshes[0].positions)
    np.testing.assert_array_equal(scene.meshes[0].color, want.meshes[0].color)
    with pytest.raises(SceneError, match="count"):
        GENERATORS[name](0)
