"""How long STOP takes in the console while its web server has much to do.

python -m benchmarks.stop                     # about ten minutes, with the autopilot's compilation
python -m benchmarks.stop --only idle import  # these loads

Pressed as the page presses it: over the page's socket and as a request of its own, both at once. Measured from then
until the first answer that thrusters are off, which the link's host gives once the vehicle has been sent zero. Presses
come at random times, so that none waits for another. Loads run in a process of their own.
"""

import argparse
import asyncio
import contextlib
import http.client
import itertools
import json
import multiprocessing
import os
import random
import socket
import tempfile
import threading
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np
from tests.console.whole import serving
from websockets.asyncio.client import connect as connect_async
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

CROWD = 500  # connections
AT_ONCE = 12  # imports and plans that are sent together
COMPILING = 300.0  # longest wait for the autopilot [s]
SETTLING = 3.0  # a load runs so long before STOP is pressed [s]
PAUSES = (0.02, 0.12)  # between two presses [s]
PATIENCE = 20.0  # with one press [s]
PLAN = '{"kind":"plan"'
ALIVE, LIVING = '{"do":"alive"}', 0.2  # what every page says all the time, and how often [s]


class Operator:
    """A page, without its looks: hears all there is, gives control to who asks for it, and presses STOP."""

    def __init__(self, port: int):
        self._port, self._answers, self._number = port, SimpleQueue(), 0
        self.state: dict[str, Any] = {}
        self._socket = connect(f"ws://127.0.0.1:{port}/live?name=operator", max_size=None, open_timeout=PATIENCE)
        self._presses: SimpleQueue[int] = SimpleQueue()
        for work in (self._listen, self._request, self._live):
            threading.Thread(target=work, daemon=True).start()

    def stop(self) -> float:
        """Press STOP; the time until the first answer that thrusters are off [s]."""
        self._number += 1
        began = time.perf_counter()
        self._presses.put(self._number)
        with contextlib.suppress(WebSocketException):  # the request is on its way all the same
            self._socket.send(json.dumps({"do": "stop", "id": self._number}))
        while True:
            number, at = self._answers.get(timeout=PATIENCE)
            if number == self._number:
                return at - began

    def close(self) -> None:
        self._presses.put(0)
        self._socket.close()

    def _listen(self) -> None:
        with contextlib.suppress(WebSocketException):
            for text in self._socket:
                if str(text).startswith(PLAN):  # which would only have to be painted
                    continue
                message = json.loads(text)
                if message["kind"] == "state":
                    self.state = message
                elif message["kind"] == "rights" and message["may"] and message["asked"]:
                    self._socket.send('{"do":"give"}')
                elif message["kind"] == "reply" and message["ok"] and message["id"] is not None:
                    self._answers.put((message["id"], time.perf_counter()))

    def _live(self) -> None:
        with contextlib.suppress(WebSocketException):
            while True:
                self._socket.send(ALIVE)
                time.sleep(LIVING)

    def _request(self) -> None:
        """STOP's second way. A browser keeps its connection, too."""
        server = http.client.HTTPConnection("127.0.0.1", self._port, timeout=PATIENCE)
        while number := self._presses.get():
            for _ in range(2):  # the server lets go of a connection that rests; a browser tries again, too
                try:
                    server.request("POST", "/stop")
                    if json.loads(server.getresponse().read())["ok"]:
                        self._answers.put((number, time.perf_counter()))
                    break
                except (OSError, http.client.HTTPException):
                    server.close()


# Loads, each until its process is ended; each says when it has begun.

Begun = Callable[[], None]
Load = Callable[[int, Begun], Coroutine[Any, Any, None]]


@asynccontextmanager
async def _page(port: int, name: str) -> AsyncIterator[Any]:
    """A page's socket."""
    async with connect_async(f"ws://127.0.0.1:{port}/live?name={name}", max_size=None, open_timeout=PATIENCE) as page:
        yield page


