"""Strands -> how much hair each cell of a grid seen from the light holds."""

import math
from typing import Any

import numpy as np

from .. import layout
from ..layout import METHODS, Declared
from .strands import DeviceStrands, arrays, stretches_of

CELLS = Declared("cell", np.uint32, None, 0)   # amounts of crossings
RESTS = Declared("strand", np.float32)         # what rounding leaves from stretch to stretch of a strand


def voxelize(gpu: Any, grid: np.void, strands: DeviceStrands, method: str, weights: np.ndarray,
             cells: Any = None) -> Any:
    """Put `DeviceStrands` into a `layout.Grid` -> [nz, ny, nx] uint32.

    ``method``: the report's "binary", "count" or "trilinear" (section 2.3.1), or "length", which deposits how often a
    ray of light is expected to cross the hair.  ``weights``: [types] uint32, what one fragment or one crossing
    adds; see `crossing_unit_for` and `depths_for`.  ``cells``: [nz, ny, nx] uint32 to add to.
    """
    nx, ny, nz, _ = (int(n) for n in grid["size"])
    cells = CELLS.empty(gpu, (nz, ny, nx)) if cells is None else cells
    given = {"grid": grid, "weights": gpu.upload(weights), "cells": cells,
             **arrays(strands, "points", "spans", "strand_uv")}
    stretches = stretches_of(gpu, strands, (11 if method == "length" else 1) * max(nx, ny, nz) + 9)   # to 4 grids away
    n = len(strands.spans)
    rests = RESTS.empty(gpu, n if len(stretches) > 1 else 0)
    for stretch in stretches:
        if method == "length":
            each = int(layout.CONSTANTS["GATHERED"]) if max(gpu.lanes, gpu.hinted) > 1 else 1
            gpu.launch("voxelize.lengths", -(-n // each), stretch=stretch, rests=rests, n_strands=n, **given)
        else:
            gpu.launch("voxelize.fragments", n, stretch=stretch, method=METHODS.index(method), **given)
    return cells


def crossing_unit_for(most: float) -> int:
    """The amount that stands for one fragment or crossing, when all hair together has at most ``most`` of them.

    It is the largest power of two, 2^16 at most, with most · amount below 2^32: then no cell and no running sum can
    overflow, even if all hair lies in one column; 0 if even 1 might.
    """
    crossing_unit = 1 << 16
    while crossing_unit and most * crossing_unit >= 1 << 32:
        crossing_unit >>= 1
    return crossing_unit


def most_of(grid: np.void, method: str, segments: int, length: float, area: float,
            nearest: float | None = None) -> float:
    """The fragments or crossings in the grid that hair cannot exceed, from what `scene.hair_bounds` gives.

    ``nearest``: its smallest w, that of the grid if None.
    """
    nearest = float(grid["face"][2]) if nearest is None else nearest
    side = float(grid["face"][1]) * nearest
    # A spot's outermost rays are this much longer than its axis, and what lies along the axis spreads by as much.
    slant = math.sqrt(1 + 2 * (float(grid["face"][1]) * int(grid["size"][0]) / 2) ** 2) if grid["light"][3] else 1.0
    return slant * area / side**2 + segments if method == "length" else slant * length / side + segments


def depths_for(alphas: Any, method: str) -> np.ndarray:
    """Optical depth of one crossing of hair with such ``alphas``, [types] each, float64.

    Light falls to alpha^count in the report's methods, and to its mean exp(-(1 - alpha) · crossings) when a mean number
    of crossings falls at random, in "length".
    """
    alphas = np.asarray(alphas, float)
    return 1 - alphas if method == "length" else -np.log(np.maximum(alphas, 1e-6))


def self_shadow(grid: np.void, method: str) -> tuple[float, float]:
    """What a strand adds on average to the sum read at its own axis: (per width [world], per fragment).

    Half of it lies before the axis.  Across, read between four columns, a strand weighs 2/3 of a cell's side where it
    was deposited between columns, 3/4 where in the nearest.
    """
    if method == "length":
        return 1 / 3 / float(grid["face"][1]), 0.0
    return 0.0, 1 / 3 if method == "trilinear" else 0.375
