"""Who may ask: around everything that is served, before anything of it is accepted.

Any page that somebody has open can send requests to a port of this machine, under this machine's name or, where it
controls a name, under another one.  So a request must name a host that is ours, come from no other page, and bring a
token that only this terminal's address holds.
"""

import hmac
import ipaddress
import re
import secrets
import socket
from typing import Any
from urllib.parse import parse_qs

LOCAL = ("127.0.0.1", "localhost", "::1")
HOST = re.compile(r"(\[[^\[\]]*\]|[^:\[\]]*)(?::(\d+))?")
HEADERS = [(b"referrer-policy", b"no-referrer"), (b"x-content-type-options", b"nosniff"),
           (b"content-security-policy", b"frame-ancestors 'none'")]
AGAIN = "this page opens with the address that clfur view prints in its terminal"


class Guard:
    """An ASGI app around another one, served at a host, from other machines, too, if it is none of `LOCAL`, and a port.

    What names another host gets status 400, what comes from another page's origin or without the token 403; websockets
    are refused before they are accepted, and need an origin.  The address /?token=... gives a cookie, and leads to /.
    """

    def __init__(self, app: Any, port: int, token: str, host: str = LOCAL[0]) -> None:
        self.app, self.port, self.token, self.host = app, port, token, host.lower()
        self.cookie = f"clfur-view-{port}"   # cookies are of a host, whatever its port
        self._once: set[str] = set()

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """As ASGI has it."""
        if scope["type"] == "lifespan":
            return await self.app(scope, receive, send)
        headers = scope["headers"]
        refused = self.refused(scope, headers)
        if scope["type"] == "websocket":
            if not refused and not self._has_cookie(headers):
                refused = 403, AGAIN
            if refused:
                return await send({"type": "websocket.close", "code": 1008, "reason": refused[1]})
            return await self.app(scope, receive, send)
        given = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token")
        if not refused and scope["path"] == "/" and given and (self.is_known(given[0]) or self._is_first(given[0])):
            return await self._let_in(send)
        if not refused and not self._has_cookie(headers):
            refused = 403, AGAIN
        if refused:
            return await _answer(send, *refused)

        async def sent(message):
            if message["type"] == "http.response.start":
                message = message | {"headers": [*message.get("headers", ()), *HEADERS]}
            await send(message)
        await self.app(scope, receive, sent)

    def refused(self, scope: Any, headers: Any) -> tuple[int, str] | None:
        """(status, why) of a request whose host or origin is not ours, else None."""
        hosts, origins = _all(headers, b"host"), _all(headers, b"origin")
        if len(hosts) != 1 or not self.is_ours(hosts[0]):
            return 400, "this host is not the one that clfur view serves"
        if len(origins) > 1 or (scope["type"] == "websocket" and not origins):
            return 403, "a websocket needs an origin"
        if origins and origins[0].lower() != f"http://{hosts[0].lower()}":
            return 403, "requests of other pages are not answered"
        return None

    def is_ours(self, host: str) -> bool:
        """Whether a Host header names this server: by name or number, but by no name that somebody else may hold."""
        found = HOST.fullmatch(host.lower())
        if not found or (found[2] or "80") != str(self.port):   # browsers leave 80 out
            return False
        name = found[1].strip("[]")
        if name in LOCAL:
            return True
        if self.host in LOCAL:
            return False
        try:
            return bool(ipaddress.ip_address(name))
        except ValueError:
            return name in (self.host, socket.gethostname().lower())

    def is_known(self, token: str) -> bool:
        """Whether it is the token, in a time that does not tell how much of it is."""
        return hmac.compare_digest(token.encode(), self.token.encode())

    def _has_cookie(self, headers):
        """Whether a cookie of ours is among those of this host's servers, which may be of any form."""
        pairs = [each.partition("=") for text in _all(headers, b"cookie") for each in text.split(";")]
        return any(name.strip() == self.cookie and self.is_known(value.strip()) for name, _, value in pairs)

    def once(self) -> str:
        """A token that lets in once: for an address that others may see while it is opened."""
        self._once.add(token := secrets.token_urlsafe(24))
        return token

    def _is_first(self, given):
        known = [token for token in self._once if hmac.compare_digest(given.encode(), token.encode())]
        self._once.difference_update(known)
        return bool(known)

    async def _let_in(self, send):
        cookie = f"{self.cookie}={self.token}; Path=/; HttpOnly; SameSite=Strict"
        await send({"type": "http.response.start", "status": 303, "headers": [
            (b"location", b"/"), (b"set-cookie", cookie.encode()), (b"cache-control", b"no-store"), *HEADERS]})
        await send({"type": "http.response.body", "body": b""})


def _all(headers, name):
    return [value.decode("latin-1") for key, value in headers if key.lower() == name]


async def _answer(send, status, why):
    await send({"type": "http.response.start", "status": status,
                "headers": [(b"content-type", b"text/plain; charset=utf-8"), *HEADERS]})
    await send({"type": "http.response.body", "body": f"clfur: {why}\n".encode()})
