"""Strands as text for other renderers: Mitsuba's curve files and pbrt's shapes."""

import numpy as np

from ..errors import Error


def write_mitsuba(strands: dict) -> bytes:
    """Return Mitsuba's text of strands, for its shape linearcurve: a point a line, x, y, z and radius, and an empty
    line between strands.  Colours have no place in it; strands of one point, for which it refuses a file, are left
    out."""
    if not (strands["counts"] > 1).any():
        raise Error("strands have one point each; allowed in .txt: some of two or more")
    rows = np.column_stack([strands["points"], np.broadcast_to(strands["width"] / 2, len(strands["points"]))])
    return "\n".join(_lines(rows, strands["counts"])).encode()


def _lines(rows, counts):
    texts, at = [" ".join(map(repr, row)) for row in np.float64(rows).tolist()], 0
    for count in counts.tolist():
        if count > 1:
            yield from texts[at:at + count]
            yield ""
        at += count


def write_pbrt(strands: dict) -> bytes:
    """Return pbrt-v4's text of strands: each a cubic Bezier curve of type cylinder, straight between its points, with
    diameters at both ends of each segment.  Colours are the reflectance of hair materials."""
    counts, points = strands["counts"], strands["points"]
    widths = np.broadcast_to(strands["width"], len(points)).tolist()
    colors = np.broadcast_to(strands["color"], (len(points), 3))
    lines, material, ends = [], None, np.cumsum(counts)
    for first, end in zip((ends - counts).tolist(), ends.tolist()):
        for k in range(first, end - 1):
            color = tuple(float(each) for each in colors[k])
            if color != material:
                material = color
                lines.append(f'Material "hair" "rgb reflectance" [ {_text(color)} ]')
            steps = points[k] + np.array([[0], [1], [2], [3]]) / 3 * (points[k + 1] - points[k])
            lines.append(f'Shape "curve" "string type" "cylinder" "point3 P" [ {_text(steps.ravel())} ] '
                         f'"float width0" {widths[k]!r} "float width1" {widths[k + 1]!r}')
    return "\n".join([*lines, ""]).encode()


def _text(values):
    return " ".join(repr(float(each)) for each in values)
