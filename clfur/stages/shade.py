"""Visible samples -> the lit picture, and what else is known of its pixels."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .. import layout
from .strands import per


@dataclass(frozen=True)
class Shadows:
    """What stands between the light and a place."""

    shadow: Any       # layout.Shadow
    grid: Any         # layout.Grid
    sums: Any         # [nz + 1, ny, nx] float32 crossings before each layer
    seen: Any         # layout.View of the light
    map: Any          # [size, size, 1] uint64, the raster of the body
    hashes: dict = field(default_factory=dict)   # SHA-256 of counts and map, where asked for


def no_shadows(gpu):
    """`Shadows` of nothing."""
    return Shadows(np.zeros((), layout.Shadow), np.zeros((), layout.Grid), gpu.empty(0, np.float32),
                   np.zeros((), layout.View), gpu.empty(0, np.uint64))


def color(gpu, view, light, specular, visible, strands, body, body_color, shadows=None):
    """Light every sample and average -> [height, width, 4] float32, linear, premultiplied, alpha = coverage.

    Strands by Kajiya and Kay (1989), the body by Lambert; ``specular`` as in `clfur.Settings`.  ``shadows``: `Shadows`.
    """
    shadows = shadows or no_shadows(gpu)
    height, width, _ = visible.shape
    image = gpu.empty((height, width, 4), np.float32)
    gpu.launch("shade.color", (width, height), view, light, np.int32(specular == "half-vector"), visible,
               strands.points, strands.tangents, strands.strand_of, strands.normals, strands.uv, strands.types,
               strands.colors, np.int32(per(len(strands.colors), len(strands.spans), len(strands.points))),
               body.positions, body.normals, body.triangles, np.array([*body_color, 0], np.float32),
               shadows.shadow, shadows.grid, shadows.sums, shadows.seen, shadows.map, image)
    return image


def about(gpu, view, visible, strands, body):
    """What the nearest covered sample of each pixel sees -> {name: [height, width(, 4)]}.

    depth: float32 distance along the view axis, infinite where nothing is.  id: int32 strand, -1 nothing, -2 body.
    tangent, normal: float32 unit or 0.  uv: float32, of the body or the strand's root.  coverage: float32 0..1.
    """
    height, width, _ = visible.shape
    result = {
        "depth": gpu.empty((height, width), np.float32),
        "id": gpu.empty((height, width), np.int32),
        "tangent": gpu.empty((height, width, 4), np.float32),
        "normal": gpu.empty((height, width, 4), np.float32),
        "uv": gpu.empty((height, width, 4), np.float32),
        "coverage": gpu.empty((height, width), np.float32),
    }
    gpu.launch("shade.about", (width, height), view, visible,
               strands.points, strands.tangents, strands.strand_of, strands.uv,
               body.positions, body.normals, body.uv, body.triangles, *result.values())
    return result
