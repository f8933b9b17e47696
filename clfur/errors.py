"""The errors of the library, and how objects are shown in short: in errors, and by themselves."""

import dataclasses
import reprlib
from collections.abc import Callable
from typing import Any

import attrs
import numpy as np


class _Short(reprlib.Repr):
    """Looks at the beginning alone of what is huge."""

    def repr1(self, x, level):
        return super().repr1(x.item() if isinstance(x, np.generic) else x, level)   # 0.5, not np.float64(0.5)

    def repr_instance(self, x, level):
        return repr(x)   # reprlib's own would hide what this raises


_SHORT = _Short()
_SHORT.maxlist = _SHORT.maxtuple = _SHORT.maxset = _SHORT.maxdict = 40
_SHORT.maxstring = _SHORT.maxother = 400


class Error(ValueError):
    """Something that the user gave cannot be used; the message is one clear line.

    It names what was wrong and where (such as `HairType.segments`), the value, and what is allowed.
    """


class DeviceError(Error):
    """A device or its driver failed: a kernel does not build, memory is out, the device is lost.

    The message names the device, what it was doing, and the kernel's file and line where the driver tells them.
    """


class Stopped(Exception):
    """What was drawn is given up, as the ``stop`` of its caller wanted; whatever drew it is as good as before."""


def go_on(stop: Callable[[], bool] | None) -> bool:
    """True, unless ``stop`` says True by now: then `Stopped` is raised."""
    if stop is not None and stop():
        raise Stopped("it was stopped, as its caller wanted")
    return True


def shown(value: Any, most: int = 80) -> str:
    """Return `value` as a short text on one line, of ``most`` characters; also where it fails to say what it is."""
    try:
        if isinstance(value, np.ndarray) and value.ndim and value.size > 4:
            text = f"an array of {value.dtype} {list(value.shape)}"
        else:
            text = " ".join((repr if isinstance(value, str) else _SHORT.repr)(value).split())
    except Exception:   # repr is the object's own, and Python's refuses numbers of thousands of digits
        text = (f"a whole number of {value.bit_length()} bits" if issubclass(type(value), int)
                else f"an object of class {type(value).__name__}")
    return text if len(text) <= most else text[:most - 3] + "..."


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
