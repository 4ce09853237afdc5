"""Reader of glTF 2.0 and GLB: nodes, one animation clip, skins, morphs, materials, camera, lights.

Texture coordinates are flipped to point up (`Texture`); colour factors and vertex colours are
linear in the file, texture images are sRGB.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene.asset import Asset, reading, several_cameras
from mbinterval.scene.deform import MorphedSkin
from mbinterval.scene.formats.gltf.data import GltfData, item_at
from mbinterval.scene.formats.gltf.deform import read_morph, read_skin
from mbinterval.scene.formats.gltf.material import MaterialReader, MaterialUse
from mbinterval.scene.formats.gltf.nodes import read_clip, walk_nodes
from mbinterval.scene.model import Camera, Light, Mesh, Viewpoint
from mbinterval.scene.transforms import Transform

_SUPPORTED = {
    "KHR_lights_punctual",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
}


def read_gltf(
    path: Path, fps: float, clip: str | int | None = None, root: Transform | None = None
) -> Asset:
    """Read the default scene of a glTF or GLB file.

    Parameters
    ----------
    path
        The file.
    fps
        Frames per second: a key at s seconds is at frame s * fps.
    clip
        Name or index of the animation clip; None takes the first.
    root
        Places the whole file in the world.

    Raises
    ------
    SceneError
        For a broken file, a required extension that is not supported, an unknown clip.
    """
    with reading(path, "glTF"):
        data = GltfData(path)
        missing = sorted(set(data.document.extensionsRequired or ()) - _SUPPORTED)
        if missing:
            raise SceneError(f"needs {', '.join(missing)}, not supported; export it without")
        return _SceneReader(data, fps, clip, root).asset()


class _SceneReader:
    def __init__(
        self, data: GltfData, fps: float, clip: str | int | None, root: Transform | None
    ) -> None:
        self.data = data
        self.notes: list[str] = []
        self.materials = MaterialReader(data, self.notes)
        self.primitives: dict[tuple[int, int], dict[str, Any] | None] = {}
        self.clip = read_clip(data, fps, clip, self.notes)
        self.nodes = walk_nodes(data, self.clip, root)

    def asset(self) -> Asset:
        meshes: list[Mesh] = []
        cameras: list[Camera] = []
        lights: list[Light] = []
        for index, (node, transform) in self.nodes.items():
            if node.mesh is not None:
                meshes += self._meshes(index, node, transform)
            if node.camera is not None:
                cameras += self._camera(node, transform)
            light = ((node.extensions or {}).get("KHR_lights_punctual") or {}).get("light")
            if light is not None:
                lights += self._light(light, transform)
        if len(cameras) > 1:
            self._note(several_cameras([camera.name for camera in cameras]))
        return Asset(
            tuple(meshes),
            tuple(map(Viewpoint, cameras)),
            tuple(lights),
            tuple(self.notes),
            self.clip.span,
        )

    def _note(self, text: str) -> None:
        note = f"{self.data.path.name}: {text}"
        if note not in self.notes:
            self.notes.append(note)

    def _meshes(self, index: int, node: Any, transform: Transform) -> list[Mesh]:
        source = item_at(self.data.document.meshes, node.mesh, "mesh")
        name = node.name or source.name or f"mesh {node.mesh}"
        result = []
        for number, primitive in enumerate(source.primitives):
            key = (node.mesh, number)
            if key not in self.primitives:
                self.primitives[key] = self._primitive(primitive)
            arrays = self.primitives[key]
            if arrays is None:
                continue
            part = name if len(source.primitives) == 1 else f"{name}.{number}"
            mesh = Mesh(**arrays, name=part, transform=transform)
            result.append(self._deformed(mesh, primitive, source, index, node))
        return result

    def _deformed(self, mesh: Mesh, primitive: Any, source: Any, index: int, node: Any) -> Mesh:
        """``mesh`` with its morph targets and its skin; the joints place a skin, not its node."""
        morph = skin = None
        if primitive.targets:
            weights = self.data.node_weights.get(index) or source.weights
            track = self.clip.tracks.get((index, "weights"))
            morph = read_morph(self.data, primitive.targets, mesh, track or weights)
            if {name[:5] for target in primitive.targets for name in target} & {"TEXCO", "COLOR"}:
                self._note(f"mesh {mesh.name!r}: texture coordinates and colours are not morphed")
        if node.skin is not None and primitive.attributes.JOINTS_0 is not None:
            skin = read_skin(self.data, primitive, node.skin, self.nodes, len(mesh.positions))
        if morph is None and skin is None:
            return mesh
        deformer = MorphedSkin(mesh.positions, mesh.normals, morph, skin)
        return replace(mesh, deformer=deformer, transform=mesh.transform if skin is None else None)

    def _primitive(self, primitive: Any) -> dict[str, Any] | None:
        """Everything of a mesh but its name and its place; None without triangles."""
        if (primitive.extensions or {}).keys() & {"KHR_draco_mesh_compression"}:
            raise SceneError("is Draco-compressed; export it without KHR_draco_mesh_compression")
        mode = 4 if primitive.mode is None else primitive.mode
        if mode not in (4, 5, 6):
            self._note("points and lines are left out")
            return None
        if primitive.attributes.POSITION is None:
            return None
        positions = self.data.accessor(primitive.attributes.POSITION)
        corners = np.arange(len(positions))
        if primitive.indices is not None:
            corners = self.data.accessor(primitive.indices).astype(np.int64)
        use = self.materials.use(primitive.material)
        color = self._attribute(primitive, "COLOR_0")
        if color is not None and color.shape[1] == 4:
            color = np.concatenate([color[:, :3], np.clip(color[:, 3:], 0.0, 1.0)], axis=1)
        return {
            "positions": positions,
            "faces": _triangles(corners, mode),
            "normals": self._attribute(primitive, "NORMAL"),
            "uv": self._uv(primitive, use),
            "color": color,
            "color_domain": "vertex",
            "material": use.material,
        }

    def _attribute(self, primitive: Any, name: str) -> NDArray[Any] | None:
        index = getattr(primitive.attributes, name, None)
        return None if index is None else self.data.accessor(index)

    def _uv(self, primitive: Any, use: MaterialUse) -> NDArray[Any] | None:
        """Coordinates of the set that the base colour texture uses, pointing up."""
        uv = self._attribute(primitive, f"TEXCOORD_{use.uv_set}")
        if uv is None:
            return None
        moved = uv @ use.uv_linear.T + use.uv_offset
        return np.stack([moved[:, 0], 1.0 - moved[:, 1]], axis=1)

    def _camera(self, node: Any, transform: Transform) -> list[Camera]:
        source = item_at(self.data.document.cameras, node.camera, "camera")
        name = node.name or source.name or f"camera {node.camera}"
        if source.perspective is None or source.type == "orthographic":
            self._note(f"camera {name!r} is orthographic and left out")
            return []
        fov = float(np.degrees(source.perspective.yfov))
        return [Camera(transform=transform, fov=fov, name=name)]

    def _light(self, index: int, transform: Transform) -> list[Light]:
        """Read a light of KHR_lights_punctual, in lux or candela; its cone is in radians.

        A white Lambert surface under E lux has radiance E / pi; our Phong model has no pi.
        """
        extension = (self.data.document.extensions or {}).get("KHR_lights_punctual") or {}
        source = item_at(extension.get("lights"), index, "light")
        kind = source["type"]
        if kind not in ("directional", "point", "spot"):
            self._note(f"{kind} lights are left out")
            return []
        cone = source.get("spot") or {}
        return [
            Light(
                kind=kind,
                color=source.get("color", (1.0, 1.0, 1.0)),
                intensity=source.get("intensity", 1.0) / np.pi,
                transform=transform,
                inner_angle=float(np.degrees(cone.get("innerConeAngle", 0.0))),
                outer_angle=float(np.degrees(cone.get("outerConeAngle", np.pi / 4))),
            )
        ]


def _triangles(corners: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """``(F, 3)`` faces of a triangle list (4), strip (5) or fan (6)."""
    if mode == 4:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    count = max(len(corners) - 2, 0)
    first = np.arange(count)
    if mode == 6:
        places = np.stack([first + 1, first + 2, np.zeros_like(first)], axis=1)
    else:
        odd = first % 2
        places = np.stack([first, first + 1 + odd, first + 2 - odd], axis=1)
    return corners[places]
