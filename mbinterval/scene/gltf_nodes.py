"""Nodes of a glTF file as transforms, moved by the channels of one animation clip."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbinterval.errors import SceneError
from mbinterval.scene.gltf_data import GltfData
from mbinterval.scene.tracks import Track, Transform

_INTERPOLATION = {"LINEAR": "linear", "STEP": "step", "CUBICSPLINE": "cubic"}

Channels = dict[tuple[int, str], Track]


def read_clip(data: GltfData, fps: float, clip: str | int | None, notes: list[str]) -> Channels:
    """Tracks of a clip by (node, path); its times in seconds become frames.

    ``clip`` is a name or an index; None takes the first clip and says so if there are others.
    """
    animations = data.document.animations or []
    names = [animation.name or str(index) for index, animation in enumerate(animations)]
    if clip is None:
        if len(animations) > 1:
            notes.append(f"{data.path.name}: clip {names[0]!r} of {', '.join(names)}")
        if not animations:
            return {}
        clip = 0
    index = names.index(clip) if clip in names else clip
    if not isinstance(index, int) or not 0 <= index < len(animations):
        known = ", ".join(names) or "none"
        raise SceneError(f"no clip {clip!r}; the file has: {known}")
    tracks: Channels = {}
    for channel in animations[index].channels:
        if channel.target.node is None:
            continue
        if channel.target.path == "weights":
            continue  # noted where the morph targets are met
        sampler = animations[index].samplers[channel.sampler]
        tracks[channel.target.node, channel.target.path] = _track(
            data, sampler, fps, channel.target.path
        )
    return tracks


def _track(data: GltfData, sampler: Any, fps: float, path: str) -> Track:
    interpolation = _INTERPOLATION.get(sampler.interpolation or "LINEAR")
    if interpolation is None:
        raise SceneError(f"unknown interpolation {sampler.interpolation!r}")
    frames = data.accessor(sampler.input).astype(np.float64) * fps
    values = data.accessor(sampler.output).astype(np.float64)
    if interpolation == "cubic":
        values = values.reshape(len(frames), 3, -1).copy()
        values[:, [0, 2]] /= fps  # tangents are per second
    # Some exporters write a time twice to make a jump: the later key counts.
    kept = np.append(np.diff(frames) != 0.0, True)
    return Track(frames[kept], values[kept], interpolation, quaternion=path == "rotation")


def walk_nodes(
    data: GltfData, tracks: Channels, root: Transform | None
) -> list[tuple[Any, Transform]]:
    """Every node of the default scene with its transform, parents before children."""
    document = data.document
    nodes = document.nodes or []
    if document.scenes:
        roots = document.scenes[document.scene or 0].nodes or []
    else:
        children = {child for node in nodes for child in node.children or ()}
        roots = [index for index in range(len(nodes)) if index not in children]
    waiting = [(index, root) for index in reversed(roots)]
    found: list[tuple[Any, Transform]] = []
    met: set[int] = set()
    while waiting:
        index, parent = waiting.pop()
        if index in met or not 0 <= index < len(nodes):
            raise SceneError(f"node {index} is missing or in the tree twice; the file is damaged")
        met.add(index)
        transform = _transform(nodes[index], index, tracks, parent)
        found.append((nodes[index], transform))
        waiting += [(child, transform) for child in reversed(nodes[index].children or ())]
    return found


def _transform(node: Any, index: int, tracks: Channels, parent: Transform | None) -> Transform:
    matrix = None
    if node.matrix:
        matrix = np.array(node.matrix, dtype=np.float64).reshape(4, 4).T
    return Transform(
        translation=tracks.get((index, "translation"), tuple(node.translation or (0, 0, 0))),
        rotation=tracks.get((index, "rotation"), tuple(node.rotation or (0, 0, 0, 1))),
        scale=tracks.get((index, "scale"), tuple(node.scale or (1, 1, 1))),
        matrix=matrix,
        parent=parent,
    )
