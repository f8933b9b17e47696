"""Input files: regular ones alone, and never more of one than a limit; and text of any encoding."""

import codecs
import contextlib
import os
import stat
from collections.abc import Iterator
from pathlib import Path

from ..errors import Error

HEAD = 64            # bytes of a text that show whether it is UTF-16 without a byte order mark
MAX_BYTES = 2**30   # of a file, and of what a file's header may ask for
UNICODE = {codecs.BOM_UTF8: "utf-8", codecs.BOM_UTF32_LE: "utf-32", codecs.BOM_UTF32_BE: "utf-32",
           codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}   # the longer of two that begin alike first

_noted: list[set[tuple[int, int]]] = []   # of each `noting` the files, by `_identity`


@contextlib.contextmanager
def noting() -> Iterator[None]:
    """Within the block note which files are read, for `is_noted`."""
    _noted.append(set())
    try:
        yield
    finally:
        _noted.pop()


def is_noted(path: str | os.PathLike) -> bool:
    """Whether a file is there that was read since the last `noting`, under this name or another one."""
    try:
        return bool(_noted) and _identity(os.stat(path)) in _noted[-1]
    except OSError:
        return False


def note(path: str | os.PathLike) -> None:
    """Note a file that another library has read, if it is there, for `is_noted`."""
    with contextlib.suppress(OSError, ValueError):
        for files in _noted[-1:]:
            files.add(_identity(os.stat(path)))


def read(path: Path, limit: int = MAX_BYTES) -> bytes:
    """Return the bytes of a regular file. Raises Error, one line that names it, for any other and for more than limit.

    A pipe or a device is not opened, as that could wait forever; of a file that grows only what was there is read.
    """
    with _opened(path, limit) as (file, size):
        return file.read(size)   # to read up to the limit would take as much memory beforehand


def size_of(path: Path, limit: int = MAX_BYTES) -> int:
    """Return how many bytes a file has that another library reads; raises as `read` does."""
    with _opened(path, limit) as (_, size):
        return size


@contextlib.contextmanager
def _opened(path, limit):
    """Give a regular file, open, and its size."""
    try:
        _regular(path, os.stat(path))
        with open(path, "rb", opener=_open) as file:
            status = os.fstat(file.fileno())   # what has the name now may be another one
            _regular(path, status)
            for files in _noted[-1:]:
                files.add(_identity(status))
            size = status.st_size
            if size > limit:
                raise Error(f"{path}: has {size} bytes; allowed: at most {limit}")
            yield file, size
    except Error:
        raise
    except ValueError:   # a name that holds a zero
        raise Error(f"{path}: no such file") from None
    except OSError as error:
        raise Error(f"{path}: {error.strerror}") from None


def _open(path, flags):
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))   # Windows has no pipes among files


def _identity(status):
    """What two names of one file have in common."""
    return status.st_dev, status.st_ino


def _regular(path, status):
    if not stat.S_ISREG(status.st_mode):
        raise Error(f"{path}: is a pipe, a device or a folder; allowed: a file")


def plain(data: bytes) -> bytes:
    """Return the text of a file as bytes, ASCII as it is: without a byte order mark, and UTF-16 and UTF-32 decoded;
    UTF-16 without a mark is known by its first characters."""
    for mark, encoding in UNICODE.items():
        if data.startswith(mark):
            return data[3:] if encoding == "utf-8" else data.decode(encoding, "replace").encode("utf-8", "replace")
    first, second = data[:HEAD:2], data[1:HEAD:2]   # bytes of characters; of UTF-16's ASCII one is zero
    for encoding, high, low in ("utf-16-le", second, first), ("utf-16-be", first, second):
        if low and all(low) and high and not any(high):
            return data.decode(encoding, "replace").encode("utf-8", "replace")
    return data


def lines(data: bytes) -> list[bytes]:
    """Return the lines of a text, whatever ends them: a line feed, a carriage return, or both."""
    return (data.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in data else data).split(b"\n")
