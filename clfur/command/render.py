"""`clfur render`: a mesh with fur, or a scene file, to a picture."""

import json
import warnings
from pathlib import Path

import attrs
import click
import numpy as np

import clfur

from .. import Camera, Scheduler, draw, over, save
from ..files.images import check_writable, load_picture
from ..files.usd import is_usd
from ..scene import backdrop, on_host
from ..settings import label
from .described import lowered
from .devices import ask_drivers
from .lines import say
from .options import Sectioned, given_flags, scene_options
from .scenes import is_scene_file, load_moving, moved, scene_at, spare, within
from .skin import taken
from .types import Backdrop, Bytes, Names, Real, Region, Subframes, read_for
from .waiting import waiting

TOLD = 0.05   # seconds of building kernels that a summary tells


@click.command(cls=Sectioned, context_settings={"show_default": True})
@click.argument("given", metavar="MESH")
@click.option("-o", "--output", metavar="FILE",
              help="PNG (sRGB), EXR (linear) or NPZ (arrays).  [default: the mesh's name, .png]")
@scene_options
@click.option("--outputs", type=Names(), default="color", metavar="NAMES",
              help="What to save: color, depth, id, tangent, normal, uv, coverage, position, hair_alpha, body_alpha, "
                   "type, type_alpha, orientation, matte_id and matte_alpha (a Cryptomatte of strands in EXR), "
                   "strand_area (in NPZ), motion_vector (since the frame before, of what moves); PNG holds color "
                   "alone.")
@click.option("--background", type=Backdrop(), metavar="COLOR|PICTURE",
              help="What the picture is laid over, which then has no alpha: R,G,B, '#rrggbb' or a picture of the same "
                   "aspect.")
@click.option("--region", type=Region(), metavar="X,Y,W,H",
              help="Draw only these pixels of the picture, from its top-left corner on: the same ones as of the whole.")
@click.option("--shutter", type=Real(0, 360), default=0, metavar="DEGREES",
              help="Blur what moves in a scene file with def scene(t) or motion: a shutter is open so many of a "
                   "frame's 360 degrees, up to --time.  [default: 0, no blur]", show_default=False)
@click.option("--fps", type=Real(1, 1000), default=24, metavar="N",
              help="Frames a second, of one of which --shutter is a part, and motion_vector.")
@click.option("--subframes", "pictures", type=Subframes(), default="auto", metavar="N|auto",
              help="How many, 1 to 64, a picture with --shutter is the mean of; auto: so many that nothing goes "
                   "further than 1.5 pixels from one to the next.")
@click.option("--max-error", type=Real(0, min_open=True), metavar="E",
              help="Choose the cheapest samples, raster, shadows, grid, masks and lod that err by no more, such as "
                   "0.05: root mean square of sRGB, 0 to 1, against the true picture.")
@click.option("--budget", "seconds", type=Real(0, min_open=True), metavar="SECONDS",
              help="Choose the best whose frame takes no longer, in seconds (0.04: 40 ms) with nothing kept of frames "
                   "before; the frames that this tries are not counted.")
@click.option("--device", metavar="DEVICE",
              help="cpu, gpu, gpu:1, part of a name such as pocl, or 1:0; several with commas share a frame.  "
                   "[default: CLFUR_DEVICE, PYOPENCL_CTX or the best there is]")
@click.option("--memory", type=Bytes(), metavar="SIZE",
              help="What arrays may take on the device, such as 2GiB: what does not fit is drawn part by part.  "
                   "[default: three quarters of the device's, or what this process may still take]")
@click.option("--cluster", metavar="local|ADDRESS",
              help="Draw regions of the picture on several machines or devices: tcp://host:port or tls://host:port of "
                   "a Dask scheduler; local, with a process for each GPU, or local:N, with N of them.")
