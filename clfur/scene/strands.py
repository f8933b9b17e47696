"""Strands that grow on a mesh, and the types of hair that they are of."""

import itertools
import math
from typing import Any

import attrs
import numpy as np

from ..color import linear_of
from ..errors import Error
from . import checks
from .display import brief
from .guides import guides
from .look import Looking
from .maps import WHOLE, Comb, Maps, tiles
from .mesh import Mesh
from .tufts import Tufts


def _radius_and_count(value, where):
    """Return (size >= 0, number) as a tuple: the form of `HairType.curl` and `HairType.wave`."""
    size, number = (float(each) for each in checks.vector(2)(value, where))
    if size < 0:
        checks.refuse(where, value, "two finite numbers, the first >= 0")
    return size, number


def _frizz(value, where):
    """Return (amplitude, waves), both >= 0, as a tuple."""
    size, waves = (float(each) for each in checks.vector(2)(value, where))
    if size < 0 or not 0 <= waves <= 10_000:
        checks.refuse(where, value, "two finite numbers, the first >= 0, the second 0 to 10,000")
    return size, waves


def _textures(value, where):
    """Return what `HairType.color_texture` takes: as `texture` has it, or {number: that} of UDIM tiles."""
    allowed = "None, a picture [h, w, 3], or {1001: picture, ...} of UDIM tiles"
    return _whole_or_tiles(tiles(value, where, allowed, texture))


def texture(value, where):
    """Return linear float32 [h, w, 3] of a picture of colours."""
    allowed = "None or a picture [h, w, 3]: uint8 or uint16 (sRGB), or linear floats >= 0"
    pixels = linear_of(checks.pixels(value, where, "uf", allowed))
    if pixels.dtype.kind != "f":   # whole numbers of a picture that are neither: nobody knows what is white
        checks.refuse(where, value, allowed)
    return checks.float32(pixels, where, checks.LARGEST, 0)


def _key(value, where):
    allowed = "None or (red, green, blue), whole numbers from 0 to 255"
    if (not isinstance(value, (tuple, list)) and getattr(value, "ndim", 0) != 1) or len(value) != 3:
        checks.refuse(where, value, allowed)
    return tuple(checks.whole(0, 255)(part, where) for part in value)


# Fields of the two rules of growth, and what they are unless told.
LAW = {"length": 0.16, "stiffness": 0.625}
RULE = {"segment_length": 0.02, "force_weight": 1.0}


