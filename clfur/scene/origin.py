"""Where float32 counts from: a point near what is drawn, so that what is far from 0 keeps its shape."""

import math
from typing import Any

import attrs
import numpy as np

from ..errors import Error
from . import checks
from .remembered import remembered

FAR = 64                 # sizes away from 0: float32 then keeps a place to 4e-6 of the size, which is still less than
                         # a step of the raster in a picture of a thousand pixels
FAR_OF_MOST = 1 << 13    # the same for the half of the points around their median, whatever else there is
FEW = 0.05               # share of the points that may be strays, left behind at the old origin
SOME = 4096              # points that are looked at

ZERO = checks.frozen(np.zeros(3))
vector = checks.vector(3)


def origin(value, where):
    """Convert what an `origin` is given as: float64 [3]."""
    return ZERO if value is ZERO else vector(value, where)


def near_origin(places, given, where):
    """Return (places float32 [..., 3], origin float64 [3]) that mean the same as ``places`` + the ``given``.

    The origin stays as it is given where the places are near it, as these bits are wanted again; else it becomes
    their median, rounded to a power of two.
    """
    some = places.reshape(-1, 3)[::max(places.size // 3 // SOME, 1)].astype(np.float64)
    some = some[np.isfinite(some).all(1)]
    if not len(some):
        return checks.float32(places, where), given
    median = _median(some)
    apart = np.abs(some - median).max(1)
    away, most, half = float(np.abs(median).max()), float(apart.max()), float(_median(apart))
    here = float((np.abs(some).max(1) * FAR < away).mean())   # near the origin as it is: these would lose their places
    if not most or (away <= FAR * most and (away <= FAR_OF_MOST * (half or most) or here > FEW)):
        return checks.float32(places, where), given
    step = 2.0 ** math.floor(math.log2(half or most))
    shift = np.rint(median / step) * step
    if not (np.abs(given + shift) <= checks.LARGEST).all():
        raise Error(f"{where} are around {checks.shown((given + shift).tolist())}; allowed: at most {checks.LARGEST:g} "
                    "from 0")
    return checks.float32(places - shift, where), checks.frozen(given + shift)


def _median(values):
    """The median along the first axis: NumPy's own imports what of NumPy is for masked arrays, which takes long."""
    middle = len(values) // 2
    return np.sort(values, 0)[middle - (len(values) % 2 == 0):middle + 1].mean(0)


def copied(thing: Any, **fields: Any) -> Any:
    """Return an attrs object like another but for these fields, unchecked: what is stored stays the same bits."""
    copy = object.__new__(type(thing))
    for field in attrs.fields(type(thing)):
        object.__setattr__(copy, field.name, fields.get(field.name, getattr(thing, field.name)))
    return copy


def upright(thing: Any, back: bool = False) -> Any:
    """Return a Mesh or Curves, of which +Z is up, turned so that +Y is, or ``back``; the very numbers, in other places
    and with other signs."""
    names = [name for name in ("positions", "normals", "points", "root_normal", "origin")
             if getattr(thing, name, None) is not None]
    turned = {name: _turned(getattr(thing, name), back) for name in names}
    if hasattr(thing, "dropped"):
        which, places, *others = thing.dropped
        turned["dropped"] = (which, _turned(places, back), *others)
    return copied(thing, **turned)


def _turned(array, back):
    x, y, z = np.moveaxis(array, -1, 0)
    return checks.frozen(np.stack([x, 0 - z, y] if back else [x, z, 0 - y], -1))   # 0 - 0 has no sign


def seen_from(thing: Any, there: np.ndarray) -> Any:
    """Return a Mesh, Curves, Strands, Camera, Light, Ground or Bounds as it is seen from a place, float64 [3], as if
    that were the world's origin; a tuple of them; None and others as they are. Asked again, it is the very same
    object."""
    if isinstance(thing, tuple):
        return tuple(seen_from(each, there) for each in thing)
    return thing if thing is None else _seen_from(thing, tuple(there.tolist()))


@remembered(16)   # what is drawn again must be the very same
def _seen_from(thing, there):
    there = np.array(there)
    name = next((each for each in ("positions", "points") if hasattr(thing, each)), None)
    if name:   # Mesh, Curves
        shift = thing.origin - there
        moved = {"origin": ZERO}
        if shift.any():
            places = getattr(thing, name)
            moved[name] = checks.float32(places + shift, name)
        if getattr(thing, "bounds", None) is not None and name == "points":
            moved["bounds"] = _seen_from(thing.bounds, tuple(there.tolist()))
        return copied(thing, **moved)
    if hasattr(thing, "point_forces"):
        fields = {name: seen_from(getattr(thing, name), there) for name in ("point_forces", "guides")
                  if getattr(thing, name)}
        if thing.comb is not None and thing.comb.direction.per == "function":
            fields["comb"] = thing.comb.asked_from(there)
        return copied(thing, **fields) if fields else thing
    if hasattr(thing, "pose"):
        pose = thing.pose.copy()
        pose[:3, 3] -= there
        places = {each: None if getattr(thing, each) is None else checks.frozen(getattr(thing, each) - there)
                  for each in ("eye", "target")}
        return copied(thing, pose=checks.frozen(pose), **places)
    if hasattr(thing, "height"):   # Ground
        return thing if thing.height is None else copied(thing, height=thing.height - there[1])
    for name in ("position", "center"):   # Light, PointForce; Bounds
        if getattr(thing, name, None) is not None:
            return copied(thing, **{name: checks.frozen(getattr(thing, name) - there)})
    return thing
