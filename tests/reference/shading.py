"""Average colour of visible spans: textures, vertex colours and Phong's model.

A span is averaged at the midpoints of n equal parts of its time range (Hong & Oh 2017, 3.2). The
mip level is log2(max(|du| width, |dv| height) / n), du and dv being the differences of uv over
the range (4.4), clamped to the chain. Levels are box-filtered, each from the one before, half its
size rounded down (of an odd size the last row or column joins the one before it); look-ups are
bilinear in the two nearest levels, texel centres at one half, v pointing up.

A point seen at depth w and segment time tau lies at eye + w ray, where eye and ray (through the
sample, at w = 1) run linearly from the camera's pose at one end of the segment to the other's.
Normals are used as they are given, linear over the interval and then normalized; a flat surface
takes its unit normals at both ends of the segment. The viewer's side of a two-sided surface is
lit. There is no highlight where a light is behind the surface.

Texels count by their alpha wherever they are averaged, if the material doesn't ignore it: they
are premultiplied, and what is found is divided by the alpha that is found.
"""

from __future__ import annotations

import numpy as np

from mbinterval.exposure.exposure import Exposure
from mbinterval.scene.model import Light, Material, Texture

from .hits import Samples
from .paths import ALPHA, COLOR, NORMAL, UV, Intervals, Paths
from .visibility import Spans


