"""Strands that the user brings."""

import functools
import itertools

import attrs
import numpy as np

from ..color import linear_of
from ..errors import Error
from . import checks
from .display import brief
from .look import Looking
from .origin import ZERO, copied, near_origin, origin
from .strands import HairType, levels

PLACED = "points", "width", "color", "root_uv", "root_normal"   # arrays that may be on a device


def _points(value, where):
    allowed = "an array [strands, points, 3], or [total, 3] with counts, of numbers"
    array = checks.placed(value, where, allowed)
    if array.ndim not in (2, 3) or array.shape[-1] != 3:
        checks.refuse(where, value, allowed)
    return array


def _counts(value, where):
    allowed = "an array [strands] of whole numbers >= 0"
    array = checks.numbers(value, where, allowed, kinds="iu")
    if array.ndim != 1 or (array.size and (int(array.min()) < 0 or int(array.max()) >= 2**32)):
        checks.refuse(where, value, allowed)
    return checks.frozen(array.astype(np.uint32))


class _OfStrands(np.ndarray):
    """Values that are of strands, also where there are as many points: what is stored can be given again."""


def _values(value, where):
    if isinstance(value, _OfStrands):
        return value
    return checks.placed(value, where, "numbers >= 0")


def _colors(value, where):
    """As `_values`; on a device it is float32, linear light."""
    values = _values(value, where)
    return values if checks.is_on_device(values) else linear_of(values)


def _of_roots(columns):
    """Return a converter to float32 [strands, columns], or an array of this shape on a device."""
    allowed = f"None or an array [strands, {columns}] of numbers"

    def convert(value, where):
        array = checks.placed(value, where, allowed)
        if array.ndim != 2 or array.shape[1] != columns:
            checks.refuse(where, value, allowed)
        return array if checks.is_on_device(array) else checks.float32(array, where, checks.LARGEST)

    return convert


def _type_of(value, where):
    allowed = "None or an array [strands] of whole numbers from 0 to 255"
    array = checks.numbers(value, where, allowed, kinds="iu")
    if array.ndim != 1 or (array.size and not 0 <= int(array.min()) <= int(array.max()) <= 255):
        checks.refuse(where, value, allowed)
    return checks.frozen(array.astype(np.uint8))


@attrs.frozen(eq=False)
class Bounds:
    """What strands cannot exceed: what cameras, the light's grid and its counters must have room for.

    center [3], radius: a sphere that holds all of them, and the mesh that they stand on. segments, length (world),
    area (world squared): of all strands together, how many segments they have, how long they are, and their length
    times their width. Raises Error for anything else.
    """

    center: checks.Given = checks.field(checks.vector(3))
    radius: float = checks.field(checks.real(low=0))
    segments: int = checks.field(checks.whole(0, 2**63))
    length: float = checks.field(checks.total)
    area: float = checks.field(checks.total)
    __repr__ = brief


