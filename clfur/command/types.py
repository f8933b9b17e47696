"""What the options of the commands take: numbers, sizes, colours, names."""

import math
import re
from pathlib import Path

import attrs
import click
import numpy as np

from ..color import srgb_to_linear
from ..errors import Error
from ..files.images import load_picture
from ..scene import Chiang, Environment, Kajiya, Light, Tufts
from ..scene.checks import LARGEST
from ..scene.maps import NAMES


def read_for(flag, read, path):
    """What ``read`` gives of a path; its error begins with the option that names the file."""
    try:
        return read(path)
    except Error as error:
        raise Error(f"{flag}: {error}") from error


def _short(number):
    return str(number) if isinstance(number, int) else f"{number:g}"


class _Within:
    """A number within limits; click would say "not a valid integer range"."""

    def convert(self, value, param, ctx):
        try:
            number = super().convert(value, param, ctx)
        except click.BadParameter:
            number = math.nan
        if math.isnan(number):
            low = "" if self.min is None else f" {'above' if self.min_open else 'from'} {_short(self.min)}"
            high = "" if self.max is None else f"{' and at most' if self.min_open else ' to'} {_short(self.max)}"
            self.fail(f"{value!r} is not {self.words}{low}{high}", param, ctx)
        return number


class Whole(_Within, click.IntRange):
    words = "a whole number"


class AnyWhole(_Within, click.types.IntParamType):   # whose limits the scene's own check tells
    min, max, min_open, words = None, None, False, "a whole number"


class AnyReal(_Within, click.types.FloatParamType):
    min, max, min_open, words = None, None, False, "a number"


class Real(_Within, click.FloatRange):
    words = "a number"


class Numbers(click.ParamType):
    """Numbers with commas between them, such as 0,-1,0."""

    def __init__(self, count):
        self.count = count
        self.name = "numbers"

    def convert(self, value, param, ctx):
        if isinstance(value, tuple):
            return value
        try:
            numbers = tuple(float(part) for part in value.split(","))
        except ValueError:
            numbers = ()
        if len(numbers) != self.count:
            self.fail(f"{value!r} is not {self.count} numbers with commas between them", param, ctx)
        return numbers


# Azimuth, from +Z towards +X, and elevation of the camera, in degrees.
VIEWS = {"34": (35.0, 15.0), "front": (0.0, 0.0), "back": (180.0, 0.0), "left": (-90.0, 0.0), "right": (90.0, 0.0),
         "top": (0.0, 90.0)}


class Size(click.ParamType):
    """Width and height in pixels, such as 640x480."""

    name = "size"

    def convert(self, value, param, ctx):
        if isinstance(value, tuple):
            return value
        parts = value.lower().split("x")
        if len(parts) != 2 or not all(part.isdecimal() and len(part) < 6 and 1 <= int(part) <= 16384 for part in parts):
            self.fail(f"{value!r} is not WIDTHxHEIGHT of 1 to 16384 pixels each, such as 640x480", param, ctx)
        return tuple(map(int, parts))


class Frames(click.ParamType):
    """Numbers of frames as Python has a range, such as 0:240 or 0:240:10."""

    name = "frames"

    def convert(self, value, param, ctx):
        if isinstance(value, range):
            return value
        parts = [part.strip() for part in value.split(":")]
        whole = all(part.isdecimal() and len(part) < 8 for part in parts)
        numbers = range(*map(int, parts)) if whole and len(parts) in (2, 3) and parts[2:] != ["0"] else ()
        if not numbers:
            self.fail(f"{value!r:.60} is not A:B or A:B:STEP, whole numbers of which B is above A, such as 0:240",
                      param, ctx)
        return numbers


class Subframes(click.ParamType):
    """How many pictures make a frame, or auto."""

    name = "subframes"

    def convert(self, value, param, ctx):
        if value == "auto" or isinstance(value, int):
            return value
        if not (value.isdecimal() and 1 <= int(value[:3]) <= 64):
            self.fail(f"{value!r:.60} is not auto or a whole number from 1 to 64", param, ctx)
        return int(value)


class Region(click.ParamType):
    """Column, row, width and height in pixels, such as 100,50,64,48."""

    name = "region"

    def convert(self, value, param, ctx):
        if isinstance(value, tuple):
            return value
        parts = [part.strip() for part in value.split(",")]
        if len(parts) != 4 or not all(part.isdecimal() and len(part) < 6 for part in parts):
            self.fail(f"{value!r} is not X,Y,WIDTH,HEIGHT in pixels, such as 100,50,64,48", param, ctx)
        return tuple(map(int, parts))


