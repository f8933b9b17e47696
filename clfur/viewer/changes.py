"""Changes of scenes by path: each gives another scene, as scenes never change."""

from typing import Any

import attrs
import numpy as np

from ..errors import Error, shown
from ..scene import Curves, Scene, Shells, Strands
from ..scene.look import Looking
from ..scene.origin import copied

Path = tuple[str | int, ...]

def found(thing: Any, path: Path) -> Any:
    """Return what stands at a path, such as ("strands", "types", 1, "length") of a Scene.

    Names are of fields, numbers of places in a tuple; of a Scene also "lights". Raises Error where there is none.
    """
    for step in path:
        try:
            thing = thing[step] if isinstance(step, int) else getattr(thing, step)
        except (AttributeError, IndexError, TypeError):
            raise Error(f"{_named(path)} is not there, as {shown(thing, 40)} has no {step!r}") from None
    return thing


def changed(thing: Any, path: Path, value: Any) -> Any:
    """Return a thing with another value at a path, as `found` has it; raises Error where it does not fit.

    "strands", "shells" and "lights" are of a Scene, of which None takes the first two away.
    """
    if not path:
        return value
    step, rest = path[0], path[1:]
    inner = changed(found(thing, path[:1]), rest, value) if rest else value
    if isinstance(step, int):
        return tuple(inner if n == step else each for n, each in enumerate(thing))
    if isinstance(thing, Strands) and step == "types" and _keys(thing.types) == _keys(inner):
        return copied(thing, types=tuple(inner))   # a type map is looked through again by others
    return _kept(thing, attrs.evolve(thing, **_fields(thing, step, inner)), step)


def _fields(thing, name, value):
    """{field: value} by which `attrs.evolve` gives a thing with another value of this name."""
    if isinstance(thing, Scene) and name in ("strands", "shells"):
        other = thing.shells if name == "strands" else thing.strands
        kinds = (Strands, Curves) if name == "strands" else Shells
        if value is not None and not isinstance(value, kinds):
            raise Error(f"Scene.{name} is {shown(value)}; allowed: None or fur of that kind")
        both = [each for each in ((other, value) if name == "strands" else (value, other)) if each is not None]
        return {"fur": both[0] if len(both) == 1 else both or None}
    if isinstance(thing, Scene) and name == "lights":
        return {"light": tuple(value)}
    if isinstance(thing, Looking) and name == "look":
        return {"look": value, "specular": None, "exponent": None}   # which a look has itself
    if name not in {field.alias for field in attrs.fields(type(thing)) if field.init}:
        raise Error(f"{type(thing).__name__} has no field {name!r} that can be changed")
    return {name: value}


def _kept(before, after, name):
    """The thing after a change, with the arrays that it had before in all fields but the one of this name: who keeps
    what is made of them knows them by identity, and undo holds them once."""
    for field in attrs.fields(type(after)):
        old, new = getattr(before, field.name), getattr(after, field.name)
        if field.init and field.alias != name and new is not old and isinstance(old, np.ndarray) and (
                old.shape == new.shape and old.dtype == new.dtype):
            object.__setattr__(after, field.name, old)
    return after


def _keys(types):
    """Keys of hair types, by which a type map knows them."""
    try:
        return [kind.key for kind in types]
    except (AttributeError, TypeError):   # the class says what is wrong with them
        return None


def _named(path):
    return ".".join(str(step) for step in path)
