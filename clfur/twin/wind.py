"""What cl/wind.cl means, in float64."""

import numpy as np

from .strands import random3


def wind_at(places, mean, gust, size, time, seed):
    """The wind [n, 3] at places: Perlin's smooth steps between random numbers at whole cells, which mean carries."""
    at = (np.asarray(places, float) - np.asarray(mean, float) * time) / size
    low = np.floor(at).astype(int)
    step = np.polyval([6, -15, 10, 0, 0, 0], at - low)
    sums = np.zeros_like(at)
    for corner in np.ndindex(2, 2, 2):
        cell = (low + corner) % 1024
        words = random3(cell @ [1, 1024, 1024**2], seed, 9)
        share = np.where(corner, step, 1 - step).prod(1)
        sums += share[:, None] * ((words >> np.uint32(8)) / 2**23 - 1)
    return mean + gust * sums
