"""Listening to an Underwater GPS G2, real or served."""

import math
import socket
import time
from collections.abc import Callable
from typing import Any

from rovtwin.core.datum import FARTHEST, Datum
from rovtwin.core.errors import LinkError
from rovtwin.links.background import BackgroundSource
from rovtwin.links.http_wire import LONGEST_BODY, Response, parse_response, request_bytes
from rovtwin.links.waterlinked import ugps_wire as wire
from rovtwin.links.waterlinked.ugps_wire import AcousticPosition

PORT = 80
PATIENCE = 2.0  # for one whole request [s]
DEPTH_LIFE = 2.0  # a depth older than this is not sent any more [s]


class UgpsSource(BackgroundSource):
    """Readings `position`: north and east in n [m], shape (2,), of the locator on the vehicle.

    The kit stamps nothing and counts nothing. A fix is new when anything in the answer differs from the last: distances
    and signal strengths are measured anew for each, so that even a vehicle at rest gives other numbers. Its time is the
    middle of the request less `latency`; the kit renews it at 4 Hz, so that it is up to 1/4 s older than that, plus
    1 / `rate`. Ask at 10 Hz for fresher ones.

    Args:
        host: The kit's address; 192.168.2.94 as it comes from the factory.
        port: Its TCP port.
        clock: Our clock [s].
        topside: Pose of the topside unit in n: north, east [m], heading of its forward mark [rad].
        datum: Where n is on the map. When given, `topside` does not count: place and heading come from the kit
            (/position/master), for a topside unit that moves.
        rate: Requests a second [Hz].
        latency: From the sound to what the kit shows [s], where known.
        raw: Positions before the kit's own filter: for an autopilot that filters itself.

    Raises:
        LinkError: There is no such port, or a rate that is none.
    """

    def __init__(
        self,
        host: str,
        port: int = PORT,
        clock: Callable[[], float] = time.monotonic,
        topside: tuple[float, float, float] = (0.0, 0.0, 0.0),
        datum: Datum | None = None,
        rate: float = 4.0,
        latency: float = 0.0,
        raw: bool = False,
    ):
        self.provides = frozenset({"position"})
        super().__init__(f"ugps://{host}:{port}", port, clock)
        if not 0.0 < rate <= 100.0:
            raise LinkError(f"{self.where}: rate {rate:g} Hz: expected more than 0 and at most 100")
        self._address = (host, port)
        self._topside, self._datum = topside, datum
        self._period, self._latency = 1.0 / rate, latency
        self._path = wire.RAW if raw else wire.FILTERED
        self._seen: AcousticPosition | None = None
        self._depth: tuple[float, float, float] | None = None
        self._thread.start()

    def tell_depth(self, depth: float, temperature: float = 10.0) -> None:
        """Our own depth [m] and the water's temperature [deg C] for the kit, which has no fix without when its locator
        is an A1. Sent with the next request; returns at once.
        """
        if math.isfinite(depth) and math.isfinite(temperature):
            self._depth = (depth, temperature, time.monotonic())

    def _visit(self) -> None:
        while not self._closed.is_set():
            start = time.monotonic()
            self._ask_once()
            self._closed.wait(max(0.0, start + self._period - time.monotonic()))

    def _ask_once(self) -> None:
        """One round: our depth goes, a position comes. What is no answer is dropped; OSError when nobody is there."""
        try:
            depth = self._depth
            if depth is not None and time.monotonic() - depth[2] <= DEPTH_LIFE:
                self._ask("PUT", wire.DEPTH, {"depth": depth[0], "temp": depth[1]})
            before = self.clock()
            answer = self._ask("GET", self._path)
            t_valid = 0.5 * (before + self.clock()) - self._latency
            if answer.status != 200:
                raise LinkError(f"answers with status {answer.status}")
            fix = wire.parse_acoustic(answer.body)
            if fix != self._seen:
                self._seen = fix
                if fix.position_valid:
                    self._keep("position", self._place(fix), t_valid)
            self._reached()
        except LinkError as error:
            if not self._closed.is_set():
                self.dropped += 1
                self.status = f"{self.where}: {error}"

    def _place(self, fix: AcousticPosition) -> tuple[float, float]:
        north, east, heading = self._topside
        if self._datum is not None:
            answer = self._ask("GET", wire.MASTER)
            master = wire.parse_map(answer.body)
            if master.orientation < 0.0:
                raise LinkError("does not know its own heading")
            north, east, _ = self._datum.position(master.lat, master.lon, 0.0).tolist()
            heading = math.radians(master.orientation)
        dn, de = wire.from_topside((fix.x, fix.y), heading)
        if math.hypot(fix.x, fix.y) > FARTHEST or math.hypot(north, east) > FARTHEST:
            raise LinkError(f"a place farther than {FARTHEST:g} m: is the datum right?")
        return north + dn, east + de

    def _ask(self, method: str, path: str, body: Any = None) -> Response:
        """One request on a connection of its own; OSError or LinkError when there is no answer in time."""
        deadline = time.monotonic() + PATIENCE
        with socket.create_connection(self._address, timeout=PATIENCE) as connection:
            self._socket = connection
            if self._closed.is_set():
                raise LinkError("closed")
            connection.sendall(request_bytes(method, self._address[0], path, body))
            try:
                return _whole_answer(connection, deadline)
            except TimeoutError:
                raise LinkError(f"no whole answer within {PATIENCE:g} s") from None


def _whole_answer(connection: socket.socket, deadline: float) -> Response:
    """What comes until `deadline` [s, monotonic]; TimeoutError when that is not all."""
    data = b""
    while len(data) <= 2 * LONGEST_BODY:
        left = deadline - time.monotonic()
        if left <= 0.0:
            raise TimeoutError
        connection.settimeout(left)
        piece = connection.recv(16384)
        data += piece
        answer = parse_response(data, ended=not piece)
        if answer is not None:
            return answer
    raise LinkError("an endless answer")
