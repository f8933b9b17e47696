"""`clfur grow`: the strands of a mesh, or of a scene file, to a strand file."""

from pathlib import Path

import click

from .. import Error, grow, save_curves
from ..files.curves import WRITERS
from ..files.output import check_writable
from .devices import ask_drivers
from .options import Sectioned, scene_options
from .scenes import load_scene
from .waiting import waiting


@click.command("grow", cls=Sectioned, context_settings={"show_default": True})
@click.argument("given", metavar="MESH")
@click.option("-o", "--output", required=True, metavar="FILE", help="Strand file: " + ", ".join(WRITERS) + ".")
@scene_options
@click.option("--device", metavar="DEVICE", help="As for `clfur render`.")
def grow_command(given, output, device, **options):
    """Grow the hair of MESH, a mesh or a scene file as for `clfur render`, and save its strands.

    Diameters, colours and uv at the roots go along where FILE's format has a place for them: docs/formats.md.
    `clfur render MESH --hair FILE` draws them.
    """
    check_writable(output, tuple(WRITERS))
    with waiting(f"reading {given}") as tell:
        scene, _ = load_scene(given, options)
        if scene.strands is None or options["hair"] is not None:
            raise Error(f"{given} grows no strands; allowed: with --fur strands or both, and without --hair")
        tell("starting OpenCL")
        ask_drivers()
        tell(f"growing hair on {given}")
        curves = grow(scene, device)
        tell(f"saving {output}")
        save_curves(output, curves)
    print(f"{Path(output)}: {len(curves.counts):,} strands, {int(curves.counts.sum()):,} points")
