"""PLY files: ascii and binary, of any properties.

Read here and not by a library: trimesh refuses lists of several lengths in binary files and needs SciPy for edges,
plyfile is under the GPL, and meshio reads neither tristrips nor texcoord.
"""

import array
import re
import struct
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import Error
from .input import plain
from .polygons import by_size, triangulate

TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
         "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
         "float": "f4", "double": "f8", "float32": "f4", "float64": "f8", "int64": "i8", "uint64": "u8"}
STRUCTS = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "i8": "q", "u8": "Q", "f8": "d"}
ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
INDICES = "vertex_indices", "vertex_index"
UV = ("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t")
COLORS = ("red", "green", "blue", "alpha"), ("diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_alpha")
WANTED = {"x", "y", "z", "nx", "ny", "nz", "texcoord", *INDICES, *sum(UV, ()), *sum(COLORS, ())}


class Property(NamedTuple):
    """A property of an element: its name, the type of its values ("f4"), and that of a list's length, else None."""

    name: str
    kind: str
    length: str | None


class Element(NamedTuple):
    """An element of the header: its name, how many rows it has, and its properties."""

    name: str
    rows: int
    properties: list


def ply(data: bytes, path: Path) -> dict:
    """Return the fields of the Mesh in a PLY file: positions, normals, uv and faces; and how they are numbered.

    Read are x, y, z, nx, ny, nz, red, green, blue, alpha and s, t (or u, v; texture_u, texture_v) of vertices,
    vertex_indices and texcoord of
    faces, and vertex_indices of tristrips, in which -1 begins a new strip. All else is passed over.
    """
    tables, stated = _tables(data, WANTED)
    vertex = tables.get("vertex", {})
    if not {"x", "y", "z"} <= vertex.keys():
        raise Error("has no vertices with x, y and z")
    positions = np.stack([vertex[name].astype(np.float64) for name in "xyz"], axis=1)
    kinds = {each.name: each.kind for element in stated if element.name == "vertex" for each in element.properties}
    normals = None
    if {"nx", "ny", "nz"} <= vertex.keys():
        normals = np.stack([vertex[name].astype(kinds[name]) for name in ("nx", "ny", "nz")], axis=1, dtype=np.float64)
    faces, uv, face_of = _faces(tables, positions)
    if not len(faces):
        raise Error("has no faces")
    if uv is None:
        pair = next((pair for pair in UV if set(pair) <= vertex.keys()), None)
        uv = pair and np.stack([vertex[name].astype(np.float64) for name in pair], axis=1)[faces]
    return {"positions": positions, "normals": normals, "uv": uv, "faces": faces,
            "numbering": {"face_of": face_of, "faces": int(face_of.max()) + 1, "colors": _colors(vertex, kinds)}}


def _colors(vertex, kinds):
    """Return the vertices' colours float32 [V, 3 or 4], 0 to 1 without a curve, or None where they have none."""
    for names in COLORS:
        if all(name in vertex and not isinstance(vertex[name], tuple) for name in names[:3]):
            there = [name for name in names if not isinstance(vertex.get(name, ()), tuple)]
            most = [np.iinfo(kinds[name]).max if kinds[name][0] in "iu" else 1 for name in there]
            return np.stack([vertex[name].astype(np.float64) / one for name, one in zip(there, most)], 1,
                            dtype=np.float32, casting="same_kind")
    return None


def rows_of(data: bytes, wanted: set) -> dict:
    """Return {element: {property: values}} of the properties of a PLY file that are wanted.

    Values are an array [rows], a list's (lengths int64 [rows], values [sum of lengths]).
    """
    tables, stated = _tables(data, wanted)
    for element in stated:   # of an ascii file all is float64 so far
        for each in element.properties:
            if each.kind[0] in "iu" and not each.length and each.name in tables[element.name]:
                values = tables[element.name][each.name]
                with np.errstate(invalid="ignore"):
                    whole = values.astype(each.kind)
                if (whole != values).any():
                    raise Error(f"has {each.name} {values[whole != values][0]:g} of {element.name}, which is stated to "
                                f"be a whole number of {each.kind}")
                tables[element.name][each.name] = whole
    return tables


def _tables(data, wanted):
    """Return what `rows_of` does, and the elements as the header states them."""
    data = plain(data)
    order, stated, at = _header(data)
    tables, elements = {}, stated
    if order == "=":
        data, elements, at = _numbers(data[at:]), [_as_doubles(each) for each in stated], 0
    for element in elements:
        tables[element.name], at = _rows(data, at, element, order, wanted)
    if order == "=" and at < len(data):
        raise Error(f"has {(len(data) - at) // 8} numbers more than its header states")
    return tables, stated


