"""`clfur film`: a mesh with fur, or a scene file, to a video or a folder of pictures."""

import json
import time
from pathlib import Path

import click
import numpy as np

from .. import HairMotion, Scheduler, Wind, film
from ..files.usd import is_usd
from ..files.video import KINDS
from ..film.film import frames_there
from ..film.turntable import turntable as around
from .devices import ask_drivers
from .lines import say
from .options import Sectioned, given_flags, scene_options
from .scenes import is_scene_file, load_moving, of_file, scene_at, spare
from .types import Bytes, Color, Frames, Numbers, Real, Subframes
from .waiting import counting, waiting

SIDES = 12      # from which a turntable's camera sees all there is
METRES = 0.5    # that the longest side of a mesh is taken for where nobody tells: a cat's
GUST = 0.5      # of the wind's mean
OTHER = {"wind": (0.0, 0.0, 0.0), "time": None}   # options of one picture


def _filming(command):
    """Give a command the options of a scene, but those of one picture."""
    command = scene_options(command)
    command.__click_params__ = [option for option in command.__click_params__ if option.name not in OTHER]
    return command


@click.command("film", cls=Sectioned, context_settings={"show_default": True})
@click.argument("given", metavar="MESH")
@click.option("-o", "--output", metavar="FILE",
              help="MP4, WebM, MOV (ProRes), GIF, PNG (APNG), or pictures with a place for their number: "
                   "frames/%04d.png or .exr.  [default: the mesh's name, .mp4]")
@_filming
@click.option("--frames", type=Frames(), default="0:24", metavar="A:B[:STEP]",
              help="Numbers of the frames, from A up to B, without B.")
@click.option("--fps", type=Real(1, 1000), default=24.0, metavar="N",
              help="Frames a second: number n is n/N seconds after the groom.")
@click.option("--turntable", type=Real(-3600, 3600), is_flag=False, flag_value=360.0, metavar="[DEGREES]",
              help="Let the camera go around the scene in all these frames, by 360 or so many degrees.  Lights go with "
                   "it, as if the scene turned, but those of --light, a scene file or USD.")
@click.option("--shutter", type=Real(0, 360), default=0.0, metavar="DEGREES",
              help="For how much of a frame's time the shutter is open, up to the frame's moment; 0: motion does not "
                   "blur.")
@click.option("--subframes", type=Subframes(), default="auto", metavar="N|auto",
              help="Pictures of that time that make a frame; auto: as many as motion on the screen needs, 1 to 64.")
@click.option("--wind", "blown", type=Numbers(3), metavar="X,Y,Z",
              help="Wind in metres a second.  With this or another option of motion, strands move.")
@click.option("--gust", type=Real(0, 16), metavar="0..16",
              help=f"How strong gusts are, of the wind.  [default: {GUST}]")
@click.option("--bend-length", type=Real(0, min_open=True), metavar="L",
              help="Hair shorter than this stands, longer droops.  [default: the longest hair]")
@click.option("--units-per-metre", type=Real(0, min_open=True), metavar="N",
              help=f"Of the scene.  [default: the mesh is {100 * METRES:g} cm long]")
@click.option("--background", type=Color(), metavar="COLOR",
              help="What all is laid over: R,G,B or '#rrggbb'.  [default: nothing, or black in a file without alpha]")
@click.option("--overwrite", is_flag=True, help="Replace the frames of another film, which are in the folder.")
@click.option("--cluster", metavar="local|ADDRESS",
              help="Draw frames on several machines or devices: local, local:N, or the tcp://host:port or tls://host:port"
                   ' of a Dask scheduler; see docs/cluster.md; needs pip install "clfur[cluster]".')
