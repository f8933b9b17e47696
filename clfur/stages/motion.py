"""Strands that move: a step in time, implicit, inextensible, solved directly along each strand."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import layout
from ..layout import Arrays, array
from .distance import Distance
from .strands import DeviceStrands

CPU_ITEMS, GPU_ITEMS = 64, 8192   # work-items of a step: few, so that their workspaces stay in a CPU's caches
SOFT = layout.Declared("strand", np.uint32)


RESTING: Any = np.zeros((), layout.Body)
RESTING["to_world"] = RESTING["to_grid"] = RESTING["carry"] = np.eye(3, 4)


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
    away: Any = array("touch", np.float32, fill=0.0)             # [points, padded], or none: they feel no body
    free: Any = array("touch", np.float32, fill=0.0)
    pressed: Any = array("press", np.float32, fill=0.0)          # [points, 3, padded]
    n: int = 0          # strands
    padded: int = 0     # to whole lanes
    points: int = 0     # of the longest

    moving = "places", "places_before", "speeds", "speeds_before", "tensions", "free", "pressed"   # what steps change


def lanes(gpu: Any) -> int:
    """How many strands its kernels take side by side."""
    return min(gpu.lanes, layout.CONSTANTS["STRANDS_BESIDE"])


def padded(gpu: Any, n: int) -> int:
    """So many strands to whole lanes of the device."""
    return -(-n // gpu.lanes) * gpu.lanes


@dataclass(frozen=True)
class Felt:
    """The body as strands feel it in a step: how far it is, and where it and its grid are, a `layout.Body`."""

    distance: Distance
    body: np.void


def body_at(rotation: Any, offset: Any, carry: Any = None, swell: float = 0.0, deforms: bool = False) -> np.void:
    """`layout.Body` of a body whose places at rest, times a ``rotation`` [3, 3] and with an ``offset`` [3], are those
    that it has now [world].

    carry: rows [3, 4] that take a place a step ago to where the body has taken it; None: it has not moved.  swell: how
    far its skin has gone besides, at most [world].  deforms: friction holds hair where its root takes it, and not where
    the body as a whole goes.
    """
    body = np.zeros((), layout.Body)
    body["to_world"][:, :3], body["to_world"][:, 3] = rotation, offset
    body["to_grid"][:, :3], body["to_grid"][:, 3] = np.transpose(rotation), -np.transpose(rotation) @ offset
    body["carry"] = np.eye(3, 4) if carry is None else carry
    body["more"][:2] = swell, deforms
    return body   # type: ignore[return-value]


def hang(gpu: Any, strands: DeviceStrands, points: int, roots: Any, types: Any, gravity: Any,
         feels: bool = False) -> tuple[State, Any]:
    """Strands as they were groomed, at rest under their weight -> (`State`, [strands] uint32: 1 where one is too soft
    for that).

    points: of the longest strand.  roots: [4, 3, padded] float32, their places and three axes.  types: [types]
    `layout.MotionType` on the device.  gravity: [3] world / s²; 0 for strands whose groom is their shape without
    weight.  feels: whether they are to feel the body; see `stand_off`.
    """
    n, rows = len(strands.spans), padded(gpu, len(strands.spans))
    touch = points * rows if feels else 0
    state = State.empty(gpu, {"padded": rows, "vector": points * 3 * rows, "number": points * rows, "touch": touch,
                              "press": 3 * touch}, n=n, padded=rows, points=points)
    soft = SOFT.empty(gpu, n)
    gpu.launch("motion.hang", n, n=n, padded=rows, points=strands.points, spans=strands.spans, strand_uv=strands.uv,
               types=types, roots=roots, gravity=(*gravity, 0), too_soft=soft,
               **{name: getattr(state, name) for name in ("segments", "type_of", "groomed", "rest", "lengths",
                                                          "places", "places_before")})
    return state, soft


def stand_off(gpu: Any, state: State, strands: DeviceStrands, body: Felt) -> Any:
    """Tell strands as they were groomed to stay away from the body, from now on -> [padded] float32: how far from it
    is the nearest point of each that is not its root [world], below 0 inside.

    A point stays half its width away, or as near as it was groomed.
    """
    deepest = gpu.full(state.padded, np.float32, 0)
    gpu.launch("motion.stand_off", state.padded // lanes(gpu), n=state.n, padded=state.padded, grid=body.distance.grid,
               body=body.body, values=body.distance.values, points=strands.points, spans=strands.spans,
               away=state.away, free=state.free, deepest=deepest)
    return deepest


def advance(gpu: Any, state: State, types: Any, roots: Any, roots_before: Any, step: float, gravity: Any, winds: Any,
            order: int = 2, jumped: bool = False, body: Felt | None = None, of_hair: Any = None) -> None:
    """One step of strands whose roots go from ``roots_before`` to ``roots``, in place.

    step: seconds.  gravity: [3] world / s².  winds: `wind.blow`'s.
    order: of the formula in time (BDF), 1 in the first step.  jumped: whether hair goes with its root as if
    nothing had moved.  body: where it is then, or None: they don't feel it.  of_hair: what
    `hair_grid.feel` gives, or None: they don't feel each other.
    """
    items = CPU_ITEMS if gpu.lanes > 1 else GPU_ITEMS
    items = min(items, state.padded // lanes(gpu))
    workspace = gpu.empty(state.points * layout.CONSTANTS["ROWS_OF_POINT"] * items * lanes(gpu), np.float32)
    names = ("segments", "type_of", "groomed", "rest", "lengths", "places", "places_before", "speeds", "speeds_before",
             "tensions", "away", "free", "pressed")
    there = body or Felt(Distance.empty(gpu, {"node": 0}, grid=np.zeros((), layout.Distances)), RESTING)
    gpu.launch("motion.advance", items, n_items=items, n=state.n, points=state.points, padded=state.padded, types=types,
               roots=roots, roots_before=roots_before, seconds=step, order=1 if jumped else order, jumped=int(jumped),
               gravity=(*gravity, 0), winds=winds, workspace=workspace, feels_hair=int(of_hair is not None),
               felt_of_hair=gpu.full(1, np.float32, 0) if of_hair is None else of_hair,
               feels=int(body is not None), grid=there.distance.grid, body=there.body, values=there.distance.values,
               **{name: getattr(state, name) for name in names})


def place_roots(gpu: Any, feet: Any, offsets: Any, before: Any, now: Any, share: float, rows: int,
                body: np.void = RESTING) -> Any:
    """Roots that stand on faces, between two poses -> [4, 3, rows] float32 on the device: places and three axes.

    feet: `guides.feet_on`'s.  offsets: [strands, 4] float32 from there to the roots, along the axes.  before, now:
    (corners, normals there) of the poses, [faces, 3, 4] float32 each.  share: 0 is before, 1 is now.  body: where a
    `layout.Body` takes it all besides.
    """
    roots = gpu.full((4, 3, rows), np.float32, 0)
    gpu.launch("motion.place_roots", len(feet), padded=rows, feet=feet, offsets=offsets, before=before[0],
               normals_before=before[1], now=now[0], normals=now[1], share=share, body=body, roots=roots)
    return roots


def place_points(gpu: Any, state: State, roots: Any, strands: DeviceStrands) -> tuple[Any, Any]:
    """Where the points of strands are now -> ([points, 3] float32; unit normals of the skin at roots, [strands, 3])."""
    packed, normals = gpu.empty((len(strands.points), 3), np.float32), gpu.empty((state.n, 3), np.float32)
    gpu.launch("motion.place_points", state.n, padded=state.padded, spans=strands.spans, roots=roots,
               places=state.places, packed=packed, normals=normals)
    return packed, normals


def remember(gpu: Any, state: State) -> tuple[Any, Any]:
    """(Places, speeds) of strands as they are, as `between` takes them after a step."""
    copies = gpu.empty(state.places.shape, np.float32), gpu.empty(state.speeds.shape, np.float32)
    gpu.launch("motion.remember", copies[0].size, places=state.places, speeds=state.speeds, places_then=copies[0],
               speeds_then=copies[1])
    return copies


def between(gpu: Any, state: State, types: Any, strands: DeviceStrands, then: tuple[Any, Any], roots: tuple,
            share: float, seconds: float, jumped: bool = False) -> tuple[Any, Any]:
    """Where strands were within their last step -> as `place_points`.

    then: what `remember` gave before the step.  roots: [4, 3, padded] float32 each, as the step began, as it ended, and
    at ``share`` of its ``seconds``.  jumped: as of `advance`.
    """
    packed, normals = gpu.empty((len(strands.points), 3), np.float32), gpu.empty((state.n, 3), np.float32)
    gpu.launch("motion.between", state.n, padded=state.padded, share=share, seconds=seconds, jumped=int(jumped),
               spans=strands.spans, types=types, places_then=then[0], speeds_then=then[1], roots_then=roots[0],
               roots_now=roots[1], roots=roots[2], packed=packed, normals=normals,
               **{name: getattr(state, name) for name in ("type_of", "lengths", "places", "speeds")})
    return packed, normals
