"""What to draw: meshes, fur, cameras and lights, as frozen classes that check themselves when they are made.

Lengths are in the mesh's own units, angles in degrees, colours linear. The world is right-handed with +Y up.
Arrays are copied on the way in and are read-only, so that a scene never changes under a renderer.
"""

import functools
import math
import operator

import attrs
import numpy as np

from .errors import Error

LARGEST = 1e9   # of single numbers: their squares' squares must stay finite on the device


# --- small helpers that turn what a user gave into what is stored ---------------------------------------


def _shown(value):
    """Return `value` as a short text on one line."""
    if isinstance(value, np.ndarray) and value.ndim and value.size > 4:
        return f"an array of {value.dtype} {list(value.shape)}"
    text = " ".join(repr(value).split())
    return text if len(text) <= 80 else text[:77] + "..."


def _refuse(where, value, allowed):
    raise Error(f"{where} is {_shown(value)}; allowed: {allowed}")


def _to(convert):
    """Return the attrs converter to `convert(value, where)`, where `where` is "Class.field"."""

    def converter(value, instance, field):
        return convert(value, f"{type(instance).__name__}.{field.name}")

    return attrs.Converter(converter, takes_self=True, takes_field=True)


def _real(low=-math.inf, high=math.inf, above=None, below=None):
    """Return a converter to a finite float: low <= value <= high, above < value < below."""
    words = [f">= {low:g}"] if low > -math.inf else []
    words += [f"<= {high:g}"] if high < math.inf else []
    words += [f"> {above:g}"] if above is not None else []
    words += [f"< {below:g}"] if below is not None else []
    allowed = " and ".join(["a finite number" + (" " if words else "") + ", ".join(words)])

    def convert(value, where):
        try:
            number = math.nan if isinstance(value, (bool, np.bool_, str, bytes)) else float(value)
        except (TypeError, ValueError, OverflowError):
            number = math.nan
        good = abs(number) <= LARGEST and low <= number <= high
        good = good and (above is None or number > above) and (below is None or number < below)
        return number if good else _refuse(where, value, allowed)

    return convert


def _whole(low, high):
    """Return a converter to an int from low to high."""

    def convert(value, where):
        allowed = f"a whole number from {low} to {high}"
        try:
            number = operator.index(value)
        except TypeError:
            _refuse(where, value, allowed)
        if isinstance(value, (bool, np.bool_)) or not low <= number <= high:
            _refuse(where, value, allowed)
        return number

    return convert


def _choice(*names):
    def convert(value, where):
        if not isinstance(value, str) or value not in names:
            _refuse(where, value, " or ".join(repr(name) for name in names))
        return value

    return convert


def _instance(*classes, none=False):
    """Return a converter that lets through objects of these classes (and None if `none`)."""

    def convert(value, where):
        if not (isinstance(value, classes) or (none and value is None)):
            names = [each.__name__ for each in classes] + ["None"] * none
            _refuse(where, value, "an object of class " + " or ".join(names))
        return value

    return convert


def _tuple_of(kind):
    """Return a converter to a tuple of objects of class `kind`; one object alone becomes a tuple of one."""

    def convert(value, where):
        items = (value,) if isinstance(value, kind) else value
        if not isinstance(items, (tuple, list)) or not all(isinstance(item, kind) for item in items):
            _refuse(where, value, f"one {kind.__name__} or a list of them")
        return tuple(items)

    return convert


def _numbers(value, where, allowed, kinds="iuf"):
    """Return `value` as an array of numbers (kinds: the dtype kinds allowed); not yet a copy."""
    try:
        array = np.asarray(value)
    except (ValueError, TypeError):
        _refuse(where, value, allowed)
    if array.dtype.kind not in kinds and array.size:
        _refuse(where, value, allowed)
    return array


def _frozen(array):
    array.flags.writeable = False
    return array


def _float32(array, where):
    """Return a read-only contiguous float32 copy of a number array; Error names the first bad element."""
    with np.errstate(over="ignore"):
        copy = np.array(array, dtype=np.float32, order="C")
    if not np.isfinite(copy).all():
        index = np.unravel_index(np.argmin(np.isfinite(copy)), copy.shape)
        at = ", ".join(str(i) for i in index)
        raise Error(f"{where}[{at}] is {array[index]}; allowed: finite numbers that float32 can hold")
    return _frozen(copy)


def _vector(length, low=-math.inf):
    """Return a converter to a read-only float64 array [length] of finite numbers >= low."""
    allowed = f"{length} finite numbers" + (f" >= {low:g}" if low > -math.inf else "")

    def convert(value, where):
        array = _numbers(value, where, allowed)
        if array.shape != (length,):
            _refuse(where, value, allowed)
        array = array.astype(np.float64)
        if not (np.abs(array) <= LARGEST).all() or (array < low).any():
            _refuse(where, value, allowed)
        return _frozen(array)

    return convert


_color = _vector(3, low=0)


def _optional(convert):
    return lambda value, where: None if value is None else convert(value, where)


def _radius_and_count(value, where):
    """Return (size >= 0, number) as a tuple: the form of `HairType.curl` and `HairType.wave`."""
    size, number = (float(each) for each in _vector(2)(value, where))
    if size < 0:
        _refuse(where, value, "two finite numbers, the first >= 0")
    return size, number


def _size(value, where):
    allowed = "(width, height), whole numbers from 1 to 16384"
    try:
        width, height = value
    except (TypeError, ValueError):
        _refuse(where, value, allowed)
    return _whole(1, 16384)(width, where), _whole(1, 16384)(height, where)


