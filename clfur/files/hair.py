"""Strand files .hair, as Cem Yuksel's cyHairFile has them.

128 bytes of header (how many hairs and points, which arrays there are, and defaults for those that are not), then the
arrays: segments uint16 [hairs], points float32 [points, 3], thickness and transparency float32 [points], colors
float32 [points, 3]; all little-endian.  The root comes first; thickness is a diameter, transparency the share of light
that a hair lets through, as LuxCore reads them.  Units and axes are nowhere stated.
"""

import struct
from pathlib import Path

import numpy as np

from ..errors import Error
from .fields import array

HEADER = struct.Struct("<4s4I5f88s")
SEGMENTS, POINTS, THICKNESS, TRANSPARENCY, COLORS = 1, 2, 4, 8, 16   # bits of `arrays`
MOST = 65535   # segments of a hair


def read_hair(data: bytes, path: Path) -> dict:
    """Return the strands of a .hair file: points, counts, width, color and transparency, per point or one for all."""
    header, _ = array(data, 0, "u1", (HEADER.size,), "header")
    mark, hairs, total, arrays, segments, thickness, transparency, *color, _ = HEADER.unpack(header.tobytes())
    if mark != b"HAIR":
        raise Error("is no .hair file: it does not begin with HAIR")
    if not arrays & POINTS:
        raise Error("has no array of points")
    at = HEADER.size
    if arrays & SEGMENTS:
        counts, at = array(data, at, "<u2", (hairs,), "segments")
        counts = counts.astype(np.int64) + 1
    stated = int(counts.sum()) if arrays & SEGMENTS else hairs * (segments + 1)
    if stated != total:
        raise Error(f"states {total} points, but its {hairs} hairs have {stated}")
    points, at = array(data, at, "<f4", (total, 3), "points")
    if not arrays & SEGMENTS:   # which are no more than there are points, now that these are known to be there
        counts = np.full(hairs, segments + 1)
    found = {"points": points, "counts": counts, "width": np.float32(thickness), "color": np.array(color, np.float32),
             "transparency": np.float32(transparency)}
    for bit, name, what, columns in [(THICKNESS, "width", "thicknesses", ()),
                                     (TRANSPARENCY, "transparency", "transparencies", ()),
                                     (COLORS, "color", "colours", (3,))]:
        if arrays & bit:
            found[name], at = array(data, at, "<f4", (total, *columns), what)
    return found


def write_hair(strands: dict) -> bytes:
    """Return the bytes of a .hair file of strands, as `curves.stored` gives them."""
    counts = strands["counts"]
    if len(counts) and not 1 <= int(counts.min()) <= int(counts.max()) <= MOST + 1:
        raise Error(f"strands have {counts.min()} to {counts.max()} points; allowed in .hair: 1 to {MOST + 1}")
    total, same = int(counts.sum()), len(set(counts.tolist())) <= 1
    arrays, data, defaults = POINTS, [], []
    if not same:
        arrays |= SEGMENTS
        data.append((counts - 1).astype("<u2"))
    data.append(strands["points"].astype("<f4"))
    for bit, name in (THICKNESS, "width"), (TRANSPARENCY, "transparency"), (COLORS, "color"):
        values = strands[name]   # one for all: the header's default
        defaults.append(np.atleast_1d(values[0]))
        if len(values) == total and total > 1:
            arrays |= bit
            data.append(values.astype("<f4"))
    thickness, transparency, color = defaults
    head = HEADER.pack(b"HAIR", len(counts), total, arrays, int(counts[0]) - 1 if len(counts) and same else 0,
                       float(thickness[0]), float(transparency[0]), *map(float, color), b"")
    return head + b"".join(each.tobytes() for each in data)
