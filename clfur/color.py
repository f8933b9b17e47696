"""Colours as files code them, and as linear light."""

from typing import Any

import numpy as np


def srgb_to_linear(values: Any) -> np.ndarray:
    """Return linear light of sRGB-coded values.

    values: array of any shape; uint8 is 0..255, floats are 0..1. Returns float32 of the same shape.
    The exact two-part curve of IEC 61966-2-1.
    """
    values = np.asarray(values)
    if values.dtype == np.uint8:  # 256 results are enough for any picture
        return srgb_to_linear(np.arange(256) / 255.0)[values]
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
