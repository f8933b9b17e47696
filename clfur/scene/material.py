"""What the body is painted with."""

import functools
from typing import Any

import attrs
import numpy as np

from . import checks
from .display import brief
from .maps import TILES, tiles
from .mesh import Mesh
from .mips import levels_of
from .origin import copied
from .remembered import remembered
from .strands import texture

WRAPS = "repeat", "mirror", "clamp"   # in the order of `layout.WRAPS`


def _wrap(value, where):
    allowed = f"two of {', '.join(map(repr, WRAPS))}, or one for both"
    pair = (value, value) if isinstance(value, str) else tuple(value) if isinstance(value, (list, tuple)) else ()
    if len(pair) != 2 or not all(isinstance(each, str) and each in WRAPS for each in pair):
        checks.refuse(where, value, allowed)
    return pair


@attrs.frozen(eq=False)
class Material:
    """Base colour of a body, or of those faces of a mesh that it is for: it reflects light as Lambert has it.

    color: linear RGB >= 0 (arrays of uint8 or uint16 are sRGB). texture: None or a picture [h, w, 3] that multiplies
    it, laid on by uv, its top row at v = 1; the same holds for it; stored as linear float32. It is seen bilinear, and
    where it is seen small as the mean of what a sample sees of it. wrap: what is outside of it, along u and v:
    "repeat", "mirror" or "clamp", or one of these for both. Raises Error otherwise.
    """

    color: checks.Given = checks.field(checks.color, default=(1.0, 1.0, 1.0))
    texture: checks.Given = checks.field(checks.optional(texture), default=None)
    wrap: checks.Given = checks.field(_wrap, default=("repeat", "repeat"))
    __repr__ = brief

    @functools.cached_property
    def levels(self) -> list[np.ndarray]:
        """The texture [h, w, 3] at all sizes, each half as large as the one before; none without."""
        return [] if self.texture is None else levels_of(self.texture)

    @functools.cached_property
    def texels(self) -> tuple[tuple[int, int], int, np.ndarray, float]:
        """The texture at all sizes: ((width, height), how many sizes, texels uint16 [n, 4] from the largest size on,
        rows from the top; what 1 of them is)."""
        if self.texture is None:
            return (0, 0), 0, np.zeros((0, 4), np.uint16), 1.0
        levels, scale = self.levels, float(self.texture.max()) / 65535 or 1.0
        texels = np.zeros((sum(level.shape[0] * level.shape[1] for level in levels), 4), np.uint16)
        np.rint(np.concatenate([level.reshape(-1, 3) for level in levels]) / scale, out=texels[:, :3], casting="unsafe")
        return self.texture.shape[1::-1], len(levels), texels, scale


TILED = "a colour, a picture [h, w, 3], a Material, a list of these, or {1001: picture or Material, ...} of UDIM tiles"


@remembered(2)   # what is drawn again must be the very same
def laid_in_tiles(mesh: Mesh, of_number: tuple) -> tuple[Mesh, tuple[Material, ...]]:
    """Return the mesh whose `material_of` are the UDIM tiles in which the middles of its faces' uv lie, of ((number,
    Material), ...), and these Materials, with one that has the colour of the first alone where there is none."""
    numbers = np.array([number for number, _ in of_number])
    column, row = np.floor(mesh.uv.mean(1)).T
    tile = np.where((column >= 0) & (column < 10) & (row >= 0), TILES[0] + column + 10 * row, 0)
    at = np.minimum(np.searchsorted(numbers, tile), len(numbers) - 1)   # they are in their order
    which = np.where(numbers[at] == tile, at, len(numbers)).astype(np.uint32)
    return (copied(mesh, material_of=checks.frozen(which)),
            (*(each for _, each in of_number), Material(of_number[0][1].color)))


def body_color(value: Any, where: str) -> Any:
    """Return what `Scene.body_color` takes: a colour float64 [3], a tuple of Materials, or {number: Material} of UDIM
    tiles."""
    if isinstance(value, dict):
        given = tiles(value, where, TILED, lambda each, at: each if isinstance(each, Material) else Material(
            texture=texture(each, at)), lambda each: 0 if each.texture is None else each.texture.size // 3)
        return given
    if isinstance(value, Material) or (isinstance(value, (tuple, list)) and any(
            isinstance(each, Material) for each in value)):
        return checks.tuple_of(Material)(value, where)
    if getattr(value, "ndim", 0) == 3:
        return (Material(texture=texture(value, where)),)
    return checks.color(value, where)
