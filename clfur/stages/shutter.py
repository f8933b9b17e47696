"""Pictures of a shutter's time -> their mean, in whatever order they come."""

from typing import Any

import numpy as np

from ..layout import Declared

SUMS = Declared("value", np.int64, None, 0)   # of a picture's numbers, in 2^-32


def add(gpu: Any, picture: Any, sums: Any = None) -> Any:
    """Add a picture, float32 on the device, to ``sums``, none if None -> `SUMS`, of its shape."""
    sums = SUMS.empty(gpu, picture.shape) if sums is None else sums
    gpu.launch("shutter.add", picture.size, picture=picture, sums=sums)
    return sums


def mean(gpu: Any, sums: Any, pictures: int) -> Any:
    """The mean of so many pictures that `add` has added up -> float32, of their shape."""
    out = gpu.empty(sums.shape, np.float32)
    gpu.launch("shutter.mean", sums.size, pictures=pictures, sums=sums, out=out)
    return out