@asynccontextmanager
async def _in_control(port: int) -> AsyncIterator[Any]:
    """The socket of a page that may plan."""
    async with _page(port, "load") as page:
        await page.send(json.dumps({"do": "take", "id": 0}))
        async for text in page:
            message = json.loads(text)
            if message["kind"] == "rights" and message["may"]:
                break
        yield page


async def _receive(page: Any) -> None:
    async for _ in page:
        pass


async def _live(page: Any) -> None:
    while True:
        await page.send(ALIVE)
        await asyncio.sleep(LIVING)


def _mission(size: int) -> str:
    """A mission file of so many characters: way-points, and a comment that fills it up."""
    head = "name: large\nwaypoints:\n"
    point = "  - {position: [1.0, 2.0, 1.5], speed: 0.2, acceptance: 0.2, hold_time: 0.0}\n"
    text = head + point * ((size - len(head)) // len(point))
    return text + "#" * (size - len(text))


async def _orders(port: int, begun: Begun, order: dict[str, Any]) -> None:
    """The same order again and again, so many without an answer."""
    async with _in_control(port) as page:
        waiting = 0
        begun()
        while True:
            while waiting < AT_ONCE:
                await page.send(json.dumps(order | {"id": 1}))
                waiting += 1
            if json.loads(await page.recv())["kind"] == "reply":
                waiting -= 1


def _import(size: int) -> Load:
    order = {"do": "plan", "op": "import", "text": _mission(size)}
    return lambda port, begun: _orders(port, begun, order)


async def _planning(port: int, begun: Begun) -> None:
    area = [[0, 0], [60, 5], [70, 55], [30, 80], [-10, 50]]
    order = {"do": "plan", "op": "template", "name": "lawnmower", "area": area, "spacing": 0.5, "depth": 1.0}
    await _orders(port, begun, order)


async def _flood(port: int, begun: Begun) -> None:
    """Changes of a long plan, as fast as the server takes them."""
    async with _in_control(port) as page:
        text = "waypoints:\n" + "  - {position: [1.0, 2.0, 1.5]}\n" * 500
        await page.send(json.dumps({"do": "plan", "op": "import", "text": text, "id": "plan"}))
        while json.loads(await page.recv()).get("id") != "plan":
            pass
        begun()

        async def change() -> None:
            for i in itertools.count():
                await page.send(json.dumps({"do": "plan", "op": "edit", "i": i % 400, "x": float(i % 7), "id": i}))

        await asyncio.gather(change(), _receive(page))


async def _viewers(port: int, begun: Begun) -> None:
    """Pages that are open and hear all; those that are turned away try again as a page does."""

    async def one(i: int) -> None:
        while True:
            with contextlib.suppress(OSError, WebSocketException, TimeoutError):
                async with _page(port, f"v{i}") as page:
                    await asyncio.gather(_receive(page), _live(page))
            await asyncio.sleep(random.uniform(5.0, 10.0))

    viewing = [asyncio.create_task(one(i)) for i in range(CROWD)]
    await asyncio.sleep(SETTLING)
    begun()
    await asyncio.gather(*viewing)


async def _commissioning(port: int, begun: Begun) -> None:
    """A stage of a commissioning that computes, again and again, in a process of its own."""
    folder = f"load-{os.getpid()}-{time.monotonic_ns()}"
    asked = {"vehicle": "double_blueye", "link": "twin://", "tank": "6x3x1.5"}
    first = {"do": "commission", "op": "begin", "folder": folder, "request": asked, "id": "begin"}
    async with _in_control(port) as page:
        await page.send(json.dumps(first))
        async for text in page:
            message = json.loads(text)
            over = message["kind"] == "commission" and message["now"] is None and message["ended"] is not None
            if message["kind"] == "commission" and message["now"] is not None:
                begun()
            elif over or (message["kind"] == "reply" and message["id"] == "begin"):
                again = {"do": "commission", "op": "start", "folder": folder, "stage": "paper", "id": "start"}
                await page.send(json.dumps(again))


async def _mute(port: int, begun: Begun) -> None:
    """Connections that say nothing, and pages that read nothing."""
    silent = [socket.create_connection(("127.0.0.1", port)) for _ in range(2 * CROWD)]
    for i, page in enumerate(silent[CROWD:]):
        page.sendall(
            f"GET /live?name=m{i} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
        )
    begun()
    await asyncio.sleep(3600.0)


async def _idle(port: int, begun: Begun) -> None:
    begun()
    await asyncio.sleep(3600.0)


LOADS: dict[str, tuple[str, Load]] = {
    "idle": ("idle", _idle),
    "large": (f"{AT_ONCE} imports of 0.8 MB without an answer at any time", _import(800_000)),
    "import": (f"{AT_ONCE} imports of 99 kB", _import(99_000)),
    "planning": (f"{AT_ONCE} lawn-mowers of 0.5 m spacing", _planning),
    "flood": ("changes of a plan of 500 way-points, as fast as they are taken", _flood),
    "crowd": (f"{CROWD} pages", _viewers),
    "commission": ("a stage of a commissioning that computes, again and again", _commissioning),
    "mute": (f"{CROWD} silent connections and {CROWD} pages that read nothing", _mute),
}


def _run(name: str, port: int, begun: Any) -> None:
    """What the process of a load runs; a server that closes the connection is asked for another one."""

    async def again() -> None:
        while True:
            with contextlib.suppress(OSError, WebSocketException, TimeoutError):
                await LOADS[name][1](port, begun.set)

    asyncio.run(again())


def measure(name: str, port: int, presses: int) -> dict[str, Any]:
    """STOP under one load: times [ms] and the machine's load."""
    context = multiprocessing.get_context("spawn")
    begun = context.Event()
    operator = Operator(port)
    loading = context.Process(target=_run, args=(name, port, begun), daemon=True)
    loading.start()
    rng, times, missed = random.Random(1), [], 0
    try:
        if not begun.wait(COMPILING):
            raise RuntimeError(f"{name}: the load did not begin")
        time.sleep(SETTLING)
        for _ in range(presses):
            time.sleep(rng.uniform(*PAUSES))
            try:
                times.append(1e3 * operator.stop())
            except Empty:
                missed += 1
        alive = loading.is_alive()
        with contextlib.suppress(Exception):
            operator.close()
    finally:
        loading.kill()
        loading.join()
    if not alive:
        raise RuntimeError(f"{name}: the load ended before the measurement did")
    found = {f"p{p}": round(float(np.percentile(times, p)), 1) for p in (50, 99, 100)}
    return found | {"presses": presses, "missed": missed, "load": round(os.getloadavg()[0], 1)}


def _ready(port: int) -> None:
    """Wait until the vehicle is connected."""
    until = time.monotonic() + COMPILING
    operator = None
    while time.monotonic() < until:
        with contextlib.suppress(OSError, WebSocketException):
            operator = operator or Operator(port)
            if operator.state.get("stage") == "ready":
                operator.close()
                return
        time.sleep(0.2)
    raise TimeoutError(f"no vehicle within {COMPILING:g} s")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=LOADS, default=list(LOADS), help="these loads (default: all)")
    parser.add_argument("--presses", type=int, default=300, help="of STOP under each load")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, serving(Path(folder), "lawnmower_calm") as served:
        _ready(served.port)
        print("| load | median [ms] | 99 % | longest | without an answer | load of the machine |")
        print("|---|---|---|---|---|---|")
        for name in options.only:
            one = measure(name, served.port, options.presses)
            figures = [one["p50"], one["p99"], one["p100"], one["missed"], one["load"]]
            print(f"| {LOADS[name][0]} | {' | '.join(str(figure) for figure in figures)} |", flush=True)
            time.sleep(SETTLING)


if __name__ == "__main__":
    main()
