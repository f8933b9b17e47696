"""Strands -> how much of each pixel each of them covers, sorted by depth, hidden behind each other, and lit."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import layout
from ..layout import Arrays, Declared, array
from .lighting import Lighting
from .shade import no_light
from .strands import DeviceStrands, arrays

TILE = layout.CONSTANTS["TILE"]
COUNTED = Declared("pixel", np.uint32, 2)                 # depth of what hides strands, fragments
TRANSMITTANCE = Declared("point", np.float32)             # share of a light's direct light there, 0..1


@dataclass(frozen=True)
class Fragments(Arrays):
    """What strands cover of each pixel: those of a pixel are starts[pixel] to pixels[pixel, 1]."""

    starts: Any = array("pixel", np.uint32)
    pixels: Any = array("pixel", np.uint32, 2)    # depth of what hides strands, end of the pixel's fragments
    areas: Any = array("fragment", np.uint64, 2)  # depth << 32 | id, see `raster`; float32 share of the pixel's area


@dataclass(frozen=True)
class Resolved(Arrays):
    """What is seen of fragments, and of what is behind them; a transmittance: the share of light that gets through."""

    weights: Any = array("fragment", np.uint64, 2)  # depth << 32 | id; float32 share of the pixel's light: in the very
                                                    # memory of `Fragments.areas`, which are gone
    used: Any = array("pixel", np.uint32)           # fragments with a weight: the last ones, the nearest last of all
    body_transmittance: Any = array("sample", np.float32, None, 1)   # of the body's light, by strands and shells
    strand_transmittance: Any = array("pixel", np.float32)   # of the shells' light, by strands before them
    alpha: Any = array("pixel", np.float32)         # share of light that does not come from behind everything
    front: Any = array("pixel", np.uint64, 1)       # depth << 32 | id of the strand or body that fills most of it
    shell_front: Any = array("pixel", np.uint64, 1)   # depth << 32 | face, where shells do


def bound(gpu: Any, visible: Any) -> Any:
    """How far each pixel can be seen into -> [rows, width, 2] uint32 depth, 0.

    ``visible``: [rows, width, samples] uint64, what `raster` gives of the body.
    """
    rows, width, samples = visible.shape
    pixels = COUNTED.empty(gpu, (rows, width))
    gpu.launch("coverage.bound", rows * width, samples=samples, visible=visible, pixels=pixels)
    return pixels


def count(gpu: Any, view: np.void, strands: DeviceStrands, pixels: Any) -> None:
    """Add how many fragments strands have at most in each pixel to what `bound` gave, [rows, width, 2] uint32."""
    gpu.launch("coverage.count", len(strands.spans), view=view, pixels=pixels, **arrays(strands, "points", "spans"))


def row_sums(gpu: Any, counted: Any) -> Any:
    """How many fragments each row has of what `count` counted, [rows, width, 2] uint32 -> [rows] uint64."""
    rows, width, _ = counted.shape
    sums = gpu.empty(rows, np.uint64)
    gpu.launch("coverage.sum_rows", rows, width=width, counted=counted, sums=sums)
    return sums


def allocate(gpu: Any, counted: Any, pieces: int, rows: tuple[int, int] | None = None) -> Fragments:
    """Empty `Fragments` for so many ``pieces``, all that `count` counted in ``rows``, (first, one past the last).

    ``counted``: [rows, width, 2] uint32, of all rows.  Without ``rows`` it is for all of them.
    """
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


def gather(gpu: Any, view: np.void, strands: DeviceStrands, fragments: Fragments) -> None:
    """Write the fragments of strands, in any order."""
    gpu.launch("coverage.gather", len(strands.spans), view=view, first=strands.first_point, pixels=fragments.pixels,
               areas=fragments.areas, **arrays(strands, "points", "spans", "shifts"))


def resolve(gpu: Any, visible: Any, fragments: Fragments, shell_transmittance: Any = None,
            shell_front: Any = None) -> Resolved:
    """Sort the fragments of each pixel and hide them behind each other -> `Resolved`.

    ``visible``: [rows, width, samples] uint64, the body's.  ``shell_transmittance``, ``shell_front``: [rows, width,
    samples] float32 and uint64, what `march.march` gave, if there are shells; the former becomes the body's.
    """
    rows, width, samples = visible.shape
    has_shells = shell_transmittance is not None
    known = {"body_transmittance": shell_transmittance} if has_shells else {}
    resolved = Resolved.empty(gpu, {"pixel": (rows, width), "sample": visible.shape}, weights=fragments.areas, **known)
    gpu.launch("coverage.resolve", rows * width, samples=samples, starts=fragments.starts, pixels=fragments.pixels,
               visible=visible, has_shells=has_shells,
               sample_shells=shell_front if has_shells else gpu.empty(0, np.uint64), **vars(resolved))
    return resolved


def steps_of(counts: np.ndarray, used: np.ndarray) -> int:
    """About how often `resolve` loops at most for a pixel of so many fragments, so many of which it looks at.

    counts, used: [rows, width] uint32.
    """
    counts, used = counts.astype(np.int64), np.minimum(used, counts)
    return int((2 * counts + used * (12 + np.log2(np.maximum(counts, 1)))).max())


def transmittance(gpu: Any, strands: DeviceStrands, lighting: Lighting) -> Any:
    """Share of each light's direct light that gets through to points of strands -> [lights, points] float32 0..1."""
    n_points = len(strands.points)
    result = TRANSMITTANCE.empty(gpu, (len(lighting.lights), n_points))
    gpu.launch("coverage.transmittance", len(strands.spans), n_points=n_points, transmittances=result,
               **lighting.arrays(), **arrays(strands, "points", "strand_of", "run", "strand_normal", "strand_uv",
                                             "types", "colors", "spans"))
    return result


def light(gpu: Any, view: np.void, lighting: Lighting, fragments: Fragments, resolved: Resolved, strands: DeviceStrands,
          transmittances: Any = None, sums: Any = None) -> Any:
    """Light the fragments of strands -> [rows, width, 4] int64, r, g, b, alpha in 2^-32, see `shade.blend`.

    ``strands`` may be a part of them all: what it shows is added to ``sums``, an array like the result.
    ``transmittances``: [lights, points] float32, what `transmittance` gave; all light if None.
    """
    rows, width = fragments.starts.shape
    sums = no_light(gpu, rows, width) if sums is None else sums
    gpu.launch("coverage.light", rows * width, view=view, part=(strands.first_point, len(strands.points)),
               pixels=fragments.pixels, used=resolved.used, weights=resolved.weights,
               n_lights=len(lighting.lights), lights=lighting.lights, shadowed=transmittances is not None,
               transmittances=gpu.empty(0, np.float32) if transmittances is None else transmittances,
               radiance_sums=sums,
               **arrays(strands, "points", "spans", "strand_of", "stored", "run", "strand_uv", "types", "colors",
                        "color_per"))
    return sums
