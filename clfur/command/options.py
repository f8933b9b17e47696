"""What the commands that draw have in common: their options, and which of them go together."""

import functools
import re
import shlex

import click
from click.core import ParameterSource

from .. import PRESETS, Chiang, Error
from ..settings import RASTERS, SCATTERING, SHADOWS
from .described import HAIRS, MOST, ROOTS, TUFTS
from .types import (
    MAPS,
    AnyReal,
    AnyWhole,
    Color,
    Height,
    LightText,
    Look,
    MapText,
    Numbers,
    Real,
    Roots,
    Size,
    Sky,
    TuftsText,
    View,
    Way,
    Whole,
    once,
)

_FUR = [
    click.option("--fur", type=click.Choice(["strands", "shells", "both"]), default="strands",
                 help="Strands, shells (a pattern in layers above the body), or an undercoat of shells under strands."),
    click.option("--length", type=Real(0), metavar="L",
                 help="Length of the hair in the mesh's units; shells under strands have half of it.  [default: 0.08 "
                      "of half the mesh's diagonal, or 0.12 for shells alone]"),
    click.option("--color", type=Color(), default="0.45,0.2,0.07", metavar="COLOR",
                 help="R,G,B of 0 to 1 each (linear), or '#rrggbb' (sRGB)."),
    click.option("--alpha", type=Real(0, 1), default=0.5, metavar="0..1",
                 help="How much light one hair lets through."),
    click.option("--variation", type=Real(0, 1), default=0.3, metavar="0..1",
                 help="How much strands differ in length, direction and colour, and shells' hairs in length."),
    click.option("--segments", type=Whole(0, 255), metavar="N",
                 help="Segments a strand, by which it is drawn as smooth; 0 is bald.  [default: 8, or as many as "
                      "--guides have, 64 at most]"),
    click.option("--force", type=Numbers(3), default="0,-1,0", metavar="X,Y,Z", help="What pulls the hair."),
    click.option("--stiffness", type=Real(1e-6), metavar="S",
                 help="How many of its lengths a hair takes to turn by a radian under a force of 1 across it; a hair "
                      "of shells bends as much as half of one.  [default: 0.625]"),
    click.option("--force-weight", type=AnyReal(), metavar="W",
                 help="Instead of --stiffness, the report's rule: how much each segment gives way to the force."),
    click.option("--wind", type=Numbers(3), default="0,0,0", metavar="X,Y,Z",
                 help="Wind that bends hair as it grows; it gusts."),
    click.option("--time", type=AnyReal(), metavar="SECONDS",
                 help="The moment of the wind, which gusts, and of a scene file that moves; or a USD file's time code. "
                      " [default: 0, or its first]"),
    click.option("--seed", type=AnyWhole(), default=0, metavar="N", help="Of all that is random."),
    click.option("--hair", metavar="FILE", multiple=True, callback=once,
                 help="Strands of a file in place of grown ones, placed as the mesh is: .hair, .tfx, .data, .ply, "
                      ".npz, .npy or USD.  --width, --color and --alpha count where it says none."),
    click.option("--guides", metavar="FILE",
                 help="Strands of a file, as --hair takes, that stand on the mesh: between them those of --roots have "
                      "their shapes, so that no length, force or lean counts; --variation and maps cut them."),
    click.option("--parting", type=Real(0, 180), default=60.0, metavar="DEG",
                 help="Guides that point apart by more than this are not blended; 180: all are."),
    click.option("--reach", type=Real(0, 1e6), default=1.0, metavar="TIMES",
                 help="How far from the nearest of --guides hair stands, in distances of that guide from the seventh "
                      "around it; 0: everywhere."),
    click.option("--up", type=click.Choice(["y", "z"]), default="y",
                 help="Which axis is up in MESH and in files of strands but USD's, which tell; what has Z there is "
                      "turned so that it is Y, the up of all other options."),
    click.option("--rest", metavar="MESH",
                 help="The mesh in rest, of the same faces: lengths go by it, and N roots and the cells of shells stay "
                      "where they are on it in every pose."),
]
_CAMERA = [
    click.option("--eye", type=Numbers(3), metavar="X,Y,Z",
                 help="The camera's place.  [default: where it sees the whole mesh, and its shadow on a --ground]"),
    click.option("--target", type=Numbers(3), metavar="X,Y,Z",
                 help="What it looks at.  [default: the mesh's centre]"),
    click.option("--view", type=View(), metavar="VIEW",
                 help="From where the camera sees all of the mesh: front (from +Z), back, left (from -X), right, top, "
                      "34 (between front and right), or AZIMUTH,ELEVATION in degrees.  [default: near 34]"),
    click.option("--zoom", type=Real(0.01, 100), default=1.0, metavar="TIMES",
                 help="How many times larger the middle of the picture is."),
    click.option("--fov", type=Real(1e-3, 179.99), default=45.0, metavar="DEG",
                 help="Vertical field of view."),
    click.option("--camera", metavar="NAME", help="Which camera of a USD scene.  [default: its first]"),
]
_LIGHT = [
    click.option("--light", "lights", type=LightText(), multiple=True, metavar="LIGHT",
                 help="The way that distant light travels, X,Y,Z; or sun, point or spot and its fields, as 'sun "
                      "direction=1,-1,-0.6 size=0.5' (degrees across) or 'spot position=2,3,1 direction=-2,-3,-1 "
                      "angle=40 color=#ffe0c0 intensity=2 size=0.2 shadows=off' (size: a disc's radius; a spot without "
                      "a direction looks at the mesh's middle).  Again for each further light.  "
                      "[default: as the camera sees it, warm from the upper left and, but under a --sky, weaker "
                      "and bluish from behind]"),
    click.option("--sky", type=Sky(), metavar="SKY",
                 help="Light from all around, hidden by hair and body, instead of the flat ambient: a colour, R,G,B of "
                      "0 or more each (linear) or '#rrggbb'; ZENITH:HORIZON:GROUND, three of these; or an "
                      "equirectangular picture, .hdr, .exr, .png.  Lights shine too: --light 'sun intensity=0' leaves "
                      "the sky alone.  [default: none]"),
]
_BODY = [
    click.option("--body-color", type=Color(), metavar="COLOR",
                 help="Base colour of the body.  [default: a glTF file's own, else 0.6 of the hair's light]"),
    click.option("--body-texture", metavar="PICTURE",
                 help="Picture that is laid on the body by uv; --body-color, if given, multiplies it."),
    click.option("--body", type=click.Choice(["drawn", "holdout"]), default="drawn",
                 help="A holdout hides and shades hair, but is not seen itself."),
    click.option("--ground", type=Height(), metavar="lowest|Y",
                 help="A level ground at the mesh's lowest point or at a height, of which the shadow alone is drawn."),
]
_STRANDS = [
    click.option("--inner", type=Whole(1, 64), metavar="N",
                 help="Tessellation level within a face; 5 and 5 give 37 strands a face.  [default: 5, or less where "
                      f"that makes more than {MOST:,} triangles]"),
    click.option("--outer", type=Whole(1, 64), metavar="N",
                 help="Tessellation level of the edges.  [default: as --inner]"),
    click.option("--roots", type=Roots(), metavar="faces|N",
                 help="One strand on each tessellated triangle, or N strands spread evenly by area.  [default: "
                      f"{ROOTS}, or faces with --inner or --outer]"),
    click.option("--surface", type=click.Choice(["pn", "flat"]), default="pn", help="Curved or flat faces."),
    click.option("--width", type=Real(0), metavar="W",
                 help="Diameter of a strand in the mesh's units.  [default: 0.0012 of half the mesh's diagonal, but at "
                      "most a tenth of the length]"),
    click.option("--tip-width", type=Real(0, 16), default=0.2, metavar="SHARE",
                 help="Of its width, what a strand has at its tip."),
    click.option("--root-color", type=Color(), metavar="COLOR",
                 help="Of a strand at its root.  [default: half of --color's light; with --look chiang as --color]"),
    click.option("--tip-color", type=Color(), metavar="COLOR", help="Of a strand at its tip.  [default: --color]"),
    click.option("--look", type=Look(), metavar="LOOK",
                 help="How strands scatter light: kajiya or chiang (real hair), and its fields, as "
                      "chiang:azimuthal_roughness=0.4,eumelanin=1.3 or chiang:absorption=0.1/0.3/0.9.  "
                      "[default: kajiya]"),
]
_GROOM = [
    click.option("--collision", type=click.Choice(["auto", "on", "off"]), default="auto",
                 help="Whether hair that would grow into the mesh slides along it; auto: where some is longer than a "
                      "fifth of the mesh's radius."),
    click.option("--type-map", metavar="PICTURE", help="Picture whose colours choose the hair type by uv."),
    click.option("--types", metavar="FILE",
                 help="JSON list of hair types, each with its key colour in the type map; what a type leaves "
                      "out is taken from the options.  Or an object with types, type_map, maps, comb and on."),
    click.option("--map", "maps", type=MapText(), multiple=True, metavar="NAME=FILE",
                 help="What the skin says of " + ", ".join(MAPS[:-1]) + f" or {MAPS[-1]}: a grey picture by uv, which "
                      "multiplies what the options say, 0 to 1 without a curve; UDIM tiles, as skin.<UDIM>.png; or a "
                      ".npy file of numbers by vertex or by face.  Again for each further map."),
    click.option("--on", multiple=True, metavar="NAME",
                 help="Hair grows there alone: a group, object or material of the mesh's file, or a vertex colour, "
                      "red, green, blue or alpha.  Again for each further place."),
    click.option("--comb", type=Way(), metavar="X,Y,Z|FILE",
                 help="Which way hair lies on the skin: a vector, a picture by uv (red: along u, green: along v, 128: "
                      "none), or a .npy file of vectors by vertex."),
    click.option("--comb-weight", type=Real(0, 1), metavar="0..1",
                 help="How flat it lies there.  [default: 0.7]"),
    click.option("--curl", type=Numbers(2), default="0,0", metavar="RADIUS,TURNS", help="Curl of the strands."),
    click.option("--wave", type=Numbers(2), default="0,0", metavar="AMPLITUDE,PERIODS",
                 help="Wave of the strands."),
    click.option("--tufts", type=TuftsText(), metavar="N",
                 help="Gather strands in N tufts on the whole mesh, which curl and wave as one; and their fields, as "
                      "2000:strength=0.9,profile=0.3,size_variation=0.5,within=200 (in so many larger ones); or off.  "
                      f"[default: {TUFTS}, or off with --guides]"),
    click.option("--frizz", type=Numbers(2), default="0,0", metavar="AMPLITUDE,WAVES",
                 help="How far strands stray at random, and in how many waves."),
]
_SHELLS = [
    click.option("--layers", type=Whole(1, 1000), default=30, metavar="N",
                 help="Layers of shells, from the body to the tips."),
    click.option("--pattern", type=click.Choice(["cells", "sine"]), default="cells",
                 help="Of shells: a hair in each cell of the faces, or the report's sines, which need uv."),
    click.option("--hairs", type=Whole(1, 10**9), metavar="N",
                 help=f"Hairs of shells on the whole mesh.  [default: {HAIRS:,}]"),
    click.option("--frequency", type=Real(0, min_open=True), metavar="F",
                 help="In place of --hairs, those along a unit of length; of sines the report's f.  [default: 40 for "
                      "sines]"),
    click.option("--density", type=Real(0, 1, min_open=True), default=1.0, metavar="0..1",
                 help="How much of its cell a hair of shells fills."),
    click.option("--noise", type=Numbers(2), default="0.5,8", metavar="A,S",
                 help="How far hairs of shells are displaced and the size of the waves, both in hairs."),
    click.option("--shading", type=click.Choice(["kajiya-kay", "turned"]), default="kajiya-kay",
                 help="Light on shells: by the hair's direction, or by the report's turned normals."),
]
_SETTINGS = [
    click.option("--preset", type=click.Choice(list(PRESETS)),
                 help="Settings that were measured to be worth their time, from draft, the fastest, to reference, the "
                      "nearest to the truth (masks and deep shadows); options beside it count more."),
    click.option("--raster", type=click.Choice(RASTERS), default="coverage",
                 help="Strands transparent by the area that they cover, or opaque in each sample."),
    click.option("--shadows", type=click.Choice(SHADOWS), default="length",
                 help="How hair shades: by what rays cross (length), by the report's voxels, not at all, or by the "
                      "single hairs before each light (deep)."),
    click.option("--masks", type=Whole(0, 4), default=0, metavar="0|4",
                 help="4: strands hide each other in 4x4 parts of a pixel, not as if at random in it."),
    click.option("--scattering", type=click.Choice(SCATTERING), default="off",
                 help="Follow light from hair to hair: grid, for --look chiang alone and --raster coverage.  Lights "
                      "then leave out their default ambient."),
    click.option("--grid", type=Whole(16, 1024), default=96, metavar="N",
                 help="Cells a side of the grid for shadows; a multiple of 16."),
    click.option("--shadow-map", type=Whole(0, 8192), default=512, metavar="N",
                 help="Texels a side of the body's shadow map; 0: none."),
    click.option("--pcf", type=Whole(0, 16), default=1, metavar="N",
                 help="Radius in texels over which it is averaged."),
    click.option("--samples", type=click.Choice(["1", "4", "16"]), default="4", help="Samples a pixel."),
    click.option("--lod", type=Real(0, 4), default=0.0, metavar="PIXELS",
                 help="Draw strands thinner than this as fewer, wider ones of fewer segments; 0: all as they are."),
    click.option("--specular", type=click.Choice(["kajiya-kay", "half-vector"]), default="kajiya-kay",
                 help="Form of the highlight."),
    click.option("--blur", type=click.Choice(["off", "all", "edges"]), default="off",
                 help="Blur the picture: all of it, or the edges of the fur alone."),
    click.option("--blur-sigma", type=Real(0, 16, min_open=True), default=1.0, metavar="PIXELS",
                 help="How wide the blur is."),
]
# Names of the options that only one kind of fur has.
_ONLY = {"strands": ("inner", "outer", "roots", "surface", "width", "tip_width", "root_color", "tip_color", "look",
                     "type_map", "types", "curl", "wave", "tufts", "frizz", "raster", "masks", "scattering", "lod",
                     "hair", "guides", "parting", "reach", "maps", "on", "comb", "comb_weight", "collision"),
         "shells": ("layers", "pattern", "hairs", "frequency", "density", "noise", "shading")}
