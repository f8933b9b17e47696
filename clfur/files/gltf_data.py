"""The bytes of a glTF file -> arrays: its buffers, views of them, and accessors (glTF 2.0, 3.6)."""

import base64
import os
import re
import sys
import urllib.parse
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import Error
from ..scene import checks
from .input import MAX_BYTES, read

MAX_ZEROS = 2**24    # numbers of an accessor that has no bytes of its own
MAX_NUMBERS = 2**30  # read in all, so that a short file cannot ask for the same accessor on and on

# componentType -> its name in the specification, and what it is in memory (always little-endian).
COMPONENTS = {5120: ("BYTE", "i1"), 5121: ("UNSIGNED_BYTE", "u1"), 5122: ("SHORT", "<i2"),
              5123: ("UNSIGNED_SHORT", "<u2"), 5125: ("UNSIGNED_INT", "<u4"), 5126: ("FLOAT", "<f4")}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
# What is read -> its type and the component types that it may have, those of KHR_mesh_quantization included.
USES = {
    "POSITION": ("VEC3", (5120, 5121, 5122, 5123, 5126)),
    "NORMAL": ("VEC3", (5120, 5122, 5126)),
    "TEXCOORD_0": ("VEC2", (5120, 5121, 5122, 5123, 5126)),
    "JOINTS": ("VEC4", (5121, 5123)),
    "WEIGHTS": ("VEC4", (5121, 5123, 5126)),
    "indices": ("SCALAR", (5121, 5123, 5125)),
    "inverseBindMatrices": ("MAT4", (5126,)),
    "time": ("SCALAR", (5126,)), "translation": ("VEC3", (5126,)), "scale": ("VEC3", (5126,)),
    "rotation": ("VEC4", (5120, 5121, 5122, 5123, 5126)), "weights": ("SCALAR", (5120, 5121, 5122, 5123, 5126)),
    "TRANSLATION": ("VEC3", (5126,)), "ROTATION": ("VEC4", (5120, 5122, 5126)), "SCALE": ("VEC3", (5126,)),
}
WHOLE = ("JOINTS", "indices")                            # numbers of things: never normalized
PACKED = ("indices", "inverseBindMatrices", "sparse", "time", "translation", "rotation", "scale",
          "weights")                                     # no attributes: never with a byteStride


def whole(holder: dict, name: str, where: str, default: int | None = None) -> int:
    """Return holder[name], a whole number from 0; Error "`where`.`name` is ..." for anything else.

    JSON does not tell 4.0 from 4, so both are taken.
    """
    value: Any = holder.get(name, default)
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        checks.refuse(_named(where, name), value, "a whole number from 0")
    return value


def child(holder: dict, name: str, kind: type, where: str) -> Any:
    """Return holder[name], a dict or a list (`kind`); an empty one where there is none."""
    value = holder.get(name, kind())
    if not isinstance(value, kind):
        checks.refuse(_named(where, name), value, "an object" if kind is dict else "a list")
    return value


def _named(where, name):
    return f"{where}.{name}" if where else name   # what stands at the top has no name before it


def vector(holder: dict, name: str, length: int, where: str, default: Any = None) -> np.ndarray:
    """Return holder[name], a list of so many numbers, as float64."""
    value = holder.get(name, default)
    good = isinstance(value, (list, tuple)) and len(value) == length and all(
        isinstance(each, (int, float)) and not isinstance(each, bool) and abs(each) <= sys.float_info.max
        for each in value)
    if not good:
        checks.refuse(_named(where, name), value, f"{length} finite numbers")
    return np.array(value, np.float64)


