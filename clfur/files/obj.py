"""OBJ files.

Read here and not by a library: trimesh takes relative indices from the file's end (so a file of several objects comes
out wrong), reads index 0 as the last one, and passes over lines that were cut short.
"""

import re
from pathlib import Path

import numpy as np

from ..errors import Error
from .input import lines, plain
from .polygons import triangulate

WIDTHS = {"v": 3, "vt": 2, "vn": 3}
FACES = {"f", "fo"}   # fo: as faces with outlines were called before version 3
# What makes a surface that is not read here, or has it in another file.
SURFACES = {"surf", "bzp", "bsp", "cdp", "call", "csh"}
COMMENT = re.compile(r"(?<!\d\.)#")
NOT_A_NUMBER = re.compile(r"[+-]?(nan|inf|\d\.#)", re.I)   # as old C libraries write them: -nan(ind), 1.#IND, 1.#INF


def obj(data: bytes, path: Path) -> dict:
    """Return the fields of the Mesh in an OBJ file: positions, normals, uv, faces, and their numbers and names.

    Read are lines v (the first three numbers: w is of curves alone), vt, vn and f, and of g, o and usemtl the names.
    Points, lines and curves are passed over; surfaces other than polygons are an Error, as is all that is damaged.
    """
    tables, sizes, corners, labels = _parse(lines(_joined(plain(data))))
    if not len(corners):
        raise Error("has no faces")
    for kind, table, last in zip(WIDTHS, tables, corners.max(axis=0), strict=True):
        if last >= len(table):
            raise Error(f"a face has the {kind} index {last + 1}; allowed: 1 to {len(table)}")
    positions, uvs, normals = tables
    triangles, face_of = triangulate(positions, corners[:, 0], sizes)
    v, vt, vn = corners[triangles].transpose(2, 0, 1)  # [F, 3] each
    uv = np.where(vt[..., None] >= 0, uvs[vt], 0) if (vt >= 0).any() else None
    numbering = {"corners": v, "vertices": len(positions), "face_of": face_of, "faces": len(sizes),
                 "labels": labels}
    if not (vn >= 0).any():
        return {"positions": positions, "uv": uv, "faces": v, "numbering": numbering}
    # One vertex for each pair (v, vn); Mesh welds the positions again.
    pairs, faces = np.unique(v * (len(normals) + 1) + vn + 1, return_inverse=True)
    v, vn = np.divmod(pairs, len(normals) + 1)
    normals = np.where(vn[:, None] > 0, normals[vn - 1], 0)
    return {"positions": positions[v], "normals": normals, "uv": uv, "faces": faces.reshape(-1, 3),
            "numbering": numbering}


def _joined(text):
    """Return the text with lines that end in a backslash joined to the next."""
    if b"\\" not in text:
        return text
    return text.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").replace(b"\\\r", b" ")


def _parse(rows):
    """Return the tables v [V, 3], vt [T, 2], vn [N, 3], sizes of faces [P], (v, vt, vn) by corner [C, 3], and the
    `Numbering.labels` of the faces."""
    named = {kind: [(0, ())] for kind in ("g", "o", "usemtl")}   # [(from which face on, names)]
    tables = {kind: [] for kind in WIDTHS}   # flat lists of floats
    known, distinct, corners, sizes = {}, [], [], []   # a corner as written -> its number in `distinct`; numbers
    for number, row in enumerate(rows, 1):
        line = row.decode("latin-1")   # numbers of str are read faster
        words = (COMMENT.split(line, maxsplit=1)[0] if "#" in line else line).split()
        kind = words[0] if words else ""
        if kind in tables:
            tables[kind] += _numbers(words, WIDTHS[kind], number)
        elif kind in FACES:
            if words[-1][-1:] == "/" and len({word.count("/") for word in words[1:]}) > 1:
                raise _no_corner(words[-1], number)   # others have as many slashes: the file was cut short there
            for word in words[1:]:
                at = known.get(word)
                if at is None:
                    at = len(distinct)
                    distinct.append(_corner(word, tables, number))
                    if "-" not in word and word[-1:] != "/":  # relative ones mean another point on another line
                        known[word] = at
                corners.append(at)
            sizes.append(len(words) - 1)
        elif kind in named:
            named[kind].append((len(sizes), _names(kind, words[1:])))
        elif kind in SURFACES:
            raise Error(f"line {number}: {kind!r} is not read; allowed: polygons in the same file (f)")
    found = [np.array(tables[kind], np.float64).reshape(-1, width) for kind, width in WIDTHS.items()]
    corners = np.array(distinct, np.int64).reshape(-1, 3)[np.array(corners, np.int64)]
    return found, np.array(sizes, np.int64), corners, tuple(_labels(each, len(sizes)) for each in named.values())


def _names(kind, words):
    """Return the names of a line: several groups, or one object or material."""
    words = [word.encode("latin-1").decode("utf-8", "replace") for word in words]
    return tuple(words) if kind == "g" else (" ".join(words),) * bool(words)


def _labels(named, faces):
    """Return tuples of names, each once, and which of them are each face's, int64 [faces]; of [(first face, names)]."""
    begin = np.array([first for first, _ in named])
    distinct = {names: number for number, names in enumerate(dict.fromkeys(names for _, names in named))}
    numbers = np.array([distinct[names] for _, names in named])
    return tuple(distinct), np.repeat(numbers, np.diff(np.append(begin, faces)))


def _numbers(words, width, number):
    """Return the first `width` numbers after a line's first word; vt may have one alone."""
    try:
        values = [float(word) for word in words[1 : width + 1]]
    except ValueError:
        values = [_number(word) for word in words[1 : width + 1]]
    if len(values) == 1 and width == 2:
        values.append(0.0)
    if len(values) < width or None in values:
        raise Error(f"line {number}: {' '.join(words)[:60]!r} is no {words[0]} of {width} numbers")
    return values


def _number(word):
    """Return a word as a float, or None."""
    try:
        return float(word)
    except ValueError:
        return np.nan if NOT_A_NUMBER.match(word) else None


def _no_corner(word, number):
    return Error(f"line {number}: {word[:40]!r} is no corner of a face")


def _corner(word, tables, number):
    """Return the 0-based (v, vt, vn) of a corner such as 3, 3/1, 3//2 or -1/-1/-1; -1 where there is none.

    Of vt and vn nothing and 0 mean none.
    """
    parts = word.split("/")
    try:
        indices = [int(part) if part else 0 for part in parts]
    except ValueError:
        indices = [0]
    if not indices[0] or len(parts) > 3 or max(map(abs, indices)) > 2**40:
        raise _no_corner(word, number)
    found = [-1, -1, -1]
    for k, (index, table) in enumerate(zip(indices, tables.values())):
        if index:
            found[k] = index - 1 if index > 0 else len(table) // (2 if k == 1 else 3) + index
            if found[k] < 0:
                raise Error(f"line {number}: {word[:40]!r} counts back to before the first of its kind")
    return found