@click.option("--device", metavar="DEVICE", help="As for `clfur render`.")
@click.option("--memory", type=Bytes(), metavar="SIZE", help="As for `clfur render`.")
@click.option("--json", "as_json", is_flag=True, help="Print what was drawn as JSON.")
def film_command(given, output, frames, fps, turntable, shutter, subframes, blown, gust, bend_length, units_per_metre,
                 background, overwrite, cluster, device, memory, as_json, **options):
    """Draw MESH with fur at one moment after the other, and save the film.

    MESH is what `clfur render` takes.  Its hair moves with --wind and the other options of motion, or as a scene file
    says that sets `motion`; a scene file that defines scene(t), t in seconds, sets all else that moves.  Called again,
    a film that was interrupted goes on where it stopped.
    """
    output = Path(Path(given).stem + ".mp4" if output is None else output)
    options |= OTHER | ({"sides": SIDES} if turntable is not None and abs(turntable) > 30 else {})
    if not shutter and "subframes" in given_flags({"subframes": subframes}):
        raise click.UsageError("--subframes is of a shutter, but there is none; allowed: with --shutter")
    if device and "," in device:
        device = [part.strip() for part in device.split(",")]
    with waiting(f"reading {given}") as tell:
        scene, motion, settings = load_moving(given, options)
        first = scene_at(scene, 0)
        for each in [output, *frames_there(output)]:
            spare(each)
        flags = given_flags({"blown": blown, "gust": gust, "bend_length": bend_length,
                             "units_per_metre": units_per_metre})
        guessed = flags and units_per_metre is None and first.mesh
        if guessed:
            units_per_metre = float(np.ptp(first.mesh.positions, axis=0).max()) / METRES
        motion = _motion(given, motion, flags, blown, gust, bend_length, units_per_metre)
        if turntable is not None:
            lights = not (is_scene_file(given) or is_usd(given) or options["lights"])
            scene = around(scene, turntable, len(frames) * frames.step / fps, lights, frames.start / fps)
        tell("starting OpenCL")
        ask_drivers()
        if memory is not None:
            device = [Scheduler(one, memory) for one in (device if isinstance(device, list) else [device])]
    began, told = time.monotonic(), []
    with counting() as show, of_file(given, ("Motion.", "scene(")):
        def progress(what, done, of):
            told.append(done)
            show(what, done, of)
        film(scene, output, frames, fps=fps, motion=motion, settings=settings, device=device, cluster=cluster,
             shutter=shutter, subframes=subframes, background=background, overwrite=overwrite, progress=progress)
    seconds, there = time.monotonic() - began, told[0]
    width, height = first.camera.size
    black = background is None and output.suffix.lower() in KINDS and not KINDS[output.suffix.lower()].alpha
    if as_json:
        print(json.dumps({"file": str(output), "size": [width, height], "frames": len(frames), "there": there,
                          "fps": fps, "seconds": seconds, "moves": motion is not None,
                          "units_per_metre": motion and motion.get("units_per_metre", 1.0),
                          "background": [0, 0, 0] if black else background and list(background)}))
        return
    made = f"{len(frames):,} frame{'s' * (len(frames) > 1)} of {width}x{height}"
    say(f"{output}: {made} in {seconds:.1f} s", *filter(None, [
        f"{there:,} of them were there" if there else "",
        f"laid over black, as {output.suffix} holds no alpha: --background sets another colour" if black else "",
        f"hair moves as if the mesh were {100 * METRES:g} cm long: --units-per-metre {units_per_metre:.3g}"
        if guessed else "",
        "" if motion is not None or callable(scene) else
        "nothing moves: --wind, --turntable or a scene file can move it"]))


def _motion(given, motion, flags, blown, gust, bend_length, units_per_metre):
    """Arguments of `Motion`, of a scene file or of the options given, {name: flag}; None without any."""
    if motion is not None:
        for flag in flags.values():
            raise click.UsageError(f"{flag}: {given} sets motion itself; change it there")
        return motion
    if "gust" in flags and "blown" not in flags:
        raise click.UsageError("--gust is how strong gusts of the wind are, but there is none; allowed: with --wind")
    if not flags:
        return None
    wind = Wind(blown, GUST if gust is None else gust) if blown else None
    return {"hair": HairMotion(bend_length=bend_length), "wind": wind, "units_per_metre": units_per_metre or 1.0}