@attrs.frozen(eq=False)
class HairType(Looking):
    """What a kind of hair looks like and how it grows.

    color: linear RGB >= 0 (arrays of uint8 or uint16 are sRGB). color_texture: None or [h, w, 3] that multiplies it,
    looked up at the root's uv; the same holds for it; stored as linear float32. segments: 0..255, 0 is bald. length:
    world units, 0.16 unless told. stiffness: how many of its lengths a hair takes to bend, > 0, 0.625 unless told:
    under a force of 1 across it turns by one radian in so many lengths; twice the force, half of that. These two tell
    the curve, and segments only how smooth it is drawn; a strand that variation makes shorter is the same curve, cut.
    In their place segment_length: world units, 0.02 unless told, and force_weight: how much of the force is added to
    the direction each segment, 1 unless told; the report's rule (section 2.1.3), by which more segments make longer
    and softer hair. width: diameter in world units. curl: (radius, turns). wave:
    (amplitude, periods). length_variation, direction_variation, color_variation: 0..1, how much strands differ; which
    way they lean, curl and wave is drawn in the frame of the skin at the root, so that it turns with it. look: how it
    scatters light, a Kajiya or a Chiang, which sets the color if it has a pigment of its own; or specular and
    exponent, to make a Kajiya. alpha: 0..1, how much light one hair lets through. root_width, tip_width: shares of
    width there, 0..16; between them it changes as taper says, 0.001..0.999: how much of the change is done at half of
    the length; 0.5 is a straight cone, less keeps the root's width for longer (Schlick's bias, "Fast alternatives to
    Perlin's bias and gain functions", 1994). root_color, tip_color: None, then as color, or linear RGB >= 0 that
    takes its place there; linear between. tufts: None, or Tufts, in which strands gather; curl and wave are then of
    each tuft as a whole. frizz: (amplitude, waves), a random line across each strand on top of all. key: None or the
    8-bit (r, g, b) that means this type in `Strands.type_map`. Raises Error otherwise.
    """

    color: checks.Given = checks.field(checks.color, default=(0.8, 0.6, 0.4))
    color_texture: checks.Given = checks.field(checks.optional(_textures), default=None)
    segments: int = checks.field(checks.whole(0, 255), default=8)
    segment_length: float | None = checks.field(checks.optional(checks.real(low=0)), default=None)
    force_weight: float | None = checks.field(checks.optional(checks.real()), default=None)
    width: float = checks.field(checks.real(low=0), default=0.002)
    curl: checks.Given = checks.field(_radius_and_count, default=(0.0, 0.0))
    wave: checks.Given = checks.field(_radius_and_count, default=(0.0, 0.0))
    length_variation: float = checks.field(checks.real(low=0, high=1), default=0.0)
    direction_variation: float = checks.field(checks.real(low=0, high=1), default=0.0)
    color_variation: float = checks.field(checks.real(low=0, high=1), default=0.0)
    alpha: float = checks.field(checks.real(low=0, high=1), default=0.5, kw_only=True)
    length: float | None = checks.field(checks.optional(checks.real(low=0)), default=None, kw_only=True)
    stiffness: float | None = checks.field(checks.optional(checks.real(low=1e-6)), default=None, kw_only=True)
    root_width: float = checks.field(checks.real(low=0, high=16), default=1.0, kw_only=True)
    tip_width: float = checks.field(checks.real(low=0, high=16), default=1.0, kw_only=True)
    taper: float = checks.field(checks.real(low=1e-3, high=0.999), default=0.5, kw_only=True)
    root_color: checks.Given = checks.field(checks.optional(checks.color), default=None, kw_only=True)
    tip_color: checks.Given = checks.field(checks.optional(checks.color), default=None, kw_only=True)
    tufts: Tufts | None = checks.field(checks.instance(Tufts, none=True), default=None, kw_only=True)
    frizz: checks.Given = checks.field(_frizz, default=(0.0, 0.0), kw_only=True)
    key: checks.Given = checks.field(checks.optional(_key), default=None, kw_only=True)
    __repr__ = brief

    def __attrs_post_init__(self):
        super().__attrs_post_init__()
        if self.look.color is not None:
            if self.root_color is not None or self.tip_color is not None:
                raise Error("HairType.look sets the colour by its pigment, and so do root_color or tip_color; allowed: "
                            "one of them")
            object.__setattr__(self, "color", self.look.color)
        law, rule = ([name for name in rule if getattr(self, name) is not None] for rule in (LAW, RULE))
        if law and rule:
            raise Error(f"HairType.{law[0]} and {rule[0]} are of two rules of growth; allowed: length and stiffness, "
                        "or segment_length and force_weight")
        for name, value in (RULE if rule else LAW).items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, value)

    @property
    def step(self) -> float:
        """Length of a segment in world units before it varies, by either rule of growth."""
        return self.segment_length or 0.0 if self.length is None else self.length / max(self.segments, 1)

    @property
    def full_length(self) -> float:
        """The same of a strand."""
        return self.segments * self.step

    @property
    def ends(self) -> tuple:
        """Linear RGB at root and tip."""
        return tuple(self.color if each is None else each for each in (self.root_color, self.tip_color))

    @property
    def widest(self) -> float:
        """The largest diameter along a strand, in world units."""
        return self.width * max(self.root_width, self.tip_width)


@attrs.frozen(eq=False)
class PointForce:
    """A force away from `position` [3] of size strength · exp(−distance); negative strength attracts."""

    position: checks.Given = checks.field(checks.vector(3))
    strength: float = checks.field(checks.real(), default=1.0)
    __repr__ = brief


def levels(shape, words):
    """Return a converter to an int 1..64, or to a read-only int32 array whose shape ends like `shape`."""
    allowed = f"a whole number from 1 to 64, or an array {words} of them"

    def convert(value, where):
        if not isinstance(value, (list, tuple)) and not getattr(value, "ndim", 0):
            return checks.whole(1, 64)(value, where)
        array = checks.numbers(value, where, allowed, kinds="iu")
        if array.ndim != 1 + len(shape) or array.shape[1:] != shape:
            checks.refuse(where, value, allowed)
        bad = (array < 1) | (array > 64)
        if bad.any():
            index = np.unravel_index(np.argmax(bad), array.shape)
            checks.refuse(f"{where}[{', '.join(str(i) for i in index)}]", int(array[index]), allowed)
        return checks.frozen(np.array(array, dtype=np.int32, order="C"))

    return convert


def _type_map(value, where):
    allowed = "None or a picture [h, w, 3] of dtype uint8, as keys of types are, or {1001: picture, ...} of UDIM tiles"

    def keys(value, where):
        pixels = checks.pixels(value, where, "u", allowed)
        if pixels.dtype != np.uint8:
            checks.refuse(where, value, allowed)
        return checks.frozen(np.array(pixels, order="C"))

    return _whole_or_tiles(tiles(value, where, allowed, keys))


