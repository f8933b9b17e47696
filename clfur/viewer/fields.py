"""What a person can turn: one table of fields for each class, with ranges that go with the size of the mesh."""

import math
import re
from collections.abc import Callable
from typing import Any

import attrs

from ..color import linear_to_srgb, srgb_to_linear
from ..errors import Error
from .changes import Path

CURVE = 3.0   # of a slider of lengths: more of its way for small ones


@attrs.frozen
class Field:
    """A knob: where it stands, what it is called, what it may be.

    path: from the object of its table on. kind: "number", "whole", "color", "vector", "from" (a direction, told by
    where it comes from), "choice" or "flag". low, high: of the slider; a typed number may be beyond, if the class takes
    it. scale: whether these are in radii of the mesh. curve: "linear", "log", or "fine", with more way for what is
    small. unit, hint: words beside and over it. choices: {value: label}. given: None, or what it becomes when it is
    switched on, as it may be off, which is the value ``off``. when: None, or a function of the object that tells
    whether it has a say.
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


SHAPE = (
    Field(("length",), "Length", high=0.6, curve="fine", scale=True, when=_has("length")),
    Field(("stiffness",), "Stiffness", low=0.05, high=10, curve="log", unit="lengths", when=_has("stiffness"),
          hint="How many of its lengths a hair takes to bend by one radian under a force of 1"),
    Field(("segment_length",), "Segment length", high=0.1, curve="fine", scale=True, when=_has("segment_length")),
    Field(("force_weight",), "Softness", high=2, curve="fine", when=_has("force_weight"),
          hint="How much of the force is added in each segment"),
    Field(("segments",), "Segments", "whole", high=64, hint="How smoothly a hair bends; 0 is bald"),
    Field(("width",), "Width", low=1e-4, high=0.02, curve="log", scale=True, hint="Diameter of a hair"),
    Field(("root_width",), "Root width", high=2, unit="×", hint="Share of the width at the root"),
    Field(("tip_width",), "Tip width", high=2, unit="×", hint="Share of the width at the tip"),
    Field(("taper",), "Taper", low=0.01, high=0.99, hint="How much of the taper is done at half of the length"),
)
CURLS = (
    Field(("curl", 0), "Curl radius", high=0.1, curve="fine", scale=True),
    Field(("curl", 1), "Curl turns", low=-20, high=20, unit="turns"),
    Field(("wave", 0), "Wave height", high=0.1, curve="fine", scale=True),
    Field(("wave", 1), "Waves", high=20, unit="periods"),
    Field(("frizz", 0), "Frizz", high=0.05, curve="fine", scale=True, hint="How far hair strays at random"),
    Field(("frizz", 1), "Frizz waves", high=40, unit="waves"),
)
VARIES = (
    Field(("length_variation",), "Length varies"),
    Field(("direction_variation",), "Direction varies"),
    Field(("color_variation",), "Colour varies"),
)
COLORS = (
    Field(("color",), "Colour", "color", when=_unpigmented),
    Field(("root_color",), "Root colour", "color", given=(0.2, 0.12, 0.06), when=_unpigmented),
    Field(("tip_color",), "Tip colour", "color", given=(0.9, 0.75, 0.5), when=_unpigmented),
    Field(("alpha",), "Transparency", hint="How much light one hair lets through"),
)
KAJIYA = (
    Field(("specular",), "Highlight", high=2, curve="fine"),
    Field(("exponent",), "Gloss", low=1, high=1000, curve="log", hint="How narrow the highlight is"),
    Field(("highlight",), "Model", "choice", choices={"kajiya-kay": "Kajiya-Kay", "half-vector": "half vector"}),
)
CHIANG = (
    Field(("longitudinal_roughness",), "Roughness along", low=0.05),
    Field(("azimuthal_roughness",), "Roughness around", low=0.1),
    Field(("tilt",), "Scales lean", low=-20, high=20, unit="°"),
    Field(("index",), "Refraction", low=1.1, high=3),
    Field(("eumelanin",), "Black pigment", high=8, given=1.3, hint="Eumelanin: 1.3 is brown, 8 black"),
    Field(("pheomelanin",), "Red pigment", high=8, given=0.5, hint="Pheomelanin"),
)
TUFTS = (
    Field(("count",), "Tufts", "whole", low=1, high=100_000, curve="log", when=_has("count")),
    Field(("density",), "Density", low=1, high=100_000, curve="log", unit="/ area", when=_has("density")),
    Field(("strength",), "Strength", hint="How far tips are drawn together"),
    Field(("profile",), "Profile", low=0.01, high=0.99, hint="How much of that is done at half of the length"),
    Field(("size_variation",), "Size varies"),
)
GROWTH = (
    Field(("roots",), "Hairs", "whole", low=100, high=1_000_000, curve="log", given=50_000, off="faces",
          hint="Spread evenly by area; switched off: one in each triangle"),
    Field(("force",), "Force", "vector", low=-3, high=3, hint="Gravity and the like; 1 bends as stiffness says"),
    Field(("collision",), "Slides on the skin", "flag", hint="Hair that would enter the mesh lies on it"),
    Field(("surface",), "Skin", "choice", choices={"pn": "curved", "flat": "flat"}),
    Field(("seed",), "Seed", "whole", high=1000, hint="Of all that is random"),
)
SHELLS = (
    Field(("length",), "Height", low=1e-3, high=0.3, curve="fine", scale=True),
    Field(("layers",), "Layers", "whole", low=1, high=128),
    Field(("hairs",), "Hairs", "whole", low=100, high=1_000_000, curve="log", when=_has("hairs")),
    Field(("frequency",), "Frequency", low=1, high=1000, curve="log", when=lambda shells: shells.hairs is None),
    Field(("density",), "Thickness", low=0.02, hint="How much of its cell a hair fills"),
    Field(("sharpness",), "Soft edges", low=1.01, high=4),
    Field(("noise", 0), "Ruffled", high=3, unit="hairs", hint="How far hairs are moved"),
    Field(("noise", 1), "Ruffles", low=1, high=50, unit="hairs", hint="How large the waves of that are"),
    Field(("length_variation",), "Height varies"),
    Field(("color",), "Colour", "color"),
    Field(("alpha",), "Transparency", hint="How much light one hair lets through"),
    Field(("root_shade",), "Light at roots"),
    Field(("look", "specular"), "Highlight", high=2, curve="fine"),
    Field(("look", "exponent"), "Gloss", low=1, high=1000, curve="log"),
    Field(("force",), "Force", "vector", low=-3, high=3),
)
LIGHT = (
    Field(("direction",), "From", "from"),
    Field(("color",), "Colour", "color"),
    Field(("intensity",), "Intensity", high=8, curve="fine"),
    Field(("size",), "Softness", high=30, curve="fine", unit="°", when=lambda light: light.position is None,
          hint="How large the light looks: the sun has 0.53°"),
    Field(("size",), "Softness", high=1, curve="fine", scale=True, when=_has("position"), hint="The lamp's radius"),
    Field(("position",), "Position", "vector", low=-5, high=5, scale=True, when=_has("position")),
    Field(("angle",), "Cone", low=1, high=170, unit="°", when=lambda light: light.position is not None and (
        light.angle < 180)),
    Field(("ambient",), "Ambient", given=0.1, hint="White light from everywhere; off: as suits the scene"),
    Field(("shadows",), "Casts shadows", "flag"),
)
SKY = (
    Field(("sky",), "Colour", "color", when=lambda sky: sky.sky.ndim == 1),
    *(Field(("sky", n), label, "color", when=lambda sky: sky.sky.ndim == 2)
      for n, label in enumerate(("Zenith", "Horizon", "Below"))),
    Field(("intensity",), "Intensity", high=8, curve="fine"),
    Field(("rotation",), "Turned", low=-180, high=180, unit="°", when=lambda sky: sky.sky.ndim == 3),
)
GROUND = (
    Field(("color",), "Colour", "color", given=(0.3, 0.3, 0.3), hint="Switched off: its shadow alone"),
    Field(("height",), "Height", low=-2, high=2, scale=True, given=-1.0, hint="Switched off: under the mesh"),
)
MOTION = (
    Field(("wind", "velocity"), "Wind", "vector", low=-10, high=10, unit="m/s"),
    Field(("wind", "gust"), "Gusts", high=4, unit="×"),
    Field(("wind", "size"), "Gust size", low=0.01, high=10, curve="log", unit="m"),
    Field(("wind", "skin"), "Still air", high=0.2, curve="fine", unit="m", hint="Height over the skin without wind"),
    Field(("wind", "shelter"), "Shelter", high=4, hint="How much hair upwind holds the wind back"),
    Field(("units_per_metre",), "A metre is", low=0.01, high=1000, curve="log", unit="units"),
    Field(("gravity",), "Gravity", "vector", low=-20, high=20, unit="m/s²"),
    Field(("hair_on_hair",), "Hair on hair", low=0.005, high=1, curve="log", unit="s", given=0.05,
          hint="Seconds in which hair takes the speed of the hair around it"),
)
HAIR_MOTION = (
    Field(("bend_length",), "Bears itself", low=0.01, high=2, curve="log", scale=True, given=0.3,
          hint="Shorter hair stands, longer droops; off: the longest of its type"),
    Field(("air",), "Air", low=0.01, high=5, curve="log", unit="s", given=0.2, hint="In which air slows hair down"),
    Field(("damping",), "Damping", high=0.5, curve="fine", unit="s"),
    Field(("inertia",), "Inertia", hint="How much of its root's motion it does not go along with by itself"),
    Field(("friction",), "Friction", high=2),
)


def _free(settings):
    return settings.goal is None


SETTINGS = (
    Field(("samples",), "Samples", "choice", choices={1: "1", 4: "4", 16: "16"}, when=_free),
    Field(("raster",), "Raster", "choice", choices={"coverage": "coverage", "samples": "samples"}, when=_free),
    Field(("shadows",), "Shadows", "choice", choices={each: each for each in (
        "off", "binary", "count", "trilinear", "length", "deep")}, when=_free),
    Field(("grid",), "Shadow grid", "choice", choices={n: str(n) for n in (
        16, 32, 48, 64, 96, 128, 160, 192, 256, 384, 512)}, unit="cells", when=_free),
    Field(("shadow_map",), "Shadow map", "choice", choices={n: str(n) for n in (0, 128, 256, 512, 1024, 2048, 4096)},
          unit="texels", when=_free, hint="Of the body; 0 for none"),
    Field(("pcf",), "Soft map", "whole", high=8, unit="texels", when=_free),
    Field(("masks",), "Masks", "choice", choices={0: "off", 4: "4 × 4"}, when=_free,
          hint="Hair hides hair in parts of a pixel"),
    Field(("scattering",), "Hair to hair", "choice", choices={"off": "off", "grid": "grid"}, when=_free,
          hint="Light that goes from hair to hair, of the glassy look"),
    Field(("lod",), "Coarser", high=4, curve="fine", unit="pixels", when=_free,
          hint="Thinner hair is drawn as fewer and wider strands"),
    Field(("blur",), "Blur", "choice", choices={"off": "off", "edges": "edges", "all": "all"}),
    Field(("blur_sigma",), "Blur width", low=0.1, high=4, unit="pixels", when=lambda settings: settings.blur != "off"),
    Field(("filtered",), "Filtered shells", "flag"),
    Field(("max_error",), "Error up to", low=0.002, high=0.2, curve="log", given=0.03, when=lambda settings: (
        settings.goal != "seconds"), hint="Choose the cheapest settings that err by no more"),
    Field(("seconds",), "Time up to", low=0.05, high=60, curve="log", unit="s", given=1.0, when=lambda settings: (
        settings.goal != "max_error"), hint="Choose the best settings whose frame takes no longer"),
)
