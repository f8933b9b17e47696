"""Colours as files code them, and as linear light."""

import functools
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


def srgb_codes(linear: np.ndarray) -> np.ndarray:
    """Return the nearest 8-bit sRGB codes of linear light: uint8 of the same shape; NaN is 0.

    linear: float32, contiguous. They are what `linear_to_srgb` would give, times 255 and rounded, for every float32,
    but looked up, in a tenth of the time.
    """
    bits = linear.view(np.uint32)
    found = _codes().take(bits >> 16)
    found += bits & 0xFFFF   # which carries from where the next code begins
    found >>= 16
    return found.astype(np.uint8)


@functools.cache
def _codes():
    """A table [65536] by the upper 16 bits of a float32 -> uint32: the code of the first float that has them << 16, and
    2^16 less the lower 16 bits of the first float that has the next code, where one of them does, else 0.

    No such 2^16 floats have more than two codes. Below 0 all is code 0, beyond 1 all is 255, and NaN, which follows
    infinity, is 255 + 1, of which the lower 8 bits are 0.
    """
    low, high = np.zeros(255, np.uint32), np.full(255, np.float32(1).view(np.uint32))
    while (low < high).any():   # the first float of each code from 1 on: codes rise with the bits of a float
        middle = low + (high - low) // 2
        reached = linear_to_srgb(middle.view(np.float32)) * 255 + 0.5 >= np.arange(1, 256)
        low, high = np.where(reached, low, middle + 1), np.where(reached, middle, high)
    first = np.arange(1 << 15, dtype=np.uint32) << 16
    table = np.zeros(1 << 16, np.uint32)
    table[:1 << 15] = np.searchsorted(low, first, "right").astype(np.uint32) << 16
    table[low >> 16] += (65536 - (low & 0xFFFF)) * (low & 0xFFFF != 0)
    infinity = np.float32(np.inf).view(np.uint32) >> 16
    table[infinity:1 << 15] = 0
    table[infinity] = (255 << 16) + 65535
    return table
