"""Skins and morph targets of a glTF file (glTF 2.0, sections 3.7.2.2 and 3.7.3)."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene.deform import Morph, NodeJoints, Skin
from mbinterval.scene.field_values import check_finite
from mbinterval.scene.formats.gltf.data import GltfData, item_at
from mbinterval.scene.model import Mesh
from mbinterval.scene.tracks import Track
from mbinterval.scene.transforms import Transform


def read_morph(
    data: GltfData,
    targets: Sequence[Mapping[str, int]],
    mesh: Mesh,
    weights: Track | Sequence[float] | None,
) -> Morph:
    """Targets of a primitive with their weights: a track, constants, or None for none."""
    positions = np.stack([_differences(data, target, "POSITION", mesh) for target in targets])
    normals = None
    if mesh.normals is not None and any("NORMAL" in target for target in targets):
        normals = np.stack([_differences(data, target, "NORMAL", mesh) for target in targets])
    if isinstance(weights, Track):
        return Morph(positions, normals, weights)
    return Morph(positions, normals, np.array(weights or [0.0] * len(targets), dtype=np.float64))


def _differences(
    data: GltfData, target: Mapping[str, int], name: str, mesh: Mesh
) -> NDArray[np.float64]:
    if target.get(name) is None:
        return np.zeros(mesh.positions.shape)
    values = data.accessor(target[name]).astype(np.float64)
    if values.shape != mesh.positions.shape:
        raise SceneError(
            f"mesh {mesh.name!r}: a morph target has {len(values)} vertices for "
            f"{len(mesh.positions)}; the file is damaged"
        )
    return values


def read_skin(
    data: GltfData,
    primitive: Any,
    index: int,
    nodes: Mapping[int, tuple[Any, Transform]],
    count: int,
) -> Skin:
    """Skin ``index`` on a primitive of ``count`` vertices, with all its sets of joints."""
    source = item_at(data.document.skins, index, "skin")
    name = source.name or str(index)
    missing = [joint for joint in source.joints if joint not in nodes]
    if missing or not source.joints:
        raise SceneError(
            f"skin {name!r}: joint node {missing[0]} is not in the scene; export the whole skeleton"
            if missing
            else f"skin {name!r} has no joints"
        )
    inverse = np.tile(np.eye(4), (len(source.joints), 1, 1))
    if source.inverseBindMatrices is not None:
        inverse = data.accessor(source.inverseBindMatrices).astype(np.float64)
        if inverse.ndim != 3 or len(inverse) < len(source.joints):
            raise SceneError(
                f"skin {name!r}: {len(inverse)} inverse bind matrices for "
                f"{len(source.joints)} joints"
            )
        if not np.isfinite(inverse).all():
            raise SceneError(f"skin {name!r}: its inverse bind matrices are not finite")
    indices, weights = _influences(data, primitive, count, name)
    check_finite(weights, f"skin {name!r}: weights", "vertex")
    wrong = np.argwhere((indices < 0) | (indices >= len(source.joints)))
    if len(wrong):
        vertex, column = wrong[0]
        raise SceneError(
            f"skin {name!r}: vertex {vertex} follows joint {indices[vertex, column]} of "
            f"{len(source.joints)}; the file is damaged"
        )
    joints = NodeJoints(
        tuple(nodes[joint][1] for joint in source.joints), inverse[: len(source.joints)]
    )
    return Skin(joints, indices, weights)


def _influences(
    data: GltfData, primitive: Any, count: int, name: str
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Joints and weights ``(N, 4 * sets)`` of all sets, JOINTS_0, JOINTS_1, ..."""
    indices, weights = [], []
    for number in itertools.count():
        joint, weight = (
            getattr(primitive.attributes, f"{kind}_{number}", None)
            for kind in ("JOINTS", "WEIGHTS")
        )
        if joint is None or weight is None:
            break
        indices.append(data.accessor(joint).astype(np.int64))
        weights.append(data.accessor(weight).astype(np.float64))
        if indices[-1].shape != (count, 4) or weights[-1].shape != (count, 4):
            raise SceneError(f"skin {name!r}: joints or weights for another number of vertices")
    if not indices:
        raise SceneError(f"skin {name!r}: its mesh has no JOINTS_0 with WEIGHTS_0")
    return np.concatenate(indices, axis=1), np.concatenate(weights, axis=1)
