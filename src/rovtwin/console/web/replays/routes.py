"""Addresses of replays: the page, its live socket, and what it fetches once."""

import asyncio
from collections.abc import Callable

from fastapi import Response, WebSocket
from nicegui import app, ui

from rovtwin.console.replays.replay import Recording
from rovtwin.console.replays.shelf import Shelf
from rovtwin.console.web.replays.page import refused, replay_page
from rovtwin.console.web.replays.replaying import Library, Replaying, Stop
from rovtwin.console.web.sockets import serve
from rovtwin.console.worker import Worker
from rovtwin.core.errors import RovtwinError
from rovtwin.core.log import Log

OPENING = 60.0  # longest wait for a run [s]


def add_replay(shelf: Shelf, given: Recording | None = None, stop: Stop | None = None) -> None:
    """Serve replays of a shelf's runs, and of the one that is given; `stop` stops what flies beside."""
    reader = Worker("reading the log")
    library = Library(shelf, lambda path: reader.call(Log.read, path), given, stop)
    app.on_shutdown(reader.close)

    @ui.page("/replay", title="rovtwin replay", response_timeout=OPENING)
    async def page(run: str = "") -> None:
        try:
            replaying = await library.open(run)
        except RovtwinError as error:
            refused(str(error))
        else:
            replay_page(replaying.recording, run, library.flies)

    @app.websocket("/replay/live")
    async def live(socket: WebSocket) -> None:
        try:
            replaying = await library.open(socket.query_params.get("run", ""))
        except RovtwinError:
            await socket.close(1008)  # its page says why
            return
        await serve(replaying, socket)

    @app.get("/replay/runs")
    async def runs() -> dict[str, object]:
        await asyncio.to_thread(reader.warm)  # somebody is about to choose a log
        return {"folder": str(shelf.folder), "runs": await asyncio.to_thread(shelf.runs)}

    @app.get("/replay/history")
    async def history(run: str = "") -> Response:
        return await _answered(library, run, lambda one: one.history, "application/octet-stream")

    @app.get("/replay/swath")
    async def swath(run: str = "") -> Response:
        return await _answered(library, run, lambda one: one.swath, "application/json")

    @app.get("/replay/picture")
    async def picture(n: int, run: str = "") -> Response:
        def taken(one: Replaying) -> bytes | None:
            return None if one.recording.album is None else one.recording.album.picture(n)

        return await _answered(library, run, taken, "image/jpeg")

    @app.get("/replay/vehicle.glb")
    async def looks(run: str = "") -> Response:
        return await _answered(library, run, lambda one: one.looks, "model/gltf-binary")


async def _answered(library: Library, run: str, find: Callable[[Replaying], bytes | None], kind: str) -> Response:
    """What a run has, found in a thread of its own: flying goes on meanwhile."""
    try:
        found = await asyncio.to_thread(find, await library.open(run))
    except RovtwinError as error:
        return Response(str(error), 404)
    return Response("the run has none", 404) if found is None else Response(found, media_type=kind)
