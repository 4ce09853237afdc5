"""Files that are broken on purpose: whole ones, and a seeded change in each of its copies.

What is mutated are the scenes of this repository and small models and images that are made here.
Changes are of three kinds: of bytes, of words and numbers in text, and of the tree that a text
stands for. The last ones, and PNG chunks with sums that fit, get past the parser.
"""

from __future__ import annotations

import copy
import json
import random
import re
import struct
import tomllib
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from mbinterval.files.exr import ExrImage, write_exr
from support.gltf_files import Gltf

SCENES = Path(__file__).parents[2] / "scenes"


@dataclass(frozen=True)
class Mutant:
    """A file to render, what lies beside it, and what was done to which.

    ``scene`` is what is rendered, ``broken`` the file that was changed; both in ``files``.
    """

    label: str
    scene: str
    broken: str
    files: Mapping[str, bytes] = field(repr=False)

    def write(self, folder: Path) -> None:
        folder.mkdir(parents=True)
        for name, data in self.files.items():
            (folder / name).write_bytes(data)
        (folder / "assets").symlink_to(SCENES / "assets")


Change = Callable[[bytes, random.Random], bytes]

NUMBERS = (
    *(0, -1, 1, 2, 255, 65536, 2**31 - 1, 2**31, 2**32, 2**53 + 1, 10**30, -(10**30)),
    *(0.5, -0.5, 1e-300, 1e-30, 1e30, 1e300, -1e300, 5e-324, 0.1),
)
OTHERS = (None, True, False, "", "x", "\u00e9\u0000", [], {}, [[]], [0, 1])
VALUES: tuple[Any, ...] = (*NUMBERS, *OTHERS)
WORDS = tuple(bytes.fromhex(text) for text in ("00" * 8, "ff" * 8, "00000080", "ffffff7f"))
SPECIAL = tuple(struct.pack("<f", value) for value in (np.nan, np.inf, -np.inf, 1e30))


def of_bytes(data: bytes, chance: random.Random) -> bytes:
    """Some bits flipped, a part overwritten, cut out, doubled, or everything after it cut off."""
    found = bytearray(data)
    # Headers are short and decide most.
    end = len(data) if chance.random() < 0.5 else min(len(data), 600)
    place = chance.randrange(end)
    length = min(int(2 ** chance.uniform(0, 10)), len(data))
    how = chance.randrange(6)
    if how <= 1:
        for _ in range(chance.choice((1, 1, 2, 8, 64))):
            found[chance.randrange(end)] ^= 1 << chance.randrange(8)
    elif how == 2:
        word = chance.choice(WORDS + SPECIAL)
        found[place : place + len(word)] = word
    elif how == 3:
        del found[place : place + length]
    elif how == 4:
        found[place:place] = found[place : place + length]
    else:
        del found[place:]
    return bytes(found)


def of_text(data: bytes, chance: random.Random) -> bytes:
    """A number, a word or a line replaced, left out or doubled."""
    text = data.decode()
    kind = chance.choice((r"-?\d+(?:\.\d+)?(?:e-?\d+)?", r"[A-Za-z_]\w*", r".*\n", r'"[^"\n]*"'))
    matches = list(re.finditer(kind, text))
    if not matches:
        return of_bytes(data, chance)
    match, other = chance.choice(matches), chance.choice(matches)
    fresh = {
        0: "",
        1: match[0] * 2,
        2: other[0],
        3: json.dumps(chance.choice(VALUES)),
        4: chance.choice(("nan", "inf", "-inf", "1e999", "0x10", "[", "}", '"', "é", "#", "\x00")),
    }[chance.randrange(5)]
    return (text[: match.start()] + fresh + text[match.end() :]).encode()


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Every container in ``tree`` with each key or index of it."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    for key, value in items:
        yield tree, key
        if isinstance(value, dict | list):
            yield from _places(value)


