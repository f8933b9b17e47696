"""The one contract between host and device: constants, sample patterns, structs and arrays, written once."""

import dataclasses
import math
from typing import Any, ClassVar

import numpy as np

CONSTANTS = {
    "SUBPIXEL": 256,        # fixed-point steps per pixel of a snapped point
    "DEPTH_ONE": 1 << 30,   # fixed-point depth: 0 at the near plane, DEPTH_ONE at infinity (or the far plane)
    "GUARD": 32768,         # snapped points lie within this many pixels of the origin; lines are clipped to it
    "NOTHING": 0xFFFFFFFF,  # depth and id of a sample that nothing covers
    "BODY": 0x80000000,     # id of a body triangle = BODY | triangle; of a strand segment = its first point
    "PERIOD": 1024,         # cells after which gusts of wind come again, along each axis
    "CROUCHED": 0.9,        # how much less than upright hair of shells is at the tip at most, pushed down
    "STRANDS_BESIDE": 16,   # of those that move, at most: two vectors of each number would not stay in registers
    "ROWS_OF_POINT": 50,    # of what a step sets aside for a point of a strand that moves
    "FASTEST": 1 << 24,     # units of speed that a grid of hair takes: 2^16 are a cell in a step
    "ALONE_IN_CELL": 1.25,  # strands across a cell, by its density, that one alone may seem to be,
    "DENSER": 1.2,          # and by how much hair may be denser than as groomed before it is pushed apart
    "SCAN": 256,            # values one work-item sums in a prefix scan
    "TILE": 8,              # pixels a side of a tile, in which strands are drawn together
    "SLOTS": 32,            # pieces of strands that a pixel lets wait; a multiple of 4
    "PIECE": 14,            # uint of one that waits in a list of its tile,
    "MASKED_PIECE": 22,     # and where it has masks
    "LISTED": 64,           # segments that are made ready together where columns go side by side
    "WALK": 88,             # uint4 of a pixel that stops on its way through these,
    "MASKED_WALK": 212,     # and where it has masks
    "KEPT_PIXEL": 32,       # uint4 of a pixel between slabs of depth,
    "MASKED_PIXEL": 72,     # and where it has masks
    "AT_A_TIME": 128,       # strands that a work-item lists where columns go side by side
    "GATHERED": 8,          # and for how many each of a group stands that puts them into a light's grid together
    "GLOWS": 64,            # pieces whose light is added together, a multiple of 8
    "MARKED": 512,          # marks that a work-item goes through, a multiple of 8
    "BUCKETS": 256,         # by depth, into which the segments of a tile are sorted
    "ID_NOTHING": -1,       # output "id" of a pixel where nothing is; strands are numbered from 0
    "ID_BODY": -2,
    "ID_SHELLS": -3,
    "ID_GROUND": -4,
    "GROUND": 0xFFFFFFFE,   # id of the ground: BODY | a triangle that there is none
    "CORNERS": 8,           # float4 a face in the lattice of shell fur
    "HEIGHTS": 64,          # of its table of means
    "FEW_PIECES": 2,        # of a segment, in which its light is a parabola,
    "FEW_PLACES": 5,        # and at how many places it is known,
    "BLOCKS": 128,          # a side of a light's shadow map, of which it is known how deep they are
    "SIDE_BITS": 2,         # of a neighbour's side: face << SIDE_BITS | side
    "ROWS": 16,             # of a face's points in the light's grid that a work-item does,
    "POINT_STEP": 0.75,     # which stand no further apart than so many sides of a cell
    "SHADES": 24,           # of hair in a table of how it scatters light, from black to white
    "LOOK": 16,             # steps of loops that a look at a light's map may take, besides its filter's,
    "LOOK_AT_ONCE": 8,      # which takes so many texels of a row in one
    "CELL_BITS": 4,         # of a coordinate of a cell by which the user's strands are put in order
    "HARMONICS": 9,         # spherical, of orders 0 to 2
    "SKY_EDGE": 2,          # cells around a slice of a sky's grid, through which all light comes
    "MOMENTS": 6,           # of hair in a cell: xx, yy, zz, xy, xz, yz
    "DIRECTIONS": 24,       # in which light goes from hair to hair; a multiple of 8
    "CHANNELS": 3,          # of each; r, g, b
    "PARTS_OF_ONE": 8,      # of each, over which light is averaged
    "TANGENTS": 96,         # of hair for which it is tabulated how light is scattered,
    "ALBEDOS": 32,          # and angles of the eye for which how much of it
    "DEEP_BLOCK": 8,        # segments of hair that are looked up together in lists of what lights see,
    "DEEP_UNIT": 1024,      # and parts of an octave in which they tell how much light they take
    "NEAREST": 8,           # guides that are looked for around a strand, at most: one more than are blended
    "TREE_ROWS": 11,        # of nodes in a tree of boxes, at most: eight parts each
    "CHORDS": 3,            # of a guide, by which it is told which way it points,
    "LEAST_TURN": 1 / 32,   # and 1 + cosine of the angle between two normals, at least
    "DISTANCE_BAND": 3,     # cells on both sides of the body in which it is known how far it is,
    "DISTANCE_BITS": 24,    # in parts of a cell of so many bits
    "SLIDE_LOOKS": 32,      # at a segment on its way along the body, at most,
    "SLIDE_PLACES": 12,     # of which so many at other places
    "LOD_LEAST": 0.125,     # share of the strands that `Settings.lod` always keeps
    "LOD_SOFT": 1.5,        # from share k to LOD_SOFT * k of them widths fade to 0: no strand pops up
}

