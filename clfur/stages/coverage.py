"""Strands -> how much of each pixel each of them covers, sorted by depth, hidden behind each other, and lit."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import layout
from ..layout import Arrays, Declared, array
from .shade import no_light
from .strands import arrays

TILE = layout.CONSTANTS["TILE"]
COUNTED = Declared("pixel", np.uint32, 2)                 # depth of what hides strands, fragments
TRANSMITTANCE = Declared("point", np.float32)             # share of a light's direct light, 0..1


@dataclass(frozen=True)
class Fragments(Arrays):
    """What strands cover of each pixel: those of a pixel are starts[pixel] to pixels[pixel, 1]."""

    starts: Any = array("pixel", np.uint32)
    pixels: Any = array("pixel", np.uint32, 2)    # depth of what hides strands, end of the pixel's fragments
    list: Any = array("fragment", np.uint64, 2)   # depth << 32 | id, see `raster`; float32 share of the pixel's area,
                                                  # then of its light


@dataclass(frozen=True)
class Resolved(Arrays):
    """What is seen of fragments, and of what is behind them."""

    used: Any = array("pixel", np.uint32)           # fragments that are seen: the last ones, the nearest last of all
    through: Any = array("sample", np.float32, None, 1)   # share of its light that comes from the body
    veil: Any = array("pixel", np.float32)          # share of the shells' light that strands before them let through
    alpha: Any = array("pixel", np.float32)         # share of light that does not come from behind everything
    seen: Any = array("pixel", np.uint64, 1)        # depth << 32 | id of the strand or body that fills most of it
    seen_fur: Any = array("pixel", np.uint64, 1)    # depth << 32 | face, where shells do


def bound(gpu, visible):
    """How far each pixel of the body's ``visible`` can be seen into -> [rows, width, 2] uint32 depth, 0."""
    rows, width, samples = visible.shape
    pixels = COUNTED.empty(gpu, (rows, width))
    gpu.launch("coverage.bound", rows * width, samples=samples, visible=visible, pixels=pixels)
    return pixels


def count(gpu, view, strands, pixels):
    """Add how many fragments `DeviceStrands` have at most in each pixel to what `bound` gave."""
    gpu.launch("coverage.count", len(strands.spans), view=view, pixels=pixels, **arrays(strands, "points", "spans"))


def row_sums(gpu, counted):
    """How many fragments each row has of what `count` counted -> [rows] uint64."""
    rows, width, _ = counted.shape
    sums = gpu.empty(rows, np.uint64)
    gpu.launch("coverage.sum_rows", rows, width=width, counted=counted, sums=sums)
    return sums


def allocate(gpu, counted, pieces, rows=None):
    """Empty `Fragments` for so many ``pieces``, all that `count` counted in ``rows``, (first, one past the last)."""
    first, end = rows or (0, len(counted))
    width = counted.shape[1]
    band = {"size": (width, end - first), "first": first * width, "counted": counted}
    blocks = -(-(-(-width // TILE) * -(-(end - first) // TILE) * TILE**2) // layout.CONSTANTS["SCAN"])
    sums, total = gpu.empty(blocks, np.uint64), gpu.empty(1, np.uint64)
    gpu.launch("coverage.sum_tiles", blocks, **band, sums=sums)
    with gpu.labelled("coverage"):
        gpu.launch("strands.scan_sums", 1, n=blocks, sums=sums, total=total)
    fragments = Fragments.empty(gpu, {"pixel": (end - first, width), "fragment": pieces})
    gpu.launch("coverage.number", blocks, **band, sums=sums, starts=fragments.starts, pixels=fragments.pixels)
    return fragments


def gather(gpu, view, strands, fragments):
    """Write the fragments of `DeviceStrands`, in any order."""
    gpu.launch("coverage.gather", len(strands.spans), view=view, first=strands.first_point, pixels=fragments.pixels,
               fragments=fragments.list, **arrays(strands, "points", "spans"))


def resolve(gpu, visible, fragments, through=None, fur=None):
    """Sort the fragments of each pixel and hide them behind each other -> `Resolved`.

    ``visible``: [rows, width, samples] uint64, the body's.  ``through``, ``fur``: what `march.march` gave, if there
    are shells; ``through`` is written anew.
    """
    rows, width, samples = visible.shape
    furry = through is not None
    known = {"through": through} if furry else {}
    resolved = Resolved.empty(gpu, {"pixel": (rows, width), "sample": visible.shape}, **known)
    gpu.launch("coverage.resolve", rows * width, samples=samples, starts=fragments.starts, pixels=fragments.pixels,
               fragments=fragments.list, visible=visible, furry=furry, fur=fur if furry else gpu.empty(0, np.uint64),
               **vars(resolved))
    return resolved


def steps_of(counts, used):
    """About how often `resolve` loops at most for a pixel of so many fragments, so many of which it looks at."""
    counts, used = counts.astype(np.int64), np.minimum(used, counts)
    return int((2 * counts + used * (12 + np.log2(np.maximum(counts, 1)))).max())


def transmittance(gpu, strands, lighting):
    """Share of each light's direct light that reaches points of `DeviceStrands` -> [lights, points] float32 0..1."""
    n_points = len(strands.points)
    shares = TRANSMITTANCE.empty(gpu, (len(lighting.lights), n_points))
    gpu.launch("coverage.transmittance", len(strands.spans), n_points=n_points, transmittances=shares,
               **lighting.arrays(),
               **arrays(strands, "points", "tangents", "strand_of", "strand_normal", "strand_uv", "types", "colors",
                        "spans"))
    return shares


def light(gpu, view, lighting, fragments, resolved, strands, shares=None, sums=None):
    """Light the fragments of `DeviceStrands` -> [rows, width, 4] int64, r, g, b, alpha in 2^-32, see `shade.blend`.

    ``strands`` may be a part of them all: what it shows is added to ``sums``.  ``shares``: what
    `transmittance` gave; all light if None.
    """
    rows, width = fragments.starts.shape
    sums = no_light(gpu, rows, width) if sums is None else sums
    gpu.launch("coverage.light", rows * width, view=view, part=(strands.first_point, len(strands.points)),
               pixels=fragments.pixels, used=resolved.used, fragments=fragments.list,
               n_lights=len(lighting.lights), lights=lighting.lights, shaded=shares is not None,
               transmittances=gpu.empty(0, np.float32) if shares is None else shares, radiance_sums=sums,
               **arrays(strands, "points", "tangents", "strand_of", "strand_uv", "types", "colors", "color_per"))
    return sums
