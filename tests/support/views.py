"""Views to draw in, and strands as the raster takes them."""

import numpy as np

import clfur
from clfur import layout
from clfur.pipeline.views import view_of

SUBPIXEL = layout.CONSTANTS["SUBPIXEL"]
CUBE = np.array([[[-1, -1, -1], [1, 1, 1]]], np.float32)     # one strand that makes a scene's extent known


def flat(width, height, samples):
    """A view whose world is the picture: x, y in pixels, z the reversed depth, widths in pixels."""
    view = np.zeros((), layout.View)
    view["to_screen"] = view["to_world"] = np.eye(4)
    view["eye"] = 0, 0, 1, 0
    view["size"] = width, height, samples, layout.pattern_start(samples)
    view["scale"][0] = 1
    view["scale"][1] = SUBPIXEL / 2 / samples
    view["rows"][1] = height
    return view


def perspective(width, height, samples, **camera):
    """What a camera at (0, 0.4, 3.2) sees of the cube from -1 to 1."""
    camera = clfur.Camera(size=(width, height), **camera)
    return view_of(clfur.Scene(fur=clfur.Curves(CUBE, width=0), camera=camera), samples)


def pack(strands):
    """Strands, each [points, 4] x, y, z, width -> points [P, 4] float32, spans [strands, 2] uint32."""
    counts = np.array([len(s) for s in strands], np.uint32)
    points = np.concatenate([*(np.reshape(s, (-1, 4)) for s in strands), np.zeros((0, 4))])
    first = np.cumsum(counts) - counts
    return points.astype(np.float32), np.stack([first, counts], 1).astype(np.uint32)
