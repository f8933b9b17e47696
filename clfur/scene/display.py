"""How objects show themselves: those that hold arrays in a line, scenes and frames as pictures in notebooks."""

import dataclasses
from typing import Any

import attrs
import numpy as np

from ..errors import shown

SHORT = 380       # characters of what `brief` gives
FEW, DEEP = 4, 2  # entries of a list that are shown one by one; objects within each other that are shown by field


def brief(self: Any) -> str:
    """`__repr__` of classes that may hold arrays: the fields that are not as by default, arrays by dtype and shape."""
    text = _object(self, DEEP)
    return text if len(text) <= SHORT else text[:SHORT - 4] + "...)"


def _object(thing, depth):
    told = [f"{name}={_value(value, depth - 1)}" for name, value in _told(thing)]
    return f"{type(thing).__name__}({', '.join(told) if depth > 0 else '...' if told else ''})"


def _told(thing):
    """(name, value) of the fields of an object of attrs or a dataclass that its repr tells."""
    kind = type(thing)
    for field in attrs.fields(kind) if attrs.has(kind) else dataclasses.fields(thing):
        if field.repr and field.init:
            value = getattr(thing, field.name)
            if not _equal(value, field.default):
                yield getattr(field, "alias", field.name), value


def _equal(value, default):
    """Whether a field holds its default, which may have become an array."""
    if isinstance(value, np.ndarray):
        return isinstance(default, (tuple, np.ndarray)) and np.array_equal(value.ravel(), default)
    plain = isinstance(value, (bool, int, float, str, tuple)) and type(value) is type(default)
    return value is default or (plain and value == default)


def _value(value, depth):
    """A field's value in short; depth: how many objects within each other are still shown by field."""
    if isinstance(value, np.ndarray) and not (0 < value.size <= FEW and value.ndim < 2):
        return f"{value.dtype} {list(value.shape)}"
    if hasattr(value, "base_data"):   # an array on a device, which would be read back
        return f"{value.dtype} {list(value.shape)} on a device"
    if isinstance(value, (np.ndarray, np.generic)):
        return _value(value.tolist(), depth)
    if isinstance(value, float):
        return f"{value:.6g}"
    if attrs.has(type(value)) or dataclasses.is_dataclass(type(value)):
        return _object(value, depth)
    if isinstance(value, (list, tuple, dict)):
        return _entries(value, depth)
    return shown(value)


def _entries(value, depth):
    """A list, tuple or dict in short."""
    left, right = "{}" if isinstance(value, dict) else "[]" if isinstance(value, list) else "()"
    if len(value) > FEW:
        return f"{left}{len(value)} entries{right}"
    told = ([f"{key!r}: {_value(each, depth)}" for key, each in value.items()] if isinstance(value, dict) else
            [_value(each, depth) for each in value])
    return f"{left}{', '.join(told)}{',' * (left == '(' and len(value) == 1)}{right}"


def repr_png(self: Any) -> bytes | None:
    """`_repr_png_` of scenes and frames: the bytes of a PNG file, or None."""
    from ..viewer.pictures import png_of  # which sees all that scenes don't: devices, files

    return png_of(self)
