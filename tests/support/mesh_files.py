"""Files of meshes, byte by byte: what exporters write, and no library that the tests have."""

import struct

CODES = {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d",
         "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "float32": "f",
         "float64": "d", "int64": "q", "uint64": "Q"}


def ply(*elements, form="ascii", end="\n", comments=()):
    """The bytes of a PLY file.

    elements: (name, [properties as in the header, such as "list uchar int vertex_indices"], rows); a row holds a
    number for each property, a sequence for a list. form: ascii, binary_little_endian or binary_big_endian.
    """
    header = ["ply", f"format {form} 1.0", *comments]
    for name, properties, rows in elements:
        header += [f"element {name} {len(rows)}", *(f"property {each}" for each in properties)]
    body = b"".join(row_of(properties, row, form, end) for _, properties, rows in elements for row in rows)
    return end.join([*header, "end_header", ""]).encode() + body


def row_of(properties, row, form, end="\n"):
    order, words, data = "<" if "little" in form else ">", [], b""
    for stated, value in zip(properties, row, strict=True):
        kinds = stated.split()
        values = list(value) if kinds[0] == "list" else [value]
        if kinds[0] == "list":
            words.append(len(values))
        words += values
        if form != "ascii":
            data += struct.pack(order + CODES[kinds[1]], len(values)) if kinds[0] == "list" else b""
            data += struct.pack(order + CODES[kinds[-2]] * len(values), *values)
    return (" ".join(map(str, words)) + end).encode() if form == "ascii" else data


def obj(positions, faces):
    """The text of an OBJ file of positions [V][3] and faces, lists of 0-based indices."""
    return "".join("v {} {} {}\n".format(*map(float, point)) for point in positions) + "".join(
        "f " + " ".join(str(int(k) + 1) for k in face) + "\n" for face in faces)


def off(positions, faces):
    """The text of an OFF file of the same."""
    return f"OFF\n{len(positions)} {len(faces)} 0\n" + "".join(
        "{} {} {}\n".format(*map(float, point)) for point in positions) + "".join(
        " ".join(map(str, [len(face), *face])) + "\n" for face in faces)


def ply_of(positions, faces, form="ascii"):
    """The bytes of a PLY file of the same."""
    return ply(("vertex", ["double x", "double y", "double z"], [list(map(float, point)) for point in positions]),
               ("face", ["list uint int vertex_indices"], [[face] for face in faces]), form=form)


def binary_stl(corners, header=b"solid but binary", behind=b""):
    records = [struct.pack("<12fH", 0, 0, 0, *face.ravel(), 0) for face in corners]
    return header.ljust(80) + struct.pack("<I", len(records)) + b"".join(records) + behind