class Source:
    """The JSON of a glTF file, and the bytes that it names; nothing is read before it is asked for.

    tree: what the JSON holds. path: of the file, for buffers beside it. binary: the GLB's chunk, or None.
    """

    def __init__(self, tree: dict, path: Path, binary: memoryview | None = None) -> None:
        self.tree, self.folder, self.binary = tree, path.parent, binary
        self._buffers: dict[int, Any] = {}
        self._bytes_left, self._numbers_left = MAX_BYTES, MAX_NUMBERS   # of files of buffers, together; of all arrays

    def items(self, kind: str) -> list:
        """Return the list `kind` ("nodes", ...) of the file, of objects; empty where there is none."""
        items = child(self.tree, kind, list, "")
        for number, item in enumerate(items):
            if not isinstance(item, dict):
                checks.refuse(f"{kind}[{number}]", item, "an object")
        return items

    def item(self, kind: str, holder: dict, name: str, where: str) -> tuple[int, dict]:
        """Return (k, the k-th of the list `kind`) where k is holder[name]."""
        number, items = whole(holder, name, where), child(self.tree, kind, list, "")
        if number >= len(items):
            raise Error(f"{_named(where, name)} is {number}; allowed: less than {len(items)}, the number of {kind}")
        if not isinstance(items[number], dict):
            checks.refuse(f"{kind}[{number}]", items[number], "an object")
        return number, items[number]

    def count(self, holder: dict, name: str, where: str, use: str | None = None) -> int:
        """Return how many elements the accessor holder[name] has; it fits into its bytes, and takes no memory yet."""
        return len(self._base(*self._accessor(holder, name, where, use or name)))

    def values(self, holder: dict, name: str, where: str, use: str | None = None) -> np.ndarray:
        """Return what the accessor holder[name] holds, [count, numbers of an element].

        use: its row in USES; None for `name`. float64, normalized integers as -1..1 or 0..1 (3.6.2.2);
        for rows in WHOLE the unsigned integers themselves, of their own size.
        """
        found = self._accessor(holder, name, where, use or name)
        accessor, where, use = found
        raw = self._base(*found)
        self._numbers_left -= raw.size
        if self._numbers_left < 0:
            raise Error(f"{where} brings the numbers that are read to more than {MAX_NUMBERS}; allowed: at most that")
        if "sparse" in accessor:
            raw = self._filled(raw, accessor, f"{where}.sparse")
        if use in WHOLE:
            return raw
        numbers = raw.astype(np.float64)
        return np.maximum(numbers / np.iinfo(raw.dtype).max, -1) if accessor.get("normalized") else numbers

    def _accessor(self, holder: dict, name: str, where: str, use: str) -> tuple[dict, str, str]:
        """Return (the accessor holder[name], its name, use), of a type that may be used so."""
        number, accessor = self.item("accessors", holder, name, where)
        where = f"accessors[{number}]"
        kind, allowed = USES[use]
        component = accessor.get("componentType")
        if accessor.get("type") != kind or component not in allowed:
            names = " or ".join(f"{each} ({COMPONENTS[each][0]})" for each in allowed)
            given = f"{checks.shown(accessor.get('type'))} of componentType {checks.shown(component)}"
            raise Error(f"{where}, read as {use}, is {given}; allowed: {kind!r} of {names}")
        normalized = accessor.get("normalized", False)
        if normalized is not False and (normalized is not True or use in WHOLE or component in (5125, 5126)):
            checks.refuse(f"{where}.normalized", normalized, f"false, for {use} of {COMPONENTS[component][0]}")
        return accessor, where, use

    def _base(self, accessor: dict, where: str, use: str) -> np.ndarray:
        """Return an accessor's components as its bufferView stores them, or zeros: [count, width], no copy."""
        count, width = whole(accessor, "count", where), WIDTHS[USES[use][0]]
        dtype = np.dtype(COMPONENTS[accessor["componentType"]][1])
        if "bufferView" in accessor:
            return self._view(accessor, where, count, dtype, width, use)
        if count * width > MAX_ZEROS:
            raise Error(f"{where}.count is {count} without a bufferView; allowed there: at most {MAX_ZEROS // width}")
        return np.broadcast_to(np.zeros((), dtype), (count, width))

    def _filled(self, base: np.ndarray, accessor: dict, where: str) -> np.ndarray:
        """Return a copy of base [count, width] with a sparse accessor's values put in."""
        sparse = child(accessor, "sparse", dict, where.removesuffix(".sparse"))
        places, values = (child(sparse, name, dict, where) for name in ("indices", "values"))
        count = whole(sparse, "count", where)
        if count > len(base):
            raise Error(f"{where}.count is {count}; allowed: at most {len(base)}, the accessor's")
        component = places.get("componentType")
        if component not in USES["indices"][1]:
            checks.refuse(f"{where}.indices.componentType", component, "5121, 5123 or 5125")
        at = self._view(places, f"{where}.indices", count, np.dtype(COMPONENTS[component][1]), 1, "sparse")
        at = at[:, 0].astype(np.int64)
        if count and (at[-1] >= len(base) or (np.diff(at) <= 0).any()):
            raise Error(f"{where}.indices do not rise from 0 to at most {len(base) - 1}")
        full = base.copy()
        full[at] = self._view(values, f"{where}.values", count, base.dtype, base.shape[1], "sparse")
        return full

    def _view(self, holder: dict, where: str, count: int, dtype: np.dtype, width: int, use: str) -> np.ndarray:
        """Return count elements of the bufferView that holder names, from its byteOffset on; no copy."""
        offset = whole(holder, "byteOffset", where, 0)
        number, view = self.item("bufferViews", holder, "bufferView", where)
        name = f"bufferViews[{number}]"
        start, length = whole(view, "byteOffset", name, 0), whole(view, "byteLength", name)
        size = width * dtype.itemsize
        stride = whole(view, "byteStride", name, size)
        if stride < size or (use in PACKED and stride != size):
            more = " or more" * (use not in PACKED)
            raise Error(f"{name}.byteStride is {stride}; allowed: {size}{more}, as {where} needs")
        needed = offset + (count - 1) * stride + size if count else 0
        if needed > length:
            raise Error(f"is damaged or cut short: {where} needs {needed} bytes but {name} has {length}")
        content = self._buffer(view, name, start + length)
        return np.ndarray((count, width), dtype, content, start + offset if count else 0, (stride, dtype.itemsize))

    def content_of(self, holder: dict, where: str) -> bytes:
        """Return the bytes of a file that is in a bufferView, in a data URI, or beside this one."""
        if "bufferView" in holder:
            number, view = self.item("bufferViews", holder, "bufferView", where)
            name = f"bufferViews[{number}]"
            start, length = whole(view, "byteOffset", name, 0), whole(view, "byteLength", name)
            return bytes(memoryview(self._buffer(view, name, start + length))[start:start + length])
        uri: Any = holder.get("uri")
        if not isinstance(uri, str):
            checks.refuse(f"{where}.uri", uri, "a text")
        return _of_data_uri(uri, where) if uri.startswith("data:") else self._of_file(uri, where)

    def _buffer(self, view: dict, where: str, needed: int) -> Any:
        """Return the bytes of the buffer that a bufferView names, of which it needs so many."""
        number, buffer = self.item("buffers", view, "buffer", where)
        name = f"buffers[{number}]"
        length = whole(buffer, "byteLength", name)
        if needed > length:
            raise Error(f"is damaged or cut short: {where} needs {needed} bytes but {name} has {length}")
        if number not in self._buffers:
            self._buffers[number] = self._content(number, buffer, name, length)
        return self._buffers[number]

    def _content(self, number: int, buffer: dict, name: str, length: int) -> Any:
        """Return at least `length` bytes: of the GLB's chunk, of a data URI, or of a file in the same folder."""
        uri: Any = buffer.get("uri")
        content: Any = self.binary
        compression = [key for key in child(buffer, "extensions", dict, name) if "meshopt" in key.lower()]
        if uri is None and (number or self.binary is None or compression):
            if compression:
                raise Error(f"has {name} only as {compression[0]} holds it; allowed: files without compression")
            raise Error(f"is damaged or cut short: {name} has no data")
        if uri is not None and not isinstance(uri, str):
            checks.refuse(f"{name}.uri", uri, "a text")
        if uri is not None and uri.startswith("data:"):
            content = _of_data_uri(uri, name)
        elif uri is not None:
            content = self._of_file(uri, name)
        if length > len(content):
            raise Error(f"is damaged or cut short: {name} states {length} bytes but has {len(content)}")
        return content

    def _of_file(self, uri: str, name: str) -> bytes:
        """Return the bytes of a regular file in the file's folder or below it, links followed."""
        path = self.folder / urllib.parse.unquote(uri)
        inside = Path(os.path.abspath(path)).is_relative_to(os.path.abspath(self.folder))   # by its name: none is asked
        if re.match(r"\w+:", uri) or not inside or not path.resolve().is_relative_to(self.folder.resolve()):
            raise Error(f"{name} is in {uri[:60]!r}; allowed: files in its own folder")
        if not os.path.exists(path):
            raise Error(f"{name} is in {uri[:60]!r}, which does not exist")
        content = read(path, self._bytes_left)
        self._bytes_left -= len(content)
        return content


def _of_data_uri(uri: str, name: str) -> bytes:
    """Return the bytes of "data:...;base64,..." or "data:...,..." (RFC 2397)."""
    head, comma, text = uri.partition(",")
    if not comma:
        raise Error(f"is damaged or cut short: {name} has a data URI without a comma")
    content = urllib.parse.unquote_to_bytes(text)
    if not head.endswith(";base64"):
        return content
    content = content.translate(None, b" \t\r\n")
    try:
        return base64.b64decode(content + b"=" * (-len(content) % 4), validate=True)   # some leave the = out
    except ValueError as error:
        raise Error(f"is damaged or cut short: {name} is no base64: {error}") from None
