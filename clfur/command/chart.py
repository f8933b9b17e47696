"""The command `clfur chart`."""

import functools
import json
import sys
from pathlib import Path

import click

from .. import frontier
from ..judge.chart import check_chart, numbers, save_chart
from ..judge.report import spread
from ..settings import Settings
from .devices import ask_drivers
from .options import Sectioned, command_line, scene_options
from .scenes import load_scene, spare
from .types import Whole
from .waiting import waiting

DOING = {"truth": "drawing the truth", "pictures": "measuring pictures", "times": "timing frames"}


@click.command(cls=Sectioned, context_settings={"show_default": True})
@click.argument("given", metavar="[MESH]", default="teapot")
@click.option("-o", "--output", metavar="FILE",
              help='Also draw it: .html (a page), .png or .svg; needs pip install "clfur[report]".')
@click.option("--device", metavar="DEVICE", help="As `clfur render` takes it; one alone.")
@click.option("--repeat", type=Whole(1), default=3, metavar="N", help="Warm frames of each settings.")
@click.option("--pan/--no-pan", default=True, help="Whether to measure flicker: four more pictures of each.")
@click.option("--fresh", is_flag=True, help="Forget what earlier runs have measured, all but the truth.")
@functools.partial(scene_options, size="320x240", settings=False)
@click.option("--json", "as_json", is_flag=True, help="Print all that was measured as JSON.")
def chart(given, output, device, repeat, pan, fresh, as_json, **options):
    """Chart speed against accuracy: what many settings take, and how far each is from the truth.

    MESH is what `clfur render` takes, a mesh or a scene file, whose settings are charted too, as "own".  The table
    lists the settings that no others beat in both time and error.  What was measured is kept: a run that is cut
    short goes on where it was.
    """
    from rich.console import Console  # takes long to import
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    if output is not None:
        check_chart(output)
    with waiting(f"reading {given}") as tell:
        scene, settings = load_scene(given, options)
        if output is not None:
            spare(output)
        tell("starting OpenCL")
        ask_drivers()
    given_settings = None if settings == Settings() or settings.goal else settings
    # On stderr, and gone at the end: stdout is for what was found.
    with Progress(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
                  console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as progress:
        tasks = {}

        def show(doing, done, total):
            if doing not in tasks:
                tasks[doing] = progress.add_task(DOING[doing], total=total)
            progress.update(tasks[doing], completed=done, total=total)
        found = frontier(scene, device=device, repeat=repeat, pan=pan, tell=show, fresh=fresh,
                         own=given_settings)
    if output is not None:
        save_chart(output, found, Path(given).stem, command_line())
    if as_json:
        print(json.dumps({"scene": given, "chart": output, **found.as_dict()}, allow_nan=False))
    else:
        _print(found, given)


def _print(found, given):
    """Print what was found, for people."""
    from rich.console import Console
    from rich.table import Table

    console = Console(highlight=False, markup=False,   # what is no terminal has no width either
                      **({} if sys.stdout.isatty() else {"width": 120}))
    frames = sum(len(point.times) for point in found.points)
    console.print(f"{given}: {found.size[0]}x{found.size[1]} on {found.device}; {len(found.points)} settings, "
                  f"{frames} warm frames" + (f", {found.earlier} of an earlier run" if found.earlier else ""))
    console.print(f"the truth: {found.truth}, itself {found.noise:.4f} in error")
    table = Table(title="the frontier: no others are both faster and nearer the truth", title_justify="left",
                  title_style="bold", header_style="dim", box=None, padding=(0, 2, 0, 0))
    columns = ["error", "flip", "bias", "area", "flicker"]
    for name in ["settings", "frame, ms", *columns]:
        table.add_column(name, justify="left" if name == "settings" else "right", overflow="fold")
    named = [point for point in found.points if point.name and not point.best]
    for point in found.best + named:
        values = numbers(point)
        table.add_row(point.label + (f" ({point.name})" if point.name else ""), spread(point.seconds),
                      *(values[name] for name in columns), style="dim" if point in named else None)
    console.print()
    console.print(table)
    if named:
        console.print(f"not on it: {', '.join(point.name for point in named)}", style="dim")
