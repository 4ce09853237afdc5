"""Nodes of a glTF file as transforms, moved by the channels of one animation clip."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mbinterval.errors import SceneError
from mbinterval.scene.formats.gltf.data import GltfData, item_at
from mbinterval.scene.tracks import Track
from mbinterval.scene.transforms import Transform

_INTERPOLATION = {"LINEAR": "linear", "STEP": "step", "CUBICSPLINE": "cubic"}


@dataclass(frozen=True)
class Clip:
    """Tracks by (node, path), and the frames of the first and the last key; None without keys."""

    tracks: dict[tuple[int, str], Track] = field(default_factory=dict)
    span: tuple[float, float] | None = None


def read_clip(data: GltfData, fps: float, clip: str | int | None, notes: list[str]) -> Clip:
    """Read an animation clip; its times in seconds become frames.

    ``clip`` is a name or an index; None takes the first clip and says so if there are others.
    """
    animations = data.document.animations or []
    names = [animation.name or str(index) for index, animation in enumerate(animations)]
    if clip is None:
        if len(animations) > 1:
            notes.append(f"{data.path.name}: clip {names[0]!r} of {', '.join(names)}")
        if not animations:
            return Clip()
        clip = 0
    index = names.index(clip) if clip in names else clip
    if not isinstance(index, int) or not 0 <= index < len(animations):
        known = ", ".join(names) or "none"
        raise SceneError(f"no clip {clip!r}; the file has: {known}")
    tracks: dict[tuple[int, str], Track] = {}
    for number, channel in enumerate(animations[index].channels):
        if channel.target.node is None:
            continue
        try:
            sampler = item_at(animations[index].samplers, channel.sampler, "sampler")
            track = _track(data, sampler, fps, channel.target.path)
        except SceneError as error:
            raise SceneError(f"animations[{index}].channels[{number}]: {error}") from None
        tracks[channel.target.node, channel.target.path] = track
    ends = [end for track in tracks.values() for end in (track.frames[0], track.frames[-1])]
    return Clip(tracks, (float(min(ends)), float(max(ends))) if ends else None)


def _track(data: GltfData, sampler: Any, fps: float, path: str) -> Track:
    interpolation = _INTERPOLATION.get(sampler.interpolation or "LINEAR")
    if interpolation is None:
        raise SceneError(f"unknown interpolation {sampler.interpolation!r}")
    frames = data.accessor(sampler.input).astype(np.float64) * fps
    values = data.accessor(sampler.output).astype(np.float64)
    if frames.ndim != 1:
        raise SceneError(f"times of a {path} channel are no SCALAR; the file is damaged")
    per_key = 3 if interpolation == "cubic" else 1
    size = values.size // max(len(frames) * per_key, 1)
    if not size or size * len(frames) * per_key != values.size:
        raise SceneError(
            f"a {path} channel has {len(frames)} times and {values.size} numbers; "
            "the file is damaged"
        )
    values = values.reshape(len(frames), per_key, size)
    # Tangents are per second.
    values = values / [[fps], [1.0], [fps]] if per_key == 3 else values[:, 0]
    # Some exporters write a time twice to make a jump: the later key counts.
    kept = np.append(np.diff(frames) != 0.0, True)
    return Track(frames[kept], values[kept], interpolation, quaternion=path == "rotation")


def walk_nodes(
    data: GltfData, clip: Clip, root: Transform | None
) -> dict[int, tuple[Any, Transform]]:
    """Every node of the default scene by its index, with its transform, parents before children."""
    document = data.document
    nodes = document.nodes or []
    if document.scenes:
        roots = item_at(document.scenes, document.scene or 0, "scene").nodes or []
    else:
        children = {child for node in nodes for child in node.children or ()}
        roots = [index for index in range(len(nodes)) if index not in children]
    waiting = [(index, root) for index in reversed(roots)]
    found: dict[int, tuple[Any, Transform]] = {}
    while waiting:
        index, parent = waiting.pop()
        if index in found or not 0 <= index < len(nodes):
            raise SceneError(f"node {index} is missing or in the tree twice; the file is damaged")
        transform = _transform(nodes[index], index, clip.tracks, parent)
        found[index] = (nodes[index], transform)
        waiting += [(child, transform) for child in reversed(nodes[index].children or ())]
    return found


def _transform(
    node: Any, index: int, tracks: dict[tuple[int, str], Track], parent: Transform | None
) -> Transform:
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
