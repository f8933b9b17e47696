"""Strands between guides: the user's strands that stand on the mesh, nearest to each root, blended there."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .. import layout
from ..layout import Arrays, array
from .strands import DeviceStrands, arrays, grow, roots_of
from .tessellate import Surface, as_float4

NEAREST, NOTHING = int(layout.CONSTANTS["NEAREST"]), int(layout.CONSTANTS["NOTHING"])
ROOM = 7   # of guides around one, the furthest of these is how far away
CHORD_SHARES = 0.25, 0.5, 1.0   # of a guide's length, where the chords from its root end
FOUND = layout.Declared("strand", np.uint32, 2 * NEAREST)   # squares of distances, float32; numbers of guides
FEET = layout.Declared("guide", np.float32, 4)
MEMBER_STEPS = 16      # of loops that a member of a tree takes, at most
CODE_BITS = 10  # of a coordinate, by which what is near each other comes into one node


@dataclass(frozen=True)
class Trees(Arrays):
    """Trees of boxes in space, see guides.cl."""

    boxes: Any = array("box", np.float32, 8)        # of a node's parts: lowest x, y, z, highest x, y, z
    members: Any = array("member", np.uint32)       # numbers of what is in the nodes of the last row
    trees: Any = array("tree", np.uint32, 4)        # first node, first of its last row, that row, first member
    rounds: int = 1                                 # in which all are gone through: a driver that ends long loops


@dataclass(frozen=True)
class Guides(Arrays):
    """Guides on the device, which stand on a mesh."""

    offsets: Any = array("guide_point", np.float32, 4)   # from the root [world], share of the guide's length
    guide_spans: Any = array("guide", np.uint32, 2)      # first point, points
    roots: Any = array("guide", np.float32, 4)           # x, y, z [world], square of `ROOM`
    normals: Any = array("guide", np.float32, 4)         # unit, of the mesh there
    chords: Any = array("chord", np.float32, 4)          # unit directions from the root to where CHORD_SHARES end
    tree_of: Any = array("type", np.uint32)              # which tree strands of a type look in
    boxes: Any = array("box", np.float32, 8)             # of trees of them, as `Trees`
    members: Any = array("member", np.uint32)
    trees: Any = array("tree", np.uint32, 4)
    rounds: int = 1


def stand(gpu: Any, mesh: Any, curves: Any, types: int) -> tuple[Guides, np.ndarray]:
    """Put guides, `clfur.Curves`, on a mesh -> (`Guides`, distances of their roots from it [guides] float32).

    Those of fewer than two points are left out.  ``types``: of the strands; each follows guides of its own number, or
    all where there is none.
    """
    some = np.flatnonzero(curves.counts > 1)
    offsets, spans, roots, chords = shapes(curves.points, curves.counts)
    kinds = np.zeros(len(some), int) if curves.type_of is None else curves.type_of[some].astype(int)
    present = [] if curves.type_of is None else [kind for kind in range(types) if (kinds == kind).any()]
    groups = [np.flatnonzero(kinds == kind) for kind in present]
    if len(present) < types:
        groups.append(np.arange(len(some)))
    tree_of = [present.index(kind) if kind in present else len(present) for kind in range(types)]
    trees = trees_of(gpu, roots, roots, groups)
    has_normals = curves.root_normal is not None
    there = gpu.upload(as_float4(roots))
    normals = gpu.upload(as_float4(curves.root_normal[some])) if has_normals else gpu.empty((len(some), 4), np.float32)
    away = np.sqrt(gpu.download(feet_on(gpu, mesh, there, normals, has_normals))[:, 0])
    made = Guides(
        offsets=gpu.upload(offsets), guide_spans=gpu.upload(spans), normals=normals,
        chords=gpu.upload(as_float4(chords)), tree_of=gpu.upload(np.array(tree_of, np.uint32)),
        roots=there, **vars(trees))
    room = _room(gpu, made, np.where(kinds < types, kinds, 0))
    return replace(made, roots=gpu.upload(np.column_stack([roots, room]))), away


def _room(gpu, guides, kinds):
    """Squares of how far the seventh of its own type is from each guide [guides] float32, infinite where none is."""
    n = len(kinds)
    spans, uv = np.stack([np.arange(n), np.ones(n)], 1).astype(np.uint32), np.zeros((n, 4), np.float32)
    uv[:, 2] = kinds
    found = _nearest(gpu, guides, ROOM + 1, points=guides.roots, spans=gpu.upload(spans), strand_normal=guides.normals,
                     strand_uv=gpu.upload(uv))
    return gpu.download(found)[:, ROOM].view(np.float32)


def _nearest(gpu, guides, most, **strands):
    """`FOUND` of strands, so many guides of each."""
    n = len(strands["spans"])
    found = FOUND.empty(gpu, n)
    for number in range(guides.rounds):
        gpu.launch("guides.nearest", n, boxes=guides.boxes, members=guides.members, roots=guides.roots,
                   normals=guides.normals, trees=guides.trees, tree_of=guides.tree_of, lap=number, most=most,
                   n_trees=len(guides.trees) // guides.rounds, found=found, **strands)
    return found


def bytes_of(curves: Any, types: int, faces: int) -> int:
    """Bytes on the device of guides, and of what it takes to put them on a mesh of so many faces."""
    guides = int((curves.counts > 1).sum())
    nodes = [6 * (8 + n // 3) for n in (2 * guides, faces)]   # of each row, an eighth and what fills those before it
    return (Guides.bytes(guide_point=len(curves.points), guide=guides, chord=3 * guides, type=types,
                         box=nodes[0], member=2 * guides) + (FEET.bytes + FOUND.bytes) * guides
            + Trees.bytes(box=nodes[1], member=faces) + 16 * 3 * faces)


def between(gpu: Any, surface: Surface, fur: Any, strands: tuple[int, int] | None = None,
            area: tuple[int, int] | None = None, sums: tuple[Any, Any] | None = None, traits_of: Any = None, *,
            guides: Guides) -> DeviceStrands:
    """Strands of a `clfur.Strands` with the shapes of its guides -> `DeviceStrands`; all but these is as `grow` has it,
    and so are the other arguments."""
    begin, roots = roots_of(gpu, surface, fur, strands, area, sums)
    traits = None if traits_of is None else traits_of(roots)
    grown = grow(gpu, surface, fur, (begin, begin + len(roots)), traits_of=None if traits is None else lambda _: traits,
                 roots=roots)
    n, most = len(roots), fur.guides_blended + 1
    found = _nearest(gpu, guides, most, **arrays(grown, "points", "spans", "strand_normal", "strand_uv"))
    known = {"positions": surface.positions, "triangles": surface.triangles, "stand_on": roots,
             "has_traits": traits is not None, "traits": gpu.empty(0, layout.Traits) if traits is None else traits,
             "seed": fur.seed,
             **arrays(grown, "first_strand", "types", "points", "spans", "strand_normal", "strand_uv")}
    of_point = most * (2 + int(guides.offsets.shape[0]).bit_length())   # steps of loops
    at_once = max(gpu.own_steps // 2 // of_point, 1)
    cosine = np.cos(np.radians(fur.parting)) if fur.parting < 180 else -2.0   # below all cosines, and their rounding
    reach = -1.0 if fur.guides_reach is None else fur.guides_reach**2   # below 0: anywhere
    for first in range(0, grown.run, at_once):
        gpu.launch("guides.blend", n, most=most, parting=np.float32(cosine), reach=np.float32(reach),
                   roots=guides.roots, found=found, offsets=guides.offsets, guide_spans=guides.guide_spans,
                   normals=guides.normals, chords=guides.chords, first_point=first,
                   stop=min(first + at_once, grown.run), **known)
    if any(kind.curl[0] or kind.wave[0] for kind in fur.types):
        gpu.launch("guides.wind", n, **known)
    return grown


def shapes(points: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """What guides of two points or more are like: (offsets from the root and shares of the length [P, 4] float32, spans
    [G, 2] uint32, roots [G, 3] float32, chords [3 G, 3] float32, unit or 0)."""
    some = counts > 1
    rows = np.repeat(some, counts)
    places, counts = points[rows].astype(np.float64), counts[some].astype(np.int64)
    first = np.cumsum(counts) - counts
    owner = np.repeat(np.arange(len(counts)), counts)
    steps = np.zeros(len(places))
    steps[1:] = np.linalg.norm(np.diff(places, axis=0), axis=1)
    steps[first] = 0
    sums = np.cumsum(steps)
    way, whole = sums - sums[first][owner], (sums[first + counts - 1] - sums[first])[owner]
    share = np.where(whole > 0, way / np.where(whole > 0, whole, 1), 0)
    share[first + counts - 1] = 1
    offsets = np.column_stack([places - places[first][owner], share])
    chords = np.zeros((len(counts), len(CHORD_SHARES), 3))
    for k, end in enumerate(CHORD_SHARES):
        behind = np.add.reduceat(share < end, first) if len(first) else first   # points before it, one at least
        b = first + np.minimum(behind, counts - 1)
        gap = share[b] - share[b - 1]
        t = np.where(gap > 0, (end - share[b - 1]) / np.where(gap > 0, gap, 1), 0)
        chord = offsets[b - 1, :3] + t[:, None] * (offsets[b, :3] - offsets[b - 1, :3])
        length = np.linalg.norm(chord, axis=1, keepdims=True)
        chords[:, k] = np.where(length > 0, chord / np.where(length > 0, length, 1), 0)
    return (offsets.astype(np.float32), np.stack([first, counts], 1).astype(np.uint32),
            places[first].astype(np.float32), chords.reshape(-1, 3).astype(np.float32))


def trees_of(gpu: Any, low: np.ndarray, high: np.ndarray, groups: list[np.ndarray]) -> Trees:
    """`Trees` of things in boxes ``low`` to ``high`` [N, 3]: one of each of some groups of their numbers, or several
    where a driver ends long loops."""
    codes, most = codes_of((low.astype(np.float64) + high) / 2), max(gpu.own_steps // MEMBER_STEPS, 1)
    rounds = max(-(-len(group) // most) for group in groups)
    boxes, members, trees, node, first = [], [], [], 0, 0
    groups = [group[np.argsort(codes[group], kind="stable")] for group in groups]
    for number in range(rounds):
        for group in groups:
            here = group[number * most:(number + 1) * most]
            nodes, rows = _nodes(low[here], high[here])
            boxes.append(nodes)
            members.append(here)
            trees.append((node, (8**rows - 1) // 7, rows, first) if len(here) else (NOTHING, 0, 0, 0))
            node, first = node + len(nodes), first + len(here)
    return Trees(boxes=gpu.upload(np.concatenate(boxes).reshape(-1, 8).astype(np.float32)),
                 members=gpu.upload(np.concatenate(members).astype(np.uint32)),
                 trees=gpu.upload(np.array(trees, np.uint32)), rounds=rounds)


def codes_of(places: np.ndarray) -> np.ndarray:
    """Where places [N, 3] are along a curve that seldom jumps (Morton's): uint32 [N]."""
    low = places.min(0)
    side = float(np.ptp(places, axis=0).max()) or 1.0
    cells = np.minimum((places - low) / side * (1 << CODE_BITS), (1 << CODE_BITS) - 1).astype(np.uint32)
    codes = np.zeros(len(places), np.uint32)
    for bit in range(CODE_BITS):
        for axis in range(3):
            codes |= (cells[:, axis] >> np.uint32(bit) & np.uint32(1)) << np.uint32(3 * bit + axis)
    return codes


def _nodes(low, high):
    """(Boxes of the parts of a tree's nodes [nodes, 6, 8], the number of its last row) of boxes low, high [n, 3], in
    their order."""
    rows = []
    while True:
        n = -(-max(len(low), 1) // 8)
        boxes = np.empty((2, 8 * n, 3))
        boxes[0], boxes[1] = 1e30, -1e30   # of nothing: that far, all squares are infinite
        boxes[0, :len(low)], boxes[1, :len(low)] = low, high
        rows.append(boxes.transpose(0, 2, 1).reshape(2, 3, n, 8).transpose(2, 0, 1, 3).reshape(n, 6, 8))
        low, high = boxes[0].reshape(n, 8, 3).min(1), boxes[1].reshape(n, 8, 3).max(1)
        if n == 1:
            break
    for row, each in enumerate(rows[:0:-1]):   # all but the last are whole, if of nothing
        rows[-1 - row] = np.concatenate([each, np.zeros((8**row - len(each), 6, 8))])
    return np.concatenate(rows[::-1]), len(rows) - 1


def feet_on(gpu: Any, mesh: Any, roots: Any, normals: Any, has_normals: bool = False) -> Any:
    """Where a mesh is nearest to ``roots`` [guides] float4 -> `FEET`: square of the distance, number of the face (its
    bits), weights of its second and third corner.  Writes its ``normals`` there, [guides, 4], unless ``has_normals``.
    """
    corners = mesh.positions[mesh.faces]
    spare = float(np.abs(mesh.positions).max()) * 2.0**-18   # what rounding may find nearer than a box
    trees = trees_of(gpu, corners.min(1) - spare, corners.max(1) + spare, [np.arange(len(corners))])
    feet = FEET.empty(gpu, len(roots))
    known = {"positions": gpu.upload(as_float4(mesh.positions)), "vertex_normals": gpu.upload(as_float4(mesh.normals)),
             "faces": gpu.upload(as_float4(mesh.faces))}
    for number in range(trees.rounds):
        gpu.launch("guides.stand", len(roots), roots=roots, boxes=trees.boxes, members=trees.members, trees=trees.trees,
                   lap=number, feet=feet, has_normals=has_normals, normals=normals, **known)
    return feet
