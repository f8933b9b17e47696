"""Strands and body in one grid of the world -> light of a sky that they hide, in each cell and at points of strands."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import layout
from ..layout import Arrays, Declared, array
from .strands import DeviceStrands, arrays
from .tessellate import Surface

CELLS = 32                           # a side of a scene's grid
DIRECTIONS, NEAR_BRIGHTEST = 32, 8   # all around, and towards what is brightest
CONE = np.radians(20)                # half the angle that these fill
MOMENTS, HARMONICS = int(layout.CONSTANTS["MOMENTS"]), int(layout.CONSTANTS["HARMONICS"])   # a cell: of hair, of light
HOLDS = MOMENTS + 1                  # numbers of what a cell holds
EDGE = int(layout.CONSTANTS["SKY_EDGE"])
POINTS = 16                          # of strands, or more, whose light a work-item looks up
STRANDS = 64                         # that a CPU's work-item adds up: more of its atomics are spared
FALLING, SQUARES = 112, 64           # directions whose light falls on the ground; squares a side that tell of it
THROUGH = Declared("cell", np.float32)                     # of each direction
POINT_LIGHT = Declared("point", np.float32, 4)             # r, g, b at a point of strands


@dataclass(frozen=True)
class Held(Arrays):
    """What cells hold of hair and body, in integers that parts of a scene add to."""

    moments: Any = array("cell", np.int32, MOMENTS, 0)     # [n³] xx, yy, zz, xy, xz, yz of hair, times ``unit``
    solids: Any = array("column", np.int32, None, 0)       # [3 n³] of the body along each axis, none without one
    unit: float = 1.0


@dataclass(frozen=True)
class SkyLight(Arrays):
    """Light of a sky in each cell of a grid, and on a ground, if there is one."""

    sky: np.void
    plane: np.void   # `layout.OnGround`
    cells: Any = array("harmonic", np.float32, 4)   # [9 n³] r, g, b, - of each spherical harmonic
    squares: Any = array("square", np.float32, 4)   # [side²] r, g, b, - on the ground


def arguments(gpu: Any, lit: SkyLight | None) -> dict:
    """A sky that may not be there, as arguments of a launch."""
    if lit is None:
        return {"sky": np.zeros((), layout.Sky), "sky_cells": gpu.empty((0, 4), np.float32)}
    return {"sky": lit.sky, "sky_cells": lit.cells}


def sky_of(low: Any, high: Any, n: int) -> np.void:
    """A `layout.Sky` of n³ cells around a box [3], [3] world; n: a multiple of 16, which lanes divide."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    side = float((high - low).max()) * 1.02 / n or 1.0
    packed: Any = np.zeros((), layout.Sky)
    packed["place"] = *((low + high) / 2 - side * n / 2), 1 / side
    packed["size"] = n, 1, 0, 0
    return packed


def held(gpu: Any, sky: np.void, body: bool, most: float) -> Held:
    """`Held` of nothing yet; ``most``: length · width [world²] that all hair cannot exceed."""
    n, unit = int(sky["size"][0]), 1 << 20
    while unit > 1 and most * float(sky["place"][3]) ** 2 * unit >= 1 << 30:
        unit >>= 1
    return Held.empty(gpu, {"cell": n**3, "column": 3 * n**3 if body else 0}, unit=float(unit))


