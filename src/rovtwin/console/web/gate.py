"""Who may come in, by whatever door: pages, files, sockets of ours and of NiceGUI."""

import secrets
from html import escape
from typing import Any
from urllib.parse import parse_qsl, quote, urlencode

from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import HTMLResponse, PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOOPBACK = ("127.0.0.1", "localhost", "::1")
COOKIE = "rovtwin_token"
REFUSED = "rovtwin console: open the address with its ?token=... as the terminal shows it"
# A page that leads on, in place of a redirect: where a link on another site was followed, a browser sends no cookie of
# SameSite=strict with what that link redirects to, but does with what a page of ours asks for.
LEADS_ON = '<!doctype html><title>rovtwin</title><meta http-equiv="refresh" content="0; url={}">'


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
        given = query.get("token") or cookies.get(cookie_of(host)) or ""
        return secrets.compare_digest(given.encode(errors="replace"), self.token.encode())


def cookie_of(host: str) -> str:
    """Name of the cookie with the token; cookies know no ports, and another console may be served at the next one."""
    return f"{COOKIE}_{host.rpartition(':')[2]}" if host.rpartition(":")[2].isdecimal() else COOKIE


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
            if is_socket:
                await self._app(scope, receive, send)
                return
            new = self._gate.token is not None and bool(asked.query_params.get("token"))
            led_on = new and scope["method"] == "GET" and "text/html" in asked.headers.get("accept", "")
            marked = self._marked(send, cookie_of(asked.headers.get("host", "")) if new else "")
            await (_clean(scope) if led_on else self._app)(scope, receive, marked)
        elif is_socket:
            await receive()  # its request to connect
            await send({"type": "websocket.close", "code": 1008})
        else:
            await PlainTextResponse(REFUSED, 403)(scope, receive, send)

    def _marked(self, send: Send, cookie: str) -> Send:
        """Answers that no other page may show or learn the address of; with the token in a cookie, if one is named."""

        async def marked(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                # Within a page of another site STOP's neighbours could be clicked unseen.
                # Added to a page's own, if it has one: both count.
                headers.append("Content-Security-Policy", "frame-ancestors 'none'")
                headers["Referrer-Policy"] = "no-referrer"
                if cookie:
                    headers.append("Set-Cookie", f"{cookie}={self._gate.token}; HttpOnly; Path=/; SameSite=strict")
            await send(message)

        return marked


def _clean(scope: Scope) -> HTMLResponse:
    """Leads on to the same address without the token, which would stay in the address bar and in what is kept of it."""
    rest = [(key, value) for key, value in parse_qsl(scope["query_string"].decode("latin-1")) if key != "token"]
    address = "/" + quote(scope["path"].lstrip("/")) + (f"?{urlencode(rest)}" if rest else "")
    return HTMLResponse(LEADS_ON.format(escape(address)), headers={"Cache-Control": "no-store"})
