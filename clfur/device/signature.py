"""What the arguments of kernels may be, read from their text: every launch is held against it before it begins."""

import math
import re

import numpy as np
from pyopencl.array import Array

from .. import layout

NUMBERS = {"int": np.int32, "uint": np.uint32, "long": np.int64, "ulong": np.uint64, "float": np.float32}
RANGE = [("ulong", "begin"), ("ulong", "end")]   # the first arguments of every kernel: the scheduler's, see common.h

_COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)
_KERNEL = re.compile(r"__kernel\s+void\s+(\w+)\s*\(([^)]*)\)")
_ARGUMENT = re.compile(r"(?:volatile )?(__global )?(const )?([A-Za-z]+)(2|4|8|16)? (\*)?(\w+)")


class Lent(Array):
    """A device array that lies in a host array's memory, at a multiple of 16 bytes: kernels may only read it, no more
    than these at a time."""


class Kernel:
    """A kernel that is built, ``run``, its ``arguments`` behind begin and end, in order, work-items in a ``group``, and
    whether it ``ran`` yet.  ``nothing``: what it may be given for no work-items."""

    def __init__(self, name, arguments, run, group):
        self.name, self.run, self.group, self.ran = name, run, group, False
        self.nothing = [argument.nothing() for argument in arguments]
        self.takes = {argument.name: argument.take for argument in arguments}

    def bind(self, given):
        """{name: value} -> the values in order, as OpenCL takes them; TypeError for names or values that don't fit."""
        if given.keys() != self.takes.keys():
            missing = ", ".join(name for name in self.takes if name not in given)
            unknown = ", ".join(name for name in given if name not in self.takes)
            wrong = " and ".join([f"misses {missing}"] * bool(missing) + [f"has no {unknown}"] * bool(unknown))
            raise TypeError(f"{self.name} {wrong}; its arguments: {', '.join(self.takes)}")
        try:
            return [take(given[name]) for name, take in self.takes.items()]
        except TypeError as error:
            raise TypeError(f"{self.name}: {error}") from None


def names(text):
    """Names of the kernels in a text of OpenCL C."""
    return [name for name, _ in _KERNEL.findall(_COMMENT.sub("", text))]


def usual(text):
    """Names of those that most pictures need: RARE stands before the others."""
    rare = re.findall(r"\bRARE\s[\w\s]*\b__kernel\s+void\s+(\w+)", _COMMENT.sub("", text))
    return [name for name in names(text) if name not in rare]


def read(text):
    """The kernels in a text of OpenCL C -> {name: [`Buffer` | `Number` | `Vector` | `Struct`]}, begin and end left out.

    Raises TypeError for an argument of another kind, or a kernel that does not begin with begin and end.
    """
    kernels = {}
    for name, inside in _KERNEL.findall(_COMMENT.sub("", text)):
        found = [_ARGUMENT.fullmatch(" ".join(each.split())) for each in inside.split(",")]
        if not all(found) or [(f[3], f[6]) for f in found[:2]] != RANGE:
            raise TypeError(f"{name}({' '.join(inside.split())}) cannot be read; allowed: 'const ulong begin, const "
                            f"ulong end', then arguments of {', '.join([*NUMBERS, *layout.STRUCTS])}, or vectors")
        kernels[name] = [_argument(*each.groups()) for each in found[2:]]
    return kernels


def _argument(in_memory, const, base, width, pointer, name):
    """An argument of the kind that its declaration states."""
    known = base in NUMBERS or (base in layout.STRUCTS and width is None)
    if not known or bool(in_memory) != bool(pointer):
        raise TypeError(f"argument {name} is of {base}{width or ''}{pointer or ''}; allowed: "
                        f"{', '.join([*NUMBERS, *layout.STRUCTS])}, vectors, or __global pointers to these")
    if pointer:
        return Buffer(name, base, int(width or 1), const is not None)
    if base in layout.STRUCTS:
        return Struct(name, base)
    return Vector(name, base, int(width)) if width else Number(name, base)


