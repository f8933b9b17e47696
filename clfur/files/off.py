"""OFF files, as Geomview defines them: text alone."""

import re
from pathlib import Path

import numpy as np

from ..errors import Error
from .input import lines, plain
from .polygons import by_size, triangulate

HEADER = re.compile(rb"(ST)?(C)?(N)?(4)?(n)?OFF$")


def off(data: bytes, path: Path) -> dict:
    """Return the fields of the Mesh in an OFF file: positions, normals, uv and faces.

    Read are OFF and all of its prefixes but n (any dimension): ST (uv), C (colours, passed over), N (normals) and
    4 (positions are divided by w). The word may be missing. Faces' colours are passed over.
    """
    rows = [line.partition(b"#")[0].split() for line in lines(plain(data))]
    rows = [row for row in rows if row]
    st, _, normal, four = _header(rows)
    vertices, faces = _counts(rows, len(data))
    if vertices + faces != len(rows):
        problem = "is damaged or cut short" if len(rows) < vertices + faces else "has more lines"
        raise Error(f"{problem}: its header states {vertices + faces} vertices and faces, there are {len(rows)} lines")
    width = 3 + four
    table = _numbers(rows[:vertices], width + 3 * normal + 2 * st, st)
    positions = table[:, :3]
    if four:
        with np.errstate(all="ignore"):   # a vertex at infinity is an error where a face uses it
            positions = positions / table[:, 3:4]
    sizes, corners = _faces(rows[vertices:], vertices)
    if not len(corners):
        raise Error("has no faces")
    triangles, face_of = by_size(*triangulate(positions, corners, sizes), sizes)
    return {"positions": positions, "normals": table[:, width:width + 3] if normal else None,
            "uv": table[:, -2:][corners[triangles]] if st else None, "faces": corners[triangles],
            "numbering": {"face_of": face_of, "faces": len(sizes)}}


def _header(rows):
    """Take the header word off the first row, which may have the counts too; return which prefixes there are."""
    word = rows[0][0] if rows else b""
    found = HEADER.match(word) or HEADER.match(word.upper())
    if not found:
        if rows and len(rows[0]) in (2, 3) and all(each.isdigit() for each in rows[0]):
            return False, False, False, False   # the word is left out
        raise Error("is damaged or cut short: it has no OFF header")
    if found[5]:
        raise Error(f"is {word.decode()}, of any dimension; allowed: OFF of three, with prefixes ST, C, N and 4")
    rows[0] = rows[0][1:]
    if rows[0] and rows[0][0].upper() == b"BINARY":
        raise Error("is OFF BINARY; allowed: OFF as text")
    if not rows[0]:
        del rows[0]
    return tuple(bool(found[k]) for k in (1, 2, 3, 4))


def _counts(rows, size):
    """Take the counts off the rows: how many vertices and faces there are."""
    words = rows.pop(0) if rows else []
    if len(words) < 2 or not all(each.isdigit() for each in words[:2]):
        raise Error("is damaged or cut short: it has no OFF header with counts of vertices and faces")
    vertices, faces = (int(each[:20]) for each in words[:2])
    if vertices + faces > size:
        raise Error(f"is damaged or cut short: it states {vertices} vertices and {faces} faces but has {size} bytes")
    return vertices, faces


def _numbers(rows, width, st):
    """Return the numbers of vertices float64 [V, width]: a row's first ones, and with st its last two."""
    short = next((k for k, row in enumerate(rows) if len(row) < width), None)
    if short is not None:
        raise Error(f"vertex {short} has {len(rows[short])} numbers; allowed: at least {width}")
    try:
        rows = [row[:width - 2] + row[-2:] if st else row[:width] for row in rows]
        return np.array(rows, np.float64).reshape(-1, width)
    except ValueError as error:
        raise Error(f"is damaged: a vertex has {str(error).rpartition(': ')[2]}, which is no number") from None


def _faces(rows, vertices):
    """Return how many corners the faces have, int64 [P], and their vertices, int64 [sum]."""
    sizes, corners = [], []
    for k, row in enumerate(rows):
        try:
            size = int(row[0])
            corners += map(int, row[1:size + 1])
        except ValueError:
            size = -1
        if not 0 <= size < len(row):
            raise Error(f"is damaged or cut short: face {k} is {b' '.join(row)[:60].decode('latin-1')!r}")
        sizes.append(size)
    worst = max(corners, default=0) if min(corners, default=0) >= 0 else min(corners)
    if not 0 <= worst < max(vertices, 1):
        raise Error(f"a face has the index {worst}; allowed: 0 to {vertices - 1}")
    return np.array(sizes, np.int64), np.array(corners, np.int64)
