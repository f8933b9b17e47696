"""Strands as text for other renderers: Mitsuba's curve files and pbrt's shapes."""

from collections.abc import Callable

import numpy as np

from ..errors import Error, go_on


def write_mitsuba(strands: dict, stop: Callable[[], bool] | None = None) -> bytes:
    """Return Mitsuba's text of strands, for its shape linearcurve: a point a line, x, y, z and radius, and an empty
    line between strands.  Colours have no place in it; strands of one point, for which it refuses a file, are left
    out."""
    if not (strands["counts"] > 1).any():
        raise Error("strands have one point each; allowed in .txt: some of two or more")
    rows = np.column_stack([strands["points"], np.broadcast_to(strands["width"] / 2, len(strands["points"]))])
    return "\n".join(_lines(np.float64(rows), strands["counts"], stop)).encode()


def _lines(rows, counts, stop):
    at = 0
    for count in counts.tolist():
        go_on(stop)
        if count > 1:
            yield from (" ".join(map(repr, row)) for row in rows[at:at + count].tolist())
            yield ""
        at += count


def write_pbrt(strands: dict, stop: Callable[[], bool] | None = None) -> bytes:
    """Return pbrt-v4's text of strands: each a cubic Bezier curve of type cylinder, straight between its points, with
    diameters at both ends of each segment.  Colours are the reflectance of hair materials."""
    counts, points = strands["counts"], strands["points"]
    widths = np.broadcast_to(strands["width"], len(points)).tolist()
    colors = np.broadcast_to(strands["color"], (len(points), 3))
    lines, material, ends = [], None, np.cumsum(counts)
    for first, end in zip((ends - counts).tolist(), ends.tolist()):
        go_on(stop)
        strand = points[first:end, None].astype(np.float64)
        steps = strand[:-1] + np.array([[0], [1], [2], [3]]) / 3 * (strand[1:] - strand[:-1])
        for k, color, step in zip(range(first, end), colors[first:end].tolist(), steps.reshape(-1, 12).tolist()):
            if color != material:
                material = color
                lines.append(f'Material "hair" "rgb reflectance" [ {_text(color)} ]')
            lines.append(f'Shape "curve" "string type" "cylinder" "point3 P" [ {_text(step)} ] '
                         f'"float width0" {widths[k]!r} "float width1" {widths[k + 1]!r}')
    return "\n".join([*lines, ""]).encode()


def _text(values):
    return " ".join(map(repr, values))
