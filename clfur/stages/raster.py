"""Strands and body triangles -> the nearest (depth, id) of every sample of a view."""

import math
from typing import Any

import numpy as np

from ..layout import Declared, drawn
from .strands import DeviceStrands, arrays, stretches_of

NONE = (1 << 64) - 1                                  # nothing there: depth and id NOTHING
VISIBLE = Declared("sample", np.uint64, None, NONE)   # depth << 32 | id
LEFT = Declared("segment", np.uint32, 2)              # or triangle that takes too many steps of loops: see raster.cl
CLIPPED = 14                                          # pieces of a triangle, at most
SOME = 1 << 12                                        # of these there is room for at first
REACHES = Declared("triangle", np.uint32)             # rows that it may touch
SHARE = 512                                           # triangles that a work-item draws, or
BANDS = 4                                             # of the picture for each core,
AREA = 12                                             # where there are so many samples for a triangle


def raster(gpu: Any, view: np.void, strands: DeviceStrands | None = None, body: Any = None,
           visible: Any = None, after: Any = None) -> Any:
    """Draw `DeviceStrands` as lines and a `Surface` or `Shell` as triangles -> [rows, width, samples] uint64.

    A sample holds depth << 32 | id: depth in 1/DEPTH_ONE (0 at the near plane), id the number of a segment's
    first point or BODY | triangle.  Strands are as wide as their width projects, but at least 1/samples of a
    pixel.  Equal depths go to the smaller id.  ``visible``: such an array to draw into, with what is there already.
    ``after``: [rows, width, samples] uint32; if given, triangles count only where they face the eye behind this depth.
    """
    width, _, samples, _ = (int(n) for n in view["size"])
    rows = int(view["rows"][1] - view["rows"][0])
    shape, n = (rows, width, samples), 0 if body is None else len(body.triangles)
    fresh = visible is None and gpu.lanes > 1 and 0 < AREA * n <= math.prod(shape)   # `raster.bands` fills it
    if visible is None:
        visible = gpu.empty(shape, VISIBLE.dtype) if fresh else VISIBLE.empty(gpu, shape)
    for phase in range(1 if gpu.int64_atomics else 2):
        if body is not None:
            _body(gpu, view, body, after, phase, visible, fresh and not phase)
        if strands is not None and len(strands.points):
            _lines(gpu, view, strands, phase, visible)
    return visible


def _body(gpu, view, body, after, phase, visible, fresh):
    """Draw triangles.  Where a driver ends long loops, large ones and those that are clipped window by window."""
    n, rows = len(body.triangles), len(visible)
    known = {"view": view, "positions": body.positions, "triangles": body.triangles, "first": body.first_triangle,
             "facing": after is not None, "after": gpu.empty(0, np.uint32) if after is None else after, "phase": phase,
             "visible": visible}
    if gpu.lanes > 1:
        if n:
            _side_by_side(gpu, n, fresh, **known)
        return
    bands = _bands(view, body) if not gpu.steps else 1
    left, n_left = _left(gpu, "raster.body", n * bands, n=n, band=-(-rows // bands), side=_side(gpu, view, 1), **known)
    _pieces(gpu, "raster.body_pieces", left, n_left, CLIPPED, **known)


def _side_by_side(gpu, n, fresh, **known):
    """Draw n triangles where samples go side by side: each band of rows by one work-item, or some triangles by each,
    where they are so small that to find those of a band would take longer."""
    rows, in_bands = len(known["visible"]), AREA * n <= known["visible"].size
    reaches = REACHES.empty(gpu, n + gpu.lanes - 1 if in_bands else 0)
    if in_bands:
        gpu.launch("raster.reach", -(-n // gpu.lanes), n=n, reaches=reaches,
                   **{name: known[name] for name in ("view", "positions", "triangles")})
    band = -(-rows // min(BANDS * gpu.device.max_compute_units, rows))
    gpu.launch("raster.bands", -(-rows // band) if in_bands else -(-n // SHARE), n=n, share=0 if in_bands else SHARE,
               reaches=reaches, band=band, fresh=fresh, **known)


def _lines(gpu, view, strands, phase, visible):
    """Draw strands.  Where a driver ends long loops, in stretches, and large segments window by window."""
    n, known = len(strands.spans), {"view": view, "phase": phase, "visible": visible}
    for stretch in stretches_of(gpu, strands, 8):   # three steps each, and as many again for what they show
        left, n_left = _left(gpu, "raster.lines", -(-n // drawn(gpu.lanes)), strands=n, first=strands.first_point,
                             stretch=stretch, steps=gpu.own_steps // 2, **known,
                             **arrays(strands, "points", "spans", "shifts"))
        _pieces(gpu, "raster.line_pieces", left, n_left, 1, points=strands.points, **known)


def _left(gpu, kernel, size, **known):
    """Launch a kernel that may leave some -> these, and how many there are."""
    room, n = SOME if gpu.steps else 0, None
    while n is None or n > room:   # to draw the others once more changes nothing
        room = max(room, n or 0)
        left = LEFT.empty(gpu, room)
        counter = gpu.full(1, np.uint32, 0) if gpu.steps else gpu.empty(0, np.uint32)
        gpu.launch(kernel, size, room=room, left=left, n_left=counter, **known)
        n = int(gpu.download(counter)[0]) if gpu.steps else 0
    return left, n


def _pieces(gpu, kernel, left, n, pieces, view, **known):
    """Draw n that are left, each in so many pieces at most, window by window of the picture."""
    if n:
        side, rows = _side(gpu, view, pieces), int(view["rows"][1] - view["rows"][0])
        windows = -(-int(view["size"][0]) // side) * -(-rows // side)
        gpu.launch(kernel, n * windows, n=n, left=left, side=side, view=view, **known)


def _side(gpu, view, pieces):
    """Side of a square of pixels in which so many pieces can be drawn before a driver ends the loop; 0: any."""
    return max(math.isqrt(gpu.steps // (2 * pieces * int(view["size"][2]))), 2) if gpu.steps else 0


def _bands(view, body):
    """Bands to divide the rows into, so that no work-item has much more than 2^14 samples to visit.

    A long work-item holds up everything behind it.
    """
    width, _, samples, _ = (int(n) for n in view["size"])
    rows = int(view["rows"][1] - view["rows"][0])
    if body is None or not len(body.triangles):
        return 1
    nearest = view["to_screen"][3, 2] if view["eye"][3] else 1     # of all that is seen, in w
    longest = body.longest * view["scale"][0] / nearest + 1        # pixels that the longest side can span
    visits = min(longest, width) * min(longest, rows) * samples
    return int(min(max(-(-visits // 2**14), 1), rows))
