"""Materials and textures of a glTF file."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.files.images import decode_image, undecoded
from mbinterval.scene.field_values import number
from mbinterval.scene.formats.gltf.data import GltfData, item_at
from mbinterval.scene.model import Material, Texture

_WRAP = {33071: "clamp", 33648: "mirror", 10497: "repeat"}

# A primitive without material has the default one of glTF 2.0 (3.9): white, single-sided, and a
# metal.
_DEFAULT = Material(double_sided=False, shading="metallic_roughness", metallic=1.0, roughness=1.0)


@dataclass(frozen=True, eq=False)
class MaterialUse:
    """A material, and the uv set that its textures read: uv -> linear @ uv + offset."""

    material: Material = _DEFAULT
    uv_set: int = 0
    uv_linear: NDArray[np.float64] = field(default_factory=lambda: np.eye(2))
    uv_offset: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))


class MaterialReader:
    """Reads each material and each texture of a file once, when it is first used."""

    def __init__(self, data: GltfData, notes: list[str]) -> None:
        self._data = data
        self._notes = notes
        self._uses: dict[int, MaterialUse] = {}
        self._textures: dict[tuple[int, str, bool], Texture | None] = {}

    def use(self, index: int | None) -> MaterialUse:
        """Material ``index`` of the file; None is the default material."""
        if index is None:
            return MaterialUse()
        if index not in self._uses:
            self._uses[index] = self._read(
                item_at(self._data.document.materials, index, "material")
            )
        return self._uses[index]

    def _read(self, source: Any) -> MaterialUse:
        pbr = source.pbrMetallicRoughness
        unlit = "KHR_materials_unlit" in (source.extensions or {})
        references = {
            "texture": None if pbr is None else pbr.baseColorTexture,
            "metallic_roughness_texture": None if pbr is None else pbr.metallicRoughnessTexture,
            "emission_texture": source.emissiveTexture,
        }
        given = None if pbr is None else pbr.baseColorFactor
        factor = tuple(given or (1.0, 1.0, 1.0, 1.0))
        name = source.name or ""
        textures: dict[str, Any] = {
            key: self._texture(reference.index, key == "metallic_roughness_texture")
            for key, reference in references.items()
            if reference is not None
        }
        plain = Material(
            name=name,
            base_color=factor[:3],
            shading="unlit" if unlit else "metallic_roughness",
            metallic=_factor(pbr, "metallicFactor", name),
            roughness=_factor(pbr, "roughnessFactor", name),
            emission=tuple(source.emissiveFactor or (0.0, 0.0, 0.0)),
            double_sided=bool(source.doubleSided),
            **_alpha(source, factor[3]),
        )
        material = replace(plain, **textures)
        uses = [_placed(material, given) for given in references.values() if given is not None]
        if any(not _alike(uses[0], use) for use in uses):
            self._note(f"material {name!r}: its textures are all looked up as the first of them is")
        return uses[0] if uses else MaterialUse(material)

    def _texture(self, index: int, raw: bool = False) -> Texture | None:
        document = self._data.document
        source = item_at(document.textures, index, "texture")
        if source.source is None:
            self._note(f"texture {index} has no image that can be read; left out")
            return None
        wrap = wrap_v = "repeat"
        if source.sampler is not None:
            sampler = item_at(document.samplers, source.sampler, "sampler")
            wrap = _WRAP.get(sampler.wrapS, "repeat")
            wrap_v = _WRAP.get(sampler.wrapT, "repeat")
        if wrap != wrap_v:
            self._note(f"texture {index} wraps by {wrap} in u and {wrap_v} in v; {wrap} is used")
        key = (source.source, wrap, raw)
        if key not in self._textures:
            self._textures[key] = self._image(*key)
        return self._textures[key]

    def _image(self, index: int, wrap: str, raw: bool) -> Texture | None:
        try:
            encoded, name = self._data.image(index)
        except FileNotFoundError as error:
            self._note(f"texture not found: tried {error.filename}; left out")
            return None
        image = decode_image(encoded, name)
        return Texture(undecoded(image) if raw else image, name=name, wrap=wrap)

    def _note(self, text: str) -> None:
        self._notes.append(f"{self._data.path.name}: {text}")


def _factor(pbr: Any, name: str, material: str) -> float:
    """Factor of a material, cut to 0 to 1; 1 where it is not given."""
    value = None if pbr is None else getattr(pbr, name)
    given = 1.0 if value is None else number(value, f"material {material!r}: {name}")
    return min(max(given, 0.0), 1.0)


def _alike(one: MaterialUse, other: MaterialUse) -> bool:
    """Whether both look textures up by the same coordinates."""
    return (
        one.uv_set == other.uv_set
        and np.array_equal(one.uv_linear, other.uv_linear)
        and np.array_equal(one.uv_offset, other.uv_offset)
    )


def _alpha(source: Any, factor: float) -> dict[str, Any]:
    """Alpha of a material; what is OPAQUE keeps nothing of it, so that a scene file can."""
    mode = (source.alphaMode or "OPAQUE").lower()
    if mode == "opaque":
        return {}
    cutoff = 0.5 if source.alphaCutoff is None else source.alphaCutoff
    return {"opacity": factor, "alpha_mode": mode, "alpha_cutoff": cutoff}


def _placed(material: Material, reference: Any) -> MaterialUse:
    """Apply KHR_texture_transform: scale, then rotation, then offset."""
    moved = (reference.extensions or {}).get("KHR_texture_transform") or {}
    angle = float(moved.get("rotation", 0.0))
    c, s = np.cos(angle), np.sin(angle)
    return MaterialUse(
        material,
        uv_set=moved.get("texCoord", reference.texCoord or 0),
        uv_linear=np.array([[c, s], [-s, c]]) * np.asarray(moved.get("scale", (1.0, 1.0))),
        uv_offset=np.asarray(moved.get("offset", (0.0, 0.0)), dtype=np.float64),
    )
