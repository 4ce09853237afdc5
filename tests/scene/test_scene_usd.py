"""The USD reader, on stages that usd-core writes, against closed forms and usd-core's baking."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, UsdSkel, Vt
from support.usd_files import QUAD, bind, new_stage, preview, quad, texture_file, textured

from mbinterval.errors import SceneError, UsageError
from mbinterval.exposure.asked import Asked
from mbinterval.exposure.exposure import expose
from mbinterval.exposure.shutter_times import Window
from mbinterval.exposure.true_motion import world_positions
from mbinterval.rendering.renderer import render
from mbinterval.scene.formats.load import load
from mbinterval.scene.formats.usd.usd import read_usd
from mbinterval.scene.model import Scene, Shutter


def read(stage, **options):
    stage.Save()
    return read_usd(Path(stage.GetRootLayer().realPath), **options)


def places(mesh, frame, base=None):
    """World positions at ``frame`` of an exposure of frame ``base``."""
    base = frame if base is None else base
    window = Window(base, frame - base, frame - base + 1.0)
    return world_positions(mesh, window, np.array([0.0]))[0]


def test_polygons_are_fans_and_keep_their_side(tmp_path):
    stage = new_stage(tmp_path)
    points = [(0, 0, 0), (2, 0, 0), (3, 1, 0), (1, 2, 0), (0, 1, 0), (9, 9, 9)]
    mesh = quad(
        stage, points=points, counts=(5, 3, 2, 3), indices=(0, 1, 2, 3, 4, 0, 2, 4, 0, 1, 0, 1, 5)
    )
    mesh.CreateHoleIndicesAttr([3])
    (found,) = read(stage).meshes
    np.testing.assert_array_equal(found.faces, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 2, 4]])
    mesh.CreateOrientationAttr("leftHanded")
    (turned,) = read(stage).meshes
    np.testing.assert_array_equal(turned.faces, found.faces[:, ::-1])
    assert len(found.positions) == 5  # the point of the hole is of no use


@pytest.mark.parametrize("kind", ["constant", "uniform", "vertex", "faceVarying"])
def test_display_colour_of_every_interpolation(tmp_path, kind):
    stage = new_stage(tmp_path)
    mesh = quad(stage, counts=(3, 3), indices=(0, 1, 2, 0, 2, 3))
    count = {"constant": 1, "uniform": 2, "vertex": 4, "faceVarying": 6}[kind]
    colors = np.arange(3 * count).reshape(count, 3) / 20
    primvar = mesh.CreateDisplayColorPrimvar(kind)
    primvar.Set([Gf.Vec3f(*map(float, color)) for color in colors])
    (found,) = read(stage).meshes
    at_corners = (
        found.color[found.faces]
        if found.color_domain == "vertex"
        else np.repeat(found.color[:, None], 3, axis=1)
    )
    which = {
        "constant": [0] * 6,
        "uniform": [0, 0, 0, 1, 1, 1],
        "vertex": [0, 1, 2, 0, 2, 3],
        "faceVarying": range(6),
    }[kind]
    expected = colors[list(which)]
    np.testing.assert_allclose(at_corners.reshape(-1, 3), expected, atol=1e-6)


def test_indexed_primvars_and_normals_at_corners(tmp_path):
    stage = new_stage(tmp_path)
    mesh = quad(stage, counts=(3, 3), indices=(0, 1, 2, 0, 2, 3))
    mesh.CreateNormalsAttr([Gf.Vec3f(0, 0, i) for i in range(1, 7)])
    mesh.SetNormalsInterpolation("faceVarying")
    (found,) = read(stage).meshes
    np.testing.assert_array_equal(found.normals[found.faces].reshape(-1, 3)[:, 2], range(1, 7))
    np.testing.assert_array_equal(
        found.positions[found.faces].reshape(-1, 3), np.array(QUAD)[[0, 1, 2, 0, 2, 3]]
    )


def test_xform_ops_are_evaluated_between_their_samples(tmp_path):
    stage = new_stage(tmp_path)
    outer = UsdGeom.Xform.Define(stage, "/outer")
    outer.AddTranslateOp().Set(Gf.Vec3d(0, 0, 5))
    turn = outer.AddRotateZOp()
    turn.Set(0.0, 0.0)
    turn.Set(90.0, 10.0)
    mesh = quad(stage, "/outer/quad")
    move = mesh.AddTranslateOp()
    move.Set(Gf.Vec3d(1, 0, 0), 0.0)
    move.Set(Gf.Vec3d(3, 0, 0), 10.0)
    (found,) = read(stage).meshes
    assert found.transform.animated
    angle = np.radians(45)
    np.testing.assert_allclose(
        places(found, 5.0)[0], [2 * np.cos(angle), 2 * np.sin(angle), 5], atol=1e-12
    )
    exposure = expose(
        Scene([found], shutter=Shutter(0, 10)), 0.0, 1.0, Asked(error=0.1), height=480
    )
    assert exposure.meshes[0].segments > 4
    mesh.SetResetXformStack(True)
    (alone,) = read(stage).meshes
    np.testing.assert_allclose(places(alone, 5.0)[0], [2, 0, 0])


def test_z_up_becomes_y_up(tmp_path):
    stage = new_stage(tmp_path, up="Z")
    quad(stage, points=[(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)])
    (found,) = read(stage).meshes
    np.testing.assert_allclose(places(found, 0.0)[:, 1], 1.0)  # up
    np.testing.assert_allclose(places(found, 0.0)[2], [1, 1, -1], atol=1e-12)


def test_sampled_points_are_linear_between_samples(tmp_path):
    stage = new_stage(tmp_path)
    mesh = quad(stage)
    after = [Gf.Vec3f(x + 4, y, z + 2) for x, y, z in QUAD]
    mesh.GetPointsAttr().Set([Gf.Vec3f(*point) for point in QUAD], 0.0)
    mesh.GetPointsAttr().Set(after, 4.0)
    (found,) = read(stage).meshes
    for frame, shift in ((-1.0, 0.0), (1.0, 0.25), (3.0, 0.75), (9.0, 1.0)):
        np.testing.assert_allclose(
            places(found, frame), np.array(QUAD) + shift * np.array([4, 0, 2]), atol=1e-6
        )


def test_velocities_and_accelerations_lead_on_from_the_frame_s_sample(tmp_path):
    """Units are seconds; the sample is that of the exposure's frame, before and after it."""
    stage = new_stage(tmp_path, codes=10.0)
    mesh = quad(stage)
    for code in (0.0, 1.0, 2.0):
        mesh.GetPointsAttr().Set([Gf.Vec3f(x + code, y, z) for x, y, z in QUAD], code)
        mesh.CreateVelocitiesAttr().Set([Gf.Vec3f(20, 0, 5)] * 4, code)
        mesh.CreateAccelerationsAttr().Set([Gf.Vec3f(0, 100, 0)] * 4, code)
    (found,) = read(stage).meshes
    for frame in (0.6, 1.0, 1.4):
        seconds = (frame - 1.0) / 10.0
        moved = np.array([1 + 20 * seconds, 50 * seconds**2, 5 * seconds])
        np.testing.assert_allclose(
            places(found, frame, base=1.0), np.array(QUAD) + moved, atol=1e-5
        )
    exposed = expose(
        Scene([found], shutter=Shutter(-0.5, 0.5)), 1.0, 1.0, Asked(segments=2)
    ).meshes[0]
    np.testing.assert_allclose(exposed.positions[:, 0, 0], [0.0, 1.0, 2.0], atol=1e-6)
    np.testing.assert_allclose(exposed.positions[:, 0, 1], [0.125, 0.0, 0.125], atol=1e-6)