class Pictures(click.ParamType):
    """How many pictures a blur is the mean of, 1 to 64, or auto -> None."""

    name = "pictures"

    def convert(self, value, param, ctx):
        if value in ("auto", None):
            return None
        if not (str(value).isdecimal() and 1 <= int(value) <= 64):
            self.fail(f"{value!r} is not auto or a whole number from 1 to 64", param, ctx)
        return int(value)


class View(click.ParamType):
    """From where the camera looks, a name of `VIEWS` or AZIMUTH,ELEVATION in degrees -> direction [3] towards it."""

    name = "view"

    def convert(self, value, param, ctx):
        if isinstance(value, tuple):
            return value
        if value in VIEWS:
            azimuth, elevation = VIEWS[value]
        else:
            parts = value.split(",")
            try:
                azimuth, elevation = (float(part) for part in parts)
            except ValueError:
                azimuth = elevation = math.inf
            if not (abs(azimuth) <= 360 and abs(elevation) <= 90):
                self.fail(f"{value!r} is none of {', '.join(VIEWS)}, nor AZIMUTH,ELEVATION in degrees, -360 to 360 and "
                          "-90 to 90", param, ctx)
        around, up = math.radians(azimuth), math.radians(elevation)
        return math.sin(around) * math.cos(up), math.sin(up), math.cos(around) * math.cos(up)


class Bytes(click.ParamType):
    """A number of bytes, such as 2GiB, 512M or 8000000; K, M, G and T are powers of 1024."""

    name = "bytes"

    def convert(self, value, param, ctx):
        if isinstance(value, int):
            return value
        found = re.fullmatch(r"(\d{1,15}(?:\.\d{1,9})?) *([kmgt]?)(?:i?b)?", value.lower())
        number = int(float(found[1]) * 1024 ** " kmgt".index(found[2] or " ")) if found else 0
        if number < 1 << 20:
            self.fail(f"{value!r} is not a number of bytes such as 2GiB, 512M or 8000000; allowed: at least 1MiB",
                      param, ctx)
        return number


class Color(Numbers):
    """Linear R,G,B of 0 to 1, or sRGB #rrggbb."""

    def __init__(self):
        super().__init__(3)

    def convert(self, value, param, ctx):
        try:
            color = from_hex(value) if isinstance(value, str) and value.startswith("#") else super().convert(
                value, param, ctx)
        except (ValueError, click.BadParameter):
            color = ()
        if not color or not all(0 <= part <= 1 for part in color):   # 255,128,0 is no linear colour
            self.fail(f"{value!r} is neither R,G,B of 0 to 1 each (linear) nor #rrggbb (sRGB)", param, ctx)
        return color


class Height(click.ParamType):
    """A number, or the word lowest."""

    name = "height"

    def convert(self, value, param, ctx):
        if value == "lowest" or isinstance(value, float):
            return value
        number = _number(value)
        if isinstance(number, str) or not abs(number) <= LARGEST:   # no number is neither
            self.fail(f"{value!r} is neither 'lowest' nor a height from {-LARGEST:g} to {LARGEST:g}", param, ctx)
        return number


class Backdrop(Color):
    """A colour as `Color` has it, or the name of a picture."""

    def convert(self, value, param, ctx):
        words = value.split(",") if isinstance(value, str) else []
        if isinstance(value, str) and not value.startswith("#") and not all(map(_is_number, words)):
            return value
        return super().convert(value, param, ctx)


MAPS = tuple(name for name in NAMES if name != "on")   # that is --on


class MapText(click.ParamType):
    """What a map is of and its file, such as density=skin.png -> (name, file)."""

    name = "map"

    def convert(self, value, param, ctx):
        if isinstance(value, tuple):
            return value
        name, _, file = value.partition("=")
        if name not in MAPS or not file:
            self.fail(f"{value!r:.60} is not NAME=FILE; allowed names: {', '.join(MAPS)}", param, ctx)
        return name, file


class Way(click.ParamType):
    """A vector X,Y,Z, or the name of a file."""

    name = "way"

    def convert(self, value, param, ctx):
        parts = value.split(",") if isinstance(value, str) else []
        return tuple(map(float, parts)) if len(parts) == 3 and all(map(_is_number, parts)) else value


