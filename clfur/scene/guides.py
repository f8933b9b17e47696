"""Guides: Curves that stand on a mesh, between which strands are interpolated."""

from typing import Any

import numpy as np

from ..errors import Error
from . import checks
from .remembered import remembered

TOLD, MOST_AWAY = 0.02, 0.1   # radii of the mesh that a guide's root may be away from it untold, and at all


def guides(value: Any, where: str) -> Any:
    """Return what `Strands.guides` takes."""
    from .curves import Curves  # which needs the types of strands
    if value is None:
        return None
    if not isinstance(value, Curves):
        checks.refuse(where, value, "None or an object of class Curves")
    if not (value.counts > 1).any():
        raise Error(f"{where} has {len(value.counts):,} strands, none of two points or more; allowed: one at least")
    return value


@remembered(4)
def reach_of(curves: Any) -> tuple[float, float]:
    """Return (how far guides reach from their roots at most, how long the longest is), in world units."""
    points, counts = curves.on_host.points.astype(np.float64), curves.counts.astype(np.int64)
    first = (np.cumsum(counts) - counts)[counts > 0]
    away = np.linalg.norm(points - np.repeat(points[first], counts[counts > 0], 0), axis=1)
    steps = np.zeros(len(points))
    steps[1:] = np.linalg.norm(np.diff(points, axis=0), axis=1)
    steps[first] = 0
    return float(away.max()), float(np.add.reduceat(steps, first).max())


def far_from(mesh: Any, away: np.ndarray, where: str = "Strands.guides") -> str:
    """Return in a line how far roots of Curves, that ``where`` has, are ``away`` [strands] from a mesh, "" where it is
    no further than rounding and bulging faces may bring about. Raises Error where they cannot be meant for it."""
    _, radius = mesh.bounds
    worst, some = float(away.max()), int((away > TOLD * radius).sum())
    line = (f"{where} has {some:,} of {len(away):,} roots more than {TOLD * radius:.3g} away from Scene.mesh, "
            f"one {worst:.3g}")
    if not worst <= MOST_AWAY * radius:
        raise Error(f"{line}; allowed: at most {MOST_AWAY * radius:.3g}, a tenth of the mesh's radius: are units and "
                    "axes those of the mesh?")
    return line + "; their strands stand on it all the same" if some else ""
