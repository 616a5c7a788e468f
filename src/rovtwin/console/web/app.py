"""The web server: pages by NiceGUI, the live socket, files; on this machine alone unless it is told otherwise."""

import asyncio
import contextlib
import logging
import secrets
from pathlib import Path
from typing import Any

from fastapi import Response, WebSocket, WebSocketDisconnect
from fastapi.responses import StreamingResponse
from nicegui import app, ui

from rovtwin.console.web.browser import Browser
from rovtwin.console.web.camera_stream import BOUNDARY, Stream
from rovtwin.console.web.gate import Gate, Guard
from rovtwin.console.web.hub import Hub
from rovtwin.console.web.mesh import vehicle_glb
from rovtwin.console.web.page import page
from rovtwin.console.wire import Place
from rovtwin.core.errors import LinkError
from rovtwin.scenario.composition import vehicle_of
from rovtwin.scenario.schema import Scenario

logger = logging.getLogger(__name__)

STATIC = Path(__file__).parent / "static"
LARGEST = 2_000_000  # message of a browser [bytes]
CLOSING = 1.0  # longest wait for a page to be closed [s]


def build(place: Place, gate: Gate, scenario: Scenario) -> Hub:
    """The pages and sockets of a console on the engine at a place, which flies a scenario's vehicle."""
    hub, vehicle = Hub(place), vehicle_of(scenario)
    stream = Stream(scenario, vehicle, place.news, hub.send)
    looks = vehicle_glb(vehicle)
    app.add_static_files("/static", STATIC, max_cache_age=0)

    app.add_middleware(Guard, gate=gate)

    @app.websocket("/live")
    async def live(socket: WebSocket) -> None:
        await socket.accept()
        await _serve(hub, socket, _name(socket.query_params.get("name", "")))

    @app.post("/stop")
    async def stop() -> dict[str, Any]:
        try:
            return {"ok": True, "heard": await hub.client.stop()}
        except LinkError as error:
            return {"ok": False, "error": str(error)}

    @app.get("/camera.mjpg")
    async def camera() -> Response:
        if stream.why_not:
            return Response(stream.why_not, 404)
        return StreamingResponse(stream.parts(), media_type=f"multipart/x-mixed-replace; boundary={BOUNDARY}")

    @app.get("/mesh/vehicle.glb")
    def mesh() -> Response:
        return Response(looks, media_type="model/gltf-binary") if looks else Response("it has no looks", 404)

    @app.get("/plan.yaml")
    def plan() -> Response:
        headers = {"Content-Disposition": 'attachment; filename="mission.yaml"'}
        return Response(hub.draft.as_yaml(), media_type="application/yaml", headers=headers)

    @ui.page("/", title="rovtwin")
    def index() -> None:
        page()

    tasks: list[asyncio.Task[None]] = []
    app.on_startup(lambda: tasks.append(asyncio.create_task(hub.run())))
    app.on_shutdown(lambda: [task.cancel() for task in tasks])
    return hub


def run(host: str, port: int) -> None:
    """Serve until Ctrl-C."""
    ui.run(
        host=host,
        port=port,
        title="rovtwin",
        reload=False,
        show=False,
        show_welcome_message=False,
        favicon=STATIC / "icon.svg",
        tailwind=False,
        uvicorn_logging_level="error",
        ws_max_size=LARGEST,
    )


def _name(wished: str) -> str:
    """A browser's name for itself, if it is one."""
    return wished if wished.isalnum() and len(wished) <= 12 else f"b{secrets.token_hex(2)}"


async def _serve(hub: Hub, socket: WebSocket, name: str) -> None:
    """Until the page is closed, or takes nothing any more."""
    browser = hub.come(name)
    work = (_send(socket, browser), _receive(hub, socket, browser), browser.given_up())
    tasks = [asyncio.create_task(one) for one in work]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        hub.leave(browser)
        for task in tasks:
            task.cancel()
        for ended in await asyncio.gather(*tasks, return_exceptions=True):
            if isinstance(ended, Exception) and not isinstance(ended, WebSocketDisconnect | RuntimeError):
                logger.error("page %s: %s: %s", browser.name, type(ended).__name__, ended)
    with contextlib.suppress(RuntimeError, TimeoutError):  # of a page that is closed, or does not listen
        await asyncio.wait_for(socket.close(1013), CLOSING)


async def _send(socket: WebSocket, browser: Browser) -> None:
    while True:
        await socket.send_text(await browser.next())


async def _receive(hub: Hub, socket: WebSocket, browser: Browser) -> None:
    obeying: set[asyncio.Task[None]] = set()
    while True:
        text = await socket.receive_text()
        # STOP must not wait behind a plan that is being laid out.
        task = asyncio.create_task(hub.obey(browser, text))
        obeying.add(task)
        task.add_done_callback(obeying.discard)
