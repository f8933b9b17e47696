"""STL files: binary and text."""

import re
import struct
from pathlib import Path

import numpy as np

from ..errors import Error
from .input import plain
from .polygons import triangulate

RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)")


def stl(data: bytes, path: Path) -> dict:
    """Return the fields of the Mesh in an STL file: positions and faces.

    Read are a binary file's corners, as many as it states (there may be more bytes behind them), and those of all the
    solids in a text. Normals are computed: those of files have one sense, which the order of corners has already.
    """
    stated = struct.unpack("<I", data[80:84])[0] if len(data) >= 84 else 0
    needed = 84 + RECORD.itemsize * stated
    # Text in the place of the count states more than any file holds: so text is never taken for binary.
    if len(data) >= 84 and (stated or len(data) == 84) and needed <= len(data):
        positions = np.frombuffer(data, RECORD, stated, 84)["corners"].reshape(-1, 3)
        if not stated:
            raise Error("has no faces")
        return {"positions": positions, "faces": np.arange(3 * stated).reshape(-1, 3)}
    text = plain(data).lower()
    if not (text.lstrip().startswith(b"solid") and b"facet" in text):
        raise Error(f"is damaged or cut short: it states {stated} faces, {needed} bytes, but has {len(data)} bytes")
    return _text(text)


def _text(text):
    facets = len(re.findall(rb"\bfacet\s", text))
    ends = np.array([match.start() for match in re.finditer(rb"\bendfacet\b", text)])
    if facets != len(ends) or b"endsolid" not in text:
        raise Error("is damaged or cut short: it ends within a facet or solid")
    found = list(VERTEX.finditer(text))
    try:
        positions = np.array([match.groups() for match in found], np.float64).reshape(-1, 3)
    except ValueError as error:
        raise Error(f"is damaged: a vertex has {str(error).rpartition(': ')[2]}, which is no number") from None
    facet = np.searchsorted(ends, [match.start() for match in found])   # of each vertex
    sizes = np.bincount(facet, minlength=facets)
    if len(sizes) > facets or (sizes < 3).any():
        raise Error("is damaged: a facet has less than three vertices")
    triangles, _ = triangulate(positions, np.arange(len(positions)), sizes)
    return {"positions": positions, "faces": triangles}
