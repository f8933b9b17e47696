"""The `clfur` command."""

import json
import math
import sys
from pathlib import Path

import attrs
import click

from . import Camera, Error, HairType, Light, Scene, Settings, Strands, draw, load_mesh, save
from .cli_devices import devices
from .image import check_writable, load_picture, srgb_to_linear
from .scene import frame
from .settings import SHADOWS


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


class Color(Numbers):
    """Linear R,G,B or sRGB #rrggbb."""

    def __init__(self):
        super().__init__(3)

    def convert(self, value, param, ctx):
        if isinstance(value, str) and value.startswith("#"):
            try:
                return _from_hex(value)
            except ValueError:
                self.fail(f"{value!r} is neither R,G,B (linear) nor #rrggbb (sRGB)", param, ctx)
        return super().convert(value, param, ctx)


class Roots(click.ParamType):
    """The word faces, or a number of strands."""

    name = "roots"

    def convert(self, value, param, ctx):
        if value == "faces" or isinstance(value, int):
            return value
        if not value.isdecimal() or len(value) > 10:
            self.fail(f"{value!r} is neither 'faces' nor a number of strands", param, ctx)
        return int(value)


class Names(click.ParamType):
    """Names with commas between them."""

    name = "names"

    def convert(self, value, param, ctx):
        return value if isinstance(value, tuple) else tuple(part.strip() for part in value.split(","))


@click.group(invoke_without_command=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="clfur")
@click.pass_context
def clfur(context):
    """Fur and hair on meshes, rendered with OpenCL."""
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


@clfur.command(context_settings={"show_default": True})
@click.argument("mesh")
@click.option("-o", "--output", metavar="FILE",
              help="PNG (sRGB), EXR (linear) or NPZ (arrays).  [default: the mesh's name, .png]")
@click.option("--size", type=Size(), default="640x480", metavar="WxH", help="Size of the picture in pixels.")
@click.option("--inner", type=click.IntRange(1, 64), default=5, metavar="N",
              help="Tessellation level within a face; 5 and 5 give 37 strands a face.")
@click.option("--outer", type=click.IntRange(1, 64), default=5, metavar="N",
              help="Tessellation level of the edges.")
@click.option("--roots", type=Roots(), default="faces", metavar="faces|N",
              help="One strand on each tessellated triangle, or N strands spread evenly.")
@click.option("--surface", type=click.Choice(["pn", "flat"]), default="pn", help="Curved or flat faces.")
@click.option("--segments", type=click.IntRange(0, 255), default=8, metavar="N",
              help="Segments a strand; 0 is bald.")
@click.option("--length", type=click.FloatRange(0), metavar="L",
              help="Length of a strand in the mesh's units.  [default: 0.08 of the mesh's radius]")
@click.option("--width", type=click.FloatRange(0), metavar="W",
              help="Diameter of a strand in the mesh's units.  [default: 0.0012 of the mesh's radius]")
@click.option("--color", type=Color(), default="0.5,0.28,0.12", metavar="COLOR",
              help="R,G,B (linear) or '#rrggbb' (sRGB).")
@click.option("--type-map", metavar="PICTURE", help="Picture whose colours choose the hair type by uv.")
@click.option("--types", metavar="FILE",
              help="JSON list of hair types, each with its key colour in the type map; what a type leaves "
                   "out is taken from the options.")
@click.option("--force", type=Numbers(3), default="0,-1,0", metavar="X,Y,Z", help="What pulls the strands.")
@click.option("--force-weight", type=float, default=0.2, metavar="W",
              help="How much the strands give way to it.")
@click.option("--curl", type=Numbers(2), default="0,0", metavar="RADIUS,TURNS", help="Curl of the strands.")
@click.option("--wave", type=Numbers(2), default="0,0", metavar="AMPLITUDE,PERIODS",
              help="Wave of the strands.")
@click.option("--variation", type=click.FloatRange(0, 1), default=0.3, metavar="0..1",
              help="How much strands differ in length, direction and colour.")
@click.option("--seed", type=int, default=0, metavar="N", help="Of all that is random.")
@click.option("--eye", type=Numbers(3), metavar="X,Y,Z",
              help="The camera's place.  [default: where it sees the whole mesh]")
