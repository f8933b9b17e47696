"""Files .npz and .npy: NumPy's own arrays; of strands, of the names and shapes that `Curves` has."""

import io
import zipfile
import zlib
from collections.abc import Collection
from pathlib import Path

import numpy as np

from ..errors import Error
from .input import MAX_BYTES

MOST = 1040   # bytes that zip packs in one, at most
NAMES = "points", "counts", "width", "color", "transparency", "root_uv", "root_normal"


def read_npy(data: bytes, path: Path) -> dict:
    """Return the strands of a .npy file: points [strands, points, 3]."""
    points = _array(data)
    if points.ndim != 3 or points.shape[2] != 3:
        raise Error(f"has an array of shape {list(points.shape)}; allowed: [strands, points, 3]")
    return {"points": points}


def read_npz(data: bytes, path: Path) -> dict:
    """Return the strands of a .npz file: points and counts, or points [strands, points, 3]; and what else of `NAMES` it
    has.  Other names are an Error."""
    found = read_arrays(data, NAMES)
    if "points" not in found:
        raise Error("has no array points")
    return found


def read_arrays(data: bytes, names: Collection[str] | None = None) -> dict[str, np.ndarray]:
    """Return the arrays of a .npz file, all or of these names alone; raises Error for others, and a damaged file."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = {each.filename.removesuffix(".npy"): each for each in archive.infolist()}
            if names is not None and (unknown := [name for name in members if name not in names]):
                raise Error(f"has the array {unknown[0][:40]!r}; allowed: {', '.join(names)}")
            if sum(each.file_size for each in members.values()) > (MAX_BYTES if names else MOST * len(data)):
                raise Error(f"would take more than {MAX_BYTES if names else MOST * len(data)} bytes")
            return {name: _array(archive.read(each)) for name, each in members.items()}
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise Error(f"is damaged or cut short: {error}") from None


def _array(data):
    """Return the array of a .npy file's bytes; raises Error where they are fewer than it states."""
    try:
        file = io.BytesIO(data)
        header = np.lib.format.read_array_header_1_0 if np.lib.format.read_magic(file) == (1, 0) else \
            np.lib.format.read_array_header_2_0
        shape, by_columns, kind = header(file)
    except ValueError:
        raise Error("is damaged or cut short: it has no header of NumPy's") from None
    if kind.hasobject or kind.names:
        raise Error("has Python objects; allowed: numbers")
    size = kind.itemsize
    for count in shape:
        size *= count
    if size != len(data) - file.tell():
        raise Error(f"is damaged or cut short: its array takes {size} bytes, but it has {len(data) - file.tell()}")
    return np.frombuffer(data, kind, offset=file.tell()).reshape(shape, order="F" if by_columns else "C")


def write_npz(strands: dict) -> bytes:
    """Return the bytes of a .npz file of strands, as `curves.stored` gives them; places in float64."""
    file = io.BytesIO()
    np.savez_compressed(file, **{name: strands[name] for name in NAMES if name in strands})
    return file.getvalue()


def write_npy(strands: dict) -> bytes:
    """Return the bytes of a .npy file of strands that all have as many points; without width and colour."""
    counts = strands["counts"]
    if len(set(counts.tolist())) > 1:
        raise Error(f"strands have {counts.min()} to {counts.max()} points; allowed in .npy: as many each")
    file = io.BytesIO()
    np.save(file, strands["points"].reshape(len(counts), int(counts[0]) if len(counts) else 0, 3))
    return file.getvalue()
