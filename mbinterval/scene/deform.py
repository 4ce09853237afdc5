"""Meshes whose vertices move on their own: morph targets, and skins of joints.

Vertices are evaluated from weights and joints at the very time that is asked for, so that a joint
turns by its animation's own rule between keys, and no vertex cuts the corner.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene.frozen import Frozen
from mbinterval.scene.transforms import Link, Transform, chain_matrices

Float64 = NDArray[np.float64]
Index = NDArray[np.integer[Any]] | slice

ALL = slice(None)


class Deformer(Protocol):
    """Shape of a mesh over time, in the space that the mesh's transform maps to the world."""

    def positions(self, frame: float, which: Index = ALL, base: float | None = None) -> Float64:
        """Positions ``(n, 3)`` at ``frame`` of all vertices, or of some.

        ``base`` is the exposure's frame, from which velocities lead on; None is ``frame``.
        """

    def normals(self, frame: float) -> Float64 | None:
        """Normals ``(N, 3)`` at ``frame``, not normalized; None where the mesh has none."""

    def mirrors(self, frame: float) -> bool:
        """Whether fronts become backs: a joint's matrix has a negative determinant."""

    @property
    def jumps(self) -> list[float]:
        """Frames at which vertices may jump."""


class Weights(Protocol):
    """Weights of morph targets over time; a `Track` will do."""

    @property
    def jumps(self) -> list[float]:
        """Frames at which they may jump."""

    def at(self, frame: float) -> Float64:
        """``(M,)`` at ``frame``."""


class Joints(Protocol):
    """Joints of a skeleton over time, in the space that the mesh's transform maps to the world."""

    @property
    def inverse_bind(self) -> Float64:
        """``(J, 4, 4)`` that take vertices from the bind pose to the space of each joint."""

    def chains(self) -> list[list[Link]]:
        """The chain of each joint."""

    def at(self, frame: float) -> Float64:
        """``(J, 4, 4)`` that take vertices from the bind pose to their place at ``frame``."""

    @property
    def jumps(self) -> list[float]:
        """Frames at which a joint may jump."""


@dataclass(frozen=True, eq=False)
class NodeJoints(Frozen):
    """Nodes of a hierarchy as joints: world matrix times inverse bind matrix, ``(J, 4, 4)``."""

    nodes: Sequence[Transform]
    inverse_bind: Float64

    def chains(self) -> list[list[Link]]:
        """See `Joints`."""
        return [node.links() for node in self.nodes]

    def at(self, frame: float) -> Float64:
        """See `Joints`."""
        places = chain_matrices(self.chains(), np.array([frame]), frame)[0]
        return np.asarray(places @ self.inverse_bind)

    @property
    def jumps(self) -> list[float]:
        """See `Joints`."""
        return sorted({frame for node in self.nodes for frame in node.jumps})


@dataclass(frozen=True, eq=False)
class Skin(Frozen):
    """Linear blend skinning: each vertex moves by the weighted mean of its joints' matrices.

    Attributes
    ----------
    joints
        Matrices of the J joints over time.
    indices, weights
        ``(N, I)``: the joints of each vertex, and how much each counts. Weights of a vertex are
        scaled to a sum of 1; one without any follows its first joint.
    """

    joints: Joints
    indices: NDArray[np.int64]
    weights: Float64

    def __post_init__(self) -> None:
        weights = np.array(self.weights, dtype=np.float64)
        total = weights.sum(axis=1, keepdims=True)
        lost = ~(total[:, 0] > 0.0)
        weights[lost, 0], total[lost] = 1.0, 1.0
        used = (weights != 0.0).any(axis=0)  # whole sets of zeros are usual
        used[0] = True
        object.__setattr__(self, "weights", (weights / total)[:, used])
        object.__setattr__(self, "indices", np.asarray(self.indices, np.int64)[:, used])

    def moved(self, points: Float64, joints: Float64, which: Index = ALL) -> Float64:
        """``points`` ``(n, 3)`` of the bind pose, moved by ``joints`` ``(J, 4, 4)``."""
        blended = self._blended(joints, which)
        return _transformed(blended[:, :, :3], points) + blended[:, :, 3]

    def turned(self, normals: Float64, joints: Float64) -> Float64:
        """``normals`` ``(N, 3)`` of the bind pose, by cofactors, right for every matrix."""
        return _transformed(cofactors(self._blended(joints)[:, :, :3]), normals)

    def _blended(self, joints: Float64, which: Index = ALL) -> Float64:
        """``(n, 3, 4)``: what takes each vertex from the bind pose to its place."""
        matrices = joints[:, :3].reshape(-1, 12)
        indices, weights = self.indices[which], self.weights[which]
        mean = weights[:, :1] * matrices[indices[:, 0]]
        for column in range(1, weights.shape[1]):
            mean += weights[:, column, None] * matrices[indices[:, column]]
        return np.asarray(mean.reshape(-1, 3, 4))


