"""Strands -> how much of each pixel each of them covers, sorted by depth, hidden behind each other, and their light."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .. import layout
from ..layout import Arrays, Declared, array
from .chiang import no_scattering
from .deep import no_deep
from .lighting import unshadowed
from .strand_light import unlit
from .strands import DeviceStrands, arrays, go_through

TILE = int(layout.CONSTANTS["TILE"])
EVERY = 0, int(layout.CONSTANTS["NOTHING"])   # tile, or depth: the first, one past the last
REACH = Declared("segment", np.uint32, 2)   # least and most depth of a segment's pieces
KEPT = Declared("uint4", np.uint32, 4)      # of a tile's pixels between slabs of depth, so many:
OF_KEPT, OF_KEPT_MASKED = (TILE**2 * int(layout.CONSTANTS[name]) for name in ("KEPT_PIXEL", "MASKED_PIXEL"))
GLOWS, MARKED = int(layout.CONSTANTS["GLOWS"]), int(layout.CONSTANTS["MARKED"])
LIGHT_AT_ONCE, LIGHT_LATER, LIGHT_NOW = range(3)   # see cl/glow.h
SLABS = 1024      # into which a tile is divided, at most
BUCKETS = int(layout.CONSTANTS["BUCKETS"])
SEEN = "bundle", "tile", "mark", "survivor", "counter"   # rows of `Seen`
BUNDLES = 8192    # of pieces that wait for light, at most, 772 bytes each
OF_ENTRY, OF_TILE = 4, 1536   # pieces that a segment in a tile has, and a tile, nearly always;
ENTRIES = 2                   # and so many segments have one that is seen, where a tile has many
SLOTS, LISTED = int(layout.CONSTANTS["SLOTS"]), int(layout.CONSTANTS["LISTED"])
PIECES = Declared("number", np.uint32)       # of pieces that have no slot, each has so many:
OF_PIECE = {"coverage": int(layout.CONSTANTS["PIECE"]), "masks": int(layout.CONSTANTS["MASKED_PIECE"])}
PIECES_AT_ONCE = TILE**2 * (LISTED + SLOTS)  # that come of segments made ready together, and of all slots
LEAST_LEFT, MOST_LEFT = 2048, 1 << 18        # and may be left, whatever the memory, and however many segments there are
WALKS = 16        # tiles at a time that go on in another launch where drivers end long loops, 90 KB each
OPEN = Declared("tile", np.uint32)           # that have not come to their end, likewise
GRAINS = Declared("tile", np.uint32, 2)      # where LANES is 1: how a tile's list is sorted
WALKED = Declared("uint4", np.uint32, 4)     # where a pixel has come to, of a tile so many:
OF_WALKED, OF_WALKED_MASKED = (TILE**2 * int(layout.CONSTANTS[name]) for name in ("WALK", "MASKED_WALK"))


@dataclass(frozen=True)
class Tiles(Arrays):
    """How far tiles of a picture can be seen into, and how many segments of strands each may show."""

    bounds: Any = array("tile", np.uint32)               # depth
    counts: Any = array("tile", np.uint32, None, 0)
    survivors: Any = array("counter", np.uint32, None, 0)   # segments that may show anywhere
    shown: Any = array("strand", np.uint32)      # rows of tiles in which each may show: first, one past the last << 16


@dataclass(frozen=True)
class Segments(Arrays):
    """Segments of strands that may show, in any order, and which of them each tile may: entries starts[tile] to
    starts[tile + 1]."""

    starts: Any = array("start", np.uint32)
    cursors: Any = array("tile", np.uint32)       # where the next entry of each tile goes
    entries: Any = array("entry", np.uint32, 2)   # depth, number of a segment
    ends: Any = array("survivor", np.float32, 8)  # each end's x, y, reversed depth, half width [pixels]
    ids: Any = array("survivor", np.uint32)       # see `raster`
    cuts: Any = array("survivor", np.uint32)      # what is left where they are clipped: from and to, in 1/65535
    survivors: Any = array("counter", np.uint32, None, 0)   # segments so far
    longest: int = 0                              # list of a tile


@dataclass(frozen=True)
class Seen(Arrays):
    """Pieces of strands that wait for light, and which segments have any: see cl/glow.h."""

    bundles: Any = array("bundle", np.uint32, 3 * GLOWS)
    nexts: Any = array("bundle", np.uint32)
    heads: Any = array("tile", np.uint32)
    marks: Any = array("mark", np.uint64, None, 0)   # a byte of each segment
    slots: Any = array("survivor", np.uint32)
    taken: Any = array("counter", np.uint32, None, 0)   # bundles so far; where LANES is 1 pieces
    when: int = LIGHT_AT_ONCE


@dataclass(frozen=True)
class Covered(Arrays):
    """What is seen of strands, and of what is behind them; a transmittance: the share of light that gets through."""

    body_transmittance: Any = array("sample", np.float32)   # of the body's light, by strands and shells
    alpha: Any = array("pixel", np.float32)                 # share of light that does not come from behind everything
    front: Any = array("pixel", np.uint64, 1)               # depth << 32 | id of strand or body that fills most of it
    shell_front: Any = array("shell", np.uint64, 1)         # depth << 32 | face, where shells do; empty without any


def tiles_of(width: int, rows: int) -> tuple[int, int]:
    """Tiles across and down so many pixels."""
    return (width + TILE - 1) // TILE, (rows + TILE - 1) // TILE


def bound(gpu: Any, view: np.void, visible: Any, strands: int = 0) -> Tiles:
    """How far each tile can be seen into -> `Tiles` with nothing counted.

    ``visible``: [rows, width, samples] uint64, what `raster` gives of the body.  ``strands``: how many there are, if
    all are counted at once: then it is remembered where each shows, and `fill` leaves out those that show elsewhere.
    """
    rows, width, _ = visible.shape
    across, down = tiles_of(width, rows)
    tiles = Tiles.empty(gpu, {"tile": across * down, "counter": 1, "strand": strands})
    gpu.launch("coverage.bound", across * down, view=view, visible=visible, bounds=tiles.bounds)
    return tiles


def count(gpu: Any, view: np.void, strands: DeviceStrands, tiles: Tiles) -> None:
    """Count the segments of strands that each of the `Tiles` may show."""
    go_through(gpu, "coverage.count", strands, _a_row(view), _at_a_time(gpu), view=view, n_strands=len(strands.spans),
               known=_knows(tiles, strands), **vars(tiles), **arrays(strands, "points", "spans"))


def allocate(gpu: Any, counts: np.ndarray, survivors: int) -> Segments:
    """Room for what was counted: ``counts`` of tiles [n], on the host, ``survivors`` in all -> `Segments`, empty."""
    starts = np.concatenate([[0], np.cumsum(counts, dtype=np.uint64)]).astype(np.uint32)
    rows = {"start": len(starts), "tile": len(counts), "entry": int(starts[-1]), "survivor": survivors, "counter": 1}
    return Segments.empty(gpu, rows, starts=gpu.upload(starts), cursors=gpu.upload(starts[:-1]),
                          longest=int(counts.max(initial=0)))


def fill(gpu: Any, view: np.void, strands: DeviceStrands, tiles: Tiles, segments: Segments,
         window: tuple[int, int] = EVERY, slab: tuple[int, int] = EVERY) -> None:
    """Write the `Segments` of strands that may show in some `Tiles`, ``window``: the first, one past the last, and
    reach into some depths, ``slab``: the same, behind those that are there already."""
    go_through(gpu, "coverage.fill", strands, _a_row(view), _at_a_time(gpu), view=view, n_strands=len(strands.spans),
               bounds=tiles.bounds, window=window, slab=slab, first=strands.first_point, known=_knows(tiles, strands),
               shown=tiles.shown, cursors=segments.cursors, survivors=segments.survivors, entries=segments.entries,
               ends=segments.ends, ids=segments.ids, cuts=segments.cuts, **arrays(strands, "points", "spans", "shifts"))


def reach(gpu: Any, view: np.void, strands: DeviceStrands, tiles: Tiles, reaches: Any, taken: Any,
          window: tuple[int, int]) -> None:
    """Tell how far in depth segments reach that may show in some `Tiles`, ``window``: the first, one past the last.

    ``reaches``: [segments, 2] uint32, the least and the most depth of each; they go behind those that are there
    already, ``taken``: [1] uint32, how many these are.
    """
    go_through(gpu, "coverage.reach", strands, _a_row(view), view=view, bounds=tiles.bounds, window=window,
               survivors=taken, reaches=reaches, **arrays(strands, "points", "spans"))


def slabs_of(reaches: np.ndarray, most: int) -> list[tuple[tuple[int, int], int]]:
    """[((first depth, one past the last), how many segments reach into it)], each for ``most`` at most, nearest first.

    ``reaches``: [segments, 2] uint32, what `reach` gave, on the host.  Empty where more than so many share one depth,
    or there would be more than SLABS.
    """
    near, far = np.sort(reaches[:, 0]), np.sort(reaches[:, 1])
    slabs: list[tuple[tuple[int, int], int]] = []
    first = 0
    while first < EVERY[1] and len(slabs) < SLABS:
        done = int(np.searchsorted(far, first))
        end = int(near[done + most]) if done + most < len(near) else EVERY[1]
        if end <= first:
            return []
        slabs.append(((first, end), int(np.searchsorted(near, end)) - done))
        first = end
    return slabs if first == EVERY[1] else []


def nothing(gpu: Any, visible: Any, shell_transmittance: Any = None) -> Covered:
    """`Covered` of which nothing is known.

    ``visible``: [rows, width, samples] uint64, the body's.  ``shell_transmittance``: [rows, width, samples] float32,
    what `march.march` gave, if there are shells; it becomes the body's.
    """
    rows, width, _ = visible.shape
    has_shells = shell_transmittance is not None
    known = {"body_transmittance": shell_transmittance} if has_shells else {}
    return Covered.empty(gpu, {"pixel": (rows, width), "sample": visible.shape,
                               "shell": (rows if has_shells else 0, width)}, **known)


def cover(gpu: Any, view: np.void, visible: Any, segments: Segments, covered: Covered, lit: Any = None,
          image: Any = None, shell_front: Any = None, window: tuple[int, int] = EVERY, slab: tuple[int, int] = EVERY,
          kept: Any = None, kernels: str = "coverage", seen: Seen | None = None) -> Any:
    """Draw `Segments` and hide them behind each other -> ``covered``, and add their light to an ``image``: in some
    tiles, ``window``: the first, one past the last.

    One tile may be drawn slab of depth after slab, from 0 to EVERY's end, ``slab``: the first depth, one past the last.
    ``kept``: [OF_KEPT, 4] uint32, the same array for all of them.  Returns [1] uint32: in how many pixels more may be
    seen.

    ``visible``: [rows, width, samples] uint64, the body's.  ``lit``: `strand_light.Places` of the segments, if there is
    light, or a function that gives them, called when all else is ready.  ``image``: then [rows, width, 4] float32: the
    light of shells behind all strands, if there are shells, and the result, with alpha.  ``shell_front``: [rows,
    width, samples] uint64, what `march.march` gave, if there are shells.  ``kernels``: the file whose kernels draw: see
    `masks`.  ``seen``: what waits for light: see `cover_seen`.
    """
    rows, width, _ = visible.shape
    has_shells, seen = shell_front is not None, seen or Seen.empty(gpu, dict.fromkeys(SEEN, 0))
    lights = lit is not None or seen.when == LIGHT_LATER
    unfinished = gpu.full(1, np.uint32, 0)
    (across, down), wide = tiles_of(width, rows), max(gpu.lanes, gpu.hinted) > 1
    known = {"view": view, "window": window, "slab": slab, "unfinished": unfinished,
             "kept": gpu.empty((0, 4), np.uint32) if kept is None else kept, "starts": segments.starts,
             "sorted": gpu.empty(segments.entries.shape, np.uint32), "ends": segments.ends, "ids": segments.ids,
             "cuts": segments.cuts, "visible": visible, "has_shells": has_shells,
             "sample_shells": shell_front if has_shells else gpu.empty(0, np.uint64), "lit": lights,
             "image": image if lights else gpu.empty((0, 4), np.float32), **vars(covered),
             **(_overflows(gpu, segments.longest, across * down, kernels) if wide else
                {"grains": GRAINS.empty(gpu, across * down)})}
    plain, near = no_scattering(gpu), no_deep(gpu)
    lit = unlit(gpu, unshadowed(gpu), 0) if lit is None else lit() if callable(lit) else lit
    known |= {"places": lit.places, "sources": lit.sources, "more": lit.more, "shadowed": lit.shadowed,
              "axes": lit.axes, "hazes": lit.hazes, **lit.lighting.arrays(), **(lit.scattering or plain).arrays(),
              **(lit.deep or near).arrays()}
    if wide:
        gpu.launch(f"{kernels}.tiles", -(-across // TILE) * -(-down // TILE) * TILE**2, entries=segments.entries,
                   room=len(seen.nexts), **vars(seen), **known)
        return unfinished
    _sort(gpu, across * down, entries=segments.entries,
          **{name: known[name] for name in ("starts", "sorted", "grains")})
    _pixels(gpu, across * down, kernels, room=len(seen.nexts), taken=seen.taken, bundles=seen.bundles, **known)
    return unfinished


def cover_seen(gpu: Any, segments: Segments, counts: np.ndarray, window: tuple[int, int], light: Any,
               draw: Any) -> None:
    """Draw `Segments` so that only those get light that are seen: some tiles after the other, each time first what
    is seen in them, then its light, then the picture.  Where columns go side by side alone.

    ``counts``: of tiles [n], on the host.  ``window``: the first of these to draw, one past the last.  ``light``: ids
    of segments, [m] uint32 -> their `strand_light.Places`.  ``draw``: `cover` with all its arguments but ``lit``,
    ``window`` and ``seen``.
    """
    n, room = len(segments.ids), BUNDLES * GLOWS
    most = np.maximum(OF_TILE, counts // ENTRIES)
    pieces = np.where(counts, GLOWS + np.minimum(OF_ENTRY * counts.astype(np.int64), most), 0)   # and some
    ends = np.append(0, np.cumsum(pieces))
    seen = Seen.empty(gpu, {"bundle": min(BUNDLES, -(-int(ends[-1]) // GLOWS)), "tile": len(counts),
                            "mark": -(-n // 8), "survivor": n, "counter": 1})
    first = window[0]
    while first < window[1]:
        end = min(max(int(np.searchsorted(ends, ends[first] + room, "right")) - 1, first + 1), window[1])
        draw(window=(first, end), seen=replace(seen, when=LIGHT_LATER, taken=gpu.full(1, np.uint32, 0)))
        ids = choose(gpu, seen, segments.ids)
        if len(ids):
            draw(lit=light(ids), window=(first, end), seen=replace(seen, when=LIGHT_NOW))
        first = end


def choose(gpu: Any, seen: Seen, ids: Any) -> Any:
    """Give slots to the segments that are marked, and take their marks away -> the ids of those in slots, [m] uint32.

    ``ids``: [n] uint32, of all.
    """
    taken, chosen = gpu.full(1, np.uint32, 0), gpu.empty(len(ids), np.uint32)
    gpu.launch("coverage.choose", -(-len(ids) // MARKED), marks=seen.marks, ids=ids, n=len(ids), taken=taken,
               slots=seen.slots, chosen=chosen)
    return gpu.rows(chosen, 0, int(gpu.download(taken)[0]))


def _overflows(gpu, longest, tiles, kernels):
    """Lists in which pieces of tiles wait that have no slot, see cl/overflow.h: for as many tiles as are drawn at a
    time, fewer or none where there is little room.  ``longest``: list of a tile's segments."""
    room = max(min(gpu.memory // 64, gpu.room // 2, gpu.largest), 0) // (PIECES.bytes * OF_PIECE[kernels])
    n = min(gpu.device.max_compute_units, tiles, room // (LEAST_LEFT + PIECES_AT_ONCE)) if longest > SLOTS else 0
    most = min(max(longest, LEAST_LEFT), MOST_LEFT, room // max(n, 1) - PIECES_AT_ONCE)
    most = most // 2 * 2   # each list begins where a ulong2 may
    return {"n_lists": n, "most_left": most if n else 0, "busy": gpu.full(n, np.uint32, 0),
            "again": gpu.full(1, np.uint32, 0),
            "overflows": PIECES.empty(gpu, n * (most + PIECES_AT_ONCE) * OF_PIECE[kernels])}


def _sort(gpu, n, starts, **known):
    """Sort the lists of n tiles by depth.  Where a driver ends long loops, long ones in many launches."""
    longest = TILE**2 * (gpu.steps // 4) if gpu.steps else 2**32 - 1   # three loops, and some
    gpu.launch("coverage.sort", n * TILE**2, first_tile=0, longest=longest, what=0, stretch=EVERY, starts=starts,
               kept=gpu.empty(0, np.uint32), **known)
    if len(known["entries"]) <= longest:
        return
    lengths = np.diff(gpu.download(starts))
    for tile in np.flatnonzero(lengths > longest):
        kept = gpu.upload(np.array([0] * BUCKETS + [2**32 - 1, 0], np.uint32))
        for what in 1, 2, 3:
            for first in range(0, int(lengths[tile]), longest):
                gpu.launch("coverage.sort", TILE**2, first_tile=int(tile), longest=longest, what=what,
                           stretch=(first, first + longest), starts=starts, kept=kept, **known)


def _pixels(gpu, n, kernels, **known):
    """Draw n tiles.  Where a driver ends long loops those with much to do stop, begin anew, some at a time, and go
    on launch by launch."""
    steps = gpu.steps // 2 if gpu.steps else 2**32 - 1   # beginning, end and the last turn take less than as many again
    none, stopped = gpu.empty(0, np.uint32), gpu.full(1, np.uint32, 0)
    open_ = OPEN.empty(gpu, n if gpu.steps else 0)
    gpu.launch(f"{kernels}.pixels", n * TILE**2, steps=steps, fresh=True, listed=False, items=none, open=open_,
               n_open=stopped, walks=gpu.empty((0, 4), np.uint32), **known)
    left = int(gpu.download(stopped)[0]) if gpu.steps else 0
    of_walked = OF_WALKED_MASKED if kernels == "masks" else OF_WALKED
    most = min(max(gpu.room // (of_walked * WALKED.bytes), 1), WALKS)
    for first in range(0, left, most):
        some, fresh, going = min(left - first, most), True, 1
        items, walks = gpu.rows(open_, first, first + some), WALKED.empty(gpu, some * of_walked)
        while going:
            stopped = gpu.full(1, np.uint32, 0)
            gpu.launch(f"{kernels}.pixels", some * TILE**2, steps=steps, fresh=fresh, listed=True, items=items,
                       open=none, n_open=stopped, walks=walks, **known)
            going, fresh = int(gpu.download(stopped)[0]), False


def _knows(tiles, strands):
    return len(tiles.shown) == len(strands.spans)


def _at_a_time(gpu):
    """Strands of a work-item, see cl/coverage.cl."""
    return int(layout.CONSTANTS["AT_A_TIME"]) if max(gpu.lanes, gpu.hinted) > 1 else 1


def _a_row(view):
    """Steps of loops that a row of tiles takes, and some."""
    return int(view["size"][0]) // TILE + 8
