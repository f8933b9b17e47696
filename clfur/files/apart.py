"""Calls a function in a process of its own: usd-core ends its process on some files that are damaged."""

import importlib
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from typing import Any

from ..errors import Error

SECONDS = 600   # that it may take
ROOM = 8 << 30  # bytes of address space that it may take, beside as many as it is told


def apart(function: Callable, *arguments: Any, size: int = 0) -> Any:
    """Return what a function of a module gives, called in a fresh process.

    size: bytes by which its memory may be more than usual. Raises its Error, and Error where its process dies or takes
    more than `SECONDS`.
    """
    call = pickle.dumps((function.__module__, function.__qualname__, arguments, ROOM + size, sys.path))
    code = "import pickle, sys; call = pickle.load(sys.stdin.buffer); sys.path[:] = call[4]; " \
           "from clfur.files.apart import serve; serve(*call[:4])"
    try:
        done = subprocess.run([sys.executable, "-c", code], input=call, capture_output=True, timeout=SECONDS)
    except subprocess.TimeoutExpired:
        raise Error(f"is damaged: to read it takes more than {SECONDS} s") from None
    try:
        error, value = pickle.loads(done.stdout)
    except Exception:   # nothing, or half of it
        raise Error("is damaged: the library that reads it ended its process") from None
    if error is not None:
        raise Error(error)
    return value


def serve(module: str, name: str, arguments: tuple, room: int) -> None:
    """In the process: call a function, write what it gives to stdout, and end."""
    answer = os.dup(1)
    os.dup2(2, 1)   # what libraries print is no answer
    _limit(room)
    found: tuple[str | None, Any]
    try:
        found = None, getattr(importlib.import_module(module), name)(*arguments)
    except Error as error:
        found = str(error), None
    except MemoryError:
        found = "is damaged: it claims more memory than there is", None
    except Exception as error:   # of a library, on a damaged file
        found = f"cannot be read: {(str(error).strip() or type(error).__name__).splitlines()[0]}", None
    with os.fdopen(answer, "wb") as stream:
        pickle.dump(found, stream, pickle.HIGHEST_PROTOCOL)
    os._exit(0)   # libraries may crash at exit, after all is done


def _limit(room):
    """Keep this process from taking more address space, where the system has such limits."""
    try:
        import resource
    except ImportError:   # Windows
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    least = min(each for each in (room, soft, hard) if each != resource.RLIM_INFINITY)
    resource.setrlimit(resource.RLIMIT_AS, (least, hard))
