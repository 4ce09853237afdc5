"""UsdPreviewSurface: base colour, opacity, their texture and what it is looked up by, gloss."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.files.images import decode_image, undecoded
from mbinterval.scene.field_values import number
from mbinterval.scene.formats.usd.layers import Layers, without_link
from mbinterval.scene.model import Material, Texture

Note = Callable[[str], None]

_WRAPS = {"repeat": "repeat", "mirror": "mirror", "clamp": "clamp", "black": "clamp"}


@dataclass(frozen=True, eq=False)
class MaterialUse:
    """A material, the primvar of its texture coordinates, uv -> linear @ uv + offset.

    ``color`` names the primvar that gives the base colour, or is empty.
    """

    material: Material
    uv: str = "st"
    uv_linear: NDArray[np.float64] = field(default_factory=lambda: np.eye(2))
    uv_offset: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))
    color: str = ""


class MaterialReader:
    """Reads each material of a stage once, when it is first used; values at the earliest time."""

    def __init__(self, note: Note, layers: Layers) -> None:
        self._note, self._layers = note, layers
        self._uses: dict[Any, MaterialUse] = {}
        self._textures: dict[tuple[str, str, bool], Texture | None] = {}

    def use(self, prim: Any, double_sided: bool) -> MaterialUse:
        """Material that is bound to ``prim``; without one its colour is ``displayColor``."""
        from pxr import UsdShade

        bound, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        key = (str(bound.GetPath()) if bound else "", double_sided)
        if key not in self._uses:
            if bound:
                self._uses[key] = self._read(bound, double_sided)
            else:
                plain = Material(double_sided=double_sided)
                self._uses[key] = MaterialUse(plain, color="displayColor")
        return self._uses[key]

    def _read(self, bound: Any, double_sided: bool) -> MaterialUse:
        name = bound.GetPrim().GetName()
        shader, _, _ = bound.ComputeSurfaceSource()
        if not shader or shader.GetShaderId() != "UsdPreviewSurface":
            self._note(f"material {name!r} has no UsdPreviewSurface; displayColor is used")
            return MaterialUse(Material(name=name, double_sided=double_sided), color="displayColor")
        plain = Material(name=name, double_sided=double_sided, shading="metallic_roughness")
        material = self._with_gloss(plain, shader)
        return self._with_alpha(self._with_color(material, shader), shader)

    def _with_gloss(self, material: Material, shader: Any) -> Material:
        """Metallic, roughness and emission, where they are constant."""
        if int(_value(shader.GetInput("useSpecularWorkflow"), 0)):
            self._note(f"material {material.name!r}: specularColor is left out; it is no metal")
        found: dict[str, Any] = {}
        for name, field_name, default in (
            ("metallic", "metallic", 0.0),
            ("roughness", "roughness", 0.5),
            ("emissiveColor", "emission", (0.0, 0.0, 0.0)),
        ):
            given = shader.GetInput(name)
            if _source(given) is not None:
                self._note(f"material {material.name!r}: {name} varies; {default} is used")
                continue
            value = _value(given, default)
            if field_name == "emission":
                found[field_name] = _triple(value)
            else:
                found[field_name] = _share(value, f"material {material.name!r}: {name}")
        return replace(material, **found)

    def _with_color(self, material: Material, shader: Any) -> MaterialUse:
        base = shader.GetInput("diffuseColor")
        source = _source(base)
        if source is None:
            value = _value(base, (0.18, 0.18, 0.18))
            return MaterialUse(replace(material, base_color=_triple(value)))
        kind = source.GetShaderId() or "a shader without id"
        if kind == "UsdUVTexture":
            return self._textured(material, source)
        if kind.startswith("UsdPrimvarReader"):
            return MaterialUse(material, color=str(_value(source.GetInput("varname"), "")))
        self._note(f"material {material.name!r}: its colour comes from {kind}; left out")
        return MaterialUse(material)

    def _with_alpha(self, use: MaterialUse, shader: Any) -> MaterialUse:
        """Opacity, which is tested where there is a threshold for it, and else blended."""
        given = shader.GetInput("opacity")
        threshold = float(_value(shader.GetInput("opacityThreshold"), 0.0))
        tested: dict[str, Any] = {"alpha_mode": "mask", "alpha_cutoff": threshold}
        mode = tested if threshold > 0.0 else {}
        source = _source(given)
        if source is None:
            what = f"material {use.material.name!r}: opacity"
            opacity = _share(_value(given, 1.0), what)
            return replace(use, material=replace(use.material, opacity=opacity, **mode))
        placed = self._alpha_texture(use, source, given)
        if placed is None:
            self._note(f"material {use.material.name!r}: opacity is read as 1")
            return use
        mode = mode or {"alpha_mode": "blend"}
        return replace(placed, material=replace(placed.material, **mode))

    def _alpha_texture(self, use: MaterialUse, source: Any, given: Any) -> MaterialUse | None:
        """``use`` with a texture whose alpha is the opacity; None where there can't be one.

        A material has one texture, so that of its colour, if any, must be of the same size and
        looked up in the same way.
        """
        if source.GetShaderId() != "UsdUVTexture":
            return None
        opacity = self._textured(use.material, source)
        if opacity.material.texture is None:
            return None
        image = opacity.material.texture.image
        channel = "rgba".find(_output(given))
        scale, bias = (
            float(_value(source.GetInput(name), (default,) * 4)[channel])
            for name, default in (("scale", 1.0), ("bias", 0.0))
        )
        alpha = np.clip(image[..., channel, None] * scale + bias, 0.0, 1.0)
        color = np.ones((*alpha.shape[:2], 3), np.float32)
        if use.material.texture is not None:
            color = use.material.texture.image[..., :3]
            same = opacity.uv == use.uv and np.array_equal(opacity.uv_linear, use.uv_linear)
            if not same or not np.array_equal(opacity.uv_offset, use.uv_offset):
                return None
            if color.shape[:2] != alpha.shape[:2]:
                return None
        own = use.material.texture or opacity.material.texture
        texture = replace(own, image=np.concatenate([color, alpha], axis=2))
        return replace(opacity, material=replace(use.material, texture=texture), color=use.color)

    def _textured(self, material: Material, source: Any) -> MaterialUse:
        uv, linear, offset = _coordinates(_source(source.GetInput("st")))
        wraps = [str(_value(source.GetInput(name), "repeat")) for name in ("wrapS", "wrapT")]
        if wraps[0] != wraps[1]:
            self._note(f"a texture of {material.name!r} wraps as {wraps[0]} in both directions")
        raw = str(_value(source.GetInput("sourceColorSpace"), "auto")) == "raw"
        file = _value(source.GetInput("file"), None)
        scale = np.array(_value(source.GetInput("scale"), (1.0, 1.0, 1.0, 1.0)))[:3]
        texture = None if file is None else self._image(file, _WRAPS.get(wraps[0], "repeat"), raw)
        if texture is None:
            fallback = _value(source.GetInput("fallback"), (0.0, 0.0, 0.0, 1.0))
            return MaterialUse(replace(material, base_color=_triple(fallback)))
        material = replace(material, texture=texture, base_color=_triple(scale))
        return MaterialUse(material, uv, linear, offset)

    def _image(self, file: Any, wrap: str, raw: bool) -> Texture | None:
        """Texture of an asset path, inside a package too; None, and a note, if it is not there."""
        key = (file.resolvedPath or file.path, wrap, raw)
        if key not in self._textures:
            data, name = self._layers.data(file.resolvedPath), without_link(file.path)
            self._textures[key] = None
            if data is None:
                self._note(f"texture not found: {name}; its fallback colour is used")
            else:
                image = decode_image(data, name)
                if raw:
                    image = undecoded(image)
                self._textures[key] = Texture(image, name=name, wrap=wrap)
        return self._textures[key]


def _source(given: Any) -> Any:
    """Shader that an input is connected to, through interfaces; None for a plain value."""
    from pxr import UsdShade

    if not given:
        return None
    for attribute in given.GetValueProducingAttributes():
        if UsdShade.Utils.GetType(attribute.GetName()) == UsdShade.AttributeType.Output:
            return UsdShade.Shader(attribute.GetPrim())
    return None


def _output(given: Any) -> str:
    """Name of the output that an input is connected to."""
    return str(given.GetValueProducingAttributes()[0].GetName().split(":")[-1])


def _value(given: Any, default: Any) -> Any:
    """Value of an input, through interfaces, at the earliest time."""
    from pxr import Usd

    for attribute in given.GetValueProducingAttributes() if given else ():
        value = attribute.Get(Usd.TimeCode.EarliestTime())
        if value is not None:
            return value
    return default


def _coordinates(reader: Any) -> tuple[str, NDArray[np.float64], NDArray[np.float64]]:
    """Primvar that a texture is looked up by, and a UsdTransform2d on the way."""
    linear, offset = np.eye(2), np.zeros(2)
    if reader is not None and reader.GetShaderId() == "UsdTransform2d":
        angle = np.radians(float(_value(reader.GetInput("rotation"), 0.0)))
        c, s = np.cos(angle), np.sin(angle)
        scale = np.array(_value(reader.GetInput("scale"), (1.0, 1.0)), dtype=np.float64)
        linear = np.array([[c, -s], [s, c]]) * scale
        offset = np.array(_value(reader.GetInput("translation"), (0.0, 0.0)), dtype=np.float64)
        reader = _source(reader.GetInput("in"))
    name = "st" if reader is None else str(_value(reader.GetInput("varname"), "st"))
    return name, linear, offset


def _share(value: Any, what: str) -> float:
    """Return a number cut to 0 to 1."""
    return min(max(number(float(value), what), 0.0), 1.0)


def _triple(value: Any) -> tuple[float, float, float]:
    red, green, blue = (float(part) for part in list(value)[:3])
    return red, green, blue
