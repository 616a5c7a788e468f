"""Who may come in: pages of this server only, and from elsewhere only who has the token."""

import secrets
from typing import Any

from fastapi import Request, Response
from nicegui import app

LOOPBACK = ("127.0.0.1", "localhost", "::1")
COOKIE = "rovtwin_token"


class Gate:
    """Of a server at a host.

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
        return secrets.compare_digest(given, self.token)

    def guard(self) -> None:
        """Stand before every request of the server; sockets ask `admits` themselves."""

        @app.middleware("http")
        async def guard(request: Request, go_on: Any) -> Response:
            if not self.admits(request.headers, request.cookies, request.query_params):
                return Response("rovtwin console: open the address with its ?token=... as the terminal shows it", 403)
            response = await go_on(request)
            if self.token is not None and request.query_params.get("token"):
                response.set_cookie(COOKIE, self.token, httponly=True, samesite="strict")
            return response
