"""Cells of hair -> what lies between each layer of cells and a light that is a disc."""

from typing import Any

import numpy as np

from .. import layout
from .zscan import SUMS

POINTS = 8, 64     # of a disc: at least, at most,
EVEN = 4.0         # and for each square column of the grid that its shadow's blur is wide
TURNS = 0.7548777, 0.5698403   # shares of a column by which the cut moves from point to point, as even as can be


def points_of(shifts: np.ndarray) -> np.ndarray:
    """The points of a disc, float32 [n, 2], at which its shadow is asked for: more where the blur is wider."""
    wide = float(np.ptp(shifts))
    return layout.disc(int(np.clip(EVEN * wide * wide, *POINTS)))


def discs(gpu: Any, cells: Any, crossing_unit: int, of_one: float, shifts: np.ndarray) -> Any:
    """[nz, ny, nx] uint32 -> [nz + 1, ny, nx] float32: crossings before each layer, and behind all, that take away as
    much light as a disc's loses on its ways there.

    ``crossing_unit``: the amount of one crossing.  ``of_one``: optical depth of one.  ``shifts``: [2 nz + 1] float32,
    how many columns a ray from the light's middle and one from the rim of its disc are apart at each half layer, where
    they cross in the one with 0.
    """
    nz, ny, nx = cells.shape
    light, points = SUMS.empty(gpu, (nz + 1, ny, nx)), points_of(shifts)
    aside = int(np.ceil(np.abs(shifts).max())) + 1
    across = -(-(nx + 2 * aside) // gpu.lanes)
    on_device = gpu.upload(shifts)
    for i, point in enumerate(points):
        gpu.launch("discs.rays", across * (ny + 2 * aside), cells=cells, size=(nx, ny, nz, aside), shifts=on_device,
                   point=tuple(point), offset=tuple(i * turn % 1 for turn in TURNS),
                   depth=-of_one / crossing_unit / np.log(2), first=i == 0, light=light)
    gpu.launch("discs.crossings", light.size, points=len(points), of_one=of_one, light=light)
    return light