def deposit(gpu: Any, sky: np.void, there: Held, strands: DeviceStrands, body: Surface) -> None:
    """Add strands and a body, or parts of them, to what a grid holds."""
    if len(strands.spans):
        each = STRANDS if gpu.lanes > 1 else 1
        gpu.launch("sky.deposit", -(-len(strands.spans) // each), sky=sky, unit=there.unit, moments=there.moments,
                   n_strands=len(strands.spans), each=each, **arrays(strands, "points", "spans", "strand_uv", "types"))
    if len(body.triangles) and there.solids.size:
        gpu.launch("sky.surface", len(body.triangles), sky=sky, positions=body.positions, triangles=body.triangles,
                   solids=there.solids)


def contents(gpu: Any, sky: np.void, there: Held) -> Any:
    """What each cell holds, once all is deposited -> [2 HOLDS, n³] float32, see sky.cl."""
    n = int(sky["size"][0])
    if there.solids.size:
        gpu.launch("sky.fill", 3 * n * n, n=n, solids=there.solids)
    cells = gpu.empty((2 * HOLDS, n**3), np.float32)
    gpu.launch("sky.contents", n**3, n=n, unit=there.unit, moments=there.moments, is_body=there.solids.size > 0,
               solids=there.solids, held=cells)
    return cells


def light(gpu: Any, sky: np.void, there: Held, directions: np.ndarray, table: np.ndarray,
          ground: tuple | None = None) -> SkyLight:
    """Take the light of all directions through the grid -> `SkyLight`; see `table_of`.

    ``ground``: what `plane_of` gives of one, and what `falling_of`.
    """
    n, count = int(sky["size"][0]), len(directions)
    lanes, cells = min(gpu.lanes, 16), contents(gpu, sky, there)
    through, _ = _through(gpu, n, cells, directions)
    plane, towards, sent = ground or (np.zeros((), layout.OnGround), np.zeros((0, 3)), np.zeros((0, 4), np.float32))
    result = SkyLight(sky, plane, SkyLight.declared["cells"].empty(gpu, HARMONICS * n**3),
                      gpu.full((int(plane["size"][0]) ** 2, 4), np.float32, 0))
    gpu.launch("sky.gather", n**3 // lanes, n=n, n_directions=count, through=through, table=gpu.upload(table),
               cells=result.cells)
    for first in range(0, len(towards), count):   # as many at a time as have room
        del through   # before the next are made
        some = towards[first:first + count]
        through, lot = _through(gpu, n, cells, some)
        gpu.launch("sky.plane", len(result.squares), sky=sky, plane=plane, n_directions=len(some), directions=lot,
                   share=len(some) / len(towards), light=gpu.upload(sent[first:first + count]), through=through,
                   squares=result.squares)
    return result


def _through(gpu, n, cells, directions):
    """(What reaches each cell of the light of directions, [directions, n³] float32; these on the device)."""
    count = len(directions)
    through, behind = THROUGH.empty(gpu, (count, n**3)), gpu.full((count, 2, (n + 2 * EDGE)**2), np.float32, 1)
    towards = gpu.upload(np.column_stack([directions, np.zeros(count)]).astype(np.float32))
    # A CPU has work enough in directions alone; else a slice's rows are divided, and wait for the slice before.
    rows, slices = (n, n) if gpu.lanes > 1 else (1, 1)
    for first in range(0, n, slices):
        gpu.launch("sky.sweep", count * n // rows, n=n, turns=(first, first + slices), rows=rows, held=cells,
                   directions=towards, behind=behind, through=through)
    return through, towards


def at_points(gpu: Any, lit: SkyLight, strands: DeviceStrands) -> Any:
    """Light that points of strands get from all around, over that of a sky of 1 -> [points, 4] float32 r, g, b, -."""
    result = POINT_LIGHT.empty(gpu, len(strands.points))
    each = strands.run * -(-POINTS // strands.run)   # whole strands, where all are alike
    gpu.launch("sky.at_points", -(-len(strands.points) // each), sky=lit.sky, cells=lit.cells, light=result,
               n_points=len(strands.points), each=each,
               **arrays(strands, "points", "spans", "strand_of", "run"))
    return result


def plane_of(low: Any, high: Any, height: float, whole: Any) -> np.void:
    """A `layout.OnGround` at a height, around a box [3], [3] world; ``whole``: r, g, b where nothing hides the sky."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    half = np.maximum((high - low)[[0, 2]] / 2, (high - low).max() / 8)   # which is seen in the grid's cells
    packed: Any = np.zeros((), layout.OnGround)
    packed["place"] = *((low + high) / 2)[[0, 2]], *(1 / np.where(half > 0, half, 1))
    packed["whole"], packed["size"][0] = (*whole, height), SQUARES
    return packed


def bytes_of(body: bool, ground: bool = False, n: int = CELLS) -> int:
    """Bytes on the device of all that `light` makes at once."""
    count = DIRECTIONS + NEAR_BRIGHTEST
    cell = Held.bytes(cell=1, column=3 * body) + 8 * HOLDS + THROUGH.bytes * count + SkyLight.bytes(harmonic=HARMONICS)
    return n**3 * cell + 8 * count * (n + 2 * EDGE)**2 + ground * SkyLight.bytes(square=SQUARES**2)


def table_of(directions: np.ndarray, light: np.ndarray, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places of a sky -> (directions [40, 3] through which its light goes, float32 [40, 9, 4] their r, g, b, -).

    ``directions``: [n, 3] unit, towards the places; ``light``: [n, 3]; ``angles``: [n] solid angles.  Each place is of
    the direction that is nearest; its light is kept in spherical harmonics, so that nothing is lost but what hides it.
    """
    around = spiral(DIRECTIONS)
    candidates = spiral(256)
    weight = light.sum(1) * angles
    sums = ((candidates @ directions.T) > np.cos(CONE)) @ np.stack([weight, angles], 1)
    brightest = candidates[np.argmax(sums[:, 0] / np.maximum(sums[:, 1], 1e-9))]
    chosen = np.concatenate([around, near(brightest)])
    nearest = np.argmax(directions @ chosen.T, 1)
    values = harmonics(directions)[:, :, None] * (light * angles[:, None])[:, None]
    table = np.zeros((len(chosen), HARMONICS, 4), np.float32)
    for channel in range(3):
        for j in range(values.shape[1]):
            table[:, j, channel] = np.bincount(nearest, values[:, j, channel], len(chosen))
    return chosen, table


def falling_of(directions: np.ndarray, light: np.ndarray, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places of a sky, as `table_of` takes them -> (directions [D, 3], float32 [D, 4] r, g, b, - that each sends to a
    level plane): as likely as their cosine, and some towards what sends most."""
    share = (np.arange(FALLING) + 0.5) / FALLING
    turn, r = np.pi * (3 - np.sqrt(5)) * np.arange(FALLING), np.sqrt(share)
    chosen = np.stack([r * np.cos(turn), np.sqrt(1 - share), r * np.sin(turn)], 1)
    sent = light * (angles * np.maximum(directions[:, 1], 0) / np.pi)[:, None]
    brightest = near(chosen[np.argmax(((chosen @ directions.T) > np.cos(CONE)) @ sent.sum(1))])
    chosen = np.concatenate([chosen, brightest[brightest[:, 1] > chosen[-1, 1]]])
    nearest, result = np.argmax(directions @ chosen.T, 1), np.zeros((len(chosen), 4), np.float32)
    for channel in range(3):
        result[:, channel] = np.bincount(nearest, sent[:, channel], len(chosen))
    return chosen, result


def spiral(n: int) -> np.ndarray:
    """Return n directions [n, 3] all around, each of the same solid angle: Fibonacci's spiral."""
    y = 1 - (2 * np.arange(n) + 1) / n
    turn, r = np.pi * (3 - np.sqrt(5)) * np.arange(n), np.sqrt(1 - y * y)
    return np.stack([r * np.cos(turn), y, r * np.sin(turn)], 1)


def near(axis: np.ndarray) -> np.ndarray:
    """Return directions [8, 3] that divide the cone around an axis: its middle and seven around that."""
    x = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    x /= np.linalg.norm(x)
    turn, out = 2 * np.pi * np.arange(NEAR_BRIGHTEST - 1) / (NEAR_BRIGHTEST - 1), 0.7 * CONE
    ring = np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * np.cross(axis, x)
    return np.concatenate([axis[None], np.cos(out) * axis + np.sin(out) * ring])


def harmonics(w: np.ndarray) -> np.ndarray:
    """Real spherical harmonics of orders 0 to 2 in directions [n, 3] -> [n, 9], as sky.h has them."""
    x, y, z = w.T
    a, b = 0.4886025119029199, 1.0925484305920792
    return np.stack([np.full(len(w), 0.28209479177387814), a * y, a * z, a * x, b * x * y, b * y * z,
                     0.31539156525252005 * (3 * z * z - 1), b * x * z, 0.5462742152960396 * (x * x - y * y)], 1)
