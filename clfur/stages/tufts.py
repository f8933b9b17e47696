"""Strands that gather in tufts, curl with them and are frizzy: on what has grown, in place."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import layout
from ..layout import Arrays, array
from .strands import ROOTS, DeviceStrands, arrays
from .tessellate import Surface, as_float4

TUFT_OF = layout.Declared("strand", np.uint32, None, 2**32 - 1)   # its tuft, the largest number for none
CELLS = 64                     # along the longest side of the box around all middles, at most
STANDING = 3                   # maps that tell whether a strand stands, and how long it is, come first of all
WIDE = 1.5                     # of the spacing of middles a cell's side has, so that most are found in 27 cells


@dataclass(frozen=True)
class Middles(Arrays):
    """Middles of the tufts of a type, on the device."""

    hair: DeviceStrands                                 # that grows there, one each; strands of other types count not
    middles: Any = array("middle", np.float32, 4)       # x, y, z [world], 1 / square of how large the tuft is
    normals: Any = array("middle", np.float32, 4)       # unit
    turns: Any = array("middle", np.float32, 4)         # where a curl begins
    listed: Any = array("listed", np.uint32)            # numbers of middles, cell after cell of a grid,
    starts: Any = array("cell", np.uint32)              # and where each cell begins
    low: tuple = (0.0, 0.0, 0.0, 0.0)                   # lowest corner of the grid, spacing of middles [world]
    scale: tuple = (1.0, 0.0, 0.0, 1.0)                 # cells a unit of length; -; -; least of all w of the middles
    size: tuple = (1, 1, 1, 0)                          # cells in x, y, z


@dataclass(frozen=True)
class Rested(Arrays):
    """Where strands stand on the mesh in rest."""

    places: Any = array("strand", np.float32, 4)          # x, y, z [world]
    place_normals: Any = array("strand", np.float32, 4)   # unit


@dataclass(frozen=True)
class Nested:
    """Tufts of a type: their `Middles`, those of the tufts around them and which of these each is in, or None."""

    inner: Middles
    outer: Middles | None = None
    parents: Any = None


def bytes_of(tufts: Any, mesh: Any, stride: int) -> int:
    """Bytes on the device of the middles of tufts, `clfur.Tufts` on a mesh, whose strands have ``stride`` points at
    most."""
    total = 0
    for level in tufts.levels:
        n = level.number(mesh)
        cells = min(CELLS**3, (1 + 2 * float(mesh.bounds[1]) / (WIDE * math.sqrt(max(mesh.area, 1e-30) / n)))**3)
        total += n * Middles.bytes(middle=1, listed=1) + int(cells + 1) * Middles.bytes(cell=1) + TUFT_OF.bytes * n
        total += n * (DeviceStrands.bytes(strand=1, run=1, point=stride, color=stride) + ROOTS.bytes)
        total += 2 * n * Surface.bytes(vertex=3, triangle=1) + n * 16
    return total


def surface_of(gpu: Any, mesh: Any, there: Any, surface: str) -> Surface:
    """A small triangle of a mesh around each of the spots ``there``, `Spots` of `clfur.scene.tufts` -> `Surface`."""
    n, corners = len(there.faces), mesh.faces[there.faces].reshape(-1)
    made = Surface.empty(gpu, {"vertex": 3 * n}, triangles=gpu.upload(np.column_stack(
        [np.arange(3 * n).reshape(n, 3), there.faces]).astype(np.uint32)))
    gpu.launch("tufts.stand", n, corners=gpu.upload(as_float4(mesh.positions[corners])),
               corner_normals=gpu.upload(as_float4(mesh.normals[corners])),
               corner_uv=gpu.upload(as_float4(mesh.uv[there.faces].reshape(-1, 2))),
               weights=gpu.upload(as_float4(there.weights)), curved=surface == "pn", positions=made.positions,
               normals=made.normals, uv=made.uv)
    return made


def middles_of(gpu: Any, hair: DeviceStrands, surface: Surface, there: Any, kind: int) -> Middles:
    """`Middles` of a type, of the hair that has grown on `surface_of` the spots ``there``; they are where such a
    ``surface`` is, of the mesh in rest if there is one."""
    of_type = (gpu.download(hair.spans)[:, 1] > 1) & (gpu.download(hair.uv)[:, 2] == kind)
    places, normals = (gpu.download(each).reshape(-1, 3, 4) for each in (surface.positions, surface.normals))
    places = np.where(of_type[:, None], places.mean(1), 0).astype(np.float32)
    places[:, 3] = 1 / there.sizes**2
    found = np.flatnonzero(of_type)
    low, high = (places[found, :3].min(0), places[found, :3].max(0)) if len(found) else np.zeros((2, 3), np.float32)
    side = max(WIDE * there.spacing, float((high - low).max()) / (CELLS - 1), 1e-30)
    size = np.minimum(((high - low) / side).astype(int) + 1, CELLS)
    x, y, z = np.minimum(((places[found, :3] - low) / side).astype(int), size - 1).T
    cell = (z * size[1] + y) * size[0] + x
    order = np.argsort(cell, kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=size.prod()))])
    return Middles(
        hair=hair, middles=gpu.upload(places), normals=gpu.upload(normals[:, 0].copy()),
        turns=gpu.upload(as_float4(there.turns)), listed=gpu.upload(found[order].astype(np.uint32)),
        starts=gpu.upload(starts.astype(np.uint32)), low=(*low.tolist(), there.spacing),
        scale=(1 / side, 0.0, 0.0, float(places[:, 3].min(initial=1))), size=(*size.tolist(), 0))


def at_rest(gpu: Any, surface: Surface, roots: Any) -> Rested:
    """Where strands with these roots stand on the tessellated mesh in rest -> `Rested`."""
    made = Rested.empty(gpu, {"strand": len(roots)})
    gpu.launch("tufts.at_rest", len(roots), positions=surface.positions, normals=surface.normals,
               triangles=surface.triangles, roots=roots, **vars(made))
    return made


def nest(gpu: Any, tufts: Any, kind: int, inner: Middles, outer: Middles | None = None) -> Nested:
    """Put tufts, as `clfur.Tufts` have them, in those around them, if any: their hair gathers there."""
    if outer is None:
        return Nested(inner)
    parents = assign(gpu, inner.hair, outer, kind, Rested(inner.middles, inner.normals))
    gather(gpu, inner.hair, outer, kind, parents, tufts.within)
    return Nested(inner, outer, parents)


def assign(gpu: Any, strands: DeviceStrands, middles: Middles, kind: int, rested: Rested | None = None) -> Any:
    """The tuft of each strand of a type, that of the middle nearest to its root, in rest if given -> `TUFT_OF`."""
    tuft_of = TUFT_OF.empty(gpu, len(strands.spans))
    places, normals = (strands.points, strands.normals) if rested is None else (rested.places, rested.place_normals)
    gpu.launch("tufts.assign", len(strands.spans), kind=kind, middles=middles.middles, middle_normals=middles.normals,
               listed=middles.listed, starts=middles.starts, low=middles.low, scale=middles.scale, size=middles.size,
               tuft_of=tuft_of, by_strand=rested is not None, places=places, place_normals=normals,
               **arrays(strands, "spans", "strand_uv"))
    return tuft_of


def gather(gpu: Any, strands: DeviceStrands, middles: Middles, kind: int, tuft_of: Any, tufts: Any,
           parents: Any = None, traits: Any = None) -> None:
    """Draw each strand of a type towards the hair in the middle of its tuft, as `clfur.Tufts` have it, or of the tuft
    around that, where ``parents`` tells it.  ``traits``: as the kernel has them, [strands] `layout.Traits`."""
    gpu.launch("tufts.gather", len(strands.spans), kind=kind, tuft_of=tuft_of, middle_points=middles.hair.points,
               middle_spans=middles.hair.spans, strength=tufts.strength, bias=1 / tufts.profile - 2,
               **_given(gpu, parents, traits), **arrays(strands, "points", "spans", "strand_uv"))


def curl(gpu: Any, strands: DeviceStrands, kind: int, seed: int, tuft_of: Any = None, turns: Any = None,
         parents: Any = None, traits: Any = None) -> None:
    """Curl and wave strands of a type with their tufts, where these are given, and make each frizzy by itself."""
    has_tufts = tuft_of is not None
    gpu.launch("tufts.curl", len(strands.spans), kind=kind, seed=seed, has_tufts=has_tufts,
               tuft_of=tuft_of if has_tufts else gpu.empty(0, np.uint32),
               turns=turns if has_tufts else gpu.empty((0, 4), np.float32), **_given(gpu, parents, traits),
               **arrays(strands, "points", "spans", "strand_uv", "numbers", "first_strand", "types"))


def put(gpu: Any, strands: DeviceStrands, fur: Any, known: dict, traits: Any = None,
        rested: Rested | None = None) -> None:
    """Gather, curl and frizz what has grown of `clfur.Strands`, in place; ``known``: {type: `Nested`}."""
    for kind, hair in enumerate(fur.types):
        moves = hair.curl[0] or hair.wave[0] or hair.frizz[0]
        if hair.tufts is None or not hair.segments:
            if hair.frizz[0]:
                curl(gpu, strands, kind, fur.seed, traits=traits)
            continue
        nested = known[kind]
        tuft_of, outer = assign(gpu, strands, nested.inner, kind, rested), nested.outer
        if outer is not None:
            gather(gpu, strands, outer, kind, tuft_of, hair.tufts.within, nested.parents, traits)
        gather(gpu, strands, nested.inner, kind, tuft_of, hair.tufts, traits=traits)
        if moves:
            curl(gpu, strands, kind, fur.seed, tuft_of, (outer or nested.inner).turns, nested.parents, traits)


def _given(gpu, parents, traits):
    """Arguments of kernels that may be none."""
    return {"has_parents": parents is not None, "parents": gpu.empty(0, np.uint32) if parents is None else parents,
            "has_traits": traits is not None, "traits": gpu.empty(0, layout.Traits) if traits is None else traits}
