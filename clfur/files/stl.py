"""STL files: binary and text."""

import re
import struct
from pathlib import Path

import numpy as np

from ..errors import Error
from .input import plain
from .polygons import triangulate

RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
LOOP = re.compile(rb"\bouter\s+loop\b(.*?)\bendloop\b", re.DOTALL)


def stl(data: bytes, path: Path) -> dict:
    """Return the fields of the Mesh in an STL file: positions and faces.

    Read are a binary file's corners, as many as it states (there may be more bytes behind them), and those of all the
    solids in a text. Normals are computed: those of files have one sense, which the order of corners has already.
    """
    stated = struct.unpack("<I", data[80:84])[0] if len(data) >= 84 else 0
    needed = 84 + RECORD.itemsize * stated
    # Text in the place of the count states more than any file holds: so text is never taken for binary.
    if needed <= len(data):
        positions = np.frombuffer(data, RECORD, stated, 84)["corners"].reshape(-1, 3)
        if not stated:
            raise Error("has no faces")
        return {"positions": positions, "faces": np.arange(3 * stated).reshape(-1, 3)}
    text = plain(data).lower()
    if not (text.lstrip().startswith(b"solid") and b"facet" in text):
        raise Error(f"is damaged or cut short: it states {stated} faces, {needed} bytes, but has {len(data)} bytes")
    return _text(text)


def _text(text):
    facets = len(re.findall(rb"\bfacet\s+normal\b", text))
    loops = [loop.split() for loop in LOOP.findall(text)]   # vertex 0 0 0 vertex 1 0 0 ...
    if not len(loops) == facets == len(re.findall(rb"\bendfacet\b", text)) or b"endsolid" not in text:
        raise Error("is damaged or cut short: it ends within a facet or solid")
    if any(len(words) < 12 or len(words) % 4 or set(words[::4]) != {b"vertex"} for words in loops):
        raise Error("is damaged: a facet has less than three vertices, or one of them is none of three numbers")
    numbers = [word for words in loops for k, word in enumerate(words) if k % 4]
    try:
        positions = np.array(list(map(float, numbers))).reshape(-1, 3)
    except ValueError as error:
        raise Error(f"is damaged: a vertex has {str(error).rpartition(': ')[2]}, which is no number") from None
    sizes = np.array([len(words) // 4 for words in loops], np.int64)
    triangles, _ = triangulate(positions, np.arange(len(positions)), sizes)
    return {"positions": positions, "faces": triangles}