# Of hair that grows; strands of a file have no use for them, nor for the second where there are no shells.
_GROWN = ("tip_width", "root_color", "tip_color", "segments", "force", "stiffness", "force_weight", "roots", "type_map",
          "types", "curl", "wave", "tufts", "frizz", "rest", "maps", "on", "comb", "comb_weight", "collision")
_GROWN_OR_SHELLS = "length", "variation", "wind"
_UNGUIDED = "stiffness", "force_weight", "force", "length", "wind"   # what the shapes of guides leave nothing to say


def _names(options):
    """What a command that has these options calls them."""
    command = click.Command(None)
    for option in options:
        option(command)
    return {option.name for option in command.params}


def _sections(size="640x480"):
    """{title: options} of the help, in its order; the size of a picture is this by default."""
    sized = click.option("--size", type=Size(), default=size, metavar="WxH", help="Size of the picture in pixels.")
    return {"Fur": _FUR, "Strands": _STRANDS, "Grooming of strands": _GROOM, "Shells": _SHELLS,
            "Body and ground": _BODY, "Light": _LIGHT, "Camera": [sized, *_CAMERA], _QUALITY: _SETTINGS}


_QUALITY = "Quality and speed"   # fields of `Settings`
_NAMES_IN = {title: _names(options) for title, options in _sections().items()}
_NAMES_IN[_QUALITY] |= {"max_error", "seconds"}   # those of `clfur render`
_NAMES_IN["Camera"] |= {"region", "turntable"}
_NAMES_IN["Time"] = {"frames", "fps", "shutter", "subframes", "pictures"}   # those of `clfur film`
_NAMES_IN["Motion"] = {"blown", "gust", "bend_length", "units_per_metre"}


