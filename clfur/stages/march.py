"""Rays that go through shell fur -> its light, and how much of what is behind it they see."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..layout import Arrays, array, block
from .lighting import Lighting
from .raster import NONE, raster
from .shade import IMAGE
from .shells import Shell
from .sky import SkyLight, arguments

ENTRIES = 8                  # times that a ray may come into the fur


@dataclass(frozen=True)
class Rays(Arrays):
    """How far the rays of a picture's samples have come."""

    after: Any = array("sample", np.uint32, None, 0)   # depth where they came in last; NOTHING: they are done
    shell_transmittance: Any = array("sample", np.float32, None, 1)   # share of light that comes from behind
    shell_front: Any = array("sample", np.uint64, None, NONE)   # depth << 32 | face where half of it is gone


def march(gpu: Any, view: np.void, shell: Shell, packed: np.void, lighting: Lighting,
          visible: Any, sky: SkyLight | None = None) -> tuple[Any, Any, Any]:
    """Take all rays through the fur -> (image, shell_transmittance, shell_front).

    ``view``: a `layout.View`.  ``packed``: the shell's `layout.Shells`.  ``visible``: [rows, width, samples] uint64,
    what `raster` gives of all else.  ``sky``: its light, if there is one.
    image: [rows, width, 4] float32, the light of the fur, premultiplied.  shell_transmittance: [rows, width, samples]
    float32, the share of light that comes from what ``visible`` holds.  shell_front: [rows, width, samples] uint64,
    depth << 32 | face where half of it is gone.
    """
    rows, width, _samples = visible.shape
    image, rays = IMAGE.empty(gpu, (rows, width)), Rays.empty(gpu, {"sample": visible.shape})
    pattern = shell.pattern
    across, down = block(max(gpu.lanes, gpu.hinted))
    blocks = -(-width // across) * -(-rows // down)
    for _ in range(ENTRIES):
        left = gpu.full(1, np.int32, 0)
        with gpu.labelled("entries"):
            entries = raster(gpu, view, None, shell, after=rays.after)
        gpu.launch("march.march", blocks, view=view, shells=packed, visible=visible, entries=entries,
                   border=shell.border, faces=pattern.faces, neighbours=pattern.neighbours, curves=shell.curves,
                   normals=shell.normals, lattice=pattern.lattice, noise=pattern.noise, means=pattern.means,
                   left=left, image=image, **vars(rays), **lighting.arrays(),
                   **arguments(gpu, sky))
        del entries   # before the next are made
        if not int(gpu.download(left)[0]):
            break
    return image, rays.shell_transmittance, rays.shell_front