@dataclass(frozen=True, eq=False)
class Morph(Frozen):
    """Morph targets: weighted differences are added to the mesh at rest.

    Attributes
    ----------
    positions, normals
        ``(M, N, 3)`` differences of the M targets; normals may be None.
    weights
        ``(M,)`` constant, or given over time.
    """

    positions: Float64
    normals: Float64 | None
    weights: Weights | Float64

    def __post_init__(self) -> None:
        weights = self.weights
        first = weights if isinstance(weights, np.ndarray) else weights.at(0.0)
        if first.shape != (len(self.positions),):
            raise SceneError(
                f"{first.size} morph weights for {len(self.positions)} targets; "
                "give one for each target"
            )

    def added(self, base: Float64, targets: Float64, frame: float, which: Index = ALL) -> Float64:
        """``base`` ``(n, 3)`` and the weighted ``targets`` ``(M, N, 3)`` of these vertices."""
        weights = self.weights
        if not isinstance(weights, np.ndarray):
            weights = weights.at(frame)
        result = base
        for target in np.flatnonzero(weights):
            result = result + weights[target] * targets[target][which]
        return result


@dataclass(frozen=True, eq=False)
class MorphedSkin(Frozen):
    """A mesh at rest, ``(N, 3)``, its morph targets, and then its skin; either may be missing."""

    rest: Float64
    rest_normals: Float64 | None = None
    morph: Morph | None = None
    skin: Skin | None = None

    def positions(self, frame: float, which: Index = ALL, base: float | None = None) -> Float64:
        """See `Deformer`."""
        points = self.shape(frame, which)
        return points if self.skin is None else self.skin.moved(points, self._joints(frame), which)

    def shape(self, frame: float, which: Index = ALL) -> Float64:
        """Positions ``(n, 3)`` before the skin moves them: morphed."""
        points = self.rest[which]
        if self.morph is not None:
            points = self.morph.added(points, self.morph.positions, frame, which)
        return points

    def normals(self, frame: float) -> Float64 | None:
        """See `Deformer`."""
        normals = self.shape_normals(frame)
        if normals is None or self.skin is None:
            return normals
        turned = self.skin.turned(normals, self._joints(frame))
        return -turned if self.mirrors(frame) else turned

    def shape_normals(self, frame: float) -> Float64 | None:
        """Normals ``(N, 3)`` before the skin turns them: morphed."""
        normals = self.rest_normals
        if normals is not None and self.morph is not None and self.morph.normals is not None:
            normals = self.morph.added(normals, self.morph.normals, frame)
        return normals

    def mirrors(self, frame: float) -> bool:
        """See `Deformer`; the first joint decides."""
        if self.skin is None:
            return False
        return bool(np.linalg.det(self._joints(frame)[0, :3, :3]) < 0.0)

    def _joints(self, frame: float) -> Float64:
        return self.skin.joints.at(frame) if self.skin is not None else np.zeros((0, 4, 4))

    @property
    def jumps(self) -> list[float]:
        """See `Deformer`."""
        found = [] if self.skin is None else self.skin.joints.jumps
        if self.morph is not None and not isinstance(self.morph.weights, np.ndarray):
            found = found + self.morph.weights.jumps
        return found


def _transformed(matrices: Float64, vectors: Float64) -> Float64:
    return np.asarray(np.einsum("nij,nj->ni", matrices, vectors))


def cofactors(matrices: NDArray[Any]) -> Float64:
    """Cofactors of ``(..., 3, 3)``: what surface normals are transformed by."""
    a, b, c = (matrices[..., row, :] for row in range(3))
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-2)
