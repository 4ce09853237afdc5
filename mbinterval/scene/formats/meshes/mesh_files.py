"""Reader of mesh files (OBJ, PLY, STL, OFF, ...) on trimesh.

Polygons are triangulated as fans, vertices stay as the file has them, and normals are those of
the file or none. Colours of vertices and faces are 8-bit sRGB by custom and become linear; the Kd
of an OBJ material is linear already.
"""

from __future__ import annotations

import dataclasses
import io
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.files.contents import read_file
from mbinterval.files.images import linear_pixels, srgb_to_linear
from mbinterval.scene.asset import Asset, reading
from mbinterval.scene.model import Material, Mesh, Texture
from mbinterval.scene.transforms import Transform


def read_mesh_file(path: Path, root: Transform | None = None) -> Asset:
    """Read every triangle mesh of a file, each instance as a mesh of its own.

    ``root`` places the whole file in the world. Raises ``SceneError`` for a kind that trimesh
    doesn't read, a broken file and a file without triangles.
    """
    import trimesh

    kind = path.suffix[1:].lower()
    if kind not in trimesh.available_formats():
        known = ", ".join(sorted(trimesh.available_formats()))
        raise SceneError(f"{path}: meshes of kind {kind!r} can't be read; known: {known}")
    with reading(path, kind.upper()):
        data, resolver = read_file(path), _recording_resolver(path)
        _check_lines(kind, data)
        loaded = trimesh.load_scene(
            io.BytesIO(_utf8(data) if kind in ("obj", "off") else data),
            file_type=kind,
            resolver=resolver,
            process=False,
        )
        notes = _missing_notes(path, resolver.missing)
        materials: dict[int, Material] = {}
        meshes = tuple(
            _mesh(loaded.geometry[geometry], node, matrix, root, materials)
            for node in loaded.graph.nodes_geometry
            for matrix, geometry in [loaded.graph[node]]
            if isinstance(loaded.geometry[geometry], trimesh.Trimesh)
            and len(loaded.geometry[geometry].faces)
        )
    if not meshes:
        raise SceneError(f"{path}: holds no triangles")
    return Asset(meshes, notes=notes)


def _check_lines(kind: str, data: bytes) -> None:
    """Refuse a text file with fewer lines than its header claims vertices and faces.

    trimesh takes as many as there are.
    """
    lines = data.split(b"\n") if kind == "off" else []
    claimed = 0
    if kind == "ply" and b"\nformat ascii" in data[:1000]:
        head, _, body = data.partition(b"end_header")
        lines = body.split(b"\n")[1:]
        claimed = sum(map(int, re.findall(rb"^element\s+\w+\s+(\d+)", head, re.MULTILINE)))
    lines = [line for line in lines if line.split(b"#")[0].strip()]
    if kind == "off" and lines:
        first = lines.pop(0).replace(b"OFF", b"").split() or lines.pop(0).split()
        claimed = sum(map(int, first[:2]))
    if claimed > len(lines):
        raise SceneError(
            f"its header claims {claimed} vertices and faces, but {len(lines)} lines follow; it is "
            "cut off or damaged"
        )


def _recording_resolver(path: Path) -> Any:
    """Make a resolver beside ``path`` that records what was found, and remembers what was not.

    Of what is missing trimesh only logs it. As trimesh does, it looks in the file's folder alone,
    there for the name without its own folder too.
    """
    from trimesh.resolvers import FilePathResolver

    class RecordingResolver(FilePathResolver):
        missing: list[str]

        def get(self, name: str) -> Any:
            folder, plain = path.parent.resolve(), name.strip()
            for candidate in (plain, plain.lstrip("/"), os.path.split(name)[-1]):
                found = (folder / candidate.replace("\0", "")).resolve()
                if found.is_file() and found.is_relative_to(folder):
                    data = read_file(path.parent / found.relative_to(folder))
                    return _utf8(data) if name.lower().endswith(".mtl") else data
            self.missing.append(name)
            raise FileNotFoundError(name)

    resolver = RecordingResolver(str(path))
    resolver.missing = []
    return resolver


def _utf8(text: bytes) -> bytes:
    """Text files of old exporters, in whatever 8-bit code: only names and comments can differ."""
    try:
        text.decode("utf-8")
    except UnicodeDecodeError:
        return text.decode("latin-1").encode("utf-8")
    return text


def _missing_notes(path: Path, missing: list[str]) -> tuple[str, ...]:
    """Notes on material libraries and textures that the file names but that aren't there."""
    return tuple(
        f"{path.name}: not found: tried {path.parent / name}; left out"
        for name in dict.fromkeys(missing)
    )


def _mesh(
    source: Any,
    name: str,
    matrix: NDArray[np.float64],
    root: Transform | None,
    materials: dict[int, Material],
) -> Mesh:
    visual = source.visual
    material = getattr(visual, "material", None)
    if id(material) not in materials:
        materials[id(material)] = _material(material)
    uv = getattr(visual, "uv", None)
    color, domain = _color(source)
    if not np.array_equal(matrix, np.eye(4)):
        root = Transform(matrix=np.array(matrix), parent=root)
    # "in _cache" is how trimesh itself tells normals that were read from those it would invent.
    normals = source.vertex_normals if "vertex_normals" in source._cache.cache else None
    return Mesh(
        positions=source.vertices.view(np.ndarray),
        faces=source.faces.view(np.ndarray),
        normals=normals,
        uv=None if uv is None or len(uv) != len(source.vertices) else uv,
        color=color,
        color_domain=domain,
        material=materials[id(material)],
        name=name,
        transform=root,
    )


def _color(source: Any) -> tuple[NDArray[np.float32] | None, str]:
    """Linear colour of a trimesh mesh, and whether it is per vertex or per face."""
    kind = source.visual.kind
    if kind in ("vertex", "face"):
        return _linear(getattr(source.visual, f"{kind}_colors")), kind
    values = source.vertex_attributes.get("color")  # beside uv, PLY colours are found here
    if values is not None and np.shape(values) in (
        (len(source.vertices), 3),
        (len(source.vertices), 4),
    ):
        return _linear(values), "vertex"
    return None, "auto"


def _linear(values: Any) -> NDArray[np.float32]:
    colors = np.asarray(values)[:, :3]
    scale = np.iinfo(colors.dtype).max if colors.dtype.kind in "iu" else 1
    return srgb_to_linear(colors / scale)


def _material(source: Any) -> Material:
    """Material of an MTL file, or of a format that speaks of base colour."""
    material = Material(name=str(getattr(source, "name", None) or ""))
    base = None
    if source is None:
        return material
    image = getattr(source, "image", None) or getattr(source, "baseColorTexture", None)
    if getattr(source, "baseColorFactor", None) is not None:
        base = np.asarray(source.baseColorFactor)[:3] / 255.0
    known = getattr(source, "kwargs", None) or {}
    if "kd" in known:
        base = np.broadcast_to(np.asarray(known["kd"], dtype=float)[..., :3], 3)
    if base is not None:
        material = dataclasses.replace(material, base_color=tuple(base.tolist()))
    if image is not None and image.format is not None:  # trimesh invents images without a format
        image.load()
        texture = Texture(linear_pixels(image), name=str(image.info.get("file_path", "")))
        material = dataclasses.replace(material, texture=texture)
    return material
