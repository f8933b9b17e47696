"""Strands that are seen -> whose pieces are in each pixel, and how much of it they take."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .. import layout
from ..layout import Arrays, array
from .coverage import BUNDLES, GLOWS, LIGHT_LATER, OF_ENTRY, OF_TILE, TILE, Seen, Segments, tiles_of
from .strands import DeviceStrands, arrays

NOTHING = int(layout.CONSTANTS["NOTHING"])
LEAST = 256         # bundles of pieces that are stored at a time, at least


@dataclass(frozen=True)
class Owners(Arrays):
    """Whose some segments are."""

    owners: Any = array("id", np.uint32, 2, NOTHING)   # number of the strand, index of its type
    turns: Any = array("id", np.float32, 2, 0)         # twice the angle on the screen: cosine, sine


@dataclass(frozen=True)
class Pieces:
    """What is seen of strands, on the host: pieces in any order, none twice."""

    pixels: np.ndarray    # [n] int64 row * width + column, of the rows that are drawn
    numbers: np.ndarray   # [n] int64 of segments, among those that were listed
    weights: np.ndarray   # [n] float32 share of the pixel's light, more than 0


def owners(gpu: Any, view: np.void, ids: Any, strands: DeviceStrands, known: Owners,
           until: int | None = None) -> None:
    """Tell in ``known`` whose segments are, ``ids`` [n] uint32, the first ``until`` of them; those of other parts of
    the scene stay."""
    gpu.launch("mattes.owners", len(ids) if until is None else until, view=view,
               part=(strands.first_point, len(strands.points)), ids=ids, **vars(known),
               **arrays(strands, "first_strand", "points", "strand_of", "numbers", "stored", "run", "strand_uv"))


def pieces(gpu: Any, segments: Segments, counts: np.ndarray, window: tuple[int, int], size: tuple[int, int],
           draw: Any, kept: Any = None) -> Any:
    """Draw `Segments` without light -> (`Pieces` of some tiles after the other, what ``draw`` gave).

    ``counts``: of tiles [n], on the host.  ``window``: the first of these to draw, one past the last.  ``size``: width
    and rows.  ``draw``: `coverage.cover` with all its arguments but ``lit``, ``window`` and ``seen``.  ``kept``: its
    argument, where slabs of depth are drawn: where pieces have no room it is as before, and they are drawn again.
    """
    n, before = len(segments.ids), None if kept is None else gpu.download(kept)
    meant = np.where(counts, GLOWS + np.minimum(OF_ENTRY * counts.astype(np.int64), OF_TILE), 0)   # pieces, and some
    ends, room, first, end = np.append(0, np.cumsum(meant)), room_of(gpu), *window[:1] * 2
    while first < window[1]:
        if end <= first:
            fit = int(np.searchsorted(ends, ends[first] + room * GLOWS, "right")) - 1
            end = min(max(fit, first + 1), window[1])
        rows = {"bundle": room, "tile": len(counts), "mark": -(-n // 8), "survivor": n, "counter": 1}
        seen = replace(Seen.empty(gpu, rows), when=LIGHT_LATER)
        unfinished = draw(window=(first, end), seen=seen)
        found, done = _stored(gpu, seen, counts, (first, end), size)
        if done > first:
            yield found, unfinished
            first, room = done, room_of(gpu)
        else:
            room *= 2
            if kept is not None:
                kept.set(before)


def room_of(gpu: Any) -> int:
    """Bundles of pieces that are stored at a time, if no tile has more."""
    return int(min(max(gpu.room // 4 // Seen.bytes(bundle=1), LEAST), BUNDLES))


def _stored(gpu, seen, counts, window, size):
    """(`Pieces` that were stored of a window's tiles, the first tile that had no room or one past the last)."""
    if max(gpu.lanes, gpu.hinted) > 1:
        return _of_tiles(gpu, seen, counts, window, size)
    taken = int(gpu.download(seen.taken)[0])
    stored = gpu.download(seen.bundles).reshape(-1, 3)
    if taken > len(stored):
        return None, window[0]
    # Where a driver ends long loops, tiles that stop are begun anew, and some of their pieces come twice.
    stored = np.unique(stored[:taken], axis=0) if gpu.steps else stored[:taken]
    pixels, numbers, weights = np.ascontiguousarray(stored.T)
    return Pieces(pixels.astype(np.int64), numbers.astype(np.int64), weights.view(np.float32)), window[1]


def _of_tiles(gpu, seen, counts, window, size):
    """`_stored` where columns go side by side: bundles, those of a tile in a chain."""
    tiles = np.arange(*window)[counts[slice(*window)] > 0]
    heads = gpu.download(seen.heads)[tiles]
    full = heads == NOTHING
    done = int(tiles[np.argmax(full)]) if full.any() else window[1]
    tiles, heads = tiles[tiles < done], heads[tiles < done]
    nexts, chains = gpu.download(seen.nexts), []
    while (heads > 0).any():
        tiles, heads = tiles[heads > 0], heads[heads > 0]
        chains.append((tiles, heads - 1))
        heads = nexts[heads - 1]
    none = np.zeros(0, np.int64)
    tiles, bundles = (np.concatenate(each) for each in zip(*chains)) if chains else (none, none)
    stored = gpu.download(seen.bundles).reshape(-1, 3, GLOWS)[bundles]
    weights, pixel = stored[:, 2].view(np.float32), (stored[:, 1] >> 16).astype(np.int64)
    across, width = tiles_of(size[0], 1)[0], size[0]
    y, x = (tiles // across * TILE)[:, None] + pixel // TILE, (tiles % across * TILE)[:, None] + pixel % TILE
    there = weights > 0
    return Pieces((y * width + x)[there], stored[:, 0][there].astype(np.int64), weights[there]), done
