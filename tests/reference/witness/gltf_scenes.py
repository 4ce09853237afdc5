"""glTF files at random: nodes, keys of all kinds, skins, morphs, materials, and types of arrays.

No key but those of steps lies within the shutter, as in `scenes`, and lights rest.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from support.gltf_files import Gltf

FPS = 24.0
LIMITS = {"b": 127, "B": 255, "h": 32767, "H": 65535}


def write(path: Path, seed: int, lit: bool, blend: bool) -> float:
    """Write a file; returns the frame at which things move in view."""
    builder = _Builder(seed, lit, blend)
    builder.scene()
    builder.file.write(path)
    return builder.frame


class _Builder:
    def __init__(self, seed: int, lit: bool, blend: bool) -> None:
        self.rng = np.random.default_rng([seed, 2 * lit + blend])
        self.lit, self.blend, self.file = lit, blend, Gltf()
        self.frame = float(self.rng.integers(2, 9))

    def scene(self) -> None:
        roots = [self.camera(), *(self.lights() if self.lit else [])]
        for number in range(self.rng.integers(3, 7)):
            corners = 3 * int(self.rng.integers(1, 4))
            ways = (self.rigid, self.morph, self.skin)
            roots += ways[number % 3](corners)
        self.file.json["scenes"] = [{"nodes": roots}]
        for name in ("KHR_materials_unlit", "KHR_mesh_quantization", "KHR_texture_transform"):
            self.file.json.setdefault("extensionsUsed", []).append(name)
        self.file.json["extensionsRequired"] = ["KHR_mesh_quantization"]

    # Numbers

    def between(self, low: Any, high: Any, *size: int) -> np.ndarray:
        return self.rng.uniform(low, high, size or np.shape(low))

    def pick(self, *values: Any) -> Any:
        return values[self.rng.integers(len(values))]

    def attribute(self, values: np.ndarray, *codes: str) -> int:
        """An accessor of floats or of normalized integers, with gaps between rows at times."""
        code = self.pick(*codes)
        if code == "f":
            array = np.asarray(values, "<f4")
        else:
            array = np.round(values * LIMITS[code]).astype(f"<{np.dtype(code).str[1:]}")
        size = array.shape[1] * array.itemsize
        stride = -(-size // 4) * 4 + 4 * int(self.rng.integers(0, 3))
        rows = [row.tobytes() + b"\7" * (stride - size) for row in array]
        more = {} if code == "f" else {"normalized": True}
        return self.file.raw_accessor(b"".join(rows), array.shape, code, stride, **more)

    def keys(self, node: int, path: str, make: Any, step: bool = True) -> None:
        """Animate by values that ``make`` draws: linear, stepped or cubic."""
        rule = self.pick("LINEAR", "CUBICSPLINE", *(("STEP",) if step else ()))
        around = np.array(self.pick([-1.0, 1.0], [-1.5, -0.5, 1.25], [-3.0, 0.5, 2.0]))
        if rule == "STEP":
            around = np.array([-2.0, float(self.between(-0.2, 0.2)), 3.0])
        values = np.stack([make() for _ in around])
        if path == "rotation":
            values = values / np.linalg.norm(values, axis=1, keepdims=True)
        if rule == "CUBICSPLINE":
            slopes = self.between(-6.0, 6.0, 2, *values.shape)
            values = np.stack([slopes[0], values, slopes[1]], axis=1).reshape(-1, values.shape[1])
        self.file.animate(node, path, (self.frame + around) / FPS, values, rule)

    # Nodes

    def moved(self, centre: np.ndarray, **fields: Any) -> int:
        """A node about ``centre`` that is keyed, and turns or grows at times."""
        node = self.file.node(translation=list(centre), scale=[1.8, 1.6, 1.5], **fields)
        self.keys(node, "translation", lambda: centre + self.between(-0.6, 0.6, 3))
        if self.pick(True, False):
            self.keys(node, "rotation", lambda: self.between(-0.5, 0.5, 4) + [0, 0, 0, 0.8])
        if self.pick(True, False):
            self.keys(node, "scale", lambda: self.between(1.3, 2.2, 3))
        return node

    def above(self, child: int) -> int:
        """A parent at rest, by its parts or by a matrix, which mirrors at times."""
        side = self.pick(1.0, 1.0, -1.0)
        if self.pick(True, False):
            return self.file.node(children=[child], scale=[side, 1.1, 0.9],
                                  rotation=[0.0, 0.0, 0.1, float(np.sqrt(0.99))])  # fmt: skip
        matrix = np.diag([side, 1.0, 1.0, 1.0])
        matrix[0, 1], matrix[:3, 3] = 0.2, [0.1, -0.1, 0.0]
        return self.file.node(children=[child], matrix=matrix.T.ravel().tolist())

    def centre(self) -> np.ndarray:
        return self.between([-1.0, -0.7, -1.5], [1.0, 0.7, 0.8])

    def rigid(self, corners: int) -> list[int]:
        node = self.moved(self.centre(), mesh=self.mesh(corners))
        return [self.above(node)]

    def morph(self, corners: int) -> list[int]:
        centre = self.centre()
        mesh = self.mesh(corners, targets=2)
        node = self.file.node(translation=list(centre), mesh=mesh, scale=[1.7, 1.7, 1.7])
        self.keys(node, "weights", lambda: self.between(-1.0, 1.0, 2))
        values = self.file.json["accessors"][
            self.file.json["animations"][-1]["samplers"][-1]["output"]
        ]
        values["count"], values["type"] = values["count"] * 2, "SCALAR"
        return [self.above(node)]

    def skin(self, corners: int) -> list[int]:
        first = self.file.node(translation=list(self.between(-0.2, 0.2, 3)))
        self.keys(first, "rotation", lambda: self.between(-0.5, 0.5, 4) + [0, 0, 0, 0.8])
        second = self.moved(self.centre(), children=[first])
        inverse = np.tile(np.eye(4), (2, 1, 1))
        inverse[:, :3, 3] = self.between(-0.3, 0.3, 2, 3)
        skin = self.file.skin([first, second], self.pick(inverse, None))
        mesh = self.mesh(corners, joints=True)
        # Where the node of a skin is counts for nothing.
        return [second, self.file.node(mesh=mesh, skin=skin, translation=[9.0, 9.0, 9.0])]

    def camera(self) -> int:
        self.file.json["cameras"] = [
            {"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.01, "aspectRatio": 1.0}}
        ]
        node = self.file.node(camera=0, translation=[0.0, 0.2, 4.0])
        self.keys(node, "translation", lambda: self.between(-0.3, 0.3, 3) + [0, 0.2, 4.0])
        self.keys(
            node, "rotation", lambda: self.between(-0.1, 0.1, 4) * [1, 1, 1, 0] + [0, 0, 0, 1]
        )
        return node

    def lights(self) -> list[int]:
        kinds: list[dict[str, Any]] = [
            {"type": "directional", "intensity": 2.0, "color": [1.0, 0.9, 0.8]},
            self.pick({"type": "point", "intensity": 20.0},
                      {"type": "spot", "intensity": 30.0, "spot": {"innerConeAngle": 0.1}}),
        ]  # fmt: skip
        self.file.json["extensions"] = {"KHR_lights_punctual": {"lights": kinds}}
        self.file.json["extensionsUsed"] = ["KHR_lights_punctual"]
        asked = [{"KHR_lights_punctual": {"light": index}} for index in range(2)]
        turn = self.between(-0.3, 0.3, 4) + [0, 0, 0, 1.0]
        turn = (turn / np.linalg.norm(turn)).tolist()
        sun = self.file.node(extensions=asked[0], rotation=turn)
        lamp = self.file.node(extensions=asked[1], translation=[0.2, 0.3, 1.5])
        above = self.file.node(children=[lamp], translation=list(self.between(-0.5, 0.5, 3)))
        return [sun, above]

    # Meshes

    def mesh(self, corners: int, targets: int = 0, joints: bool = False) -> int:
        points = self.between(-0.8, 0.8, corners, 3)
        codes = ("f",) if targets else ("f", "h", "b")
        attributes = {"POSITION": self.attribute(points, *codes)}
        if targets or joints or self.pick(True, False):
            normals = points * 0.5 + [0, 0, 1.0]
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
            attributes["NORMAL"] = self.attribute(normals, "f", *(() if targets else ("b", "h")))
        material, mode, order = self.material(attributes, points), 4, np.arange(corners)
        if corners > 3:
            mode = self.pick(4, 5, 6)
            order = self.rng.permutation(corners)
        if joints:
            share = self.between(0.1, 1.0, corners, 4) * [1, 1, 0, 0]
            share /= share.sum(axis=1, keepdims=True)
            attributes["WEIGHTS_0"] = self.attribute(share, "f", "B", "H")
            places = np.tile([0, 1, 0, 0], (corners, 1))
            attributes["JOINTS_0"] = self.file.accessor(places, self.pick("B", "H"))
        part = {"attributes": attributes, "material": material, "mode": mode}
        if corners > 3 or self.pick(True, False):
            part["indices"] = self.file.accessor(order, self.pick("B", "H", "I"))
        if targets:
            part["targets"] = [self.target(corners) for _ in range(targets)]
        return self.file.mesh(part)

    def target(self, corners: int) -> dict[str, int]:
        """Differences, of which some are given one by one at times."""
        moved = self.file.accessor(self.between(-0.4, 0.4, corners, 3))
        if self.pick(True, False):
            rows = np.array([0, corners - 1])
            where = self.file.view(rows.astype("<u2").tobytes())
            what = self.file.view(self.between(-0.5, 0.5, 2, 3).astype("<f4").tobytes())
            self.file.json["accessors"][moved]["sparse"] = {
                "count": 2, "indices": {"bufferView": where, "componentType": 5123},
                "values": {"bufferView": what},
            }  # fmt: skip
        return {
            "POSITION": moved,
            "NORMAL": self.file.accessor(self.between(-0.2, 0.2, corners, 3)),
        }

    def material(self, attributes: dict[str, int], points: np.ndarray) -> int:
        """One with a texture and colours of vertices, which take ``attributes``."""
        given: dict[str, Any] = {"doubleSided": bool(self.pick(True, True, False))}
        alpha = float(self.between(0.3, 0.9)) if self.blend else 1.0
        pbr: dict[str, Any] = {
            "baseColorFactor": [*self.between(0.3, 1.0, 3).tolist(), alpha],
            "metallicFactor": float(self.pick(0.0, 0.5, 1.0)),
            "roughnessFactor": float(self.between(0.4, 0.9)),
        }
        if self.blend:
            given["alphaMode"] = "BLEND"
        if not self.lit:
            given["extensions"] = {"KHR_materials_unlit": {}}
        else:
            given["emissiveFactor"] = self.between(0.0, 0.2, 3).tolist()
        uv = np.clip(points[:, :2] * 0.45 + 0.5, 0.0, 1.0)
        attributes["TEXCOORD_1"] = self.attribute(uv, "f", "H", "B")
        pbr["baseColorTexture"] = {"index": self.texture(), "texCoord": 1}
        if self.pick(True, False):
            moved = {
                "offset": [0.1, -0.2],
                "rotation": float(self.between(-1, 1)),
                "scale": [0.7, 0.8],
            }
            pbr["baseColorTexture"]["extensions"] = {"KHR_texture_transform": moved}
        colors = self.between(0.2, 1.0, len(points), 4 if self.blend else 3)
        attributes["COLOR_0"] = self.attribute(colors, "f", "B", "H")
        self.file.json.setdefault("materials", []).append(given | {"pbrMetallicRoughness": pbr})
        return len(self.file.json["materials"]) - 1

    def texture(self) -> int:
        from PIL import Image

        pixels = self.rng.integers(100, 255, (int(self.pick(3, 4)), 4, 3)).astype(np.uint8)
        data = io.BytesIO()
        Image.fromarray(pixels).save(data, "PNG")
        view, document = self.file.view(data.getvalue()), self.file.json
        wrap = int(self.pick(33071, 33648, 10497))
        for name, item in (("images", {"bufferView": view, "mimeType": "image/png"}),
                           ("samplers", {"wrapS": wrap, "wrapT": wrap})):  # fmt: skip
            document.setdefault(name, []).append(item)
        number = len(document["images"]) - 1
        document.setdefault("textures", []).append({"source": number, "sampler": number})
        return number