def srgb_to_linear(values):
    """Return linear light of sRGB-coded values.

    values: array of any shape; uint8 is 0..255, floats are 0..1. Returns float32 of the same shape.
    The exact two-part curve of IEC 61966-2-1.
    """
    values = np.asarray(values)
    if values.dtype == np.uint8:  # 256 results are enough for any picture
        return srgb_to_linear(np.arange(256) / 255.0)[values]
    coded = np.maximum(values.astype(np.float64), 0)
    linear = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    return linear.astype(np.float32)


def _pixels(value, where, kinds, allowed):
    """Return a picture's first three channels [h, w, 3], h and w >= 1; not a copy."""
    array = _numbers(value, where, allowed, kinds)
    if array.ndim != 3 or array.shape[2] not in (3, 4) or 0 in array.shape:
        _refuse(where, value, allowed)
    return array[:, :, :3]


# --- the mesh -------------------------------------------------------------------------------------------


def _rows(columns, kinds="iuf"):
    """Return a converter to an array [n, columns] of numbers (not yet a copy, not yet checked for NaN)."""
    allowed = f"an array [n, {columns}] of " + ("numbers" if "f" in kinds else "whole numbers")

    def convert(value, where):
        if value is None:
            _refuse(where, value, allowed)
        array = _numbers(value, where, allowed, kinds)
        if array.ndim != 2 or array.shape[1] != columns:
            _refuse(where, value, allowed)
        return array

    return convert


def _uv_array(value, where):
    allowed = "None, an array [vertices, 2] or an array [faces, 3, 2] of numbers"
    if value is None:
        return None
    array = _numbers(value, where, allowed)
    if array.shape[1:] not in ((2,), (3, 2)):
        _refuse(where, value, allowed)
    return array


