"""OpenEXR files of scan lines, in one part or several, as "OpenEXR File Layout" (openexr.com) has them.

The package OpenEXR writes several parts in one call, in which nobody hears Ctrl-C, and takes the sizes that a damaged
file states at their word.
"""

import struct
import zlib
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np

from ..errors import Error

MAGIC = b"v/1\1"
VERSION, MULTIPLE, LONG_NAMES, OTHER_KINDS = 2, 0x1000, 0x400, 0xA00   # of a file; bits: deep data, tiles
EFFORT = 1            # of zlib's compression
ROWS = {0: 1, 2: 1, 3: 16}   # that are packed together, by the compressions that are read: none, ZIPS, ZIP
ZIP = 3
PIXELS = {0: np.dtype("<u4"), 1: np.dtype("<f2"), 2: np.dtype("<f4")}
MAX_VALUES = 2**30    # of all channels
PACKED = 1040         # bytes that zlib packs in one, and some
MAX_CHANNELS = 4096
SHORT = 31            # letters of a name that old readers know


@dataclass
class Part:
    """A part of a file: its name, {channel: array [h, w] of uint32, float16 or float32}, {attribute: its value}.

    Values: str, float32 [4, 4], and of what is read also bytes, for types of which nothing is known here.
    """

    name: str
    channels: dict[str, np.ndarray]
    header: dict[str, Any]


# --- writing ------------------------------------------------------------------------------------------------------


def write(path: Any, parts: list[Part]) -> None:
    """Write parts of one size to a file."""
    with open(path, "wb") as file:
        write_to(file, parts)


