"""Cells of hair -> what lies between each layer of cells and the light."""

from typing import Any

import numpy as np

from ..layout import Declared

SUMS = Declared("layer", np.float32)   # crossings before a cell of each layer, and behind all


def zscan(gpu: Any, cells: Any, crossing_unit: int) -> Any:
    """Sum [nz, ny, nx] uint32 along z -> [nz + 1, ny, nx] float32: crossings before each layer, and behind all.

    nx · ny must be a multiple of 16; ``crossing_unit`` is the amount of one crossing.
    """
    nz, ny, nx = cells.shape
    sums = SUMS.empty(gpu, (nz + 1, ny, nx))
    gpu.launch("zscan.columns", nx * ny // 16, cells=cells, layers=nz, layer=nx * ny, scale=1 / crossing_unit,
               sums=sums)
    return sums