def _first_of_equal_rows(rows):
    """Return, for each row of rows [n, 3], the index of the first row with the same numbers: int64 [n]."""
    order = np.lexsort(rows.T)  # stable: among equal rows the first stays first
    ordered = rows[order]
    new = np.ones(len(rows), bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    first = np.empty(len(rows), np.int64)
    first[order] = order[new][np.cumsum(new) - 1]
    return first


def _sums(values, index, count):
    """Return the sums of values [n, 3] by index [n]: float64 [count, 3]."""
    return np.stack([np.bincount(index, values[:, k], count) for k in range(3)], axis=1)


@attrs.frozen(eq=False)
class Mesh:
    """A triangle mesh with smooth normals, welded so that it has no seams.

    positions: [V, 3] finite numbers.
    normals: None or [V, 3]; need not be unit length; where zero, not finite or None, they are computed.
    uv: None, [V, 2] per vertex or [F, 3, 2] per corner; (0, 0) is the lower left corner of a picture (as in
    OBJ files), and pictures repeat outside 0..1.
    faces: [F, 3] whole numbers 0 to V-1, counter-clockwise seen from outside. Required.

    As stored: `positions` float32 [P, 3] holds each position once (files split vertices where uv or normals
    jump, and fur would part there), in the order given, without those that no face uses. `normals`
    float32 [P, 3] are unit: the mean of the given ones at that position, or of the faces' weighted by area.
    `uv` float32 [F', 3, 2] is kept by corner (zeros where none was given: see `has_uv`), `faces` is
    uint32 [F', 3]. Faces without area and faces at a point where all normals cancel are left out;
    `degenerate_faces` and `zero_normal_faces` count them, and `kept_faces` int64 [F'] says which of the
    given faces the stored ones are. Raises Error for other shapes, NaN or infinity, indices out of range,
    and when no face is left.
    """

    positions: np.ndarray = attrs.field(converter=_to(_rows(3)))
    normals: np.ndarray = attrs.field(converter=_to(_optional(_rows(3))), default=None)
    uv: np.ndarray = attrs.field(converter=_to(_uv_array), default=None)
    faces: np.ndarray = attrs.field(converter=_to(_rows(3, kinds="iu")), default=None)
    has_uv: bool = attrs.field(init=False)
    degenerate_faces: int = attrs.field(init=False)
    zero_normal_faces: int = attrs.field(init=False)
    kept_faces: np.ndarray = attrs.field(init=False, repr=False)

    def __attrs_post_init__(self):
        given = _float32(self.positions, "Mesh.positions") + np.float32(0)  # + 0 turns -0.0 into 0.0
        faces = self.faces.astype(np.int64)
        corner_uv = self._check(given, self.faces)

        # Weld: from here on a vertex is called by the index of the first given one at the same position.
        first = _first_of_equal_rows(given)
        welded = first[faces]
        normal, longest = _face_normals(given, welded)
        twice_area = np.sqrt((normal**2).sum(axis=1))
        has_area = twice_area > 2e-12 * longest**2
        degenerate = len(faces) - int(has_area.sum())

        keep = np.flatnonzero(has_area)
        normals = self._vertex_normals(first, faces[keep], normal[keep])
        has_normals = (normals[welded[keep]] != 0).any(axis=2).all(axis=1)
        zero_normal = len(keep) - int(has_normals.sum())
        keep = keep[has_normals]
        if not len(keep):
            raise Error(
                f"Mesh.faces has no face that can be drawn: of {len(faces)}, {degenerate} are degenerate and "
                f"{zero_normal} have a zero normal; allowed: at least one face with an area and normals"
            )

        used, stored_faces = np.unique(welded[keep], return_inverse=True)
        uv = np.zeros((len(keep), 3, 2), np.float32) if corner_uv is None else corner_uv[keep]
        self._store(
            positions=_frozen(given[used]),
            normals=_frozen(normals[used].astype(np.float32)),
            uv=_frozen(uv),
            faces=_frozen(stored_faces.reshape(-1, 3).astype(np.uint32)),
            has_uv=corner_uv is not None,
            degenerate_faces=degenerate,
            zero_normal_faces=zero_normal,
            kept_faces=_frozen(keep),
        )

    def _store(self, **fields):
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    def _check(self, positions, faces):
        """Check how the given arrays fit together; return uv by corner, float32 [F, 3, 2], or None."""
        if not len(faces):
            raise Error("Mesh.faces is empty; allowed: at least one face")
        if int(faces.min()) < 0 or int(faces.max()) >= len(positions):
            worst = int(faces.min()) if int(faces.min()) < 0 else int(faces.max())
            raise Error(
                f"Mesh.faces has the index {worst}; allowed: 0 to {len(positions) - 1}, "
                f"since there are {len(positions)} positions"
            )
        if self.normals is not None and len(self.normals) != len(positions):
            _refuse("Mesh.normals", self.normals, f"None or [{len(positions)}, 3], one for each position")
        if self.uv is None:
            return None
        allowed = f"None, [{len(positions)}, 2] per vertex or [{len(faces)}, 3, 2] per corner"
        if self.uv.shape not in ((len(positions), 2), (len(faces), 3, 2)):
            _refuse("Mesh.uv", self.uv, allowed)
        uv = _float32(self.uv, "Mesh.uv")
        return uv[faces] if uv.ndim == 2 else uv

    def _vertex_normals(self, first, faces, face_normals):
        """Return unit normals float64 [V, 3], at the first given vertex of each position, else zero.

        first: [V] the first vertex at the same position. faces: [K, 3] as given. face_normals: [K, 3] of
        length proportional to the area. Where normals cancel to rounding error the result is zero.
        """
        count = len(first)
        corner = first[faces].ravel()
        by_area = np.repeat(face_normals, 3, axis=0)
        areas = np.bincount(corner, np.sqrt((by_area**2).sum(axis=1)), count)
        result = _unit_unless_cancelled(_sums(by_area, corner, count), areas)
        if self.normals is None:
            return result
        used = np.unique(faces)
        with np.errstate(invalid="ignore"):
            given = self.normals[used].astype(np.float64)
        size = np.abs(given).max(axis=1, keepdims=True)
        good = (np.isfinite(size) & (size > 0)).ravel()
        given = given[good] / size[good]  # first by the largest part: no square can overflow or vanish
        given /= np.sqrt((given**2).sum(axis=1, keepdims=True))
        corner = first[used][good]
        mean = _unit_unless_cancelled(_sums(given, corner, count), np.bincount(corner, minlength=count))
        return np.where((mean != 0).any(axis=1, keepdims=True), mean, result)

    @functools.cached_property
    def hull(self):
        """Points whose convex hull holds the curved (PN) surface, float64 [n, 3] (Vlachos et al. 2001)."""
        return _hull(self)

    @functools.cached_property
    def area(self):
        """Area of all faces, flat, in world units squared."""
        return float(np.sqrt((_face_normals(self.positions, self.faces)[0] ** 2).sum(axis=1)).sum() / 2)

    @functools.cached_property
    def longest_edge(self):
        """Length of the longest side of a face, flat."""
        return float(_face_normals(self.positions, self.faces)[1].max())

    @functools.cached_property
    def bounds(self):
        """The sphere around the box of the positions: (centre float64 [3], radius float)."""
        return _sphere(*_box(self.positions))


def _hull(mesh):
    """Control points of the mesh's PN triangles, float64 [10 F, 3]: their convex hull holds the surface."""
    p = mesh.positions.astype(np.float64)[mesh.faces]   # [F, 3, 3]
    n = mesh.normals.astype(np.float64)[mesh.faces]
    sides = []
    for shift in (1, 2):
        d = np.roll(p, -shift, axis=1) - p
        sides.append(p + (d - (d * n).sum(2, keepdims=True) * n) / 3)
    middle = np.concatenate(sides, 1).mean(1, keepdims=True) * 1.5 - p.mean(1, keepdims=True) / 2
    return np.concatenate([p, *sides, middle], 1).reshape(-1, 3)


def _face_normals(positions, faces):
    """Return (cross products of two edges float64 [F, 3], longest edges float64 [F])."""
    corners = positions.astype(np.float64)[faces]
    edges = np.roll(corners, -1, axis=1) - corners
    normal = np.cross(edges[:, 0], edges[:, 1])
    return normal, np.sqrt((edges**2).sum(axis=2)).max(axis=1)


def _unit_unless_cancelled(sums, weights):
    """Return the sums [n, 3] as unit vectors, zero where they are rounding errors against weights [n]."""
    length = np.sqrt((sums**2).sum(axis=1))
    good = length > 1e-6 * weights
    return np.where(good, 1, 0)[:, None] * sums / np.where(good, length, 1)[:, None]


def _box(positions):
    """Return the (low, high) corners, float64 [3] each, of positions [n, 3], n >= 1."""
    columns = [positions[:, i] for i in range(3)]   # ten times as fast as a reduction over the first axis
    return np.array([c.min() for c in columns], np.float64), np.array([c.max() for c in columns], np.float64)


def _sphere(low, high):
    return (low + high) / 2, float(np.sqrt(((high - low) ** 2).sum()) / 2)


# --- fur ------------------------------------------------------------------------------------------------


def _texture(value, where):
    allowed = "None or a picture [h, w, 3]: uint8 (sRGB), or linear floats >= 0"
    pixels = _pixels(value, where, "uf", allowed)
    if pixels.dtype == np.uint8:
        return _frozen(np.ascontiguousarray(srgb_to_linear(pixels)))
    if pixels.dtype.kind != "f":
        _refuse(where, value, allowed)
    linear = _float32(pixels, where)
    if (linear < 0).any():
        _refuse(where, value, allowed)
    return linear


def _key(value, where):
    allowed = "None or (red, green, blue), whole numbers from 0 to 255"
    if not isinstance(value, (tuple, list, np.ndarray)) or len(value) != 3:
        _refuse(where, value, allowed)
    return tuple(_whole(0, 255)(part, where) for part in value)


@attrs.frozen(eq=False)
class HairType:
    """What a kind of hair looks like and how it grows.

    color: linear RGB >= 0. color_texture: None or [h, w, 3] that multiplies it, looked up at the root's uv;
    uint8 is read as sRGB, floats as linear; stored as linear float32. segments: 0..255, 0 is bald.
    segment_length: world units. force_weight: how much of the force is added to the direction each segment.
    width: diameter in world units. curl: (radius, turns). wave: (amplitude, periods). length_variation,
    direction_variation, color_variation: 0..1, how much strands differ (a direction_variation above .57 lets some
    grow inwards). specular: strength >= 0. exponent: of the highlight, > 0. alpha: 0..1, how much light one hair
    lets through. key: None or the 8-bit (r, g, b) that means this type in `Strands.type_map`. Raises Error otherwise.
    """

    color: np.ndarray = attrs.field(converter=_to(_color), default=(0.8, 0.6, 0.4))
    color_texture: np.ndarray = attrs.field(converter=_to(_optional(_texture)), default=None)
    segments: int = attrs.field(converter=_to(_whole(0, 255)), default=8)
    segment_length: float = attrs.field(converter=_to(_real(low=0)), default=0.02)
    force_weight: float = attrs.field(converter=_to(_real()), default=1.0)
    width: float = attrs.field(converter=_to(_real(low=0)), default=0.002)
    curl: tuple = attrs.field(converter=_to(_radius_and_count), default=(0.0, 0.0))
    wave: tuple = attrs.field(converter=_to(_radius_and_count), default=(0.0, 0.0))
    length_variation: float = attrs.field(converter=_to(_real(low=0, high=1)), default=0.0)
    direction_variation: float = attrs.field(converter=_to(_real(low=0, high=1)), default=0.0)
    color_variation: float = attrs.field(converter=_to(_real(low=0, high=1)), default=0.0)
    specular: float = attrs.field(converter=_to(_real(low=0)), default=0.3)
    exponent: float = attrs.field(converter=_to(_real(above=0)), default=150.0)
    alpha: float = attrs.field(converter=_to(_real(low=0, high=1)), default=0.5)
    key: tuple = attrs.field(converter=_to(_optional(_key)), default=None)


@attrs.frozen(eq=False)
class PointForce:
    """A force away from `position` [3] of size strength · exp(−distance); negative strength attracts."""

    position: np.ndarray = attrs.field(converter=_to(_vector(3)))
    strength: float = attrs.field(converter=_to(_real()), default=1.0)


def _levels(shape, words):
    """Return a converter to an int 1..64, or to a read-only int32 array whose shape ends like `shape`."""
    allowed = f"a whole number from 1 to 64, or an array {words} of them"

    def convert(value, where):
        if not isinstance(value, (np.ndarray, list, tuple)):
            return _whole(1, 64)(value, where)
        array = _numbers(value, where, allowed, kinds="iu")
        if array.ndim != 1 + len(shape) or array.shape[1:] != shape:
            _refuse(where, value, allowed)
        bad = (array < 1) | (array > 64)
        if bad.any():
            index = np.unravel_index(np.argmax(bad), array.shape)
            _refuse(f"{where}[{', '.join(str(i) for i in index)}]", int(array[index]), allowed)
        return _frozen(np.array(array, dtype=np.int32, order="C"))

    return convert


def _type_map(value, where):
    allowed = "None or a picture [h, w, 3] of dtype uint8"
    pixels = _pixels(value, where, "u", allowed)
    if pixels.dtype != np.uint8:
        _refuse(where, value, allowed)
    return _frozen(np.array(pixels, order="C"))


def _roots(value, where):
    if isinstance(value, str) and value == "faces":
        return value
    try:
        return _whole(0, 2**31 - 1)(value, where)
    except Error:
        _refuse(where, value, f"'faces' or a whole number from 0 to {2**31 - 1}")


def _packed(rgb):
    """Return 8-bit colours [..., 3] as one number each: uint32 [...], 0xRRGGBB."""
    rgb = np.asarray(rgb, dtype=np.uint32)
    return rgb[..., 0] << 16 | rgb[..., 1] << 8 | rgb[..., 2]


@attrs.frozen(eq=False)
class Strands:
    """Fur grown on a mesh: where the strands have their roots, and what makes them grow.

    inner: tessellation level 1..64, or one for each of the mesh's faces, [F].
    outer: the level of the edges, or [F, 3] of them: outer[f, 0] is the edge between corners 1 and 2 of
    face f, outer[f, 1] between 2 and 0, outer[f, 2] between 0 and 1 (as in OpenGL). F counts the faces that
    the Mesh kept. types: one HairType, or up to 256. type_map: None, or a picture uint8 [h, w, 3] that
    chooses the type by uv, every colour of which must be the `key` of a type; without it there must be one
    type. roots: "faces" for one strand in each tessellated triangle, or how many to spread evenly by area.
    force: added to the growing direction of all strands; point_forces: PointForce objects, added to it.
    surface: "pn" for curved PN triangles, or "flat". seed: of all that is random, 0..2**32-1.

    `type_indices` uint8 [h, w] is the index into `types` of every pixel of the map (None without a map).
    Raises Error for anything else.
    """

    inner: int | np.ndarray = attrs.field(converter=_to(_levels((), "[faces]")), default=5)
    outer: int | np.ndarray = attrs.field(converter=_to(_levels((3,), "[faces, 3]")), default=5)
    types: tuple = attrs.field(converter=_to(_tuple_of(HairType)), default=(HairType(),))
    type_map: np.ndarray = attrs.field(converter=_to(_optional(_type_map)), default=None)
    roots: str | int = attrs.field(converter=_to(_roots), default="faces")
    force: np.ndarray = attrs.field(converter=_to(_vector(3)), default=(0.0, -1.0, 0.0))
    point_forces: tuple = attrs.field(converter=_to(_tuple_of(PointForce)), default=())
    surface: str = attrs.field(converter=_to(_choice("pn", "flat")), default="pn")
    seed: int = attrs.field(converter=_to(_whole(0, 2**32 - 1)), default=0)
    type_indices: np.ndarray = attrs.field(init=False, repr=False)

    def __attrs_post_init__(self):
        if not 1 <= len(self.types) <= 256:
            raise Error(f"Strands.types has {len(self.types)} types; allowed: 1 to 256")
        if self.type_map is None and len(self.types) > 1:
            raise Error(
                f"Strands.type_map is None but Strands.types has {len(self.types)} types; "
                "allowed: one type without a type_map"
            )
        indices = None if self.type_map is None else self._types_of_pixels()
        object.__setattr__(self, "type_indices", indices)

    def _types_of_pixels(self):
        keys = [hair.key for hair in self.types]
        if None in keys:
            raise Error(f"HairType.key of Strands.types[{keys.index(None)}] is None; "
                        "allowed: (r, g, b) for every type when there is a type_map")
        if len(set(keys)) < len(keys):
            twice = next(key for key in keys if keys.count(key) > 1)
            raise Error(f"HairType.key {twice} is that of more than one of Strands.types; "
                        "allowed: distinct keys")
        packed_keys = _packed(keys)
        order = np.argsort(packed_keys)
        pixels = _packed(self.type_map)
        place = np.minimum(np.searchsorted(packed_keys[order], pixels), len(keys) - 1)
        indices = order[place]
        unlisted = packed_keys[indices] != pixels
        if unlisted.any():
            colors, counts = np.unique(pixels[unlisted], return_counts=True)
            colors = [int(color) for color in colors[np.argsort(-counts, kind="stable")]]
            names = ", ".join(str((c >> 16, c >> 8 & 255, c & 255)) for c in colors[:8])
            more = f" and {len(colors) - 8} more" if len(colors) > 8 else ""
            known = ", ".join(str(key) for key in keys[:8]) + (", ..." if len(keys) > 8 else "")
            raise Error(f"Strands.type_map has colours that are no type's key: {names}{more}; "
                        f"allowed: {known}")
        return _frozen(indices.astype(np.uint8))


def _points(value, where):
    allowed = "an array [strands, points, 3], or [total, 3] with counts, of numbers"
    array = _numbers(value, where, allowed)
    if array.ndim not in (2, 3) or array.shape[-1] != 3:
        _refuse(where, value, allowed)
    return _float32(array, where)


def _counts(value, where):
    allowed = "an array [strands] of whole numbers >= 0"
    array = _numbers(value, where, allowed, kinds="iu")
    if array.ndim != 1 or (array.size and (int(array.min()) < 0 or int(array.max()) >= 2**32)):
        _refuse(where, value, allowed)
    return _frozen(array.astype(np.uint32))


def _values(value, where):
    return _numbers(value, where, "numbers >= 0")


@attrs.frozen(eq=False)
class Curves:
    """Strands that the user brings, as polylines.

    points: [strands, points, 3], or [total, 3] with counts [strands] when strands differ in length; the root
    comes first. width: diameter in world units >= 0: one, [strands], or one for each point ([total], or
    [strands, points]). color: linear RGB >= 0, shaped like width with [..., 3]. specular: strength >= 0.
    exponent: of the highlight, > 0. alpha: 0..1, how much light one hair lets through. No strands at all are
    allowed.

    As stored: `points` float32 [total, 3], `counts` uint32 [strands], `uniform` the points per strand where
    all have the same, else None, `width` float32 [1], [strands] or [total], `color` float32 [1, 3],
    [strands, 3] or [total, 3]. Raises Error for other shapes and values, and for a width or colour
    that could be meant per strand or per point.
    """

    points: np.ndarray = attrs.field(converter=_to(_points))
    counts: np.ndarray = attrs.field(converter=_to(_optional(_counts)), default=None)
    width: np.ndarray = attrs.field(converter=_to(_values), default=0.002)
    color: np.ndarray = attrs.field(converter=_to(_values), default=(0.8, 0.6, 0.4))
    specular: float = attrs.field(converter=_to(_real(low=0)), default=0.3)
    exponent: float = attrs.field(converter=_to(_real(above=0)), default=150.0)
    alpha: float = attrs.field(converter=_to(_real(low=0, high=1)), default=0.5)
    uniform: int | None = attrs.field(init=False)

    def __attrs_post_init__(self):
        points, counts = self.points, self.counts
        if points.ndim == 3:
            if counts is not None:
                _refuse("Curves.counts", counts, "None when points is [strands, points, 3]")
            counts = _frozen(np.full(len(points), points.shape[1], np.uint32))
            points = points.reshape(-1, 3)
        elif counts is None:
            _refuse("Curves.counts", counts, "an array [strands] when points is [total, 3]")
        elif int(counts.sum(dtype=np.uint64)) != len(points):
            raise Error(f"Curves.counts add up to {counts.sum(dtype=np.uint64)}; "
                        f"allowed: {len(points)}, the number of points")
        same = not len(counts) or bool((counts == counts[0]).all())
        uniform = (int(counts[0]) if len(counts) else 0) if same else None
        sizes = len(counts), len(points), uniform
        for name, value in [
            ("points", points),
            ("counts", counts),
            ("uniform", uniform),
            ("width", _spread(self.width, (), *sizes, "Curves.width")),
            ("color", _spread(self.color, (3,), *sizes, "Curves.color")),
        ]:
            object.__setattr__(self, name, value)


def _spread(values, tail, strands, total, uniform, where):
    """Return values as float32 [1, *tail], [strands, *tail] or [total, *tail]; anything else is an Error."""
    shapes = {tail: "for all", (1, *tail): "for all", (strands, *tail): "per strand",
              (total, *tail): "per point"}
    if uniform is not None:
        shapes[(strands, uniform, *tail)] = "per point"
    allowed = "one for all, " + " or ".join(
        f"{list(shape)} {meaning}" for shape, meaning in shapes.items() if meaning != "for all"
    )
    if values.shape not in shapes or (values.dtype.kind == "f" and np.isnan(values).any()):
        _refuse(where, values, allowed + ", of finite numbers >= 0")
    if strands == total != 1 and values.shape == (strands, *tail) and strands and uniform != 1:
        raise Error(f"{where} of shape {list(values.shape)} could be per strand or per point, as there are "
                    f"as many points as strands; allowed: one for all")
    values = _float32(values, where).reshape(-1, *tail)
    if (values < 0).any():
        _refuse(where, values, "finite numbers >= 0")
    # No strands need no values, but an empty array would be trouble for every buffer down the line.
    return values if len(values) else _frozen(np.zeros((1, *tail), np.float32))


# --- camera and light -----------------------------------------------------------------------------------


def _unit(vector, where):
    """Return the vector float64 [3] at length one, read-only; Error where it is zero."""
    largest = np.abs(vector).max()
    if largest == 0:
        _refuse(where, vector, "a vector that is not zero")
    vector = vector / largest  # so that no square overflows or vanishes
    return _frozen(vector / np.sqrt((vector**2).sum()))


def _direction(value, where):
    return _unit(_vector(3)(value, where), where)


@attrs.frozen(eq=False)
class Camera:
    """A pinhole camera at `eye` that looks at `target`.

    eye, target, up: [3]; up may not be parallel to the view. fov: vertical, degrees, 0 < fov < 180.
    size: (width, height) in pixels, 1..16384 each. Raises Error for anything else.

    Every camera has `pose`, float64 [4, 4] camera to world (the camera looks along its -Z, +Y is up,
    +X right), `intrinsics`, float64 [3, 3] in pixels (see `calibrated`), and `size`; the renderer uses these
    three alone. One made by `calibrated` has None for eye, target, up and fov.
    """

    eye: np.ndarray = attrs.field(converter=_to(_vector(3)), default=(0.0, 0.4, 3.2))
    target: np.ndarray = attrs.field(converter=_to(_vector(3)), default=(0.0, 0.0, 0.0))
    up: np.ndarray = attrs.field(converter=_to(_vector(3)), default=(0.0, 1.0, 0.0))
    fov: float = attrs.field(converter=_to(_real(above=0, below=180)), default=45.0)
    size: tuple = attrs.field(converter=_to(_size), default=(640, 480))
    pose: np.ndarray = attrs.field(init=False, repr=False)
    intrinsics: np.ndarray = attrs.field(init=False, repr=False)

    def __attrs_post_init__(self):
        if (self.eye == self.target).all():
            raise Error(f"Camera.target is {_shown(self.target.tolist())}, the same as Camera.eye; "
                        "allowed: another point")
        back = _unit(self.eye - self.target, "Camera.eye - Camera.target")
        right = np.cross(_unit(self.up, "Camera.up"), back)
        if np.sqrt((right**2).sum()) < 1e-6:
            raise Error(f"Camera.up is {_shown(self.up.tolist())}, along the view; "
                        "allowed: a vector that is not parallel to target - eye")
        right = _unit(right, "Camera.up")
        pose = np.eye(4)
        pose[:3, :] = np.stack([right, np.cross(back, right), back, self.eye], axis=1)
        width, height = self.size
        focal = height / 2 / math.tan(math.radians(self.fov) / 2)
        intrinsics = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
        object.__setattr__(self, "pose", _frozen(pose))
        object.__setattr__(self, "intrinsics", _frozen(intrinsics))

    @classmethod
    def calibrated(cls, pose, intrinsics, size):
        """Return the camera of a calibration.

        pose: [4, 4] camera to world, right-handed, a rotation and a translation; the camera looks along its
        -Z and +Y is up (the trimesh and OpenGL convention; OpenCV's looks along +Z with +Y down: negate the
        second and third columns of its pose). intrinsics: [[fx, s, cx], [0, fy, cy], [0, 0, 1]] in pixels; a
        point (x, y, -d) before the camera is seen at column (fx x - s y)/d + cx and row cy - fy y/d. The
        origin is the top-left corner of the top-left pixel, whose centre is at (0.5, 0.5); OpenCV puts it
        in that pixel's centre, so its cx and cy are 0.5 less: add 0.5 to both. size: (width, height).
        Raises Error where the pose is no rigid motion (tolerance 1e-4) or the matrix has not this form.
        """

        def matrix(value, n, where):
            allowed = f"an array [{n}, {n}] of finite numbers"
            array = _numbers(value, where, allowed)
            if array.shape != (n, n) or not (np.abs(array.astype(np.float64)) <= LARGEST).all():
                _refuse(where, value, allowed)
            return array.astype(np.float64)

        pose = matrix(pose, 4, "Camera.calibrated pose")
        if (pose[3] != (0, 0, 0, 1)).any():
            _refuse("Camera.calibrated pose[3]", pose[3].tolist(), "[0, 0, 0, 1]")
        rotation = pose[:3, :3]
        error = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
        if error > 1e-4 or np.linalg.det(rotation) < 0:
            raise Error("Camera.calibrated pose[:3, :3] is no rotation: its columns are "
                        f"{error:.3g} from orthonormal, its determinant is {np.linalg.det(rotation):.3g}; "
                        "allowed: an error of 1e-4, determinant 1")
        u, _, v = np.linalg.svd(rotation)
        pose[:3, :3] = u @ v  # the nearest rotation, so that its transpose is its inverse
        k = matrix(intrinsics, 3, "Camera.calibrated intrinsics")
        if k[0, 0] <= 0 or k[1, 1] <= 0 or k[1, 0] != 0 or (k[2] != (0, 0, 1)).any():
            _refuse("Camera.calibrated intrinsics", k.tolist(),
                    "[[fx, s, cx], [0, fy, cy], [0, 0, 1]] with fx > 0 and fy > 0")
        camera = object.__new__(cls)  # eye, target, up and fov stay None: the matrices say more than they can
        fields = {"eye": None, "target": None, "up": None, "fov": None, "size": _size(size, "Camera.size"),
                  "pose": _frozen(pose), "intrinsics": _frozen(k)}
        for name, value in fields.items():
            object.__setattr__(camera, name, value)
        return camera


@attrs.frozen(eq=False)
class Light:
    """A distant light, or a spot light where it has a position: `direction` [3] is the way the light travels.

    direction is stored at unit length. color: linear RGB >= 0. ambient: white light from everywhere, >= 0.
    position: [3] of a spot, or None. angle: a spot's whole cone, degrees; its light does not fall off with distance.
    Raises Error otherwise.
    """

    direction: np.ndarray = attrs.field(converter=_to(_direction), default=(-1.0, -1.0, -1.0))
    color: np.ndarray = attrs.field(converter=_to(_color), default=(1.0, 1.0, 1.0))
    ambient: float = attrs.field(converter=_to(_real(low=0)), default=0.1)
    position: np.ndarray = attrs.field(converter=_to(_optional(_vector(3))), default=None)
    angle: float = attrs.field(converter=_to(_real(above=0, below=180)), default=60.0)


def _reach(fur):
    """Return how far fur can reach beyond the points that it is made of or grows on, in world units."""
    if isinstance(fur, Curves):
        return float(fur.width.max()) / 2
    if fur is None:
        return 0.0
    return max(hair.segments * hair.segment_length * (1 + hair.length_variation)
               + 2 * hair.curl[0] + hair.wave[0] + hair.width / 2 for hair in fur.types)


@functools.lru_cache(maxsize=2)
def hair_bounds(fur, strands):
    """Return (segments, length [world], length · width [world²]) that ``strands`` strands of the fur cannot exceed."""
    if isinstance(fur, Curves):
        d = np.linalg.norm(np.diff(fur.points, axis=0), axis=1)
        inner = np.ones(len(fur.points), bool)
        inner[np.cumsum(fur.counts, dtype=np.int64)[fur.counts > 0] - 1] = False   # a strand's end joins nothing
        length = float(d[inner[:-1]].sum(dtype=float))
        return len(fur.points), length, length * float(fur.width.max())
    types = fur.types
    # Curl and wave hold a point within this reach of its axis; from one point to the next it may cross all of it.
    lengths = [t.segments * (t.segment_length * (1 + t.length_variation) + 2 * (2 * t.curl[0] + t.wave[0]))
               for t in types]
    return (strands * max(t.segments for t in types), strands * max(lengths),
            strands * max(length * t.width for length, t in zip(lengths, types)))


def _points_to_see(mesh, fur):
    """Return arrays [n, 3] of points whose hull, grown by `_reach`, holds all that is drawn."""
    curved = isinstance(fur, Strands) and fur.surface == "pn"
    points = [mesh.hull if curved else mesh.positions] if mesh is not None else []
    return points + ([fur.points] if isinstance(fur, Curves) and len(fur.points) else [])


@functools.lru_cache(maxsize=2)   # a film asks for the same again in every frame
def extent(mesh, fur):
    """Return a sphere (centre float64 [3], radius float) around all that a mesh and its fur can reach."""
    boxes = [_box(points) for points in _points_to_see(mesh, fur)]
    if not boxes:
        return np.zeros(3), 0.0
    center, _ = _sphere(np.min([low for low, _ in boxes], 0), np.max([high for _, high in boxes], 0))
    furthest = max(((points - center) ** 2).sum(1).max() for points in _points_to_see(mesh, fur))
    return center, float(np.sqrt(furthest)) + _reach(fur)


def frame(mesh, fur, size=(640, 480), fov=45, direction=(0.45, 0.3, 1.0)):
    """Return a Camera that sees all of a mesh and its fur.

    mesh: Mesh, or None with Curves. fur: Strands, Curves or None. size: (width, height) in pixels.
    fov: vertical, degrees. direction: [3] from the centre of what is drawn to the camera, which comes
    as near as it can. Raises Error as Camera does.
    """
    size = _size(size, "frame size")
    fov = _real(above=0, below=180)(fov, "frame fov")
    direction = _direction(direction, "frame direction")
    center, _ = extent(mesh, fur)
    up = (0, 1, 0) if abs(direction[1]) < 0.999 else (0, 0, -1)
    axes = Camera(eye=center + direction, target=center, up=up, fov=fov, size=size).pose[:3, :3]
    tall = math.tan(math.radians(fov) / 2)
    slopes = np.array([tall * size[0] / size[1], tall])
    # The four planes of the view, each pushed out to its furthest point: where they meet is the nearest eye.
    offsets = np.concatenate([points - center for points in _points_to_see(mesh, fur)] or [np.zeros((1, 3))]) @ axes
    margin = _reach(fur) * np.sqrt(1 + slopes**2)
    one = (offsets[:, :2] + slopes * offsets[:, 2:]).max(0) + margin
    other = (-offsets[:, :2] + slopes * offsets[:, 2:]).max(0) + margin
    distance = 1.05 * float(((one + other) / (2 * slopes)).max()) or 1.0
    target = center + axes[:, :2] @ ((one - other) / 2)
    return Camera(eye=target + distance * direction, target=target, up=up, fov=fov, size=size)


@attrs.frozen(eq=False)
class Scene:
    """All that a picture shows.

    mesh: Mesh or None. fur: Strands (which need a mesh), Curves or None; a mesh or fur is required.
    camera: Camera, or None to frame all of it. light: Light. body_color: linear RGB >= 0 of the mesh itself,
    or None to leave it undrawn. Raises Error where the parts don't fit: a type_map or color_texture on a
    mesh without uv, levels for another number of faces, or an edge whose two faces give it different levels.
    """

    mesh: Mesh = attrs.field(converter=_to(_instance(Mesh, none=True)), default=None)
    fur: Strands | Curves = attrs.field(converter=_to(_instance(Strands, Curves, none=True)), default=None)
    camera: Camera = attrs.field(converter=_to(_instance(Camera, none=True)), default=None)
    light: Light = attrs.field(converter=_to(_instance(Light)), default=Light())
    body_color: np.ndarray = attrs.field(converter=_to(_optional(_color)), default=(0.30, 0.20, 0.12))

    def __attrs_post_init__(self):
        if self.mesh is None and self.fur is None:
            raise Error("Scene.mesh and Scene.fur are None; allowed: at least one of them")
        if isinstance(self.fur, Strands):
            if self.mesh is None:
                raise Error("Scene.mesh is None but Scene.fur is Strands; allowed: a Mesh for it to grow on")
            _check_uv(self.mesh, self.fur)
            _check_levels(self.mesh, self.fur)
        _, radius = extent(self.mesh, self.fur)
        if radius and not 1e-6 <= radius <= LARGEST:
            raise Error(f"Scene is {2 * radius:.3g} across; allowed: 2e-06 to 2e+09, where float32 is exact enough")
        if self.camera is None:
            object.__setattr__(self, "camera", frame(self.mesh, self.fur))


def _check_uv(mesh, strands):
    if mesh.has_uv:
        return
    if strands.type_map is not None:
        raise Error("Strands.type_map is looked up by uv but Scene.mesh has none; allowed: a mesh with uv")
    if any(hair.color_texture is not None for hair in strands.types):
        raise Error("HairType.color_texture is looked up by uv but Scene.mesh has none; "
                    "allowed: a mesh with uv")


def _check_levels(mesh, strands):
    for name in ("inner", "outer"):
        levels = getattr(strands, name)
        if isinstance(levels, np.ndarray) and len(levels) != len(mesh.faces):
            raise Error(f"Strands.{name} has levels for {len(levels)} faces; "
                        f"allowed: {len(mesh.faces)}, the faces that the mesh has kept")
    if not isinstance(strands.outer, np.ndarray):
        return
    edges = np.sort(mesh.faces[:, [[1, 2], [2, 0], [0, 1]]].astype(np.int64), axis=2).reshape(-1, 2)
    order = np.lexsort(edges.T)
    levels = strands.outer.reshape(-1)[order]
    differ = (edges[order][1:] == edges[order][:-1]).all(axis=1) & (levels[1:] != levels[:-1])
    if differ.any():
        at = int(np.argmax(differ))
        one, other = order[at], order[at + 1]
        raise Error(f"Strands.outer is {levels[at]} at face {one // 3}, edge {one % 3}, but {levels[at + 1]} "
                    f"at face {other // 3}, edge {other % 3}, which is the same edge; allowed: equal levels")
