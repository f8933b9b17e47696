"""Strands as lights see them: their pieces in the texels of a map, sorted by depth, for shadows of single hairs."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import layout
from ..layout import Arrays, array
from .strands import DeviceStrands, arrays, stretches_of

PADDING = 4       # pieces behind the last, which may be read
SORTED = 512      # pieces that are sorted in one work-item there: it takes n log² n steps
SEGMENTS = 64     # of each strand that a launch takes where drivers end long loops,
COLUMNS = 512     # and texels of each of these


@dataclass(frozen=True)
class Deep(Arrays):
    """Maps of the pieces of strands, one a light; see cl/deep.h."""

    maps: Any = array("light", layout.Deep)
    starts: Any = array("start", np.uint32)     # where in `pieces` those of each texel begin, map after map
    pieces: Any = array("piece", np.uint64)     # of each texel, by depth: depth << 40 | strand << 16 | opacity
    longest: int = 0                            # list of a texel; 0: there are no maps

    def arrays(self) -> dict:
        """All of it, as arguments of a launch."""
        return {f"deep_{name}": value for name, value in vars(self).items()}


PIECE = Deep.bytes(piece=1)
TEXEL = 2 * Deep.bytes(start=1)   # and where the next piece goes, while it is filled


def no_deep(gpu: Any) -> Deep:
    """`Deep` without a map."""
    return Deep(gpu.empty(0, layout.Deep), gpu.empty(0, np.uint32), gpu.empty(0, np.uint64))


def count(gpu: Any, view: np.void, packed: np.void, dark: Any, strands: DeviceStrands, counts: Any) -> None:
    """Count the pieces of strands in the texels of a light's map.

    ``view``, ``packed``: its `layout.View` and `layout.Deep`.  ``dark``: [cells, cells] uint32, depth from which on no
    light comes in a part of the map.  ``counts``: [texels] uint32, to which they are added.
    """
    _each(gpu, "deep.count", view, strands, map=packed, dark=dark, cells=len(dark), counts=counts)


def allocate(gpu: Any, maps: np.ndarray, counts: np.ndarray) -> tuple[Deep, Any]:
    """Room for what was counted -> (`Deep` without its pieces, [texels] uint32 where the next piece of each goes).

    ``maps``: [lights] `layout.Deep`.  ``counts``: [texels] uint32 of one after the other, on the host.
    """
    starts = np.concatenate([[0], np.cumsum(counts, dtype=np.uint64)]).astype(np.uint32)
    sizes = maps["size"][:, 0].astype(np.int64) ** 2
    maps = maps.copy()
    maps["size"][:, 1] = np.cumsum(sizes) - sizes
    pieces = Deep.declared["pieces"].empty(gpu, int(starts[-1]) + PADDING)
    made = Deep(gpu.upload(maps), gpu.upload(starts), pieces, int(counts.max(initial=0)))
    return made, gpu.upload(starts[:-1])


def fill(gpu: Any, view: np.void, packed: np.void, dark: Any, strands: DeviceStrands, made: Deep, cursors: Any) -> None:
    """Write the pieces of strands that were counted in a light's map; ``packed``: its `layout.Deep`, with its place."""
    _each(gpu, "deep.fill", view, strands, map=packed, dark=dark, cells=len(dark), cursors=cursors,
          pieces=made.pieces, **arrays(strands, "numbers", "first_strand", "strand_uv", "types"))


def sort(gpu: Any, made: Deep) -> None:
    """Sort the pieces of each texel.  Where a driver ends long loops, long lists in many launches."""
    longest = SORTED if gpu.steps else 2**32 - 1
    gpu.launch("deep.sort", len(made.starts) - 1, longest=longest, starts=made.starts, pieces=made.pieces)
    if made.longest <= longest:
        return
    starts = gpu.download(made.starts)
    lengths = np.diff(starts)
    for texel in np.flatnonzero(lengths > longest):
        for bit, value, apart in _steps(int(lengths[texel])):
            gpu.launch("deep.exchange", int(lengths[texel]) - apart, first=int(starts[texel]), bit=bit, value=value,
                       apart=apart, pieces=made.pieces)


def _each(gpu, name, view, strands, **more):
    """Launch a kernel over strands: where a driver ends long loops, some segments and columns of texels at a time."""
    size = int(view["size"][0])
    for stretch in stretches_of(gpu, strands, max((gpu.steps or 0) // SEGMENTS, 1)):
        for first in range(0, size, COLUMNS if gpu.steps else size):
            gpu.launch(name, len(strands.spans), view=view, stretch=stretch,
                       columns=(first, min(first + COLUMNS, size) if gpu.steps else size), **more,
                       **arrays(strands, "points", "spans"))


def _steps(n):
    """[(bit, value, apart)] of the steps that sort n pieces, see deep.cl."""
    steps, whole = [], 1
    while 2 * whole < n:
        whole *= 2
    bit = whole
    while bit:
        half, value, apart = whole, 0, bit
        while apart:
            steps.append((bit, value, apart))
            apart, half, value = (half - bit, half // 2, bit) if half > bit else (0, 0, bit)
        bit //= 2
    return steps
