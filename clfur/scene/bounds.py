"""How far a mesh and its fur extend at most: what cameras, grids and counters must have room for."""

import math
from typing import Any

import numpy as np

from .checks import is_on_device
from .curves import Bounds, Curves
from .guides import reach_of
from .mesh import Mesh, box, sphere
from .origin import ZERO, seen_from
from .remembered import remembered
from .shells import Shells
from .strands import HairType, Strands

LONG = 0.2   # of a mesh's radius: hair that is longer may lie on the mesh


def strands_and_shells(fur):
    """Return (Strands, Curves or None; Shells or None) of what `_fur` gave."""
    parts = fur if isinstance(fur, tuple) else (fur,)
    return (next((part for part in parts if isinstance(part, (Strands, Curves))), None),
            next((part for part in parts if isinstance(part, Shells)), None))


def origin_of(mesh: Mesh | None, fur: Any) -> np.ndarray:
    """Return the place, float64 [3], that they are drawn relative to: the mesh's origin, or the Curves'."""
    strands, _ = strands_and_shells(fur)
    if isinstance(strands, Curves) and (mesh is None or is_on_device(strands.points)):
        return strands.origin
    return ZERO if mesh is None else mesh.origin


def local(mesh: Mesh | None, fur: Any) -> tuple:
    """Return (`origin_of` a mesh and its fur, both seen from there)."""
    there = origin_of(mesh, fur)
    strands, _ = strands_and_shells(fur)
    placed = mesh, strands, getattr(strands, "guides", None)
    apart = any(part.origin.any() for part in placed if isinstance(part, (Mesh, Curves)))
    return (there, seen_from(mesh, there), seen_from(fur, there)) if apart or there.any() else (there, mesh, fur)


def points_to_see(mesh, fur):
    """Return arrays [n, 3] of points whose hull, grown by `fur_extent`, holds all that `local` gave."""
    strands, _ = strands_and_shells(fur)   # shells grow on the mesh
    curved = strands is not None and strands.surface == "pn"
    points = [mesh.hull if curved else mesh.positions] if mesh is not None else []
    return points + ([strands.on_host.points] if isinstance(strands, Curves) and len(strands.points) else [])


def points_to_frame(mesh, fur):
    """Return (what `points_to_see` does, `fur_extent`) as a camera needs them: hair that slides is seldom pulled
    straight; strands that stand near guides lie about as far from these as they are apart, and no further than they
    reach."""
    strands, shells = strands_and_shells(fur)
    points, most = points_to_see(mesh, fur), fur_extent(fur, unbent=False)
    if not isinstance(strands, Strands) or strands.guides is None or strands.guides_reach is None:
        return points, most
    reach, _ = reach_of(strands.guides)
    apart = math.sqrt(mesh.area / len(strands.guides.counts)) * max(strands.guides_reach, 1)
    least = apart * (1 + reach / mesh.bounds[1]) + max(fur_extent(strands, unbent=False) - reach, 0)
    return [*points, strands.guides.on_host.points], min(most, max(least, fur_extent(shells)))


@remembered(2)   # a film asks for the same again in every frame
def boxes_to_see(mesh, fur):
    """Return the (low, high) corners of the boxes of `points_to_see`."""
    return [box(each) for each in points_to_see(mesh, fur)]


@remembered(2)
def extent(mesh: Mesh | None, fur: Any) -> tuple[np.ndarray, float]:
    """Return a sphere (centre float64 [3], radius float) around a mesh and all that its fur can fill."""
    there, mesh, fur = local(mesh, fur)
    if there.any():
        center, radius = extent(mesh, fur)
        return center + there, radius
    strands, shells = strands_and_shells(fur)
    if isinstance(strands, Curves) and strands.bounds:
        center, radius = strands.bounds.center, strands.bounds.radius
        return center, max(radius, _furthest(center, [mesh.positions]) + fur_extent(shells)) if mesh else radius
    points, boxes = points_to_see(mesh, fur), boxes_to_see(mesh, fur)
    if not boxes:
        return np.zeros(3), 0.0
    center, _ = sphere(np.min([low for low, _ in boxes], 0), np.max([high for _, high in boxes], 0))
    return center, _furthest(center, points) + fur_extent(fur)


