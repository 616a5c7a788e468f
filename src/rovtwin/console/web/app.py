"""The web server: pages by NiceGUI, the live socket, files; on this machine alone unless it is told otherwise."""

import asyncio
import secrets
from pathlib import Path
from typing import Any

from fastapi import Request, Response, WebSocket, WebSocketDisconnect
from fastapi.responses import StreamingResponse
from nicegui import app, ui

from rovtwin.console.web.assessing import Assessing
from rovtwin.console.web.camera_stream import BOUNDARY, Stream
from rovtwin.console.web.hub import Browser, Hub
from rovtwin.console.web.mesh import vehicle_glb
from rovtwin.console.web.page import page
from rovtwin.console.wire import Place
from rovtwin.scenario.composition import vehicle_of
from rovtwin.scenario.schema import Scenario

STATIC = Path(__file__).parent / "static"
LOOPBACK = ("127.0.0.1", "localhost", "::1")
COOKIE = "rovtwin_token"
LARGEST = 2_000_000  # message of a browser [bytes]


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
        return secrets.compare_digest(given, self.token)


def build(place: Place, gate: Gate, scenario: Scenario) -> Hub:
    """The pages and sockets of a console on the engine at a place, which flies a scenario's vehicle."""
    hub, vehicle = Hub(place), vehicle_of(scenario)
    stream = Stream(scenario, vehicle, place.news, hub.send)
    looks = vehicle_glb(vehicle)
    app.add_static_files("/static", STATIC, max_cache_age=0)

    @app.middleware("http")
    async def guard(request: Request, go_on: Any) -> Response:
        if not gate.admits(request.headers, request.cookies, request.query_params):
            return Response("rovtwin console: open the address with its ?token=... as the terminal shows it", 403)
        response = await go_on(request)
        if gate.token is not None and request.query_params.get("token"):
            response.set_cookie(COOKIE, gate.token, httponly=True, samesite="strict")
        return response

    @app.websocket("/live")
    async def live(socket: WebSocket) -> None:
        if not gate.admits(socket.headers, socket.cookies, socket.query_params):
            await socket.close(1008)
            return
        await socket.accept()
        await _serve(hub, socket, _name(socket.query_params.get("name", "")))

    @app.post("/stop")
    async def stop() -> dict[str, bool]:
        return {"heard": hub.client.stop()}

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
        page(is_test=scenario.test is not None)

    tasks: list[asyncio.Task[None]] = []
    app.on_startup(lambda: tasks.append(asyncio.create_task(hub.run())))
    if scenario.test is not None:
        assessing = Assessing(hub, scenario, vehicle)
        app.on_startup(lambda: tasks.append(asyncio.create_task(assessing.run())))
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
    browser = hub.come(name)
    try:
        await asyncio.gather(_send(socket, browser), _receive(hub, socket, browser))
    except (WebSocketDisconnect, RuntimeError):
        pass  # the page was closed
    finally:
        hub.leave(browser)


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