def _whole_or_tiles(found):
    """What `tiles` gives, or the picture itself where it is no tile."""
    return found.get(WHOLE, found)


def _roots(value, where):
    if isinstance(value, str) and value == "faces":
        return value
    try:
        return checks.whole(0, 2**31 - 1)(value, where)
    except Error:
        checks.refuse(where, value, f"'faces' or a whole number from 0 to {2**31 - 1}")


SPREAD = 32.0   # of 8-bit colours, how far JPEG moves them at edges


def blends(keys):
    """Return how far, in 8-bit r, g, b, a pixel of a type map may be from the nearest of keys [n, 3]: as far as any
    blend of them is (Jung 1901: of n points at most d apart), which soft brushes leave, and SPREAD more."""
    keys = np.asarray(keys, np.float64)
    apart = max(float(np.sqrt(((keys - key)**2).sum(1)).max()) for key in keys)
    n = min(len(keys) - 1, 3)
    return apart * math.sqrt(n / (2 * n + 2)) + SPREAD


def _nearest(pixels, keys):
    """Return (the nearest of keys [n, 3] to each of pixels [m, 3], int64 [m]; how far it is, float64 [m]); of two as
    near it is the first."""
    found, apart, keys = np.zeros(len(pixels), np.int64), np.zeros(len(pixels)), np.asarray(keys, np.int64)
    for at in range(0, len(pixels), BLOCK):
        square = ((pixels[at:at + BLOCK, None].astype(np.int64) - keys)**2).sum(2)
        found[at:at + BLOCK], apart[at:at + BLOCK] = square.argmin(1), np.sqrt(square.min(1))
    return found, apart


BLOCK = 1 << 12   # pixels that are compared with all keys together


