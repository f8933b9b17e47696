"""The errors of the library, and how they show values in short."""

import reprlib
import sys
from collections.abc import Callable
from typing import Any


class _Short(reprlib.Repr):
    """Looks at the beginning alone of what is huge."""

    def repr1(self, x, level):
        return super().repr1(x.item() if _is_of_numpy(x, "generic") else x, level)   # 0.5, not np.float64(0.5)

    def repr_instance(self, x, level):
        return repr(x)   # reprlib's own would hide what this raises


def _is_of_numpy(value, kind):
    """Whether a value is of this class of NumPy's, which takes long to import: drivers are asked for before."""
    return "numpy" in sys.modules and isinstance(value, getattr(sys.modules["numpy"], kind))


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
        if _is_of_numpy(value, "ndarray") and value.ndim and value.size > 4:
            text = f"an array of {value.dtype} {list(value.shape)}"
        else:
            text = " ".join((repr if isinstance(value, str) else _SHORT.repr)(value).split())
    except Exception:   # repr is the object's own, and Python's refuses numbers of thousands of digits
        text = (f"a whole number of {value.bit_length()} bits" if issubclass(type(value), int)
                else f"an object of class {type(value).__name__}")
    return text if len(text) <= most else text[:most - 3] + "..."
