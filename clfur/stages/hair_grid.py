"""Hair that feels hair: a coarse grid of how much of it there is and how it moves."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import layout
from ..layout import Declared
from .motion import CPU_ITEMS, State

MOST_CELLS = 1 << 19   # 24 MiB
FASTEST = int(layout.CONSTANTS["FASTEST"])
SPEEDS = 1 << 16   # units of speed in a cell a step
SUMS = Declared("cell", np.int64, 4, 0)
CELLS = Declared("cell", np.float32, 4)


@dataclass(frozen=True)
class HairGrid:
    """Where a grid is: its lowest corner, x, y, z as roots are told [world]; the side of a cell; cells along each."""

    low: tuple
    cell: float
    size: tuple

    @property
    def arguments(self) -> dict:
        """Those of the kernels."""
        return {"low": (*self.low, 1 / self.cell), "size": (*self.size, 0)}


def grid_around(low: Any, high: Any, cell: float) -> HairGrid:
    """A grid of such cells around the box from ``low`` to ``high`` [3]; of too large a one around its middle alone."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    size = np.ceil((high - low) / cell).astype(np.int64) + 2   # half a cell and more on each side
    while (cells := int(np.prod(size))) > MOST_CELLS:
        size = np.maximum((size * (MOST_CELLS / cells) ** (1 / np.sum(size > 2))).astype(np.int64), 2)
    return HairGrid(tuple(((low + high) / 2 - size * cell / 2).tolist()), cell, tuple(size.tolist()))


def mass_unit(points: int, heaviest: float) -> float:
    """Units of mass in a world unit of hair, for so many points, of which the heaviest has so much.

    They are 2^16 in this one, or less, so that all of them together, at `FASTEST`, stay below 2^62.
    """
    bits = min(16, 62 - int(FASTEST).bit_length() - max(points - 1, 0).bit_length())
    return 2.0**bits / heaviest


def deposit(gpu: Any, state: State, roots: Any, grid: HairGrid, unit: float, step: float, ahead: bool = False) -> Any:
    """Mass and momentum of all points in each cell -> [cells, 4] int64 on the device: momentum, mass.

    roots: [4, 3, padded] float32 of the state.  unit: `mass_unit`.  step: seconds, of the next: speeds are told in
    parts of a cell in it.  ahead: of speeds as they will be then, if they go on to change as they did.
    """
    sums = SUMS.empty(gpu, int(np.prod(grid.size)))
    run = -(-state.padded // gpu.lanes // CPU_ITEMS) * gpu.lanes if gpu.lanes > 1 else 1
    gpu.launch("hair_grid.deposit", -(-state.padded // max(run, 1)), run=run, padded=state.padded,
               segments=state.segments, lengths=state.lengths, roots=roots, places=state.places, speeds=state.speeds,
               speeds_before=state.speeds_before, ahead=float(ahead), units=(unit, SPEEDS * step / grid.cell),
               sums=sums, **grid.arguments)
    return sums


def average(gpu: Any, sums: Any, grid: HairGrid, unit: float, step: float) -> Any:
    """`deposit`'s sums -> [cells, 4] float32 on the device: mean velocity [world / s] times its coupling, density
    [strands across a cell]."""
    cells = CELLS.empty(gpu, len(sums))
    gpu.launch("hair_grid.average", len(sums), sums=sums, units=(grid.cell / (SPEEDS * step), 1 / (unit * grid.cell)),
               cells=cells)
    return cells


def density(gpu: Any, state: State, roots: Any, grid: HairGrid, cells: Any) -> Any:
    """How dense hair is at each point -> [points * padded] float32 on the device, [strands across a cell]."""
    densities = gpu.full(state.points * state.padded, np.float32, 0)
    gpu.launch("hair_grid.density", state.padded // gpu.lanes, points=state.points, padded=state.padded,
               segments=state.segments, roots=roots, places=state.places, cells=cells, densities=densities,
               **grid.arguments)
    return densities


def feel(gpu: Any, state: State, roots: Any, groomed: Any, grid: HairGrid, cells: Any, friction: float, push: float,
         rub: float, most: float) -> Any:
    """What points feel of the hair around them, for `motion.advance` -> [points * 4 * padded] float32 on the device.

    groomed: `density` of the groom.  friction: 1 / s.  push: acceleration [world / s²] of hair that is far denser
    than groomed, where the density falls to none in a cell; most: of it at most.  rub: friction that is added there
    [1 / s].
    """
    felt = gpu.empty(state.points * 4 * state.padded, np.float32)   # of the roots it is never read
    gpu.launch("hair_grid.feel", state.padded // gpu.lanes, points=state.points, padded=state.padded,
               segments=state.segments, roots=roots, places=state.places, groomed=groomed, cells=cells,
               friction=friction, push=(push, rub, most, 0), felt=felt, **grid.arguments)
    return felt