@click.option("--target", type=Numbers(3), metavar="X,Y,Z",
              help="What it looks at.  [default: the mesh's centre]")
@click.option("--fov", type=click.FloatRange(0, 180, min_open=True, max_open=True), default=45.0, metavar="DEG",
              help="Vertical field of view.")
@click.option("--light", type=Numbers(3), default="1,-1,-0.6", metavar="X,Y,Z",
              help="The way the light travels.")
@click.option("--alpha", type=click.FloatRange(0, 1), default=0.5, metavar="0..1",
              help="How much light one hair lets through.")
@click.option("--shadows", type=click.Choice(SHADOWS), default="length",
              help="How hair shades: by what rays cross, by the report's voxels, or not at all.")
@click.option("--grid", type=int, default=48, metavar="N",
              help="Cells a side of the grid for shadows; a multiple of 16.")
@click.option("--samples", type=click.Choice(["1", "4", "16"]), default="4", help="Samples a pixel.")
@click.option("--specular", type=click.Choice(["kajiya-kay", "half-vector"]), default="kajiya-kay",
              help="Form of the highlight.")
@click.option("--outputs", type=Names(), default="color", metavar="NAMES",
              help="What to save: color, depth, id, tangent, normal, uv, coverage; PNG holds color alone.")
@click.option("--device", metavar="DEVICE",
              help="cpu, gpu, gpu:1, part of a name such as pocl, or 1:0.  "
                   "[default: CLFUR_DEVICE, PYOPENCL_CTX or the best there is]")
@click.option("--json", "as_json", is_flag=True, help="Print what was drawn as JSON.")
def render(mesh, output, as_json, **options):
    """Draw MESH with fur and save the picture.

    MESH is an OBJ, PLY, STL, OFF, GLB or glTF file, or one of the built-in shapes: sphere, teapot.
    """
    options["samples"] = int(options["samples"])
    output = Path(mesh).stem + ".png" if output is None else output
    check_writable(output)
    output = Path(output)
    if output.suffix.lower() == ".png" and set(options["outputs"]) != {"color"}:
        raise click.UsageError(f"{output} can hold the output color alone; .exr and .npz hold others")
    for given in (mesh, options["type_map"], options["types"]):
        if given and output.exists() and Path(given).exists() and output.samefile(given):
            raise click.UsageError(f"{output} is read by this command and would be overwritten: name another with -o")
    mesh = load_mesh(mesh)
    scene = _scene(mesh, options)
    drawn = draw(scene, device=options["device"], outputs=options["outputs"],
                 settings=Settings(samples=options["samples"], specular=options["specular"],
                                   shadows=options["shadows"], grid=options["grid"]))
    save(output, drawn.images)

    skipped = {"degenerate": mesh.degenerate_faces, "zero_normal": mesh.zero_normal_faces}
    if as_json:
        print(json.dumps({
            "file": str(output), "size": options["size"], "device": drawn.device,
            "triangles": drawn.triangles, "strands": drawn.strands, "segments": drawn.segments,
            "seconds": drawn.seconds, "stages": drawn.stages, "skipped": skipped,
            "camera": {name: list(getattr(scene.camera, name)) for name in ("eye", "target")},
            "options": {name: options[name]
                        for name in ("fov", "light", "samples", "alpha", "shadows", "grid", "seed")}}))
        return
    stages = ", ".join(f"{name} {seconds:.3f}" for name, seconds in drawn.stages.items())
    left_out = [f"{count:,} {what.replace('_', ' ')}" for what, count in skipped.items() if count]
    print(f"{output}: {drawn.triangles:,} triangles, {drawn.strands:,} strands, {drawn.segments:,} segments "
          f"in {drawn.seconds:.2f} s on {drawn.device} ({stages})"
          + (f"; skipped faces: {', '.join(left_out)}" if left_out else ""))


clfur.add_command(devices)


