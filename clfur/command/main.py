"""The `clfur` command."""

import atexit
import contextlib
import gc
import os
import sys
import warnings

import click

from .. import Error, __version__
from ..files.input import noting
from . import endings
from .chart import chart
from .compare import compare
from .devices import devices
from .film import film_command
from .grow import grow_command
from .render import render
from .view import view


@click.group(invoke_without_command=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__)
@click.pass_context
def clfur(context):
    """Fur and hair on meshes, rendered with OpenCL."""
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


clfur.add_command(render)
clfur.add_command(view)
clfur.add_command(film_command)
clfur.add_command(chart)
clfur.add_command(compare)
clfur.add_command(devices)
clfur.add_command(grow_command)


def main(arguments=None):
    """Run the command and exit; what the user got wrong is one line on stderr and exit code 2."""
    for stream in (sys.stdout, sys.stderr):   # a device's name need not be ASCII
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    atexit.register(gc.freeze)   # else Python's end looks for cycles in all that was imported, which takes longest
    warnings.showwarning = lambda message, *_, **__: print("clfur: warning:", message, file=sys.stderr)
    sys.exit(endings.run(lambda: _run(arguments)) or 0)


def _run(arguments):
    """The exit code."""
    try:
        given = sys.argv[1:] if arguments is None else arguments
        with noting():   # of which none is overwritten
            code = clfur.main(given, prog_name="clfur", standalone_mode=False, obj=list(given))   # obj: what pages tell
        sys.stdout.flush()   # what fails at the end of the process is told by nobody
        return code
    except (click.Abort, KeyboardInterrupt):
        return endings.say()
    except OSError as error:   # of stdout itself: a full disk, a closed pipe
        print(f"clfur: error: {error.strerror}", file=sys.stderr)
        with contextlib.suppress(OSError, ValueError):   # what waits there still would be tried again at the end
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except MemoryError:
        print("clfur: error: out of memory: ask for a smaller picture, fewer samples or fewer strands", file=sys.stderr)
    except (Error, click.ClickException) as error:
        message = error.format_message() if isinstance(error, click.ClickException) else str(error)
        print("clfur: error:", " ".join(message.split()), file=sys.stderr)
    return 2
