"""The web server: pages by NiceGUI, the live socket, files; on this machine alone unless set otherwise."""

import asyncio
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from fastapi import Response, WebSocket
from fastapi.responses import RedirectResponse, StreamingResponse
from nicegui import app, ui

from rovtwin.console.chart.maps import MapFile
from rovtwin.console.replays.replay import Recording
from rovtwin.console.replays.shelf import Shelf
from rovtwin.console.web.assessing import Assessing
from rovtwin.console.web.camera_stream import BOUNDARY, Stream, feed_of
from rovtwin.console.web.chart.layers import add_layers
from rovtwin.console.web.chart.plan_files import add_plan_files
from rovtwin.console.web.commissioning.attending import Commissioning
from rovtwin.console.web.commissioning.routes import add_commissioning
from rovtwin.console.web.gate import Gate, Guard
from rovtwin.console.web.hub import Hub
from rovtwin.console.web.mesh import vehicle_glb
from rovtwin.console.web.own_views import OwnViews
from rovtwin.console.web.page import page
from rovtwin.console.web.rehearsing import Rehearsing
from rovtwin.console.web.replays.routes import add_replay
from rovtwin.console.web.sockets import serve
from rovtwin.console.web.swath_layer import SwathLayer
from rovtwin.console.wire import Place
from rovtwin.core.errors import ConfigError, LinkError
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.scenario.schema import Scenario

STATIC = Path(__file__).parent / "static"
LARGEST = 250_000  # message of a browser [bytes]: a file of MOST_UPLOAD bytes, as JSON has it
BACKLOG = 8  # connections that are let in between two looks at those there are: each takes a millisecond or two
SWITCH = 1e-3  # until another thread may go on; by default five times as long, as often as there are threads [s]


def build(
    place: Place,
    gate: Gate,
    scenario: Scenario,
    runs: Path,
    is_twin: bool,
    camera: str | None = None,
    views: Sequence[str] = (),
    link: str = "twin://",
    sensors: Sequence[str] = (),
    maps: Sequence[MapFile] = (),
) -> Hub:
    """The pages and sockets of a console on the engine at a place, which flies a scenario's vehicle.

    Args:
        place: Of the engine.
        gate: Who may come in.
        scenario: What it flies.
        runs: Folder of finished runs, which can be replayed.
        is_twin: Whether the vehicle is computed.
        camera: Address of the vehicle's camera stream, if it has one.
        views: Addresses or entry points of views of one's own.
        link: URL of the vehicle.
        sensors: URLs of instruments beside it.
        maps: Under the chart.
    """
    hub, vehicle = Hub(place, scenario), vehicle_of(scenario)
    own, swath = OwnViews(hub, views), SwathLayer(hub, scenario)
    try:
        stream = Stream(feed_of(scenario, vehicle, is_twin, place.news, camera), "", hub.send, hub.keep)
    except ConfigError as error:
        stream = Stream(None, str(error), hub.send, hub.keep)
    looks = vehicle_glb(vehicle)
    open_to(gate)
    add_replay(shelf := Shelf(runs), stop=hub.client.stop)
    add_layers(hub, scenario, shelf, maps)
    add_plan_files(hub, scenario)
    add_commissioning(Commissioning(hub, place, runs), runs, _asked_for(scenario, link, sensors))

    @app.websocket("/live")
    async def live(socket: WebSocket) -> None:
        await serve(hub, socket)

    @app.post("/stop")
    async def stop() -> dict[str, Any]:
        try:
            return {"ok": True, "confirmed": await hub.client.stop()}
        except LinkError as error:
            return {"ok": False, "error": str(error)}

    @app.get("/attended")
    def attended() -> dict[str, Any]:
        return hub.attended()

    @app.get("/camera.mjpg")
    async def picture() -> Response:
        if stream.rests:
            return Response(status_code=204)  # the page shows why, and no error in the browser
        return StreamingResponse(stream.parts(), media_type=f"multipart/x-mixed-replace; boundary={BOUNDARY}")

    @app.get("/mesh/vehicle.glb")
    def mesh() -> Response:
        return Response(looks, media_type="model/gltf-binary") if looks else Response("it has no looks", 404)

    @ui.page("/", title="rovtwin")
    def index() -> None:
        page(is_test=scenario.test is not None, own=own.names)

    tasks: list[asyncio.Task[None]] = []
    app.on_startup(lambda: tasks.append(asyncio.create_task(hub.run())))
    app.on_startup(lambda: tasks.append(asyncio.create_task(own.run())))
    app.on_startup(lambda: tasks.append(asyncio.create_task(swath.run())))
    if scenario.test is None:
        rehearsing = Rehearsing(hub, scenario, is_twin)
        app.on_startup(lambda: tasks.append(asyncio.create_task(rehearsing.run())))
    else:
        assessing = Assessing(hub, scenario, vehicle)
        app.on_startup(lambda: tasks.append(asyncio.create_task(assessing.run())))
    app.on_startup(lambda: _when_ended(hub.client.off))
    app.on_shutdown(lambda: [task.cancel() for task in tasks])
    return hub


def _asked_for(scenario: Scenario, link: str, sensors: Sequence[str]) -> dict[str, Any]:
    """What the form of a new commissioning begins with: the vehicle, link and tank of this session."""
    tank = scenario.world.tank
    named = scenario.vehicle if isinstance(scenario.vehicle, str) else ""
    sizes = None if tank is None else [abs(side[1] - side[0]) for side in (tank.north, tank.east)]
    floor = getattr(scenario.world, "floor", None)
    return {"vehicle": named, "link": link, "sensors": list(sensors), "sides": sizes, "depth": floor}


def build_replay(recording: Recording, gate: Gate, runs: Path) -> None:
    """The pages and sockets of a console that flies nothing: a recording, and the runs of a folder."""
    open_to(gate)
    add_replay(Shelf(runs), recording)

    @app.get("/")
    def index() -> Response:
        return RedirectResponse("/replay")


def _when_ended(first: Callable[[], object]) -> None:
    """Do something at Ctrl-C before all else: the server waits for its pages, up to a second."""
    for number in (signal.SIGINT, signal.SIGTERM):
        before = signal.getsignal(number)
        if callable(before):
            signal.signal(number, lambda n, frame, before=before: (first(), before(n, frame)))


def open_to(gate: Gate) -> None:
    """What all servers have: the files of the pages, and the gate before everything."""
    app.add_static_files("/static", STATIC, max_cache_age=0)
    app.add_middleware(Guard, gate=gate)


def run(host: str, port: int) -> None:
    """Serve until Ctrl-C."""
    sys.setswitchinterval(SWITCH)
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
        backlog=BACKLOG,
        ws_max_size=LARGEST,
        ws_per_message_deflate=False,  # twenty states a second to every page: packing them takes longer than sending
        timeout_graceful_shutdown=1,  # or Ctrl-C would wait for pages that are open, whose pictures never end
    )
