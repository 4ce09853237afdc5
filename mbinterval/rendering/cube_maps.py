"""Cube maps as the kernels read them: made of environments, and of pictures of surroundings.

A map has levels. The first is what is there; each of the others is what a rough surface mirrors
that is seen head-on: the mean over GGX's half-way directions, weighed by the cosine (Karis 2013,
"Real Shading in Unreal Engine 4"). Roughness squared, alpha, is 1 at the last level and half as
much at each one before it. ``cl/shared/cube_map.h`` says how texels lie.
"""

from __future__ import annotations

import weakref
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.device import records
from mbinterval.device.runtime import Runtime
from mbinterval.rendering.panorama import PANORAMA, picture
from mbinterval.scene.environment import Environment

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

IRRADIANCE_SIZE = 16
"""Steps along an edge of the cube for Lambert's surfaces (``cl/shared/environment.h``)."""
SHARES = (32, 64)
"""Rows, of roughness, and columns, of cosines, of the table of what facets reflect (likewise)."""
_SIZES = (16, 2048)
_DIRECTIONS = (64, 1024)
"""That a level's texels are the mean of: the finest's, and, twice as many by level, the most."""
_LEAST, _FINEST = 8, 6
"""Least size of a level; the finest level that is not sharp is for an alpha of 1/64."""
_IRRADIANCE_ROWS = 64
_DARK = 1e-30  # light that a block without any has, so that it has a direction
_ready: weakref.WeakKeyDictionary[Environment, dict[int, Float32]] = weakref.WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class CubeMaps:
    """``CubeMap`` records, and the texels ``(n, 4)`` of all of them behind the table of shares."""

    maps: NDArray[np.void]
    texels: Float32


def level_sizes(size: int) -> list[int]:
    """Steps along an edge of each level of a map of that size."""
    rough = range(min(int(np.log2(size)) - 2, _FINEST), -1, -1)  # alpha is 2**-k
    return [size, *(max(_LEAST, 4 << k) for k in rough)]


def texel_count(size: int) -> int:
    """Texels of a level."""
    return 6 * (size + 1) ** 2


def map_texels(size: int) -> int:
    """Texels of all levels of a map of that size."""
    return sum(map(texel_count, level_sizes(size)))


def environment_size(environment: Environment) -> int:
    """Steps along an edge that have texels as wide, in the middle of a face, as the image's."""
    return int(np.clip(round(environment.image.shape[1] / np.pi), *_SIZES))


def directions(size: int) -> Float64:
    """``(6, size + 1, size + 1, 3)``: unit vectors to the texels of a level."""
    u = np.linspace(-1.0, 1.0, size + 1)
    rows, columns = np.meshgrid(u, u, indexing="ij")
    faces = []
    for face in range(6):
        axis = face // 2
        along = np.full_like(rows, -1.0 if face % 2 else 1.0)
        parts = [along, columns, rows]
        faces.append(np.stack([parts[(k - axis) % 3] for k in range(3)], axis=-1))
    found = np.array(faces)
    return np.asarray(found / np.linalg.norm(found, axis=-1, keepdims=True))


def gather(
    runtime: Runtime, environment: Environment | None, surroundings: list[Float32]
) -> CubeMaps:
    """Make the maps of a frame: the environment's, without levels if there is none, and others.

    ``surroundings`` are pictures ``(times, 6, n + 1, n + 1, 3)``.
    """
    table = np.zeros(1 + len(surroundings), records.CUBE_MAP)
    parts = [shares().reshape(-1, 4)]
    first = len(parts[0])
    if environment is not None:
        texels = _environment_texels(runtime, environment)
        _fill(table[0], environment_size(environment), 1, first)
        table[0]["irradiance"] = first + map_texels(environment_size(environment))
        parts.append(texels)
        first += len(texels)
    for row, pictures in zip(table[1:], surroundings, strict=True):
        size = pictures.shape[2] - 1
        _fill(row, size, len(pictures), first)
        for faces in pictures:
            texels = np.ones((texel_count(size), 4), np.float32)
            texels[:, :3] = faces.reshape(-1, 3)
            parts.append(_filtered(runtime, runtime.upload("float4", texels, "surroundings"), size))
            first += len(parts[-1])
    return CubeMaps(table, np.concatenate(parts))


def _fill(row: Any, size: int, times: int, first: int) -> None:
    sizes = level_sizes(size)
    counts = [texel_count(level) for level in sizes]
    row["levels"], row["times"], row["stride"] = len(sizes), times, sum(counts)
    row["size"][: len(sizes)] = sizes
    row["first"][: len(sizes)] = first + np.append(0, np.cumsum(counts[:-1]))