def of_sections(*titles):
    """Names of the options that stand under these titles of the help."""
    return set().union(*(_NAMES_IN[title] for title in titles))


class Sectioned(click.Command):
    """A command whose help lists its options by section, its own ones in the end."""

    def format_options(self, ctx, formatter):
        shown = [(option.name, record) for option in self.get_params(ctx)
                 if isinstance(option, click.Option) and (record := option.get_help_record(ctx))]
        others = {name for name, _ in shown}.difference(*_NAMES_IN.values())
        for title, names in {**_NAMES_IN, "Output and device": others}.items():
            records = [record for name, record in shown if name in names]
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


def scene_options(command, size="640x480", settings=True):
    """Give a command the options that `load_scene` reads: a size like this, and those of `Settings` or none."""
    command = _naming_options(command)
    for title, options in reversed(_sections(size).items()):
        for option in reversed(options if settings or title != _QUALITY else ()):
            command = option(command)
    return command


# Fields that have another name than the option which sets them; all of a Light are of --light.
_NAMES = {"key": "types", "segment_length": "length", "height": "ground", "environment": "sky",
          **dict.fromkeys(("length_variation", "direction_variation", "color_variation"), "variation")}


def _naming_options(command):
    """A command whose errors of a field begin with the option that has set it, where one was given."""

    @functools.wraps(command)
    def naming(*arguments, **options):
        try:
            return command(*arguments, **options)
        except Error as error:
            if flag := _flag_of(str(error), given_flags(options)):
                raise type(error)(f"{flag}: {error}") from error
            raise
    return naming


