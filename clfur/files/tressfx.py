"""Strand files .tfx of TressFX 4.

160 bytes of header (version 4, strands, points a strand, and at which byte each array begins; 0: there is none), then
positions float32 [strands, points, 4] (w is 0 where a point is held fast), and as they are there uv [strands, 2], uv
[strands, points, 2], thickness [strands], colours [strands, points, 4]; all little-endian.  The root comes first.  The
exporter that AMD published writes no thickness: hair is as wide as its material says in the game; and its v runs down,
as Direct3D has it.
"""

import struct
from pathlib import Path

import numpy as np

from ..errors import Error
from .fields import array

HEADER = struct.Struct("<f7I128x")
FEWEST, MOST = 4, 64   # points of a strand, a power of two


def read_tfx(data: bytes, path: Path) -> dict:
    """Return the strands of a .tfx file: points, counts, and as it has them width, color and root_uv."""
    header, _ = array(data, 0, "u1", (HEADER.size,), "header")
    version, strands, points, *offsets = HEADER.unpack(header.tobytes())
    if not 4 <= version < 5:
        raise Error(f"is of TressFX version {version:g}; allowed: 4")
    kinds = [("positions", (strands, points, 4)), ("uv of strands", (strands, 2)), ("uv", (strands, points, 2)),
             ("thicknesses", (strands,)), ("colours", (strands, points, 4))]
    if offsets[0] < HEADER.size:
        raise Error(f"has its positions at byte {offsets[0]}; allowed: {HEADER.size} or more, behind the header")
    places, _ = array(data, offsets[0], "<f4", kinds[0][1], kinds[0][0])
    uv, point_uv, thickness, colors = (array(data, at, "<f4", shape, what)[0] if at else None
                                       for at, (what, shape) in zip(offsets[1:], kinds[1:], strict=True))
    if uv is None and point_uv is not None:
        uv = point_uv[:, 0]
    found = {"points": places[..., :3].reshape(-1, 3), "counts": np.full(strands, points), "root_uv": _from_above(uv),
             "width": thickness,
             "color": None if colors is None else colors[..., :3].reshape(-1, 3)}
    return {name: value for name, value in found.items() if value is not None}


def write_tfx(strands: dict) -> bytes:
    """Return the bytes of a .tfx file of strands, as `curves.stored` gives them.

    All strands get as many points as the longest has, or the next power of two: what is added lies on their segments.
    """
    counts = strands["counts"]
    if len(counts) and not 2 <= int(counts.min()) <= int(counts.max()) <= MOST:
        raise Error(f"strands have {counts.min()} to {counts.max()} points; allowed in .tfx: 2 to {MOST}")
    most = max(FEWEST, int(counts.max(initial=FEWEST)))
    most = 1 << (most - 1).bit_length()
    at, share = spread(counts, most)
    total = int(counts.sum())

    def filled(values):
        values = np.broadcast_to(values, (total, values.shape[1])).astype(np.float64)
        return values[at] * (1 - share[:, None]) + values[np.minimum(at + 1, total - 1)] * share[:, None]

    held = np.where(np.arange(len(at)) % most < 2, 0, 1)[:, None]   # the root and the next, as AMD's exporters do
    data = [np.hstack([filled(strands["points"]), held]), _from_above(strands.get("root_uv")), None,
            _at_roots(strands["width"], counts),
            np.hstack([filled(strands["color"]), np.ones((len(at), 1))])]
    offsets, end = [], HEADER.size
    blocks = [None if each is None else np.asarray(each).astype("<f4").tobytes() for each in data]
    for block in blocks:
        offsets.append(0 if block is None else end)
        end += 0 if block is None else len(block) + -len(block) % 8   # arrays begin at eighths
    head = HEADER.pack(4.0, len(counts), most, *offsets)
    return head + b"".join(block + bytes(-len(block) % 8) for block in blocks if block is not None)


def spread(counts: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Return where points of strands with ``most`` each lie: int64 [strands * most], the point before, and the share
    of the way to the next.  Points that there are stay, others divide segments evenly."""
    first = np.cumsum(counts) - counts
    segments = (counts - 1)[:, None]
    of = np.arange(most)[None, :]
    # Segment s gets the steps from ceil(s n / segments) on: as many as another, give or take one.
    steps = most - 1
    segment = np.minimum(of * segments // steps, segments - 1)
    begin = -(-segment * steps // segments)
    end = -(-(segment + 1) * steps // segments)
    share = (of - begin) / (end - begin)
    return (first[:, None] + segment).ravel(), share.ravel()


def _from_above(uv):
    """uv with v from the top down, or from the bottom up where it was so."""
    return None if uv is None else np.column_stack([uv[:, 0], 1 - uv[:, 1]])


def _at_roots(values, counts):
    """One value for each strand, of values for all or for each point: its root's."""
    return np.broadcast_to(values, len(counts)) if len(values) == 1 else values[np.cumsum(counts) - counts]
