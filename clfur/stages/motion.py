"""Strands that move: a step in time, implicit, inextensible, solved directly along each strand."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import layout
from ..layout import Arrays, array
from .strands import DeviceStrands

CPU_ITEMS, GPU_ITEMS = 64, 8192   # work-items of a step: few, so that their workspaces stay in a CPU's caches
PERIOD = layout.CONSTANTS["PERIOD"]   # cells after which gusts come again
SOFT = layout.Declared("strand", np.uint32)


@dataclass(frozen=True)
class State(Arrays):
    """What strands that move keep from step to step.  Rows are of all strands, to whole lanes; see motion.cl."""

    segments: Any = array("padded", np.int32, fill=0)
    type_of: Any = array("padded", np.uint32, fill=0)
    groomed: Any = array("vector", np.float32, fill=0.0)         # [points, 3, padded]
    rest: Any = array("vector", np.float32, fill=0.0)
    lengths: Any = array("number", np.float32, fill=0.0)         # [points, padded]
    places: Any = array("vector", np.float32, fill=0.0)
    places_before: Any = array("vector", np.float32, fill=0.0)
    speeds: Any = array("vector", np.float32, fill=0.0)
    speeds_before: Any = array("vector", np.float32, fill=0.0)
    tensions: Any = array("number", np.float32, fill=0.0)
    n: int = 0          # strands
    padded: int = 0     # to whole lanes
    points: int = 0     # of the longest


def padded(gpu: Any, n: int) -> int:
    """So many strands to whole lanes of the device."""
    return -(-n // gpu.lanes) * gpu.lanes


def hang(gpu: Any, strands: DeviceStrands, points: int, roots: Any, types: Any, gravity: Any) -> tuple[State, Any]:
    """Strands as they were groomed, at rest under their weight -> (`State`, [strands] uint32: 1 where one is too soft
    for that).

    points: of the longest strand.  roots: [4, 3, padded] float32, their places and three axes.  types: [types]
    `layout.MotionType` on the device.  gravity: [3] world / s²; 0 for strands whose groom is their shape without
    weight.
    """
    n, rows = len(strands.spans), padded(gpu, len(strands.spans))
    state = State.empty(gpu, {"padded": rows, "vector": points * 3 * rows, "number": points * rows}, n=n, padded=rows,
                        points=points)
    soft = SOFT.empty(gpu, n)
    gpu.launch("motion.hang", n, n=n, padded=rows, points=strands.points, spans=strands.spans, strand_uv=strands.uv,
               types=types, roots=roots, gravity=(*gravity, 0), too_soft=soft,
               **{name: getattr(state, name) for name in ("segments", "type_of", "groomed", "rest", "lengths",
                                                          "places", "places_before")})
    return state, soft


def advance(gpu: Any, state: State, types: Any, roots: Any, roots_before: Any, step: float, gravity: Any, winds: Any,
            order: int = 2, jumped: bool = False, skin: float = 0.0, felt: Any = None) -> None:
    """One step of strands whose roots go from ``roots_before`` to ``roots``, in place.

    step: seconds.  gravity: [3] world / s².  winds: `blow`'s.  skin: up to what height it holds air [world].
    order: of the formula in time (BDF), 1 in the first step.  jumped: whether hair goes with its root as if
    nothing had moved.  felt: what `hair_grid.feel` gives, or None: hair doesn't feel hair.
    """
    items = CPU_ITEMS if gpu.lanes > 1 else GPU_ITEMS
    items = min(items, state.padded // gpu.lanes)
    workspace = gpu.empty(state.points * layout.CONSTANTS["ROWS_OF_POINT"] * items * gpu.lanes, np.float32)
    names = ("segments", "type_of", "groomed", "rest", "lengths", "places", "places_before", "speeds", "speeds_before",
             "tensions")
    gpu.launch("motion.advance", items, n_items=items, n=state.n, padded=state.padded, types=types, roots=roots,
               roots_before=roots_before, seconds=step, order=1 if jumped else order, jumped=int(jumped),
               gravity=(*gravity, 0), winds=winds, by_skin=1 / skin if skin else 0.0, workspace=workspace,
               feels_hair=int(felt is not None), felt=gpu.full(1, np.float32, 0) if felt is None else felt,
               **{name: getattr(state, name) for name in names})


def blow(gpu: Any, state: State, roots: Any, mean: Any, gust: float = 0.0, size: float = 1.0, time: float = 0.0,
         seed: int = 0) -> Any:
    """The wind at roots -> [3, padded] float32, world / s.

    mean: [3] world / s.  gust: how strong gusts are, likewise.  size: of their cells [world].  time: seconds in which
    the mean has carried them along.
    """
    winds = gpu.empty(3 * state.padded, np.float32)
    gone = np.remainder(np.asarray(mean, float) * time / size, PERIOD)
    gpu.launch("motion.blow", state.padded, padded=state.padded, roots=roots, mean=(*mean, gust),
               gone=(*gone, 1 / size), seed=seed, winds=winds)
    return winds


def place_roots(gpu: Any, feet: Any, offsets: Any, before: Any, now: Any, share: float, rows: int) -> Any:
    """Roots that stand on faces, between two poses -> [4, 3, rows] float32 on the device: places and three axes.

    feet: `guides.feet_on`'s.  offsets: [strands, 4] float32 from there to the roots, along the axes.  before, now:
    (corners, normals there) of the poses, [faces, 3, 4] float32 each.  share: 0 is before, 1 is now.
    """
    roots = gpu.full((4, 3, rows), np.float32, 0)
    gpu.launch("motion.place_roots", len(feet), padded=rows, feet=feet, offsets=offsets, before=before[0],
               normals_before=before[1], now=now[0], normals=now[1], share=share, roots=roots)
    return roots


def place_points(gpu: Any, state: State, roots: Any, strands: DeviceStrands) -> tuple[Any, Any]:
    """Where the points of strands are now -> ([points, 3] float32; unit normals of the skin at roots, [strands, 3])."""
    packed, normals = gpu.empty((len(strands.points), 3), np.float32), gpu.empty((state.n, 3), np.float32)
    gpu.launch("motion.place_points", state.n, padded=state.padded, spans=strands.spans, roots=roots,
               places=state.places, packed=packed, normals=normals)
    return packed, normals