# --- the header -----------------------------------------------------------------------------------------------


def _header(data):
    """Return the byte order ("=" for ascii), the elements, and where the rows begin."""
    start = re.match(rb"ply[ \t]*(\r\n|\n|\r)", data)
    found = start and re.compile(rb"[\r\n]end_header[ \t]*" + start[1]).search(data[:2**20])
    if not found:
        raise Error("is damaged or cut short: it has no PLY header")
    order, elements, where = None, [], data[start.end():found.start()].decode("latin-1").split(start[1].decode())
    for line in where:
        words = line.split()
        match words:
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", name, _] if name in ORDERS:
                order = ORDERS[name]
            case ["element", name, count] if count.isdecimal() and name not in [each.name for each in elements]:
                elements.append(Element(name, int(count[:20]), []))
            case ["property", "list", length, kind, name] if elements and {length, kind} <= TYPES.keys():
                elements[-1].properties.append(Property(name, TYPES[kind], TYPES[length]))
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1].properties.append(Property(name, TYPES[kind], None))
            case _:
                raise Error(f"has the header line {line[:60]!r}, which is none of PLY's")
    if order is None:
        raise Error("has no format in its header; allowed: " + ", ".join(ORDERS))
    for element in elements:
        names = [each.name for each in element.properties]
        if len(set(names)) < len(names):
            raise Error(f"has a property of {element.name} twice")
        if any(each.length in ("f4", "f8") for each in element.properties):
            raise Error(f"has lists of {element.name} whose length is no whole number")
    return order, elements, found.end()


def _numbers(text):
    """Return the numbers of an ascii file as the bytes of float64: so it is read as a binary file of these."""
    text = re.sub(rb"\d\.#\w+", b"nan", text) if b"#" in text else text   # 1.#IND, as old C libraries write it
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return memoryview(np.fromstring(text, np.float64, sep=" ")).cast("B") if text.strip() else b""
        except (DeprecationWarning, ValueError):
            raise Error("is damaged or cut short: it has something else than numbers behind its header") from None


def _as_doubles(element):
    return element._replace(properties=[each._replace(kind="f8", length=each.length and "f8")
                                        for each in element.properties])


# --- rows -----------------------------------------------------------------------------------------------------


def _rows(data, at, element, order, wanted):
    """Return what is wanted of an element's rows that begin at a byte, and the byte behind them.

    Values are as `rows_of` says.
    """
    row = sum(_size(each.length or each.kind) for each in element.properties)
    if element.rows * row > len(data) - at:
        raise Error(f"is damaged or cut short: it states {element.rows} {element.name} rows, at least "
                    f"{element.rows * row} bytes, but has {len(data) - at}")
    if not element.rows or not element.properties:
        empty = np.zeros(0)
        return {each.name: (np.zeros(0, np.int64), empty) if each.length else empty for each in element.properties}, at
    _, lengths = _walk(data, at, element._replace(rows=1), order)
    fields = []   # of a row, if all are as the first
    for k, each in enumerate(element.properties):
        fields += [(f"n{k}", order + each.length)] if each.length else []
        fields += [(f"v{k}", order + each.kind, (int(lengths[k][0]),) if each.length else ())]
    row = np.dtype(fields)
    if element.rows * row.itemsize <= len(data) - at:
        table = np.frombuffer(data, row, element.rows, at)
        if all((table[f"n{k}"] == lengths[k]).all() for k in lengths):
            return {each.name: (np.full(element.rows, lengths[k][0]), table[f"v{k}"].ravel()) if each.length
                    else table[f"v{k}"] for k, each in enumerate(element.properties) if each.name in wanted
                    }, at + element.rows * row.itemsize
    return _rows_of_lists(data, at, element, order, wanted)


def _rows_of_lists(data, at, element, order, wanted):
    """Return what `_rows` does, of rows whose lists have several lengths."""
    place, lengths = _walk(data, at, element, order)
    place, end, table = place[:-1], int(place[-1]), {}
    for k, each in enumerate(element.properties):
        size, many = _size(each.kind), lengths.get(k, 1)
        place = place + _size(each.length) if each.length else place
        if each.name in wanted:
            # The value at every byte, of which those that there are get taken.
            anywhere = np.ndarray(len(data) - size + 1, order + each.kind, data, strides=1)
            if each.length:
                first = np.repeat(place - size * (np.cumsum(many) - many), many)
                table[each.name] = many, anywhere[first + size * np.arange(len(first))]
            else:
                table[each.name] = anywhere[place]
        place = place + size * many
    return table, end


