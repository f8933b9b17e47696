"""The `clfur` command."""

import atexit
import contextlib
import gc
import importlib
import os
import sys
import warnings

import click

from .. import __version__
from ..errors import Error
from ..files.input import noting
from . import endings
from .devices import asking_drivers

# {name: function in the module of that name}, which is imported when it is called, or for its line of the help.
COMMANDS = {"chart": "chart", "compare": "compare", "devices": "devices", "film": "film_command",
            "grow": "grow_command", "render": "render", "view": "view"}


class Commands(click.Group):
    """All commands, imported one by one."""

    def list_commands(self, context):
        return list(COMMANDS)

    def get_command(self, context, name):
        if name not in COMMANDS:
            return None
        with endings.importing():
            return getattr(importlib.import_module(f".{name}", __package__), COMMANDS[name])

    def resolve_command(self, context, arguments):
        draws = arguments[0] in COMMANDS and arguments[0] != "devices" and not context.resilient_parsing   # TAB
        if draws and not {*arguments} & {*context.help_option_names}:
            context.with_resource(asking_drivers())   # ahead of imports, which take as long
        return super().resolve_command(context, arguments)


@click.group(cls=Commands, invoke_without_command=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__)
@click.pass_context
def clfur(context):
    """Fur and hair on meshes, rendered with OpenCL."""
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


def main(arguments=None):
    """Run the command and exit; what the user got wrong is one line on stderr and exit code 2."""
    for name in "stdout", "stderr":
        stream = getattr(sys, name)
        if stream is None:   # closed by who started this process
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))   # noqa: SIM115, open to the end
        elif hasattr(stream, "reconfigure"):   # a device's name need not be ASCII
            stream.reconfigure(errors="replace")
    # NumPy's OpenBLAS lets threads spin for a tenth of a second once it is loaded, and after each of its products, on
    # cores that drivers need: now for 2^4 ticks of a clock.  It reads this as NumPy is imported, which is later.
    os.environ.setdefault("OPENBLAS_THREAD_TIMEOUT", "4")
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