@attrs.frozen(eq=False)
class Curves(Looking):
    """Strands that the user brings, as polylines.

    points: [strands, points, 3], or [total, 3] with counts [strands] when strands differ in length; the root
    comes first. width: diameter in world units >= 0: one, [strands] or [strands, 1], or one for each point ([total], or
    [strands, points]). color: RGB >= 0, shaped like width with [..., 3]: arrays of uint8 or uint16 are sRGB, all other
    numbers linear light. No strands at all are allowed.
    types: what strands look like and how much light they let through: HairType objects, up to 256; their color and
    width hold where color and width are not given; nothing that makes hair grow is used, nor variation, nor textures.
    Or None, and look (a Kajiya or a Chiang; or specular and exponent, to make a Kajiya) and alpha (0..1, how much light
    one hair lets through) say it for all. type_of: [strands] which of types each is of, needed where there are several.
    root_uv: [strands, 2], for the output "uv". root_normal: [strands, 3] unit normals of the mesh at the roots, by
    which its shadow does not fall on hair that lies on it. origin: [3] what points are relative to, 0 if not given.
    inner, outer, surface: how the mesh under them is tessellated, as in Strands. seed: by which `Settings.lod` chooses
    strands. lod_by: what else it goes by, "place", where a strand's ends are, so that strands may be given in any order
    and from either end; or "number", that of a strand, so that the same ones are chosen in a film in which they move.
    bounds: what they cannot exceed, or None to measure it.

    points, width, color, root_uv and root_normal may be float32 arrays on an OpenCL device (pyopencl.array.Array),
    which are drawn without a copy by a `Scheduler` of the same context. Their values are not checked, and without
    bounds they are read back once. Do not change them in place: what is made of the same Curves is kept. Make new
    Curves of the changed array.

    As stored: `points` float32 [total, 3], relative to `origin` float64 [3], as in Mesh (on a device the origin is as
    given), `counts` uint32 [strands], `uniform` the points per strand where
    all have the same, else None, `width` float32 [1], [strands] or [total], `color` float32 [1, 3],
    [strands, 3] or [total, 3]. Raises Error for other shapes and values, and for a width or colour
    that could be meant per strand or per point.
    """

    points: checks.Given = checks.field(_points)
    counts: checks.Given = checks.field(checks.optional(_counts), default=None)
    width: checks.Given = checks.field(checks.optional(_values), default=None)
    color: checks.Given = checks.field(checks.optional(_colors), default=None)
    alpha: float = checks.field(checks.real(low=0, high=1), default=0.5, kw_only=True)
    types: checks.Given = checks.field(checks.optional(checks.tuple_of(HairType)), default=None, kw_only=True)
    type_of: checks.Given = checks.field(checks.optional(_type_of), default=None, kw_only=True)
    root_uv: checks.Given = checks.field(checks.optional(_of_roots(2)), default=None, kw_only=True)
    root_normal: checks.Given = checks.field(checks.optional(_of_roots(3)), default=None, kw_only=True)
    inner: checks.Given = checks.field(levels((), "[faces]"), default=1, kw_only=True)
    outer: checks.Given = checks.field(levels((3,), "[faces, 3]"), default=1, kw_only=True)
    surface: str = checks.field(checks.choice("pn", "flat"), default="flat", kw_only=True)
    seed: int = checks.field(checks.whole(0, 2**32 - 1), default=0, kw_only=True)
    lod_by: str = checks.field(checks.choice("place", "number"), default="place", kw_only=True)
    bounds: Bounds | None = checks.field(checks.instance(Bounds, none=True), default=None, kw_only=True)
    origin: checks.Given = checks.field(origin, default=ZERO, kw_only=True)
    uniform: int | None = attrs.field(init=False)
    __repr__ = brief

    def __attrs_post_init__(self):
        super().__attrs_post_init__()
        points, counts, place = self.points, self.counts, self.origin
        if not checks.is_on_device(points):
            points, place = near_origin(points, place, "Curves.points")
        if points.ndim == 3:
            if counts is not None:
                checks.refuse("Curves.counts", counts, "None when points is [strands, points, 3]")
            counts = checks.frozen(np.full(len(points), points.shape[1], np.uint32))
            points = points.reshape(points.shape[0] * points.shape[1], 3)
        elif counts is None:
            checks.refuse("Curves.counts", counts, "an array [strands] when points is [total, 3]")
        elif int(counts.sum(dtype=np.uint64)) != len(points):
            raise Error(f"Curves.counts add up to {counts.sum(dtype=np.uint64)}; "
                        f"allowed: {len(points)}, the number of points")
        same = not len(counts) or bool((counts == counts[0]).all())
        uniform = (int(counts[0]) if len(counts) else 0) if same else None
        self._check_types(len(counts))
        sizes = len(counts), len(points), uniform
        for name, value in [
            ("points", points),
            ("origin", place),
            ("counts", counts),
            ("uniform", uniform),
            ("width", _spread(self._given("width"), (), *sizes, "Curves.width")),
            ("color", _spread(self._given("color"), (3,), *sizes, "Curves.color")),
        ]:
            object.__setattr__(self, name, value)

    def _given(self, name):
        """Width or color as it was given, else what the types say: one for all, or [strands, 1(, 3)]."""
        if getattr(self, name) is not None:
            return getattr(self, name)
        of_types = np.array([getattr(kind, name) for kind in self.hair_types], np.float64)
        return of_types[0] if len(of_types) == 1 else of_types[self.type_of][:, None]

    def _check_types(self, strands):
        for name in ("type_of", "root_uv", "root_normal"):
            if (value := getattr(self, name)) is not None and len(value) != strands:
                raise Error(f"Curves.{name} has {len(value)} rows; allowed: {strands}, one for each strand")
        if self.types is not None and not 1 <= len(self.types) <= 256:
            raise Error(f"Curves.types has {len(self.types)} types; allowed: 1 to 256")
        for_all = self._look, self._specular, self._exponent, self.alpha
        if self.types is not None and for_all != (None, None, None, 0.5):
            raise Error("Curves.types say what strands look like, and so do look, specular, exponent or alpha; "
                        "allowed: one of them")
        kinds = len(self.hair_types)
        if self.type_of is None and kinds > 1:
            raise Error(f"Curves.type_of is None but Curves.types has {kinds} types; "
                        "allowed: an array [strands] of their numbers")
        if self.type_of is not None and len(self.type_of) and int(self.type_of.max()) >= kinds:
            raise Error(f"Curves.type_of has {int(self.type_of.max())}; allowed: 0 to {kinds - 1}, as there are "
                        f"{kinds} types")

    @functools.cached_property
    def hair_types(self) -> tuple[HairType, ...]:
        """The types that there are, also where none are given: a tuple of HairType."""
        return self.types or (HairType(look=self.look, alpha=self.alpha),)

    @functools.cached_property
    def hairy(self) -> tuple[bool, ...]:
        """Of each type whether there are strands of it that have segments."""
        of_type, n = np.zeros(len(self.counts), int) if self.type_of is None else self.type_of, len(self.hair_types)
        return tuple((np.bincount(of_type[self.counts > 1], minlength=n) > 0).tolist())

    @property
    def hairy_types(self) -> tuple[HairType, ...]:
        """The types of strands that have segments."""
        return tuple(itertools.compress(self.hair_types, self.hairy))

    @functools.cached_property
    def on_host(self) -> "Curves":
        """The same Curves with no array on a device."""
        there = {name: getattr(self, name) for name in PLACED if checks.is_on_device(getattr(self, name))}
        if not there:
            return self
        host = attrs.evolve(self, **{name: array.get() for name, array in there.items()})
        places = checks.frozen(self.points.get()) if "points" in there else self.points
        return copied(host, points=places, origin=self.origin)


