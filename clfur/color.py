"""Colours as files code them, and as linear light."""

from typing import Any

import numpy as np


def is_coded(colors: np.ndarray) -> bool:
    """Whether colours are sRGB-coded, as the pixels of pictures are: uint8 and uint16 are."""
    return colors.dtype.kind == "u" and colors.dtype.itemsize <= 2


def linear_of(colors: np.ndarray) -> np.ndarray:
    """Return linear light of colours as they were given: the one rule for all of them.

    colors: array of any shape. Of dtype uint8 (0..255) or uint16 (0..65535) it is sRGB-coded, as pictures are: the
    result is float32. All other numbers are linear light already and come back as they are: floats, and whole numbers
    of another dtype, as NumPy makes of a list such as (1, 1, 1).
    """
    return srgb_to_linear(colors) if is_coded(colors) else colors


def srgb_to_linear(values: Any) -> np.ndarray:
    """Return linear light of sRGB-coded values.

    values: array of any shape; uint8 is 0..255, uint16 0..65535, floats are 0..1. Returns float32 of the same shape.
    The exact two-part curve of IEC 61966-2-1.
    """
    values = np.asarray(values)
    if is_coded(values):  # as many results as there are codes are enough for any picture
        most = np.iinfo(values.dtype).max
        return srgb_to_linear(np.arange(most + 1) / most)[values]
    coded = np.maximum(values.astype(np.float64), 0)
    linear = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    return linear.astype(np.float32)


def linear_to_srgb(values: Any) -> np.ndarray:
    """Return sRGB-coded values of linear light, both 0..1 (others are clipped): float32 of the same shape.

    The exact two-part curve of IEC 61966-2-1, the inverse of `srgb_to_linear`.
    """
    linear = np.clip(np.asarray(values, np.float32), 0, 1)
    coded = np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)
    return coded.astype(np.float32)
