"""Meshes of USD files that skeletons and blend shapes move (UsdSkel), by usd-core's own arithmetic."""

from typing import Any

import numpy as np

from ..errors import Error
from .usd import Stage


class Skeletons:
    """The skeletons of a stage, and which prims they hold."""

    def __init__(self, stage: Stage) -> None:
        Usd, UsdSkel = stage.pxr.Usd, stage.pxr.UsdSkel
        self._stage, self._cache, self._of = stage, UsdSkel.Cache(), {}
        every = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
        for prim in Usd.PrimRange(stage.stage.GetPseudoRoot(), every):
            if prim.IsA(UsdSkel.Root):
                root = UsdSkel.Root(prim)
                self._cache.Populate(root, every)
                for binding in self._cache.ComputeSkelBindings(root, every):
                    for target in binding.GetSkinningTargets():
                        self._of[target.GetPrim().GetPath()] = binding.GetSkeleton(), target

    def hold(self, prim: Any) -> bool:
        """Whether one of them moves the points of a prim."""
        return prim.GetPath() in self._of

    def deformed(self, prim: Any, points: np.ndarray) -> np.ndarray:
        """Return where points [n, 3] of a prim are at the stage's time, float64 [n, 3] in its own space: first by its
        blend shapes, then by its joints. Raises Error where they don't fit."""
        stage, (skeleton, target) = self._stage, self._of[prim.GetPath()]
        Vt, query = stage.pxr.Vt, self._cache.GetSkelQuery(skeleton)
        moved = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(points, np.float32))
        if not query or (target.HasBlendShapes() and not self._shaped(prim, target, query, moved)):
            raise Error("has blend shapes or a skeleton that do not fit it")
        if not target.HasJointInfluences():
            return np.asarray(moved, np.float64)
        joints = query.ComputeSkinningTransforms(stage.at)
        to_skeleton = np.eye(4)
        if target.IsRigidlyDeformed():
            to_skeleton = np.array(target.ComputeSkinnedTransform(joints, stage.at))
        elif not target.ComputeSkinnedPoints(joints, moved, stage.at):
            raise Error("has joints or weights that do not fit it")
        # Joints put points into the skeleton's space; where the prim itself stands has no say.
        world, own = (np.array(stage.matrices.GetLocalToWorldTransform(each)) for each in (skeleton.GetPrim(), prim))
        if not np.linalg.det(own):
            raise Error("stands flat, by a matrix without inverse, and is held by a skeleton")
        matrix = to_skeleton @ world @ np.linalg.inv(own)
        return np.asarray(moved, np.float64) @ matrix[:3, :3] + matrix[3, :3]

    def _shaped(self, prim, target, query, points):
        """Move points by a prim's blend shapes; whether these fit."""
        UsdSkel, animation = self._stage.pxr.UsdSkel, query.GetAnimQuery()
        if not animation:
            return True
        weights, mapper = animation.ComputeBlendShapeWeights(self._stage.at), target.GetBlendShapeMapper()
        shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(prim))
        parts = shapes.ComputeSubShapeWeights(mapper.Remap(weights) if mapper else weights)
        return shapes.ComputeDeformedPoints(*parts, shapes.ComputeBlendShapePointIndices(),
                                            shapes.ComputeSubShapePointOffsets(), points)