def _flag_of(message, flags):
    """The one of the options given, {name: flag}, that has set the field with which a message begins, or None."""
    if message.startswith(("region ", "there is no output")):
        return flags.get("region" if message.startswith("region") else "outputs")
    if not (found := re.match(r"([A-Z]\w*\.|frame )(\w+)", message)):
        return None
    kind, field = found.groups()
    if kind == "Light.":
        return flags.get("lights")
    if kind == "Tufts.":
        return flags.get("tufts")
    if kind in ("Maps.", "Comb."):
        return flags.get("on" if field == "on" else "maps" if kind == "Maps." else "comb")
    if field == "body_color":
        return flags.get("body_texture", flags.get("body_color"))
    return flags.get(_NAMES.get(field, field))


def given_flags(options):
    """{name: flag} of the options that were given, not left to their defaults."""
    context = click.get_current_context()
    return {option.name: option.opts[0] for option in context.command.params if option.name in options
            and context.get_parameter_source(option.name) is ParameterSource.COMMANDLINE}


def check_fur(flags, options):
    """Raise click.UsageError for one of the options given, {name: flag}, that the fur which is drawn has no use for."""
    for fur, names in _ONLY.items():
        for name in names if options["fur"] not in (fur, "both") else ():
            if name in flags:
                raise click.UsageError(f"{flags[name]} is for {fur}, but --fur is {options['fur']}; "
                                       f"allowed: with --fur {fur} or --fur both")
    for name in ("maps", "on") if options["fur"] == "both" else ():
        if name in flags:
            raise click.UsageError(f"{flags[name]} is for strands alone, shells do not follow maps; allowed: with "
                                   "--fur strands")
    for name in ("parting", "reach"):
        if options["guides"] is None and name in flags:
            raise click.UsageError(f"{flags[name]} is for strands between --guides; allowed: with them")
    if options["guides"] is not None:
        for name in ("hair", *(_UNGUIDED if options["fur"] == "strands" else ())):
            if name in flags:
                raise click.UsageError(f"{flags[name]} has no say where --guides give strands their shapes; allowed: "
                                       "one of them")
    if options["hair"] is not None:
        check_grown(flags, options, "--hair")
    if "hairs" in flags and ("frequency" in flags or options["pattern"] == "sine"):
        raise click.UsageError("--hairs is for --pattern cells without --frequency; allowed: one of them")
    if "time" in flags and not any(options["wind"]):
        raise click.UsageError("--time is the moment of the wind, but there is none; allowed: with --wind")
    if "specular" in flags and options["fur"] == "strands" and isinstance(options["look"], Chiang):
        raise click.UsageError("--specular is for --look kajiya, but --look is chiang; allowed: one of them")
    if "variation" in flags and (options["fur"], options["pattern"]) == ("shells", "sine"):
        raise click.UsageError("--variation is for --pattern cells, but --pattern is sine; "
                               "allowed: with --pattern cells or --fur both")


