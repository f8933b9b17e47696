"""Files .npz and .npy: NumPy's own arrays; of strands, of the names and shapes that `Curves` has."""

import io
import zipfile
import zlib
from collections.abc import Collection
from pathlib import Path

import numpy as np

from ..errors import Error
from .input import MAX_BYTES, read

MOST = 1040   # bytes that zip packs in one, at most
NAMES = "points", "counts", "width", "color", "transparency", "root_uv", "root_normal"
SETUP = "inner", "outer", "surface", "seed", "lod_by", "bounds"   # how the body under them is tessellated, and such


def load_numbers(path: Path) -> np.ndarray:
    """Return the array of numbers of a .npy file; raises Error, one line that names the file."""
    try:
        data = read(path)
        return _array(io.BytesIO(data), len(data))
    except Error as error:
        raise Error(f"{'' if str(path) in str(error) else f'{path}: '}{error}") from None


def read_npy(data: bytes, path: Path) -> dict:
    """Return the strands of a .npy file: points [strands, points, 3]."""
    points = _array(io.BytesIO(data), len(data))
    if points.ndim != 3 or points.shape[2] != 3:
        raise Error(f"has an array of shape {list(points.shape)}; allowed: [strands, points, 3]")
    return {"points": points}


def read_npz(data: bytes, path: Path) -> dict:
    """Return the strands of a .npz file: points and counts, or points [strands, points, 3]; and what else of `NAMES` it
    has.  Other names are an Error."""
    found = read_arrays(data, NAMES + SETUP, setup=SETUP)
    if "points" not in found:
        raise Error("has no array points")
    setup = {name: found.pop(name) for name in SETUP if name in found}
    return found | {"setup": {name: value.item() if value.ndim == 0 else value for name, value in setup.items()}}


def read_arrays(data: bytes, names: Collection[str] | None = None,
                setup: Collection[str] = ()) -> dict[str, np.ndarray]:
    """Return the arrays of a .npz file, all or of these names alone; raises Error for others, and a damaged file. Those
    of ``setup`` may be text."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = {each.filename.removesuffix(".npy"): each for each in archive.infolist()}
            if names is not None and (unknown := [name for name in members if name not in names]):
                known = [name for name in names if name not in setup]
                raise Error(f"has the array {unknown[0][:40]!r}; allowed: {', '.join(known)}")
            most = MAX_BYTES if names else MOST * len(data)
            if sum(each.file_size for each in members.values()) > most:
                raise Error(f"would take more than {most} bytes")
            found = {}
            for name, each in members.items():
                with archive.open(each) as stream:
                    found[name] = _array(stream, each.file_size, "biuf" + "U" * (name in setup))
            return found
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise Error(f"is damaged or cut short: {error}") from None


def _array(file, total, kinds="biuf"):
    """Return the array of a .npy file of so many bytes, of a dtype of these kinds; raises Error where they are fewer
    than it states, before any are read."""
    try:
        header = np.lib.format.read_array_header_1_0 if np.lib.format.read_magic(file) == (1, 0) else \
            np.lib.format.read_array_header_2_0
        shape, by_columns, kind = header(file)
    except ValueError:
        raise Error("is damaged or cut short: it has no header of NumPy's") from None
    if kind.hasobject or kind.kind not in kinds:
        raise Error(f"has {'Python objects' if kind.hasobject else f'values of dtype {kind}'}; allowed: numbers")
    size, there = kind.itemsize, total - file.tell()
    for count in shape:
        size *= count
    if size != there or min(shape, default=0) < 0:
        raise Error(f"is damaged or cut short: its array takes {size} bytes, but it has {there}")
    return np.frombuffer(file.read(), kind).reshape(shape, order="F" if by_columns else "C")


def write_npz(strands: dict) -> bytes:
    """Return the bytes of a .npz file of strands, as `curves.stored` gives them; places in float64."""
    file = io.BytesIO()
    np.savez_compressed(file, **{name: strands[name] for name in NAMES if name in strands}, **strands.get("setup", {}))
    return file.getvalue()


def write_npy(strands: dict) -> bytes:
    """Return the bytes of a .npy file of strands that all have as many points; without width and colour."""
    counts = strands["counts"]
    if len(set(counts.tolist())) > 1:
        raise Error(f"strands have {counts.min()} to {counts.max()} points; allowed in .npy: as many each")
    file = io.BytesIO()
    np.save(file, strands["points"].reshape(len(counts), int(counts[0]) if len(counts) else 0, 3))
    return file.getvalue()