def of_tree(tree: Any, chance: random.Random) -> Any:
    """A copy of parsed JSON in which one to three values are others, missing or doubled."""
    tree = copy.deepcopy(tree)
    for _ in range(chance.choice((1, 1, 1, 2, 3))):
        places = list(_places(tree))
        within, key = chance.choice(places)
        source, name = chance.choice(places)
        how = chance.randrange(6)
        if how == 0:
            del within[key]
        elif how == 1:
            within[key] = copy.deepcopy(source[name])
        elif how == 2 and isinstance(within, list):
            within.insert(key, copy.deepcopy(within[key]))
        elif how == 3 and isinstance(within[key], int | float):
            within[key] = chance.choice((within[key] + 1, -within[key] - 1, within[key] * 1000))
        else:
            within[key] = copy.deepcopy(chance.choice(VALUES))
    return tree


def of_json(data: bytes, chance: random.Random) -> bytes:
    """A JSON file whose tree was changed."""
    return json.dumps(of_tree(json.loads(data), chance)).encode()


def of_glb(data: bytes, chance: random.Random) -> bytes:
    """A GLB whose JSON chunk, or the numbers in whose binary chunk, were changed."""
    length = int.from_bytes(data[12:16], "little")
    text, rest = data[20 : 20 + length], bytearray(data[20 + length :])
    if chance.random() < 0.75:
        text = of_json(text, chance)
        text += b" " * (-len(text) % 4)
    else:
        for _ in range(chance.choice((1, 10, 100))):
            place = chance.randrange(8, len(rest) - 4) & ~3
            rest[place : place + 4] = chance.choice(WORDS + SPECIAL)[:4]
    head = struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + bytes(rest)


def of_png(data: bytes, chance: random.Random) -> bytes:
    """A PNG in which a chunk was changed, with a sum that fits; or one left out or doubled."""
    chunks, place = [], 8
    while place < len(data):
        size = int.from_bytes(data[place : place + 4])
        chunks.append((data[place + 4 : place + 8], data[place + 8 : place + 8 + size]))
        place += 12 + size
    number = chance.randrange(len(chunks))
    kind, content = chunks[number]
    how = chance.randrange(5)
    if how == 0:
        del chunks[number]
    elif how == 1:
        chunks.insert(number, chunks[chance.randrange(len(chunks))])
    elif kind == b"IDAT" and how == 2:
        chunks[number] = kind, zlib.compress(of_bytes(zlib.decompress(content), chance))
    else:
        chunks[number] = kind, of_bytes(content or b"\0", chance)
    found = [data[:8]]
    for kind, content in chunks:
        found += [struct.pack(">I", len(content)), kind, content]
        found.append(struct.pack(">I", zlib.crc32(kind + content)))
    return b"".join(found)


CHANGES: dict[str, tuple[Change, ...]] = {
    ".toml": (of_text, of_text, of_bytes),
    ".json": (of_json, of_json, of_json, of_text),
    ".gltf": (of_json, of_json, of_text),
    ".glb": (of_glb, of_glb, of_bytes),
    ".usda": (of_text, of_text, of_bytes),
    ".png": (of_png, of_png, of_bytes),
}
"""How files are changed, by their ending; others by their bytes."""


def mutant(sources: Mapping[str, Mapping[str, bytes]], kind: str, number: int) -> Mutant:
    """Mutant ``number`` of ``sources``: files by name, for each of them; the first is rendered.

    The last file of a source is the one that is changed; it may be the first.
    """
    chance = random.Random(f"{kind} {number}")
    name = chance.choice(list(sources))
    files = dict(sources[name])
    scene, broken = next(iter(files)), list(files)[-1]
    change = chance.choice(CHANGES.get(Path(broken).suffix, (of_bytes,)))
    files[broken] = change(files[broken], chance)
    return Mutant(f"{kind} {number}: {name} by {change.__name__}", scene, broken, files)