# How hair scatters light, as the last of `shine` tells; scatter.h has a way for each.
MODELS = {"kajiya-kay": 0, "half-vector": 1, "turned": 2, "chiang": 3}

# What has a value on the skin for a strand, in the order of `SkinMap`s; of ways there are three.
SKIN = "density", "on", "length", "width", "clump", "curl", "stiffness", "way"
CONSTANTS |= {f"SKIN_{name.upper()}": number for number, name in enumerate(SKIN)} | {"SKIN_MAPS": len(SKIN) + 2}
PER = "none", "picture", "face", "corner"   # what a map on the skin has numbers for
CONSTANTS |= {f"PER_{name.upper()}": number for number, name in enumerate(PER)}
CONSTANTS["UDIM"] = 1001   # number of the tile of uv 0 to 1; in each row are 10

WRAPS = "repeat", "mirror", "clamp"   # what is seen of a picture outside of it
CONSTANTS |= {f"WRAP_{name.upper()}": number for number, name in enumerate(WRAPS)}

# Sample positions in 1/16 pixel from the pixel's centre: no two share a row or a column, so an edge near an
# axis has as many steps as samples.  4 and 16 are Direct3D's standard patterns.
PATTERNS = {
    1: [(0, 0)],
    4: [(-2, -6), (6, -2), (-6, 2), (2, 6)],
    16: [(1, 1), (-1, -3), (-3, 2), (4, -1), (-5, -2), (2, 5), (5, 3), (3, -5),
         (-2, 6), (0, -7), (-4, -6), (-6, 4), (-8, 0), (7, -4), (6, 7), (-7, -8)],
}

CONSTANTS["DISC_POINTS"] = DISC_POINTS = 64       # of a disc at which its shadow of the body is asked for,
CONSTANTS["SEARCH_POINTS"] = SEARCH_POINTS = 24   # and where it is looked for what casts it
CONSTANTS["SAMPLES"] = max(PATTERNS)   # the most a pixel can have

HELD = 1 << 15   # cells of a light's grid that a work-group gathers by itself: no faster with more

METHODS = "binary", "count", "trilinear", "length"   # of `Settings.shadows`: how hair is put into the light's grid
CONSTANTS |= {f"METHOD_{name.upper()}": number for number, name in enumerate(METHODS)}

# Every member is made of 16-byte vectors, so there is no padding for host and device to disagree on.
_float4, _int4 = (np.float32, 4), (np.int32, 4)

