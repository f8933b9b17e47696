"""Jobs as bytes that are sent to other machines: what all of them have goes there once."""

import io
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np

from ..cache import digest

LARGE = 1 << 12   # bytes of an array that is not sent again


class Parcels:
    """Packs jobs.

    first: the job whose ``kinds`` of objects, and large arrays, are parts: sent to each worker once, since later jobs
    have the same (as an object, or in all its bits). parts: {token: bytes}; name: a hash of the tokens.
    """

    def __init__(self, first: Any, kinds: tuple[type, ...]) -> None:
        self._kinds = kinds
        self._tokens: dict[int, str] = {}   # by id, of objects that are
        self._held: list[Any] = []          # held here, so that no other gets their id
        self.parts: dict[str, bytes] = {}
        _dump(first, self._take)
        self.name = digest(sorted(self.parts))[:12]

    def pack(self, job: Any) -> bytes:
        """Bytes of a job, with tokens in the place of parts."""
        return _dump(job, self._find)

    def _is_part(self, value):
        return isinstance(value, self._kinds) or (isinstance(value, np.ndarray) and value.nbytes >= LARGE)

    def _take(self, value):
        if not self._is_part(value):
            return None
        if id(value) not in self._tokens:
            self._tokens[id(value)] = token = _token(value)
            self._held.append(value)
            self.parts[token] = pickle.dumps(value, pickle.HIGHEST_PROTOCOL)
        return self._tokens[id(value)]

    def _find(self, value):
        if id(value) in self._tokens:
            return self._tokens[id(value)]
        token = _token(value) if self._is_part(value) else None
        return token if token in self.parts else None


def unpack(data: bytes, parts: dict[str, Any]) -> Any:
    """The job of bytes that `Parcels.pack` gave; parts: {token: object}."""
    unpickler = _Unpickler(io.BytesIO(data))
    unpickler.persistent_load = parts.__getitem__   # type: ignore[method-assign]
    return unpickler.load()


class _Unpickler(pickle.Unpickler):
    """Python's own takes persistent_load of objects of derived classes alone."""


class _Pickler(pickle.Pickler):
    """The same of persistent_id."""


def _token(value):
    return f"{type(value).__name__} {digest(value)}"


def _dump(job: Any, token_of: Callable[[Any], str | None]) -> bytes:
    stream = io.BytesIO()
    pickler = _Pickler(stream, pickle.HIGHEST_PROTOCOL)
    pickler.persistent_id = token_of   # type: ignore[method-assign]
    pickler.dump(job)
    return stream.getvalue()
