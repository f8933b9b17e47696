"""What a person can turn: one table of fields for each class, with ranges that go with the size of the mesh."""

import math
import re
from collections.abc import Callable
from typing import Any

import attrs

from ..color import linear_to_srgb, srgb_to_linear
from ..errors import Error
from .changes import Path
from .shades import root_shade, tip_shade

CURVE = 3.0   # of a slider of lengths: more of its way for small ones


@attrs.frozen
class Field:
    """A knob: where it stands, what it is called, what it may be.

    path: from the object of its table on. kind: "number", "whole", "color", "vector", "from" (a direction, told by
    where it comes from), "choice", "flag" or "key" (a colour that is told, not turned). low, high: of the slider; a
    typed number may be beyond, if the class takes it. scale: whether these are in radii of the mesh. curve: "linear",
    "log", or "fine", with more way for what is small. unit, hint: words beside and over it. choices: {value: label}.
    given: None, or what it becomes when it is switched on, or a function of the object that tells it, as it may be off,
    which is the value ``off``. when: None, or a function of the object that tells whether it has a say.
    """

    path: Path
    label: str
    kind: str = "number"
    low: float = 0.0
    high: float = 1.0
    curve: str = "linear"
    scale: bool = False
    unit: str = ""
    hint: str = ""
    choices: dict[Any, str] | None = None
    given: Any = None
    off: Any = None
    when: Callable[[Any], bool] | None = None

    def sized(self, path: Path, radius: float) -> "Field":
        """The field at a path of its object, for a mesh of this radius."""
        times = radius if self.scale else 1.0
        given = self.given * times if self.scale and self.given is not None else self.given
        return attrs.evolve(self, path=(*path, *self.path), low=self.low * times, high=self.high * times, given=given,
                            unit=self.unit or ("units" if self.scale else ""))

    def share(self, value: float) -> float:
        """Where a slider from 0 to 1 stands at a value."""
        low, high = self.low, self.high
        if self.curve == "log":
            value, low, high = (math.log(max(each, 1e-12)) for each in (value, low, high))
        share = min(max((value - low) / (high - low), 0.0), 1.0)
        return share ** (1 / CURVE) if self.curve == "fine" else share

    def value(self, share: float) -> Any:
        """The value, with three digits, where a slider from 0 to 1 stands; whole numbers are whole."""
        if self.curve == "log":
            number = self.low * (self.high / self.low) ** share
        else:
            number = self.low + (self.high - self.low) * (share ** CURVE if self.curve == "fine" else share)
        return round(number) if self.kind == "whole" else float(f"{number:.3g}")


def refused(field: Field, line: str) -> str:
    """Return an Error's line by the label of a field that was refused: "Length: -1 is not allowed; allowed: ..."."""
    names = [step for step in field.path if isinstance(step, str)]
    told = re.fullmatch(rf"\w+\.{names[-1]} is (.*?); allowed: (.*)", line, re.DOTALL)
    return f"{field.label}: {told[1].removesuffix('.0')} is not allowed; allowed: {told[2]}" if told else (
        f"{field.label}: {line}")


def hex_of(color: Any) -> str:
    """Return linear RGB as pickers have it: sRGB, "#rrggbb"."""
    coded = [round(float(each) * 255) for each in linear_to_srgb(color).reshape(-1)[:3]]
    return "#" + "".join(f"{each:02x}" for each in coded)


def color_of(text: str) -> tuple[float, float, float]:
    """Return linear RGB of "#rrggbb"; raises Error for anything else."""
    try:
        parts = bytes.fromhex(text.strip().removeprefix("#"))
    except ValueError:
        parts = b""
    if len(parts) != 3:
        raise Error(f"the colour is {text!r:.40}; allowed: #rrggbb")
    red, green, blue = srgb_to_linear([each / 255 for each in parts]).tolist()
    return red, green, blue