View = np.dtype([                     # a camera: world -> (x, y, e, 1)·w, pixels and reversed depth
    ("to_screen", np.float32, (4, 4)),   # columns; e/w is 1 at the near plane and falls to 0
    ("to_world", np.float32, (4, 4)),    # columns of the inverse
    ("eye", *_float4),                   # position and 1, or direction towards an orthographic eye and 0
    ("size", *_int4),                    # columns that are drawn, rows of all [pixels], samples a pixel, first row of
                                         # its PATTERN
    ("scale", *_float4),                 # pixels per world unit of width at w = 1; least half width, sub-pixels; least
                                         # w of triangles before the near plane, which are drawn at it, 0: none
    ("rows", *_int4),                    # rows that are drawn: first, one past the last; the first column that is, a
                                         # multiple of TILE; columns behind those that are
])

HairType = np.dtype([
    ("color", *_float4),              # linear r, g, b; color_variation
    ("shape", *_float4),              # length of a segment, width [world], force_weight, direction_variation
    ("curl", *_float4),               # radius [world], cos and sin of the angle a segment, length_variation
    ("wave", *_float4),               # amplitude [world], cos and sin of the angle a segment; softness, see strands.cl
    ("taper", *_float4),              # shares of the width: at the root, gained to the tip; 1 / taper - 2; sub-steps a
                                      # segment, 0: by the report's rule
    ("frizz", *_float4),              # amplitude [world], waves along the strand; 1: curl and wave are the tufts'; -
    ("root", *_float4),               # linear r, g, b there, -; where points have colours
    ("tip", *_float4),
    ("shine", *_float4),              # two numbers of its model, in most specular and exponent; alpha; MODELS
    ("lobes", *_float4),              # of a Chiang: roughness along and around the strand, tilt [radians], index
    ("counts", *_int4),               # segments; its texture's first tile and how many it has, 0: none; -
])

Traits = np.dtype([                   # what maps on the skin make of a strand: factors, 1 where there is none
    ("scale", *_float4),              # of length, width, stiffness; of curl and wave
    ("tuft", *_float4),               # of clump strength, of frizz, -, -
    ("comb", *_float4),               # direction along the skin, at most 1 long; its weight against the normal, 0 to 1
])

# A picture, or a tile of one (UDIM); pictures without tiles are looked up everywhere.
SkinTile = np.dtype([("place", *_int4)])   # first texel, width, height; number, 0: it repeats

SkinMap = np.dtype([("kind", *_int4)])     # PER; first tile, or first of its numbers; how many tiles; -

Light = np.dtype([
    ("direction", *_float4),          # unit vector, the way the light travels
    ("color", *_float4),              # linear r, g, b; ambient
    ("position", *_float4),           # of a spot light and 1, or 0
    ("cone", *_float4),               # cosine of half a spot's angle; a disc's radius if it has a position, else the
                                      # tangent of half its angle; -, -
])

# method: 1 if a type's optical depth is 1 - alpha, 0 if it is -ln(alpha).
Shadow = np.dtype([                   # how a place is looked up in a light's grid and map
    ("hair", *_float4),               # optical depth of one crossing; self-shadow: of a width, of a fragment; method
    ("body", *_int4),                 # 1: there is a shadow map; filter radius in texels, -, -
    ("disc", *_float4),               # how wide a disc is: radius in texels of its shadow's blur, to a difference of
                                      # reversed depth of 1 in the map, 0: a point; -, -, -
    ("place", *_int4),                # where its cells and its texels begin: low and high 32 bits of each
])

Grid = np.dtype([                     # cells seen from the light: world -> (x·w, y·w, z, w), cells
    ("to_grid", np.float32, (4, 4)),     # columns
    ("light", *_float4),                 # direction towards the light and 0, or its position and 1
    ("size", *_int4),                    # cells in x, y (across the light) and z (along it); 1: what lies before the
                                         # first layer counts in it
    ("face", *_float4),                  # area of a cell's face and length of its side at w = 1 [world]; smallest w in
                                         # the grid, and of all that counts
])

Deep = np.dtype([                     # a light's lists of segments of hair: world -> (x·w, y·w, e·w, w), pixels and
    ("to_map", np.float32, (4, 4)),      # reversed depth of its view; columns
    ("size", *_int4),                    # tiles of TILE pixels a side, 0: none; where its tiles begin, -, -
    ("reach", *_float4),                 # half a side of the square around a place that is shaded [pixels], -, -, -
])

