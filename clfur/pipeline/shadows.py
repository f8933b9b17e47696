"""What stands before the lights: hair in a grid of cells, the body in a shadow map, of each light."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .. import layout
from ..errors import Error
from ..scene import Scene
from ..settings import Settings
from ..stages import deep, shells
from ..stages.discs import discs
from ..stages.lighting import Lighting, lighting_of
from ..stages.raster import raster
from ..stages.strands import DeviceStrands
from ..stages.tessellate import Surface
from ..stages.voxelize import crossing_unit_for, depths_for, most_of, self_shadow, voxelize
from ..stages.zscan import zscan
from .fit import Fit
from .views import TILE, Rig, deep_of, grid_of

NARROWEST = 0.25   # columns of a grid by which the light of a disc's rim goes astray, that are worth a look
LEAST_SHARE = 1e-3  # of a spot's furthest distance
TILE_WIDTHS = 6.0       # widths of hair to a side of a tile of a light's map,
DEEP_MOST = 512         # of which there are at most so many a side
DEEP_REACH = 0.4        # half a side of the square that is shaded, in widths of hair
DEEP_ENTRIES = 1 << 23  # in all tiles of all maps together, about
DARK = 10.0             # optical depth behind which there is no light: 5e-5 of it
STEEPEST = 5.0          # as HAIR_STEEPEST in light.h
LEAST_WEIGHT = 4   # of a crossing in the counters, which rounding should not spoil


@dataclass(frozen=True)
class ShadowPlan:
    """How a light's shadow is cast, before anything is.

    light: `layout.Light`.  grid, light_view: `layout.Grid` and `layout.View` of it, or None where there is no hair or
    no body to cast a shadow.  method: `Settings.method`.  weights: [types] uint32, what a crossing of each
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
    most = most_of(grid, settings.method, segments, length, area, nearest)
    if shell_bounds:
        pieces, area = shell_bounds
        most += most_of(grid, "length", pieces, 0.0, area, nearest)
    return most


def _plan(rig, number, light, grid, light_view, strands, body, shell_bounds):
    """`ShadowPlan` of one light."""
    scene, settings = rig.scene, rig.settings
    method, weights, crossing_unit, shadow = settings.method, None, 0, np.zeros((), layout.Shadow)
    hairs, hairy = (scene.strands.hair_types, scene.strands.hairy) if scene.strands else ((), ())
    depths = depths_for([hair.alpha for hair in hairs], method) * np.array(hairy, bool)
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


@dataclass(frozen=True)
class DeepPlan:
    """Maps of the segments of hair that lights see, before there are any.

    views: of each light `layout.View`, or None.  maps: [lights] `layout.Deep`.  entries, segments: how many there may
    be in all, about.  strands: how many there are.
    """

    views: list
    maps: np.ndarray
    entries: int
    segments: int
    strands: int

    @property
    def tiles(self) -> np.ndarray:
        """[lights] how many tiles they have."""
        return self.maps["size"][:, 0].astype(np.int64) ** 2


def plan_deep(rig: Rig, strands: int) -> DeepPlan:
    """`DeepPlan` of the lights of a `Rig`, for this many strands: of tiles as small as the mean width of hair asks for,
    or larger ones that list fewer segments."""
    n = len(rig.lights)
    views: list = [None] * n
    maps, entries, all_segments, before = np.zeros(n, layout.Deep), 0, 0, 0
    casting = [i for i, grid in enumerate(rig.grids) if grid is not None and strands]
    for i in casting:
        segments, length, area, _ = rig.fit.hair_before(rig.grids[i], strands)
        width, side = area / length if length else 0.0, float(rig.grids[i]["face"][1]) * rig.settings.grid
        if rig.lights[i]["position"][3]:
            side *= rig.fit.frame(rig.scene.lights[i], rig.settings.grid)[2]   # where the middle of all is
        if not width > 0:
            continue
        tiles = math.ceil(min(side / (TILE_WIDTHS * width), DEEP_MOST))
        while tiles > 1 and _entries(segments, length, width, tiles / side) > DEEP_ENTRIES // len(casting):
            tiles -= 1
        views[i], maps[i] = deep_of(rig.scene, tiles, DEEP_REACH * width * TILE * tiles / side, rig.scene.lights[i],
                                    rig.fit)
        maps[i]["size"][1] = before
        before += tiles**2
        entries += _entries(segments, length, width, tiles / side)
        all_segments += segments
    return DeepPlan(views, maps, entries, all_segments, strands)