def test_instances_share_a_mesh_and_have_their_own_place(tmp_path):
    stage = new_stage(tmp_path)
    quad(stage, "/proto/quad")
    UsdGeom.Xform.Define(stage, "/proto")
    for number in range(3):
        instance = UsdGeom.Xform.Define(stage, f"/world/i{number}")
        instance.GetPrim().GetReferences().AddInternalReference("/proto")
        instance.GetPrim().SetInstanceable(True)
        instance.AddTranslateOp().Set(Gf.Vec3d(10.0 * number, 0, 0))
    stage.GetPrimAtPath("/proto").SetActive(True)
    found = read(stage).meshes
    assert sorted(places(mesh, 0.0)[0, 0] for mesh in found) == [0, 0, 10, 20]


def crowd(stage, count=4):
    instancer = UsdGeom.PointInstancer.Define(stage, "/crowd")
    instancer.AddTranslateOp().Set(Gf.Vec3d(0, 100, 0))
    proto = quad(stage, "/crowd/protos/quad")
    proto.AddScaleOp().Set(Gf.Vec3f(2, 2, 2))
    other = quad(stage, "/crowd/protos/other")
    instancer.CreatePrototypesRel().SetTargets([proto.GetPath(), other.GetPath()])
    instancer.CreateProtoIndicesAttr([number % 2 for number in range(count)])
    return instancer