Shells = np.dtype([                   # fur as a height field on the body, drawn layer by layer
    ("size", *_float4),                  # length [world], layers, frequency, length_variation
    ("shape", *_float4),                 # sharpness, density, noise [hairs], size of its waves [hairs]
    ("color", *_float4),                 # linear r, g, b; share of light at the roots
    ("shine", *_float4),                 # as of HairType
    ("kind", *_int4),                    # pattern: 0 cells, 1 sine; seed; slabs that a hair bends in; 1: filtered
    ("noise", *_int4),                   # lattice of the noise in x, y, z; 1: no body is drawn
    ("bend", *_float4),                  # what bends hairs all the time, -
    ("wind", *_float4),                  # what bends them in gusts, -
    ("gust", *_float4),                  # waves of the gusts a unit of length [1/world], waves gone by
    ("to_noise", np.float32, (3, 4)),    # columns: from the middle of the mesh in rest -> in lattices of the noise
])

Sky = np.dtype([                      # cells of the world that hold light of a sky
    ("place", *_float4),                 # lowest corner [world]; cells a unit of length
    ("size", *_int4),                    # cells a side; 1: there is a sky, -, -
])

OnGround = np.dtype([                 # squares of a plane that tell of a sky's light, narrower near its middle
    ("place", *_float4),                 # x and z of its middle [world]; 1 / how far along each half of its squares are
    ("whole", *_float4),                 # linear r, g, b where nothing hides it; height [world]
    ("size", *_int4),                    # squares a side, 0: no sky, -, -, -
])

Distances = np.dtype([                # nodes of a grid at which it is known how far the body is
    ("place", *_float4),                 # its first node [world]; cells a unit of length
    ("size", *_int4),                    # nodes in x, y and z, -
    ("reach", *_float4),                 # how far it is known; side of a cell [world], -, -
])

Ground = np.dtype([                   # a level plane, as a camera above it sees it
    ("plane", *_float4),                 # reversed depth at (x, y, 1) [pixels]: its three factors; height [world]
    ("color", *_float4),                 # linear r, g, b; 1, or 0 if its shadow alone is seen
])

Material = np.dtype([                 # what the body is painted with
    ("color", *_float4),                 # linear r, g, b, which a picture's texels multiply
    ("size", *_int4),                    # its picture's width and height (0: none), its first texel, its levels
    ("wrap", *_int4),                    # WRAPS of u and v, -, -
])

Lobes = np.dtype([                    # how hair of a type scatters light, where its model is "chiang"
    ("along", np.float32, (4, 4)),       # a row a lobe: 1 / variance, 1 / integral, sine and cosine of the tilt
    ("color", *_float4),                 # how fast the lobes fall with the square of log2(colour), -, -, -
    ("table", *_int4),                   # where its table begins; how many cosines and angles it has, -
])

MotionType = np.dtype([               # how hair of a type moves
    ("hair", *_float4),                  # what bends it over its mass a length [world^3 / s^2]; 1 / air [1 / s];
                                         # damping [s]; share of its root's motion that carries it along
    ("touch", *_float4),                 # friction on the body, -, -, -
])

Body = np.dtype([                     # where the body is, that hair touches
    ("to_world", np.float32, (3, 4)),    # rows that take a place at rest to where it is now [world],
    ("to_grid", np.float32, (3, 4)),     # and back, to where the grid of its distances has it
    ("carry", np.float32, (3, 4)),       # rows that take a place a step ago to where the body has taken it
    ("more", *_float4),                  # how far its skin has gone besides, at most [world]; 1: it deforms, -, -
])

Wind = np.dtype([                     # of a moment
    ("mean", *_float4),                  # [world / s]; how strong gusts are, likewise
    ("gone", *_float4),                  # how far the mean has carried gusts [cells]; cells a world unit
    ("less", *_float4),                  # 1 / height of the air that the skin holds [1 / world], 0: none; how much less
                                         # a crossing of hair upwind leaves, -, -
    ("seed", *_int4),                    # of gusts; 1: those of each point, 0: of roots; -, -
])