def _furthest(center, points):
    """Return how far the furthest of arrays of points [n, 3] is from a centre."""
    return float(np.sqrt(max(((each - center) ** 2).sum(1).max() for each in points)))


def bounds_of(mesh: Mesh | None, fur: Any, strands: int) -> Bounds:
    """Return the `Bounds` of this many strands of a fur, as its Curves would need them to be drawn alike."""
    segments, length, area = hair_bounds(strands_and_shells(fur)[0], strands)
    return Bounds(*extent(mesh, fur), segments, length, area)


def sideways(kind: HairType, curled: float) -> float:
    """Return how far curl and wave, so many times as large, and frizz take a point of a strand from its axis at most,
    in world units."""
    return 2 * kind.curl[0] * curled + kind.wave[0] * curled + 1.5 * kind.frizz[0]   # which is in two directions


def fur_extent(fur: Any, unbent: bool = True) -> float:
    """Return how far fur, or each of a tuple, extends beyond the points it is made of or grows on, in world units:
    at most, or if not ``unbent`` but for curls that the body pulls straight as hair slides along it."""
    if isinstance(fur, tuple):
        return max((fur_extent(each, unbent) for each in fur), default=0.0)
    if isinstance(fur, Shells):
        return fur.length
    if isinstance(fur, Curves):
        return _widest(fur.on_host) / 2
    if fur is None:
        return 0.0
    longer, wider, more = _most(fur)
    return max((_longest(fur, hair, longer, more, unbent) + hair.widest * wider / 2 for hair in fur.hairy_types),
               default=0.0)


def _widest(curves):
    """Return the width of the widest of Curves that has points."""
    width, counts = curves.width, curves.counts
    return float((width[counts > 0] if 1 < len(width) != len(curves.points) else width).max(initial=0))


def _longest(fur, hair, longer, more, unbent):
    """Return how far from its root a hair can get; tufts may straighten guides, and what slides along the body all."""
    axis = hair.full_length * (1 + hair.length_variation) * longer
    if fur.guides is not None:
        axis = reach_of(fur.guides)[int(fur.collision or fur.tufted)]
    if not (fur.collision and unbent):
        return axis + sideways(hair, more)
    bends = sum(size * min(2 * hair.segments, 2 * np.pi * abs(turns)) for size, turns in (hair.curl, hair.wave))
    return axis + more * bends + 3 * hair.frizz[0] * hair.segments


def _most(fur):
    """How many times as long, as wide and as curled as a type says Strands may be where maps say so."""
    return (1.0, 1.0, 1.0) if fur.maps is None else tuple(map(fur.maps.most, ("length", "width", "curl")))


@remembered(2)
def hair_bounds(fur: Strands | Curves, strands: int) -> tuple[int, float, float]:
    """Return (segments, length [world], length · width [world²]) that ``strands`` strands of the fur cannot exceed."""
    if isinstance(fur, Curves):
        if fur.bounds:
            return fur.bounds.segments, fur.bounds.length, fur.bounds.area
        fur = fur.on_host
        d = np.linalg.norm(np.diff(fur.points, axis=0), axis=1)
        inner = np.ones(len(fur.points), bool)
        inner[np.cumsum(fur.counts, dtype=np.int64)[fur.counts > 0] - 1] = False   # a strand's end joins nothing
        length = float(d[inner[:-1]].sum(dtype=float))
        return len(fur.points), length, length * _widest(fur)
    types, (longer, wider, more) = fur.hairy_types, _most(fur)
    # From one point to the next it may cross all of what curl, wave and frizz leave it.
    lengths = [(t.segments * t.step * (1 + t.length_variation) * longer if fur.guides is None
                else reach_of(fur.guides)[1]) + t.segments * 2 * sideways(t, more) for t in types]
    return (strands * max((t.segments for t in types), default=0), strands * max(lengths, default=0.0),
            strands * max((length * t.widest * wider for length, t in zip(lengths, types)), default=0.0))
