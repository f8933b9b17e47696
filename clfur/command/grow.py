"""`clfur grow`: the strands of a mesh, or of a scene file, to a strand file."""

import functools
import json
from pathlib import Path

import click

from .. import Error, Strands, grow, save_curves
from ..files.curves import WRITERS
from ..files.output import check_writable
from ..files.usd import is_usd
from ..scene import upright
from .devices import ask_drivers
from .options import Sectioned, of_sections, scene_options
from .scenes import load_moving, moved, scene_at, spare
from .waiting import waiting

UNUSED = of_sections("Shells", "Body and ground", "Light", "Camera")


def _growing(command):
    """Give a command the options of hair that grows, and the defaults of all others that `load_scene` reads."""
    all_of_them = click.command()(scene_options(lambda **options: None, settings=False))
    usual = all_of_them.make_context("grow", []).params
    others = {name: usual[name] for name in UNUSED if name in usual}

    @functools.wraps(command)
    def growing(*arguments, **options):
        return command(*arguments, **others | options)

    growing = scene_options(growing, settings=False)
    growing.__click_params__ = [option for option in growing.__click_params__ if option.name not in UNUSED]
    return growing


@click.command("grow", cls=Sectioned, context_settings={"show_default": True})
@click.argument("given", metavar="MESH")
@click.option("-o", "--output", required=True, metavar="FILE", help="Strand file: " + ", ".join(WRITERS) + ".")
@_growing
@click.option("--device", metavar="DEVICE", help="As for `clfur render`.")
@click.option("--json", "as_json", is_flag=True, help="Print what was grown as JSON.")
def grow_command(given, output, device, as_json, **options):
    """Grow the hair of MESH, a mesh or a scene file as for `clfur render`, and save its strands.

    Diameters, colours and uv at the roots go along where FILE's format has a place for them: docs/formats.md.
    `clfur render MESH --hair FILE` draws them.
    """
    check_writable(output, tuple(WRITERS))
    with waiting(f"reading {given}") as tell:
        *moving, _ = load_moving(given, options)
        scene = scene_at(moving[0], options["time"])
        spare(output)
        if not isinstance(scene.strands, Strands):
            raise Error(f"{given} grows no strands; allowed: with --fur strands or both, and without --hair")
        tell("starting OpenCL")
        ask_drivers()
        tell(f"growing hair on {given}")
        scene, steps = moved(given, *moving, options["time"], device)
        curves = scene.strands if steps else grow(scene, device)
        tell(f"saving {output}")
        turned = options["up"] == "z" and not is_usd(output)   # which would tell that Y is up
        save_curves(output, upright(curves, back=True) if turned else curves)
    strands, points = len(curves.counts), int(curves.counts.sum())
    if as_json:
        print(json.dumps({"file": str(Path(output)), "strands": strands, "points": points, "types": len(
            curves.hair_types), "bounds": {"center": curves.bounds.center.tolist(), "radius": curves.bounds.radius}}))
    else:
        print(f"{Path(output)}: {strands:,} strands, {points:,} points")
