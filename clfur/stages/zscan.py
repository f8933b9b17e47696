"""Cells of hair -> what lies between each layer of cells and the light."""

import numpy as np


def zscan(gpu, cells, unit):
    """Sum [nz, ny, nx] uint32 along z -> [nz + 1, ny, nx] float32: crossings before each layer, and behind all.

    nx · ny must be a multiple of 16; ``unit`` is the amount of one crossing.
    """
    nz, ny, nx = cells.shape
    sums = gpu.empty((nz + 1, ny, nx), np.float32)
    gpu.launch("zscan.columns", nx * ny // 16, cells=cells, layers=nz, layer=nx * ny, scale=1 / unit, sums=sums)
    return sums
