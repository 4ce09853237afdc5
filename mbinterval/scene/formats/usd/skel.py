"""UsdSkel: joints and blend shapes of a stage as a `MorphedSkin`.

A skinned mesh lives in the space of its skeleton: joints and the bind pose place it, the mesh's own
xformOps don't.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene.deform import Morph, MorphedSkin, Skin
from mbinterval.scene.formats.usd.times import Clock, Sampled, columns, finite, reading_prim
from mbinterval.scene.frozen import OfStage
from mbinterval.scene.transforms import Link

Float64 = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class SkelJoint(Sampled):
    """One of the joints of a skeleton, a `Link`."""

    joints: SkelJoints
    number: int

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, SkelJoint) and super().__eq__(other) and self.number == other.number
        )

    def __hash__(self) -> int:
        return hash((self._name(), self.number))

    def local(self, frames: Float64, base: float) -> Float64:
        """See `Link`."""
        return np.array([self.joints.of_skeleton(float(frame))[self.number] for frame in frames])


@dataclass(frozen=True, eq=False)
class SkelJoints(OfStage):
    """Joints of a skeleton in the order of one mesh, times its bind transform."""

    skeleton: Any
    order: Ints
    bind: Float64
    clock: Clock
    _known: dict[float, Float64] = field(default_factory=dict)

    @property
    def inverse_bind(self) -> Float64:
        """See `Joints`: the skeleton's own are in its transforms."""
        return np.broadcast_to(self.bind, (len(self.order), 4, 4))

    def chains(self) -> list[list[Link]]:
        """See `Joints`; in the skeleton's space."""
        prim, animation = self.skeleton.GetPrim(), self.skeleton.GetAnimQuery()
        attributes = []
        if animation:
            moved = animation.GetPrim()
            attributes = [moved.GetAttribute(name) for name in _JOINT_VALUES]
        given = tuple(attribute for attribute in attributes if attribute)
        path = str(prim.GetPath())
        return [[SkelJoint(self.clock, path, given, self, int(joint))] for joint in self.order]

    @property
    def jumps(self) -> list[float]:
        """Nowhere: animation is interpolated."""
        return []

    def at(self, frame: float) -> Float64:
        """See `Joints`; in the skeleton's space."""
        return np.asarray(self.of_skeleton(frame)[self.order] @ self.bind)

    def of_skeleton(self, frame: float) -> Float64:
        """``(J, 4, 4)``: what moves the joints from the bind pose, in the skeleton's order."""
        found = self._known.get(frame)  # other threads may clear it at any time
        if found is None:
            if len(self._known) >= _MOST_KNOWN:
                self._known.clear()
            path = self.skeleton.GetPrim().GetPath()
            with reading_prim(path):
                given = self.skeleton.ComputeSkinningTransforms(self.clock.code(frame))
                found = np.array(given, dtype=np.float64).transpose(0, 2, 1)
            self._known[frame] = found = finite(found, path, frame)
        return found


_JOINT_VALUES = ("translations", "rotations", "scales")
_MOST_KNOWN = 1024


@dataclass(frozen=True, eq=False)
class ShapeWeights(Sampled):
    """Weights of sub-shapes over time: blend shapes with their in-betweens, a `Mover`."""

    animation: Any
    order: Ints
    query: Any
    count: int

    pieces: ClassVar[int] = 8

    def at(self, frame: float) -> Float64:
        """See `Weights`."""
        with reading_prim(self.path):
            given = np.array(self.animation.ComputeBlendShapeWeights(self.clock.code(frame)))
        known = np.append(given, 0.0)  # -1 is a shape that the animation does not know
        weights = known[self.order].astype(np.float32)
        subs, _, shapes = self.query.ComputeSubShapeWeights(weights.tolist())
        total = np.zeros(self.count)
        np.add.at(total, np.array(shapes, np.int64), np.array(subs, dtype=np.float64))
        return total


