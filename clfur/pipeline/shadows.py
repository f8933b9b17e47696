"""What stands before the light: hair in a grid of cells, the body in a shadow map."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import layout
from ..errors import Error
from ..scene import hair_bounds
from ..stages import lod, shade, shells
from ..stages.raster import raster
from ..stages.voxelize import depths_for, most_of, own_share, unit_for, voxelize
from ..stages.zscan import zscan
from .views import Rig


@dataclass(frozen=True)
class Plan:
    """How a scene's shadows are cast, before anything is.

    grid, seen: `layout.Grid` and `layout.View` of the light, or None where there is no hair or no body to cast shadows.
    method: as in `Settings.shadows`.  weights: [types] what a crossing of each adds; of shells: the last.  unit: what
    one amounts to.  shadow: `layout.Shadow`.
    """

    grid: Any
    seen: Any
    method: str
    weights: Any
    unit: int
    shadow: Any


def shells_depth(alpha, method):
    """Optical depth of one crossing in shell fur, as `depths_for` tells of strands.

    Hairs that stand in a pattern are crossed more evenly than at random: in "length" their depth lies between that of
    strands, x = 1 - alpha, and -ln(alpha) = x + x²/2 + x³/3 ...; the first two terms are near what rays through the
    fur measure, and stay finite.
    """
    x = 1 - alpha
    return x + x * x / 2 if method == "length" else depths_for([alpha], method)[0]


def plan_shadows(rig, strands, body, fur=None):
    """`Plan` for a `Rig`, this many strands, and whether there is a body.

    Raises `clfur.Error` if counters could overflow.
    ``fur``: `stages.shells.bounds_of` the scene's shells, if they are to cast shadows.
    """
    scene, settings = rig.scene, rig.settings
    method, grid, seen, weights, unit = settings.shadows, None, None, None, 0
    shadow = np.zeros((), layout.Shadow)
    hairs = scene.strands.hair_types if scene.strands else []
    depths = depths_for([hair.alpha for hair in hairs], method)
    if fur:
        depths = np.append(depths, shells_depth(scene.shells.alpha, method))
    some = np.array([strands > 0] * len(hairs) + [True] * bool(fur), bool)
    if method != "off" and (depths[some] > 0).any():
        grid = rig.grids[0]
        segments, length, area = hair_bounds(scene.strands, strands) if strands else (0, 0, 0)
        most = most_of(grid, method, segments, length, area * (lod.WIDEST if settings.lod else 1))
        if fur:
            most += most_of(grid, "length", fur[0], 0.0, fur[1])
        unit = unit_for(most)
        weights = np.rint(unit * depths / depths.max()).astype(np.uint32)
        if min(weights[depths > 0]) < 4:
            raise Error(f"Settings.grid is {settings.grid}; allowed: fewer cells, less hair, hair types of more equal "
                        f"alpha or a spot with a wider angle, so that 32-bit counters can hold the hair's shadow")
        shadow["hair"] = depths.max(), *own_share(grid, method), method == "length"
    if method != "off" and body and settings.shadow_map:
        seen = rig.light_views[0]
        shadow["body"][:2] = 1, settings.pcf
    return Plan(grid, seen, method, weights, unit, shadow)


def cast(gpu, plan, strands, body, cells=None, seen=None, shell=None):
    """Put strands and body, or a part of them, before the light -> (cells, map), each None if it isn't planned.

    ``cells``, ``seen``: what is there already.  ``shell``: `stages.shells.Shell` and its `layout.Shells`, which are put
    there once in all.
    """
    if plan.grid is not None:
        cells = voxelize(gpu, plan.grid, strands, plan.method, plan.weights, cells)
        if shell is not None:
            cells = shells.deposit(gpu, plan.grid, *shell, plan.method, plan.weights[-1], cells)
    if plan.seen is not None:
        with gpu.called("shadow_map"):
            seen = raster(gpu, plan.seen, None, body, seen)
    return cells, seen


def settle(gpu, plan, cells, seen):
    """What `cast` gave in the end -> `shade.Shadows`."""
    none = shade.no_shadows(gpu)
    return shade.Shadows(plan.shadow,
                         none.grid if cells is None else plan.grid,
                         none.seen if seen is None else plan.seen,
                         none.sums if cells is None else zscan(gpu, cells, plan.unit),
                         none.map if seen is None else seen)


def cast_shadows(gpu, scene, settings, strands, body, shell=None):
    """The shadows of whole strands and a whole body, and of shells as in `cast` -> `shade.Shadows`."""
    bounds = shells.bounds_of(gpu, shell[0]) if shell else None
    plan = plan_shadows(Rig.of(scene, settings), len(strands.spans), len(body.triangles), bounds)
    return settle(gpu, plan, *cast(gpu, plan, strands, body, shell=shell))
