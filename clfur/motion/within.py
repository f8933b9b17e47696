"""What a step began with, so that what lies within it can be told."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import Error
from ..scene import Mesh, checks
from ..scene.origin import copied


@dataclass(frozen=True)
class Began:
    """How a step began: seconds since the groom, how many it took, the mesh and strands, their roots as
    `stages.motion.place_roots` has them, places and speeds as `remember` does.

    is_cut: whether hair was carried along with the mesh.  by_scene: whether the mesh is that of a function of seconds.
    """

    time: float
    seconds: float
    mesh: Any
    roots: Any
    hair: tuple
    is_cut: bool
    by_scene: bool


def mixed(before: Mesh, now: Mesh, share: float) -> Mesh:
    """The mesh at a share of the way from one pose to another: straight, as roots go too."""
    if before is now or share == 0:
        return before
    if before.faces.shape != now.faces.shape or (before.faces != now.faces).any():
        raise Error("Motion.between has no pose between two meshes whose vertices touch in other places; allowed: a "
                    "function of seconds as Motion.scene")
    places = before.positions.astype(np.float64) + (before.origin - now.origin)
    normals = before.normals.astype(np.float64)
    normals += share * (now.normals - normals)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return copied(now, positions=checks.frozen((places + share * (now.positions - places)).astype(np.float32)),
                  normals=checks.frozen(np.where(length > 0.1, normals / np.maximum(length, 0.1), now.normals).astype(
                      np.float32)))