def angles_of(direction: Any) -> tuple[float, float]:
    """Return (azimuth, elevation) in degrees of where a direction comes from: 0, 0 is +Z, 90, 0 is +X."""
    x, y, z = (-float(each) for each in direction)
    return math.degrees(math.atan2(x, z)), math.degrees(math.atan2(y, math.hypot(x, z)))


def direction_of(azimuth: float, elevation: float) -> tuple[float, float, float]:
    """Return the direction that comes from there."""
    a, e = math.radians(azimuth), math.radians(elevation)
    return -math.sin(a) * math.cos(e), -math.sin(e), -math.cos(a) * math.cos(e)


def _has(name):
    """A function of an object that tells whether a field is given."""
    return lambda thing: getattr(thing, name) is not None


def _unpigmented(kind):
    return kind.look.color is None


FLOOR = 0.3, 0.3, 0.3   # linear RGB of a ground
TRANSPARENCY = Field(("alpha",), "Transparency", hint="Share of the light that one hair lets through: 0 is opaque")
SHAPE = (
    Field(("length",), "Length", high=0.6, curve="fine", scale=True, when=_has("length"), hint="From root to tip"),
    Field(("stiffness",), "Stiffness", low=0.05, high=10, curve="log", unit="lengths", when=_has("stiffness"),
          hint="How many of its lengths a hair takes to bend by one radian under a force of 1: more is stiffer"),
    Field(("segment_length",), "Segment length", high=0.1, curve="fine", scale=True, when=_has("segment_length"),
          hint="A hair is as long as all its segments"),
    Field(("force_weight",), "Force weight", high=2, curve="fine", when=_has("force_weight"),
          hint="How much of the force each segment adds to its direction: more is softer"),
    Field(("segments",), "Segments", "whole", high=64, hint="Straight pieces of a hair: more bend more smoothly; 0 is "
          "bald"),
    Field(("width",), "Width", low=1e-4, high=0.02, curve="log", scale=True, hint="Diameter of a hair"),
    Field(("root_width",), "Root width", high=2, unit="× width", hint="Width at the root, in widths"),
    Field(("tip_width",), "Tip width", high=2, unit="× width", hint="Width at the tip, in widths; 0 is a point"),
    Field(("taper",), "Taper", low=0.01, high=0.99, hint="Share of the change from root to tip width that is done at "
          "half of the length; 0.5: a straight cone"),
)
CURLS = (
    Field(("curl", 0), "Curl radius", high=0.1, curve="fine", scale=True, hint="Of the helix that a hair winds along"),
    Field(("curl", 1), "Curl turns", low=-20, high=20, unit="turns", hint="From root to tip; below 0 the other way "
          "round"),
    Field(("wave", 0), "Wave amplitude", high=0.1, curve="fine", scale=True, hint="How far a wave goes to one side"),
    Field(("wave", 1), "Wave periods", high=20, unit="periods", hint="Waves from root to tip"),
    Field(("frizz", 0), "Frizz amplitude", high=0.05, curve="fine", scale=True, hint="How far each hair strays at "
          "random"),
    Field(("frizz", 1), "Frizz waves", high=40, unit="waves", hint="Random waves from root to tip"),
)
VARIES = (
    Field(("length_variation",), "Length variation", hint="Random variation of the length: 0 none, 1 down to nothing"),
    Field(("direction_variation",), "Direction variation", hint="How far hairs lean at random: 0 none"),
    Field(("color_variation",), "Colour variation", hint="Random variation of the brightness: 0 none"),
)
COLORS = (
    Field(("color",), "Colour", "color", when=_unpigmented,
          hint="Of the hair; root and tip colour go with it until they are chosen themselves"),
    Field(("root_color",), "Root colour", "color", given=root_shade, when=_unpigmented,
          hint="In place of the colour at the root; goes with the colour until it is chosen. Off: the colour"),
    Field(("tip_color",), "Tip colour", "color", given=tip_shade, when=_unpigmented,
          hint="In place of the colour at the tip; goes with the colour until it is chosen. Off: the colour"),
    TRANSPARENCY,
)
KAJIYA = (
    Field(("specular",), "Specular", high=2, curve="fine", hint="Strength of the highlight"),
    Field(("exponent",), "Specular exponent", low=1, high=1000, curve="log", hint="How narrow the highlight is: more "
          "is glossier"),
    Field(("highlight",), "Specular model", "choice", choices={
        "kajiya-kay": "Kajiya-Kay", "half-vector": "half vector"},
          hint="Kajiya-Kay: a highlight from every side; half vector: none against the light"),
)
CHIANG = (
    Field(("longitudinal_roughness",), "Roughness", low=0.05, hint="Longitudinal roughness: how far highlights spread "
          "along the hair"),
    Field(("azimuthal_roughness",), "Radial roughness", low=0.1, hint="Azimuthal roughness: how far light spreads "
          "around the hair"),
    Field(("tilt",), "Cuticle tilt", low=-20, high=20, unit="°", hint="Angle of the scales on a hair, which moves the "
          "highlight towards the root"),
    Field(("index",), "IOR", low=1.1, high=3, hint="Index of refraction; hair has 1.55"),
    Field(("eumelanin",), "Eumelanin", high=8, given=1.3, hint="Brown-black pigment in place of the colour: 1.3 is "
          "brown, 8 black"),
    Field(("pheomelanin",), "Pheomelanin", high=8, given=0.5, hint="Yellow-red pigment in place of the colour"),
)
TUFTS = (
    Field(("count",), "Count", "whole", low=1, high=100_000, curve="log", when=_has("count"), unit="tufts",
          hint="On the whole mesh"),
    Field(("density",), "Density", low=1, high=100_000, curve="log", unit="/ area", when=_has("density"),
          hint="Tufts on a square unit"),
    Field(("strength",), "Strength", hint="How far tips are drawn together: 0 not, 1 to a point"),
    Field(("profile",), "Profile", low=0.01, high=0.99, hint="Share of that which is done at half of the length; 0.5: "
          "evenly"),
    Field(("size_variation",), "Size variation", hint="How much tufts differ in size: 0 not"),
)
GROWTH = (
    Field(("roots",), "Strands", "whole", low=100, high=1_000_000, curve="log", given=50_000, off="faces",
          hint="How many hairs, spread evenly by area; off: one in each triangle"),
    Field(("force",), "Force", "vector", low=-3, high=3, hint="Direction and strength of gravity and the like as hair "
          "grows; 1 bends as its stiffness says"),
    Field(("collision",), "Collision", "flag", hint="Hair that would enter the mesh is laid along it"),
    Field(("surface",), "Surface", "choice", choices={"pn": "smooth (PN)", "flat": "flat"},
          hint="Whether triangles of the mesh are curved by their normals"),
    Field(("seed",), "Seed", "whole", high=1000, hint="Another number gives other random hair"),
)
SHELLS = (
    Field(("length",), "Length", low=1e-3, high=0.3, curve="fine", scale=True, hint="Height of the fur over the skin"),
    Field(("layers",), "Layers", "whole", low=1, high=128, hint="Steps from roots to tips: more are finer, and slower"),
    Field(("hairs",), "Hairs", "whole", low=100, high=1_000_000, curve="log", when=_has("hairs"),
          hint="On the whole mesh"),
    Field(("frequency",), "Frequency", low=1, high=1000, curve="log", when=lambda shells: shells.hairs is None,
          unit="/ unit", hint="Hairs along a unit of length; of the pattern 'sine', waves in uv"),
    Field(("density",), "Density", low=0.02, hint="Share of its cell that a hair fills"),
    Field(("sharpness",), "Edge softness", low=1.01, high=4, hint="Where the edge of a hair ends, over where it "
          "begins: 1 is sharp"),
    Field(("noise", 0), "Noise amplitude", high=3, unit="hairs", hint="How far hairs are moved, in their distances"),
    Field(("noise", 1), "Noise size", low=1, high=50, unit="hairs", hint="How large the waves of that are"),
    Field(("length_variation",), "Length variation", hint="Random variation of the length: 0 none, 1 down to nothing"),
    Field(("color",), "Colour", "color", hint="Of the undercoat"),
    TRANSPARENCY,
    Field(("root_shade",), "Root shade", hint="Share of the light that roots get: less is darker"),
    Field(("look", "specular"), "Specular", high=2, curve="fine", hint="Strength of the highlight"),
    Field(("look", "exponent"), "Specular exponent", low=1, high=1000, curve="log", hint="How narrow the highlight is: "
          "more is glossier"),
    Field(("force",), "Force", "vector", low=-3, high=3, hint="Gravity and the like: where the tips lean, in lengths"),
)
LIGHT = (
    Field(("direction",), "Direction", "from", hint="Where the light comes from: degrees around the vertical (0 is "
          "+Z, 90 is +X), and over the horizon"),
    Field(("color",), "Colour", "color", hint="Of the light"),
    Field(("intensity",), "Intensity", high=8, curve="fine", hint="Times the colour; not of the ambient light"),
    Field(("size",), "Angular size", high=30, curve="fine", unit="°", when=lambda light: light.position is None,
          hint="Diameter of the light as it is seen: larger has softer shadows; the sun has 0.53°"),
    Field(("size",), "Radius", high=1, curve="fine", scale=True, when=_has("position"),
          hint="Of the lamp: larger has softer shadows"),
    Field(("position",), "Position", "vector", low=-5, high=5, scale=True, when=_has("position"), hint="Of the lamp"),
    Field(("angle",), "Cone angle", low=1, high=170, unit="°", when=lambda light: light.position is not None and (
        light.angle < 180), hint="The whole angle of the spot's cone"),
    Field(("ambient",), "Ambient", given=0.1, hint="White light from everywhere; off: 0.1, or 0 with a sky or multiple "
          "scattering"),
    Field(("shadows",), "Casts shadows", "flag", hint="Whether hair and body are in the way of this light"),
)
SKY = (
    Field(("sky",), "Colour", "color", when=lambda sky: sky.sky.ndim == 1, hint="Of the light from everywhere"),
    *(Field(("sky", n), label, "color", when=lambda sky: sky.sky.ndim == 2, hint=hint)
      for n, (label, hint) in enumerate((("Zenith", "Straight above"), ("Horizon", "All around"),
                                         ("Nadir", "Straight below")))),
    Field(("intensity",), "Intensity", high=8, curve="fine", hint="Times the sky's colours"),
    Field(("rotation",), "Rotation", low=-180, high=180, unit="°", when=lambda sky: sky.sky.ndim == 3,
          hint="Of the picture, around the vertical"),
)
GROUND = (
    Field(("color",), "Colour", "color", given=FLOOR, hint="Off: a shadow catcher, which is its shadow alone"),
    Field(("height",), "Height", low=-2, high=2, scale=True, given=-1.0,
          hint="Its y in the world; off: under the mesh"),
)
MOTION = (
    Field(("wind", "velocity"), "Wind", "vector", low=-10, high=10, unit="m/s", hint="Where the wind blows to, and how "
          "fast"),
    Field(("wind", "gust"), "Gust strength", high=4, unit="× wind", hint="Speed of gusts, in speeds of the wind"),
    Field(("wind", "size"), "Gust size", low=0.01, high=10, curve="log", unit="m", hint="How far gusts are apart"),
    Field(("wind", "skin"), "Boundary layer", high=0.2, curve="fine", unit="m",
          hint="Height over the skin below which wind is slower; at the skin there is none"),
    Field(("wind", "shelter"), "Shelter", high=4, hint="How much hair upwind holds the wind back: 0 not"),
    Field(("units_per_metre",), "Units per metre", low=0.01, high=1000, curve="log", unit="units",
          hint="Scale of the scene, which tells how fast things fall"),
    Field(("gravity",), "Gravity", "vector", low=-20, high=20, unit="m/s²", hint="The Earth's is -9.81 in y"),
    Field(("hair_on_hair",), "Hair on hair", low=0.005, high=1, curve="log", unit="s", given=0.05,
          hint="Friction between hairs: seconds in which one takes the speed of those around it; off: none"),
)
HAIR_MOTION = (
    Field(("bend_length",), "Bend length", low=0.01, high=2, curve="log", scale=True, given=0.3,
          hint="Hair shorter than this stands, longer droops; off: the longest of its type"),
    Field(("air",), "Air drag", low=0.01, high=5, curve="log", unit="s", given=0.2,
          hint="Seconds in which hair takes the speed of the air: less is more drag; off: none"),
    Field(("damping",), "Damping", high=0.5, curve="fine", unit="s", hint="Of bending: more swings for less long"),
    Field(("inertia",), "Inertia", hint="0: hair goes with its root; 1: it lags behind by its own mass"),
    Field(("friction",), "Friction", high=2, hint="On the mesh, Coulomb's: 1 holds hair on a slope of 45°"),
)


