"""What is seen along rays: surfaces in order of depth, their colour, light, shadows, mirrors."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np

from . import around
from .cast import BLOCK, Hits, Triangles
from .tracks import matrices

MATERIAL = SimpleNamespace(
    base_color=(1.0, 1.0, 1.0),
    texture=None,
    shading="phong",
    specular=(0.04, 0.04, 0.04),
    shininess=32.0,
    metallic=0.0,
    roughness=0.5,
    metallic_roughness_texture=None,
    emission=(0.0, 0.0, 0.0),
    emission_texture=None,
    double_sided=True,
    reflectivity=0.0,
    reflection_shear=0.0,
    opacity=1.0,
    alpha_mode="auto",
    alpha_cutoff=0.5,
)
"""That of a mesh without one."""

OPAQUE = 1e-6
"""Light that a stack lets through, below which it ends."""
FAR = 1e9


@dataclass(eq=False)
class Seen:
    """What N rays see, without what is behind everything.

    ``color`` ``(N, 3)`` premultiplied; ``left`` ``(N,)`` is what passes all of it; ``depth`` times
    what each layer adds; ``cover`` ``(N, M)`` what each mesh adds; ``layers`` pairs of depth and
    alpha added, front to back.
    """

    color: np.ndarray
    left: np.ndarray
    depth: np.ndarray
    cover: np.ndarray
    layers: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Rays:
    """N rays ``start + w way`` at the instants ``group``; ``eye`` is where light goes to."""

    group: np.ndarray
    start: np.ndarray
    way: np.ndarray
    eye: np.ndarray
    behind: np.ndarray
    """What is seen where nothing is, unless an environment is: ``(N, 3)``."""
    disc: np.ndarray | None = None
    """Of the unit disc: where glossy mirrors send each ray ``(N, 2)``."""

    def chosen(self, which: np.ndarray) -> Rays:
        disc = None if self.disc is None else self.disc[which]
        parts = (self.group, self.start, self.way, self.eye, self.behind)
        return Rays(*(part[which] for part in parts), disc)


class World:
    """A scene at some instants, ready to be looked at."""

    def __init__(self, scene: Any, triangles: Triangles, shadows: str = "lights") -> None:
        self.scene, self.triangles = scene, triangles
        self.still = triangles.still
        self.materials = [mesh.material or MATERIAL for mesh in scene.meshes]
        per_face = [self.materials[mesh] for mesh in self.still.mesh]
        if triangles.faces == 0:
            per_face = []
        self.double = np.array([m.double_sided for m in per_face], bool)
        self.mirror = np.array([m.reflectivity > 0.0 for m in per_face], bool)
        self.kind = np.array([_alpha_kind(m) for m in per_face], object)
        self.casting = [
            light.kind != "ambient" and shadows != "off" and (light.shadows or shadows == "all")
            for light in scene.lights
        ]
        self.lights = [_placed(light, self.still.frames) for light in scene.lights]

    def behind(self, rays: Rays) -> np.ndarray:
        environment = self.scene.environment
        if environment is not None and environment.background:
            return around.seen(environment, rays.way)
        return rays.behind

    def look(self, rays: Rays, hits: Hits, bounce: bool = True, keep: bool = False) -> Seen:
        """What ``rays`` see of ``hits``; mirrors are mirrors if ``bounce``."""
        distance = np.where(hits.front | self.double, hits.distance, np.inf)
        count = len(distance)
        seen = Seen(
            np.zeros((count, 3)), np.ones(count), np.zeros(count),
            np.zeros((count, len(self.scene.meshes))),
        )  # fmt: skip
        if not self.triangles.faces:
            return seen
        active = np.arange(count)
        while len(active):
            face = distance[active].argmin(axis=1)
            w = distance[active, face]
            met = np.isfinite(w)
            active, face, w = active[met], face[met], w[met]
            if not len(active):
                break
            distance[active, face] = np.inf
            here = rays.chosen(active)
            color, alpha = self.surfaces(here, face, hits.weights(active, face), bounce)
            added = seen.left[active] * alpha
            seen.color[active] += added[:, None] * color
            seen.depth[active] += added * w
            np.add.at(seen.cover, (active, self.still.mesh[face]), added)
            if keep:
                z, a = np.full(count, np.inf), np.zeros(count)
                z[active], a[active] = w, added
                seen.layers.append((z, a))
            seen.left[active] *= 1.0 - alpha
            active = active[seen.left[active] > OPAQUE]
        return seen

    def surfaces(
        self, rays: Rays, face: np.ndarray, weights: np.ndarray, bounce: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """Colours ``(n, 3)``, mirrors' included, and alphas of points of faces."""
        corners = self.still.corners[rays.group, face]
        points = np.einsum("ni,nik->nk", weights, corners)
        color, alpha = np.zeros((len(face), 3)), np.ones(len(face))
        owner = self.still.mesh[face]
        for mesh in np.unique(owner):
            on = np.flatnonzero(owner == mesh)
            one = rays.chosen(on)
            color[on], alpha[on] = self._own(
                self.materials[mesh], one, points[on], face[on], weights[on]
            )
        mirrors = np.flatnonzero(self.mirror[face]) if bounce else []
        if len(mirrors):
            one = rays.chosen(mirrors)
            share = np.array([self.materials[m].reflectivity for m in owner[mirrors]])[:, None]
            other = self._mirrored(one, face[mirrors], points[mirrors])
            color[mirrors] = (1.0 - share) * color[mirrors] + share * other
        return color, alpha

    def _mirrored(self, rays: Rays, face: np.ndarray, points: np.ndarray) -> np.ndarray:
        normal = _unit(self.triangles.normals[rays.group, face])
        along = np.sum(rays.way * normal, axis=1, keepdims=True)
        way = rays.way - 2.0 * along * normal
        # Light goes to where a clear mirror shows the eye.
        height = np.sum((rays.eye - points) * normal, axis=1, keepdims=True)
        eye = rays.eye - 2.0 * height * normal
        shear = [self.materials[self.still.mesh[f]].reflection_shear for f in face]
        if np.any(shear) and rays.disc is not None:
            first = np.cross(normal, [0.36, -0.48, 0.8])
            first = _unit(first)
            off = np.array(shear)[:, None] * np.abs(along) * rays.disc
            way = way + off[:, :1] * first + off[:, 1:] * np.cross(normal, first)
        reflected = Rays(rays.group, points, way, eye, rays.behind)
        found = np.zeros_like(points)
        for part in _blocks(len(points), self.triangles.faces):
            some = reflected.chosen(part)
            hits = self.triangles.meet(some.group, some.start, some.way)
            hits.distance[np.arange(len(part)), face[part]] = np.inf
            hits.distance[hits.distance < 1e-9] = np.inf
            seen = self.look(some, hits, bounce=False)
            found[part] = seen.color + seen.left[:, None] * self.behind(some)
        return found

    def _own(
        self,
        material: Any,
        rays: Rays,
        points: np.ndarray,
        face: np.ndarray,
        weights: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        still, group = self.still, rays.group
        vertex = np.einsum("ni,nik->nk", weights, still.color[group, face])
        uv = np.einsum("ni,nik->nk", weights, still.uv[group, face])
        color = np.asarray(material.base_color, np.float64) * vertex[:, :3]
        alpha = _alpha(material, vertex[:, 3], uv)
        if material.texture is not None:
            texel = looked_up(material.texture, uv, _alpha_kind(material) != "opaque")
            color = color * texel[:, :3]
        if material.shading == "unlit":
            return color, alpha
        normal = _unit(np.einsum("ni,nik->nk", weights, still.normals[group, face]))
        view = _unit(rays.eye - points)
        if material.double_sided:
            side = np.sum(normal * view, axis=1, keepdims=True)
            normal = np.where(side < 0.0, -normal, normal)
        metallic, roughness = np.full(len(face), material.metallic), material.roughness
        if material.metallic_roughness_texture is not None:
            gloss = looked_up(material.metallic_roughness_texture, uv, False)
            metallic, roughness = metallic * gloss[:, 2], roughness * gloss[:, 1]
        roughness = np.broadcast_to(roughness, metallic.shape)
        light = _Lit(material, color, normal, view, metallic, roughness)
        found = np.zeros_like(color)
        for index, source in enumerate(self.scene.lights):
            arriving = np.asarray(source.color) * source.intensity
            if source.kind == "ambient":
                found += arriving * light.ambient()
                continue
            towards, strength, distance = _reaching(source, points, *self.lights[index], group)
            if self.casting[index]:
                strength = strength * self._passing(group, face, points, towards * distance)
            found += arriving * strength[:, None] * light.reflected(towards)
        found += self._around(light, rays, points, face)
        emission = np.asarray(material.emission, np.float64)
        if material.emission_texture is not None:
            emission = emission * looked_up(material.emission_texture, uv, False)[:, :3]
        return found + emission, alpha

    def _around(self, light: _Lit, rays: Rays, points: np.ndarray, face: np.ndarray) -> np.ndarray:
        """What points of one material make of an environment, or of what is around their mesh."""
        environment = self.scene.environment
        found = np.zeros_like(points)
        if environment is not None:
            found += light.scattered(around.scattered(environment, light.normal))
        if light.material.shading != "metallic_roughness":
            return found
        own = self.still.mesh[face]
        for mesh in np.unique(own):
            on, asked = np.flatnonzero(own == mesh), self.scene.meshes[mesh].reflections
            some = light.chosen(on)
            if asked is not None:
                way, share = some.drawn(rays.disc[on])
                mirrored = share[:, None] * self._reflections(asked, rays.group[on], way)
            elif environment is not None:
                mirrored = some.mirrored(environment)
            else:
                continue
            found[on] += some.shine(mirrored)
        return found

    def _reflections(self, asked: Any, group: np.ndarray, way: np.ndarray) -> np.ndarray:
        """What the middle of the meshes that ``asked`` sees in directions ``way``, without them."""
        scene = self.scene
        gone = np.array([mesh.reflections is asked for mesh in scene.meshes])[self.still.mesh]
        corners = self.still.corners[:, gone].reshape(len(self.still.frames), -1, 3)
        middle = 0.5 * (corners.min(axis=1) + corners.max(axis=1))[group]
        behind = np.asarray(scene.background, np.float64)
        behind = np.broadcast_to(behind.reshape(-1, 3).mean(axis=0), way.shape)
        if scene.environment is not None:
            behind = around.seen(scene.environment, way)
        rays, found = Rays(group, middle, way, middle, behind), np.zeros_like(way)
        for part in _blocks(len(way), self.triangles.faces):
            some = rays.chosen(part)
            hits = self.triangles.meet(some.group, some.start, some.way)
            hits.distance[:, gone] = np.inf
            seen = self.look(some, hits)
            found[part] = seen.color + seen.left[:, None] * some.behind
        return found

    def _passing(
        self, group: np.ndarray, face: np.ndarray, points: np.ndarray, way: np.ndarray
    ) -> np.ndarray:
        """Shares of light that pass from the ends of rays ``points + way`` to their starts."""
        passed = np.ones(len(face))
        for part in _blocks(len(face), self.triangles.faces):
            hits = self.triangles.meet(group[part], points[part], way[part])
            met = (hits.distance < 1.0) & (hits.distance > 1e-12)
            met[np.arange(len(part)), face[part]] = False
            opaque = (met & (self.kind == "opaque")).any(axis=1)
            here = np.where(opaque, 0.0, 1.0)
            ray, other = np.nonzero(met & (self.kind != "opaque"))
            for mesh in np.unique(self.still.mesh[other]):
                on = self.still.mesh[other] == mesh
                r, f = ray[on], other[on]
                weights, g = hits.weights(r, f), group[part][r]
                vertex = np.einsum("ni,ni->n", weights, self.still.color[g, f][..., 3])
                uv = np.einsum("ni,nik->nk", weights, self.still.uv[g, f])
                alpha = _alpha(self.materials[mesh], vertex, uv)
                np.multiply.at(here, r, 1.0 - alpha)
            passed[part] = here
        return passed


@dataclass(frozen=True, eq=False)
class _Lit:
    """Points of one material, and what they make of light: by Phong's model or by glTF's.

    "A white wall that faces a light of colour 1 has colour 1": glTF's model is taken times pi.
    """

    material: Any
    color: np.ndarray
    normal: np.ndarray
    view: np.ndarray
    metallic: np.ndarray
    roughness: np.ndarray

    @property
    def head_on(self) -> np.ndarray:
        """What is mirrored head-on: glTF's f0."""
        metallic = self.metallic[:, None]
        return 0.04 * (1.0 - metallic) + self.color * metallic

    @property
    def diffuse(self) -> np.ndarray:
        return self.color * (1.0 - self.metallic[:, None])

    def ambient(self) -> np.ndarray:
        """Of light 1 from all sides: in glTF's model as if all of it came head-on."""
        if self.material.shading == "phong":
            return self.color
        return self.diffuse * (1.0 - self.head_on) + self.head_on

    def reflected(self, towards: np.ndarray) -> np.ndarray:
        cosine = np.sum(self.normal * towards, axis=1)
        lit = cosine > 0.0
        if self.material.shading == "phong":
            mirror = 2.0 * cosine[:, None] * self.normal - towards
            along = np.maximum(np.sum(mirror * self.view, axis=1), 0.0)
            shine = np.where(lit, along**self.material.shininess, 0.0)
            scattered = np.maximum(cosine, 0.0)[:, None] * self.color
            return scattered + shine[:, None] * np.asarray(self.material.specular)
        half = _unit(towards + self.view)
        alpha = np.maximum(self.roughness, around.LEAST_ROUGHNESS) ** 2
        n_h, v_h = np.sum(self.normal * half, axis=1), np.sum(self.view * half, axis=1)
        n_v = np.abs(np.sum(self.normal * self.view, axis=1))
        density = alpha**2 / (np.pi * (n_h**2 * (alpha**2 - 1.0) + 1.0) ** 2)
        visible = 1.0
        for x in (cosine, n_v):
            visible = visible / (np.abs(x) + np.sqrt(alpha**2 + (1.0 - alpha**2) * x**2))
        specular = np.where(n_h > 0.0, density * visible, 0.0)[:, None]
        fresnel = self.head_on + (1.0 - self.head_on) * ((1.0 - np.abs(v_h)) ** 5)[:, None]
        both = (1.0 - fresnel) * self.diffuse / np.pi + fresnel * specular
        return np.where(lit, np.pi * cosine, 0.0)[:, None] * both

    def chosen(self, on: np.ndarray) -> _Lit:
        parts = (self.color, self.normal, self.view, self.metallic, self.roughness)
        return _Lit(self.material, *(part[on] for part in parts))

    @property
    def way(self) -> np.ndarray:
        """Where a clear mirror shows the view to come from."""
        along = np.sum(self.normal * self.view, axis=1)[:, None]
        return 2.0 * along * self.normal - self.view

    def shares(self) -> np.ndarray:
        """``(3, n, 1)``: of what is mirrored times its colour, besides, and lost by Lambert's."""
        n_v = np.clip(np.sum(self.normal * self.view, axis=1), 0.0, 1.0)
        found = np.zeros((3, len(n_v), 1))
        for roughness in np.unique(self.roughness):  # constant, but where a texture says it
            on = self.roughness == roughness
            cosine, *tables = around.shares(float(roughness))
            found[:, on] = np.stack([np.interp(n_v[on], cosine, t)[:, None] for t in tables])
        return found

    def scattered(self, light: np.ndarray) -> np.ndarray:
        """Of light from all around, whose integral over pi at each normal is ``light``."""
        if self.material.shading == "phong":
            return self.color * light
        return self.diffuse * (1.0 - self.head_on) * (1.0 - self.shares()[2]) * light

    def shine(self, mirrored: np.ndarray) -> np.ndarray:
        """Of light ``mirrored`` that facets have for a view head-on (split sum, Karis 2013)."""
        factor, added, _ = self.shares()
        return mirrored * (self.head_on * factor + added)

    def mirrored(self, environment: Any) -> np.ndarray:
        found, way = np.zeros_like(self.color), self.way
        for roughness in np.unique(self.roughness):
            on = self.roughness == roughness
            alpha = max(float(roughness), around.LEAST_ROUGHNESS) ** 2
            found[on] = around.mirrored(environment, way[on], alpha)
        return found

    def drawn(self, disc: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """One direction about the mirrored one for each point of a disc, and what it weighs."""
        alpha = np.maximum(self.roughness, around.LEAST_ROUGHNESS) ** 2
        square = np.sum(disc**2, axis=1)
        angle = 2.0 * np.arctan(alpha * np.sqrt(square / np.maximum(1.0 - square, 1e-12)))
        share = np.maximum(np.cos(angle), 0.0) / around.mean_cosine(alpha)
        way = _unit(self.way)
        first = np.cross(way, np.where(np.abs(way[:, :1]) < 0.7, [1.0, 0, 0], [0.0, 1.0, 0.0]))
        first = _unit(first)
        turn = disc / np.sqrt(np.maximum(square, 1e-30))[:, None]
        aside = turn[:, :1] * first + turn[:, 1:] * np.cross(way, first)
        return np.cos(angle)[:, None] * way + np.sin(angle)[:, None] * aside, share


def _placed(light: Any, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where a light is and which way it shines, ``(G, 3)``, at the instants ``frames``."""
    place = matrices(light.transform, frames)
    position = place[:, :3, :3] @ np.asarray(light.position, np.float64) + place[:, :3, 3]
    return position, _unit(place[:, :3, :3] @ np.asarray(light.direction, np.float64))


def _reaching(
    light: Any, points: np.ndarray, places: np.ndarray, ways: np.ndarray, group: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit vectors to a light, how strong it is, and how far, ``(n, 1)``, at ``points``."""
    if light.kind == "directional":
        return -ways[group], np.ones(len(points)), np.full((len(points), 1), FAR)
    away = places[group] - points
    distance = np.linalg.norm(away, axis=1, keepdims=True)
    towards, strength = away / distance, distance[:, 0] ** -2.0
    if light.kind == "spot":
        inner, outer = np.cos(np.radians([light.inner_angle, light.outer_angle]))
        along = -np.sum(towards * ways[group], axis=1)
        strength = strength * np.clip((along - outer) / max(inner - outer, 1e-3), 0.0, 1.0) ** 2
    return towards, strength, distance


def _alpha_kind(material: Any) -> str:
    if material.alpha_mode != "auto":
        return str(material.alpha_mode)
    return "blend" if material.opacity < 1.0 else "opaque"


def _alpha(material: Any, vertex: np.ndarray, uv: np.ndarray) -> np.ndarray:
    kind = _alpha_kind(material)
    if kind == "opaque":
        return np.ones(len(vertex))
    alpha = material.opacity * vertex
    if material.texture is not None:
        alpha = alpha * looked_up(material.texture, uv, True)[:, 3]
    alpha = np.clip(alpha, 0.0, 1.0)
    return (alpha >= material.alpha_cutoff).astype(float) if kind == "mask" else alpha


def looked_up(texture: Any, uv: np.ndarray, alpha_counts: bool) -> np.ndarray:
    """``(n, 4)``: bilinear between texels' middles, v up; texels weigh by alpha where it counts."""
    image = np.asarray(texture.image, np.float64)
    height, width = image.shape[:2]
    x, y = uv[:, 0] * width - 0.5, (1.0 - uv[:, 1]) * height - 0.5
    x0, y0 = np.floor(x), np.floor(y)
    found, weight = np.zeros((len(uv), 4)), np.zeros(len(uv))
    for dx, share_x in ((0, 1.0 - (x - x0)), (1, x - x0)):
        for dy, share_y in ((0, 1.0 - (y - y0)), (1, y - y0)):
            column = _wrapped(x0 + dx, width, texture.wrap)
            texel = image[_wrapped(y0 + dy, height, texture.wrap), column]
            share = share_x * share_y
            found[:, 3] += share * texel[:, 3]
            if alpha_counts:
                share = share * texel[:, 3]
            found[:, :3] += share[:, None] * texel[:, :3]
            weight += share
    whole = np.where(weight > 0.0, weight, 1.0)
    found[:, :3] /= whole[:, None]
    return found


def _wrapped(index: np.ndarray, size: int, wrap: str) -> np.ndarray:
    if wrap == "clamp":
        return np.clip(index, 0, size - 1).astype(int)
    if wrap == "mirror":
        folded = np.mod(index, 2 * size)
        return np.where(folded < size, folded, 2 * size - 1 - folded).astype(int)
    return np.mod(index, size).astype(int)


def _blocks(count: int, faces: int) -> list[np.ndarray]:
    size = max(BLOCK // (8 * max(faces, 1)), 1)
    return [np.arange(first, min(first + size, count)) for first in range(0, count, size)]


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
