"""Strands in PLY files: an element of lists of vertices, or edges.

Vertices have x, y, z, and as they are there width (or diameter, thickness; radius is half of it) and red, green, blue
(whole numbers are sRGB, others linear light).  A strand is a row of the element strand (or line, polyline, curve,
fiber; also in the plural) with a list vertex_indices, or with nsegs (how many segments; vertices stand strand after
strand, as hairutil writes them), or a chain of the element edge's vertex1, vertex2, from its root on.
"""

from pathlib import Path

import numpy as np

from ..errors import Error
from .ply import INDICES, rows_of

LISTS = "strand", "strands", "line", "lines", "polyline", "polylines", "curve", "curves", "fiber", "fibers"
WIDTHS = {"width": 1, "diameter": 1, "thickness": 1, "radius": 2}   # of it a diameter is so many
RGB = "red", "green", "blue"
SEGMENTS = "nsegs"
WANTED = {"x", "y", "z", *WIDTHS, *RGB, *INDICES, SEGMENTS, "vertex1", "vertex2"}


def read_strand_ply(data: bytes, path: Path) -> dict:
    """Return the strands of a PLY file: points, counts, and as it has them width and color per point."""
    tables = rows_of(data, WANTED)
    vertex = tables.get("vertex", {})
    if not {"x", "y", "z"} <= vertex.keys():
        raise Error("has no vertices with x, y and z")
    name = next((name for name in LISTS if name in tables), None)
    if name and SEGMENTS in tables[name]:
        segments = tables[name][SEGMENTS]
        counts, order = _whole(segments, 1 << 31) + 1, np.arange(len(vertex["x"]))
        if int(counts.sum()) != len(order):
            raise Error(f"has {len(order)} vertices, but its strands have {int(counts.sum())}")
    elif name:
        lists = next((tables[name][each] for each in INDICES if each in tables[name]), None)
        if not isinstance(lists, tuple):
            raise Error(f"has {name} rows without a list vertex_indices")
        counts, order = lists
    elif {"vertex1", "vertex2"} <= tables.get("edge", {}).keys():
        counts, order = _chains(*(_whole(tables["edge"][each], len(vertex["x"])) for each in ("vertex1", "vertex2")))
    else:
        raise Error("has no strands; allowed: an element strand (or line) of lists vertex_indices, or edge of vertex1 "
                    "and vertex2")
    order = _whole(order, len(vertex["x"]))
    found = {"points": np.stack([vertex[each].astype(np.float64) for each in "xyz"], axis=1)[order], "counts": counts}
    if width := next((each for each in WIDTHS if each in vertex), None):
        found["width"] = WIDTHS[width] * vertex[width].astype(np.float64)[order]
    if set(RGB) <= vertex.keys():
        found["color"] = _colors(np.stack([vertex[each] for each in RGB], axis=1)[order])
    return found


def _colors(values):
    """Colours as `Curves` takes them: whole numbers are sRGB, of 8 bits unless they are stated to have 16."""
    if values.dtype.kind == "f" or values.dtype == np.uint16:
        return values
    if len(values) and not 0 <= int(values.min()) <= int(values.max()) <= 255:
        raise Error(f"has colours of {values.min()} to {values.max()}; allowed for whole numbers: 0 to 255, or to "
                    "65535 of ushort")
    return values.astype(np.uint8)


def _whole(values, vertices):
    with np.errstate(invalid="ignore"):
        indices = values.astype(np.int64)
    wrong = (indices != values) | (indices < 0) | (indices >= vertices)
    if wrong.any():
        raise Error(f"a strand has the index {values[wrong.argmax()]:.15g}; allowed: 0 to {vertices - 1}")
    return indices


def _chains(begin, end):
    """Return the lengths of chains of edges, and the vertices along them; a chain begins where no edge ends."""
    vertices, again = np.unique(np.concatenate([begin, end]), return_inverse=True)
    begin, end = again.reshape(2, -1)
    many = len(vertices)
    if np.bincount(begin, minlength=many).max(initial=0) > 1 or np.bincount(end, minlength=many).max(initial=0) > 1:
        raise Error("has edges that branch, or that run from both ends; allowed: chains from a root to a tip")
    follows, first = np.full(many, -1), np.ones(many, bool)
    follows[begin], first[end] = end, False
    at, strand = np.flatnonzero(first), np.arange(int(first.sum()))
    steps = []
    while len(at):   # all chains a step at a time
        steps.append((strand, at))
        at = follows[at]
        strand, at = strand[at >= 0], at[at >= 0]
    found = sum(len(each) for _, each in steps)
    if found < many:
        raise Error(f"has {many - found} vertices in edges that run in a circle; allowed: chains from a root to a tip")
    strands, order = (np.concatenate(each) for each in zip(*steps)) if steps else np.zeros((2, 0), np.int64)
    return np.bincount(strands, minlength=int(first.sum())), vertices[order[np.argsort(strands, kind="stable")]]


def write_strand_ply(strands: dict) -> bytes:
    """Return the bytes of a PLY file of strands, as `curves.stored` gives them; places in float64."""
    counts, points = strands["counts"], strands["points"]
    rows = np.empty(len(points), [("place", "<f8", 3), ("width", "<f4"), ("color", "<f4", 3)])
    rows["place"], rows["width"], rows["color"] = points, strands["width"], strands["color"]
    words = np.empty(len(counts) + len(points), "<u4")
    at = np.cumsum(counts + 1) - (counts + 1)
    rest = np.ones(len(words), bool)
    rest[at] = False
    words[at], words[rest] = counts, np.arange(len(points))
    head = ["ply", "format binary_little_endian 1.0", "comment width is a diameter, colours are linear light",
            f"element vertex {len(points)}", *(f"property double {each}" for each in "xyz"), "property float width",
            *(f"property float {each}" for each in RGB),
            f"element strand {len(counts)}", "property list uint uint vertex_indices", "end_header", ""]
    return "\n".join(head).encode() + rows.tobytes() + words.tobytes()