def scene_sources() -> dict[str, dict[str, bytes]]:
    """Scenes of the repository as TOML, and as JSON whose tree can be changed."""
    found = {}
    for path in sorted(SCENES.glob("*.toml")):
        found[path.name] = {path.name: path.read_bytes()}
        tree = tomllib.loads(path.read_text(encoding="utf-8"))
        found[f"{path.stem}.json"] = {f"{path.stem}.json": json.dumps(tree).encode()}
    arrays = {
        "camera": {"keys": [{"frame": f, "position": [0, 0, 4 + f]} for f in (0, 3)]},
        "objects": [
            {
                "positions": [[[x, 0, 0], [x + 1, 0, 0], [x, 1, 0]] for x in (0.0, 0.5)],
                "faces": [[0, 1, 2]],
                "normals": [[0, 0, 1]] * 3,
                "uv": [[0, 0], [1, 0], [0, 1]],
                "color": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
                "material": {"texture": "assets/wheel.png", "opacity": 0.5, "wrap": "mirror"},
            }
        ],
    }
    found["arrays.json"] = {"arrays.json": json.dumps(arrays).encode()}
    return found


def picture(mode: str = "RGB", size: int = 8) -> Image.Image:
    """An image of that mode, of random pixels."""
    pixels = np.random.default_rng(3).integers(0, 256, (size, size, 4), np.uint8)
    return Image.fromarray(pixels, "RGBA").convert(mode)


def encoded(image: Image.Image, kind: str, **options: Any) -> bytes:
    stream = BytesIO()
    image.save(stream, kind, **options)
    return stream.getvalue()


def gltf_sources(folder: Path) -> dict[str, dict[str, bytes]]:
    """The models of the repository, and small ones with everything that the reader knows."""
    found = {}
    for name in ("Fox.glb", "CesiumMilkTruck.glb"):
        found[name] = {name: (SCENES / "assets" / name).read_bytes()}
    for name in ("rigged.glb", "rigged.gltf"):
        rigged = _rigged().write(folder / name)
        found[name] = {name: rigged.read_bytes()}
    return found


