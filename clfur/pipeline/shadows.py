"""What stands before the lights: hair in a grid of cells, the body in a shadow map, of each light."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .. import layout
from ..errors import Error
from ..scene import Scene
from ..settings import Settings
from ..stages import shells
from ..stages.discs import discs
from ..stages.lighting import Lighting, lighting_of
from ..stages.raster import raster
from ..stages.strands import DeviceStrands
from ..stages.tessellate import Surface
from ..stages.voxelize import crossing_unit_for, depths_for, most_of, self_shadow, voxelize
from ..stages.zscan import zscan
from .fit import Fit
from .views import Rig, grid_of

NARROWEST = 0.25   # columns of a grid by which the light of a disc's rim goes astray, that are worth a look
LEAST_SHARE = 1e-3  # of a spot's furthest distance
LEAST_WEIGHT = 4   # of a crossing in the counters, which rounding should not spoil


@dataclass(frozen=True)
class ShadowPlan:
    """How a light's shadow is cast, before anything is.

    light: `layout.Light`.  grid, light_view: `layout.Grid` and `layout.View` of it, or None where there is no hair or
    no body to cast a shadow.  method: as in `Settings.shadows`.  weights: [types] uint32, what a crossing of each
    adds; of shells: the last.  crossing_unit: what one amounts to.  shadow: `layout.Shadow`.  shifts: of a light that
    is a disc, see `stages.discs`, or None.
    """

    light: np.void
    grid: np.void | None
    light_view: np.void | None
    method: str
    weights: Any
    crossing_unit: int
    shadow: np.void
    shifts: Any = None


def shells_depth(alpha: float, method: str) -> float:
    """Optical depth of one crossing in shell fur, as `depths_for` tells of strands.

    Hairs that stand in a pattern are crossed more evenly than at random: in "length" their depth lies between that of
    strands, x = 1 - alpha, and -ln(alpha) = x + x²/2 + x³/3 ...; the first two terms are near what rays through the
    fur measure, and stay finite.
    """
    x = 1 - alpha
    return x + x * x / 2 if method == "length" else depths_for([alpha], method)[0]


def plan_shadows(rig: Rig, strands: int, body: bool, shell_bounds: tuple | None = None) -> list[ShadowPlan]:
    """[`ShadowPlan`] of each light of a `Rig`, for this many strands, and whether there is a body.

    Raises `clfur.Error` if counters could overflow.
    ``shell_bounds``: `stages.shells.bounds_of` the scene's shells, if they are to cast shadows.
    """
    return [_plan(rig, number, *of_light, strands, body, shell_bounds)
            for number, of_light in enumerate(zip(rig.lights, rig.grids, rig.light_views))]


def _most(rig, grid, strands, shell_bounds):
    """The fragments or crossings in a grid that hair cannot exceed."""
    settings = rig.settings
    segments, length, area, nearest = rig.fit.hair_before(grid, strands)
    most = most_of(grid, settings.shadows, segments, length, area, nearest)
    if shell_bounds:
        pieces, area = shell_bounds
        most += most_of(grid, "length", pieces, 0.0, area, nearest)
    return most


def _plan(rig, number, light, grid, light_view, strands, body, shell_bounds):
    """`ShadowPlan` of one light."""
    scene, settings = rig.scene, rig.settings
    method, weights, crossing_unit, shadow = settings.shadows, None, 0, np.zeros((), layout.Shadow)
    hairs = scene.strands.hair_types if scene.strands else []
    depths = depths_for([hair.alpha for hair in hairs], method)
    if shell_bounds:
        depths = np.append(depths, shells_depth(scene.shells.alpha, method))
    some = np.array([strands > 0] * len(hairs) + [True] * bool(shell_bounds), bool)
    if grid is not None and (depths[some] > 0).any():
        crossing_unit = crossing_unit_for(_most(rig, grid, strands, shell_bounds))
        weights = np.rint(crossing_unit * depths / depths.max()).astype(np.uint32)
        if min(weights[depths > 0]) < LEAST_WEIGHT and rig.fit.seen.cropped:   # too small cells
            grid = grid_of(scene, settings.grid, scene.lights[number], Fit(scene, replace(rig.fit.seen, cropped=False)))
            crossing_unit = crossing_unit_for(_most(rig, grid, strands, shell_bounds))
            weights = np.rint(crossing_unit * depths / depths.max()).astype(np.uint32)
        if min(weights[depths > 0]) < LEAST_WEIGHT:
            raise Error(f"Settings.grid is {settings.grid}; allowed: fewer cells, less hair, hair types of more equal "
                        f"alpha or a spot with a wider angle, so that 32-bit counters can hold the hair's shadow")
        shadow["hair"] = depths.max(), *self_shadow(grid, method), method == "length"
    else:
        grid = None
    if light_view is not None and body:
        shadow["body"][:2] = 1, settings.pcf
        shadow["disc"][0] = _disc(scene.lights[number], light_view)
    else:
        light_view = None
    shifts = None if grid is None else _shifts(scene.lights[number], grid)
    return ShadowPlan(light, grid, light_view, method, weights, crossing_unit, shadow, shifts)


def accumulate(gpu: Any, plans: list[ShadowPlan], strands: DeviceStrands, body: Surface, counted: list | None = None,
               shell: tuple[shells.Shell, np.void] | None = None) -> list:
    """Put strands and body, or a part of them, before all lights -> [cells of each light, then shadow map of each];
    None where none is planned.

    Cells are [nz, ny, nx] uint32, maps [size, size, 1] uint64.
    ``counted``: what is there already, as it is given back.  ``shell``: `stages.shells.Shell` and its `layout.Shells`,
    which are put there once in all.
    """
    n = len(plans)
    counted = list(counted or [None] * (2 * n))
    for i, plan in enumerate(plans):
        if plan.grid is not None:
            counted[i] = voxelize(gpu, plan.grid, strands, plan.method, plan.weights, counted[i])
            if shell is not None:
                counted[i] = shells.deposit(gpu, plan.grid, *shell, plan.method, plan.weights[-1], counted[i])
        if plan.light_view is not None:
            with gpu.labelled("shadow_map"):
                counted[n + i] = raster(gpu, plan.light_view, None, body, counted[n + i])
    return counted


def finish(gpu: Any, plans: list[ShadowPlan], counted: list) -> Lighting:
    """What `accumulate` gave in the end, which it takes from the list -> `Lighting`."""
    crossings = []
    for i, plan in enumerate(plans):   # cells go as soon as they are summed
        cells, counted[i] = counted[i], None
        crossings.append(None if cells is None else _sums(gpu, cells, plan))
        del cells
    maps = counted[len(plans):]
    return lighting_of(gpu, [plan.light for plan in plans], [plan.shadow for plan in plans],
                       [plan.grid for plan in plans], [plan.light_view for plan in plans], crossings, maps)


def _disc(light, view):
    """`disc` of a `layout.Shadow`: of a light of a scene that has a size, and of the view of its map."""
    size = int(view["size"][0])
    if light.position is None:   # as deep as wide
        return math.tan(math.radians(light.size) / 2) * size
    return light.size * float(view["scale"][0]) / float(view["to_screen"][3, 2])


def _sums(gpu, cells, plan):
    """What lies before each layer of a light's cells, as seen from all of its disc."""
    shifts = plan.shifts
    if shifts is None:
        return zscan(gpu, cells, plan.crossing_unit)
    return discs(gpu, cells, plan.crossing_unit, float(plan.shadow["hair"][0]), shifts)


