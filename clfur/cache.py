"""Clfur's folder in the user's cache, names of what is kept there, and what is known of each device."""

import hashlib
import json
import math
import os
import tempfile
from pathlib import Path

import platformdirs

from ._version import __version__
from .errors import Error

VERDICTS = ("pass", "wrong", "crash", "hang")


def folder(name):
    """Path of a folder in clfur's cache folder, there or not; raises `clfur.Error` if the user has none."""
    path = Path(platformdirs.user_cache_dir("clfur"))
    if not path.is_absolute():   # without a home it would be a folder named "~" right here
        raise Error("there is no cache folder without HOME or XDG_CACHE_HOME")
    return path / name


def write(file, content):
    """Write bytes to a file of the cache, whole or not at all; raises `clfur.Error` where that is not possible."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        handle, new = tempfile.mkstemp(dir=file.parent)
        try:
            with open(handle, "wb") as stream:
                stream.write(content)
            os.replace(new, file)
        except BaseException:
            os.unlink(new)
            raise
    except OSError as error:
        raise Error(f"cannot write to {file.parent}: {error.strerror}") from None


def digest(*values):
    """SHA-256 in hex of objects of attrs, arrays, containers, numbers and texts, by what they hold."""
    state = hashlib.sha256()
    for text in _texts(values):
        state.update(text)
    return state.hexdigest()


def _texts(value):
    import attrs  # with NumPy, not above: what asks for drivers comes before all that takes long to import
    import numpy as np

    if attrs.has(type(value)):
        yield type(value).__name__.encode()
        for field in attrs.fields(type(value)):
            yield from _texts((field.name, getattr(value, field.name)))
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype.str}{value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif hasattr(value, "base_data"):   # an array on a device
        yield from _texts(value.get())
    elif isinstance(value, dict):
        yield from _texts(sorted(value.items()))
    elif isinstance(value, (list, tuple)):
        yield f"[{len(value)}".encode()
        for part in value:
            yield from _texts(part)
    else:
        yield f"{value!r};".encode()


def remember_bytes(file, content):
    """Keep bytes in a file of the cache, with what shows that they are whole; raises `clfur.Error` as `write` does."""
    write(file, hashlib.sha256(content).digest() + content)


def recall_bytes(file):
    """What `remember_bytes` kept in a file, or None: there is none, or it is damaged."""
    try:
        kept = file.read_bytes()
    except OSError:
        return None
    return kept[32:] if len(kept) > 32 and hashlib.sha256(kept[32:]).digest() == kept[:32] else None


def recall(identity):
    """What `remember` kept of what the self-test said of this device -> (verdict, message), or None."""
    record = _record(identity)
    return record and (record["verdict"], record["message"])


def recall_seconds(identity):
    """What `remember` kept of the seconds that this device takes for a frame, or None."""
    seconds = (_record(identity) or {}).get("seconds")
    return seconds if isinstance(seconds, float) and 0 < seconds < math.inf else None


def _record(identity):
    try:
        record = json.loads(_file(identity).read_bytes())
        whole = record["verdict"] in VERDICTS and isinstance(record["message"], str)
    except (OSError, ValueError, LookupError, TypeError):   # none yet, or damaged; clfur.Error is a ValueError
        return None
    return record if whole else None


def remember(identity, verdict, message="", seconds=None):
    """Keep what the self-test said of a device, one of `VERDICTS` and a line, and the seconds of a frame.

    identity: texts that distinguish the device and its driver's version from others; clfur's own version is added.
    Raises `clfur.Error` if the folder cannot be written.
    """
    write(_file(identity), json.dumps(
        {"device": identity, "verdict": verdict, "message": message, "seconds": seconds}).encode())


def _file(identity):
    name = hashlib.sha256(json.dumps([*identity, __version__]).encode()).hexdigest()[:32]
    return folder("checks") / f"{name}.json"
