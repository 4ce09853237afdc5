"""The film: means over instants, places in the pixel and points of the lens, in repeats.

Each repeat draws its instants in as many strata as it has, and with each of them, for each pixel,
a place in the reach of the filter, a point of the lens and one of the disc of glossy mirrors: from
an additive sequence (Roberts 2018, "The unreasonable effectiveness of quasirandom sequences") that
begins anywhere. So repeats are independent, and every mean is right on average.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from . import camera as cameras
from . import exposure, filters
from .cast import BLOCK, Hits, Triangles
from .motion import freeze
from .shade import Lines, Rays, Seen, World, joined


@dataclass(frozen=True)
class Asked:
    """How to sample: ``strata`` instants in each of ``repeats``.

    With ``centre`` samples lie in the middle of their pixels, and there is no filter. ``depths``
    are those below which alpha is added up. ``moment`` is the part of the exposure at which all
    instants are, instead of being drawn, or those of the repeats. With a ``part`` of the exposure
    it alone counts, and the shutter is open throughout. All places are moved by ``shift`` pixels.
    The filter "five_point" is the rule of that name for samples in the middle.
    """

    strata: int = 64
    repeats: int = 8
    centre: bool = False
    filter: str = "box"
    radius: float | None = None
    shadows: str = "lights"
    depths: Sequence[float] = ()
    moment: float | tuple[float, ...] | None = None
    part: tuple[float, float] | None = None
    transparent: bool = False
    shift: tuple[float, float] = (0.0, 0.0)
    seed: int = 1


@dataclass(frozen=True, eq=False)
class Repeats:
    """Films ``(R, H, W, ...)``: colour over the background and alpha; ``depth`` is the mean of
    depth times alpha; ``cover`` alpha by mesh; ``below`` alpha before each of the depths asked for.
    """

    rgba: np.ndarray
    depth: np.ndarray
    cover: np.ndarray
    below: np.ndarray


def _steps(count: int) -> np.ndarray:
    """Roberts's additive steps: powers of 1/g where g^(count + 1) = g + 1."""
    g = 1.0
    for _ in range(60):
        g = (1.0 + g) ** (1.0 / (count + 1))
    return g ** -np.arange(1.0, count + 1)


