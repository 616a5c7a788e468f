"""Who may come in, by whatever door: pages, files, sockets of ours and of NiceGUI."""

import secrets
from typing import Any

from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOOPBACK = ("127.0.0.1", "localhost", "::1")
COOKIE = "rovtwin_token"
REFUSED = "rovtwin console: open the address with its ?token=... as the terminal shows it"


class Gate:
    """Who may come in: pages of this server only, and from elsewhere only who has the token.

    A page of another site that is open in the operator's browser may send requests here, too: they name another host
    or another origin.
    """

    def __init__(self, host: str, token: str | None):
        self._hosts = LOOPBACK if host in LOOPBACK else None
        self.token = token

    def admits(self, headers: Any, cookies: Any, query: Any) -> bool:
        """Whether a request with these may come in."""
        host = headers.get("host", "")
        name = host.rsplit(":", 1)[0].strip("[]")
        if self._hosts is not None and name not in self._hosts:
            return False
        origin = headers.get("origin")
        if origin is not None and origin.split("://", 1)[-1] != host:
            return False
        if self.token is None:
            return True
        given = query.get("token") or cookies.get(COOKIE) or ""
        return secrets.compare_digest(given.encode(errors="replace"), self.token.encode())


class Guard:
    """Asks a gate at every door of a server. Middleware for HTTP alone would leave NiceGUI's own socket open to all."""

    def __init__(self, app: ASGIApp, gate: Gate):
        self._app, self._gate = app, gate

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        asked, is_socket = HTTPConnection(scope), scope["type"] == "websocket"
        if self._gate.admits(asked.headers, asked.cookies, asked.query_params):
            new = bool(asked.query_params.get("token"))
            await self._app(scope, receive, send if is_socket else self._marked(send, new))
        elif is_socket:
            await receive()  # its wish to connect
            await send({"type": "websocket.close", "code": 1008})
        else:
            await PlainTextResponse(REFUSED, 403)(scope, receive, send)

    def _marked(self, send: Send, new: bool) -> Send:
        """Answers with a cookie for who came with the token, and which no other page may show within itself."""

        async def marked(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                # Within a page of another site STOP's neighbours could be clicked unseen.
                headers["Content-Security-Policy"] = "frame-ancestors 'none'"
                if self._gate.token is not None and new:
                    cookie = f"{COOKIE}={self._gate.token}; HttpOnly; Path=/; SameSite=strict"
                    headers.append("Set-Cookie", cookie)
            await send(message)

        return marked
