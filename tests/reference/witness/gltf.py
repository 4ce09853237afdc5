"""glTF 2.0 as the witness reads it: JSON, buffers, and what can be looked at, by the specification.

A file becomes records that have the names of a scene's fields, so that all else of the witness
takes them. Sections of the specification are in brackets. Lights are in lux and candela, of which a
white Lambert surface gives back the part 1 / pi; keys at s seconds are at frame s times fps.
"""

from __future__ import annotations

import base64
import io
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

KINDS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": (1,), "VEC2": (2,), "VEC3": (3,), "VEC4": (4,), "MAT4": (4, 4)}
WRAPS = {33071: "clamp", 33648: "mirror", 10497: "repeat"}
RULES = {"LINEAR": "linear", "STEP": "step", "CUBICSPLINE": "cubic"}
OPEN, CLOSE, FPS = -0.25, 0.25, 24.0


class File:
    """The JSON of a file and its binary data [3.6, 4]."""

    def __init__(self, path: Path) -> None:
        data, self.folder = path.read_bytes(), path.parent
        chunk = b""
        if data[:4] == b"glTF":
            length = int.from_bytes(data[12:16], "little")
            chunk, data = data[28 + length :], data[20 : 20 + length]
        self.json = json.loads(data)
        self.buffers = [self._fetched(b["uri"]) if "uri" in b else chunk
                        for b in self.json.get("buffers", [])]  # fmt: skip

    def _fetched(self, uri: str) -> bytes:
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2])
        return (self.folder / uri).read_bytes()

    def of(self, kind: str) -> list[Any]:
        return self.json.get(kind, [])

    def view(self, index: int) -> tuple[bytes, int]:
        """Bytes of a buffer view, and its stride or 0."""
        view = self.of("bufferViews")[index]
        first = view.get("byteOffset", 0)
        part = self.buffers[view["buffer"]][first : first + view["byteLength"]]
        return part, view.get("byteStride", 0)

    def accessor(self, index: int) -> np.ndarray:
        """Its elements as float64, ``(n,)``, ``(n, width)`` or ``(n, 4, 4)`` with usual rows."""
        given = self.of("accessors")[index]
        kind, shape = np.dtype(KINDS[given["componentType"]]), WIDTHS[given["type"]]
        count = given["count"]
        found = np.zeros((count, int(np.prod(shape))), kind)
        if "bufferView" in given:
            data, stride = self.view(given["bufferView"])
            size = found.shape[1] * kind.itemsize
            for row in range(count):
                at = given.get("byteOffset", 0) + row * (stride or size)
                found[row] = np.frombuffer(data[at : at + size], kind)
        if "sparse" in given:  # [3.6.2.3]
            sparse = given["sparse"]
            where, what = sparse["indices"], sparse["values"]
            rows = np.frombuffer(self.view(where["bufferView"])[0], KINDS[where["componentType"]],
                                 sparse["count"], where.get("byteOffset", 0))  # fmt: skip
            size = len(rows) * found.shape[1]
            new = np.frombuffer(self.view(what["bufferView"])[0], kind, size,
                                what.get("byteOffset", 0))  # fmt: skip
            found[rows] = new.reshape(len(rows), -1)
        values = found.astype(np.float64)
        if given.get("normalized"):  # [3.11]
            values = np.maximum(values / np.iinfo(kind).max, -1.0)
        if shape == (4, 4):
            return values.reshape(-1, 4, 4).swapaxes(1, 2)
        return values[:, 0] if shape == (1,) else values

    def image(self, index: int, srgb: bool) -> np.ndarray:
        """Linear pixels ``(h, w, 4)`` with straight alpha [3.9.2]."""
        from PIL import Image

        given = self.of("images")[index]
        data = self._fetched(given["uri"]) if "uri" in given else self.view(given["bufferView"])[0]
        pixels = np.asarray(Image.open(io.BytesIO(data)).convert("RGBA"), np.float64) / 255.0
        if srgb:
            low, high = pixels[..., :3] / 12.92, ((pixels[..., :3] + 0.055) / 1.055) ** 2.4
            pixels[..., :3] = np.where(pixels[..., :3] <= 0.04045, low, high)
        return pixels


def read(path: Path, fps: float = FPS, clip: int = 0) -> SimpleNamespace:
    """The scene of a file, by one animation and its first camera."""
    return _Reader(File(path), fps, clip).scene()