STRUCTS = {"Sky": Sky, "View": View, "HairType": HairType, "Traits": Traits, "SkinTile": SkinTile,
           "SkinMap": SkinMap, "Light": Light, "Shadow": Shadow, "Grid": Grid, "Deep": Deep, "Shells": Shells,
           "Ground": Ground, "OnGround": OnGround, "Material": Material, "Lobes": Lobes, "Distances": Distances,
           "MotionType": MotionType, "Body": Body, "Wind": Wind}


def shine(look, alpha, model=None):
    """Member `shine` of what has a look; of another of the MODELS than the look's, if that is named."""
    return *look.numbers, alpha, MODELS[model or look.model]


def _c_struct(name, dtype):
    """C declaration of a struct of 16-byte vectors, which does not compile where it is laid out otherwise."""
    members = []
    for member in dtype.names:
        field = dtype[member]
        vector = {np.dtype(np.float32): "float4", np.dtype(np.int32): "int4"}[field.base]
        members.append(f"{vector} {member}{f'[{field.shape[0]}]' if len(field.shape) > 1 else ''};")
    return (f"typedef struct {{ {' '.join(members)} }} {name};\n"
            f"typedef char {name}_is_whole[sizeof({name}) == {dtype.itemsize} ? 1 : -1];\n")


def _c_number(value):
    """A constant in C: a float, an int, or a uint where it is too large for one."""
    if isinstance(value, float) or value < 0:
        return f"{value}f" if value >= 0 else f"({value})"
    return f"{value:#x}" + "u" * (value >> 31)


def block(lanes):
    """Pixels, across and down, whose rays go through shell fur together, one a lane."""
    return (1, 1) if lanes == 1 else (4, lanes // 4)


def shaded(lanes):
    """Pixels that one work-item of `shade.color` lights: enough to fill its lanes most of the time."""
    return 1 if lanes == 1 else 64


def drawn(lanes):
    """Strands that one work-item of `raster.lines` draws."""
    return 1 if lanes == 1 else 16


def disc(points):
    """So many points of a disc of radius 1, as even as can be, from its middle on: float32 [points, 2] (Vogel 1979)."""
    number = np.arange(points)
    radius, angle = np.sqrt((number + 0.5) / points), number * (math.pi * (3 - math.sqrt(5)))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], 1).astype(np.float32)


def preamble(int64_atomics, checked=False, lanes=1, hinted=1, local=1 << 15):
    """The C text that every program starts with.

    ``int64_atomics``: whether the raster may take depth and id with one 64-bit atomic.
    ``lanes``: values that a work-item should take side by side, where it can.
    ``hinted``: the same for a kernel that tells the driver to leave its vectors alone, if more.
    ``checked``: whether the driver looks for races, and must not see the harmless ones.
    ``local``: bytes of local memory that a work-group may have; OpenCL promises these 32 KB.
    """
    patterns = [p for n in sorted(PATTERNS) for p in PATTERNS[n]]
    step = CONSTANTS["SUBPIXEL"] // 16
    table = ", ".join(f"(int2)({x * step}, {y * step})" for x, y in patterns)
    return "".join([
        *(f"#define {name} {_c_number(value)}\n" for name, value in CONSTANTS.items()),
        *(f"#define {name.upper().replace('-', '_')} {value}\n" for name, value in MODELS.items()),
        f"#define INT64_ATOMICS {int(int64_atomics)}\n",
        f"#define CHECKED {int(checked)}\n",
        f"#define LANES_HINTED {hinted}\n",
        f"#define HELD {min(local // 8, HELD)}\n",   # of 4 bytes, in half of it
        "#define LANES {}\n#define BLOCK_X {}\n#define BLOCK_Y {}\n".format(lanes, *block(lanes)),
        f"#define SHADED {shaded(lanes)}\n#define DRAWN {drawn(lanes)}\n",
        *(_c_struct(name, dtype) for name, dtype in STRUCTS.items()),
        f"__constant int2 PATTERN[] = {{{table}}};\n",
        *("__constant float2 {}[] = {{{}}};\n".format(name, ", ".join(f"(float2)({x}f, {y}f)" for x, y in disc(points)))
          for name, points in (("DISC", DISC_POINTS), ("SEARCH", SEARCH_POINTS))),
    ])