def _scene(mesh, options):
    """The scene that the options of `clfur render` describe."""
    _, radius = mesh.bounds
    length = 0.08 * radius if options["length"] is None else options["length"]
    hair = {
        "color": options["color"],
        "segments": options["segments"],
        "segment_length": length / max(options["segments"], 1),
        "width": 0.0012 * radius if options["width"] is None else options["width"],
        "force_weight": options["force_weight"],
        "curl": options["curl"],
        "wave": options["wave"],
        "alpha": options["alpha"],
        **dict.fromkeys(("length_variation", "direction_variation", "color_variation"), options["variation"]),
    }
    if options["type_map"] is not None and options["types"] is None:
        raise click.UsageError("--type-map needs --types, the hair types that its colours mean")
    fur = Strands(
        types=[HairType(**hair)] if options["types"] is None else _hair_types(options["types"], hair),
        type_map=None if options["type_map"] is None else load_picture(options["type_map"]),
        **{name: options[name] for name in ("inner", "outer", "roots", "surface", "force", "seed")})

    camera = frame(mesh, fur, options["size"], options["fov"])
    if options["eye"] or options["target"]:
        target = options["target"] or tuple(camera.target)
        eye = options["eye"] or tuple(camera.eye + target - camera.target)
        aside, up = math.hypot(eye[0] - target[0], eye[2] - target[2]), abs(eye[1] - target[1])
        upright = aside > 1e-3 * up
        camera = Camera(eye=eye, target=target, up=(0, 1, 0) if upright else (0, 0, -1),
                        fov=options["fov"], size=options["size"])
    return Scene(mesh=mesh, fur=fur, camera=camera, light=Light(direction=options["light"]))


def _hair_types(path, defaults):
    """The hair types of a JSON file; raises `clfur.Error` naming the file, the type and the field."""
    try:
        listed = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise Error(f"{path}: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise Error(f"{path} is not JSON: {error}") from None
    if not isinstance(listed, list) or not all(isinstance(fields, dict) for fields in listed):
        raise Error(f'{path} must hold a list of objects, such as [{{"key": [255, 0, 0], "segments": 10}}]')
    allowed = [field.name for field in attrs.fields(HairType) if field.init]
    types = []
    for number, fields in enumerate(listed):
        where = f"{path}, type {number}"
        if unknown := [name for name in fields if name not in allowed]:
            raise Error(f"{where}: unknown field {unknown[0]!r}; allowed: {', '.join(allowed)}")
        try:
            if isinstance(texture := fields.get("color_texture"), str):
                fields["color_texture"] = load_picture(Path(path).parent / texture)
            if isinstance(color := fields.get("color"), str):
                fields["color"] = _from_hex(color)
            types.append(HairType(**{**defaults, **fields}))
        except ValueError as error:   # clfur.Error is one
            raise Error(f"{where}: {error}") from None
    return types


def _from_hex(text):
    """Linear colour of sRGB "#rrggbb"; raises ValueError."""
    digits = text[1:]
    if len(text) != 7 or text[0] != "#" or not all(d in "0123456789abcdefABCDEF" for d in digits):
        raise ValueError(f"{text!r} is not a colour such as #ccaa88")
    return tuple(float(c) for c in srgb_to_linear([int(digits[i:i + 2], 16) / 255 for i in (0, 2, 4)]))


def main(arguments=None):
    """Run the command and exit; what the user got wrong is one line on stderr and exit code 2."""
    for stream in (sys.stdout, sys.stderr):   # a device's name need not be ASCII
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    try:
        code = clfur.main(arguments, prog_name="clfur", standalone_mode=False)
    except (click.Abort, KeyboardInterrupt):
        print("clfur: interrupted", file=sys.stderr)
        code = 130
    except OSError as error:   # of stdout itself: a full disk, a closed pipe
        print(f"clfur: error: {error.strerror}", file=sys.stderr)
        sys.stdout = None
        code = 2
    except MemoryError:
        print("clfur: error: out of memory: ask for a smaller picture, fewer samples or fewer strands", file=sys.stderr)
        code = 2
    except (Error, click.ClickException) as error:
        message = error.format_message() if isinstance(error, click.ClickException) else str(error)
        print("clfur: error:", " ".join(message.split()), file=sys.stderr)
        code = 2
    sys.exit(code or 0)