class Roots(click.ParamType):
    """The word faces, or a number of strands."""

    name = "roots"

    def convert(self, value, param, ctx):
        if value == "faces" or isinstance(value, int):
            return value
        if not value.isdecimal() or len(value) > 10:
            self.fail(f"{value!r} is neither 'faces' nor a number of strands", param, ctx)
        return int(value)


class Look(click.ParamType):
    """How hair scatters light, such as chiang or chiang:azimuthal_roughness=0.4,eumelanin=1.3."""

    name = "look"

    def convert(self, value, param, ctx):
        if not isinstance(value, str):
            return value
        try:
            return look_of(value)
        except ValueError as error:   # clfur.Error is one
            self.fail(str(error), param, ctx)


class TuftsText(click.ParamType):
    """Tufts in which hair gathers, such as 2000 or 2000:strength=0.9,within=200; False for off."""

    name = "tufts"

    def convert(self, value, param, ctx):
        try:
            return value != "off" and tufts_of(value) if isinstance(value, str) else value
        except ValueError as error:   # clfur.Error is one
            self.fail(str(error), param, ctx)


class Sky(click.ParamType):
    """A sky of one colour, of three, or of a picture, such as #88aaff, 1,1,1:.5,.5,.6:.1,.1,.1 or studio.hdr."""

    name = "sky"

    def convert(self, value, param, ctx):
        if not isinstance(value, str):
            return value
        numbers = re.fullmatch(r"[#\d.,:+\-a-fA-F\s]*", value) or all(map(_is_number, re.split("[,:]", value)))
        if Path(value).is_file() or ("." in value and not numbers):
            try:
                return Environment(load_picture(value))
            except Error as error:
                self.fail(f"{'' if value in str(error) else value + ': '}{error}", param, ctx)
        colors = [_color(part) for part in value.split(":")]
        if len(colors) not in (1, 3) or None in colors:
            self.fail(f"{value!r} is neither a colour, R,G,B of 0 to {LARGEST:g} each (linear) or #rrggbb "
                      "(sRGB), nor ZENITH:HORIZON:GROUND of three, nor a picture file", param, ctx)
        return Environment(colors if len(colors) == 3 else colors[0])


def _color(text):
    """Linear colour of a part of a sky's text, or None."""
    try:
        color = from_hex(text) if text.startswith("#") else tuple(map(float, text.split(",")))
    except ValueError:
        return None
    return color if len(color) == 3 and all(0 <= part <= LARGEST for part in color) else None


class LightText(click.ParamType):
    """A light, such as 1,-1,-0.6, the way that it travels, or sun direction=1,-1,-0.6 size=0.5."""

    name = "light"

    def convert(self, value, param, ctx):
        try:
            light_of(value)
        except ValueError as error:   # clfur.Error is one
            self.fail(str(error), param, ctx)
        return value


class Names(click.ParamType):
    """Names with commas between them."""

    name = "names"

    def convert(self, value, param, ctx):
        return value if isinstance(value, tuple) else tuple(part.strip() for part in value.split(","))


_ANY = "color", "intensity", "ambient", "size", "shadows"
LIGHTS = {"sun": ("direction", *_ANY), "point": ("position", *_ANY), "spot": ("position", "direction", "angle", *_ANY)}


def light_of(text, fields=None, middle=None):
    """The `Light` of a text: numbers with commas between them, the way of a distant light, or a kind, sun, point or
    spot, and its fields, NAME=VALUE each, with spaces between them. fields: what the text may leave out. middle: [3],
    what a spot looks at that has no direction. Raises `clfur.Error` for any other."""
    kind, *parts = text.split() or [""]
    if kind not in LIGHTS:
        way = [_number(part) for part in text.split(",")]
        if len(way) != 3 or not all(isinstance(part, float) for part in way):
            raise Error(f"light {text!r:.60} is of no kind; allowed: X,Y,Z, the way it travels, or sun, point or spot "
                        "and fields, as sun direction=1,-1,-0.6 size=0.5")
        return Light(**{**(fields or {}), "direction": way})
    said = {}
    for part in parts:
        field, _, value = part.partition("=")
        if field not in LIGHTS[kind]:
            raise Error(f"light {kind} has no {field!r:.40}; allowed: {', '.join(LIGHTS[kind])}")
        if field in said:
            raise Error(f"light {kind} has {field} twice; allowed: each field once")
        said[field] = _light_value(kind, field, value)
    if kind != "sun" and "position" not in said:
        raise Error(f"light {kind} has no position; allowed: position=X,Y,Z")
    given = {**(fields or {}), **({"angle": 360.0} if kind == "point" else {}), **said}
    if kind == "spot" and middle is not None and "direction" not in said:
        given["direction"] = np.subtract(middle, said["position"])
        if not given["direction"].any():
            raise Error("light spot stands in the mesh's middle, which it would look at; allowed: direction=X,Y,Z")
    return Light(**given)


