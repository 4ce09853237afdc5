"""Rays through scenes with mirrors, in float64: an oracle that shares nothing with the kernels.

A scene here is a list of `Surface`, triangles that move linearly. Rays go through the centres of
pixels at many times, and where they meet a mirror on, from there, in the mirrored direction; of a
glossy one in a direction near it, which leads off by (a, b) for each unit of distance from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbinterval.scene.model import Camera, Light, Material, Mesh, Scene

FOV = 50.0
CAMERA = Camera(position=(0, 0, 0), look_at=(0, 0, -1), fov=FOV)
BACKGROUND = (0.15, 0.3, 0.2)


@dataclass(frozen=True, eq=False)
class Surface:
    """One mesh: triangles ``(F, 2, 3, 3)`` at both ends of the shutter, one colour for all.

    ``lit`` surfaces are Phong's, with highlights of ``specular``.
    """

    corners: np.ndarray
    color: tuple[float, ...]
    opacity: float = 1.0
    reflectivity: float = 0.0
    shear: float = 0.0
    lit: bool = False
    specular: float = 0.0

    @property
    def mesh(self) -> Mesh:
        ends = np.moveaxis(self.corners, 1, 0).reshape(2, -1, 3)
        material = Material(
            base_color=self.color, opacity=self.opacity, reflectivity=self.reflectivity,
            reflection_shear=self.shear,
            shading="phong" if self.lit else "unlit", specular=(self.specular,) * 3,
            shininess=SHININESS,
        )  # fmt: skip
        still = np.array_equal(ends[0], ends[1])
        faces = np.arange(3 * len(self.corners)).reshape(-1, 3)
        return Mesh(positions=ends[0] if still else ends, faces=faces, material=material)


SHININESS = 10.0


def scene(surfaces: Sequence[Surface], lights: Sequence[Light] = ()) -> Scene:
    return Scene(
        meshes=[surface.mesh for surface in surfaces], camera=CAMERA, lights=lights,
        background=BACKGROUND,
    )  # fmt: skip


def traced(
    surfaces: Sequence[Surface], size: tuple[int, int], times: int, lights: Sequence[Light] = ()
) -> np.ndarray:
    """The film's colours ``(height, width, 3)``: the mean over as many times."""
    rays = _Rays(surfaces, lights)
    directions = _directions(size)
    found = np.zeros_like(directions)
    for time in (np.arange(times) + 0.5) / times:
        rays.freeze(time)
        found += rays.seen(np.zeros_like(directions), directions, bounce=True)
    return (found / times).reshape(size[1], size[0], 3)


