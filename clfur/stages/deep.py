"""Strands as lights see them: lists of their segments in tiles of each light's view, for shadows of single hairs."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import layout
from ..layout import Arrays, array
from .strands import DeviceStrands, arrays, stretches_of

BLOCK = layout.CONSTANTS["DEEP_BLOCK"]
SORTED = 512      # entries that are sorted in one work-item there: it takes n log² n steps
SEGMENTS = 8      # of each strand that a launch takes where drivers end long loops,
BLOCKS = 512      # and blocks of each list


@dataclass(frozen=True)
class Deep(Arrays):
    """Lists of the segments of strands, in tiles of the view of each light; see cl/deep.h."""

    maps: Any = array("light", layout.Deep)
    starts: Any = array("start", np.uint32)     # where in `blocks` those of each tile begin, map after map
    nears: Any = array("block", np.float32)     # reversed depth before which none of a block's segments lies
    blocks: Any = array("block", np.uint32, 8 * BLOCK)   # what eight segments are like, number by number
    longest: int = 0                            # list of blocks of a tile; 0: there are no maps

    def arrays(self) -> dict:
        """All of it, as arguments of a launch."""
        return {f"deep_{name}": value for name, value in vars(self).items()}


@dataclass(frozen=True)
class Lists(Arrays):
    """The same while it is made: segments, and which of them each tile lists."""

    starts: Any = array("start", np.uint32)     # where in `entries` those of each tile begin, map after map
    cursors: Any = array("tile", np.uint32)     # and where the next one goes
    entries: Any = array("entry", np.uint64)    # 1 - nearest reversed depth << 32 | number of a segment
    ends: Any = array("segment", np.float32, 8)   # each end's x, y, reversed depth, half width [pixels]
    marks: Any = array("segment", np.uint32, 2)   # strand's number, share of light that it takes
    taken: Any = array("one", np.uint32)        # segments so far


ENTRY = 2 * Lists.bytes(entry=1) + Deep.bytes(block=1) // BLOCK


def bytes_of(entries: int, segments: int, tiles: int) -> int:
    """Bytes on the device of so many segments, listed so often in so many tiles of all maps."""
    of_tile = Lists.bytes(start=1, tile=1) + Deep.bytes(start=1, block=1)   # of its last block all may be empty
    return ENTRY * entries + Lists.bytes(segment=segments) + of_tile * (tiles + 1)


def no_deep(gpu: Any) -> Deep:
    """`Deep` without a map."""
    return Deep.empty(gpu, {"light": 0, "start": 0, "block": 0})


def count(gpu: Any, view: np.void, packed: np.void, dark: Any, strands: DeviceStrands, counts: Any,
          survivors: Any) -> None:
    """Count the segments of strands that the tiles of a light's map list.

    ``view``, ``packed``: its `layout.View` and `layout.Deep`.  ``dark``: [tiles, tiles] float32, reversed depth behind
    which no light comes.  ``counts``: [tiles of all lights] uint32, ``survivors``: [1] uint32 segments before lights;
    both are added to.
    """
    _each(gpu, "deep.count", view, packed, strands, dark=dark, counts=counts, survivors=survivors)


def allocate(gpu: Any, counts: np.ndarray, survivors: int) -> Lists:
    """Room for what was counted; ``counts``: [tiles of all lights] uint32, on the host."""
    starts = _before(counts)
    cursors = gpu.upload(starts[:-1])
    return Lists.empty(gpu, {"entry": int(starts[-1]), "segment": survivors}, starts=gpu.upload(starts),
                       cursors=cursors, taken=gpu.full(1, np.uint32, 0))


def fill(gpu: Any, view: np.void, packed: np.void, dark: Any, strands: DeviceStrands, lists: Lists) -> None:
    """List the segments of strands that were counted in a light's map."""
    _each(gpu, "deep.fill", view, packed, strands, dark=dark, cursors=lists.cursors, taken=lists.taken,
          entries=lists.entries, ends=lists.ends, marks=lists.marks,
          **arrays(strands, "numbers", "first_strand", "strand_uv", "types"))


def lay(gpu: Any, maps: np.ndarray, counts: np.ndarray, lists: Lists) -> Deep:
    """What the segments of each tile are like, the nearest to the light first -> `Deep`.

    ``maps``: [lights] `layout.Deep`.  ``counts``: [tiles of all lights] uint32, on the host.
    """
    _sort(gpu, counts, lists)
    blocks = -(-counts.astype(np.int64) // BLOCK)
    firsts, longest = gpu.upload(_before(blocks)), int(blocks.max(initial=0))
    made = Deep.empty(gpu, {"block": int(blocks.sum())}, maps=gpu.upload(maps), starts=firsts, longest=longest)
    step = BLOCKS if gpu.steps else max(longest, 1)
    for packed in maps:
        for first in range(0, longest, step):
            gpu.launch("deep.lay", int(packed["size"][0])**2, map=packed, stretch=(first, first + step), firsts=firsts,
                       nears=made.nears, blocks=made.blocks, starts=lists.starts, entries=lists.entries,
                       ends=lists.ends, marks=lists.marks)
    return made


def _before(counts):
    """[n + 1] uint32 sums of what comes before each of [n]."""
    return np.concatenate([[0], np.cumsum(counts, dtype=np.int64)]).astype(np.uint32)


def _sort(gpu, counts, lists):
    """Sort the entries of each tile.  Where a driver ends long loops, long lists in many launches."""
    longest = SORTED if gpu.steps else 2**32 - 1
    by_digits = max(gpu.lanes, gpu.hinted) > 1
    spare = Lists.declared["entries"].empty(gpu, len(lists.entries) * by_digits)
    gpu.launch("deep.sort", len(counts), longest=longest, starts=lists.starts, entries=lists.entries, spare=spare)
    if counts.max(initial=0) <= longest:
        return
    starts = _before(counts)
    for tile in np.flatnonzero(counts > longest):
        for bit, value, apart in _steps(int(counts[tile])):
            gpu.launch("deep.exchange", int(counts[tile]) - apart, first=int(starts[tile]), bit=bit, value=value,
                       apart=apart, entries=lists.entries)


def _each(gpu, name, view, packed, strands, **more):
    """Launch a kernel over strands: where a driver ends long loops, some segments and rows of tiles at a time."""
    tiles = int(packed["size"][0])
    rows = max(gpu.steps // (SEGMENTS * tiles), 1) if gpu.steps else tiles
    for stretch in stretches_of(gpu, strands, max((gpu.steps or 0) // SEGMENTS, 1)):
        for first in range(0, tiles, rows):
            gpu.launch(name, len(strands.spans), view=view, map=packed, stretch=stretch,
                       rows=(first, first + rows), **more, **arrays(strands, "points", "spans"))


def _steps(n):
    """[(bit, value, apart)] of the steps that sort n entries, see deep.cl."""
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