def _light_value(kind, field, value):
    """What a light's field is, of its text."""
    if field == "shadows" and value in ("on", "off"):
        return value == "on"
    if field in ("direction", "position", "color") and value.startswith("#") <= (field == "color"):
        try:
            return from_hex(value) if value.startswith("#") else _three(value)
        except ValueError:
            pass
    elif field != "shadows" and isinstance(number := _number(value), float):
        return number
    allowed = {"shadows": "on or off", "color": "R,G,B, linear, or #rrggbb", "direction": "X,Y,Z", "position": "X,Y,Z"}
    raise Error(f"light {kind}: {field} is {value!r:.40}; allowed: {allowed.get(field, 'a number')}")


def _three(text):
    """Three numbers with commas between them; raises ValueError."""
    x, y, z = (float(part) for part in text.split(","))
    return x, y, z


def look_of(text):
    """The look of a text: its class in small letters, and behind a colon its fields with commas between them, each
    NAME=NUMBER, a word, or three numbers with / between them. Raises `clfur.Error` for any other."""
    classes = {"kajiya": Kajiya, "chiang": Chiang}
    name, _, rest = text.partition(":")
    if name not in classes:
        raise Error(f"look {text!r:.60} is of no kind; allowed: kajiya or chiang, or with fields, as chiang:tilt=3")
    known, fields = [field.name for field in attrs.fields(classes[name]) if field.init], {}
    for part in filter(None, rest.split(",")):
        field, _, value = (each.strip() for each in part.partition("="))
        if field not in known:
            raise Error(f"look {name} has no {field!r:.40}; allowed: {', '.join(known)}")
        if field in fields:
            raise Error(f"look {name} has {field} twice; allowed: each field once")
        fields[field] = [_number(each) for each in value.split("/")] if "/" in value else _number(value)
    return classes[name](**fields)


def tufts_of(given):
    """The `Tufts` of a number, of a text as `TuftsText` has it, or of an object of JSON. Raises `clfur.Error` for any
    other."""
    if isinstance(given, str):
        count, _, rest = given.partition(":")
        pairs = [[each.strip() for each in part.partition("=")[::2]] for part in filter(None, rest.split(","))]
        if twice := next((name for name, _ in pairs if [each for each, _ in pairs].count(name) > 1), None):
            raise Error(f"tufts have {twice} twice; allowed: each field once")
        given = {"count": _whole(count), **{name: _whole(value) for name, value in pairs}}
    if not isinstance(given, dict):
        return Tufts(given)
    known = [field.name for field in attrs.fields(Tufts)]
    if unknown := next((name for name in given if name not in known), None):
        raise Error(f"tufts have no {unknown!r:.40}; allowed: {', '.join(known)}")
    within = given.get("within")
    return Tufts(**{**given, "within": within if within is None else tufts_of(within)})


def _whole(text):
    """A whole number, a number, or the text where it is none."""
    number = _number(text)
    return int(number) if isinstance(number, float) and number.is_integer() else number


def _is_number(text):
    return isinstance(_number(text), float)


def _number(text):
    """A number, or the text where it is none."""
    try:
        return float(text)
    except ValueError:
        return text


def from_hex(text):
    """Linear colour of sRGB "#rrggbb"; raises ValueError."""
    digits = text[1:]
    if len(text) != 7 or text[0] != "#" or not all(d in "0123456789abcdefABCDEF" for d in digits):
        raise ValueError(f"{text!r} is not a colour such as #ccaa88")
    return tuple(float(c) for c in srgb_to_linear([int(digits[i:i + 2], 16) / 255 for i in (0, 2, 4)]))


def once(context, option, values):
    """What an option that may be given once was given, or None: for click, whose last one of several counts."""
    if len(values) > 1:
        raise click.UsageError(f"{option.opts[0]} is given {len(values)} times; allowed: once")
    return values[0] if values else None
