"""Pictures at half their size, and at a half of that, by the mean of what each pixel covers."""

import numpy as np


def halved(picture: np.ndarray, axis: int) -> np.ndarray:
    """Return a picture [h, w, n] with half as many rows (axis 0) or columns (1), rounded down but at least one.

    Each is the mean of what it covers of the larger one, 2 or, of an odd number, 2 + 1/n pixels, so that the mean of
    all stays the same (Guthe and Heckbert, "Non-Power-of-Two Mipmapping", 2005).
    """
    pixels = picture.shape[axis]
    if pixels == 1:
        return picture
    half = pixels // 2
    one, two = (picture.take(np.arange(k, k + 2 * half, 2), axis) for k in (0, 1))
    if pixels % 2 == 0:
        return (one + two) / 2
    three = picture.take(np.arange(2, 2 + 2 * half, 2), axis)
    at = np.arange(half, dtype=picture.dtype).reshape((-1, 1, 1) if axis == 0 else (1, -1, 1))
    return ((half - at) * one + half * two + (at + 1) * three) / pixels


def levels_of(picture: np.ndarray) -> list[np.ndarray]:
    """Return a picture [h, w, n] and all that come of it by halving both sides, down to a single pixel."""
    levels = [picture]
    while levels[-1].shape[:2] != (1, 1):
        levels.append(halved(halved(levels[-1], 0), 1))
    return levels
