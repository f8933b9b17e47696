"""Converters that check what a user gives: each returns what is stored, or raises an Error in one line.

A converter takes a value and `where`, the name of the field it is for; `field` makes one of attrs of it.
"""

import math
import operator
import sys
from typing import Any

import attrs
import numpy as np

from ..color import linear_of
from ..errors import Error, shown

Given = Any   # type of a field that takes more than it holds: a list becomes an array or a tuple, read-only
LARGEST = 1e9   # of single numbers: their squares' squares must stay finite on the device
SMALLEST = 1 / LARGEST   # of those that must be above 0: what is divided by them must, too


def refuse(where, value, allowed):
    raise Error(f"{where} is {shown(value)}; allowed: {allowed}")


def safely(convert, value, where):
    """Return `convert(value, where)`; what the value's own methods raise becomes an Error."""
    try:
        return convert(value, where)
    except Error:
        raise
    except Exception as error:
        raise Error(f"{where} is {shown(value)}, which raises {type(error).__name__} when it is read; "
                    "allowed: what can be read") from error


def field(convert, **options):
    """Return the attrs field that holds `convert(value, where)`, where `where` is "Class.field"."""

    def converter(value, instance, field):
        return safely(convert, value, f"{type(instance).__name__}.{field.alias}")

    return attrs.field(converter=attrs.Converter(converter, takes_self=True, takes_field=True), **options)


def _one(value):
    """Return the number that an array without axes holds, None for other arrays and masked ones; else the value."""
    if not isinstance(value, np.ndarray):
        return value
    return None if value.ndim or _is_masked(value) else value[()]


def _float(value):
    """Return a number as a float, and NaN for what is none; NumPy would take times, and half of a complex number."""
    try:
        value = _one(value)
        odd = isinstance(value, (bool, np.bool_, str, bytes, np.complexfloating, np.timedelta64, np.datetime64))
        a_number = hasattr(type(value), "__float__") or hasattr(type(value), "__index__")
        return float(value) if a_number and not odd else math.nan
    except Exception:   # an object's own conversion can raise anything
        return math.nan


def real(low=-math.inf, high=math.inf, above=None, below=None):
    """Return a converter to a finite float: low <= value <= high, above < value < below."""
    words = [f">= {low:g}"] if low > -math.inf else []
    words += [f"<= {high:g}"] if high < math.inf else []
    words += [f"> {above:g}"] if above is not None else []
    words += [f"< {below:g}"] if below is not None else []
    if low == -math.inf and above is None:
        words.append(f">= {-LARGEST:g}")
    if high == math.inf and below is None:
        words.append(f"<= {LARGEST:g}")
    allowed = "a finite number " + ", ".join(words)

    def convert(value, where):
        number = _float(value)
        good = abs(number) <= LARGEST and low <= number <= high
        good = good and (above is None or number > above) and (below is None or number < below)
        return number if good else refuse(where, value, allowed)

    return convert


def positive(high=LARGEST):
    """Return a converter to a float above 0 that float32 can hold and divide by: from SMALLEST to high."""
    return real(low=SMALLEST, high=high)


def whole(low, high):
    """Return a converter to an int from low to high."""

    def convert(value, where):
        allowed = f"a whole number from {low} to {high}"
        try:
            number = operator.index(_one(value))
            odd = isinstance(value, bool) or isinstance(_one(value), np.bool_)
        except Exception:   # an object's own conversion can raise anything
            refuse(where, value, allowed)
        if odd or not low <= number <= high:
            refuse(where, value, allowed)
        return int(number)

    return convert


def flag(value, where):
    """Return a bool of Python's, of Python's or of NumPy's."""
    if isinstance(one := _one(value), (bool, np.bool_)):
        return bool(one)
    return refuse(where, value, "True or False")


def to_stop(value, where):
    """Return what is asked whether a picture is to be given up, or None."""
    if value is not None and not callable(value):
        refuse(where, value, "None, or a function without arguments, such as threading.Event().is_set")
    return value


def choice(*names):
    def convert(value, where):
        if not isinstance(value, str) or value not in names:
            refuse(where, value, " or ".join(repr(name) for name in names))
        return names[names.index(value)]   # a plain str, whatever kind of str was given

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
    if isinstance(value, (bytes, bytearray)):   # NumPy would take the second for numbers
        refuse(where, value, allowed)
    if _is_masked(value):
        raise Error(f"{where} is {shown(value)} with masked values; allowed: {allowed}, without a mask")
    try:
        array = np.asarray(value)
        if array.dtype.kind == "O" and "f" in kinds:   # Python's other numbers: fractions, decimals, large integers
            array = np.array([_float(each) for each in array.flat], np.float64).reshape(array.shape)
            if np.isnan(array).any():
                refuse(where, value, allowed)
    except Error:
        raise
    except Exception:   # an object's own conversion can raise anything
        refuse(where, value, allowed)
    if array.dtype.kind not in kinds:
        if array.size:
            refuse(where, value, allowed)
        return np.zeros(array.shape, float if "f" in kinds else int)
    return array


def _is_masked(value):
    """Whether a masked array, or one in a list, hides some of its values, which NumPy would show again."""
    masked = sys.modules.get("numpy.ma")   # which takes long to import: without it there are no masked arrays
    if masked is None:
        return False
    if isinstance(value, masked.MaskedArray):
        return masked.is_masked(value)
    return isinstance(value, (list, tuple)) and any(
        _is_masked(each) for each in value if isinstance(each, (list, tuple, masked.MaskedArray)))


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


def float32(array, where, most=None, least=None):
    """Return a read-only contiguous float32 copy of a number array; Error names the first bad element.

    most: how large numbers may be, LARGEST or what float32 can hold if None. least: 0, or -most if None.
    """
    with np.errstate(over="ignore"):
        copy = np.array(array, dtype=np.float32, order="C")
    good = np.isfinite(copy) if most is None else np.abs(copy) <= np.float32(most)
    good = good if least is None else good & (copy >= least)
    if not good.all():
        index = np.unravel_index(np.argmin(good), copy.shape)
        at = f"[{', '.join(str(i) for i in index)}]" if index else ""
        allowed = "that float32 can hold" if most is None else f"from {-most if least is None else least:g} to {most:g}"
        raise Error(f"{where}{at} is {array[index]}; allowed: finite numbers {allowed}")
    return frozen(copy)


def vector(length, low=-math.inf):
    """Return a converter to a read-only float64 array [length] of finite numbers >= low."""
    allowed = f"{length} finite numbers >= {max(low, -LARGEST):g}, <= {LARGEST:g}"

    def convert(value, where):
        array = numbers(value, where, allowed)
        if array.shape != (length,):
            refuse(where, value, allowed)
        with np.errstate(over="ignore"):   # of long doubles
            array = array.astype(np.float64)
        if not (np.abs(array) <= LARGEST).all() or (array < low).any():
            refuse(where, value, allowed)
        return frozen(array)

    return convert


def color(value, where):
    """Return linear light, read-only float64 [3] >= 0, of a colour as `clfur.color.linear_of` has it."""
    array = numbers(value, where, f"3 finite numbers >= 0, <= {LARGEST:g}")
    return vector(3, low=0)(linear_of(array), where)


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