def film(scene: Any, frame: float, size: tuple[int, int], asked: Asked) -> Repeats:
    """Repeats of the film of ``scene`` at ``frame``, ``size`` pixels wide and high."""
    width, height = size
    rng = np.random.default_rng(asked.seed)
    repeats, strata = asked.repeats, asked.strata
    lines, opens = _lines(scene, size)
    after = _after(scene, asked, rng)
    # Groups of rays at one instant: each line at each instant of each repeat.
    shape = repeats, len(lines), strata
    instants = (opens[:, None] + after).reshape(-1)
    pixels = np.broadcast_to(lines[None, :, None], (*shape, *lines.shape[1:]))
    pixels = pixels.reshape(len(instants), -1, 2)
    begin = rng.uniform(size=(*shape[:2], 1, lines.shape[1], 6))
    drawn = (begin + np.arange(strata)[:, None, None] * _steps(6)) % 1.0
    drawn = drawn.reshape(len(instants), -1, 6)
    repeat = np.arange(repeats).repeat(len(lines) * strata)
    total = [
        np.zeros((repeats, height, width, n)) for n in (4, 1, len(scene.meshes), len(asked.depths))
    ]
    block = max(BLOCK // (lines.shape[1] * max(_faces(scene), 1)), 1)
    for first in range(0, len(instants), block):
        part = slice(first, first + block)
        values = _groups(scene, frame, instants[part], pixels[part], drawn[part], size, asked)
        # Instants of one line in one repeat follow each other.
        new = np.arange(first, min(first + block, len(instants)))
        new = new[(new % strata == 0) | (new == first)]
        where = repeat[new][:, None], pixels[new, :, 1], pixels[new, :, 0]
        for sums, value in zip(total, values, strict=True):
            each = value.reshape(len(instants[part]), lines.shape[1], value.shape[1])
            sums[where] += np.add.reduceat(each, new - first, axis=0) / strata
    found = Repeats(total[0], total[1][..., 0], total[2], total[3])
    return _five_points(found) if asked.filter == "five_point" else found


def _after(scene: Any, asked: Asked, rng: np.random.Generator) -> np.ndarray:
    """When instants are, ``(R, 1, strata)``, in frames after the opening of their line."""
    shape = asked.repeats, 1, asked.strata
    if asked.moment is not None:
        moments = np.reshape(asked.moment, (-1, 1, 1))
        return np.broadcast_to(moments, shape) * exposure.length(scene)
    share = (np.arange(asked.strata) + rng.uniform(size=shape)) / asked.strata
    if asked.part is None:
        return exposure.opened(scene, share)
    low, high = asked.part
    return exposure.length(scene) * (low + (high - low) * share)


def _five_points(centres: Repeats) -> Repeats:
    """Pixels' averages: the value at their centre and a 24th of the Laplacian there.

    That is told by the four pixels beside them; beyond the frame a pixel stands for what is not.
    """

    def average(values: np.ndarray) -> np.ndarray:
        padded = np.pad(values, ((0, 0), (1, 1), (1, 1), *((0, 0),) * (values.ndim - 3)), "edge")
        beside = padded[:, :-2, 1:-1] + padded[:, 2:, 1:-1]
        beside = beside + padded[:, 1:-1, :-2] + padded[:, 1:-1, 2:]
        return values + (beside - 4.0 * values) / 24.0

    parts = (getattr(centres, item.name) for item in fields(Repeats))
    return Repeats(*map(average, parts))


def _lines(scene: Any, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Pixels, x and y, of each line ``(L, P, 2)``, and when each opens; one line is the frame."""
    place = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1)
    starts = exposure.line_starts(scene, size)
    if starts is None:
        return place.reshape(1, -1, 2), np.array([scene.shutter.open])
    return place.swapaxes(0, 1) if scene.shutter.rolling in ("left", "right") else place, starts


def _faces(scene: Any) -> int:
    return sum(len(mesh.faces) for mesh in scene.meshes)


def _groups(
    scene: Any,
    frame: float,
    instants: np.ndarray,
    pixels: np.ndarray,
    drawn: np.ndarray,
    size: tuple[int, int],
    asked: Asked,
) -> list[np.ndarray]:
    weight = np.ones(pixels.shape[:2])
    places = pixels + 0.5 + np.array(asked.shift)
    if not asked.centre:
        x, sign_x = filters.draw(asked.filter, asked.radius, drawn[..., 0])
        y, sign_y = filters.draw(asked.filter, asked.radius, drawn[..., 1])
        places, weight = places + np.stack([x, y], axis=-1), sign_x * sign_y
    lens = cameras.lens_points(scene.camera, drawn[..., 2:4])
    poses = cameras.poses_at(scene.camera, frame + instants, size[0] / size[1])
    world = World(
        scene,
        Triangles(freeze(scene, frame, instants, exposure.window(scene, size))),
        asked.shadows,
    )
    rays, hits = primary(world, scene.camera, poses, places, lens, size)
    disc = np.sqrt(drawn[..., 4:5]) * np.concatenate(
        [np.cos(2 * np.pi * drawn[..., 5:]), np.sin(2 * np.pi * drawn[..., 5:])], axis=-1
    )
    behind = _background(scene, pixels)
    rays = replace(rays, behind=behind, disc=disc.reshape(-1, 2))
    seen = world.look(rays, hits, keep=bool(asked.depths))
    color = seen.color
    if not asked.transparent:
        color = color + seen.left[:, None] * world.behind(rays)
    by = weight.reshape(-1, 1)
    below = [_below(seen, depth) for depth in asked.depths]
    return [
        by * np.concatenate([color, 1.0 - seen.left[:, None]], axis=1),
        by * seen.depth[:, None],
        by * seen.cover,
        by * np.stack(below, axis=1) if below else np.zeros((len(by), 0)),
    ]


def _below(seen: Seen, depth: float) -> np.ndarray:
    found = np.zeros_like(seen.left)
    for z, added in seen.layers:
        found += np.where(z < depth, added, 0.0)
    return found


def _background(scene: Any, pixels: np.ndarray) -> np.ndarray:
    background = np.asarray(scene.background, np.float64)
    flat = pixels.reshape(-1, 2)
    if background.ndim == 1:
        return np.broadcast_to(background, (len(flat), 3))
    return background[flat[:, 1], flat[:, 0]]


def primary(
    world: World,
    camera: Any,
    poses: cameras.Poses,
    places: np.ndarray,
    lens: np.ndarray | None,
    size: tuple[int, int],
) -> tuple[Rays, Hits]:
    """Rays from the eye and what they meet; of bent ones the piece that each hit lies on.

    The rays that are returned are the farthest pieces; hits of nearer ones have their distances,
    which are depths on all pieces.
    """
    pieces = cameras.rays(camera, poses, places, lens, size)
    groups, count = places.shape[:2]
    group = np.arange(groups).repeat(count)
    eye = poses.eye.repeat(count, axis=0)
    found: Hits | None = None
    bent = []
    for piece in pieces:
        hits = world.triangles.meet_all(piece.start, piece.way)
        low, high = (np.broadcast_to(b, (groups, 1)).repeat(count) for b in (piece.low, piece.high))
        found = joined(found, hits, low, high)
        bent.append(Lines(piece.start.reshape(-1, 3), piece.way.reshape(-1, 3), low, high))
    last = bent[-1]
    rays = Rays(group, last.start, last.way, eye, np.zeros((len(group), 3)))
    return replace(rays, bent=tuple(bent) if len(bent) > 1 else ()), found
