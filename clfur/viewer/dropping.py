"""The route that takes dropped files: a body of a request, which is read up to a limit."""

import asyncio
from typing import Any

from fastapi import FastAPI, Request
from fastapi.responses import PlainTextResponse

from ..errors import Error
from . import dropped
from .document import Document

ROUTE = "/drop"
LARGE, WRONG, BROKEN = 413, 422, 500   # status codes


def add_route(app: FastAPI, document: Document) -> None:
    """Let an app take files that are dropped: POST /drop?name=..., the file as the body -> a line of text."""
    turn = asyncio.Lock()

    @app.post(ROUTE)
    async def drop(request: Request, name: str = "") -> Any:
        try:
            dropped.suffix_of(name, int(request.headers.get("content-length") or 1))   # before any of it is read
            data = await _body(request)
            async with turn:
                return PlainTextResponse(await asyncio.to_thread(dropped.take, document, name, data))
        except Error as error:
            large = "at most" in str(error) and "MiB" in str(error)
            return PlainTextResponse(str(error), LARGE if large else WRONG)
        except Exception as error:   # of a reader: the page gets one line all the same
            return PlainTextResponse(f"the file cannot be read: {type(error).__name__}", BROKEN)


async def _body(request):
    """The body of a request; raises Error where it is larger than it may be, as soon as it is."""
    data = bytearray()
    async for part in request.stream():
        data += part
        if len(data) > dropped.MOST:
            dropped.suffix_of("file.obj", len(data))
    return bytes(data)
