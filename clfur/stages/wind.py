"""The wind where hair is, what hair upwind leaves of it, and shell fur that it bends."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import layout
from ..layout import Arrays, Declared, array
from .voxelize import crossing_unit_for, most_of, voxelize
from .zscan import zscan

PERIOD = layout.CONSTANTS["PERIOD"]   # cells after which gusts come again
CELLS = 96          # a side of the grid of hair upwind
FINEST = 0.1        # of a gust's size: gusts at the roots of hair shorter than that do for all of it
SHARES = Declared("number", np.float32, None, 1.0)
WINDS = Declared("vector", np.float32)


def moment(mean: Any, gust: float = 0.0, size: float = 1.0, time: float = 0.0, seed: int = 0, skin: float = 0.0,
           shelter: float = 0.0, longest: float = 0.0) -> np.void:
    """The wind of a moment, as `layout.Wind`.

    mean: [3] world / s.  gust: how strong gusts are, likewise.  size: of their cells [world].  time: seconds in which
    the mean has carried them along.  skin: up to what height it holds air [world], or 0.  shelter: of what `shelter`
    finds, or 0.  longest: of the strands [world].
    """
    wind: Any = np.zeros((), layout.Wind)
    gone = np.remainder(np.asarray(mean, float) * time / size, PERIOD)
    wind["mean"], wind["gone"] = (*mean, gust), (*gone, 1 / size)
    wind["less"][:2] = 1 / skin if skin else 0, shelter
    wind["seed"][:2] = np.uint32(seed).view(np.int32), longest > FINEST * size
    return wind


def blow(gpu: Any, wind: np.void, roots: Any, places: Any, points: int, padded: int, shares: Any = None) -> Any:
    """The wind at the points of strands -> [points, 3, padded] float32, world / s.

    wind: `moment`'s.  roots: [4, 3, padded].  places: [points, 3, padded] relative to them.  shares: `shelter`'s, or
    None where hair gives none.
    """
    winds, wind = WINDS.empty(gpu, points * 3 * padded), wind.copy()
    if shares is None:
        wind["less"][1] = 0
    gpu.launch("wind.blow", padded // gpu.lanes, wind=wind, padded=padded, points=points, roots=roots, places=places,
               open=places if shares is None else shares, winds=winds)
    return winds


def upwind(gpu: Any, direction: Any, sphere: tuple[Any, float], strands: Any, most: tuple[int, float, float],
           types: int, cells: int = CELLS) -> tuple[np.void, Any]:
    """How often hair is crossed on the way of the wind -> (`layout.Grid`, `zscan`'s sums).

    direction: [3], unit, of the wind.  sphere: (centre [3], radius) that holds all of it.  strands: `DeviceStrands`, of
    so many types.  most: segments, length and area of all together, see `scene.hair_bounds`.
    """
    grid: Any = np.zeros((), layout.Grid)
    z = np.asarray(direction, float)
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    axes, (center, radius) = np.stack([x, np.cross(z, x), z]), sphere
    side = 2 * radius / cells
    grid["to_grid"][:3, :3] = axes.T / side
    grid["to_grid"][3] = *(cells / 2 - axes @ center / side), 1
    grid["light"][:3], grid["size"], grid["face"] = -z, (cells, cells, cells, 0), (side * side, side, 1, 1)
    unit = crossing_unit_for(most_of(grid, "length", *most)) or 1
    return grid, zscan(gpu, voxelize(gpu, grid, strands, "length", np.full(types, unit, np.uint32)), unit)


def shelter(gpu: Any, wind: np.void, there: tuple[np.void, Any], roots: Any, places: Any, points: int,
            padded: int) -> Any:
    """Shares of the wind that hair upwind, ``there``, leaves at the points of strands -> [points, padded] float32."""
    shares = SHARES.empty(gpu, points * padded)
    gpu.launch("wind.shelter", padded // gpu.lanes, wind=wind, grid=there[0], sums=there[1], padded=padded,
               points=points, roots=roots, places=places, open=shares)
    return shares


@dataclass(frozen=True)
class Leans(Arrays):
    """How shell fur leans, vertex by vertex, in the axes of roots that stand there.  Rows as those of strands."""

    rest: Any = array("vector", np.float32, fill=0.0)      # [3, padded] as it was groomed
    weight: Any = array("vector", np.float32, fill=0.0)    # gravity then [world / s²]
    leans: Any = array("vector", np.float32, fill=0.0)     # from rest
    speeds: Any = array("vector", np.float32, fill=0.0)    # [1 / s]
    going: Any = array("vector", np.float32, fill=0.0)     # how fast roots go [world / s]
    n: int = 0
    padded: int = 0

    moving = "leans", "speeds", "going"   # what steps change


def oscillator(bend: float, air: float, damping: float, length: float) -> tuple[float, float, float]:
    """Shell fur of a length as the first bending wave of a bar that is clamped at the skin -> (w [1 / s], zeta, lean by
    a force on all of it [s² / world]).

    bend: stiffness over mass a length [world³ / s²], air: 1 / s, damping: s, as `layout.MotionType` has them.  w =
    1.8751² sqrt(bend) / length²; air slows all of it down by its rate, and damping bending by w² of it: 2 zeta w = air
    + damping w².  A tip of lean f lies length f / 2 aside, and that of a bar length⁴ / 8 bend of a small force: f =
    length³ / 4 bend of it.
    """
    w = 1.8751**2 * math.sqrt(bend) / length**2
    return w, (air + damping * w * w) / (2 * w), length**3 / (4 * bend)


def onward(w: float, zeta: float, step: float) -> tuple[float, float, float, float]:
    """What x'' = -w² x - 2 zeta w x' makes of (x, v) in a step, exactly -> x of x, x of v, v of x, v of v."""
    decay, square = zeta * w, w * w * (1 - zeta * zeta)
    t = math.sqrt(abs(square)) * step
    if square < 0:   # two rates of decay, both slower than the step allows to overflow
        slow, fast = math.exp(t - decay * step), math.exp(-t - decay * step)
        c, s = (slow + fast) / 2, (slow - fast) / 2 / t * step if t > 1e-6 else step * slow
    else:
        c = math.cos(t) * math.exp(-decay * step)
        s = (math.sin(t) / t if t > 1e-6 else 1.0) * step * math.exp(-decay * step)
    return c + decay * s, s, -w * w * s, c - decay * s


def sway(gpu: Any, state: Leans, roots: Any, roots_before: Any, step: float, gravity: Any, winds: Any,
         hair: tuple[float, float, float, float, float], jumped: bool = False) -> Any:
    """One step of shell fur at vertices, in place -> [vertices, 3] float32: what `Shells.lean` is then.

    winds: `blow`'s at middles of hair (`stand`).  hair: what bends, air, damping, inertia, as `layout.MotionType` has
    them but for the last; length.
    """
    bend, air, damping, inertia, length = hair
    w, zeta, by = oscillator(bend, air, damping, length)
    out = gpu.empty((state.n, 3), np.float32)
    gpu.launch("wind.sway", state.n, padded=state.padded, roots=roots, roots_before=roots_before,
               winds=winds, gravity=(*gravity, 0), hair=(by, air, inertia, 0), onward=onward(w, zeta, step),
               times=(1 / step, 0 if jumped else 1, 0, 0), out=out,
               **{name: getattr(state, name) for name in ("rest", "weight", "leans", "speeds", "going")})
    return out


def stand(gpu: Any, roots: Any, height: float, padded: int) -> Any:
    """Middles of hair of shells that stands upright at roots -> [2, 3, padded] float32, as places of two points."""
    places = gpu.full(2 * 3 * padded, np.float32, 0)
    gpu.launch("wind.stand", padded, padded=padded, roots=roots, height=height / 2, places=places)
    return places


def lean_between(gpu: Any, before: Any, now: Any, share: float) -> Any:
    """How shell fur leans, [vertices, 3] float32, a share of the way from ``before`` to ``now``, of `sway`'s form."""
    out = gpu.empty(now.shape, np.float32)
    gpu.launch("wind.lean_between", now.size, before=before, now=now, share=share, out=out)
    return out