def _environment_texels(runtime: Runtime, environment: Environment) -> Float32:
    """Levels and irradiance of an environment; kept, since a batch asks for them every frame."""
    known = _ready.setdefault(environment, {})
    device = int(runtime.device.int_ptr)
    if device not in known:
        size = environment_size(environment)
        level = runtime.allocate("float4", texel_count(size), "environment")
        arguments = {
            **{
                name: runtime.upload(PANORAMA[name], array, name)
                for name, array in picture(environment).items()
            },
            "size": size,
            "texels": level,
        }
        kernel = runtime.kernel("shared/cube_map.cl", "project")
        runtime.run(kernel, 6 * (size + 1), arguments)
        around = np.ones((6, IRRADIANCE_SIZE + 1, IRRADIANCE_SIZE + 1, 4), np.float32)
        around[..., :3] = irradiance(environment, directions(IRRADIANCE_SIZE))
        known[device] = np.concatenate([_filtered(runtime, level, size), around.reshape(-1, 4)])
    return known[device]


def irradiance(environment: Environment, normals: Float64) -> Float64:
    """Light that Lambert's surfaces with those unit ``normals`` ``(..., 3)`` scatter, over pi.

    The integral of the environment times the cosine: a sum over blocks of its pixels, each in the
    mean direction of its light, so that small lamps are where they are. Pixels of small images are
    divided before.
    """
    image = environment.image
    often = -(-_IRRADIANCE_ROWS // len(image))
    image = np.repeat(np.repeat(image, often, axis=0), often, axis=1)
    height, width = image.shape[:2]
    turn = 2.0 * np.pi * (np.arange(width) + 0.5) / width - np.pi
    turn = turn - np.radians(environment.rotation % 360.0)
    starts = np.linspace(0, width, 2 * _IRRADIANCE_ROWS, endpoint=False).astype(int)
    rows = np.linspace(0, height, _IRRADIANCE_ROWS + 1).astype(int)
    light, middle = [], []
    for first, last in pairwise(rows):
        edge = np.pi * np.arange(first, last + 1)[:, None] / height
        up = 0.5 * np.pi - 0.5 * (edge[1:] + edge[:-1])
        out = np.cos(up)
        ways = [out * np.sin(turn), np.sin(up) + 0.0 * turn, -out * np.cos(turn)]
        angles = -np.diff(np.cos(edge), axis=0) * 2.0 * np.pi / width  # solid, of pixels
        here = image[first:last].astype(np.float64)
        weight = (here.mean(axis=2) + _DARK) * angles
        light.append(np.add.reduceat((here * angles[..., None]).sum(axis=0), starts))
        mean = np.stack([(way * weight).sum(axis=0) for way in ways], axis=-1)
        middle.append(np.add.reduceat(mean, starts))
    ways_of_blocks = np.concatenate(middle)
    ways_of_blocks /= np.linalg.norm(ways_of_blocks, axis=-1, keepdims=True)
    all_light = environment.intensity / np.pi * np.concatenate(light)
    found = [np.maximum(row @ ways_of_blocks.T, 0.0) @ all_light for row in normals.reshape(-1, 3)]
    return np.reshape(found, normals.shape)


def _filtered(runtime: Runtime, level: Any, size: int) -> Float32:
    """Return all levels ``(n, 4)`` of a map whose first ``level`` is on the device."""
    sizes = [size]
    while sizes[-1] > 4:
        sizes.append(sizes[-1] // 2)
    record = np.zeros(1, records.CUBE_MAP)
    counts = [texel_count(step) for step in sizes]
    record["levels"], record["size"][0, : len(sizes)] = len(sizes), sizes
    record["first"][0, : len(sizes)] = np.append(0, np.cumsum(counts[:-1]))
    chain = [runtime.download(level, (counts[0], 4), np.float32)]
    for given, step in pairwise(sizes):
        finer = runtime.upload("float4", chain[-1], "a level of a cube map")
        chain.append(_rows(runtime, "halve", step, given=finer, given_size=given))
    source = {
        "given": runtime.upload("CubeMap", record, "a cube map"),
        "given_texels": runtime.upload("float4", np.concatenate(chain), "levels"),
    }
    parts = [chain[0]]
    rough = level_sizes(size)[1:]
    for index, step in enumerate(rough):
        count = min(_DIRECTIONS[0] << index, _DIRECTIONS[1])
        toward = lobe(0.5 ** (len(rough) - 1 - index), size, count)
        ways = {"lobe": runtime.upload("float4", toward, "a lobe"), "directions": len(toward)}
        parts.append(_rows(runtime, "prefilter", step, **source, **ways))
    return np.concatenate(parts)


def _rows(runtime: Runtime, name: str, size: int, **arguments: Any) -> Float32:
    """Run a kernel for each row of texels of a level; return these ``(n, 4)``."""
    texels = runtime.allocate("float4", texel_count(size), "a level of a cube map")
    kernel = runtime.kernel("shared/cube_map.cl", name)
    runtime.run(kernel, 6 * (size + 1), {**arguments, "size": size, "texels": texels})
    return runtime.download(texels, (texel_count(size), 4), np.float32)


@lru_cache(maxsize=64)
def lobe(alpha: float, size: int, count: int) -> Float32:
    """``(n, 4)``: unit vectors about +z that GGX facets of ``alpha`` mirror the view along +z in.

    They are ``count``, but for those below the horizon, and weigh their third coordinate. The
    fourth number is the level of a chain of halved maps of ``size`` whose texels are as wide as
    what each vector stands for (Křivánek & Colbert 2008).
    """
    k = np.arange(count)
    part = (k + 0.5) / count
    tangent = alpha**2 * part / (1.0 - part)
    cosine = 1.0 / np.sqrt(1.0 + tangent)
    turn = 2.0 * np.pi * ((k * (np.sqrt(5.0) - 1.0) / 2.0) % 1.0)
    out = np.sqrt(1.0 - cosine**2)
    along = 2.0 * cosine**2 - 1.0
    across = 2.0 * cosine * out
    # Density of the mirrored direction: the distribution over 4, as the view is along the normal.
    spread = cosine**2 * (alpha**2 - 1.0) + 1.0
    density = alpha**2 / (np.pi * spread**2) / 4.0
    texel = 4.0 * np.pi / (6.0 * size**2)
    level = 0.5 * np.log2(1.0 / (count * density * texel))
    found = np.stack([across * np.cos(turn), across * np.sin(turn), along, level], axis=1)
    return found[along > 0.0].astype(np.float32)


@lru_cache(maxsize=1)
def shares() -> Float32:
    """``(*SHARES, 4)``: what GGX facets reflect of light that is the same from everywhere.

    By roughness and cosine to the view: times the colour that is mirrored head-on, in addition to
    it, and the share of light that Fresnel's term takes from what Lambert's model scatters. The
    last column is not used. Facets are drawn by their distribution (Karis 2013), masked on both
    ways by Smith's term, as in ``cl/shared/shading.h``.
    """
    rows, columns, radial, around = *SHARES, 64, 64
    cosine = np.maximum(np.linspace(0.0, 1.0, columns), 1e-4)[:, None, None]
    view = np.stack([np.sqrt(1.0 - cosine**2), 0.0 * cosine, cosine], axis=-1)
    part = ((np.arange(radial) + 0.5) / radial)[:, None]
    turn = 2.0 * np.pi * (np.arange(around) + 0.5)[None] / around
    table = np.zeros((rows, columns, 4))
    for row, rough in enumerate(np.linspace(0.0, 1.0, rows)):
        square = max(rough, 0.03) ** 4
        up = 1.0 / np.sqrt(1.0 + square * part / (1.0 - part))
        out = np.sqrt(1.0 - up**2)
        half = np.stack([out * np.cos(turn), out * np.sin(turn), up + 0.0 * turn], axis=-1)
        facing = (view * half).sum(axis=-1)
        light = np.maximum(2.0 * facing * half[..., 2] - cosine, 0.0)

        def unmasked(c: Float64, square: float = square) -> Float64:
            return 1.0 / (c + np.sqrt(square + (1.0 - square) * c**2))

        weight = 4.0 * unmasked(cosine) * unmasked(light) * light * facing / half[..., 2]
        weight = np.where((light > 0.0) & (facing > 0.0), weight, 0.0)
        fifth = (1.0 - np.clip(facing, 0.0, 1.0)) ** 5
        table[row, :, 0] = (weight * (1.0 - fifth)).mean(axis=(1, 2))
        table[row, :, 1] = (weight * fifth).mean(axis=(1, 2))
    height = np.sqrt(part)  # the cosine, for the share of Lambert's light
    ways = np.stack([np.sqrt(1.0 - part) * np.cos(turn), np.sqrt(1.0 - part) * np.sin(turn),
                     height + 0.0 * turn], axis=-1)  # fmt: skip
    square_half = 0.5 * (1.0 + (view * ways).sum(axis=-1))  # cos^2 of half the angle between
    lost = (1.0 - np.sqrt(np.clip(square_half, 0.0, 1.0))) ** 5
    table[:, :, 2] = lost.mean(axis=(1, 2))
    return table.astype(np.float32)
