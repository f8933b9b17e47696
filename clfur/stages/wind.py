"""The wind where hair is."""

from typing import Any

import numpy as np

from .. import layout

PERIOD = layout.CONSTANTS["PERIOD"]   # cells after which gusts come again


def blow(gpu: Any, state: Any, roots: Any, mean: Any, gust: float = 0.0, size: float = 1.0, time: float = 0.0,
         seed: int = 0) -> Any:
    """The wind at roots -> [3, padded] float32, world / s.

    mean: [3] world / s.  gust: how strong gusts are, likewise.  size: of their cells [world].  time: seconds in which
    the mean has carried them along.
    """
    winds = gpu.empty(3 * state.padded, np.float32)
    gone = np.remainder(np.asarray(mean, float) * time / size, PERIOD)
    gpu.launch("wind.blow", state.padded, padded=state.padded, roots=roots, mean=(*mean, gust),
               gone=(*gone, 1 / size), seed=seed, winds=winds)
    return winds