def sampled(
    surfaces: Sequence[Surface],
    size: tuple[int, int],
    times: int,
    rng: np.random.Generator,
    lights: Sequence[Light] = (),
) -> np.ndarray:
    """Likewise with random places in the pixels and on the discs of glossy mirrors."""
    rays, found = _Rays(surfaces, lights), np.zeros((size[0] * size[1], 3))
    for time in (np.arange(times) + rng.uniform(size=times)) / times:
        rays.freeze(time)
        radius, turn = np.sqrt(rng.uniform(size=len(found))), rng.uniform(0, 2 * np.pi, len(found))
        rays.disc = radius[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        directions = _directions(size, rng.uniform(size=(len(found), 2)))
        found += rays.seen(np.zeros_like(directions), directions, bounce=True)
    return (found / times).reshape(size[1], size[0], 3)


def _directions(size: tuple[int, int], within: np.ndarray | float = 0.5) -> np.ndarray:
    width, height = size
    reach = np.tan(np.radians(FOV / 2))
    row, column = np.divmod(np.arange(width * height), width)
    x, y = (np.stack([column, row], axis=1) + within).T
    across = (x / width * 2 - 1) * reach * width / height
    return np.stack([across, -(y / height * 2 - 1) * reach, -np.ones_like(across)], axis=-1)


class _Rays:
    def __init__(self, surfaces: Sequence[Surface], lights: Sequence[Light]) -> None:
        self.surfaces, self.lights = surfaces, lights
        self.corners = np.concatenate([surface.corners for surface in surfaces])
        self.disc: np.ndarray | None = None  # of each ray's mirrored direction
        self.owner = np.repeat(np.arange(len(surfaces)), [len(s.corners) for s in surfaces])

    def freeze(self, time: float) -> None:
        self.now = (1 - time) * self.corners[:, 0] + time * self.corners[:, 1]
        across, along = self.now[:, 1] - self.now[:, 0], self.now[:, 2] - self.now[:, 0]
        normals = np.cross(across, along)
        self.normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)

    def hits(self, origin: np.ndarray, way: np.ndarray) -> np.ndarray:
        """``(N, F)`` distances along the rays, infinite where they miss (Möller & Trumbore)."""
        found = np.full((len(origin), len(self.now)), np.inf)
        for face, (a, b, c) in enumerate(self.now):
            e1, e2 = b - a, c - a
            p = np.cross(way, e2)
            with np.errstate(all="ignore"):
                over, s = 1.0 / (p @ e1), origin - a
                q = np.cross(s, e1)
                u, v = np.sum(s * p, axis=1) * over, np.sum(way * q, axis=1) * over
                t = (q @ e2) * over
                inside = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-9)
            found[inside, face] = t[inside]
        return found

    def passed(self, origin: np.ndarray, way: np.ndarray) -> np.ndarray:
        """Shares of light that pass from the rays' ends to their starts."""
        met = self.hits(origin, way) < 1.0
        opacity = np.array([surface.opacity for surface in self.surfaces])[self.owner]
        return np.prod(np.where(met, 1.0 - opacity, 1.0), axis=1)

    def seen(self, origin: np.ndarray, way: np.ndarray, bounce: bool) -> np.ndarray:
        """Colours at the ends of rays, past what is translucent."""
        distances, color = self.hits(origin, way), np.zeros_like(way)
        rest = np.ones(len(way))
        while True:
            face = distances.argmin(axis=1)
            t = distances[np.arange(len(way)), face]
            if not np.isfinite(t[rest > 0]).any():
                return color + rest[:, None] * BACKGROUND
            for index, surface in enumerate(self.surfaces):
                on = (self.owner[face] == index) & np.isfinite(t) & (rest > 0)
                if not on.any():
                    continue
                at, ways = origin[on] + t[on, None] * way[on], way[on]
                own = self.shaded(surface, at, ways, self.normals[face[on]])
                if surface.reflectivity and bounce:
                    normal = self.normals[face[on]]
                    along = np.sum(ways * normal, axis=1)[:, None]
                    turned = ways - 2 * along * normal
                    if self.disc is not None and surface.shear:
                        first = np.cross(normal, [0.3, -0.5, 0.8])
                        first /= np.linalg.norm(first, axis=1, keepdims=True)
                        off = self.disc[on] * surface.shear * np.abs(along)
                        turned += off[:, :1] * first + off[:, 1:] * np.cross(normal, first)
                    share = surface.reflectivity
                    own = (1 - share) * own + share * self.seen(at, turned, bounce=False)
                color[on] += (rest[on] * surface.opacity)[:, None] * own
                rest[on] *= 1 - surface.opacity
            distances[np.arange(len(way)), face] = np.inf

    def shaded(
        self, surface: Surface, at: np.ndarray, way: np.ndarray, normal: np.ndarray
    ) -> np.ndarray:
        if not surface.lit:
            return np.broadcast_to(surface.color, at.shape)
        view = -way / np.linalg.norm(way, axis=1, keepdims=True)
        normal = normal * np.where(np.sum(normal * view, axis=1) < 0, -1.0, 1.0)[:, None]
        found = np.zeros_like(at)
        for light in self.lights:
            if light.kind == "ambient":
                found += np.multiply(light.color, light.intensity) * surface.color
                continue
            towards = -np.asarray(light.direction) + 0 * at
            if light.kind != "directional":
                towards = np.asarray(light.position) - at
            distance = np.linalg.norm(towards, axis=1, keepdims=True)
            towards /= distance
            strength = light.intensity * (1.0 if light.kind == "directional" else distance**-2)
            if light.kind == "spot":
                axis = np.asarray(light.direction) / np.linalg.norm(light.direction)
                inner, outer = np.cos(np.radians([light.inner_angle, light.outer_angle]))
                cosine = -(towards @ axis)[:, None]
                strength = strength * np.clip((cosine - outer) / (inner - outer), 0, 1) ** 2
            if light.shadows:
                end = 1e6 if light.kind == "directional" else distance
                strength = strength * self.passed(at, towards * end)[:, None]
            cosine = np.sum(normal * towards, axis=1, keepdims=True)
            mirrored = 2 * cosine * normal - towards
            shine = np.maximum(np.sum(mirrored * view, axis=1, keepdims=True), 0) ** SHININESS
            both = np.maximum(cosine, 0) * surface.color + (cosine > 0) * shine * surface.specular
            found += np.asarray(light.color) * strength * both
        return found
