"""What cl/zscan.cl means: running sums along the light in whole numbers, made floats at the end."""

import numpy as np


def zscan(cells, crossing_unit):
    """Cells [nz, ny, nx] -> crossings before each layer and behind all, float32 [nz + 1, ny, nx].

    crossing_unit: the amount of one crossing.
    """
    cells = np.asarray(cells)
    sums = np.zeros((len(cells) + 1, *cells.shape[1:]), np.uint64)
    np.cumsum(cells, axis=0, dtype=np.uint64, out=sums[1:])
    return sums.astype(np.float32) * np.float32(1 / crossing_unit)