def test_point_instancers_place_their_prototypes(tmp_path):
    stage = new_stage(tmp_path)
    instancer = crowd(stage)
    half = float(np.sqrt(0.5))
    instancer.CreatePositionsAttr([Gf.Vec3f(10.0 * i, 0, 0) for i in range(4)])
    instancer.CreateOrientationsAttr([Gf.Quath(1, 0, 0, 0)] * 2 + [Gf.Quath(half, 0, 0, half)] * 2)
    instancer.CreateScalesAttr([Gf.Vec3f(1, 1, 1)] * 3 + [Gf.Vec3f(3, 3, 3)])
    found = sorted(read(stage).meshes, key=lambda mesh: mesh.name)
    assert len(found) == 4
    corner = np.array([places(mesh, 0.0)[1] for mesh in sorted(found, key=lambda m: m.name)])
    expected = [[2, 100, 0], [11, 100, 0], [20, 102, 0], [30, 103, 0]]
    np.testing.assert_allclose(corner, expected, atol=2e-3)  # half-precision quaternions


def test_point_instancers_move_by_velocities_and_hide_instances(tmp_path):
    stage = new_stage(tmp_path)
    instancer = crowd(stage)
    instancer.CreatePositionsAttr().Set([Gf.Vec3f(10.0 * i, 0, 0) for i in range(4)], 0.0)
    instancer.CreateVelocitiesAttr().Set([Gf.Vec3f(0, 24.0 * i, 0) for i in range(4)], 0.0)
    instancer.CreateInvisibleIdsAttr().Set(Vt.Int64Array([0]), 0.0)
    instancer.CreateInvisibleIdsAttr().Set(Vt.Int64Array([0, 3]), 0.1)
    found = {mesh.name.split("/")[0]: mesh for mesh in read(stage).meshes}
    assert set(found) == {"crowd[1]", "crowd[2]", "crowd[3]"}
    np.testing.assert_allclose(places(found["crowd[2]"], 0.25, 0.0)[0], [20, 100.5, 0], atol=1e-5)
    exposed = expose(Scene([found["crowd[3]"]]), 0.0, 1.0).meshes
    assert [(m.open, round(m.close, 5)) for m in exposed] == [(0.0, 0.7)]


def test_visibility_is_inherited_and_exact_in_time(tmp_path):
    stage = new_stage(tmp_path)
    parent = UsdGeom.Xform.Define(stage, "/parent")
    quad(stage, "/parent/quad")
    parent.CreateVisibilityAttr().Set("invisible", 0.0)
    parent.CreateVisibilityAttr().Set("inherited", 10.1)
    (found,) = read(stage).meshes
    assert expose(Scene([found]), 5.0, 1.0).meshes == ()
    (exposed,) = expose(Scene([found]), 10.0, 1.0).meshes
    assert (exposed.open, exposed.close) == (pytest.approx(0.7), 1.0)
    guide = quad(stage, "/guide")
    guide.CreatePurposeAttr("guide")
    assert len(read(stage).meshes) == 1


