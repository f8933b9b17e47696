"""Values on the skin that hair follows: grey pictures, numbers by vertex or by face, and a field of directions."""

from typing import Any

import attrs
import numpy as np

from ..errors import Error
from . import checks
from .display import brief
from .mesh import Mesh
from .remembered import remembered

NAMES = "density", "on", "length", "width", "clump", "curl", "stiffness"
FACTOR = 16.0             # at most, of what multiplies
TEXELS = 2**27            # of all tiles of a picture, as many as a picture that is read may have
TILES = 1001, 9999        # numbers of UDIM tiles: 1001 + column + 10 row, columns 0 to 9
WHOLE = 0                 # the number of a picture that is no tile: it repeats
GREY = "a grey picture [h, w] of uint8, uint16 or numbers, or {1001: picture, ...} of UDIM tiles"
BY = "an array by vertex or by face"


@attrs.frozen(eq=False)
class Skin:
    """What has a value everywhere on a skin.

    per: "picture", data {number of a UDIM tile, or WHOLE: float32 [h, w] or [h, w, n]}; "vertex", "face" or "array"
    (one of both, by its length), data float32 [n] or [n, 3]; "all", float32 [3]; "function", what gives it.
    """

    per: str
    data: Any
    __repr__ = brief

    @property
    def most(self) -> float:
        """The largest number that it can give."""
        if isinstance(self.data, dict):
            tiled = WHOLE not in self.data   # where there is none it is 1
            return max(float(tiled), *(float(each.max()) for each in self.data.values()))
        return float(np.max(self.data, initial=0))


def tiles(value, where, allowed, convert, size=lambda picture: picture.shape[0] * picture.shape[1]):
    """Return {number: convert(picture, where)} of a picture, or of {number: picture} of UDIM tiles, each of so many
    pixels."""
    given = {WHOLE: value} if not isinstance(value, dict) else value
    if not given or not all(isinstance(number, int) and TILES[0] <= number <= TILES[1] for number in given
                            if given is value):
        checks.refuse(where, value, allowed + f", numbers from {TILES[0]} to {TILES[1]}")
    found, texels = {}, 0
    for number in sorted(given):
        picture = convert(given[number], where if number == WHOLE else f"{where}[{number}]")
        texels += size(picture)
        if texels > TEXELS:
            raise Error(f"{where} has more than {TEXELS} pixels in all; allowed: at most that")
        found[number] = picture
    return found


def as_numbers(array):
    """Return data as floats: uint8 and uint16 are 0 to 1, linear; others are as they are."""
    if array.dtype.kind == "u" and array.dtype.itemsize <= 2:
        return array.astype(np.float32) / np.float32(np.iinfo(array.dtype).max)
    return array


def _grey(most):
    """Return a converter to float32 [h, w] of a grey picture; where it has three channels these must be equal."""

    def convert(value, where):
        array = checks.numbers(value, where, GREY)
        if array.ndim == 3 and array.shape[2] in (3, 4) and array.size:
            if (array[:, :, :1] != array[:, :, :3]).any():
                checks.refuse(where, value, GREY + "; this one has colours")
            array = array[:, :, 0]
        if array.ndim != 2 or 0 in array.shape:
            checks.refuse(where, value, GREY)
        return checks.float32(as_numbers(array), where, most, 0)

    return convert


def grey(most):
    """Return a converter to the `Skin` of one of `Maps`, whose numbers are from 0 to most."""
    allowed = f'None, {GREY}, or {BY}, {{"vertex": array}} or {{"face": array}} if they are as many'

    def convert(value, where):
        if isinstance(value, Skin):
            return value
        if isinstance(value, dict) and set(value) <= {"vertex", "face"} and len(value) == 1:
            (per, array), = value.items()
        elif isinstance(value, dict):
            return Skin("picture", tiles(value, where, allowed, _grey(most)))
        else:
            per, array = "array", value
        array = checks.numbers(array, where, allowed, "biuf")
        if array.ndim == 1 and array.size:
            return Skin(per, checks.float32(as_numbers(array), where, most, 0))
        if per != "array" or array.ndim not in (2, 3):
            checks.refuse(where, value, allowed)
        return Skin("picture", tiles(value, where, allowed, _grey(most)))

    return convert


