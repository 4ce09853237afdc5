"""Small glTF files for tests, written byte by byte."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

COMPONENTS = {"b": 5120, "B": 5121, "h": 5122, "H": 5123, "I": 5125, "f": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Gltf:
    """A document that grows; every array gets a buffer view and an accessor of its own."""

    def __init__(self) -> None:
        self.blob = b""
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [],
            "meshes": [],
            "accessors": [],
            "bufferViews": [],
        }

    def view(self, data: bytes, **more: Any) -> int:
        self.blob += b"\0" * (-len(self.blob) % 4)
        views = self.json["bufferViews"]
        views.append({"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(data), **more})
        self.blob += data
        return len(views) - 1

    def accessor(self, values: Any, code: str = "f", **more: Any) -> int:
        array = np.asarray(values, dtype=np.dtype(code).newbyteorder("<"))
        return self.raw_accessor(array.tobytes(), array.shape, code, **more)

    def raw_accessor(
        self, data: bytes, shape: tuple[int, ...], code: str, stride: int | None = None, **more: Any
    ) -> int:
        view = self.view(data, **({} if stride is None else {"byteStride": stride}))
        width = shape[1] if len(shape) > 1 else 1
        entry = {"bufferView": view, "componentType": COMPONENTS[code], "count": shape[0]}
        self.json["accessors"].append(entry | {"type": TYPES[width], **more})
        return len(self.json["accessors"]) - 1

    def node(self, **fields: Any) -> int:
        self.json["nodes"].append(fields)
        return len(self.json["nodes"]) - 1

    def mesh(self, primitive: dict[str, Any]) -> int:
        self.json["meshes"].append({"primitives": [primitive]})
        return len(self.json["meshes"]) - 1

    def triangle(self, **primitive: Any) -> int:
        """A mesh of one triangle in x and y; returns its index."""
        position = self.accessor([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
        attributes = {"POSITION": position} | primitive.pop("attributes", {})
        return self.mesh({"attributes": attributes, **primitive})

    def skin(self, joints: list[int], inverse_bind: Any = None) -> int:
        """A skin; inverse bind matrices ``(J, 4, 4)`` have the usual rows and columns."""
        skin: dict[str, Any] = {"joints": joints}
        if inverse_bind is not None:
            columns = np.asarray(inverse_bind, float).transpose(0, 2, 1).reshape(-1, 16)
            skin["inverseBindMatrices"] = self.accessor(columns)
        self.json.setdefault("skins", []).append(skin)
        return len(self.json["skins"]) - 1

    def animate(
        self, node: int, path: str, times: Any, values: Any, interpolation: str = "LINEAR"
    ) -> None:
        clips = self.json.setdefault("animations", [])
        if not clips:
            clips.append({"name": "first", "channels": [], "samplers": []})
        sampler = {
            "input": self.accessor(times, min=[float(min(times))], max=[float(max(times))]),
            "output": self.accessor(values),
            "interpolation": interpolation,
        }
        clip = clips[-1]
        clip["samplers"].append(sampler)
        target = {"node": node, "path": path}
        clip["channels"].append({"sampler": len(clip["samplers"]) - 1, "target": target})

    def write(self, path: Path) -> Path:
        """GLB, or JSON with a data URI, by the ending."""
        if path.suffix == ".gltf":
            uri = "data:application/octet-stream;base64," + base64.b64encode(self.blob).decode()
            buffers = [{"byteLength": len(self.blob), "uri": uri}]
            path.write_text(json.dumps(self.json | {"buffers": buffers}), encoding="utf-8")
            return path
        text = json.dumps(self.json | {"buffers": [{"byteLength": len(self.blob)}]}).encode()
        text += b" " * (-len(text) % 4)
        blob = self.blob + b"\0" * (-len(self.blob) % 4)
        body = struct.pack("<I4s", len(text), b"JSON") + text
        body += struct.pack("<I4s", len(blob), b"BIN\0") + blob
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
        return path