def least_half_width(samples):
    """Half the width at which thinner strands are drawn, in sub-pixels: a sample's share of a pixel, 1/samples.

    Wider would keep strands from breaking up between samples (5/8 of a pixel with 4 samples, 1/4 with 16), but shows
    thin fur too dense; narrower loses some.
    """
    return CONSTANTS["SUBPIXEL"] / 2 / samples


def pattern_start(samples):
    """First row in PATTERN of the pattern with this many samples a pixel."""
    return sum(n for n in PATTERNS if n < samples)


@dataclasses.dataclass(frozen=True)
class Declared:
    """An array on the device before there is one.

    of: what it has a row for, "point", "pixel" or the like.  dtype, width: of a row, of so many values; None: of one.
    fill: the value that it is filled with at first, nothing if None.
    """

    of: str
    dtype: Any
    width: int | None = None
    fill: Any = None

    @property
    def bytes(self):
        """Bytes of a row."""
        return np.dtype(self.dtype).itemsize * (self.width or 1)

    def empty(self, gpu, rows):
        """The array itself, with so many rows, a number or several: [*rows, width]."""
        shape = (*(rows if isinstance(rows, tuple) else (rows,)), *[self.width] * bool(self.width))
        return gpu.empty(shape, self.dtype) if self.fill is None else gpu.full(shape, self.dtype, self.fill)


def array(of, *rest, **keys):
    """A field of `Arrays` that holds an array on the device: a `Declared`, or what makes one."""
    return dataclasses.field(metadata={"declared": of if isinstance(of, Declared) else Declared(of, *rest, **keys)})


class Arrays:
    """Base of the dataclasses that hold arrays on the device: each is declared, with `array`, and annotated Any.

    Raises TypeError for a class with a field of Any that is not declared, and for an object whose arrays are not as
    they are declared, or of which two with rows of the same have another number of them; an empty one may stand for
    none.
    """

    declared: ClassVar[dict[str, Declared]]

    def __init_subclass__(cls):
        fields = {name: getattr(cls, name, None) for name in cls.__annotations__}
        declared = {name: each.metadata["declared"] for name, each in fields.items()
                    if isinstance(each, dataclasses.Field) and "declared" in each.metadata}
        for name, kind in cls.__annotations__.items():
            if (kind is Any) != (name in declared):
                raise TypeError(f"{cls.__name__}.{name} is of {kind}; allowed: Any with layout.array, or another type")
        cls.declared = {**getattr(cls, "declared", {}), **declared}

    def __post_init__(self):
        rows = {}
        for name, value in vars(self).items():
            known = self.declared.get(name)
            if known is None:
                if hasattr(value, "base_data"):
                    raise TypeError(f"{type(self).__name__}.{name} is an array on the device that is not declared")
                continue
            shape, end = value.shape, (known.width,) if known.width else ()
            before = shape[:len(shape) - len(end)]
            if (value.size and rows.setdefault(known.of, before) != before) or (
                    value.dtype != known.dtype or shape[len(before):] != end):
                raise TypeError(f"{type(self).__name__}.{name} is {value.dtype} {list(shape)}; allowed: "
                                f"{np.dtype(known.dtype)} {[*rows.get(known.of, before), *end]}")

    @classmethod
    def empty(cls, gpu, rows, **given):
        """One of this class: its arrays as declared, with so many ``rows``, {"point": 7, ...}, but those ``given``."""
        made = {name: known.empty(gpu, rows[known.of]) for name, known in cls.declared.items() if name not in given}
        return cls(**made, **given)

    @classmethod
    def bytes(cls, *names, **rows):
        """Bytes on the device of its arrays, all or those of these ``names``, that have rows of these, so many of each:
        ``bytes(point=7)``."""
        return sum(cls.declared[name].bytes * rows.get(cls.declared[name].of, 0) for name in names or cls.declared)
