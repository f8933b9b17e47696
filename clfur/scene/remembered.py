"""Functions that keep what they gave, while that which it is of is there."""

import functools
import threading
import weakref
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

Given = TypeVar("Given")


def remembered(most: int) -> Callable[[Callable[..., Given]], Callable[..., Given]]:
    """Let a function keep what it gave the last ``most`` times, as `functools.lru_cache` does, without keeping its
    arguments, which may hold large arrays on a device: what is of one goes with it.

    Arguments are positional: objects, told apart by which they are, numbers, texts and None, and tuples of all these.
    What is given may be, or have in tuples, arguments; else it must not hold them.
    """
    def decorate(function):
        kept: dict[Any, tuple[list, Any]] = {}   # {key: (references of the arguments' objects, what is given)}
        turn = threading.RLock()                  # an object may go at any time, in this thread, too

        @functools.wraps(function)
        def call(*given):
            objects: list = []
            key = _key(given, objects)
            with turn:
                known = kept.pop(key, None)
                if known is not None:
                    kept[key] = known             # the last one
                    return _given(known[1])
            value = function(*given)
            references = [weakref.ref(each, lambda _: kept.pop(key, None)) for each in objects]
            with turn:
                kept[key] = references, _kept(value, objects, references)
                while len(kept) > most:
                    kept.pop(next(iter(kept)), None)
            return value
        call.forget = kept.clear   # type: ignore[attr-defined]
        return call
    return decorate


def _key(value, objects):
    """What arguments are told by; adds those that are objects to a list."""
    if isinstance(value, tuple):
        return tuple(_key(each, objects) for each in value)
    if value is None or isinstance(value, (str, int, float, np.generic)):
        return value
    objects.append(value)
    return type(value), id(value)   # nothing else has it before `weakref` tells that this is gone


def _kept(value, objects, references):
    """What is given, with references in the place of objects of the arguments."""
    if isinstance(value, tuple):
        return _same(value, tuple(_kept(each, objects, references) for each in value))
    return next((reference for each, reference in zip(objects, references) if each is value), value)


def _given(value):
    """What `_kept` was of."""
    if isinstance(value, tuple):
        return _same(value, tuple(map(_given, value)))
    return value() if isinstance(value, weakref.ref) else value


def _same(one, other):
    """The first of two tuples if they hold the very same."""
    return one if all(a is b for a, b in zip(one, other)) else other