@attrs.frozen(eq=False)
class Maps:
    """What the skin says of its hair, each None or numbers of 0 or more that multiply what a type says.

    density: 0..1, the share of strands that stand there; which ones is each strand's own random number, so that all
    others keep their places, and more density only adds. on: 0..1, the same once more, such as `Mesh.mask` of a group's
    name: both are multiplied. length (0: bald), width, curl (of wave, too), stiffness: up to
    16. clump: 0..1, how strong tufts are.

    Each is a grey picture [h, w], looked up by uv (rows from the top, v upwards, between four pixels, repeating); or
    {1001: picture, ...}, UDIM tiles 1001 + column + 10 row: the one in which the middle of a triangle's uv lies, and 1
    where there is none; or an array by vertex [V] or by face [F] of the mesh as it was given: `Mesh.numbering` counts
    them. One that is as long as both is told apart by {"vertex": array} or {"face": array}. uint8 and uint16 are 0 to 1
    without a curve, as these are data, no colours; other numbers are as they are. Raises Error for anything else.
    """

    density: checks.Given = checks.field(checks.optional(grey(1.0)), default=None, kw_only=True)
    on: checks.Given = checks.field(checks.optional(grey(1.0)), default=None, kw_only=True)
    length: checks.Given = checks.field(checks.optional(grey(FACTOR)), default=None, kw_only=True)
    width: checks.Given = checks.field(checks.optional(grey(FACTOR)), default=None, kw_only=True)
    clump: checks.Given = checks.field(checks.optional(grey(1.0)), default=None, kw_only=True)
    curl: checks.Given = checks.field(checks.optional(grey(FACTOR)), default=None, kw_only=True)
    stiffness: checks.Given = checks.field(checks.optional(grey(FACTOR)), default=None, kw_only=True)
    __repr__ = brief

    def most(self, name: str) -> float:
        """The largest number of the map of this name; 1 where there is none."""
        skin = getattr(self, name)
        return 1.0 if skin is None else skin.most


def _flow(value, where):
    """Return float32 [h, w, 2], -1 to 1, of a picture of directions: red along u, green along v."""
    allowed = "a picture [h, w, 3] of uint8 or uint16 (128 or 32768: none), or of numbers from -1 to 1"
    array = checks.pixels(value, where, "iuf", allowed)[:, :, :2]
    if array.dtype.kind == "u" and array.dtype.itemsize <= 2:
        middle = (np.iinfo(array.dtype).max + 1) // 2
        array = np.maximum((array.astype(np.float32) - middle) / np.float32(middle - 1), -1)
    return checks.float32(array, where, 1)


def _directions(value, where):
    allowed = ("[3], vectors by vertex [V, 3], a picture [h, w, 3], {1001: picture, ...} of UDIM tiles, or a function "
               "of positions and normals [n, 3] that gives them")
    if isinstance(value, Skin):
        return value
    if callable(value):
        return Skin("function", value)
    array = None if isinstance(value, dict) else checks.numbers(value, where, allowed)
    if array is None or array.ndim == 3:
        return Skin("picture", tiles(value, where, allowed, _flow))
    if array.shape != (3,) and (array.ndim != 2 or array.shape[1] != 3 or not array.size):
        checks.refuse(where, value, allowed)
    return Skin("all" if array.ndim == 1 else "vertex", checks.float32(array, where, checks.LARGEST))


@attrs.frozen(eq=False)
class Comb:
    """Which way hair is combed: it leaves the skin between its normal and this direction along it.

    direction: [3] for all, or [V, 3] by vertex of the mesh as it was given, in the world; or a function of positions
    and normals, float64 [n, 3] each, that gives [n, 3], called with the mesh's vertices; or a picture [h, w, 3] looked
    up by uv as `Maps` are, or UDIM tiles of it: red is the way along u and green along v, blue has no say (of uint8 128
    is none and 255 all the way along u; of uint16 32768 and 65535; numbers are -1 to 1). The part of it along the skin
    counts, at most 1 long. weight: 0..1, 0 the normal alone, 1 flat on the skin where the direction is 1 long.
    Raises Error for anything else.
    """

    direction: checks.Given = checks.field(_directions)
    weight: float = checks.field(checks.real(low=0, high=1), default=0.7)
    __repr__ = brief

    def asked_from(self, there: np.ndarray) -> "Comb":
        """The same where positions are relative to a place, float64 [3]: a function is asked in the world."""
        ask: Any = self.direction.data
        return Comb(lambda positions, normals: ask(positions + there, normals), self.weight)


