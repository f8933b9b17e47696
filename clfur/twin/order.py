"""order in float64 NumPy: the cell of each root along Morton's curve, by halving space."""

import numpy as np


def cells(roots, bits):
    """Cell of each root [N, 3] -> [N] int64: of a cube whose sides are halved ``bits`` times.

    Its lowest corner is that of the box around all roots, its side the box's longest.  A half tells a bit: z before y
    before x, the coarsest halves first.
    """
    low = np.asarray(roots, float).min(0)
    side = (np.asarray(roots, float).max(0) - low).max()
    corner, result = np.tile(low, (len(roots), 1)), np.zeros(len(roots), np.int64)
    for _ in range(bits):
        side = side / 2
        upper = roots - corner >= side
        corner = corner + side * upper
        result = 8 * result + upper @ [1, 2, 4]
    return result


def is_order(placed, counts):
    """Whether strands of these ``counts`` of points [N] are put in ``placed`` [N, 2], strand and first point, without a
    gap and none upon another."""
    strands, first = np.asarray(placed, np.int64).T
    counts = np.asarray(counts, np.int64)
    taken = np.concatenate([[], *(np.arange(f, f + n) for f, n in zip(first, counts))])
    return (np.sort(strands) == np.arange(len(counts))).all() and (np.sort(taken) == np.arange(counts.sum())).all()
