"""`clfur view`: a page on this machine, and the websocket that brings it pictures."""

import asyncio
import contextlib
import errno
import json
import os
import secrets
import socket
import struct
import sys
import threading
import webbrowser
from collections.abc import Callable
from typing import Any

import uvicorn
from fastapi import FastAPI, WebSocket, WebSocketDisconnect

from ..errors import Error
from . import dropping, page
from .document import Document
from .drawing import Drawing
from .guard import Guard
from .windows import Link

ROUTE = "/pictures"
PATIENCE = 0.5    # seconds in which connections should end
LONGEST = 30.0    # seconds that are waited for a kernel that is being built
UNKNOWN = 4404    # the code that closes a socket whose window is not known: its page has to be loaded anew


def view(document: Document, devices: Any, host: str = "127.0.0.1", port: int | None = None, browser: bool = True,
         title: str = "clfur", said: Callable[[str], Any] = print) -> None:
    """Serve a page that shows a document, until what ends a command is raised (see `clfur.command.endings`).

    devices: what `clfur.draw` takes, for this alone. host: the address it is bound to. port: or None for one that is
    free. browser: whether one is opened. said: takes a line, the page's address. Raises Error where it cannot be.
    """
    with _listening(host, port) as listening:
        port, token = listening.getsockname()[1], secrets.token_urlsafe(24)
        drawing = Drawing(document, devices)
        app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
        app.websocket(ROUTE)(_pictures(drawing))
        dropping.add_route(app, document)
        page.build(app, drawing, title)
        guard = Guard(app, port, token, host)
        server = uvicorn.Server(uvicorn.Config(
            guard, log_level="critical", access_log=False, server_header=False, ws_per_message_deflate=False,
            timeout_graceful_shutdown=1, lifespan="on"))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, name="server", daemon=True)
        over = threading.Event()
        try:
            drawing.start()
            thread.start()
            address = f"http://{_shown(host)}:{port}/?token="
            said(address + token)
            if browser and _has_screen():   # whose arguments other users of the machine can read
                webbrowser.open(address + guard.once())
            while not over.wait(0.5):   # signals are heard in between
                if not thread.is_alive():
                    raise Error("the server has ended by itself")
        finally:
            server.should_exit = True
            thread.join(PATIENCE)
            drawing.close(LONGEST)


def _shown(host):
    """The host of an address, for who serves at this one."""
    host = {"localhost": "127.0.0.1", "0.0.0.0": "127.0.0.1", "::": "::1"}.get(host.lower(), host)
    return f"[{host}]" if ":" in host else host


def _has_screen():
    """Whether there is one for a browser; else some open in the terminal."""
    return sys.platform in ("win32", "darwin") or bool({"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys())


@contextlib.contextmanager
def _listening(host, port):
    """A socket that listens there."""
    if not host:   # which a socket would take for all addresses
        raise Error("no page can be served at '' as the host; allowed: 127.0.0.1, or another address of this machine")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as listening:
        # Windows would share a port that another one listens to.
        if hasattr(socket, "SO_EXCLUSIVEADDRUSE"):
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        else:
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((host, port or 0))
            listening.listen(128)
        except (OSError, OverflowError, UnicodeError) as error:
            why = (getattr(error, "strerror", None) or str(error)).lower()
            of_host = isinstance(error, (socket.gaierror, UnicodeError)) or getattr(
                error, "errno", None) == errno.EADDRNOTAVAIL
            allowed = "a free port" if not of_host else "an address or name of this machine"
            raise Error(f"no page can be served at {host}, port {port or 'any'}: {why}; allowed: {allowed}") from None
        yield listening


def _pictures(drawing):
    """The route that takes what a page tells, and brings it pictures."""
    async def pictures(socket: WebSocket, window: str = "", before: str = ""):
        known = drawing.windows.get(window)
        await socket.accept()
        if known is None:
            return await socket.close(UNKNOWN)
        waiting: asyncio.Queue = asyncio.Queue()
        loop, drawn = asyncio.get_running_loop(), asyncio.Event()
        drawn.set()

        def later(*what):
            with contextlib.suppress(RuntimeError):   # the loop has ended
                loop.call_soon_threadsafe(waiting.put_nowait, what)
        link = Link(later, lambda header: later(header, b""))
        sending = asyncio.ensure_future(_send(socket, waiting, drawn))
        drawing.connect(known, link, before)
        try:
            while True:
                message = json.loads(await socket.receive_text())
                if not isinstance(message, dict):
                    raise Error("a message is no object")
                if message.get("drawn"):
                    drawn.set()
                drawing.take(known, link, message)
        except WebSocketDisconnect:
            pass
        except (Error, ValueError, KeyError):   # not of our page
            await socket.close(1003)
        finally:
            drawing.disconnect(known, link)
            sending.cancel()
    return pictures


async def _send(socket, waiting, drawn):
    """Send what waits: of pictures the next one when the last one is drawn."""
    while True:
        header, data = await waiting.get()
        if data:
            await drawn.wait()
            drawn.clear()
        head = json.dumps(header).encode()
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):   # the page has gone
            await socket.send_bytes(struct.pack("<I", len(head)) + head + data)
