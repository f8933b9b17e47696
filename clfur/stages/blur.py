"""Picture -> the same, blurred: all of it, or where fur ends."""

import math
from typing import Any

import numpy as np


def blur_radius(sigma: float) -> int:
    """Pixels to each side that a blur of this many reaches."""
    return math.ceil(3 * sigma)


def blur(gpu: Any, image: Any, sigma: float, edges: bool, rows: tuple[int, int] | None = None) -> Any:
    """Lay a Gaussian of ``sigma`` pixels, cut off at 3 sigma, over an image -> [rows, width, 4] float32.

    image: [h, w, 4] float32, linear and premultiplied, on the device.  ``edges``: only where coverage changes within
    its radius; the rest keeps its bits.  ``rows``: (first, one past the last) that are wanted, all if None.
    """
    height, width, _ = image.shape
    first, end = rows or (0, height)
    radius = blur_radius(sigma)
    weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    weights = gpu.upload((weights / weights.sum()).astype(np.float32))
    flat, result = gpu.empty(image.shape, np.float32), gpu.empty((end - first, width, 4), np.float32)
    for size, source, target in ((width, height, 0, 0), image, flat), ((width, height, first, 1), flat, result):
        gpu.launch("blur.along", target.size // 4, size=size, radius=radius, weights=weights, image=source, out=target)
    if edges:
        gpu.launch("blur.edges", (end - first) * width, first=first * width, image=image, blurred=result)
    return result
