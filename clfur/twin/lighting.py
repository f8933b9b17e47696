"""What share_of_light in cl/light_lanes.h means, in float64: a light where nothing stands before it."""

import numpy as np

from .vectors import dot, f64, unit


def light_at(light, p):
    """A `Light` struct at places p [n, 3] -> (unit vectors to it [n, 3], its colour there [n, 3], its ambient)."""
    direction, color = f64(light["direction"])[:3], f64(light["color"])
    if light["position"][3] == 0:
        return np.broadcast_to(-direction, p.shape), np.broadcast_to(color[:3], p.shape), color[3]
    to_light = unit(f64(light["position"])[:3] - p)
    within = dot(to_light, -direction) >= float(light["cone"][0])
    return to_light, color[:3] * within[:, None], color[3]
