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


def points_of(light, n=256):
    """Lights without a size whose mean a `Light` is that is a disc: of n points of it (Vogel 1979), [n] structs."""
    disc, k = float(light["cone"][1]), np.arange(n)
    radius, turn = disc * np.sqrt((k + .5) / n), k * np.pi * (3 - np.sqrt(5))
    z = f64(light["direction"])[:3]
    x = unit(np.cross(z, np.eye(3)[np.abs(z).argmin()]))
    offset = (radius * np.cos(turn))[:, None] * x + (radius * np.sin(turn))[:, None] * np.cross(z, x)
    points = np.repeat(np.asarray(light)[None], n)
    points["cone"][:, 1] = 0
    if light["position"][3]:
        points["position"][:, :3] += offset
    else:
        points["direction"][:, :3] = unit(z + offset)
    return points
