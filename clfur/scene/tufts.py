"""Tufts: how hair gathers, and where on a mesh the middles of tufts stand."""

import attrs
import numpy as np

from ..errors import Error
from . import checks
from .display import brief
from .mesh import Mesh

MOST = 1 << 20   # tufts


@attrs.frozen(eq=False)
class Tufts:
    """How strands of a type gather in tufts, each towards the hair that grows in its middle.

    count: tufts on the whole mesh, 1 to 1,048,576, spread evenly; or density: tufts a unit of the mesh's area.
    strength: 0..1, how far tips are drawn to the middle. profile: 0.001..0.999, how much of that is done at half of the
    length; 0.5: evenly from the root, less: nearer to the tip. size_variation: 0..1, how much tufts differ in size.
    within: None, or the Tufts that these gather in, fewer and larger, which have none around themselves; curl and wave
    are then theirs. No strand gets longer; it is of the tuft whose middle is nearest, on skin that looks
    the same way. Raises Error otherwise.
    """

    count: int | None = checks.field(checks.optional(checks.whole(1, MOST)), default=None)
    density: float | None = checks.field(checks.optional(checks.real(above=0)), default=None, kw_only=True)
    strength: float = checks.field(checks.real(low=0, high=1), default=0.8, kw_only=True)
    profile: float = checks.field(checks.real(low=1e-3, high=0.999), default=0.4, kw_only=True)
    size_variation: float = checks.field(checks.real(low=0, high=1), default=0.3, kw_only=True)
    within: "Tufts | None" = attrs.field(default=None, kw_only=True)
    __repr__ = brief

    def __attrs_post_init__(self):
        if (self.count is None) == (self.density is None):
            raise Error(f"Tufts.count is {self.count} and Tufts.density is {self.density}; allowed: one of them, the "
                        "other None")
        if self.within is not None and not (isinstance(self.within, Tufts) and self.within.within is None):
            raise Error(f"Tufts.within is {self.within!r:.60}; allowed: None or Tufts without any within")

    def number(self, mesh: Mesh) -> int:
        """How many there are on a mesh; raises Error for too many."""
        if self.density is None:
            return self.count or 1
        if self.density * mesh.area > MOST:
            raise Error(f"Tufts.density is {self.density}, on an area of {mesh.area:g}; allowed: at most {MOST:,} "
                        "tufts in all")
        return max(round(self.density * mesh.area), 1)

    @property
    def levels(self) -> "tuple[Tufts, ...]":
        """These, and those around them."""
        return (self,) if self.within is None else (self, self.within)


@attrs.frozen(eq=False)
class Spots:
    """Where the middles of tufts stand on a mesh.

    faces: [n].  weights: float32 [n, 3] of their corners.  sizes: float64 [n] about 1, how large each tuft is.  turns:
    float32 [n, 3] in the direction of which its curl begins.  spacing: about how far they are apart in world units.
    """

    faces: np.ndarray
    weights: np.ndarray
    sizes: np.ndarray
    turns: np.ndarray
    spacing: float
    __repr__ = brief


def spots_of(tufts: Tufts, mesh: Mesh, rest: Mesh, seed: int) -> Spots:
    """Return `Spots`: the i-th of n at a random place of the i-th n-th of the area that the mesh has in ``rest``."""
    n = tufts.number(rest)
    first, second, third = rest.positions[rest.faces].astype(float).swapaxes(0, 1)
    areas = np.cumsum(np.linalg.norm(np.cross(second - first, third - first), axis=1))
    random = np.random.Generator(np.random.PCG64([seed, n, tufts.within is None])).random((n, 7))
    faces = np.searchsorted(areas, (np.arange(n) + random[:, 0]) / n * areas[-1], side="right")
    faces = np.minimum(faces, len(areas) - 1)
    a, b = random[:, 1:3].T
    folded = a + b > 1
    a, b = np.where(folded, 1 - a, a), np.where(folded, 1 - b, b)
    corners = mesh.positions[mesh.faces[faces]].astype(float)
    # Along the sides of the face and across it, so that it turns with the skin.
    sides = corners[:, 1:] - corners[:, :1]
    across = np.cross(sides[:, 0], sides[:, 1])
    frame = np.concatenate([sides, across[:, None]], 1)
    frame = frame / np.maximum(np.linalg.norm(frame, axis=2, keepdims=True), 1e-30)
    turns = ((2 * random[:, 3:6] - 1)[:, :, None] * frame).sum(1)
    return Spots(faces, np.stack([1 - a - b, a, b], 1).astype(np.float32),
                   1 + 0.9 * tufts.size_variation * (2 * random[:, 6] - 1), turns.astype(np.float32),
                   float(np.sqrt(rest.area / n)))