def _walk(data, at, element, order):
    """Return where each row begins and the last ends, int64 [rows + 1], and {list property: lengths int64 [rows]}."""
    steps, head = [], 0   # of each list: reads its length, where its values begin, their size, lengths found
    for k, each in enumerate(element.properties):
        if each.length:
            read = struct.Struct(f"{order}{head}x{STRUCTS[each.length]}")
            steps.append((k, read.unpack_from, read.size, _size(each.kind), array.array("q")))
            head = 0
        else:
            head += _size(each.kind)
    starts = array.array("q", [at])
    try:
        for _ in range(element.rows):
            for _, read, before, size, found in steps:
                stated = read(data, at)[0]
                length = int(stated)
                if length < 0 or length != stated:
                    raise Error(f"row {len(starts) - 1} of {element.name} has a list of {stated} values")
                found.append(length)
                at += before + size * length
            at += head
            starts.append(at)
    except (struct.error, ValueError, OverflowError) as error:
        if isinstance(error, Error):
            raise
        at = len(data) + 1
    if at > len(data):
        raise Error(f"is damaged or cut short: it ends within {element.name} row {len(starts) - 1} of {element.rows}")
    return np.array(starts), {k: np.array(found) for k, *_, found in steps}


def _size(kind):
    return int(kind[1])


# --- faces ----------------------------------------------------------------------------------------------------


def _faces(tables, positions):
    """Return the faces int64 [F, 3] of the elements face and tristrips, uv [F, 3, 2] of texcoord or None, and the
    number of the face that each is of, int64 [F]; triangles of strips go on counting."""
    sizes, corners = _indices(tables, "face", positions)
    triangles, face_of = by_size(*triangulate(positions, corners, sizes), sizes)
    uv, faces = None, corners[triangles]
    lengths, values = tables.get("face", {}).get("texcoord", (np.zeros(len(sizes), np.int64), None))
    if (bad := (lengths != 0) & (lengths != 2 * sizes)).any():
        worst = int(bad.argmax())
        raise Error(f"face {worst} has {lengths[worst]} values of texcoord for {sizes[worst]} corners; "
                    "allowed: two for each corner, or none")
    if lengths.any():
        by_corner = np.zeros((len(corners), 2))   # where a face has none
        by_corner[np.repeat(lengths > 0, sizes)] = values.reshape(-1, 2)
        uv = by_corner[triangles]
    strips = _strips(*_indices(tables, "tristrips", positions, restart=True))
    if uv is not None:
        uv = np.concatenate([uv, np.zeros((len(strips), 3, 2))])
    return np.concatenate([faces, strips]), uv, np.concatenate([face_of, len(sizes) + np.arange(len(strips))])


def _indices(tables, name, positions, restart=False):
    """Return the lists of vertices of an element: (lengths int64 [rows], indices int64 [sum of lengths])."""
    table = tables.get(name, {})
    lengths, values = next((table[each] for each in INDICES if each in table), (None, None))
    if lengths is None or not isinstance(lengths, np.ndarray):
        if name in tables:
            raise Error(f"has {name} rows without a list vertex_indices")
        lengths, values = np.zeros((2, 0), np.int64)
    if restart and values.dtype.kind == "u":   # -1 as it stands in unsigned numbers
        values = np.where(values == np.iinfo(values.dtype).max, -1, values.astype(np.int64))
    with np.errstate(invalid="ignore"):
        indices = values.astype(np.int64)
    wrong = (indices != values) | (indices < (-1 if restart else 0)) | (indices >= len(positions))
    if wrong.any():
        raise Error(f"a face has the index {values[wrong.argmax()]:.15g}; allowed: 0 to {len(positions) - 1}")
    return lengths, indices


def _strips(lengths, indices):
    """Return the triangles [F, 3] of strips: every other one is turned, and -1 begins a new one."""
    ends = np.cumsum(lengths)
    strip = np.insert(indices, ends, -1)
    at = np.arange(len(strip))
    begin = np.maximum.accumulate(np.where(strip < 0, at + 1, 0)) if len(strip) else at   # of the strip that each is in
    triangles = np.stack([strip[:-2], strip[1:-1], strip[2:]], axis=1) if len(strip) > 2 else np.zeros((0, 3), np.int64)
    odd = (at - begin)[:len(triangles)] % 2 == 1
    triangles[odd] = triangles[odd][:, [1, 0, 2]]
    return triangles[(triangles >= 0).all(axis=1)]
