"""USD stages as usd-core writes them."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

QUAD = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]


def new_stage(tmp_path, up="Y", codes=24.0, name="a.usda"):
    stage = Usd.Stage.CreateNew(str(tmp_path / name))
    UsdGeom.SetStageUpAxis(stage, up)
    stage.SetTimeCodesPerSecond(codes)
    return stage


def quad(stage, path="/quad", points=QUAD, counts=(4,), indices=(0, 1, 2, 3)):
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr([Gf.Vec3f(*point) for point in points])
    mesh.CreateFaceVertexCountsAttr(list(counts))
    mesh.CreateFaceVertexIndicesAttr(list(indices))
    mesh.CreateSubdivisionSchemeAttr("none")
    return mesh


def preview(stage, path, **inputs):
    material = UsdShade.Material.Define(stage, path)
    surface = UsdShade.Shader.Define(stage, f"{path}/surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    for name, value in inputs.items():
        surface.CreateInput(name, Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*value))
    return material, surface


def bind(mesh, material):
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)


def texture_file(tmp_path, pixels):
    stream = io.BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8)).save(stream, "PNG")
    (tmp_path / "t.png").write_bytes(stream.getvalue())


def textured(stage, path="/mat", file="t.png"):
    material, surface = preview(stage, path)
    image = UsdShade.Shader.Define(stage, f"{path}/image")
    image.CreateIdAttr("UsdUVTexture")
    image.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(file)
    image.CreateInput("wrapS", Sdf.ValueTypeNames.Token).Set("mirror")
    image.CreateInput("wrapT", Sdf.ValueTypeNames.Token).Set("mirror")
    image.CreateInput("fallback", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(0.5, 0, 0, 1))
    move = UsdShade.Shader.Define(stage, f"{path}/move")
    move.CreateIdAttr("UsdTransform2d")
    move.CreateInput("rotation", Sdf.ValueTypeNames.Float).Set(90.0)
    move.CreateInput("scale", Sdf.ValueTypeNames.Float2).Set(Gf.Vec2f(2, 3))
    move.CreateInput("translation", Sdf.ValueTypeNames.Float2).Set(Gf.Vec2f(0.5, 0.25))
    reader = UsdShade.Shader.Define(stage, f"{path}/reader")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    name = material.CreateInput("uvName", Sdf.ValueTypeNames.String)
    name.Set("map1")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).ConnectToSource(name)
    for user, given, source, result, kind in (
        (surface, "diffuseColor", image, "rgb", Sdf.ValueTypeNames.Color3f),
        (image, "st", move, "result", Sdf.ValueTypeNames.Float2),
        (move, "in", reader, "result", Sdf.ValueTypeNames.Float2),
    ):
        output = source.CreateOutput(result, Sdf.ValueTypeNames.Float3)
        user.CreateInput(given, kind).ConnectToSource(output)
    return material
