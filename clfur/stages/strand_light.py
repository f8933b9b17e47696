"""Strands -> their light at places along them: what gets through to points, and what segments send to the eye."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .. import layout
from ..layout import Arrays, Declared, array
from .chiang import Scattering, no_scattering
from .deep import Deep
from .lighting import Lighting
from .strands import DeviceStrands, arrays
from .transport import LEAVING, Transport, leaving

TRANSMITTANCE = Declared("point", np.float32)   # share of a light's direct light there, 0..1
RANGES = Declared("block", np.uint32)            # of depths in a light's shadow map
FEW = layout.CONSTANTS["FEW_PLACES"]             # of a segment
BLOCKS = layout.CONSTANTS["BLOCKS"]              # of a map, a side
LEAST = 8 * BLOCKS**2                            # points: for fewer, ranges take more than they save


@dataclass(frozen=True)
class Places(Arrays):
    """Light of each source that segments send to the eye, linear r, g, b, at places of them; between these it is as
    cl/places.h has it, or cl/exact_light.h where it changes too much."""

    places: Any = array("place", np.uint64, FEW)   # of each segment and source, in that order, or where in `more`
                                                  # they are: see cl/places.h
    more: Any = array("row", np.float32, 32)      # what others are like: see cl/exact_light.h
    axes: Any = array("axis", np.float32, 8)      # where in the world they lie, if their pieces look at the hair before
                                                  # lights: start x, y, z, strand's number; way x, y, z, -
    hazes: Any = array("haze", np.uint32)         # and for each light how much the grid's hair lets through: cl/deep.h
    sources: int = 1                              # lights, the sky, and what comes from hair to hair, if any
    until: int = 0                                # segments of which it is known
    rows: int = 0                                 # of `more` that these have
    lighting: Lighting | None = None              # that falls on them,
    shadowed: bool = False                        # whether anything stands before it
    scattering: Scattering | None = None          # of the types of the strands, where some have lobes
    deep: Deep | None = None                      # maps of the hair before lights, where each piece looks at these


def transmittance(gpu: Any, strands: DeviceStrands, lighting: Lighting, segments: Any = None) -> Any:
    """Share of each light's direct light that gets through to points of strands -> [lights, points] float32 0..1; or to
    the start and the end of each of some ``segments``, [n] uint32 ids -> [lights, 2n]."""
    n = len(strands.points) if segments is None else 2 * len(segments)
    result = TRANSMITTANCE.empty(gpu, (len(lighting.lights), n))
    blocks = len(lighting.lights) * BLOCKS**2 if lighting.shadow_maps.size else 0
    ranged = blocks > 0 and gpu.lanes > 1 and n >= LEAST and gpu.room >= blocks * RANGES.bytes
    ranges = RANGES.empty(gpu, blocks * ranged)
    if ranged:
        gpu.launch("strand_light.depth_ranges", blocks // BLOCKS, shadows=lighting.shadows, ranges=ranges,
                   light_views=lighting.light_views, shadow_maps=lighting.shadow_maps)
    gpu.launch("strand_light.transmittance", _items(gpu, n), n_asked=n, transmittances=result, ranged=ranged,
               ranges=ranges, listed=segments is not None,
               segments=gpu.empty(0, np.uint32) if segments is None else segments, **lighting.arrays(),
               **arrays(strands, "first_point", "points", "spans", "strand_of", "stored", "run", "strand_normal",
                        "strand_uv", "types"))
    return result


def unlit(gpu: Any, lighting: Lighting, n: int, around: int = 0) -> Places:
    """Room for the light of n segments -> `Places`, of none of them; ``around``: sources of it beside lights."""
    sources = len(lighting.lights) + around
    return Places(Places.declared["places"].empty(gpu, n * sources), Places.declared["more"].empty(gpu, 0),
                  Places.declared["axes"].empty(gpu, 0), Places.declared["hazes"].empty(gpu, 0), sources,
                  lighting=lighting)


def radiance(gpu: Any, view: np.void, lighting: Lighting, strands: DeviceStrands, transmittances: Any = None,
             segments: Any = None, until: int | None = None, before: Places | None = None, last: bool = True,
             scattering: Scattering | None = None, sky_light: Any = None, even: float = 0.0,
             transport: Transport | None = None, of_ends: bool = False) -> Places:
    """Light that segments send to the eye -> `Places`.

    ``transmittances``: [lights, points] float32, what `transmittance` gave; all light if None.  ``of_ends``: whether of
    ``segments``' starts and ends.
    ``segments``: [n] uint32, ids of segments, of which those of ``strands`` end at ``until``; each point if None,
    those of strands' last points without a meaning.  ``before``: what this gave of those before them.  ``last``:
    whether no others come after them; else all that may be needed of `Places.more` is set aside at once.
    ``scattering``: of the strands' types; None where none has lobes.  ``sky_light``: [points, 4] float32 r, g, b, what
    `sky.at_points` gave, if there is a sky.  ``even``: light from all around beside it, the same everywhere, which
    lights leave out.  ``transport``: light that goes from hair to hair, if it is followed.
    """
    n = len(strands.points) if segments is None else len(segments)
    around = sky_light is not None or even > 0
    known = before or unlit(gpu, lighting, n, around + (transport is not None))
    first, end = known.until, n if until is None else until
    rows = gpu.full(1, np.uint32, known.rows)
    scattered = LEAVING.empty(gpu, 0)
    if transport is not None:
        scattered = leaving(gpu, view, transport, strands, segments, first, end)
    given = {"view": view, "range": (first, end), "listed": segments is not None, "first_point": strands.first_point,
             "segments": gpu.empty(0, np.uint32) if segments is None else segments, "places": known.places,
             "shadowed": transmittances is not None, "of_ends": of_ends,
             "n_asked": 0 if transmittances is None else transmittances.shape[1],
             "transmittances": gpu.empty(0, np.float32) if transmittances is None else transmittances,
             **(scattering or no_scattering(gpu)).arrays(), **lighting.arrays(),
             **arrays(strands, "points", "spans", "strand_of", "stored", "run", "strand_normal", "strand_uv", "types",
                      "colors", "color_per")}
    gpu.launch("strand_light.radiance", _items(gpu, end - first), rows=rows, under_sky=around, even=even,
               has_sky=sky_light is not None,
               sky_light=gpu.empty((0, 4), np.float32) if sky_light is None else sky_light,
               is_scattered=transport is not None, scattered=scattered, **given)
    more, taken = known.more, int(gpu.download(rows)[0])
    if len(more) < taken:
        more = Places.declared["more"].empty(gpu, taken if last else n)
    if known.rows < taken:
        for unused in "view", "lights", "light_views", "crossings", "shadow_maps", "lobes", "lobe_table":
            del given[unused]
        gpu.launch("strand_light.further", _items(gpu, end - first), more=more, sources=known.sources, **given)
    return replace(known, more=more, until=end, rows=taken, lighting=lighting, shadowed=transmittances is not None,
                   scattering=scattering)


def axes(gpu: Any, maps: Deep, strands: DeviceStrands, segments: Any, first: int, known: Places,
         transmittances: Any, of_ends: bool = False) -> Places:
    """``known`` `Places`, and where segments lie in the world, for pieces that look at the hair before lights.

    ``maps``: of that.  ``segments``: [n] uint32, ids of segments, of which those of ``strands`` begin at ``first`` and
    end where their light is known to end.  ``transmittances``, ``of_ends``: as of `radiance`, of lights before
    which hair alone stands; they are for pieces of little weight.
    """
    new, n_lights, there, hazes = not len(known.axes), len(transmittances), known.axes, known.hazes
    if new:
        there = Places.declared["axes"].empty(gpu, len(segments))
        hazes = Places.declared["hazes"].empty(gpu, len(segments) * n_lights)
    gpu.launch("strand_light.axes", known.until - first, first=first, segments=segments, axes=there, hazes=hazes,
               n_lights=n_lights, of_ends=of_ends, n_asked=transmittances.shape[1], transmittances=transmittances,
               **arrays(strands, "first_point", "points", "strand_of", "stored", "run", "numbers", "first_strand"))
    return replace(known, deep=maps, axes=there, hazes=hazes)


def _items(gpu, n):
    """Work-items for n places side by side."""
    return -(-n // gpu.lanes)
