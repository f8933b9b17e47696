"""How far the body is from nodes of a grid, below 0 inside, and strands that slide along it."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import layout
from ..layout import Arrays, Declared, array
from .strands import DeviceStrands, arrays, stretches_of

NODES = 96                                             # along the longest side of a body, about
SIDE = 3.0                                             # cells that a side of a triangle need not be shorter than
ROWS = 256                                             # of nodes that a work-item goes through
BAND, LOOKS = (layout.CONSTANTS[name] for name in ("DISTANCE_BAND", "SLIDE_LOOKS"))
NEAREST = Declared("node", np.uint32, None, layout.CONSTANTS["NOTHING"])   # distance in parts of a cell
SUMS = Declared("node", np.int32, None, 0)             # on which side of what is nearest
STATES = Declared("strand", np.float32, 4)             # where a stretch of a strand ends


@dataclass(frozen=True)
class Distance(Arrays):
    """How far a body is, on the device, for `near_at` of cl/distance.h: known within DISTANCE_BAND cells of it."""

    grid: np.void                             # `layout.Distances`
    values: Any = array("node", np.float32)   # x runs first, then y, then z [world], below 0 inside


def grid_of(low: Any, high: Any) -> np.void:
    """`layout.Distances` around a body in the box from ``low`` to ``high``, [3] each [world]."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    cell = max(float((high - low).max()), 1e-30) / (NODES - 1 - 2 * (BAND + 1))
    grid = np.zeros((), layout.Distances)
    grid["place"] = *(low - (BAND + 1) * cell), 1 / cell
    grid["size"][:3] = np.ceil((high - low) / cell) + 1 + 2 * (BAND + 1)
    grid["reach"][:2] = BAND * cell, cell
    return grid   # type: ignore[return-value]


def nodes_of(grid: np.void) -> int:
    """How many nodes a grid has."""
    return math.prod(int(n) for n in grid["size"][:3])


def distance(gpu: Any, grid: np.void, surfaces: Any) -> Distance:
    """How far a body is from the nodes of a grid -> `Distance`.

    ``surfaces``: a function that yields the body's parts, a `Surface` each.  Inside is what lies behind the nearest
    face, edge or corner of it, no further than the grid's reach: so far an open body goes on beyond its border.
    """
    nodes = nodes_of(grid)
    nearest, sums = NEAREST.empty(gpu, nodes), SUMS.empty(gpu, nodes)
    for surface in surfaces():
        gpu.launch("distance.offer", len(surface.triangles) * _every(grid, surface), grid=grid, nearest=nearest,
                   positions=surface.positions, triangles=surface.triangles, every=_every(grid, surface))
    for surface in surfaces():
        gpu.launch("distance.weigh", len(surface.triangles) * _every(grid, surface), grid=grid, nearest=nearest,
                   sums=sums, positions=surface.positions, normals=surface.normals, triangles=surface.triangles,
                   every=_every(grid, surface))
    found = Distance.empty(gpu, {"node": nodes}, grid=grid)
    gpu.launch("distance.finish", nodes, grid=grid, nearest=nearest, sums=sums, values=found.values)
    return found


def deepened(gpu: Any, body: Distance) -> Distance:
    """The same, with values everywhere: also far from the body, where they are half of the distance or more, and inside
    of what is closed."""
    nodes, size = len(body.values), [int(n) for n in body.grid["size"][:3]]
    enclosed, found = SUMS.empty(gpu, nodes), Distance.empty(gpu, {"node": nodes}, grid=body.grid)
    step = 1, size[0], size[0] * size[1]
    rows: Any = [{"row": (size[axis], step[axis], size[one], step[one]), "layer": step[other]}
                 for axis, (one, other) in enumerate(((1, 2), (0, 2), (0, 1)))]
    for row in rows:
        gpu.launch("distance.enclose", nodes // row["row"][0], grid=body.grid, values=body.values, enclosed=enclosed,
                   found=found.values, **row)
    for row in rows:
        gpu.launch("distance.deepen", nodes // row["row"][0], grid=body.grid, values=body.values, enclosed=enclosed,
                   last=int(row is rows[-1]), found=found.values, **row)
    return found


def between(gpu: Any, before: Distance, now: Distance, share: float) -> Distance:
    """How far a body is on its way between two poses, in the same grid: so much of it is gone, 0 to 1."""
    found = Distance.empty(gpu, {"node": len(now.values)}, grid=now.grid)
    gpu.launch("distance.between", len(now.values), share=share, before=before.values, now=now.values,
               found=found.values)
    return found


def slide(gpu: Any, body: Distance, strands: DeviceStrands) -> None:
    """Turn segments of strands that would enter a body, in place: lengths stay, and what follows goes along."""
    n = len(strands.spans)
    stretches = stretches_of(gpu, strands, int(LOOKS) + 4)
    states = STATES.empty(gpu, n if len(stretches) > 1 else 0)
    for stretch in stretches:
        gpu.launch("distance.slide", -(-n // gpu.lanes), grid=body.grid, values=body.values, n=n, stretch=stretch,
                   states=states, **arrays(strands, "spans", "points"))


def bytes_of(grid: np.void) -> int:
    """Bytes on the device while a `Distance` is made, beside its surface."""
    return nodes_of(grid) * (NEAREST.bytes + SUMS.bytes + Distance.bytes(node=1))


def _every(grid, surface):
    """Work-items that share the rows of nodes near a triangle."""
    across = surface.longest * float(grid["place"][3]) + 2 * BAND + 2
    rows = min(across * across, float(grid["size"][1]) * float(grid["size"][2]))
    return max(math.ceil(rows / ROWS), 1)
