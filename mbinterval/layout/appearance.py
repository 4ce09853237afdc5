"""Materials, textures, lights and backgrounds as the kernels read them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.device import records
from mbinterval.scene.field_values import LARGEST
from mbinterval.scene.model import Light, Material, Texture
from mbinterval.settings.settings import Settings

if TYPE_CHECKING:
    from mbinterval.exposure.exposure import Exposure

DEFAULT_MATERIAL = Material()

Float32 = NDArray[np.float32]
_LEAST_FADE = 1e-3
"""Least difference of the cosines of a cone's angles, as KHR_lights_punctual has it."""
_LEAST_SQUARED = 1e-100
"""Below it squares of numbers are lost."""
LEAST_ROUGHNESS = 0.03
"""Below it a material shines as with it (``cl/shared/shading.h``)."""


@dataclass(frozen=True, eq=False)
class Appearance:
    """Tables of ``cl/shared/records.h``; ``texels`` is ``(n, 4)`` float32, all mip chains.

    Texels are premultiplied with their alpha, which is 1 where materials ignore it.
    """

    materials: NDArray[np.void]
    textures: NDArray[np.void]
    texels: Float32
    lights: NDArray[np.void]


def appearance(
    materials: Sequence[Material],
    lights: Sequence[Light],
    origin: NDArray[np.float64] | None = None,
    casters: Sequence[int] = (),
) -> Appearance:
    """Tables for ``materials`` (indices stay) and ``lights``, placed relative to ``origin``.

    ``casters`` are the places of the lights that cast shadows.
    """
    textures = textures_of(materials)
    chains = [mip_chain(texture_image(texture, key[1])) for key, texture in textures.items()]
    texels = [level.reshape(-1, 4) for chain in chains for level in chain]
    return Appearance(
        materials=_material_table(
            materials, textures, any(light.kind != "ambient" for light in lights)
        ),
        textures=_texture_table(list(textures.values()), chains),
        texels=np.concatenate(texels) if texels else np.zeros((0, 4), np.float32),
        lights=_light_table(lights, np.zeros(3) if origin is None else origin, casters),
    )


def casting(exposure: Exposure, settings: Settings) -> tuple[int, ...]:
    """Return the places of the lights that cast shadows, among the exposure's lights."""
    if settings.shadows == "off":
        return ()
    return tuple(
        index
        for index, light in enumerate(exposure.lights)
        if light.kind != "ambient" and (light.shadows or settings.shadows == "all")
    )


TextureKey = tuple[int, bool]
"""Identity of a texture, and whether its alpha counts."""


def _uses_of(material: Material) -> dict[str, tuple[Texture | None, bool]]:
    """Textures by the field of the record that names them, and whether their alpha counts."""
    return {
        "texture": (material.texture, material.alpha != "opaque"),
        "gloss_texture": (material.metallic_roughness_texture, False),
        "emission_texture": (material.emission_texture, False),
    }


def textures_of(materials: Sequence[Material]) -> dict[TextureKey, Texture]:
    """Return the textures in use, each once, or twice if its alpha counts for some only."""
    uses = [use for material in materials for use in _uses_of(material).values()]
    return {(id(texture), counts): texture for texture, counts in uses if texture}


def texture_image(texture: Texture, counts: bool) -> Float32:
    """Texels as the device has them: premultiplied where alpha ``counts``, else alpha is 1.

    So texels count by their alpha wherever they are averaged.
    """
    if texture.alpha_range == (1.0, 1.0):
        return texture.image
    color, alpha = texture.image[..., :3], texture.image[..., 3:]
    alpha = np.clip(alpha, 0.0, 1.0) if counts else np.ones_like(alpha)
    return np.concatenate([color * alpha, alpha], axis=2)


def mip_chain(image: Float32) -> list[Float32]:
    """Levels of ``image`` (h, w, 4), each half the size of the one before, down to one texel.

    A level is the box-filtered one before; of an odd size the last row or column joins the one
    before it.
    """
    levels = [image]
    while levels[-1].shape[:2] != (1, 1):
        levels.append(halved(halved(levels[-1], 0), 1))
    return levels


def halved(image: Float32, axis: int) -> Float32:
    """Means of pairs along ``axis``; of an odd number the last joins the pair before it."""
    rows = np.moveaxis(image, axis, 0)
    size = len(rows)
    if size == 1:
        return image
    half = 0.5 * (rows[: size - 1 : 2] + rows[1::2])
    if size % 2:
        half[-1] = rows[-3:].mean(axis=0, dtype=np.float64)
    return np.moveaxis(half, 0, axis)


def fit_background(image: Float32, width: int, height: int) -> Float32:
    """``image`` (h, w, 3) resampled to fill a frame: box filter down, bilinear up."""
    return np.ascontiguousarray(
        _resampled(_resampled(image, 0, height), 1, width), dtype=np.float32
    )