class Argument:
    """What the arguments of all kinds have: name, base and width of their type in C, what is ``allowed``.

    ``take``: from a value to what pyopencl takes.  ``packed``: the type that it packs that in, np.void if it is packed
    already, None for a buffer.
    """

    packed: type | None = np.void

    def nothing(self):
        """What a launch over no work-items may be given."""
        return None

    def refused(self, value):
        """The error for a value that does not fit."""
        return TypeError(f"{self.name} is {_shown(value)}; allowed: {self.allowed}")


class Buffer(Argument):
    """A pointer: takes a device array of the very dtype, whose rows are as wide as the vectors that it points to."""

    packed = None

    def __init__(self, name, base, width, only_read=False):
        self.name, self.base, self.width = name, base, width
        self.dtype = np.dtype(NUMBERS.get(base) or layout.STRUCTS[base])
        self.takes_lent = only_read and base in NUMBERS and width * self.dtype.itemsize <= 16
        self.allowed = f"a device array of {_dtype(self.dtype)}" + f" [..., {width}]" * (width > 1)

    def take(self, value):
        if (isinstance(value, Array) and (value.dtype is self.dtype or value.dtype == self.dtype) and not value.offset
                and (self.width == 1 or value.shape[-1:] == (self.width,))
                and (self.takes_lent or not isinstance(value, Lent))):
            return value.base_data
        raise self.refused(value)


class Number(Argument):
    """A number: takes whatever is one, if the C type can hold it."""

    def __init__(self, name, base):
        self.name, self.base, self.width, self.packed = name, base, 1, NUMBERS[base]
        self.whole = base != "float"
        limits = np.iinfo(self.packed) if self.whole else np.finfo(self.packed)
        self.low, self.high = limits.min, limits.max
        if not self.whole:
            self.low, self.high = float(self.low), float(self.high)   # Python's compare faster
        self.allowed = f"a {'whole ' * self.whole}number from {self.low} to {self.high}"

    def nothing(self):
        return 0

    def take(self, value):
        if isinstance(value, (np.number, np.bool_, np.ndarray)) and not (value.shape or value.dtype.names):
            value = value.item()
        if not isinstance(value, (int, float)):
            raise self.refused(value)
        if self.low <= value <= self.high and (not self.whole or value == int(value)):
            return int(value) if self.whole else float(value)
        if not self.whole and (value != value or abs(value) == math.inf):   # these every float holds
            return value
        raise self.refused(value)


class Vector(Argument):
    """A vector: takes as many numbers."""

    def __init__(self, name, base, width):
        self.name, self.base, self.width = name, base, width
        self.each, self.dtype = Number(name, base), np.dtype(NUMBERS[base])
        self.allowed = f"{width} numbers, each {self.each.allowed}"

    def nothing(self):
        return np.zeros(self.width, self.dtype)

    def take(self, value):
        row = isinstance(value, (tuple, list)) or (isinstance(value, np.ndarray) and value.ndim == 1)
        if row and len(value) == self.width:
            return np.array([self.each.take(each) for each in value], self.dtype)
        raise self.refused(value)


class Struct(Argument):
    """A struct of `layout`: takes one of exactly that dtype; PoCL takes another size without a word."""

    def __init__(self, name, base):
        self.name, self.base, self.width, self.dtype = name, base, 1, layout.STRUCTS[base]
        self.allowed = f"a layout.{base}"

    def nothing(self):
        return np.zeros((), self.dtype)[()]

    def take(self, value):
        if (isinstance(value, (np.void, np.ndarray)) and value.shape == ()
                and (value.dtype is self.dtype or value.dtype == self.dtype)):
            return value
        raise self.refused(value)


def _shown(value):
    """What an error says of a value."""
    if isinstance(value, Array):
        return (f"a device array of {_dtype(value.dtype)} {list(value.shape)}"
                + " in the host's memory" * isinstance(value, Lent)
                + " that begins within a larger one" * bool(value.offset))
    if isinstance(value, (np.ndarray, np.void)):
        return f"{_dtype(value.dtype)} {list(value.shape)} on the host"
    return f"{value!r:.60}"


def _dtype(dtype):
    """Name of a dtype; of a struct that of `layout`."""
    names = [name for name, struct in layout.STRUCTS.items() if dtype.names and struct == dtype]
    return names[0] if names else f"a struct of {dtype.itemsize} bytes" if dtype.names else str(dtype)
