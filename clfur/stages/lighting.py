"""The lights on the device, and what stands before each: one class for all that light anything."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import layout
from ..layout import Arrays, array
from .raster import VISIBLE
from .zscan import SUMS


@dataclass(frozen=True)
class Lighting(Arrays):
    """Lights, and what stands before each."""

    lights: Any = array("light", layout.Light)
    shadows: Any = array("light", layout.Shadow)      # where its crossings and its shadow map begin, among others
    grids: Any = array("light", layout.Grid)
    light_views: Any = array("light", layout.View)
    crossings: Any = array(SUMS)          # [nz + 1, ny, nx] before each layer of a grid; one grid's after the other
    shadow_maps: Any = array(VISIBLE)     # [size, size] the raster of the body in a view; one view's after the other

    def arrays(self) -> dict:
        """All of it, as arguments of a launch."""
        return {"n_lights": len(self.lights), **vars(self)}


def unshadowed(gpu: Any, *lights: np.void) -> Lighting:
    """`Lighting` of `layout.Light`s before which nothing stands."""
    none = [None] * len(lights)
    return lighting_of(gpu, lights, none, none, none, none, none)


def lighting_of(gpu: Any, lights: tuple | list, shadows: list, grids: list, light_views: list,
                crossings: list, shadow_maps: list) -> Lighting:
    """`Lighting` of what there is of each light, None where there is none.

    lights: [`layout.Light`].  shadows: [`layout.Shadow`].  grids: [`layout.Grid`], crossings: what `zscan` gives for
    each, [nz + 1, ny, nx] float32.  light_views: [`layout.View`], shadow_maps: what `raster` gives for each, [size,
    size, 1] uint64.
    """
    packed = _packed(shadows, layout.Shadow)
    for first, arrays in ((0, crossings), (2, shadow_maps)):
        sizes = [0 if array is None else array.size for array in arrays]
        begins = np.cumsum([0] + sizes[:-1], dtype=np.uint64)
        halves = np.stack([begins & np.uint64(0xFFFFFFFF), begins >> np.uint64(32)], 1)
        packed["place"][:, first:first + 2] = halves.astype(np.uint32).view(np.int32)
    return Lighting(gpu.upload(_packed(lights, layout.Light)), gpu.upload(packed),
                    gpu.upload(_packed(grids, layout.Grid)), gpu.upload(_packed(light_views, layout.View)),
                    gpu.joined(crossings, SUMS.dtype), gpu.joined(shadow_maps, VISIBLE.dtype))


def _packed(structs, dtype):
    """Structs, zeros for None -> [n] array."""
    packed = np.zeros(len(structs), dtype)
    for i, struct in enumerate(structs):
        if struct is not None:
            packed[i] = struct
    return packed