def _resampled(image: NDArray[Any], axis: int, size: int) -> NDArray[Any]:
    """Resample one axis with a triangle filter as wide as the coarser of the two grids."""
    given = image.shape[axis]
    if given == size:
        return image
    step = given / size
    radius = max(step, 1.0)
    centre = (np.arange(size) + 0.5) * step - 0.5
    taps = np.arange(-int(radius) - 1, int(radius) + 2)
    index = np.floor(centre)[:, None].astype(int) + taps
    weight = np.maximum(0.0, 1.0 - np.abs(index - centre[:, None]) / radius)
    weight /= weight.sum(axis=1, keepdims=True)
    rows = np.moveaxis(image, axis, 0)
    result = np.zeros((size, *rows.shape[1:]))
    for tap in range(len(taps)):
        result += weight[:, tap, None, None] * rows[np.clip(index[:, tap], 0, given - 1)]
    return np.moveaxis(result, 0, axis)


def _material_table(
    materials: Sequence[Material], textures: Mapping[TextureKey, Texture], shining: bool
) -> NDArray[np.void]:
    """Table of ``materials``; ``shining`` says whether any light makes highlights."""
    index = {key: place for place, key in enumerate(textures)}
    table = np.zeros(len(materials), records.MATERIAL)
    for row, material in zip(table, materials, strict=True):
        row["specular"], row["shininess"] = material.specular, material.shininess
        row["flags"] = (
            (material.shading == "phong") * records.MATERIAL_PHONG
            + (material.shading == "metallic_roughness") * records.MATERIAL_METALLIC
            + (not material.double_sided) * records.MATERIAL_SINGLE_SIDED
            + (material.alpha == "mask") * records.MATERIAL_MASK
        )
        for name, (texture, counts) in _uses_of(material).items():
            row[name] = index.get((id(texture), counts), records.NONE)
        row["cutoff"], row["turn"] = material.alpha_cutoff, _turn(material) if shining else np.inf
        row["metallic"], row["roughness"] = material.metallic, material.roughness
        row["emission"] = material.emission
    return table


def _turn(material: Material) -> float:
    """Square of the chord that normals may turn by so that no highlight passes unseen.

    What is mirrored turns twice as far as they do, by half of a highlight's width at half its
    height: cos^n is 1/2 at an angle of sqrt(2 ln 2 / n), and GGX's distribution where the tangent
    between normal and half-way vector is sqrt(sqrt(2) - 1) times alpha.
    """
    if material.shading == "phong":
        turn = 0.5 * float(np.log(2.0)) / material.shininess if any(material.specular) else np.inf
        return turn if turn < LARGEST else np.inf
    roughness = material.roughness
    if material.metallic_roughness_texture is not None:
        roughness *= float(material.metallic_roughness_texture.image[..., 1].min())
    return float(np.sqrt(2.0) - 1.0) * max(roughness, LEAST_ROUGHNESS) ** 4


def _texture_table(textures: list[Texture], chains: list[list[Float32]]) -> NDArray[np.void]:
    table = np.zeros(len(textures), records.TEXTURE)
    first = 0
    for row, texture, chain in zip(table, textures, chains, strict=True):
        row["texel"], row["levels"] = first, len(chain)
        row["height"], row["width"] = texture.image.shape[:2]
        row["wrap"] = records.WRAP[texture.wrap]
        first += sum(level.shape[0] * level.shape[1] for level in chain)
    return table


def _light_table(
    lights: Sequence[Light], origin: NDArray[np.float64], casters: Sequence[int]
) -> NDArray[np.void]:
    table = np.zeros(len(lights), records.LIGHT)
    table["shadow"] = records.NONE
    table["shadow"][list(casters)] = np.arange(len(casters))
    for row, light in zip(table, lights, strict=True):
        row["color"] = np.asarray(light.color) * light.intensity
        row["kind"] = records.LIGHT_KIND[light.kind]
        if light.kind in ("point", "spot"):
            row["vector"] = np.asarray(light.position) - origin
        elif light.kind == "directional":
            row["vector"] = _back_along(light)
        if light.kind == "spot":
            inner, outer = np.cos(np.radians([light.inner_angle, light.outer_angle]))
            row["axis"] = _back_along(light)
            row["cone"] = np.array([1.0, -outer]) / max(inner - outer, _LEAST_FADE)
    return table


def _back_along(light: Light) -> NDArray[np.float64]:
    """Return the unit vector against the way that light travels."""
    direction = np.asarray(light.direction, np.float64)
    if np.abs(direction).max() < _LEAST_SQUARED:
        direction = direction / np.abs(direction).max()
    return np.asarray(-direction / np.linalg.norm(direction))