def test_cameras_with_lens_and_shutter(tmp_path):
    stage = new_stage(tmp_path, codes=48.0)
    quad(stage)
    camera = UsdGeom.Camera.Define(stage, "/cam")
    camera.AddTranslateOp().Set(Gf.Vec3d(0, 0, 10))
    camera.CreateFocalLengthAttr().Set(30.0, 0.0)
    camera.CreateFocalLengthAttr().Set(60.0, 48.0)
    camera.CreateVerticalApertureAttr(15.0)
    camera.CreateHorizontalApertureAttr(20.0)
    camera.CreateFStopAttr(2.0)
    camera.CreateFocusDistanceAttr(8.0)
    camera.CreateShutterOpenAttr(-0.5)
    camera.CreateShutterCloseAttr(1.0)
    stage.Save()
    scene = load(tmp_path / "a.usda")
    assert (scene.fps, scene.shutter.open, scene.shutter.close) == (48.0, -0.5, 1.0)
    poses = expose(Scene(scene.meshes, scene.camera, shutter=Shutter(0, 1)), 24.0, 1.5).path.opening
    np.testing.assert_allclose(poses.focal, [45.0 / 15.0])
    # The lens is focal length over f-stop wide, in tenths of a world unit.
    np.testing.assert_allclose(poses.aperture, [45.0 * 0.1 / 2.0 / 2.0])
    np.testing.assert_allclose(poses.focus, [8.0])
    np.testing.assert_allclose(poses.eye, [[0, 0, 10]])
    halved = load(tmp_path / "a.usda", fps=24)
    assert (halved.fps, halved.shutter.open, halved.shutter.close) == (24.0, -0.25, 0.5)
    poses = expose(
        Scene(halved.meshes, halved.camera, shutter=Shutter(0, 1)), 12.0, 1.5
    ).path.opening
    np.testing.assert_allclose(poses.focal, [45.0 / 15.0])
    camera.CreateFStopAttr(0.0)
    assert read(stage).camera.f_stop is None


def test_motion_api(tmp_path):
    stage = new_stage(tmp_path)
    parent = UsdGeom.Xform.Define(stage, "/parent")
    mesh = quad(stage, "/parent/quad")
    UsdGeom.MotionAPI.Apply(parent.GetPrim()).CreateMotionBlurScaleAttr(0.5)
    UsdGeom.MotionAPI.Apply(mesh.GetPrim()).CreateNonlinearSampleCountAttr(5)
    plain = quad(stage, "/plain")
    assert plain
    found = {item.name: item for item in read(stage).meshes}
    assert (found["quad"].shutter_scale, found["quad"].motion_segments) == (0.5, 4)
    assert (found["plain"].shutter_scale, found["plain"].motion_segments) == (1.0, None)