@click.option("--json", "as_json", is_flag=True, help="Print what was drawn as JSON.")
def render(given, output, outputs, background, region, shutter, fps, pictures, device, memory, cluster, as_json,
           **options):
    """Draw MESH with fur and save the picture.

    MESH is an OBJ, PLY, STL, OFF, GLB or glTF file, or one of the built-in shapes: sphere, teapot.  Or it is a USD
    scene (.usd, .usda, .usdc, .usdz), whose camera, lights and hair count where no option says otherwise.  Or it is a
    Python file (.py) that sets `scene`, a clfur.Scene or a function of seconds that gives one, and maybe `settings`, a
    clfur.Settings, and `motion`, a dict of arguments of clfur.Motion, by which hair moves up to --time.
    """
    output = Path(Path(given).stem + ".png" if output is None else output)
    _check_files(output, outputs, background)
    _check_shutter(shutter, outputs)
    device = _devices(device, cluster, memory)
    with waiting(f"reading {given}") as tell:
        *moving, settings = load_moving(given, options)
        scene = scene_at(moving[0], options["time"])
        behind = None if background is None else _background(background, scene.camera.size)
        spare(output)
        tell("starting OpenCL")
        ask_drivers()
        if memory is not None:
            device = [Scheduler(one, memory) for one in (device if isinstance(device, list) else [device])]
        known = {"device": device, "outputs": outputs, "settings": settings, "region": region}
        drawn, scene, steps = _drawn(tell, given, moving, options["time"], shutter, fps, pictures, known, cluster)
        if "color" in drawn.images and not drawn.images["color"][..., 3].any():
            warnings.warn("nothing of the scene is to be seen in the picture", stacklevel=2)
        tell(f"saving {output}")
        laid = {} if behind is None else {"color": _over(drawn.images["color"], behind, scene.camera.size, region)}
        save(output, drawn.images | laid, _camera_of(scene.camera, region), drawn.settings)

    skipped, wound = _faults(scene.mesh)
    shells, fewer = scene.shells, "" if is_scene_file(given) else lowered(options, scene.strands)
    if as_json:
        of_options = {} if is_scene_file(given) or is_usd(given) else {
            "light": _told(options["lights"], scene.lights),
            **{name: options[name] for name in ("fov", "alpha", "seed")}}
        print(json.dumps({
            "file": str(output), "size": region[2:] if region else scene.camera.size, "device": drawn.device,
            "triangles": drawn.triangles, "strands": drawn.strands, "segments": drawn.segments,
            "shells": shells and {"frequency": shells.frequency_on(scene.mesh), **{
                name: getattr(shells, name) for name in ("layers", "length", "hairs", "pattern")}},
            "fewer": fewer, "inexact": getattr(scene.strands, "inexact", 0), "steps": steps,
            "pictures": drawn.pictures, "seconds": drawn.seconds,
            "building": drawn.building, "stages": drawn.stages, "skipped": skipped, **wound,
            "camera": {"eye": scene.camera.pose[:3, 3].tolist(),
                       "target": None if scene.camera.target is None else scene.camera.target.tolist()},
            "settings": attrs.asdict(drawn.settings), "error": drawn.error, "why": drawn.why,
            "options": of_options | {
                name: getattr(drawn.settings, name) for name in ("samples", "raster", "shadows", "grid", "lod")}}))
        return
    fur = [f"{shells.layers} layers of shells"] if shells else []
    fur += [f"{drawn.strands:,} strand{'s' * (drawn.strands != 1)}"] if scene.strands or not shells else []
    say(f"{output}: {', '.join(fur)} in {drawn.seconds:.2f} s on {drawn.device}", *filter(None, [
        f"of these {drawn.building:.2f} s to build kernels" if drawn.building >= TOLD else "",
        f"the mean of {drawn.pictures} pictures" if drawn.pictures > 1 else "",
        f"moved by {options['time']:g} s in {steps} steps" if steps else "",
        fewer, taken(scene.strands), *_said(skipped, wound),
        f"{label(drawn.settings)}: error about {drawn.error:.3g}, {drawn.why}" if drawn.why else ""]))


def _said(skipped, wound):
    """What `_faults` found, in words."""
    left_out = [f"{count:,} {what.replace('_', ' ')}" for what, count in skipped.items() if count]
    return [f"skipped faces: {', '.join(left_out)}" if left_out else "",
            f"turned {wound['turned']:,} faces that were inside out" if wound["turned"] else "",
            f"{wound['one_sided']:,} faces are of a surface with one side: hair changes over somewhere"
            if wound["one_sided"] else "",
            "the mesh's normals point inwards, and so does its fur" if wound["inward"] else ""]


def _faults(mesh):
    """({kind: faces} left out, {what is wrong with how faces are wound}) of a mesh or None."""
    return ({name: getattr(mesh, f"{name}_faces", 0) for name in ("degenerate", "zero_normal", "doubled")},
            {name: getattr(mesh, f"{name}_faces", 0) for name in ("turned", "one_sided")}
            | {"inward": bool(mesh and mesh.inward)})


