"""The user's strands -> an order in which those that are near each other in space are near each other in memory."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import layout
from ..layout import Arrays, array

SCAN = int(layout.CONSTANTS["SCAN"])
CELLS = 1 << 3 * int(layout.CONSTANTS["CELL_BITS"])


@dataclass(frozen=True)
class Order(Arrays):
    """Where strands go, and what it takes to tell."""

    placed: Any = array("strand", np.uint32, 2)    # strand, first point in the new order
    ranks: Any = array("strand", np.uint32, 4)     # cell; strands, points of it that were counted before; -


def order(gpu: Any, packed: Any, spans: Any) -> Order:
    """Where the user's strands go -> `Order`: those of a cell of space one after the other, cells along Morton's curve.

    packed: [points, 3] float32.  spans: [strands, 2] uint32 first point, points.
    The points of a strand stay together.  The order of strands in a cell is any, and so is that of their points.
    """
    n = len(spans)
    blocks = -(-n // SCAN)
    made = Order.empty(gpu, {"strand": n})
    corners, counts = gpu.empty((2 * blocks, 4), np.float32), gpu.full((CELLS, 2), np.uint32, 0)
    brought = {"packed": packed, "spans": spans}
    gpu.launch("order.boxes", blocks, n=n, corners=corners, **brought)
    while blocks > 1:
        boxes, blocks = blocks, -(-blocks // SCAN)
        around = gpu.empty((2 * blocks, 4), np.float32)
        gpu.launch("order.box", blocks, n=boxes, corners=corners, around=around)
        corners = around
    gpu.launch("order.count", n, corners=corners, counts=counts, ranks=made.ranks, **brought)
    gpu.launch("order.scan", 1, n=CELLS, counts=counts)
    gpu.launch("order.place", n, counts=counts, **vars(made))
    return made