def _entries(segments, length, width, scale):
    """How many tiles, of which ``scale`` make a unit of length, list so many segments of such a length in all at most,
    about."""
    wide = 1 + (1 + 2 * DEEP_REACH) * width * scale
    return int(wide * (segments * wide + 4 / math.pi * length * scale))


def deep_maps(gpu: Any, plan: DeepPlan, hair: Callable[[], Iterable[DeviceStrands]],
              lighting: Lighting | None = None) -> deep.Deep:
    """Put strands into lists of their segments -> `Deep`.

    ``lighting``: what there is of the lights' grids and maps; what lies where they tell of no light is left out.
    ``hair``: gives the strands, part by part, each time that it is called.
    Raises `clfur.Error` if there is no room for so many entries, before anything is drawn.
    """
    mapped = [i for i, tiles in enumerate(plan.tiles) if tiles]
    dark = dark_of(gpu, plan, lighting)
    counted, survivors = gpu.full(int(plan.tiles.sum()), np.uint32, 0), gpu.full(1, np.uint32, 0)
    shown = {i: gpu.full(plan.strands, np.uint32, 0) for i in mapped}
    for strands in hair():
        for i in mapped:
            deep.count(gpu, plan.views[i], plan.maps[i], dark[i], strands, counted, survivors, shown[i])
        del strands   # goes before the next ones are made
    counts, segments = gpu.download(counted), int(gpu.download(survivors)[0])
    total = int(counts.sum(dtype=np.uint64))
    room = max(plan.entries, gpu.room // 2 // deep.ENTRY)
    if total > room:
        raise Error(f"{gpu.name} has room for {room:,} segments of hair in lists of what lights see, where there are "
                    f"{total:,}; allowed: fewer or shorter strands, or Settings.shadows 'length'")
    lists = deep.allocate(gpu, counts, segments)
    for strands in hair():
        for i in mapped:
            deep.fill(gpu, plan.views[i], plan.maps[i], dark[i], strands, lists, shown[i])
        del strands
    return deep.lay(gpu, plan.maps, counts, lists)


def without_hair(gpu: Any, lighting: Lighting) -> Lighting:
    """The same lights, before which hair hides nothing; without their ambient light, which nothing hides."""
    lights, shadows = gpu.download(lighting.lights).copy(), gpu.download(lighting.shadows).copy()
    lights["color"][:, 3] = 0
    shadows["hair"][:, 0] *= -1   # how many cells a segment crosses still counts
    return replace(lighting, lights=gpu.upload(lights), shadows=gpu.upload(shadows))


def without_body(gpu: Any, lighting: Lighting) -> Lighting:
    """The same lights, before which the body hides nothing."""
    shadows = gpu.download(lighting.shadows).copy()
    shadows["body"][:, 0] = 0
    return replace(lighting, shadows=gpu.upload(shadows))


def dark_of(gpu: Any, plan: DeepPlan, lighting: Lighting | None) -> list:
    """[[tiles, tiles] float32 reversed depth in its map from which on none of its light comes] of each light: behind
    hair that lets nothing through, or the body; beside that too, as far as lookups reach."""
    if lighting is None:
        return [gpu.upload(np.full((int(packed["size"][0]),) * 2, -1, np.float32)) for packed in plan.maps]
    result = []
    shadows, grids, views = (gpu.download(each) for each in (lighting.shadows, lighting.grids, lighting.light_views))
    crossings, maps = gpu.download(lighting.crossings), gpu.download(lighting.shadow_maps).ravel()
    for i, (shadow, grid, view) in enumerate(zip(shadows, grids, views)):
        nx, ny, nz, _ = (int(size) for size in grid["size"])
        tiles = int(plan.maps["size"][i, 0])
        first_cell, first_texel = (int(place) for place in shadow["place"].view(np.uint64))
        dark = np.full((max(nx, 1), max(nx, 1)), np.inf)
        if nx and tiles:
            sums = crossings.ravel()[first_cell:][:(nz + 1) * ny * nx].reshape(nz + 1, ny, nx)
            layers = (sums * shadow["hair"][0] <= DARK).sum(0)
            dark = _widest(np.where(layers > nz, np.inf, layers / nz), 1)
        if nx and tiles and shadow["body"][0]:
            size = int(view["size"][0])
            texels = maps[first_texel:][:size * size].reshape(size, size)
            dark = np.minimum(dark, _behind_body(grid, view, texels, int(shadow["body"][1])))
        result.append(gpu.upload(_reversed(plan.views[i], grid, _on_tiles(dark, tiles))))
    return result


def _on_tiles(values, tiles):
    """The most of values [cells, cells] within each of ``tiles``² tiles of the same square."""
    edges = np.arange(tiles + 1) * len(values) / max(tiles, 1)
    first, last = np.floor(edges[:-1] + 1e-9).astype(int), np.ceil(edges[1:] - 1e-9).astype(int)
    for _ in range(2):   # rows, then columns
        values = np.stack([values[a:b].max(0) for a, b in zip(first, last)], 1) if tiles else values[:0]
    return values


def _reversed(view, grid, depth):
    """Depths in a grid, 0 to 1, as reversed depths of a light's view, float32; -1 for what lies behind all."""
    if view is None:
        return np.full((1, 1), -1, np.float32)
    m, to_screen = grid["to_grid"].astype(float), view["to_screen"].astype(float)
    known = np.isfinite(depth)
    z = np.where(known, depth, 0)[..., None] * int(grid["size"][2]) - m[3, 2]
    places = z * m[:3, 2] / (m[:3, 2] @ m[:3, 2])   # any that is as deep: the same for all of these
    e, w = (places @ to_screen[:3, k] + to_screen[3, k] for k in (2, 3))
    return np.where(known, e / np.maximum(w, 1e-30), -1).astype(np.float32)


def _behind_body(grid, view, texels, radius):
    """[cells, cells] depth, 0 to 1, from which on the body hides all light, in columns of a grid; texels: of its
    shadow map."""
    cells, size = int(grid["size"][0]), len(texels)
    e = 1 - (texels >> np.uint64(32)).astype(float) / layout.CONSTANTS["DEPTH_ONE"]
    slack = 1 + 2 * radius + STEEPEST * (radius + 1.5)   # texels that `past_body` of light.h allows
    if view["eye"][3]:
        near = float(grid["face"][2])
        deep_by = cells / float(np.linalg.norm(grid["to_grid"][:3, 2].astype(float)))
        behind = e * (1 - slack / float(view["scale"][0]))
        depth = np.where(behind > 0, near * (1 / np.maximum(behind, 1e-9) - 1) / deep_by, np.inf)
    else:
        depth = 1 - e + slack / size
    depth = np.where(e < 0, np.inf, depth)
    if size >= cells:
        begins = np.arange(cells) * size // cells
        depth = np.maximum.reduceat(np.maximum.reduceat(depth, begins, 0), begins, 1)
    else:
        nearest = (np.arange(cells) * size + size // 2) // cells
        depth = depth[np.ix_(nearest, nearest)]
    return _widest(depth, 1 + math.ceil((radius + 3) * cells / size))


def _widest(values, reach):
    """The most of values [n, n] within ``reach`` of each place."""
    for axis in 0, 1:
        padded = np.pad(values, [(reach, reach) if axis == k else (0, 0) for k in (0, 1)], constant_values=np.inf)
        values = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis).max(-1)
    return values


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
