"""What cl/blur.cl means, in float64: the whole square of a Gaussian at once, around every pixel."""

import math

import numpy as np


def blur(image, sigma, edges):
    """[h, w, 4] -> [h, w, 4] float64, blurred; only where coverage changes if ``edges``."""
    image = np.asarray(image, np.float64)
    radius = math.ceil(3 * sigma)
    y, x = np.mgrid[-radius:radius + 1, -radius:radius + 1]
    square = np.exp(-(x * x + y * y) / (2 * sigma * sigma))
    square /= square.sum()
    wide = np.pad(image, ((radius, radius), (radius, radius), (0, 0)), "edge")
    windows = np.lib.stride_tricks.sliding_window_view(wide, square.shape, (0, 1))
    soft = np.einsum("yxcij,ij->yxc", windows, square)
    if not edges:
        return soft
    share = np.clip((np.minimum(soft[..., 3:], 1 - soft[..., 3:]) - 1 / 64) / (1 / 4 - 1 / 64), 0, 1)
    return image + share * (soft - image)