class Shader:
    """Shade spans of ``paths``, which were made from ``exposure`` for an image of ``size``."""

    def __init__(
        self, exposure: Exposure, paths: Paths, size: tuple[int, int], texture_samples: int = 16
    ) -> None:
        self.exposure, self.paths, self.size = exposure, paths, size
        self.count = texture_samples
        self.materials = [mesh.mesh.material or Material() for mesh in exposure.meshes]
        self.chains = [m.texture and mip_chain(premultiplied(m)) for m in self.materials]
        self.gloss, self.emission = (
            [t and mip_chain(np.asarray(t.image[..., :3], np.float64)) for t in textures]
            for textures in zip(
                *((m.metallic_roughness_texture, m.emission_texture) for m in self.materials),
                strict=True,
            )
        )

    def __call__(self, intervals: Intervals, spans: Spans, samples: Samples) -> np.ndarray:
        """Colour ``(J, 3)`` of each span."""
        path = intervals.path[spans.interval]
        color = self.paths.color[path]
        if not self.paths.attributes.shape[-1]:
            return color
        places = (np.arange(self.count) + 0.5) / self.count
        for mesh in np.unique(self.paths.mesh[path]):
            span = np.flatnonzero(self.paths.mesh[path] == mesh)
            one = Spans(spans.interval[span], spans.t[span], spans.weight[span])
            level = self._level(mesh, intervals, one)
            total = sum(
                self._at(mesh, intervals, one, part, level, samples, color[span]) for part in places
            )
            color[span] = total / self.count
        return color

    def _level(self, mesh: int, intervals: Intervals, spans: Spans) -> np.ndarray:
        texture = self.materials[mesh].texture
        if texture is None or self.materials[mesh].alpha_mode == "mask":
            return np.zeros(len(spans.interval))
        ends = [intervals.values(spans.interval, t)[:, UV] for t in spans.t.T]
        height, width = texture.image.shape[:2]
        extent = (np.abs(ends[1] - ends[0]) * [width, height]).max(axis=1) / self.count
        return np.log2(np.maximum(extent, 1.0))

    def _at(
        self, mesh: int, intervals: Intervals, spans: Spans, part: float, level: np.ndarray,
        samples: Samples, base: np.ndarray,
    ) -> np.ndarray:  # fmt: skip
        """Colour of spans of one mesh, ``part`` of the way through their time ranges."""
        t = spans.t[:, 0] + part * (spans.t[:, 1] - spans.t[:, 0])
        values = intervals.values(spans.interval, t)
        material = self.materials[mesh]
        color = base * values[:, COLOR]
        if material.texture is not None:
            texel = trilinear(self.chains[mesh], material.texture, values[:, UV], level)
            color = color * texel[:, :3] / np.where(texel[:, 3:] > 0, texel[:, 3:], 1.0)
        if material.shading == "unlit":
            return color
        w = intervals.depth(spans.interval, t)
        x, y = samples.positions(intervals.sample[spans.interval])
        eye, ray = self._view(mesh, intervals.path[spans.interval], x, y, t)
        view, normal = -unit(ray), unit(values[:, NORMAL])
        if material.double_sided:
            away = (normal * view).sum(axis=1, keepdims=True) < 0
            normal = np.where(away, -normal, normal)
        position = eye + w[:, None] * ray
        lights = self.exposure.lights
        seen = np.zeros_like(color)
        if material.shading == "phong":
            for light in lights:
                seen += phong(material, color, position, normal, view, light)
        else:
            gloss = (
                np.array([material.metallic, material.roughness])
                * self._texels(
                    self.gloss[mesh], material.metallic_roughness_texture, values[:, UV], level
                )[:, [2, 1]]
            )
            for light in lights:
                seen += metallic_roughness(gloss, color, position, normal, view, light)
        return seen + np.asarray(material.emission) * self._texels(
            self.emission[mesh], material.emission_texture, values[:, UV], level
        )

    def _texels(self, chain, texture, uv: np.ndarray, level: np.ndarray) -> np.ndarray:
        """Colour ``(J, 3)`` of a texture that may be missing."""
        if texture is None:
            return np.ones((len(uv), 3))
        return trilinear(chain, texture, uv, level)[:, :3]

    def alpha_at(
        self, mesh: int, intervals: Intervals, spans: Spans, part: float, level: np.ndarray
    ) -> np.ndarray:
        """Alpha ``(J,)`` of spans of one mesh, likewise; 0 or 1 where it is tested."""
        path = intervals.path[spans.interval]
        alpha = self.paths.alpha[path].copy()
        material = self.materials[mesh]
        if not self.paths.attributes.shape[-1]:
            return alpha
        t = spans.t[:, 0] + part * (spans.t[:, 1] - spans.t[:, 0])
        values = intervals.values(spans.interval, t)
        alpha = alpha * values[:, ALPHA][:, 0]
        if material.texture is not None:
            texel = trilinear(self.chains[mesh], material.texture, values[:, UV], level)
            alpha = alpha * texel[:, 3]
        if material.alpha_mode == "mask":
            alpha = (alpha >= material.alpha_cutoff).astype(float)
        return np.where(self.paths.opaque[path], 1.0, np.clip(alpha, 0.0, 1.0))

    def _view(
        self, mesh: int, path: np.ndarray, x: np.ndarray, y: np.ndarray, t: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Eye, and ray through the sample at w = 1, in the world at global times t."""
        poses = self.exposure.meshes[mesh].poses
        width, height = self.size
        segment = self.paths.segment[path]
        ends = []
        for pose in (segment, np.minimum(segment + 1, len(poses.eye) - 1)):
            p = np.stack([(x - width / 2) / height, 0.5 - y / height, -np.ones(len(x))], 1)
            rays = np.linalg.solve(poses.view[pose], p[..., None])[..., 0]
            ends.append((poses.eye[pose], rays))
        tau = self.paths.local(path, t)[:, None]
        (eye0, ray0), (eye1, ray1) = ends
        return eye0 + tau * (eye1 - eye0), ray0 + tau * (ray1 - ray0)


def unit(v: np.ndarray) -> np.ndarray:
    """Vectors ``(M, 3)`` of length 1; zero stays zero."""
    length = np.linalg.norm(v, axis=1, keepdims=True)
    return v / np.where(length > 0, length, 1.0)


def phong(
    material: Material,
    color: np.ndarray,
    position: np.ndarray,
    normal: np.ndarray,
    view: np.ndarray,
    light: Light,
) -> np.ndarray:
    """What one light adds: colour * max(0, n.l) + specular * max(0, r.v) ** shininess, lit."""
    if light.kind == "ambient":
        return color * np.asarray(light.color) * light.intensity
    towards, arriving = arriving_from(light, position)
    cosine = (normal * towards).sum(axis=1, keepdims=True)
    mirrored = 2.0 * cosine * normal - towards
    highlight = np.maximum((mirrored * view).sum(axis=1, keepdims=True), 0.0) ** material.shininess
    lit = cosine * color + highlight * np.asarray(material.specular)
    return np.where(cosine > 0, arriving * lit, 0.0)


def cone(light: Light, towards: np.ndarray) -> np.ndarray:
    """Share ``(M, 1)`` of a spot light's strength by angle: the glTF extension's formula."""
    inner, outer = np.cos(np.radians([light.inner_angle, light.outer_angle]))
    across = -(towards * unit(np.asarray([light.direction]))).sum(axis=1, keepdims=True)
    return np.clip((across - outer) / max(0.001, inner - outer), 0.0, 1.0) ** 2


def arriving_from(light: Light, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors towards a light, and its colour there; not of ambient light."""
    color = np.asarray(light.color) * light.intensity
    if light.kind == "directional":
        return unit(-np.asarray([light.direction])), color
    towards = np.asarray(light.position) - position
    color = color / (towards**2).sum(axis=1, keepdims=True)
    return unit(towards), color * cone(light, unit(towards)) if light.kind == "spot" else color


def metallic_roughness(
    gloss: np.ndarray,
    color: np.ndarray,
    position: np.ndarray,
    normal: np.ndarray,
    view: np.ndarray,
    light: Light,
) -> np.ndarray:
    """What one light adds: pi * BRDF * cosine, by glTF 2.0, appendix B.3, as it is written there.

    ``gloss`` ``(M, 2)`` is metallic and roughness. Ambient light is mirrored as if head-on.
    """
    metal, rough = np.clip(gloss, [0.0, 0.03], 1.0).T[:, :, None]
    black, f0 = color * (1.0 - metal), 0.04 * (1.0 - metal) + color * metal
    if light.kind == "ambient":
        return np.asarray(light.color) * light.intensity * (black * (1.0 - f0) + f0)
    towards, arriving = arriving_from(light, position)
    half = unit(towards + view)
    nl, nv, nh, vh = (
        (a * b).sum(axis=1, keepdims=True)
        for a, b in ((normal, towards), (normal, view), (normal, half), (view, half))
    )
    alpha2 = rough**4
    d = alpha2 * (nh > 0) / (np.pi * (nh**2 * (alpha2 - 1.0) + 1.0) ** 2)
    g = 1.0
    for cosine in (nl, nv):
        shadow = np.abs(cosine) + np.sqrt(alpha2 + (1.0 - alpha2) * cosine**2)
        g = g * 2.0 * np.abs(cosine) / shadow
    fresnel = f0 + (1.0 - f0) * (1.0 - np.abs(vh)) ** 5
    diffuse = (1.0 - fresnel) * black / np.pi
    specular = fresnel * d * g / (4.0 * np.abs(nv) * np.abs(nl))
    return np.where(nl > 0, np.pi * (diffuse + specular) * nl * arriving, 0.0)


def premultiplied(material: Material) -> np.ndarray:
    """Texels ``(h, w, 4)``; alpha is 1 where the material ignores it."""
    image = np.array(material.texture.image, dtype=np.float64)
    if material.alpha_mode == "opaque" or (material.alpha_mode, material.opacity) == ("auto", 1.0):
        image[..., 3] = 1.0
    image[..., 3] = np.clip(image[..., 3], 0.0, 1.0)
    image[..., :3] *= image[..., 3:]
    return image


def mip_chain(image: np.ndarray) -> list[np.ndarray]:
    """All levels of ``image`` ``(h, w, c)``, down to one texel."""
    levels = [np.asarray(image, dtype=np.float64)]
    while max(levels[-1].shape[:2]) > 1:
        level = levels[-1]
        for axis in (0, 1):
            size = level.shape[axis]
            groups = np.array_split(np.arange(size), [*range(2, size - 1, 2)])
            level = np.stack([level.take(g, axis).mean(axis) for g in groups], axis)
        levels.append(level)
    return levels


def averaged(
    chain: list[np.ndarray], texture: Texture, uv: np.ndarray, right: np.ndarray,
    down: np.ndarray, most: int, least: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Texels ``(M, c)`` over the parallelograms of ``right`` and ``down`` ``(M, 2)`` around ``uv``.

    As many look-ups as the longer side is longer than the parallelogram is high, ``most`` at most,
    in a row along it.
    """
    size = np.array(texture.image.shape[1::-1])
    a, b = right * size, down * size
    lengths = np.stack([np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)])
    long = lengths.max(axis=0)
    high = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / np.where(long > 0, long, 1.0)
    high = np.maximum(np.maximum(high, long / most), 1.0)
    count = np.clip(np.ceil(long / high - 0.01), 1, most).astype(int)
    side = np.where((lengths[0] >= lengths[1])[:, None], right, down)
    level = np.maximum(np.log2(high), least)
    result = np.zeros((len(uv), chain[0].shape[2]))
    for k in range(most):
        place = uv + side * ((k + 0.5) / count - 0.5)[:, None]
        result += (k < count)[:, None] * trilinear(chain, texture, place, level)
    return result / count[:, None]


def wrapped(index: np.ndarray, size: int, wrap: str) -> np.ndarray:
    """Texel that stands at ``index``, any integer, of a row of ``size`` texels."""
    if wrap == "clamp":
        return np.clip(index, 0, size - 1)
    if wrap == "repeat":
        return np.mod(index, size)
    folded = np.mod(index, 2 * size)
    return np.where(folded < size, folded, 2 * size - 1 - folded)


def bilinear(image: np.ndarray, texture: Texture, uv: np.ndarray) -> np.ndarray:
    """Texel ``(M, c)`` of one level at ``uv`` ``(M, 2)``."""
    height, width = image.shape[:2]
    x, y = uv[:, 0] * width - 0.5, (1.0 - uv[:, 1]) * height - 0.5
    left, top = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    result = np.zeros((len(uv), image.shape[2]))
    for down in (0, 1):
        for right in (0, 1):
            share_x = x - left if right else 1.0 - (x - left)
            share_y = y - top if down else 1.0 - (y - top)
            row = wrapped(top + down, height, texture.wrap)
            column = wrapped(left + right, width, texture.wrap)
            result += (share_x * share_y)[:, None] * image[row, column]
    return result


def trilinear(
    chain: list[np.ndarray], texture: Texture, uv: np.ndarray, level: np.ndarray
) -> np.ndarray:
    """Texel ``(M, c)`` between the two levels nearest to ``level`` ``(M,)``."""
    level = np.clip(level, 0.0, len(chain) - 1)
    result = np.zeros((len(uv), chain[0].shape[2]))
    for index, image in enumerate(chain):
        share = np.maximum(1.0 - np.abs(level - index), 0.0)
        used = np.flatnonzero(share)
        result[used] += share[used, None] * bilinear(image, texture, uv[used])
    return result