def _drawn(tell, given, moving, seconds, degrees, fps, pictures, known, cluster):
    """(Frame, Scene, steps) of what `load_moving` gives, at a time, with a shutter that is open so many degrees."""
    vectors, device = "motion_vector" in known["outputs"], known["device"]
    if vectors and degrees:
        raise click.UsageError("motion_vector is of pictures without --shutter; allowed: one of them")
    if cluster is not None and (vectors or degrees):
        raise click.UsageError("--cluster draws one moment; allowed: without --shutter and motion_vector")
    if moving[1] is not None:
        tell(f"moving the hair of {given}")
    if degrees or vectors:
        at, steps = within(given, *moving, seconds, device, (degrees or 360) / 360 / fps)
        n = 1 if vectors else clfur.subframes(at(0), at(1), device) if pictures == "auto" else pictures
        scenes = [at(1)] if vectors else [at((k + 0.5) / n) for k in range(n)]
        known = known | {"before": at(0) if vectors else None}
    else:
        scene, steps = moved(given, *moving, seconds, device)
        scenes = [scene]
    tell(f"drawing {given}")
    if cluster is not None:
        from ..film.regions import picture  # with all that draws on clusters

        return picture(on_host(scene), cluster, device=device, **{
            name: known[name] for name in ("settings", "outputs", "region")}), scene, steps
    drawn = draw(*scenes, **known) if len(scenes) == 1 else clfur.blurred(scenes, **known)
    return drawn, scenes[len(scenes) // 2], steps


def _told(texts, lights):
    """Lights of the command in JSON: the numbers of one that has no more than a direction, else texts, also of those
    that are there without any."""
    if len(texts) == 1 and texts[0][:1] in "-.0123456789":
        return [float(part) for part in texts[0].split(",")]
    return list(texts) or [f"sun direction={_numbers(light.direction)} color={_numbers(light.strength)}"
                           for light in lights]


def _numbers(vector):
    return ",".join(f"{part:.4g}" for part in vector)


def _background(given, size):
    """What `over` takes, of the option's colour or picture, for a picture of (width, height)."""
    if isinstance(given, str):
        return backdrop(read_for("--background", load_picture, given), size, f"--background: {given}")
    return backdrop(given, size, "--background")


def _camera_of(camera, region):
    """The camera that sees a region of another's picture, its own if None."""
    if region is None:
        return camera
    x, y, width, height = region
    return Camera.calibrated(camera.pose, camera.intrinsics - [[0, 0, x], [0, 0, y], [0, 0, 0]], (width, height))


def _over(image, behind, size, region):
    """An image over what is behind all of the picture, of (width, height), or its region alone."""
    if region is None:
        return over(image, behind)
    x, y, width, height = region
    whole = np.zeros((size[1], size[0], 4), np.float32)
    whole[y:y + height, x:x + width] = image
    return over(whole, behind)[y:y + height, x:x + width]


def _devices(device, cluster, memory):
    """The option --device, a text or a list of several; raises what does not go with a cluster."""
    if cluster is not None:
        from ..film.cluster import check_address

        check_address(cluster)
        if memory is not None:
            raise click.UsageError("--memory is for this process; allowed: without --cluster")
        if device is not None and not cluster.startswith("local"):
            raise click.UsageError("--device is for this machine, workers elsewhere have CLFUR_DEVICE; allowed: with "
                                   "--cluster local, or without one")
    return [part.strip() for part in device.split(",")] if device and "," in device else device


def _check_shutter(degrees, outputs):
    """Raise click.UsageError for options of a shutter that is not there."""
    for name, flag in {} if degrees else given_flags({"pictures": None, "fps": None}).items():
        if name == "pictures" or "motion_vector" not in outputs:
            more = " or --outputs motion_vector" if name == "fps" else ""
            raise click.UsageError(f"{flag} is of a shutter, but there is none; allowed: with --shutter{more}")


def _check_files(output, outputs, background):
    """Raise what the user got wrong of what is written, before anything is read."""
    check_writable(output)
    if output.suffix.lower() == ".png" and set(outputs) != {"color"}:
        other = next((name for name in outputs if name != "color"), "none")
        raise click.UsageError(f"--outputs: {output} can hold color alone, not {other}; allowed: color, or others in "
                               ".exr or .npz")
    if output.suffix.lower() == ".exr":
        alone = {"matte_id", "matte_alpha"} & set(outputs)
        if "strand_area" in outputs or len(alone) == 1:
            what = "strand_area" if "strand_area" in outputs else f"{alone.pop()} alone"
            raise click.UsageError(f"--outputs: {output} cannot hold {what}; allowed: in .npz")
    if background is not None and "color" not in outputs:
        raise click.UsageError("--background is for the output color, which is not asked for; allowed: with it")