_FOLDERS = re.compile(r"^(--?\w[\w-]*=|-\w)?(\w+=)?.*[\\/](?=.)", re.S)   # of a word: --map NAME=FILE, -oFILE


def command_line():
    """The line of the shell that runs now, its paths cut to their last names: pages with it go to others, and folders
    tell who works there."""
    return shlex.join(["clfur", *(_FOLDERS.sub(r"\1\2", word) for word in click.get_current_context().obj or ())])


def check_grown(flags, options, has):
    """Raise click.UsageError for one of the options given, {name: flag}, of hair that grows, as something has its
    own."""
    for name in _GROWN + (_GROWN_OR_SHELLS if options["fur"] == "strands" else ()):
        if name in flags:
            raise click.UsageError(f"{flags[name]} is for hair that grows, but {has} has its own; allowed: one of them")


# Of fields of `Settings`: which have no use where another one has this value, and what of it is allowed.
_IDLE = [("blur_sigma", "blur", "off", "all or edges"), ("pcf", "shadow_map", 0, "a number of texels"),
         *((name, "shadows", "off", "any other") for name in ("grid", "shadow_map", "pcf"))]


def check_settings(flags, settings):
    """Raise click.UsageError for one of the options given, {name: flag}, that other settings leave no use for."""
    for name, other, value, allowed in _IDLE:
        if name in flags and getattr(settings, other) == value:
            flag = f"--{other.replace('_', '-')}"
            raise click.UsageError(f"{flags[name]} has no use where {flag} is {value}; allowed: with {flag} {allowed}")