def test_base_colour_and_texture_of_a_preview_surface(tmp_path):
    stage = new_stage(tmp_path)
    texture_file(tmp_path, [[[255, 0, 0], [188, 188, 188]]])
    plain, image = quad(stage, "/plain"), quad(stage, "/image")
    bind(plain, preview(stage, "/red", diffuseColor=(0.5, 0.1, 0.2))[0])
    bind(image, textured(stage))
    st = UsdGeom.PrimvarsAPI(image).CreatePrimvar(
        "map1", Sdf.ValueTypeNames.TexCoord2fArray, "vertex"
    )
    st.Set([Gf.Vec2f(0, 0), Gf.Vec2f(1, 0), Gf.Vec2f(1, 1), Gf.Vec2f(0, 1)])
    found = {mesh.name: mesh for mesh in read(stage).meshes}
    np.testing.assert_allclose(found["plain"].material.base_color, (0.5, 0.1, 0.2), atol=1e-7)
    assert found["plain"].material.name == "red"
    material = found["image"].material
    assert material.texture.wrap == "mirror"
    np.testing.assert_allclose(material.texture.image[0, 0], [1, 0, 0, 1])
    decoded = ((188 / 255 + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(material.texture.image[0, 1, :3], decoded, rtol=1e-6)
    # Scaled, then turned counter-clockwise, then moved.
    expected = [[0.5, 0.25], [0.5, 2.25], [0.5 - 3, 2.25], [0.5 - 3, 0.25]]
    np.testing.assert_allclose(found["image"].uv, expected, atol=1e-6)
    (tmp_path / "t.png").unlink()
    asset = read(stage)
    assert any("texture not found: t.png" in note for note in asset.notes)
    found = {mesh.name: mesh for mesh in asset.meshes}
    np.testing.assert_allclose(found["image"].material.base_color, (0.5, 0, 0))


def test_gloss_and_emission_of_a_preview_surface(tmp_path):
    stage = new_stage(tmp_path)
    plain, shiny = quad(stage, "/plain"), quad(stage, "/shiny")
    bind(plain, preview(stage, "/dull")[0])
    material, surface = preview(stage, "/metal", emissiveColor=(0.5, 0.25, 0.0))
    for name, value in (("metallic", 1.0), ("roughness", 0.125)):
        surface.CreateInput(name, Sdf.ValueTypeNames.Float).Set(value)
    bind(shiny, material)
    found = {mesh.name: mesh.material for mesh in read(stage).meshes}
    assert {m.shading for m in found.values()} == {"metallic_roughness"}
    assert (found["plain"].metallic, found["plain"].roughness) == (0.0, 0.5)
    assert (found["shiny"].metallic, found["shiny"].roughness) == (1.0, 0.125)
    assert found["shiny"].emission == (0.5, 0.25, 0.0)
    assert found["plain"].emission == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("values", "want"),
    [
        ({}, ("opaque", 1.0)),
        ({"opacity": 0.25}, ("blend", 0.25)),
        ({"opacity": 0.25, "opacityThreshold": 0.0}, ("blend", 0.25)),
        ({"opacity": 0.25, "opacityThreshold": 0.125}, ("mask", 0.25)),
    ],
)
def test_opacity_is_blended_or_where_there_is_a_threshold_tested(tmp_path, values, want):
    stage = new_stage(tmp_path)
    material, surface = preview(stage, "/mat")
    for name, value in values.items():
        surface.CreateInput(name, Sdf.ValueTypeNames.Float).Set(value)
    bind(quad(stage), material)
    asset = read(stage)
    found = asset.meshes[0].material
    assert (found.alpha, found.opacity) == want
    assert found.alpha_cutoff == values.get("opacityThreshold", 0.0) or want[0] != "mask"
    assert not [note for note in asset.notes if "opacity" in note]


def opacity_from(stage, path, output, file="t.png", **inputs):
    """Connect the opacity of the material at ``path`` to a texture of its own."""
    surface = UsdShade.Shader.Get(stage, f"{path}/surface")
    image = UsdShade.Shader.Define(stage, f"{path}/cut")
    image.CreateIdAttr("UsdUVTexture")
    image.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(file)
    image.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("raw")
    for name, value in inputs.items():
        image.CreateInput(name, Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*[value] * 4))
    result = image.CreateOutput(output, Sdf.ValueTypeNames.Float)
    surface.CreateInput("opacity", Sdf.ValueTypeNames.Float).ConnectToSource(result)
    return image


def test_opacity_from_a_channel_of_a_texture(tmp_path):
    texture_file(tmp_path, [[[255, 51, 0, 102], [0, 255, 0, 255]]])
    for output, want in (("a", [0.4, 1]), ("g", [0.2, 1]), ("r", [1, 0])):
        stage = new_stage(tmp_path, name=f"{output}.usda")
        material, _ = preview(stage, "/mat", diffuseColor=(0.5, 0.1, 0.2))
        opacity_from(stage, "/mat", output, scale=0.5, bias=0.25)
        bind(quad(stage), material)
        found = read(stage).meshes[0].material
        assert found.alpha == "blend"
        np.testing.assert_allclose(found.base_color, (0.5, 0.1, 0.2), atol=1e-7)
        np.testing.assert_allclose(found.texture.image[..., :3], 1.0)
        want = [[0.5 * value + 0.25 for value in want]]
        np.testing.assert_allclose(found.texture.image[..., 3], want, atol=1e-6)


