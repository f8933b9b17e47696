"""The body that strands in motion feel: its distance in each pose, and where it is between two."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..pipeline.sliding import distance_in, distance_of
from ..scene import Mesh
from ..scene.bounds import boxes_to_see
from ..scene.origin import copied
from ..stages import distance
from ..stages.motion import Felt, body_at
from .pose import Pose, between, part_of

ROOM = 0.125   # of its longest side by which the box that a body at rest is in may grow, as it deforms
FRESH = 2.0    # cells that a skin may go, besides the rigid motion, till its distance is made anew
PACE = 0.5     # of the band in which distances are exact: how far the body may go in a substep


class Body:
    """How far the body is, for strands that move, at rest and in the poses of a mesh.

    A rigid motion takes the grid of rest along; in other poses its distance is made anew, and between two of them it
    goes from one to the other.  fur: the Strands or Curves by which the mesh is tessellated.
    """

    def __init__(self, gpu: Any, mesh: Mesh, fur: Any, rest: Pose) -> None:
        self._gpu, self._mesh, self._fur, self._rest = gpu, mesh, fur, rest
        self._at_rest = distance.deepened(gpu, distance_of(gpu, mesh, fur))
        self._box = boxes_to_see(mesh, fur)[0]
        self._last: tuple = (None, None, None)   # grid, pose, its distance at the end of the last step
        self.pace = PACE * float(self._at_rest.grid["reach"][0])   # world units that it may go in a substep
        self.felt = Felt(self._at_rest, body_at(np.eye(3), np.zeros(3)))

    def way(self, before: Pose, now: Pose, substeps: int, cut: bool = False) -> Iterator[Felt]:
        """The body at the end of each of so many substeps from one pose to another; cut: it is there at once."""
        last, swell = before.rows(), 0.0 if cut else _apart(before, now) / substeps
        deforms = not before.corners is now.corners is self._rest.corners
        distances = self._distances(now if cut else before, now, substeps)
        for number, there in enumerate(distances, 1):
            rows = between(before, now, 1 if cut else number / substeps)
            yield Felt(there, body_at(rows[:3, :3], rows[:3, 3], (rows @ np.linalg.inv(last))[:3], swell, deforms))
            last = rows

    def _distances(self, before, now, substeps):
        """The distance at the end of each substep."""
        if before.corners is now.corners is self._rest.corners:
            yield from [self._at_rest] * substeps
            return
        grid = self._grid(before, now)
        was = self._last[2] if self._last[:2] == (grid.tobytes(), before) else self._distance(before, grid)
        pieces = min(max(math.ceil(_apart(before, now) / (FRESH * float(grid["reach"][1]))), 1), substeps)
        for piece in range(1, pieces + 1):
            pose = now if piece == pieces else part_of(before, now, piece / pieces)
            there = self._distance(pose, grid)
            for number in range((piece - 1) * substeps // pieces + 1, piece * substeps // pieces + 1):
                yield distance.between(self._gpu, was, there, number * pieces / substeps - (piece - 1))
            was = there
        self._last = grid.tobytes(), now, was

    def _grid(self, before, now):
        """A grid for two poses: that of the body at rest, with some room, if they are in it."""
        low, high = self._box
        room = ROOM * float((high - low).max())
        boxes = [boxes_to_see(self._posed(pose), self._fur)[0] for pose in (before, now)]
        lows, highs = [each[0] for each in boxes], [each[1] for each in boxes]
        return distance.grid_of(np.min([low - room, *lows], 0), np.max([high + room, *highs], 0))

    def _distance(self, pose, grid):
        return distance.deepened(self._gpu, distance_in(self._gpu, self._posed(pose), self._fur, grid))

    def _posed(self, pose):
        """The mesh in a pose, without the rigid motion: each face has corners of its own."""
        corners = pose.corners.reshape(-1, 3)
        return copied(self._mesh, positions=corners, normals=pose.normals.reshape(-1, 3), origin=np.zeros(3),
                      faces=np.arange(len(corners), dtype=np.uint32).reshape(-1, 3))


def _apart(before, now):
    """How far a corner goes, besides the rigid motion, at most."""
    return float(np.sqrt(((now.corners - before.corners)**2).sum(2).max(initial=0)))
