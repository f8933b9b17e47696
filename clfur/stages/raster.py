"""Strands and body triangles -> the nearest (depth, id) of every sample of a view."""

import math
from typing import Any

import numpy as np

from ..layout import Declared, drawn
from .strands import DeviceStrands, arrays

NONE = (1 << 64) - 1                                  # nothing there: depth and id NOTHING
VISIBLE = Declared("sample", np.uint64, None, NONE)   # depth << 32 | id
LEFT = Declared("segment", np.uint32, 2)              # first point, id of one that takes too many steps of loops
SOME = 1 << 12                                        # of these there is room for at first


def raster(gpu: Any, view: np.void, strands: DeviceStrands | None = None, body: Any = None,
           visible: Any = None, after: Any = None, longest: int | None = None) -> Any:
    """Draw `DeviceStrands` as lines and a `Surface` or `Shell` as triangles -> [rows, width, samples] uint64.

    A sample holds depth << 32 | id: depth in 1/DEPTH_ONE (0 at the near plane), id the number of a segment's
    first point or BODY | triangle.  Strands are as wide as their width projects, but at least 1/samples of a
    pixel.  Equal depths go to the smaller id.  ``visible``: such an array to draw into, with what is there already.
    ``longest``: points of the longest strand; as many as all have if None.
    ``after``: [rows, width, samples] uint32; if given, triangles count only where they face the eye behind this depth.
    """
    width, _, samples, _ = (int(n) for n in view["size"])
    rows = int(view["rows"][1] - view["rows"][0])
    bands = _bands(view, body)
    visible = VISIBLE.empty(gpu, (rows, width, samples)) if visible is None else visible
    facing, after = after is not None, gpu.empty(0, np.uint32) if after is None else after
    for phase in range(1 if gpu.int64_atomics else 2):
        if body is not None:
            n = len(body.triangles)
            gpu.launch("raster.body", -(-n // gpu.lanes) * bands, view=view, positions=body.positions,
                       triangles=body.triangles, n=n, first=body.first_triangle, band=-(-rows // bands), facing=facing,
                       after=after, phase=phase, visible=visible)
        if strands is not None and len(strands.points):
            _lines(gpu, view, strands, phase, visible, longest or len(strands.points))
    return visible


def _lines(gpu, view, strands, phase, visible, longest):
    """Draw strands of at most so many points.  Where a driver ends long loops, in stretches, and `_pieces`."""
    n, most = len(strands.spans), gpu.steps // 8 if gpu.steps else longest   # three steps of loops each, at least
    for first in range(0, longest, most):
        room, n_left = SOME if gpu.steps else 0, None
        while n_left is None or n_left > room:   # to draw them once more changes nothing
            room = max(room, n_left or 0)
            left, counter = LEFT.empty(gpu, room), gpu.full(1, np.uint32, 0)
            gpu.launch("raster.lines", -(-n // drawn(gpu.lanes)), view=view, strands=n, first=strands.first_point,
                       stretch=(first, first + most), phase=phase, visible=visible, steps=gpu.own_steps // 2,
                       room=room, n_left=counter, left=left, **arrays(strands, "points", "spans", "shifts"))
            n_left = int(gpu.download(counter)[0]) if gpu.steps else 0
        if n_left:
            _pieces(gpu, view, strands.points, phase, visible, left, n_left)


def _pieces(gpu, view, points, phase, visible, left, n):
    """Draw n segments that are ``left``, window by window of the picture."""
    width, _, samples, _ = (int(n) for n in view["size"])
    side = max(math.isqrt(gpu.steps // (2 * samples)), 2)
    windows = -(-width // side) * -(-int(view["rows"][1] - view["rows"][0]) // side)
    gpu.launch("raster.pieces", n * windows, view=view, points=points, n=n, left=left, side=side, phase=phase,
               visible=visible)


def _bands(view, body):
    """Bands to divide the rows into, so that no work-item has much more than 2^14 samples to visit.

    A long work-item holds up everything behind it, and Mesa's llvmpipe ends loops after 65,535 steps, silently.
    """
    width, _, samples, _ = (int(n) for n in view["size"])
    rows = int(view["rows"][1] - view["rows"][0])
    if body is None or not len(body.triangles):
        return 1
    nearest = view["to_screen"][3, 2] if view["eye"][3] else 1     # of all that is seen, in w
    longest = body.longest * view["scale"][0] / nearest + 1        # pixels that the longest side can span
    visits = min(longest, width) * min(longest, rows) * samples
    return int(min(max(-(-visits // 2**14), 1), rows))
