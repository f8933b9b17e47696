"""Root and tip colours that go with the colour of their hair, as long as nobody has chosen them."""

from typing import Any

import attrs
import numpy as np

from ..scene import HairType
from .changes import Path, found

SHADES = "root_color", "tip_color"
ROOT, TIP = 0.5, 0.5   # of the colour's light that is left at the root; of what it lacks to white, at the tip


@attrs.frozen(eq=False)
class Shade:
    """A root or tip colour, [3], beside its hair's, [3]; chosen: whether by a person, so that it stays as it is."""

    shade: Any
    color: Any
    chosen: bool = False

    def beside(self, color: Any) -> Any:
        """It beside another colour of the hair."""
        return self.shade if self.chosen else shaded(color, self.color, self.shade)


def shaded(color: Any, before: Any, shade: Any) -> np.ndarray:
    """Return what ``shade`` is to ``before`` for another colour, linear RGB [3] each: where it is darker the same share
    of each channel's light, where it is lighter the same share of what is missing to white."""
    color, before, shade = (np.asarray(each, np.float64) for each in (color, before, shade))
    if shade.sum() > before.sum():
        found = 1 - (1 - color) * _shares(1 - shade, 1 - before)
    else:
        found = color * _shares(shade, before)
    return np.clip(found, 0, max(1.0, color.max(), shade.max()))


def _shares(parts, wholes):
    """The share of each channel; of one of which there is nothing that of all others, or 1."""
    there = wholes > 0
    others = parts[there].sum() / wholes[there].sum() if there.any() else 1.0
    return np.where(there, parts / np.where(there, wholes, 1), others)


def root_shade(kind: HairType) -> Any:
    """The root colour of hair that has none, when it is switched on: linear RGB."""
    return tuple(ROOT * np.asarray(kind.color))


def tip_shade(kind: HairType) -> Any:
    """The same of the tip."""
    return tuple(1 - TIP * (1 - np.minimum(kind.color, 1.0)))


def with_shades(state: Any, path: Path, value: Any, chosen: bool = True) -> Any:
    """Return `State.changed(path, value)`, in which root and tip go with the colour of their hair type.

    chosen: whether a root or tip colour is one that a person has chosen.
    """
    after = state.changed(path, value)
    if path[-1] not in (*SHADES, "color") or not isinstance(kind := found(state, path[:-1]), HairType):
        return after
    shades = dict(state.shades)
    if path[-1] in SHADES:
        shades[path] = _now(state, path, kind) if value is None else Shade(found(after, path), kind.color, chosen)
        return attrs.evolve(after, shades=shades)
    for name in SHADES:
        if getattr(kind, name) is not None:
            place = (*path[:-1], name)
            shades[place] = _now(state, place, kind)
            after = after.changed(place, shades[place].beside(found(after, path)))
    return attrs.evolve(after, shades=shades)


def carried(shades: dict, before: Any, after: Any) -> dict:
    """Return {path: `Shade`} after fur has become another, each with its hair type if that is still there, wherever.

    before, after: fur, or None.
    """
    types, others = (getattr(each, "types", None) or () for each in (before, after))
    if all(one is other for one, other in zip(types, others)) and len(types) <= len(others):
        return shades
    kept = {}
    for (*start, number, name), shade in shades.items():
        place = next((n for n, other in enumerate(others) if number < len(types) and _is(types[number], other)), None)
        if place is not None:
            kept[*start, place, name] = shade
    return kept


def _is(kind, other):
    """Whether a hair type is still the same one, but for its key: that of the last one goes."""
    return kind is other or all(getattr(kind, field.name) is getattr(other, field.name)
                                for field in attrs.fields(HairType) if field.name != "key")


def switched_on(state: Any, path: Path, usual: Any) -> Any:
    """Return (a root or tip colour that is switched on: as it was, for the colour that its hair has now, or ``usual``;
    whether somebody had chosen it)."""
    known = state.shades.get(path)
    return (usual, False) if known is None else (known.beside(found(state, path[:-1]).color), known.chosen)


def _now(state, path, kind):
    """The `Shade` at a path: what is known of it, if it is still so."""
    known, shade = state.shades.get(path), getattr(kind, path[-1])
    if known is not None and (shade is None or np.allclose(known.beside(kind.color), shade, atol=1e-6)):
        return known
    return Shade(shade, kind.color)
