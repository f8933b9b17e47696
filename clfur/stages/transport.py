"""Strands of Chiang's look and the lights on them -> light that goes from hair to hair, in cells of the world."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import layout
from ..layout import Arrays, Declared, array
from . import bounce
from . import sky as sky_stage
from .chiang import SHADES, Scattering
from .lighting import Lighting
from .strands import DeviceStrands, arrays

CELLS = 24                # a side of the grid
DIRECTIONS, CHANNELS, PARTS, TANGENTS, ALBEDOS = (
    int(layout.CONSTANTS[name]) for name in ("DIRECTIONS", "CHANNELS", "PARTS_OF_ONE", "TANGENTS", "ALBEDOS"))
ORDERS, SETTLED = 12, 11  # that are followed; after so many, what further ones add is told from the last three
AMOUNTS = Declared("fibre", np.int32, 16, 0)              # of a type in a cell, see transport.cl
OF_LIGHT = Declared("shade", np.float32, DIRECTIONS)      # of hair of a type and a tangent, to each direction
BEFORE = Declared("channel", np.float32, 2)               # of a cell's light
DENSE = Declared("cell", np.float32, 8)                   # of all hair in a cell
STRANDS = 64              # that a CPU's work-item adds up: more of its atomics are spared
ASKED = Declared("point", np.uint32)            # whether its light is asked for
LEAVING = Declared("point", np.float32, 4)     # r, g, b, - that it sends to the eye
POINTS = 16               # of strands, or more, whose light a work-item looks up
PASSES = Declared("cell", np.float32, 2)                  # of one direction
FIELD = Declared("cell", np.float32, CHANNELS * DIRECTIONS)


@dataclass(frozen=True)
class Phases(Arrays):
    """How hair of each type scatters light from each direction to each other, for some tangents."""

    albedos: Any = array("eye", np.float32, SHADES)                  # [types · ALBEDOS] share of all light around
    phases: Any = array("phase", np.float32, DIRECTIONS * DIRECTIONS)   # [types · TANGENTS · SHADES] from, to
    tangents: Any = array("tangent", np.float32, 4)
    directions: Any = array("axis", np.float32, DIRECTIONS)          # [3]
    parts: Any = array("axis", np.float32, DIRECTIONS * PARTS)       # [3]


@dataclass(frozen=True)
class Transport(Arrays):
    """Light in each cell of a grid, from around each of the directions: of the sky and of hair."""

    sky: np.void
    phases: Phases
    scattering: Scattering
    light: Any = array(FIELD)   # counted in `bytes_of`
    around: sky_stage.SkyLight | None = None   # as a body shows it, if there is one


def directions() -> tuple[np.ndarray, np.ndarray]:
    """Directions [DIRECTIONS, 3] in which light goes, and parts of each [DIRECTIONS, PARTS, 3], unit."""
    axes = sky_stage.spiral(DIRECTIONS)
    x = np.cross(axes, np.eye(3)[np.argmin(np.abs(axes), 1)])
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    part = np.arange(PARTS) + 0.5                # of a cone, each of the same solid angle
    cosine, turn = 1 - 2 / DIRECTIONS * part / PARTS, np.pi * (3 - np.sqrt(5)) * part
    aside = np.sqrt(1 - cosine**2)[:, None]
    around = np.cos(turn)[:, None] * x[:, None] + np.sin(turn)[:, None] * np.cross(axes, x)[:, None]
    return axes, cosine[:, None] * axes[:, None] + aside * around


def outside(places: tuple | None) -> np.ndarray:
    """Mean light of a sky's ``places``, see `Environment.places`, around each direction -> [DIRECTIONS, 3]; none if
    None."""
    if places is None:
        return np.zeros((DIRECTIONS, 3))
    towards, light, angles = places
    nearest = np.argmax(towards @ directions()[0].T, 1)
    weights = np.bincount(nearest, angles, DIRECTIONS)
    sums = np.stack([np.bincount(nearest, light[:, k] * angles, DIRECTIONS) for k in range(CHANNELS)], 1)
    return sums / weights[:, None]


def phases(gpu: Any, scattering: Scattering, items: int | None = None) -> Phases:
    """`Phases` of the looks of types; of the first ``items`` of tangents and directions alone, if not None."""
    axes, parts = directions()
    tangents = np.column_stack([sky_stage.spiral(TANGENTS), np.zeros(TANGENTS)]).astype(np.float32)
    types = len(scattering.lobes)
    rows = {"eye": types * ALBEDOS, "phase": types * TANGENTS * SHADES}
    made = Phases.empty(gpu, rows, tangents=gpu.upload(tangents),
                        directions=gpu.upload(np.float32(axes.T)), parts=gpu.upload(np.float32(parts.reshape(-1, 3).T)))
    looks = {"lobes": scattering.lobes, "table": scattering.lobe_table}
    gpu.launch("transport.albedos", types * ALBEDOS, albedos=made.albedos, **looks)
    items = types * TANGENTS * DIRECTIONS if items is None else items
    gpu.launch("transport.phases", items, albedos=made.albedos, tangents=made.tangents,
               directions=made.directions, parts=made.parts, phases=made.phases, **looks)
    return made


def amounts(gpu: Any, sky: np.void, types: int) -> Any:
    """Room for what cells hold of hair of each type: nothing yet -> [types · n³, 16] int32."""
    return AMOUNTS.empty(gpu, types * int(sky["size"][0]) ** 3)


def deposit(gpu: Any, sky: np.void, there: Any, unit: float, strands: DeviceStrands, scattering: Scattering) -> None:
    """Add strands, or a part of them, to what cells hold of hair; ``unit``: that of `sky.held`."""
    each = STRANDS if gpu.lanes > 1 else 1
    gpu.launch("transport.hold", -(-len(strands.spans) // each), sky=sky, n_strands=len(strands.spans), each=each,
               unit=unit, amounts=there, lobes=scattering.lobes,
               **arrays(strands, "points", "spans", "strand_uv", "types", "colors", "color_per"))


def transport(gpu: Any, sky: np.void, held: sky_stage.Held, there: Any, lighting: Lighting, scattering: Scattering,
              made: Phases, outside: np.ndarray, body_color: tuple = (0, 0, 0), orders: int = ORDERS) -> Transport:
    """Take light from hair to hair ``orders`` times -> `Transport`.

    held, there: what cells hold, by `sky.deposit` of the body and `deposit`.  outside: [DIRECTIONS, 3] light of the
    sky.  body_color: linear r, g, b, one for all of it.
    """
    n, types = int(sky["size"][0]), len(scattering.lobes)
    cells, is_body = n**3, held.solids.size > 0
    kinds, dense = gpu.empty((types * cells * 2, 4), np.float32), DENSE.empty(gpu, cells)
    gpu.launch("transport.kinds", cells, n_types=types, n=n, unit=held.unit, amounts=there, tangents=made.tangents,
               kinds=kinds, dense=dense)
    first, sent, light = (FIELD.empty(gpu, cells) for _ in range(3))
    looks = {"lobes": scattering.lobes, "table": scattering.lobe_table, "parts": made.parts}
    by_tangent = OF_LIGHT.empty(gpu, types * TANGENTS * SHADES)
    for number in range(len(lighting.lights)):
        gpu.launch("transport.of_light", types * TANGENTS * DIRECTIONS, number=number, lights=lighting.lights,
                   tangents=made.tangents, by_tangent=by_tangent, **looks)
        gpu.launch("transport.direct", cells, sky=sky, n_types=types, number=number, kinds=kinds, dense=dense,
                   by_tangent=by_tangent, first=first, **looks, **lighting.arrays())
    faces = bounce.FACES.empty(gpu, 0)
    if is_body:
        faces = bounce.faces(gpu, sky, sky_stage.contents(gpu, sky, held), body_color, lighting)
    keeps, before = gpu.empty(cells, np.float32), BEFORE.empty(gpu, CHANNELS * cells)
    sweep = _sweeper(gpu, n, dense, outside, keeps, {"is_body": is_body, "faces": faces, "light": light})
    sums = gpu.empty(2 * CHANNELS * cells, np.float32)
    for order in range(orders):
        if order:
            gpu.launch("transport.scatter", cells, n_types=types, cells=cells, kinds=kinds, dense=dense,
                       phases=made.phases, first=first, light=light, sent=sent, before=before)
        if order and is_body:
            bounce.glow(gpu, body_color, made.directions, light, faces)
        sweep(sent if order else first, order >= min(SETTLED - 3, orders - 1))
        if order and order < SETTLED:
            gpu.launch("transport.settle", cells * CHANNELS, turn=max(order - (SETTLED - 3), -1), keeps=keeps,
                       before=before, sums=sums, light=light)
    gpu.launch("transport.even_out", cells, n=n, dense=dense, light=light, evened=sent)
    around = bounce.light_around(gpu, sky, directions()[0], sent) if is_body else None
    return Transport(sky, made, scattering, sent, around)


def _sweeper(gpu, n, dense, outside, keeps, given):
    """A function that takes what cells send through all of the grid, in all directions."""
    cells = n**3
    towards = gpu.upload(np.column_stack([directions()[0], np.zeros(DIRECTIONS)]).astype(np.float32))
    beyond = np.column_stack([outside, np.ones(DIRECTIONS)]).astype(np.float32)
    behind = gpu.upload(np.repeat(beyond, 2 * (n + 2 * sky_stage.EDGE)**2, 0))
    passes = PASSES.empty(gpu, DIRECTIONS * cells)
    gpu.launch("transport.passing", cells, cells=cells, dense=dense, towards=towards, passes=passes, keeps=keeps)
    slices, rows = (1, 1) if gpu.lanes == 1 else (n, n)

    def sweep(sent, everywhere):
        for turn in range(0, n, slices):
            gpu.launch("transport.sweep", DIRECTIONS * n // rows, n=n, turns=(turn, turn + slices), rows=rows,
                       everywhere=everywhere, passes=passes, towards=towards, sent=sent, behind=behind, **given)
    return sweep


def bytes_of(types: int, body: bool) -> int:
    """Bytes on the device of all that `transport` makes at once, and of `Phases`, of so many types of hair."""
    held = sky_stage.Held.bytes(cell=1, column=3 * body) + 8 * sky_stage.HOLDS + DENSE.bytes + 4 + 8 * CHANNELS
    cells = held + 3 * FIELD.bytes + CHANNELS * BEFORE.bytes + DIRECTIONS * PASSES.bytes + types * (AMOUNTS.bytes + 32)
    looks = Phases.bytes("albedos", "phases", eye=types * ALBEDOS, phase=types * TANGENTS * SHADES)
    looks += OF_LIGHT.bytes * types * TANGENTS * SHADES
    behind = DIRECTIONS * 2 * (CELLS + 2 * sky_stage.EDGE)**2 * 16
    return CELLS**3 * cells + behind + looks + bounce.bytes_of(CELLS) * body


def leaving(gpu: Any, view: np.void, lit: Transport, strands: DeviceStrands, segments: Any, first: int,
            end: int) -> Any:
    """What points of strands send to the eye of the light of cells -> [points, 4] float32 r, g, b, -; of those of
    segments ``first`` to ``end`` of the ids ``segments`` alone, if not None."""
    n_points = len(strands.points)
    asked = ASKED.empty(gpu, 0)
    if segments is not None:
        asked = gpu.full(n_points, np.uint32, 0)
        gpu.launch("transport.ask", end - first, first=first, segments=segments, first_point=strands.first_point,
                   asked=asked, **arrays(strands, "spans", "strand_of", "stored", "run"))
    each, scattered = strands.run * -(-POINTS // strands.run), LEAVING.empty(gpu, n_points)
    gpu.launch("transport.leaving", -(-n_points // each), view=view, n_points=n_points, each=each,
               asks=segments is not None, asked=asked, sky=lit.sky, light=lit.light, directions=lit.phases.directions,
               lobes=lit.scattering.lobes, table=lit.scattering.lobe_table, albedos=lit.phases.albedos,
               scattered=scattered,
               **arrays(strands, "points", "spans", "strand_of", "run", "strand_uv", "colors", "color_per"))
    return scattered