@attrs.frozen(eq=False)
class Strands:
    """Fur grown on a mesh: where the strands have their roots, and what makes them grow.

    inner: tessellation level 1..64, or one for each of the mesh's faces, [F].
    outer: the level of the edges, or [F, 3] of them: outer[f, 0] is the edge between corners 1 and 2 of
    face f, outer[f, 1] between 2 and 0, outer[f, 2] between 0 and 1 (as in OpenGL). F counts the faces that
    the Mesh kept. types: one HairType, or up to 256. type_map: None, or a picture uint8 [h, w, 3] that
    chooses the type by uv, the one whose `key` the colour is nearest to; without it there must be one
    type. roots: "faces" for one strand in each tessellated triangle, or how many to spread evenly by area.
    force: added to the growing direction of all strands; point_forces: PointForce objects, added to it.
    surface: "pn" for curved PN triangles, or "flat". seed: of all that is random, 0..2**32-1. collision: whether growth
    that would enter the mesh slides along it: segments that would are turned about their beginning, and keep their
    lengths. rest: None, or a Mesh of the same faces as the one that is drawn, by whose areas strands are spread: each
    then keeps its place on its face in all poses. Without it they are spread by the areas of what is drawn, and strands
    go to other triangles as these change; where a mesh is but turned, rounding takes a few in ten thousand along. maps:
    None or Maps, what the skin says of density, length, width and so on. comb: None or a Comb, which way hair lies on
    the skin.

    guides: None, or Curves that stand on the mesh in the pose in which it is drawn: strands have the shapes of the
    nearest ones, blended by distance. All else is a type's, but for segment_length and force_weight; of guides points,
    root_normal and type_of count: strands of a type that guides have follow these alone.
    guides_blended: 1 to 7 of them. guides_reach: None, strands stand everywhere; or, above 0, no further from the
    nearest guide than so many times that is from the seventh around it (1: among the guides and a little beyond).
    parting: degrees, 0 to 180; a guide that points elsewhere than the nearest one by more is not blended with it, 180:
    all are. Segments are of equal length along the guides; strands that a map or length_variation makes shorter are cut
    there. Guides of fewer than two points are left out.

    A type_map may be {1001: picture, ...}, UDIM tiles, as those of Maps; where there is none it is the first type's. A
    pixel that is no key has the type of the nearest, as soft brushes and JPEG leave such; those that are further from
    it, as r, g, b, than any blend of the keys by more than 32 are refused. `inexact` counts those taken so.
    `type_indices` uint8 [h, w] is the index into `types` of every pixel of the map, or {1001: that, ...} (None without
    a map). Raises Error for anything else.
    """

    inner: checks.Given = checks.field(levels((), "[faces]"), default=5)
    outer: checks.Given = checks.field(levels((3,), "[faces, 3]"), default=5)
    types: checks.Given = checks.field(checks.tuple_of(HairType), default=(HairType(),))
    type_map: checks.Given = checks.field(checks.optional(_type_map), default=None)
    roots: str | int = checks.field(_roots, default="faces")
    force: checks.Given = checks.field(checks.vector(3), default=(0.0, -1.0, 0.0))
    point_forces: checks.Given = checks.field(checks.tuple_of(PointForce), default=())
    surface: str = checks.field(checks.choice("pn", "flat"), default="pn")
    seed: int = checks.field(checks.whole(0, 2**32 - 1), default=0)
    collision: bool = checks.field(checks.flag, default=False, kw_only=True)
    rest: Mesh | None = checks.field(checks.instance(Mesh, none=True), default=None, kw_only=True)
    guides: checks.Given = checks.field(guides, default=None, kw_only=True)
    guides_blended: int = checks.field(checks.whole(1, 7), default=3, kw_only=True)
    guides_reach: float | None = checks.field(checks.optional(checks.real(above=0, high=1e6)), default=None,
                                              kw_only=True)
    parting: float = checks.field(checks.real(low=0, high=180), default=60.0, kw_only=True)
    maps: Maps | None = checks.field(checks.instance(Maps, none=True), default=None, kw_only=True)
    comb: Comb | None = checks.field(checks.instance(Comb, none=True), default=None, kw_only=True)
    type_indices: Any = attrs.field(init=False, repr=False)
    inexact: int = attrs.field(init=False, repr=False)
    __repr__ = brief

    @property
    def hair_types(self) -> tuple[HairType, ...]:
        """The types that there are: a tuple of HairType."""
        return self.types

    @property
    def hairy(self) -> tuple[bool, ...]:
        """Of each type whether strands of it have segments; others are bald, and nothing else of them counts."""
        return tuple(kind.segments > 0 for kind in self.types)

    @property
    def hairy_types(self) -> tuple[HairType, ...]:
        """Those of the types that are not bald."""
        return tuple(itertools.compress(self.types, self.hairy))

    @property
    def tufted(self) -> bool:
        """Whether strands gather in tufts or are frizzy."""
        return any(kind.tufts is not None or kind.frizz[0] for kind in self.hairy_types)

    @property
    def colored_points(self) -> bool:
        """Whether points have colours of their own, as some type has others at root or tip."""
        return any(kind.root_color is not None or kind.tip_color is not None for kind in self.types)

    def __attrs_post_init__(self):
        if not 1 <= len(self.types) <= 256:
            raise Error(f"Strands.types has {len(self.types)} types; allowed: 1 to 256")
        if self.guides is not None and self.comb is not None:
            raise Error("Strands.comb tells which way hair lies, and so do Strands.guides; allowed: one of them")
        if self.type_map is None and len(self.types) > 1:
            raise Error(
                f"Strands.type_map is None but Strands.types has {len(self.types)} types; "
                "allowed: one type without a type_map"
            )
        indices, inexact = (None, 0) if self.type_map is None else self._types_of_pixels()
        object.__setattr__(self, "type_indices", indices)
        object.__setattr__(self, "inexact", inexact)

    def _types_of_pixels(self):
        """(`type_indices`, `inexact`) of the type map."""
        keys = [hair.key for hair in self.types]
        if None in keys:
            raise Error(f"HairType.key of Strands.types[{keys.index(None)}] is None; "
                        "allowed: (r, g, b) for every type when there is a type_map")
        if len(set(keys)) < len(keys):
            twice = next(key for key in keys if keys.count(key) > 1)
            raise Error(f"HairType.key {twice} is that of more than one of Strands.types; "
                        "allowed: distinct keys")
        found, inexact = {}, 0
        for number, picture in (self.type_map if isinstance(self.type_map, dict) else {WHOLE: self.type_map}).items():
            pixels = picture.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
            packed, which, counts = np.unique(pixels, return_inverse=True, return_counts=True)
            colors = np.stack([packed >> 16, packed >> 8 & 255, packed & 255], 1)
            nearest, apart = _nearest(colors, keys)
            if (apart > blends(keys)).any():
                raise Error(_no_keys(keys, colors[apart > blends(keys)], counts[apart > blends(keys)]))
            found[number] = checks.frozen(nearest.astype(np.uint8)[which].reshape(pixels.shape))
            inexact += int(counts[apart > 0].sum())
        return _whole_or_tiles(found), inexact


def _no_keys(keys, colors, counts):
    """What to say of colours [n, 3] of a type map, so many of each, that are near no key."""
    colors = colors[np.argsort(-counts, kind="stable")].tolist()
    names = ", ".join(str(tuple(color)) for color in colors[:8])
    more = f" and {len(colors) - 8} more" if len(colors) > 8 else ""
    known = ", ".join(str(key) for key in keys[:8]) + (", ..." if len(keys) > 8 else "")
    return f"Strands.type_map has colours that are no type's key: {names}{more}; allowed: {known}, and what is near"
