"""Pictures with shadows by brute force: rays to the lights, at many times of the shutter.

A sample sees the nearest triangle at its time, a mean of that triangle's vertices by the weights
of its edge functions; the vertices are where they are in the world at that time, linear between
the ends of a motion segment. A light is hidden while the straight way to it meets any other
triangle. What is translucent lets the share 1 - alpha pass. Nothing is solved and nothing is shared
with the kernels.
"""

from __future__ import annotations

import numpy as np

from mbinterval.exposure.exposure import Exposure
from mbinterval.scene.model import Light, Material

from .paths import NORMAL, Paths, paths_of
from .point_samples import Drawn, nearest_paths, path_circles
from .shading import phong, unit


def world_of(exposure: Exposure, paths: Paths, size: tuple[int, int]) -> np.ndarray:
    """Corners ``(P, 2, 3, 3)`` of the paths in the world: end of the segment, vertex, (x, y, z)."""
    width, height = size
    result = np.zeros(paths.points.shape)
    for k in range(len(paths)):
        poses = exposure.meshes[paths.mesh[k]].poses
        for end in range(2):
            pose = min(int(paths.segment[k]) + end, int(paths.segments[k]))
            x, y, w = paths.points[k, end].T
            p = np.stack([(x - width / 2 * w) / height, w / 2 - y / height, -w], axis=1)
            result[k, end] = poses.eye[pose] + np.linalg.solve(poses.view[pose], p.T).T
    return result


def weights_of(points: np.ndarray, circle: np.ndarray, tau: np.ndarray, at: Drawn) -> np.ndarray:
    """Weights ``(M, 3)`` of the vertices of paths ``(M, 2, 3, 3)`` where samples meet them."""
    t = tau[:, None, None]
    now = (1 - t) * points[:, 0] + t * points[:, 1]
    blur = (1 - t[..., 0]) * circle[:, 0] + t[..., 0] * circle[:, 1]
    x = now[..., 0] + at.u[:, None] * blur - at.x[:, None] * now[..., 2]
    y = now[..., 1] + at.v[:, None] * blur - at.y[:, None] * now[..., 2]
    e = np.stack([x[:, (i + 1) % 3] * y[:, (i + 2) % 3] - x[:, (i + 2) % 3] * y[:, (i + 1) % 3]
                  for i in range(3)], axis=1)  # fmt: skip
    return e / e.sum(axis=1, keepdims=True)


def reaching(
    light: Light, position: np.ndarray, t: np.ndarray, own: np.ndarray, paths: Paths,
    world: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Share ``(M,)`` of the light that reaches points ``(M, 3)`` of paths ``own`` at times t."""
    share = np.ones(len(position))
    if light.kind == "directional":
        way = np.broadcast_to(-np.asarray(light.direction), position.shape)
        far = np.inf
    else:
        way, far = np.asarray(light.position) - position, 1.0
    for k in range(len(paths)):
        low, high = paths.window[k]
        place = (t - low) / (high - low)
        there = (place >= 0) & (place <= 1) if paths.segments[k] else np.ones(len(t), bool)
        there &= own != k
        tau = np.clip(place, 0, 1)[there, None, None] if paths.segments[k] else 0.0
        a, b, c = np.moveaxis((1 - tau) * world[k, :1] + tau * world[k, 1:], 1, 0)
        p, d = position[there], way[there]
        normal = np.cross(b - a, c - a)
        facing = (normal * d).sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            s = ((a - p) * normal).sum(axis=1) / facing
            hit = p + s[:, None] * d
            sides = [(np.cross(q - r, hit - r) * normal).sum(axis=1)
                     for r, q in ((a, b), (b, c), (c, a))]  # fmt: skip
        between = (s > 1e-9) & (s < far) & (np.min(sides, axis=0) >= 0)
        passed = 0.0 if paths.opaque[k] else 1.0 - paths.alpha[k]
        share[np.flatnonzero(there)[between]] *= passed
    return share


def render_shadows(exposure: Exposure, size: tuple[int, int], drawn: Drawn) -> np.ndarray:
    """Colour ``(..., 3)`` that samples see, over the background; no texture, opaque receivers."""
    width, height = size
    paths = paths_of(exposure, width, height, attributes=True)
    world, circle = world_of(exposure, paths, size), path_circles(exposure, paths, height)
    seen, _, _ = nearest_paths(exposure, width, height, drawn)
    own = seen.ravel()
    flat = Drawn(*(part.ravel() for part in drawn))
    color = np.tile(np.asarray(exposure.background, float), (own.size, 1))
    hit = np.flatnonzero(own >= 0)
    own, at = own[hit], Drawn(*(part[hit] for part in flat))
    tau = np.where(paths.segments[own] > 0, paths.local(own, at.t), 0.0)
    weight = weights_of(paths.points[own], circle[own], tau, at)[..., None]
    mix = tau[:, None, None]
    position = (weight * ((1 - mix) * world[own, 0] + mix * world[own, 1])).sum(axis=1)
    attributes = (1 - mix) * paths.attributes[own, 0] + mix * paths.attributes[own, 1]
    normal = unit((weight * attributes).sum(axis=1)[:, NORMAL])
    for index in np.unique(paths.mesh[own]):
        mesh = exposure.meshes[index]
        one = np.flatnonzero(paths.mesh[own] == index)
        material = mesh.mesh.material or Material()
        base = paths.color[own[one]]
        if material.shading == "unlit":
            color[hit[one]] = base
            continue
        view = unit(_eye(exposure, at.t[one]) - position[one])
        facing = (normal[one] * view).sum(axis=1, keepdims=True)
        side = np.where(facing < 0, -1.0, 1.0) if material.double_sided else 1.0
        total = np.zeros((len(one), 3))
        for light in exposure.lights:
            part = phong(material, base, position[one], side * normal[one], view, light)
            if light.shadows:
                lit = reaching(light, position[one], at.t[one], own[one], paths, world)
                part = part * lit[:, None]
            total += part
        color[hit[one]] = total
    return color.reshape(*drawn.t.shape, 3)


def _eye(exposure: Exposure, t: np.ndarray) -> np.ndarray:
    first, last = (poses.eye[0] for poses in exposure.path.ends)
    return (1 - t[:, None]) * first + t[:, None] * last


def over_time(exposure: Exposure, size: tuple[int, int], times: int) -> np.ndarray:
    """Picture ``(h, w, 3)`` at the pixels' centres: the mean over so many times."""
    width, height = size
    y, x = np.mgrid[0:height, 0:width] + 0.5
    total = np.zeros((height, width, 3))
    for chunk in np.array_split((np.arange(times) + 0.5) / times, max(times // 64, 1)):
        shape = (len(chunk), height, width)
        zero = np.zeros(shape)
        t = np.broadcast_to(chunk[:, None, None], shape)
        drawn = Drawn(np.broadcast_to(x, shape), np.broadcast_to(y, shape), t, zero, zero)
        total += render_shadows(exposure, size, drawn).sum(axis=0)
    return total / times