def test_opacity_joins_the_texture_of_the_colour_where_both_are_looked_up_alike(tmp_path):
    texture_file(tmp_path, [[[255, 0, 0, 51], [0, 255, 0, 255]]])
    for alike in (True, False):
        stage = new_stage(tmp_path, name=f"{alike}.usda")
        bind(quad(stage), textured(stage))
        image = opacity_from(stage, "/mat", "a")
        if alike:
            move = UsdShade.Shader.Get(stage, "/mat/move").GetOutput("result")
            image.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(move)
        asset = read(stage)
        found = asset.meshes[0].material
        assert found.alpha == ("blend" if alike else "opaque")
        noted = [note for note in asset.notes if "opacity is read as 1" in note]
        assert bool(noted) == (not alike)
        if alike:
            want = [[[1, 0, 0, 0.2], [0, 1, 0, 1]]]
            np.testing.assert_allclose(found.texture.image, want, atol=1e-6)


def test_subsets_have_their_own_materials(tmp_path):
    stage = new_stage(tmp_path)
    mesh = quad(stage, counts=(3, 3), indices=(0, 1, 2, 0, 2, 3))
    red = preview(stage, "/red", diffuseColor=(1, 0, 0))[0]
    subset = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).CreateMaterialBindSubset(
        "part", Vt.IntArray([1])
    )
    UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(red)
    found = {item.name: item for item in read(stage).meshes}
    assert found["quad.part"].material.name == "red"
    np.testing.assert_array_equal(
        found["quad.part"].positions[found["quad.part"].faces[0]], np.array(QUAD)[[0, 2, 3]]
    )
    assert len(found["quad"].faces) == 1


def skinned_stage(tmp_path, shapes=True):
    """Random points on three joints that turn, with a blend shape that has an in-between."""
    random = np.random.default_rng(4)
    stage = new_stage(tmp_path)
    root = UsdSkel.Root.Define(stage, "/root")
    root.AddTranslateOp().Set(Gf.Vec3d(1, 2, 3))
    skeleton = UsdSkel.Skeleton.Define(stage, "/root/skel")
    skeleton.AddRotateXOp().Set(30.0)
    names = ["a", "a/b", "a/b/c"]
    skeleton.CreateJointsAttr(names)
    rest = [Gf.Matrix4d().SetTranslate(Gf.Vec3d(*random.uniform(-1, 1, 3))) for _ in names]
    skeleton.CreateRestTransformsAttr(rest)
    bind_pose = [rest[0], rest[1] * rest[0], rest[2] * rest[1] * rest[0]]
    skeleton.CreateBindTransformsAttr(bind_pose)
    animation = UsdSkel.Animation.Define(stage, "/root/skel/anim")
    animation.CreateJointsAttr(names)
    animation.CreateTranslationsAttr([Gf.Vec3f(m.ExtractTranslation()) for m in rest])
    animation.CreateScalesAttr([Gf.Vec3h(1, 1, 1)] * 3)
    for code in (0.0, 5.0, 10.0):
        turns = [Gf.Rotation(Gf.Vec3d(*random.normal(size=3)), 9.0 * code) for _ in names]
        animation.CreateRotationsAttr().Set([Gf.Quatf(turn.GetQuat()) for turn in turns], code)
        animation.CreateBlendShapesAttr(["other", "smile"])
        animation.CreateBlendShapeWeightsAttr().Set([0.3, code / 10.0], code)
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets(
        [animation.GetPath()]
    )
    points = random.uniform(-1, 1, (12, 3))
    mesh = quad(stage, "/root/mesh", points.tolist(), (3,) * 4, range(12))
    mesh.AddTranslateOp().Set(Gf.Vec3d(7, 7, 7))  # of no account for a skinned mesh
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    binding.CreateJointsAttr(["a/b/c", "a"])  # an order of its own
    binding.CreateGeomBindTransformAttr(Gf.Matrix4d().SetScale(1.5))
    binding.CreateJointIndicesPrimvar(False, 2).Set([0, 1] * 12)
    weights = random.uniform(0, 1, 12)
    pairs = np.stack([weights, 1 - weights], axis=1).ravel().tolist()
    binding.CreateJointWeightsPrimvar(False, 2).Set(pairs)
    if shapes:
        shape = UsdSkel.BlendShape.Define(stage, "/root/mesh/smile")
        shape.CreatePointIndicesAttr([1, 4, 7])
        shape.CreateOffsetsAttr([Gf.Vec3f(0, 0, 2)] * 3)
        between = shape.CreateInbetween("half")
        between.SetWeight(0.5)
        between.SetOffsets([Gf.Vec3f(3, 0, 0)] * 3)
        binding.CreateBlendShapesAttr(["smile"])
        binding.CreateBlendShapeTargetsRel().SetTargets([shape.GetPath()])
    return stage


