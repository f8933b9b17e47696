"""Radiance pictures (.hdr): bytes -> linear colours. Pillow does not read them."""

import re

import numpy as np

from ..errors import Error

MAGIC = b"#?"                                      # RADIANCE, RGBE
HEAD = 1 << 16                                     # bytes in which a header must end
SIZE = re.compile(rb"-Y (\d{1,9}) \+X (\d{1,9})")   # rows from the top, each from the left: all that programs write


def decoded(data: bytes, most: int) -> np.ndarray:
    """Return the pixels of a file's bytes: float32 [h, w, 3], linear, the top row first.

    By Ward's own description of the format ("Real Pixels", 1991): a mantissa of 8 bits a colour and one exponent, in
    runs or as they are. EXPOSURE is taken out again. Raises Error for other bytes, other layouts, XYZ, and more than
    ``most`` pixels.
    """
    end = data.find(b"\n\n", 0, HEAD)
    line_end = data.find(b"\n", end + 2, HEAD)
    if min(end, line_end) < 0:
        raise Error("is cut off in its header")
    size = SIZE.fullmatch(data[end + 2:line_end].strip())
    if not size:
        raise Error(f"has its rows as {data[end + 2:line_end][:40]!r}; allowed: -Y height +X width")
    height, width = int(size[1]), int(size[2])
    if not 0 < height * width <= most:
        raise Error(f"has {width} x {height} pixels; allowed: at least 1 and at most {most}")
    values = _values(data[:end])
    if values.get(b"FORMAT", b"32-bit_rle_rgbe") != b"32-bit_rle_rgbe":
        raise Error(f"has FORMAT={values[b'FORMAT'][:40].decode('ascii', 'replace')}; allowed: 32-bit_rle_rgbe")
    rgbe = _rows(memoryview(data)[line_end + 1:], height, width)
    power = rgbe[:, :, 3].astype(np.int32)
    with np.errstate(over="ignore"):   # told below
        scale = np.ldexp(np.float32(1 / values[b"EXPOSURE"]), power - 136)
        scale[power == 0] = 0
        pixels = rgbe[:, :, :3] * scale[:, :, None]
    if not np.isfinite(pixels).all():
        raise Error("has an EXPOSURE by which its light is more than float32 holds")
    return pixels


def _values(header):
    """What a header says: {name: bytes}, and EXPOSURE as a number."""
    values, exposure = {}, 1.0
    for line in header.split(b"\n"):
        name, _, value = line.partition(b"=")
        values[name.strip()] = value.strip()
        if name.strip() == b"EXPOSURE":            # each program that changed it has added one
            try:
                exposure *= float(value)
            except ValueError:
                exposure = 0.0
    if not 1e-20 < exposure < 1e20:
        raise Error("has an EXPOSURE that is no number above 0")
    return values | {b"EXPOSURE": exposure}


def _rows(data, height, width):
    """Return all pixels as uint8 [h, w, 4]."""
    if not (8 <= width < 32768 and bytes(data[:2]) == b"\2\2"):
        if len(data) < 4 * height * width:
            raise Error("is cut off, or in runs of the oldest kind, which nothing writes any more")
        return np.frombuffer(data, np.uint8, 4 * height * width).reshape(height, width, 4)
    rows, at = [], 0
    for _ in range(height):
        if bytes(data[at:at + 4]) != bytes((2, 2, width >> 8, width & 255)):
            raise Error("is cut off or damaged")
        row, at = _row(data, at + 4, width)
        rows.append(np.frombuffer(row, np.uint8).reshape(4, width).T)
    return np.stack(rows)


def _row(data, at, width):
    """(bytes of one row, one colour after the other, where the next row begins)."""
    row, n = bytearray(), len(data)
    for channel in range(1, 5):
        while len(row) < channel * width:
            count = data[at] if at < n else 0
            if count > 128:
                piece = bytes(data[at + 1:at + 2]) * (count - 128)
                at += 2
            else:
                piece = bytes(data[at + 1:at + 1 + count])
                at += 1 + count
            if not piece or at > n:
                raise Error("is cut off or damaged")
            row += piece
        if len(row) != channel * width:
            raise Error("is damaged: a run goes past the end of its row")
    return row, at
