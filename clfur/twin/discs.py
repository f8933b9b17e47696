"""What cl/discs.cl means, in float64: light of a disc that gets to layers of cells, point by point of it."""

import numpy as np


def discs(cells, crossing_unit, of_one, shifts, points, rounds):
    """Cells [nz, ny, nx] -> crossings before each layer and behind all, float64 [nz + 1, ny, nx], as `stages.discs` has
    them.

    points: [n, 2] of the disc.  rounds: [n, 2] what is added before a shift is cut to whole columns.
    """
    cells, shifts = np.asarray(cells, float) / crossing_unit, np.asarray(shifts, np.float32)
    nz, ny, nx = cells.shape
    y, x = np.mgrid[:ny, :nx]
    light = np.zeros((nz + 1, ny, nx))
    for point, add in zip(np.asarray(points, np.float32), np.asarray(rounds, np.float32)):
        cut = np.floor(shifts[:, None] * point + add).astype(int)   # [2 nz + 1, 2]
        for z in range(nz + 1):
            total = np.zeros((ny, nx))
            for before in range(z):
                cx, cy = (each + cut[2 * z, k] - cut[2 * before + 1, k] for k, each in enumerate((x, y)))
                inside = (cx >= 0) & (cx < nx) & (cy >= 0) & (cy < ny)
                total += np.where(inside, cells[before, cy.clip(0, ny - 1), cx.clip(0, nx - 1)], 0)
            light[z] += np.exp(-of_one * total) / len(points)
    return np.maximum(-np.log(light), 0) / of_one