def baked_points(path, code):
    """World points of every mesh as usd-core bakes them, by path."""
    stage = Usd.Stage.Open(str(path))
    stage.SetEditTarget(stage.GetSessionLayer())
    UsdSkel.BakeSkinning(stage.Traverse(), Gf.Interval(code, code))
    found = {}
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Mesh):
            points = np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get(code))
            matrix = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(code))
            found[prim.GetName()] = points @ matrix[:3, :3] + matrix[3, :3]
    return found


@pytest.mark.parametrize("code", [0.0, 5.0, 10.0])
@pytest.mark.parametrize("shapes", [True, False])
def test_skeletons_and_blend_shapes_are_as_usd_bakes_them(tmp_path, shapes, code):
    (mesh,) = read(skinned_stage(tmp_path, shapes)).meshes
    expected = baked_points(tmp_path / "a.usda", code)["mesh"]
    np.testing.assert_allclose(places(mesh, code), expected, atol=2e-6)
    other = baked_points(tmp_path / "a.usda", 5.0 if code != 5.0 else 0.0)["mesh"]
    assert np.abs(other - expected).max() > 0.1  # the comparison can fail


def test_in_betweens_of_blend_shapes_are_passed_through(tmp_path):
    (mesh,) = read(skinned_stage(tmp_path)).meshes
    moved = [
        mesh.deformer.morph.added(mesh.positions, mesh.deformer.morph.positions, frame)
        - mesh.positions
        for frame in (2.5, 5.0, 7.5, 10.0)
    ]
    expected = [[1.5, 0, 0], [3, 0, 0], [1.5, 0, 1], [0, 0, 2]]
    np.testing.assert_allclose([offset[4] for offset in moved], expected, atol=1e-6)
    np.testing.assert_allclose([offset[0] for offset in moved], 0.0)


