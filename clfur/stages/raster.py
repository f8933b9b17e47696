"""Strands and body triangles -> the nearest (depth, id) of every sample of a view."""

import numpy as np

NONE = (1 << 64) - 1   # nothing there: depth and id NOTHING


def raster(gpu, view, strands=None, body=None):
    """Draw `Grown` strands as lines and a `Surface` as triangles -> [height, width, samples] uint64.

    A sample holds depth << 32 | id: depth in 1/DEPTH_ONE (0 at the near plane), id the number of a segment's
    first point or BODY | triangle.  Strands are as wide as their width projects, but at least a sample's share
    of a pixel (1/samples).  Equal depths go to the smaller id.
    """
    width, height, samples, _ = (int(n) for n in view["size"])
    visible = gpu.full((height, width, samples), np.uint64, NONE)
    for one_pass in range(1 if gpu.int64_atomics else 2):
        if body is not None:
            gpu.launch("raster.body", len(body.triangles), view, body.positions, body.triangles,
                       np.int32(one_pass), visible)
        if strands is not None:
            gpu.launch("raster.lines", len(strands.spans), view, strands.points, strands.spans,
                       np.int32(one_pass), visible)
    return visible