def _free(settings):
    return settings.goal is None


SETTINGS = (
    Field(("samples",), "Samples", "choice", choices={1: "1", 4: "4", 16: "16"}, when=_free, unit="/ pixel",
          hint="Of the body and shells, and of hair with the raster 'samples'"),
    Field(("raster",), "Raster", "choice", choices={"coverage": "coverage", "samples": "samples"}, when=_free,
          hint="coverage: the area of each hair in a pixel, transparent; samples: opaque hair, fast"),
    Field(("shadows",), "Shadows", "choice", choices={each: each for each in (
        "off", "binary", "count", "trilinear", "length", "deep")}, when=_free,
        hint="How hair casts them, from the roughest to the best"),
    Field(("grid",), "Shadow grid", "choice", choices={n: str(n) for n in (
        16, 32, 48, 64, 96, 128, 160, 192, 256, 384, 512)}, unit="cells", when=_free,
        hint="Cells a side of each light's grid of hair: more have finer shadows"),
    Field(("shadow_map",), "Shadow map", "choice", choices={n: str(n) for n in (0, 128, 256, 512, 1024, 2048, 4096)},
          unit="texels", when=_free, hint="Texels a side, for shadows of the body; 0 for none"),
    Field(("pcf",), "PCF radius", "whole", high=8, unit="texels", when=_free,
          hint="Percentage-closer filtering: how far the body's shadows are softened"),
    Field(("masks",), "Pixel masks", "choice", choices={0: "off", 4: "4 × 4"}, when=_free,
          hint="Hair hides hair in so many parts of a pixel, not at random in it"),
    Field(("scattering",), "Multiple scattering", "choice", choices={"off": "off", "grid": "grid"}, when=_free,
          hint="Light that goes on from hair to hair, for the Chiang model"),
    Field(("lod",), "Level of detail", high=4, curve="fine", unit="pixels", when=_free,
          hint="Hair thinner than this is drawn as fewer, wider strands; 0: all there are"),
    Field(("blur",), "Blur", "choice", choices={"off": "off", "edges": "edges", "all": "all"},
          hint="A Gaussian over the picture, or over the edges of fur alone"),
    Field(("blur_sigma",), "Blur radius", low=0.1, high=4, unit="pixels", when=lambda settings: settings.blur != "off",
          hint="Standard deviation of the Gaussian"),
    Field(("filtered",), "Filter shells", "flag", hint="The undercoat's pattern is averaged over each pixel"),
    Field(("max_error",), "Max. error", low=0.002, high=0.2, curve="log", given=0.03, when=lambda settings: (
        settings.goal != "seconds"), hint="Choose the cheapest settings that err by no more: root mean square of sRGB, "
        "0 to 1"),
    Field(("seconds",), "Max. time", low=0.05, high=60, curve="log", unit="s", given=1.0, when=lambda settings: (
        settings.goal != "max_error"), hint="Choose the best settings whose frame takes no longer"),
)
