"""How far the body is, for growth that slides along it and for hair that moves: how fine, where it is made and kept."""

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..scene import Mesh, Strands
from ..scene.bounds import boxes_to_see
from ..scene.remembered import remembered
from ..stages import distance
from ..stages.strands import DeviceStrands
from ..stages.tessellate import Source, Surface, counts_of, levels_of, tessellate

SURFACE = 1 << 24   # bytes of the body's triangles that are there at a time, one face's at least


@dataclass(frozen=True)
class Sliding:
    """How the distance of a body is made.

    levels: (inner, outer, surface) by which the body is divided: as it is drawn, but not into sides that are shorter
    than `distance.SIDE` cells.  runs: [(first face, one past the last)] that are there at a time, of so many bytes.
    """

    grid: np.void
    levels: tuple
    finest: int
    runs: list
    surface: int

    @property
    def bytes(self) -> int:
        """Bytes on a device while it is made."""
        return self.surface + distance.bytes_of(self.grid)


@remembered(2)
def sliding_of(mesh: Mesh, fur: Strands) -> Sliding:
    """`Sliding` of strands on a mesh."""
    return _planned(mesh, fur, distance.grid_of(*boxes_to_see(mesh, fur)[0]))


def _planned(mesh, fur, grid):
    finest = max(math.ceil(mesh.longest_edge * float(grid["place"][3]) / distance.SIDE), 1)
    levels = np.minimum(fur.inner, finest), np.minimum(fur.outer, finest), fur.surface
    vertices, triangles = counts_of(levels_of(*levels[:2], len(mesh.faces)))
    each = Surface.bytes(vertex=1) * vertices + Surface.bytes(triangle=1) * triangles
    each += Source.bytes(face=1, corner=3, end=1)
    runs, at, before = [], 0, np.concatenate([[0], np.cumsum(each)])
    while at < len(each):
        end = max(int(np.searchsorted(before, before[at] + SURFACE, "right")) - 1, at + 1)
        runs.append((at, end))
        at = end
    surface = max((int(before[b] - before[a]) for a, b in runs), default=0)
    return Sliding(grid, levels, finest, runs, surface + len(mesh.positions) * Source.bytes(mesh_vertex=1))


def slide(gpu: Any, mesh: Mesh, fur: Strands, strands: DeviceStrands) -> None:
    """Let strands that grew on a mesh slide along it, in place; its distance is kept while mesh and levels stay."""
    distance.slide(gpu, distance_of(gpu, mesh, fur), strands)


def distance_of(gpu: Any, mesh: Mesh, fur: Any) -> distance.Distance:
    """How far a mesh is, as it is drawn under Strands or Curves; kept while mesh and levels stay."""
    plan = sliding_of(mesh, fur)
    return gpu.keep("distance", (mesh, fur.inner, fur.outer, fur.surface, plan.finest),
                    functools.partial(_distance, gpu, mesh, plan))


def distance_in(gpu: Any, mesh: Mesh, fur: Any, grid: np.void) -> distance.Distance:
    """The same in a grid that is given, and not kept."""
    return _distance(gpu, mesh, _planned(mesh, fur, grid))


def _distance(gpu, mesh, plan):
    return distance.distance(gpu, plan.grid, functools.partial(_surfaces, gpu, mesh, plan))


def _surfaces(gpu: Any, mesh: Mesh, plan: Sliding) -> Iterator[Surface]:
    inner, outer, surface = plan.levels
    for run in plan.runs:
        yield tessellate(gpu, mesh, inner, outer, surface, run)