def write_to(file: BinaryIO, parts: list[Part]) -> None:
    """Write parts of one size to an open file that can be sought in, some rows of each at a time."""
    height, width = next(iter(parts[0].channels.values())).shape
    names = [name for part in parts for name in (part.name, *part.channels, *part.header)]
    several, chunks = len(parts) > 1, -(-height // ROWS[ZIP])
    flags = VERSION | MULTIPLE * several | LONG_NAMES * (max(len(name.encode()) for name in names) > SHORT)
    headers = [_header(part, width, height, chunks, several) for part in parts]
    places = np.zeros((len(parts), chunks), "<u8")
    file.write(MAGIC + struct.pack("<i", flags) + b"".join(headers) + b"\0" * several)
    table = file.tell()
    file.write(places.tobytes())
    for k in range(chunks):
        for number, part in enumerate(parts):
            top = k * ROWS[ZIP]
            packed = _packed(part.channels, top)
            places[number, k] = file.tell()
            file.write(struct.pack("<i", number) * several + struct.pack("<ii", top, len(packed)) + packed)
    file.seek(table)
    file.write(places.tobytes())


def _header(part, width, height, chunks, several):
    """The bytes of a part's header."""
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    kinds = {dtype: kind for kind, dtype in PIXELS.items()}
    channels = b"".join(name.encode() + b"\0" + struct.pack("<iiii", kinds[part.channels[name].dtype], 0, 1, 1)
                        for name in sorted(part.channels))
    known = [("channels", "chlist", channels + b"\0"), ("compression", "compression", bytes([ZIP])),
             ("dataWindow", "box2i", window), ("displayWindow", "box2i", window), ("lineOrder", "lineOrder", b"\0"),
             ("pixelAspectRatio", "float", struct.pack("<f", 1)), ("screenWindowCenter", "v2f", bytes(8)),
             ("screenWindowWidth", "float", struct.pack("<f", 1))]
    known += [("name", "string", part.name.encode())] * bool(part.name)
    if several:
        known += [("type", "string", b"scanlineimage"), ("chunkCount", "int", struct.pack("<i", chunks))]
    for name, value in part.header.items():
        text = isinstance(value, str)
        known.append((name, "string" if text else "m44f", value.encode() if text else np.float32(value).tobytes()))
    return b"".join(name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value
                    for name, kind, value in known) + b"\0"


def _packed(channels, top):
    """Some rows of a part as ZIP has them: bytes of one place in all numbers after those of the other, differences."""
    rows = [channels[name][top:top + ROWS[ZIP]] for name in sorted(channels)]
    plain = np.concatenate([np.ascontiguousarray(each).view(np.uint8) for each in rows], 1).ravel()
    apart = np.concatenate([plain[::2], plain[1::2]])
    apart[1:] -= apart[:-1] - np.uint8(128)   # of what is there before it
    packed = zlib.compress(apart, EFFORT)
    return packed if len(packed) < len(plain) else plain.tobytes()


# --- reading ------------------------------------------------------------------------------------------------------


def read(data: bytes) -> list[Part]:
    """Return the parts of a file's bytes.

    Raises Error, which does not name the file, where they are cut short, damaged, deep, tiled, of a part of the picture
    or otherwise compressed than by none, ZIPS or ZIP.
    """
    if not data.startswith(MAGIC):
        raise Error("is no EXR file")
    try:
        return _parts(data)
    except Error:
        raise
    except (struct.error, ValueError, IndexError, UnicodeDecodeError, KeyError, zlib.error):
        raise Error("is EXR that is cut off or damaged") from None


def _parts(data):
    flags, = struct.unpack_from("<i", data, 4)
    if flags & 0xFF != VERSION or flags & OTHER_KINDS:
        raise Error("is EXR with tiles or deep data, or of another version; allowed: scan lines of version 2")
    several, at, headers = bool(flags & MULTIPLE), 8, []
    while not headers or (several and data[at] != 0):
        header, at = _attributes(data, at)
        headers.append(header)
    at += several
    layouts, tables = [_layout(header) for header in headers], []
    values = sum(width * height * len(channels) for width, height, channels in layouts)
    if values > min(MAX_VALUES, PACKED * len(data)):
        raise Error(f"is EXR that claims {values:,} values in {len(data):,} bytes; allowed: at most {MAX_VALUES:,}, "
                    f"{PACKED} a byte")
    for header, (_, height, _) in zip(headers, layouts):
        chunks = -(-height // ROWS[header["compression"][1][0]])
        tables.append(np.frombuffer(data, "<u8", chunks, at))
        at += 8 * chunks
    return [_part(data, header, layout, table, number if several else None)
            for number, (header, layout, table) in enumerate(zip(headers, layouts, tables))]


def _attributes(data, at):
    """({name: (type, bytes)} of a header that begins at a byte, where it ends)."""
    found = {}
    while data[at] != 0:
        name_end = data.index(0, at)
        kind_end = data.index(0, name_end + 1)
        size, = struct.unpack_from("<i", data, kind_end + 1)
        begin = kind_end + 5
        if not 0 <= size <= len(data) - begin:
            raise ValueError
        found[data[at:name_end].decode()] = data[name_end + 1:kind_end].decode(), data[begin:begin + size]
        at = begin + size
    return found, at + 1


def _layout(header):
    """(width, height, {channel: dtype}) that a header tells."""
    kind = header.get("type", ("", b"scanlineimage"))[1]
    if kind != b"scanlineimage" or header["compression"][1][0] not in ROWS:
        raise Error("is EXR of another kind or compression; allowed: scan lines, and none, ZIPS or ZIP")
    left, top, right, bottom = struct.unpack("<4i", header["dataWindow"][1])
    listed, at, channels = header["channels"][1], 0, {}
    while listed[at] != 0:
        end = listed.index(0, at)
        pixel, _, across, down = struct.unpack_from("<iiii", listed, end + 1)
        if (across, down) != (1, 1) or len(channels) >= MAX_CHANNELS:
            raise Error(f"is EXR with channels that are smaller, or more than {MAX_CHANNELS}; allowed: all of one size")
        channels[listed[at:end].decode()] = PIXELS[pixel]
        at = end + 17
    if header["dataWindow"] != header["displayWindow"] or (left, top) != (0, 0):
        raise Error("is EXR that stores a part of its picture; allowed: all pixels of its display window")
    width, height = right + 1, bottom + 1
    if width < 1 or height < 1 or not channels:
        raise ValueError
    return width, height, channels


def _part(data, header, layout, table, number):
    width, height, channels = layout
    compression = header["compression"][1][0]
    names, row = sorted(channels), width * sum(dtype.itemsize for dtype in channels.values())
    arrays = {name: np.empty((height, width), channels[name]) for name in names}
    for k, place in enumerate(table.tolist()):
        top = k * ROWS[compression]
        rows = min(ROWS[compression], height - top)
        if number is not None:
            if struct.unpack_from("<i", data, place)[0] != number:
                raise ValueError
            place += 4
        y, packed = struct.unpack_from("<ii", data, place)
        if y != top or not 0 <= packed <= len(data) - place - 8:
            raise ValueError
        plain = _plain(data[place + 8:place + 8 + packed], rows * row, compression).reshape(rows, row)
        at = 0
        for name in names:
            end = at + width * channels[name].itemsize
            arrays[name][top:top + rows] = np.ascontiguousarray(plain[:, at:end]).view(channels[name])
            at = end
    return Part(_text(header.get("name", ("", b""))[1]), arrays, {name: _value(*each) for name, each in header.items()})


def _plain(packed, size, compression):
    """The bytes of some rows, so many."""
    if len(packed) < size and compression:
        apart = np.frombuffer(zlib.decompressobj().decompress(packed, size), np.uint8)
        if len(apart) == size:
            apart = np.cumsum(apart.astype(np.uint8) + np.uint8(128), dtype=np.uint8) + np.uint8(128)
            plain, half = np.empty(size, np.uint8), (size + 1) // 2
            plain[::2], plain[1::2] = apart[:half], apart[half:]
            return plain
        raise ValueError
    if len(packed) != size:
        raise ValueError
    return np.frombuffer(packed, np.uint8)


def _value(kind, value):
    if kind == "m44f":
        return np.frombuffer(value, "<f4", 16).reshape(4, 4)
    return _text(value) if kind == "string" else value


def _text(value):
    return value.decode("utf-8", "replace")
