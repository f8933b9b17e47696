"""Converters that check what a user gives: each returns what is stored, or raises an Error in one line.

A converter takes a value and `where`, the name of the field it is for; `field` makes one of attrs of it.
"""

import math
import operator
from typing import Any

import attrs
import numpy as np

from ..color import linear_of
from ..errors import Error

Given = Any   # type of a field that takes more than it holds: a list becomes an array or a tuple, read-only
LARGEST = 1e9   # of single numbers: their squares' squares must stay finite on the device


def shown(value):
    """Return `value` as a short text on one line."""
    if isinstance(value, np.ndarray) and value.ndim and value.size > 4:
        return f"an array of {value.dtype} {list(value.shape)}"
    text = " ".join(repr(value).split())
    return text if len(text) <= 80 else text[:77] + "..."


def refuse(where, value, allowed):
    raise Error(f"{where} is {shown(value)}; allowed: {allowed}")


def field(convert, **options):
    """Return the attrs field that holds `convert(value, where)`, where `where` is "Class.field"."""

    def converter(value, instance, field):
        return convert(value, f"{type(instance).__name__}.{field.alias}")

    return attrs.field(converter=attrs.Converter(converter, takes_self=True, takes_field=True), **options)


def _float(value):
    """Return a number as a float, and NaN for what is none; NumPy would take times, and half of a complex number."""
    try:
        odd = isinstance(value, (bool, np.bool_, str, bytes, np.complexfloating, np.timedelta64))
        return math.nan if odd else float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def real(low=-math.inf, high=math.inf, above=None, below=None):
    """Return a converter to a finite float: low <= value <= high, above < value < below."""
    words = [f">= {low:g}"] if low > -math.inf else []
    words += [f"<= {high:g}"] if high < math.inf else []
    words += [f"> {above:g}"] if above is not None else []
    words += [f"< {below:g}"] if below is not None else []
    allowed = " and ".join(["a finite number" + (" " if words else "") + ", ".join(words)])

    def convert(value, where):
        number = _float(value)
        good = abs(number) <= LARGEST and low <= number <= high
        good = good and (above is None or number > above) and (below is None or number < below)
        return number if good else refuse(where, value, allowed)

    return convert


def whole(low, high):
    """Return a converter to an int from low to high."""

    def convert(value, where):
        allowed = f"a whole number from {low} to {high}"
        try:
            number = operator.index(value)
        except TypeError:
            refuse(where, value, allowed)
        if isinstance(value, (bool, np.bool_)) or not low <= number <= high:
            refuse(where, value, allowed)
        return number

    return convert


def choice(*names):
    def convert(value, where):
        if not isinstance(value, str) or value not in names:
            refuse(where, value, " or ".join(repr(name) for name in names))
        return value

    return convert


def instance(*classes, none=False):
    """Return a converter that lets through objects of these classes (and None if `none`)."""

    def convert(value, where):
        if not (isinstance(value, classes) or (none and value is None)):
            names = [each.__name__ for each in classes] + ["None"] * none
            refuse(where, value, "an object of class " + " or ".join(names))
        return value

    return convert


def tuple_of(kind):
    """Return a converter to a tuple of objects of class `kind`; one object alone becomes a tuple of one."""

    def convert(value, where):
        items = (value,) if isinstance(value, kind) else value
        if not isinstance(items, (tuple, list)) or not all(isinstance(item, kind) for item in items):
            refuse(where, value, f"one {kind.__name__} or a list of them")
        return tuple(items)

    return convert


def numbers(value, where, allowed, kinds="iuf"):
    """Return `value` as an array of numbers (kinds: the dtype kinds allowed); not yet a copy."""
    try:
        array = np.asarray(value)
    except (ValueError, TypeError):
        refuse(where, value, allowed)
    if array.dtype.kind not in kinds and array.size:
        refuse(where, value, allowed)
    return array


def is_on_device(value):
    """Whether this is an array of pyopencl's, which lies on a device: known by its members, as OpenCL is not here."""
    return hasattr(value, "base_data") and hasattr(value, "get")


def placed(value, where, allowed):
    """Return `value` as an array of numbers, or as it is where it lies on a device; there it must be float32."""
    if not is_on_device(value):
        return numbers(value, where, allowed)
    if value.dtype != np.float32 or not value.flags.c_contiguous:
        raise Error(f"{where} is {value.dtype} {list(value.shape)} on a device; "
                    "allowed there: float32 without gaps (C order)")
    if value.queue is None:
        raise Error(f"{where} is on a device without a queue; allowed: an array with the queue that fills it")
    return value


def frozen(array):
    array.flags.writeable = False
    return array


def float32(array, where):
    """Return a read-only contiguous float32 copy of a number array; Error names the first bad element."""
    with np.errstate(over="ignore"):
        copy = np.array(array, dtype=np.float32, order="C")
    if not np.isfinite(copy).all():
        index = np.unravel_index(np.argmin(np.isfinite(copy)), copy.shape)
        at = ", ".join(str(i) for i in index)
        raise Error(f"{where}[{at}] is {array[index]}; allowed: finite numbers that float32 can hold")
    return frozen(copy)


def vector(length, low=-math.inf):
    """Return a converter to a read-only float64 array [length] of finite numbers >= low."""
    allowed = f"{length} finite numbers" + (f" >= {low:g}" if low > -math.inf else "")

    def convert(value, where):
        array = numbers(value, where, allowed)
        if array.shape != (length,):
            refuse(where, value, allowed)
        array = array.astype(np.float64)
        if not (np.abs(array) <= LARGEST).all() or (array < low).any():
            refuse(where, value, allowed)
        return frozen(array)

    return convert


def color(value, where):
    """Return linear light, read-only float64 [3] >= 0, of a colour as `clfur.color.linear_of` has it."""
    allowed = "3 finite numbers >= 0"
    return vector(3, low=0)(linear_of(numbers(value, where, allowed)), where)


def total(value, where):
    """Return a sum of many: a finite float >= 0, however large."""
    number = _float(value)
    return number if 0 <= number < math.inf else refuse(where, value, "a finite number >= 0")


def optional(convert):
    return lambda value, where: None if value is None else convert(value, where)


def pixels(value, where, kinds, allowed):
    """Return a picture's first three channels [h, w, 3], h and w >= 1; not a copy."""
    array = numbers(value, where, allowed, kinds)
    if array.ndim != 3 or array.shape[2] not in (3, 4) or 0 in array.shape:
        refuse(where, value, allowed)
    return array[:, :, :3]


def rows(columns, kinds="iuf"):
    """Return a converter to an array [n, columns] of numbers (not yet a copy, not yet checked for NaN)."""
    allowed = f"an array [n, {columns}] of " + ("numbers" if "f" in kinds else "whole numbers")

    def convert(value, where):
        if value is None:
            refuse(where, value, allowed)
        array = numbers(value, where, allowed, kinds)
        if array.ndim != 2 or array.shape[1] != columns:
            refuse(where, value, allowed)
        return array

    return convert


def unit(vector, where):
    """Return the vector float64 [3] at length one, read-only; Error where it is zero."""
    largest = np.abs(vector).max()
    if largest == 0:
        refuse(where, vector, "a vector that is not zero")
    vector = vector / largest  # so that no square overflows or vanishes
    return frozen(vector / np.sqrt((vector**2).sum()))


def direction(value, where):
    return unit(vector(3)(value, where), where)