class SkelReader:
    """Finds the skeleton of every skinned mesh of a stage."""

    def __init__(self, stage: Any, clock: Clock) -> None:
        from pxr import Usd, UsdSkel

        self.clock = clock
        self.cache = UsdSkel.Cache()
        self.bindings: dict[Any, tuple[Any, Any]] = {}
        predicate = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
        for prim in Usd.PrimRange.Stage(stage, predicate):
            root = UsdSkel.Root(prim)
            if not root:
                continue
            self.cache.Populate(root, predicate)
            for binding in self.cache.ComputeSkelBindings(root, predicate):
                for target in binding.GetSkinningTargets():
                    found = binding.GetSkeleton().GetPrim(), target
                    self.bindings[target.GetPrim().GetPath()] = found

    def deformer(
        self, mesh: Any, vertices: Ints, rest: Float64, normals: Float64 | None
    ) -> tuple[MorphedSkin, Any | None] | None:
        """Deformer of ``mesh``, and the skeleton's prim if joints place it; None if not skinned.

        ``rest`` ``(N, 3)`` are its vertices, which are the points ``vertices`` ``(N,)``.
        """
        from pxr import UsdSkel

        found = self.bindings.get(mesh.GetPath())
        if found is None:
            return None
        prim, target = found
        query = self.cache.GetSkelQuery(UsdSkel.Skeleton(prim))
        animation = query.GetAnimQuery()
        morph = self._morph(mesh, target, animation, vertices, len(rest))
        skin = self._skin(mesh, target, query, vertices)
        if morph is None and skin is None:
            return None
        return MorphedSkin(rest, normals, morph, skin), prim if skin is not None else None

    def _skin(self, mesh: Any, target: Any, query: Any, vertices: Ints) -> Skin | None:
        if not target.HasJointInfluences():
            return None
        size = len(mesh.GetPointsAttr().Get() or mesh.GetPointsAttr().Get(0.0) or ())
        given = target.ComputeVaryingJointInfluences(size)
        if not given or not len(given[0]):
            raise SceneError(f"{mesh.GetPath()}: its joint influences don't fit its {size} points")
        indices = np.array(given[0], dtype=np.int64).reshape(size, -1)
        weights = np.array(given[1], dtype=np.float64).reshape(size, -1)
        names = list(query.GetJointOrder())
        own = target.GetJointOrder()
        order = np.arange(len(names))
        if own is not None and len(own):
            missing = [name for name in own if name not in names]
            if missing:
                raise SceneError(f"{mesh.GetPath()}: joint {missing[0]} is not in its skeleton")
            order = np.array([names.index(name) for name in own])
        if indices.size and not 0 <= indices.min() <= indices.max() < len(order):
            raise SceneError(
                f"{mesh.GetPath()}: a point follows joint {indices.max()} of {len(order)}"
            )
        bind = columns(target.GetGeomBindTransform())
        joints = SkelJoints(query, order, bind, self.clock)
        return Skin(joints, indices[vertices], weights[vertices])

    def _morph(
        self, mesh: Any, target: Any, animation: Any, vertices: Ints, count: int
    ) -> Morph | None:
        from pxr import UsdSkel

        if not target.HasBlendShapes() or not animation:
            return None
        query = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(mesh.GetPrim()))
        known = list(animation.GetBlendShapeOrder())
        names = list(target.GetBlendShapeOrder())
        order = np.array([known.index(n) if n in known else len(known) for n in names], np.int64)
        places = query.ComputeBlendShapePointIndices()
        offsets = []
        for number, values in enumerate(query.ComputeSubShapePointOffsets()):
            where = np.array(places[query.GetBlendShapeIndex(number)], dtype=np.int64)
            dense = np.zeros((int(vertices.max(initial=-1)) + 1, 3))
            moved = np.array(values, dtype=np.float64).reshape(-1, 3)
            where = where[: len(moved)] if len(where) else np.arange(len(moved))
            inside = where < len(dense)
            dense[where[inside]] = moved[inside]
            offsets.append(dense[vertices])
        positions = np.array(offsets).reshape(-1, count, 3)
        moved = animation.GetPrim()
        given = moved.GetAttribute("blendShapeWeights")
        sampled = self.clock, str(moved.GetPath()), (given,) if given else ()
        weights = ShapeWeights(*sampled, animation, order, query, len(positions))
        return Morph(positions, None, weights)
