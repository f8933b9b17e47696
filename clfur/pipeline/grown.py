"""Strands that have grown on a device, read back."""

from typing import Any, cast

import numpy as np

from ..scene import Curves, Strands, bounds_of, seen_from
from . import build
from .plan import Plan


def curves_of(gpu: Any, plan: Plan, origin: np.ndarray) -> Curves:
    """The strands of a plan's scene as `Curves` on the host, which draw the same picture.

    ``origin``: [3] what the plan's scene is relative to.
    """
    scene, fur = plan.scene, cast(Strands, plan.scene.strands)
    found = [_read(gpu, build.hair(gpu, plan, part, 0)) for part in plan.parts(gpu) if part.hairy]
    counts, points, colors, root_uv, normals = (np.concatenate(each) for each in zip(*found)) if found else (
        np.zeros(0, np.uint32), *(np.zeros((0, 4), np.float32) for _ in range(4)))
    width = points[:, 3]
    if all(kind.root_width == kind.tip_width for kind in fur.types):   # one for all points of a strand
        width = np.zeros((len(counts), 1), np.float32)
        width[counts > 0, 0] = points[(np.cumsum(counts) - counts)[counts > 0], 3]
    return Curves(
        points=points[:, :3], counts=counts, width=width, types=fur.types,
        color=colors[:, :3] if fur.colored_points else colors[:, None, :3],
        type_of=root_uv[:, 2].astype(np.uint8), root_uv=root_uv[:, :2], root_normal=normals[:, :3],
        inner=fur.inner, outer=fur.outer, surface=fur.surface, seed=fur.seed, lod_by="number",
        origin=origin, bounds=seen_from(bounds_of(scene.mesh, scene.fur, plan.strands), -origin))


def _read(gpu, hair):
    """(points of each strand, then the arrays of points, colours, root uv and root normals) of what is on a device."""
    first, counts = gpu.download(hair.spans).T.astype(np.int64)
    rows = np.arange(counts.sum()) + np.repeat(first - np.cumsum(counts) + counts, counts)
    colors = gpu.download(hair.colors)
    return (counts, gpu.download(hair.points)[rows], colors[rows] if hair.color_per == 2 else colors,
            *(gpu.download(array) for array in (hair.uv, hair.normals)))
