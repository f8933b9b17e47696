"""`clfur view`: a mesh with fur, or a scene file, in a browser."""

import warnings
from pathlib import Path

import click

from .. import Error, Scheduler
from ..files.usd import is_usd
from ..viewer.guard import LOCAL
from . import endings
from .devices import ask_drivers
from .options import Sectioned, scene_options
from .scenes import is_scene_file, load_moving
from .types import Bytes, Whole
from .waiting import waiting

NEEDED = "nicegui", "fastapi", "uvicorn", "starlette"   # modules that clfur[view] brings

@click.command(cls=Sectioned, context_settings={"show_default": True})
@click.argument("given", metavar="MESH")
@scene_options
@click.option("--port", type=Whole(1, 65535), metavar="N", help="Of the page.  [default: one that is free]")
@click.option("--host", default="127.0.0.1", metavar="ADDRESS",
              help="Address that the page is served at; with another than this one, such as 0.0.0.0, whoever knows the "
                   "page's address can see and change the scene from other machines.")
@click.option("--no-browser", is_flag=True, help="Open no browser: the page's address is printed alone.")
@click.option("--device", metavar="DEVICE", help="As for `clfur render`.")
@click.option("--memory", type=Bytes(), metavar="SIZE", help="As for `clfur render`.")
def view(given, port, host, no_browser, device, memory, **options):
    """Show MESH with fur in a browser, turn it with the mouse, and change it.

    MESH is what `clfur render` takes.  The page's address is printed; it is for this machine alone, and holds a token
    without which it does not open.  Ctrl-C ends it.
    """
    show, document_of = _viewer()
    if host and host.lower() not in LOCAL:
        warnings.warn(f"the page is served at {host}, not encrypted: who reads its address on the network can see and "
                      "change the scene", stacklevel=2)
    with waiting(f"reading {given}") as tell:
        document = document_of(given, options)
        tell("starting OpenCL")
        ask_drivers()
        names = [part.strip() for part in device.split(",")] if device and "," in device else [device]
        gpus = [Scheduler(one, memory) for one in names]

    def said(address):
        endings.serves()
        print(f"{given}: {address}  (Ctrl-C ends)", flush=True)
    show(document, gpus, host, port, not no_browser, Path(given).name, said)


def _viewer():
    """(`clfur.viewer.server.view`, function that makes a Document of a command's argument and options)."""
    try:
        from ..viewer.server import view
    except ImportError as error:
        if (error.name or "").partition(".")[0] in NEEDED:
            raise Error('clfur view needs NiceGUI: pip install "clfur[view]"') from None
        raise
    return view, _document


def _document(given, options):
    from ..viewer.document import Document, MeshFile

    scene, motion, settings = load_moving(given, options)
    plain = not is_scene_file(given) and not is_usd(given) and options["rest"] is None
    mesh_file = MeshFile(scene.mesh, given, up=options["up"]) if plain else None
    return Document(scene, settings, motion, mesh_file)