def _spread(values, tail, strands, total, uniform, where):
    """Return values as float32 [1, *tail], [strands, *tail] or [total, *tail]; anything else is an Error."""
    shapes = {tail: "for all", (1, *tail): "for all", (strands, *tail): "per strand", (strands, 1, *tail): "per strand",
              (total, *tail): "per point"}
    if uniform is not None:
        shapes[(strands, uniform, *tail)] = "per point"
    allowed = "one for all, " + " or ".join(
        f"{list(shape)} {meaning}" for shape, meaning in shapes.items() if meaning != "for all"
    )
    on_device = checks.is_on_device(values)
    if values.shape not in shapes or (not on_device and values.dtype.kind == "f" and np.isnan(values).any()):
        checks.refuse(where, values, allowed + ", of finite numbers >= 0")
    unclear = strands == total != 1 and strands and uniform != 1
    if unclear and values.shape == (strands, *tail) and not isinstance(values, _OfStrands):
        raise Error(f"{where} of shape {list(values.shape)} could be per strand or per point, as there are "
                    f"as many points as strands; allowed: one for all, or {[strands, 1, *tail]} per strand")
    if on_device:
        return values.reshape(values.size // int(np.prod(tail, dtype=int)), *tail)
    values = checks.float32(values, where, checks.LARGEST, 0).reshape(-1, *tail)
    if unclear and len(values) == strands:
        values = values.view(_OfStrands)
    # No strands need no values, but an empty array would be trouble for every buffer down the line.
    return values if len(values) else checks.frozen(np.zeros((1, *tail), np.float32))
