"""Rays that go through shell fur -> its light, and how much of what is behind it they see."""

import numpy as np

from .raster import NONE, raster
from .shade import no_shadows

ENTRIES = 8                  # times that a ray may come into the fur


def march(gpu, view, shell, packed, light, visible, shadows=None):
    """Take all rays through the fur -> (image, through, fur).

    image: [rows, width, 4] float32, the light of the fur, premultiplied. through: [rows, width, samples] float32, the
    share of light that comes from what ``visible`` holds. fur: [rows, width, samples] uint64, depth << 32 | face where
    half of it is gone.
    """
    rows, width, samples = visible.shape
    shadows = shadows or no_shadows(gpu)
    image = gpu.full((rows, width, 4), np.float32, 0)
    through, after = gpu.full(visible.shape, np.float32, 1), gpu.full(visible.shape, np.uint32, 0)
    fur = gpu.full(visible.shape, np.uint64, NONE)
    pattern = shell.pattern
    across, down = (1, 1) if gpu.lanes == 1 else (4, gpu.lanes // 4)   # a work-item's pixels
    blocks = -(-width // across) * -(-rows // down)
    for _ in range(ENTRIES):
        left = gpu.full(1, np.int32, 0)
        with gpu.called("entries"):
            entries = raster(gpu, view, None, shell, after=after)
        gpu.launch("march.march", blocks, view=view, shells=packed, light=light, visible=visible, entries=entries,
                   border=shell.border, faces=pattern.faces, neighbours=pattern.neighbours, curves=shell.curves,
                   normals=shell.normals, lattice=pattern.lattice, noise=pattern.noise, means=pattern.means,
                   noise_box=pattern.box, after=after, through=through, fur=fur, left=left, image=image,
                   **shadows.arrays())
        if not int(gpu.download(left)[0]):
            break
    return image, through, fur