def _rigged() -> Gltf:
    """A triangle with skin, morph target, texture, sparse indices, colours, camera and light."""
    gltf = Gltf()
    image = gltf.view(encoded(picture(), "PNG"))
    gltf.json["images"] = [{"bufferView": image, "mimeType": "image/png"}]
    gltf.json["samplers"] = [{"wrapS": 33071, "wrapT": 10497}]
    gltf.json["textures"] = [{"source": 0, "sampler": 0}]
    moved = {"offset": [0.1, 0.2], "rotation": 0.3, "scale": [2, 2], "texCoord": 0}
    texture = {"index": 0, "extensions": {"KHR_texture_transform": moved}}
    gltf.json["materials"] = [
        {
            "pbrMetallicRoughness": {
                "baseColorTexture": texture,
                "baseColorFactor": [1, 1, 1, 0.5],
            },
            "alphaMode": "BLEND",
            "extensions": {"KHR_materials_unlit": {}},
        }
    ]
    attributes = {
        "TEXCOORD_0": gltf.accessor([[0, 0], [65535, 0], [0, 65535]], "H", normalized=True),
        "COLOR_0": gltf.accessor(np.ones((3, 4))),
        "NORMAL": gltf.accessor([[0, 0, 1]] * 3),
        "JOINTS_0": gltf.accessor([[0, 1, 0, 0]] * 3, "B"),
        "WEIGHTS_0": gltf.accessor([[0.5, 0.5, 0, 0]] * 3),
    }
    target = gltf.accessor([[0, 0, 1]] * 3)
    sparse = {
        "count": 1,
        "indices": {"bufferView": gltf.view(b"\x01"), "componentType": 5121},
        "values": {"bufferView": gltf.view(np.float32([0, 0, 2]).tobytes())},
    }
    gltf.json["accessors"][target]["sparse"] = sparse
    indices = gltf.accessor([0, 1, 2, 0, 2, 1], "H")
    mesh = gltf.triangle(
        attributes=attributes, indices=indices, material=0, targets=[{"POSITION": target}]
    )
    gltf.json["meshes"][mesh]["weights"] = [0.5]
    gltf.json["cameras"] = [
        {"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1, "aspectRatio": 1.5}}
    ]
    lamp = {"type": "point", "color": [1, 1, 1], "intensity": 50.0}
    gltf.json["extensions"] = {"KHR_lights_punctual": {"lights": [lamp]}}
    gltf.json["extensionsUsed"] = ["KHR_lights_punctual", "KHR_texture_transform"]
    root, joint = gltf.node(children=[1, 2, 3, 4, 5]), gltf.node(translation=[0, 0, 0])
    other = gltf.node(rotation=[0, 0, 0, 1], scale=[1, 1, 1])
    skin = gltf.skin([joint, other], [np.eye(4)] * 2)
    gltf.node(mesh=mesh, skin=skin)
    gltf.node(camera=0, translation=[0, 0, 3])
    gltf.node(matrix=np.eye(4).ravel().tolist(), extensions={"KHR_lights_punctual": {"light": 0}})
    gltf.animate(joint, "rotation", [0.0, 1.0], [[0, 0, 0, 1], [0, 0, 0.6, 0.8]])
    gltf.animate(other, "translation", [0.0, 0.5, 1.0], np.zeros((3, 3)), "STEP")
    gltf.animate(root, "scale", [0.0, 1.0], np.ones((6, 3)), "CUBICSPLINE")
    gltf.animate(root + 3, "weights", [0.0, 1.0], [0.0, 1.0])
    return gltf


def image_sources(folder: Path) -> dict[str, dict[str, bytes]]:
    """Images of many kinds, seen as a texture."""
    write_exr(
        folder / "a.exr",
        ExrImage({name: np.full((8, 8), 0.5, np.float32) for name in "RGBA"}, (8, 8), (0, 0), {}),
    )
    images = {
        "rgb.png": encoded(picture(), "PNG"),
        "rgba.png": encoded(picture("RGBA"), "PNG"),
        "palette.png": encoded(picture("P"), "PNG", transparency=3),
        "grey16.png": encoded(Image.fromarray(np.arange(64, dtype=np.uint16).reshape(8, 8)), "PNG"),
        "a.jpg": encoded(picture(size=24), "JPEG"),
        "progressive.jpg": encoded(picture(size=24), "JPEG", progressive=True),
        "a.tif": encoded(picture(), "TIFF", compression="tiff_lzw"),
        "a.webp": encoded(picture(), "WEBP"),
        "a.gif": encoded(picture("P"), "GIF"),
        "a.bmp": encoded(picture(), "BMP"),
        "a.tga": encoded(picture(), "TGA"),
        "a.exr": (folder / "a.exr").read_bytes(),
        "studio.hdr": (SCENES / "assets" / "studio.hdr").read_bytes(),
    }
    return (
        {name: {"s.json": _seen(name), name: data} for name, data in images.items()}
        | {
            f"background {name}": {"s.json": _behind(name), name: images[name]}
            for name in ("rgb.png", "a.exr")
        }
        | {"around": {"s.json": _around("studio.hdr"), "studio.hdr": images["studio.hdr"]}}
    )


_CAMERA = {"position": [0, 0, 3], "look_at": [0, 0, 0]}


def _seen(texture: str) -> bytes:
    plane = {"primitive": {"kind": "plane"}, "material": {"texture": texture, "shading": "unlit"}}
    return json.dumps({"camera": _CAMERA, "objects": [plane]}).encode()


def _around(picture: str) -> bytes:
    """A ball that mirrors the picture, and a triangle that passes."""
    chrome = {"shading": "metallic_roughness", "metallic": 1.0, "roughness": 0.1}
    moves = {"keys": [{"frame": f, "translation": [f, 0, 0]} for f in (0, 3)]}
    ball = {"primitive": {"kind": "sphere", "segments": 8}, "material": chrome, "transform": moves,
            "reflections": {"size": 16, "times": 2}}  # fmt: skip
    passing = {"primitive": {"kind": "box"}, "transform": {"translation": [0, 2, 0]}}
    around = {"file": picture, "rotation": 30.0}
    table = {"camera": _CAMERA, "environment": around, "objects": [ball, passing]}
    return json.dumps(table).encode()


def _behind(background: str) -> bytes:
    return json.dumps({"camera": _CAMERA, "background": background}).encode()


def mesh_sources(folder: Path) -> dict[str, dict[str, bytes]]:
    """A box as the kinds of mesh files that are common, one with a material of its own."""
    import trimesh

    box = trimesh.creation.box()
    found = {}
    for name in ("a.ply", "a.stl", "a.off"):
        box.export(folder / name)
        found[name] = {name: (folder / name).read_bytes()}
    text = trimesh.exchange.obj.export_obj(box)
    library = b"newmtl m\nKd 0.5 0.5 0.5\nmap_Kd rgb.png\n"
    obj = f"mtllib a.mtl\nusemtl m\n{text}".encode()
    picture_file = {"rgb.png": encoded(picture(), "PNG")}
    found["a.obj"] = {"s.json": json.dumps({"objects": [{"file": "a.obj"}]}).encode()}
    found["a.obj"] |= picture_file | {"a.mtl": library, "a.obj": obj}
    found["a.mtl"] = {
        name: found["a.obj"][name] for name in ("s.json", "rgb.png", "a.obj", "a.mtl")
    }
    return found


def usd_sources(folder: Path) -> dict[str, dict[str, bytes]]:
    """A stage with all that the reader knows, as text, as crate and as package."""
    from pxr import UsdUtils

    (folder / "rgb.png").write_bytes(encoded(picture(), "PNG"))
    stage = _stage(folder / "a.usda")
    stage.Export(str(folder / "a.usdc"))
    UsdUtils.CreateNewUsdzPackage(str(folder / "a.usdc"), str(folder / "a.usdz"))
    beside = {"rgb.png": (folder / "rgb.png").read_bytes()}
    found = {}
    for name in ("a.usda", "a.usdc", "a.usdz"):
        found[name] = _rendered(name, beside, (folder / name).read_bytes())
    return found


def _rendered(name: str, beside: Mapping[str, bytes], data: bytes) -> dict[str, bytes]:
    """A scene that names the model, what lies beside it, and the model itself, last."""
    scene = json.dumps({"objects": [{"file": name}]}).encode()
    return {"s.json": scene, **beside, name: data}


def _stage(path: Path) -> Any:
    from pxr import Gf, Usd, UsdGeom

    stage = Usd.Stage.CreateNew(str(path))
    stage.SetTimeCodesPerSecond(24.0)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(2)
    quad = [Gf.Vec3f(x, y, 0) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]

    def mesh(at: str) -> Any:
        made = UsdGeom.Mesh.Define(stage, at)
        made.CreatePointsAttr(quad)
        made.CreateFaceVertexCountsAttr([4])
        made.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
        made.CreateSubdivisionSchemeAttr("none")
        return made

    plain = mesh("/plain")
    plain.CreateVelocitiesAttr([Gf.Vec3f(1, 0, 0)] * 4)
    plain.CreateDisplayColorAttr([Gf.Vec3f(1, 0, 0)])
    plain.CreateNormalsAttr([Gf.Vec3f(0, 0, 1)] * 4)
    plain.AddRotateXYZOp().Set(Gf.Vec3f(0, 0, 40), 2.0)
    plain.GetVisibilityAttr().Set("invisible", 3.0)
    moving = mesh("/moving")
    for time in (0.0, 2.0):
        moving.GetPointsAttr().Set([point + Gf.Vec3f(time, 0, 0) for point in quad], time)
    _textured(stage, mesh("/textured"))
    _rigged_quad(stage, mesh)
    crowd = UsdGeom.PointInstancer.Define(stage, "/crowd")
    prototype = mesh("/crowd/kinds/quad")
    crowd.CreatePrototypesRel().SetTargets([prototype.GetPath()])
    crowd.CreateProtoIndicesAttr([0, 0])
    crowd.CreatePositionsAttr([Gf.Vec3f(0, 2, 0), Gf.Vec3f(2, 2, 0)])
    crowd.CreateOrientationsAttr([Gf.Quath(1, 0, 0, 0)] * 2)
    crowd.CreateScalesAttr([Gf.Vec3f(1, 1, 1)] * 2)
    crowd.CreateVelocitiesAttr([Gf.Vec3f(0, 1, 0)] * 2)
    crowd.CreateInvisibleIdsAttr([1])
    camera = UsdGeom.Camera.Define(stage, "/camera")
    camera.AddTranslateOp().Set(Gf.Vec3d(0, 0, 8))
    camera.CreateShutterOpenAttr(-0.25)
    camera.CreateShutterCloseAttr(0.25)
    camera.CreateFocalLengthAttr(35.0)
    camera.CreateFStopAttr(2.8)
    camera.CreateFocusDistanceAttr(8.0)
    stage.Save()
    return stage


def _textured(stage: Any, mesh: Any) -> None:
    from pxr import Sdf, UsdGeom, UsdShade

    texture_uv = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
    )
    texture_uv.Set([(0, 0), (1, 0), (1, 1), (0, 1)])
    material = UsdShade.Material.Define(stage, "/look")
    surface = UsdShade.Shader.Define(stage, "/look/surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    image = UsdShade.Shader.Define(stage, "/look/image")
    image.CreateIdAttr("UsdUVTexture")
    image.CreateInput("file", Sdf.ValueTypeNames.Asset).Set("./rgb.png")
    reader = UsdShade.Shader.Define(stage, "/look/reader")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    image.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(
        reader.ConnectableAPI(), "result"
    )
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(
        image.ConnectableAPI(), "rgb"
    )
    surface.CreateInput("opacity", Sdf.ValueTypeNames.Float).Set(0.5)
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)