@remembered(2)   # asked for again by every frame
def planes(mesh: Mesh, maps: Maps | None, comb: Comb | None) -> tuple:
    """Return what a mesh's skin says: of each of NAMES, and of three directions, None, {number: float32 [h, w]} of a
    picture, or float32 [F, 3] by corner or [F] by face of the faces that the mesh has kept.

    A picture of directions has two, along u and v; others are x, y and z. Raises Error where these don't fit the mesh.
    """
    found = [_plane(mesh, None if maps is None else getattr(maps, name), f"Maps.{name}") for name in NAMES]
    return (*found, *_ways(mesh, comb))


def _plane(mesh, skin, where):
    if skin is None:
        return None
    if skin.per == "picture":
        _check_uv(mesh, where)
        return skin.data
    count, known, per = len(skin.data), mesh.numbering, skin.per
    if per == "array" and known.vertices == known.faces == count:
        raise Error(f"{where} has {count} numbers, as many as the mesh has vertices and faces; "
                    'allowed: {"vertex": array} or {"face": array}')
    if count == known.vertices and per != "face":
        return checks.frozen(skin.data[known.corners[mesh.kept_faces]])
    if count == known.faces and per != "vertex":
        kept = mesh.kept_faces
        return checks.frozen(skin.data[kept if known.face_of is None else known.face_of[kept]])
    allowed = {"vertex": f"{known.vertices}, one for each vertex", "face": f"{known.faces}, one for each face"}
    raise Error(f"{where} has {count} numbers; allowed for this mesh: "
                + (allowed.get(per) or " or ".join(allowed.values())))


def _ways(mesh, comb):
    """Return the three of `planes` that tell a direction."""
    if comb is None:
        return None, None, None
    data = comb.direction.data
    if comb.direction.per == "picture":
        _check_uv(mesh, "Comb.direction")
        return (*({number: checks.frozen(each[:, :, k].copy()) for number, each in data.items()} for k in (0, 1)), None)
    known = mesh.numbering
    if comb.direction.per == "all":
        corners = np.broadcast_to(data, (len(mesh.faces), 3, 3))
    elif comb.direction.per == "function":
        corners = _asked(mesh, data)[mesh.faces]
    elif len(data) != known.vertices:
        raise Error(f"Comb.direction has {len(data)} vectors; allowed for this mesh: {known.vertices}, one for each "
                    "vertex")
    else:
        corners = data[known.corners[mesh.kept_faces]]
    corners = corners.astype(np.float64)
    corners /= np.maximum(np.sqrt((corners**2).sum(2, keepdims=True)), 1)
    return tuple(checks.frozen(corners[:, :, k].astype(np.float32)) for k in range(3))


def _asked(mesh, function):
    """Return what a function says of the mesh's vertices, float32 [P, 3]."""
    positions = mesh.positions.astype(np.float64) + mesh.origin
    try:
        said = function(positions, mesh.normals.astype(np.float64))
    except Exception as error:   # it is the user's
        raise Error(f"Comb.direction raises {type(error).__name__}: {error}; allowed: a function of positions and "
                    f"normals, [{len(positions)}, 3] each") from error
    where, allowed = "Comb.direction's result", f"[{len(positions)}, 3], a vector for each position"
    array = checks.numbers(said, where, allowed)
    if array.shape != positions.shape:
        checks.refuse(where, said, allowed)
    return checks.float32(array, where, checks.LARGEST)


def _check_uv(mesh, where):
    if not mesh.has_uv:
        raise Error(f"{where} is a picture, looked up by uv, but Scene.mesh has none; allowed: a mesh with uv, or "
                    f"{BY}")