class _Reader:
    def __init__(self, file: File, fps: float, clip: int) -> None:
        self.file, self.fps = file, fps
        self.tracks: dict[tuple[int, str], SimpleNamespace] = {}
        for moves in file.of("animations")[clip : clip + 1]:
            for channel in moves["channels"]:
                sampler = moves["samplers"][channel["sampler"]]
                target = channel["target"]
                self.tracks[target["node"], target["path"]] = self.track(sampler, target["path"])
        self.nodes: dict[int, SimpleNamespace] = {}
        for root in file.of("scenes")[file.json.get("scene", 0)]["nodes"]:
            self.place(root, None)

    def track(self, sampler: Any, path: str) -> SimpleNamespace:
        """Keys [3.11]; those of a cubic are tangent, value, tangent, and tangents per second."""
        rule = RULES[sampler.get("interpolation", "LINEAR")]
        frames = self.file.accessor(sampler["input"]) * self.fps
        values = self.file.accessor(sampler["output"])
        values = values.reshape(len(frames), 3 if rule == "cubic" else 1, -1)
        if rule == "cubic":
            values = values / np.array([self.fps, 1.0, self.fps])[:, None]
        else:
            values = values[:, 0]
        return SimpleNamespace(
            frames=frames, values=values, interpolation=rule, quaternion=path == "rotation"
        )

    def place(self, index: int, parent: Any) -> None:
        """A node's place [3.5.2], and those of its children."""
        node = self.file.of("nodes")[index]
        usual = {"translation": (0.0, 0, 0), "rotation": (0.0, 0, 0, 1), "scale": (1.0, 1, 1)}
        given = {name: self.tracks.get((index, name), node.get(name, value))
                 for name, value in usual.items()}  # fmt: skip
        matrix = np.reshape(node["matrix"], (4, 4)).T if "matrix" in node else None
        self.nodes[index] = SimpleNamespace(**given, matrix=matrix, parent=parent)
        for child in node.get("children", []):
            self.place(child, self.nodes[index])

    def scene(self) -> SimpleNamespace:
        nodes = self.file.of("nodes")
        found: dict[str, list[Any]] = {"meshes": [], "cameras": [], "lights": []}
        for index, place in self.nodes.items():
            node = nodes[index]
            if "mesh" in node:
                parts = self.file.of("meshes")[node["mesh"]]["primitives"]
                found["meshes"] += [self.mesh(index, node, part) for part in parts]
            if "camera" in node:
                found["cameras"].append(self.camera(node["camera"], place))
            light = node.get("extensions", {}).get("KHR_lights_punctual", {}).get("light")
            if light is not None:
                found["lights"].append(self.light(light, place))
        shutter = SimpleNamespace(open=OPEN, close=CLOSE, curve="box", rolling=None)
        return SimpleNamespace(
            meshes=found["meshes"], camera=(found["cameras"] or [None])[0], lights=found["lights"],
            background=(0.0, 0.0, 0.0), environment=None, shutter=shutter, fps=self.fps,
        )  # fmt: skip

    def mesh(self, index: int, node: Any, part: Any) -> SimpleNamespace:
        """A primitive [3.7] at its node; a skin is where its joints are [3.7.3.3]."""
        has = {name: self.file.accessor(at) for name, at in part["attributes"].items()}
        points = has["POSITION"]
        corners = np.arange(len(points))
        if "indices" in part:
            corners = self.file.accessor(part["indices"]).astype(int)
        material, texture = self.material(part.get("material"))
        uv = has.get(f"TEXCOORD_{texture.get('texCoord', 0)}")
        place, skin = self.nodes[index], None
        if "skin" in node:
            skin, place = self.skin(node["skin"], has), None
        deformer = None
        if "targets" in part or skin is not None:
            deformer = SimpleNamespace(
                rest=points, rest_normals=has.get("NORMAL"), skin=skin,
                morph=self.morph(index, node, part, points),
            )  # fmt: skip
        return SimpleNamespace(
            positions=points, faces=_triangles(corners, part.get("mode", 4)),
            normals=has.get("NORMAL"), uv=None if uv is None else _placed(uv, texture),
            color=has.get("COLOR_0"), color_domain="vertex", material=material, transform=place,
            deformer=deformer, visible=True, motion_blur=True, shutter_scale=1.0, reflections=None,
        )  # fmt: skip

    def morph(self, index: int, node: Any, part: Any, points: np.ndarray) -> Any:
        """Targets [3.7.2.2]: differences times weights, of the animation, the node or the mesh."""
        targets = part.get("targets", [])
        if not targets:
            return None
        usual = self.file.of("meshes")[node["mesh"]].get("weights", [0.0] * len(targets))
        moved = {
            name: np.stack([self.file.accessor(target[name]) if name in target
                            else np.zeros_like(points) for target in targets])
            for name in ("POSITION", "NORMAL")
        }  # fmt: skip
        weights = self.tracks.get((index, "weights"), node.get("weights", usual))
        return SimpleNamespace(
            positions=moved["POSITION"], normals=moved["NORMAL"], weights=weights
        )

    def skin(self, index: int, has: dict[str, np.ndarray]) -> SimpleNamespace:
        given = self.file.of("skins")[index]
        inverse = np.tile(np.eye(4), (len(given["joints"]), 1, 1))
        if "inverseBindMatrices" in given:
            inverse = self.file.accessor(given["inverseBindMatrices"])
        sets = range(sum(name.startswith("JOINTS_") for name in has))
        nodes = [self.nodes[joint] for joint in given["joints"]]
        return SimpleNamespace(
            joints=SimpleNamespace(nodes=nodes, inverse_bind=inverse),
            indices=np.concatenate([has[f"JOINTS_{k}"] for k in sets], axis=1).astype(int),
            weights=np.concatenate([has[f"WEIGHTS_{k}"] for k in sets], axis=1),
        )

    def material(self, index: int | None) -> tuple[SimpleNamespace, Any]:
        """A material [3.9], and how its base colour's texture is placed."""
        given = {} if index is None else self.file.of("materials")[index]
        pbr = given.get("pbrMetallicRoughness", {})
        base = pbr.get("baseColorFactor", [1.0, 1.0, 1.0, 1.0])
        texture = pbr.get("baseColorTexture", {})
        unlit = "KHR_materials_unlit" in given.get("extensions", {})
        return SimpleNamespace(
            base_color=base[:3], opacity=base[3], texture=self.texture(texture, True),
            shading="unlit" if unlit else "metallic_roughness",
            metallic=pbr.get("metallicFactor", 1.0), roughness=pbr.get("roughnessFactor", 1.0),
            metallic_roughness_texture=self.texture(pbr.get("metallicRoughnessTexture", {}), False),
            emission=given.get("emissiveFactor", (0.0, 0.0, 0.0)),
            emission_texture=self.texture(given.get("emissiveTexture", {}), True),
            double_sided=given.get("doubleSided", False), reflectivity=0.0, reflection_shear=0.0,
            alpha_mode=given.get("alphaMode", "OPAQUE").lower(),
            alpha_cutoff=given.get("alphaCutoff", 0.5),
        ), texture  # fmt: skip

    def texture(self, reference: Any, srgb: bool) -> Any:
        if "index" not in reference:
            return None
        given = self.file.of("textures")[reference["index"]]
        sampler = self.file.of("samplers")[given["sampler"]] if "sampler" in given else {}
        wrap = WRAPS[sampler.get("wrapS", 10497)]
        return SimpleNamespace(image=self.file.image(given["source"], srgb), wrap=wrap)

    def camera(self, index: int, place: SimpleNamespace) -> SimpleNamespace:
        """A perspective camera [3.10.3]; the image has square pixels, whatever its aspect."""
        fov = np.degrees(self.file.of("cameras")[index]["perspective"]["yfov"])
        return SimpleNamespace(
            transform=place, fov=fov, focal_length=None, f_stop=None, focus_distance=None,
            sharp_range=None, foreground_blur=None, meters_per_unit=1.0, blades=0,
        )  # fmt: skip

    def light(self, index: int, place: SimpleNamespace) -> SimpleNamespace:
        """KHR_lights_punctual: along -z of the node, or at it."""
        given = self.file.json["extensions"]["KHR_lights_punctual"]["lights"][index]
        cone = given.get("spot", {})
        return SimpleNamespace(
            kind=given["type"], color=given.get("color", (1.0, 1.0, 1.0)),
            intensity=given.get("intensity", 1.0) / np.pi, transform=place,
            position=(0.0, 0.0, 0.0), direction=(0.0, 0.0, -1.0), shadows=False,
            inner_angle=np.degrees(cone.get("innerConeAngle", 0.0)),
            outer_angle=np.degrees(cone.get("outerConeAngle", np.pi / 4.0)),
        )  # fmt: skip


def _triangles(corners: np.ndarray, mode: int) -> np.ndarray:
    """Lists, strips and fans [3.7.2.1]."""
    if mode == 4:
        return corners.reshape(-1, 3)
    if mode == 6:
        return np.array([[corners[0], *corners[k : k + 2]] for k in range(1, len(corners) - 1)])
    turned = [corners[k : k + 3] if k % 2 == 0 else corners[[k + 1, k, k + 2]]
              for k in range(len(corners) - 2)]  # fmt: skip
    return np.array(turned)


def _placed(uv: np.ndarray, reference: Any) -> np.ndarray:
    """Coordinates by KHR_texture_transform, v up: offset times rotation times scale."""
    moved = reference.get("extensions", {}).get("KHR_texture_transform", {})
    angle = moved.get("rotation", 0.0)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    uv = (uv * moved.get("scale", (1.0, 1.0))) @ turn.T + moved.get("offset", (0.0, 0.0))
    return np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1)
