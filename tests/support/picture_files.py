"""Files of pictures, byte by byte: what no library that the tests have writes."""

import struct
import zlib

import numpy as np


def png(pixels, bits=16):
    """The bytes of a PNG file of pixels [h, w, 1 to 4]: grey, grey and alpha, RGB or RGBA; rows filtered in turn."""
    height, width, channels = pixels.shape
    rows = pixels.astype(">u2" if bits == 16 else np.uint8).view(np.uint8).reshape(height, -1).astype(int)
    step, coded = channels * bits // 8, b""
    for y, row in enumerate(rows):
        left, above = np.pad(row, (step, 0))[:-step], rows[y - 1] if y else 0 * row
        expected = [0 * row, left, above, (left + above) // 2][y % 4]
        coded += bytes([y % 4]) + ((row - expected) % 256).astype(np.uint8).tobytes()
    kind = {1: 0, 2: 4, 3: 2, 4: 6}[channels]
    return b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", struct.pack(">2I5B", width, height, bits, kind, 0, 0, 0)) + _chunk(
        b"IDAT", zlib.compress(coded)) + _chunk(b"IEND", b"")


def empty_png(width, height):
    """The bytes of a PNG file that states a size and has no pixels."""
    return b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0)) + _chunk(
        b"IDAT", zlib.compress(b"\0" * 100)) + _chunk(b"IEND", b"")


def _chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def tiff(pixels, order="<", packed=False, photometric=None, extra=2, planes=False):
    """The bytes of a TIFF file of pixels [h, w, 1 to 4] of any dtype, in this byte order, packed by zlib or not.

    photometric: 0 where white is 0. extra: what a fourth channel is, 2 for alpha. planes: one channel after the other,
    in a strip each.
    """
    height, width, channels = pixels.shape
    parts = np.moveaxis(pixels, 2, 0) if planes else pixels[None]
    strips = [part.astype(pixels.dtype.newbyteorder(order)).tobytes() for part in parts]
    strips = [zlib.compress(strip) for strip in strips] if packed else strips
    photometric = (2 if channels >= 3 else 1) if photometric is None else photometric
    entries = [(256, 3, [width]), (257, 3, [height]), (258, 3, [8 * pixels.itemsize] * channels),
               (259, 3, [8 if packed else 1]), (262, 3, [photometric]), (273, 4, [0] * len(strips)),
               (277, 3, [channels]), (278, 3, [height]), (279, 4, [len(strip) for strip in strips]), (284, 3, [1 + planes])]
    entries += [(338, 3, [extra])] if channels in (2, 4) else []
    entries += [(339, 3, [{"u": 1, "i": 2, "f": 3}[pixels.dtype.kind]] * channels)]
    behind = 8 + 2 + 12 * len(entries) + 4
    sizes = [{3: "H", 4: "I"}[kind] * len(values) for _, kind, values in entries]
    wide = sum(struct.calcsize(order + each) for each in sizes if struct.calcsize(order + each) > 4)
    entries[5] = 273, 4, [behind + wide + sum(map(len, strips[:k])) for k in range(len(strips))]
    body, far = b"", b""   # entries, and values that do not fit them
    for (tag, kind, values), size in zip(entries, sizes, strict=True):
        value = struct.pack(order + size, *values)
        if len(value) > 4:
            value, far = struct.pack(order + "I", behind + len(far)), far + value
        body += struct.pack(order + "2HI", tag, kind, len(values)) + value.ljust(4, b"\0")
    head = {"<": b"II", ">": b"MM"}[order] + struct.pack(order + "HI", 42, 8) + struct.pack(order + "H", len(entries))
    return head + body + b"\0" * 4 + far + b"".join(strips)