@pytest.mark.parametrize(
    ("name", "mesh"),
    [
        ("usd_riggedfigure/RiggedFigure.usdz", "Proxy_1"),
        ("usd_riggedsimple/RiggedSimple.usdz", "Cylinder_2"),
    ],
)
def test_rigged_models_are_as_usd_bakes_them(name, mesh, shared_file):
    path = shared_file(f"assets/{name}")
    (found,) = (item for item in read_usd(path).meshes if item.name == mesh)
    codes = found.deformer.skin.joints.skeleton.GetAnimQuery().GetJointTransformTimeSamples()
    for code in codes[:: max(len(codes) // 5, 1)]:
        theirs = baked_points(path, code)[mesh]
        distance = np.linalg.norm(places(found, code)[:, None] - theirs[None], axis=2).min(axis=1)
        assert distance.max() < 1e-5 * np.ptp(theirs)


def test_blend_shapes_are_the_ground_truth_of_their_file(shared_file):
    path = shared_file("assets/usd_openusd_blendshapes/blendshapes.usda")
    truth, found = read_usd(path).meshes
    for frame in range(1, 131, 7):
        ours, theirs = (places(mesh, float(frame)) for mesh in (found, truth))
        ours, theirs = ours - ours.mean(axis=0), theirs - theirs.mean(axis=0)
        np.testing.assert_allclose(ours, theirs, atol=1e-3 * np.ptp(theirs))


def test_subdivision_cages_are_said(tmp_path):
    stage = new_stage(tmp_path)
    quad(stage).CreateSubdivisionSchemeAttr("catmullClark")
    assert read(stage).notes == ("a.usda: catmullClark subdivision cages are shown as polygons",)


def test_a_usd_file_renders(tmp_path):
    stage = new_stage(tmp_path)
    mesh = quad(stage, points=[(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)])
    mesh.CreateVisibilityAttr().Set("inherited", 0.0)
    mesh.CreateVisibilityAttr().Set("invisible", 5.0)
    UsdGeom.Camera.Define(stage, "/cam").AddTranslateOp().Set(Gf.Vec3d(0, 0, 5))
    stage.Save()
    table = {"objects": [{"file": "a.usda"}], "fps": 24.0}
    film = render(load(table, tmp_path), frame=5, width=24, height=16)
    np.testing.assert_allclose(film.rgba[..., 3], 0.5, atol=1e-6)


def test_without_usd_core_the_remedy_is_named(tmp_path, monkeypatch):
    (tmp_path / "a.usda").write_text("#usda 1.0\n")
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(SceneError, match=r"a\.usda: .*pip install 'mbinterval\[usd\]'"):
        load(tmp_path / "a.usda")


def spoil_topology(stage):
    quad(stage).GetFaceVertexCountsAttr().Set([3], 5.0)
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/quad"))
    mesh.GetFaceVertexCountsAttr().Set([4], 6.0)


def spoil_counts(stage):
    quad(stage, counts=(5,))


def spoil_indices(stage):
    quad(stage, indices=(0, 1, 2, 9))


def spoil_primvar(stage):
    quad(stage).CreateDisplayColorPrimvar("vertex").Set([Gf.Vec3f(1, 0, 0)])


def spoil_influences(stage):
    mesh = quad(stage)
    root = UsdSkel.Root.Define(stage, "/root")
    assert root
    mesh.GetPointsAttr().Clear()


def spoil_order(stage):
    mesh = quad(stage)
    mesh.AddTranslateOp()
    mesh.GetXformOpOrderAttr().Set(["xformOp:transalte"])


def only_spheres(stage):
    UsdGeom.Sphere.Define(stage, "/ball")


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (spoil_topology, "/quad: its faces change over time"),
        (spoil_counts, "/quad: faceVertexCounts add up to 5, but there are 4"),
        (spoil_indices, "/quad: faceVertexIndices run from 0 to 9, but points from 0 to 3"),
        (spoil_primvar, "/quad: primvar 'displayColor' has 1 values, vertex asks for 4"),
        (spoil_influences, "/quad: faceVertexIndices run from 0 to 3, but points from 0 to -1"),
        (spoil_order, "/quad: cannot be read .Invalid xform opType token 'transalte'"),
        (only_spheres, "holds no mesh, only Sphere"),
    ],
)
def test_what_is_wrong_with_a_stage_is_said(tmp_path, spoil, said):
    stage = new_stage(tmp_path)
    spoil(stage)
    with pytest.raises(SceneError, match=rf"a\.usda: .*{said}"):
        read(stage)


def test_a_colour_from_a_shader_without_an_id_is_left_out_and_said(tmp_path):
    stage = new_stage(tmp_path)
    mesh = quad(stage)
    material = UsdShade.Material.Define(stage, "/look")
    surface = UsdShade.Shader.Define(stage, "/look/surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    unknown = UsdShade.Shader.Define(stage, "/look/unknown")
    unknown.CreateOutput("rgb", Sdf.ValueTypeNames.Color3f)
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(
        unknown.ConnectableAPI(), "rgb"
    )
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    assert "its colour comes from a shader without id; left out" in read(stage).notes[0]


def test_a_value_of_another_type_is_told_of_by_its_prim(tmp_path):
    stage = new_stage(tmp_path)
    quad(stage).CreateHoleIndicesAttr([9])
    with pytest.raises(SceneError, match=r"a\.usda: /quad: cannot be read \(IndexError: .*again"):
        read(stage)


def test_broken_files_and_wrong_options_are_said(tmp_path):
    (tmp_path / "b.usda").write_text("#usda 1.0\ndef Mesh {")
    with pytest.raises(SceneError, match=r"b\.usda: not a readable USD file") as caught:
        load(tmp_path / "b.usda")
    assert "Error in" not in str(caught.value)  # what USD says, without where in USD
    assert "b.usda:2" in str(caught.value)
    with pytest.raises(UsageError, match="a USD file has one animation"):
        load(tmp_path / "b.usda", clip="Walk")