def _shifts(light, grid):
    """How many columns of a grid a ray to the rim of a light's disc passes, at each half layer, [2 nz + 1] float32,
    from that in the middle of the grid on; None where it is too narrow to be seen in it."""
    nz, side = int(grid["size"][2]), float(grid["face"][1])
    at, m = np.arange(2 * nz + 1) / 2, grid["to_grid"].astype(float)
    if light.position is None:
        shifts = math.tan(math.radians(light.size) / 2) * at
    else:   # distances, by the way the light looks, of whole layers
        depth = float(np.linalg.norm(m[:3, 2]))
        distance = (at - (m[3, 2] + light.position @ m[:3, 2])) / depth
        shifts = -light.size / side / np.maximum(distance, LEAST_SHARE * distance[-1])
    shifts = np.clip(shifts - shifts[nz], -nz / 2, nz / 2)   # a disc as wide as the grid
    return shifts.astype(np.float32) if np.ptp(shifts) >= NARROWEST else None


def cast_shadows(gpu: Any, scene: Scene, settings: Settings, strands: DeviceStrands, body: Surface,
                 shell: tuple[shells.Shell, np.void] | None = None) -> Lighting:
    """The lights of a scene, and the shadows of whole strands, a whole body, and shells as in `accumulate`
    -> `Lighting`."""
    bounds = shells.bounds_of(gpu, shell[0]) if shell else None
    plans = plan_shadows(Rig.of(scene, settings), len(strands.spans), len(body.triangles) > 0, bounds)
    return finish(gpu, plans, accumulate(gpu, plans, strands, body, shell=shell))