def _rigged_quad(stage: Any, mesh: Callable[[str], Any]) -> None:
    from pxr import Gf, UsdSkel, Vt

    UsdSkel.Root.Define(stage, "/rig")
    skeleton = UsdSkel.Skeleton.Define(stage, "/rig/bones")
    skeleton.CreateJointsAttr(["hip", "hip/knee"])
    skeleton.CreateBindTransformsAttr([Gf.Matrix4d(1.0)] * 2)
    skeleton.CreateRestTransformsAttr([Gf.Matrix4d(1.0)] * 2)
    moves = UsdSkel.Animation.Define(stage, "/rig/moves")
    moves.CreateJointsAttr(["hip", "hip/knee"])
    for time in (0.0, 2.0):
        moves.CreateTranslationsAttr().Set([Gf.Vec3f(0, time, 0)] * 2, time)
        moves.CreateRotationsAttr().Set([Gf.Quatf(1.0)] * 2, time)
        moves.CreateScalesAttr().Set([Gf.Vec3h(1, 1, 1)] * 2, time)
        moves.CreateBlendShapeWeightsAttr().Set([time / 2], time)
    moves.CreateBlendShapesAttr(["smile"])
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets(
        [moves.GetPath()]
    )
    skin = mesh("/rig/skin")
    binding = UsdSkel.BindingAPI.Apply(skin.GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    binding.CreateJointIndicesPrimvar(False, 2).Set([0, 1] * 4)
    binding.CreateJointWeightsPrimvar(False, 2).Set([0.5, 0.5] * 4)
    smile = UsdSkel.BlendShape.Define(stage, "/rig/skin/smile")
    smile.CreateOffsetsAttr(Vt.Vec3fArray([Gf.Vec3f(0, 0, 1)]))
    smile.CreatePointIndicesAttr([1])
    binding.CreateBlendShapesAttr(["smile"])
    binding.CreateBlendShapeTargetsRel().SetTargets([smile.GetPath()])
