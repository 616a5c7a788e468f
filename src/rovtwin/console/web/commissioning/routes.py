"""Addresses of commissionings: the page, the list, a checklist, and the files that stages left."""

import asyncio
from pathlib import Path
from typing import Any

from fastapi import Response
from fastapi.responses import FileResponse
from nicegui import app, ui

from rovtwin.console.commissioning.folders import file_of
from rovtwin.console.web.commissioning.attending import Commissioning
from rovtwin.console.web.commissioning.page import commission_page
from rovtwin.console.wire import encode
from rovtwin.core.errors import RovtwinError

SHOWN = {
    ".html": "text/html; charset=utf-8",
    ".pdf": "application/pdf",
    ".png": "image/png",
    ".jpg": "image/jpeg",
    ".jpeg": "image/jpeg",
    ".yaml": "text/plain; charset=utf-8",
    ".json": "text/plain; charset=utf-8",
}
# A page from a folder may have come from anybody: it runs apart, and gives no orders.
APART = {"Content-Security-Policy": "sandbox allow-scripts", "X-Content-Type-Options": "nosniff"}


def add_commissioning(commissioning: Commissioning, root: Path, defaults: dict[str, Any]) -> None:
    """Serve them; `defaults` are what the form of a new one begins with, `root` is the folder of all."""
    app.on_shutdown(commissioning.close)

    @ui.page("/commission", title="rovtwin commission")
    def page() -> None:
        commission_page()

    @app.get("/commission/list")
    async def listed() -> Response:
        return _json(await commissioning.listed() | {"defaults": defaults})

    @app.get("/commission/checklist")
    async def checklist(name: str) -> Response:
        try:
            return _json(await commissioning.checklist(name))
        except RovtwinError as error:
            return _json({"error": str(error)}, 404)

    @app.get("/commission/file")
    async def file(name: str, path: str) -> Response:
        try:
            found = await asyncio.to_thread(file_of, root, name, path)
        except RovtwinError as error:
            return Response(str(error), 404)
        kind = SHOWN.get(found.suffix.lower())
        sent = None if kind else found.name
        apart = {} if kind == "application/pdf" else APART  # Chromium's viewer does not open in a sandbox
        return FileResponse(found, media_type=kind, filename=sent, headers=apart)


def _json(data: dict[str, Any], status: int = 200) -> Response:
    return Response(encode(data), status, media_type="application/json")
