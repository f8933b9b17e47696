"""Output files: tested before the work, and written whole or not at all."""

import os
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import Error, Stopped, shown


def is_path(value):
    """Whether this is a str or path-like that Path takes."""
    try:
        return isinstance(value, (str, os.PathLike)) and isinstance(Path(value), Path)
    except Exception:   # an object's own method can raise anything
        return False


def output_path(path, suffixes):
    """The path as a Path; raises Error unless it has one of these suffixes and names a file in a folder that is."""
    if not is_path(path):
        raise Error(f"save path is {shown(path)}; allowed: a file's name")
    path = Path(path)
    if not path.name:
        raise Error(f"save path is {shown(str(path))}; allowed: a file's name")
    if path.suffix.lower() not in suffixes:
        raise Error(f"{path}: {path.suffix or 'no suffix'} is not supported; allowed: {', '.join(suffixes)}")
    if os.path.isdir(path):
        raise Error(f"{path}: is a folder; allowed: a file")
    if not os.path.isdir(path.parent):
        raise Error(f"{path}: there is no folder {path.parent}")
    return path


def check_writable(path, suffixes):
    """Raise Error unless a file with one of these suffixes could be written to this path; leaves nothing behind."""
    path = output_path(path, suffixes)
    temporary = _beside(path)
    try:
        temporary.touch(exist_ok=False)   # the one sure test: permissions may lie, as for root on a read-only disk
    except OSError as error:
        raise Error(f"{path}: cannot be written: {error.strerror}") from None
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextmanager
def whole(path):
    """Give a name to write to that becomes ``path`` at the end; if the block raises, nothing is left."""
    temporary = _beside(path)   # known before it is there, so that a signal at any time leaves none
    try:
        temporary.touch(exist_ok=False)
        yield temporary
        os.replace(temporary, path)
    except (Error, Stopped):
        raise
    except Exception as error:  # whatever a writer fails with, the user gets one line
        raise Error(f"{path}: cannot be written: {reason(error)}") from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def reason(error):
    """What an exception says, in one line."""
    text = getattr(error, "strerror", None) or str(error).strip() or type(error).__name__
    return text.splitlines()[0]


def _beside(path):
    """A new name beside ``path``, so that replacing it is one step; the file gets the usual permissions."""
    return path.with_name(f".{path.stem}-{os.urandom(4).hex()}{path.suffix.lower()}")
