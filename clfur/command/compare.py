"""The command `clfur compare`."""

import json
import sys
from pathlib import Path

import click

from .. import compare as compare_devices
from ..judge.report import check_report, mebibytes, milliseconds, save_report, spread
from .devices import ask_drivers
from .options import Sectioned, command_line, scene_options
from .scenes import load_scene
from .types import Whole
from .waiting import waiting

NO_FLIP = "needs pip install flip_evaluator"


@click.command(cls=Sectioned, context_settings={"show_default": True})
@click.argument("given", metavar="[MESH]", default="teapot")
@click.option("--devices", default="all", metavar="all|A,B",
              help="Which, as --device of `clfur render` takes them, with commas between.")
@click.option("--repeat", type=Whole(1), default=5, metavar="N", help="Warm frames a device.")
@click.option("-o", "--output", metavar="FILE.html",
              help='Also write a page with charts and pictures; needs pip install "clfur[report]".')
@scene_options
@click.option("--json", "as_json", is_flag=True, help="Print what was found as JSON.")
def compare(given, devices, repeat, output, as_json, **options):
    """Draw the same frames on each device, and report times, memory and the pictures' differences.

    MESH is what `clfur render` takes, a mesh or a scene file.  Each device has a process of its own, so that a driver
    that crashes or hangs costs one row.  Exit code 0 if all devices give the same picture, else 1.
    """
    from rich.console import Console  # takes long to import
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    if output is not None:
        check_report(output)
    with waiting(f"reading {given}") as tell:
        scene, settings = load_scene(given, options)
        tell("starting OpenCL")
        ask_drivers()
    # On stderr, and gone at the end: stdout is for what was found.
    with Progress(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("frames"),
                  TimeElapsedColumn(), console=Console(stderr=True), transient=True,
                  disable=not sys.stderr.isatty()) as progress:
        tasks = {}

        def show(device, done, frames):
            if device not in tasks:
                tasks[device] = progress.add_task(device, total=frames)
            progress.update(tasks[device], completed=done)
        found = compare_devices(scene, devices, settings, repeat, tell=show)
    if output is not None:
        save_report(output, found, Path(given).stem, command_line())
    if as_json:
        print(json.dumps({"scene": given, "report": output, **found.as_dict()}, allow_nan=False))
    else:
        _print(found, given)
    return 0 if found.agree else 1


def _print(found, given):
    """Print what was found, for people."""
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False, markup=False,   # what is no terminal has no width either
                      **({} if sys.stdout.isatty() else {"width": 120}))
    strands = "" if found.strands is None else f", {found.strands:,} strands, {found.segments:,} segments"
    console.print(f"{given}: {found.size[0]}x{found.size[1]}{strands}, "
                  f"{found.repeat} warm frame{'s' * (found.repeat != 1)} a device")
    if found.fastest:
        console.print(found.fastest)
    _table(console, "", ["device", "driver and processor", "status"], [
        [row.device, row.name, Text(row.status, "green" if row.status == "ok" else "red")
         + (", the reference" if row.device == found.reference else "") + (f": {row.message}" if row.message else "")]
        for row in found.rows])
    rows = [row for row in found.rows if row.frame]
    if not rows:
        return
    _table(console, "frames, ms: median (least–most)", [
        "device", "frame", "first", "build", "strands/s", "device MiB", "process MiB"], [
        [row.device, spread(row.frame), milliseconds(row.first), milliseconds(row.build),
         f"{row.strands_per_second:,.0f}", mebibytes(row.memory), mebibytes(row.resident)] for row in rows])
    names = list(dict.fromkeys(name for row in rows for name in row.stages or ()))
    _table(console, "stages, ms on the device", ["device", *names], [
        [row.device, *(["not reported"] if row.stages is None else
                       [f"{milliseconds(s.median)}\n{milliseconds(s.min)}–{milliseconds(s.max)}"
                        for s in map(row.stages.get, names)])] for row in rows])
    names = list(dict.fromkeys(name for row in rows for name in row.difference.same))
    _table(console, f"difference to {found.reference}",
           ["device", "largest", "pixels > 1e-3", "FLIP", *names], [
        [row.device, f"{row.difference.largest:.2g}", f"{row.difference.share:.3%}",
         NO_FLIP if row.difference.flip is None else f"{row.difference.flip:.2g}",
         *("same bits" if row.difference.same[name] else "differs" for name in names)] for row in rows])


def _table(console, title, columns, rows):
    from rich.table import Table

    table = Table(title=title, title_justify="left", title_style="bold", header_style="dim", box=None,
                  padding=(0, 1 if len(columns) > 7 else 2, 0, 0))   # seven stages fit into 80 columns
    for place, column in enumerate(columns):
        table.add_column(column, justify="right" if place and title else "left", overflow="fold")
    for row in rows:
        table.add_row(*row)
    console.print()
    console.print(table)
