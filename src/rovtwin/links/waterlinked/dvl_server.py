"""A DVL A50 that measures what a station's DVL measures."""

import asyncio
import math
import time
from collections.abc import Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rovtwin.core.arrays.rotations import turn_about_z
from rovtwin.core.errors import LinkError
from rovtwin.core.flow import Measurement
from rovtwin.links.clock import Due
from rovtwin.links.servers.served_vehicle import ServedVehicle
from rovtwin.links.servers.server import Server
from rovtwin.links.servers.tcp_server import MOST_CLIENTS, Client, TcpServer, open_tcp_server
from rovtwin.links.waterlinked.dvl_pages import DvlPages
from rovtwin.links.waterlinked.dvl_wire import (
    CONFIG,
    NO_ALTITUDE,
    Order,
    PositionReport,
    Report,
    Response,
    VelocityReport,
    beams,
    checked_config,
    figure_of_merit,
    parse_order,
    report_line,
    split_orders,
)
from rovtwin.links.waterlinked.reckoning import Reckoning
from rovtwin.links.waterlinked.web import serving_pages

PORT = 16171
WEB_PORT = 8171  # of the pages; the DVL itself has 80, which takes root to bind
POSITION_PERIOD = 0.2  # of dead reckoning [s]: 5 Hz
INVALID_PERIOD = 0.25  # of reports without bottom lock [s]; the DVL's own range of rates is 2 to 15 Hz
STALE = 0.5  # no reading for so long: bottom lock is lost [s]
MOST_PINGS = 15  # that can wait when pings are triggered
LONGEST_LINE = 4096  # of a command [bytes]


@dataclass
class DvlServer(Server):
    """Speaks for a DVL A50 on TCP, for several clients at a time.

    Velocities come as the station's `dvl` comes. Altitude is that of `altimeter`, else `floor` less `pressure`, else
    -1, the vendor's word for none: an invented one would be flown by. Dead reckoning integrates `dvl` along `attitude`
    (level and north without).

    Args:
        host: Address to bind.
        port: TCP port; 16171 is the DVL's own.
        noise: Standard deviation of the velocity's components, which covariance and figure of merit tell [m/s]. The
            default is the vendor's 0.1 cm/s of long-term accuracy, five times over for a single ping across.
        floor: Depth of the floor in n [m], for a vehicle without altimeter.
        epoch: What the DVL's clock shows at the vehicle's time 0 [s since 1970]; None: as this machine's clock when it
            starts. It runs with the vehicle's time, which may be faster than real.
        water_speed_of_sound: True speed of sound [m/s]: a client that sets another one gets velocities that are wrong
            by the ratio, as with the real DVL.
        web_port: TCP port of its pages (`dvl_pages`); None: there are none. Where it is taken the DVL speaks without.
    """

    host: str = "127.0.0.1"
    port: int = PORT
    noise: tuple[float, float, float] = (0.005, 0.005, 0.001)
    floor: float | None = None
    epoch: float | None = None
    water_speed_of_sound: float = 1475.0
    most_clients: int = MOST_CLIENTS
    web_port: int | None = None

    @property
    def addresses(self) -> list[str]:
        return [self.host]

    async def run(self, station: ServedVehicle) -> None:
        dvl = _Dvl(self, station)

        async def serve(client: Client) -> None:
            rest = b""
            while (piece := await client.reader.read(LONGEST_LINE)) and not client.gone:
                orders, rest = split_orders(rest + piece)
                for order in orders:
                    client.send(report_line(dvl.answer(order)))
                if len(rest) > LONGEST_LINE:
                    raise LinkError("line too long")

        where = (self.host, self.port)
        async with (
            open_tcp_server("dvl", *where, serve, station.say, LONGEST_LINE, self.most_clients) as people,
            AsyncExitStack() as stack,
        ):
            station.say(f"dvl: speaks at {self.host}:{self.port}")
            dvl.people = people
            await self._show_pages(dvl, stack)
            watch = asyncio.create_task(dvl.watch())
            try:
                async for batch in station.readings():
                    dvl.receive(batch)
            finally:
                watch.cancel()

    async def _show_pages(self, dvl: "_Dvl", stack: AsyncExitStack) -> None:
        """Its pages as long as the stack lasts: a port that is taken costs the pages, and no velocity."""
        if self.web_port is None:
            return
        pages = DvlPages(self.port, lambda: dvl.config, lambda: dvl.listeners, lambda: dvl.epoch + dvl.station.now)
        try:
            await stack.enter_async_context(serving_pages("dvl", self.host, self.web_port, pages))
        except LinkError as error:
            dvl.station.say(f"dvl: no pages over HTTP, which BlueOS' extension asks for: {error}")
        else:
            dvl.station.say(f"dvl: pages at http://{self.host}:{self.web_port}/api/v1/about")


class _Dvl:
    """The instrument: what it was sent, and what it last saw."""

    def __init__(self, options: DvlServer, station: ServedVehicle):
        self.options, self.station = options, station
        self.people: TcpServer | None = None
        self.config: dict[str, Any] = dict(CONFIG)
        self.epoch = time.time() - station.now if options.epoch is None else options.epoch
        self.pings = 0
        self.reckoning = Reckoning()
        self.malformed = 0
        self._last_report = self._last_valid = -math.inf
        self._position_due = Due(POSITION_PERIOD)
        self._batches = 0
        self._warned_of_none = False
        self._commands: dict[str, Callable[[Order], Any]] = {
            "get_config": lambda order: dict(self.config),
            "set_config": self._set_config,
            "reset_dead_reckoning": lambda order: self.reckoning.reset(),
            "calibrate_gyro": lambda order: None,  # the twin's gyro is calibrated; the real one takes up to 15 s
            "trigger_ping": self._trigger,
        }

    @property
    def listeners(self) -> int:
        """How many are connected now."""
        return 0 if self.people is None else len(self.people.clients)

    # What clients ask.

    def answer(self, line: bytes) -> Response:
        """To a line from a client."""
        try:
            order = parse_order(line)
        except LinkError as error:
            self.malformed += 1
            return Response("", False, str(error))
        name = order.command[:40]
        if order.command not in self._commands:
            self.malformed += 1
            return Response(name, False, f"no such command; expected one of {', '.join(self._commands)}")
        try:
            return Response(name, True, "", self._commands[order.command](order))
        except LinkError as error:
            return Response(name, False, str(error))

    def _set_config(self, order: Order) -> None:
        self.config = checked_config(self.config, order.parameters)

    def _trigger(self, order: Order) -> None:
        if self.pings >= MOST_PINGS:
            raise LinkError(f"{MOST_PINGS} pings wait already")
        self.pings += 0 if self.config["acoustic_enabled"] else 1

    # What the vehicle measures.

    def receive(self, batch: list[Measurement]) -> None:
        """Readings as they come, and what is due by now."""
        self._batches += 1
        if self.station.now < self._last_report:  # the vehicle's time starts anew
            self._last_report = self._last_valid = -math.inf
        for reading in batch:
            if reading.sensor == "attitude" and reading.value.shape == (3,):
                self.reckoning.turn(reading.value)
            elif reading.sensor == "dvl" and reading.value.shape == (3,) and np.isfinite(reading.value).all():
                self._measure(reading)
        now = self.station.now
        if now - self._last_valid > STALE and now - self._last_report >= INVALID_PERIOD - 1e-9:
            self._lost()
        if self._position_due(now):
            self._tell(self._position())

    async def watch(self) -> None:
        """A vehicle of which nothing is received any more has no bottom lock either (real time).

        Before anything is received nothing is reported: its time does not run yet, and stamps would be wrong.
        """
        while True:
            seen = self._batches
            await asyncio.sleep(STALE)
            if seen and seen == self._batches:
                self._lost()

    def _measure(self, reading: Measurement) -> None:
        if not self.config["acoustic_enabled"]:
            if self.pings == 0:
                return
            self.pings -= 1
        self._last_valid = reading.t_valid
        scale = self.config["speed_of_sound"] / self.options.water_speed_of_sound
        R = turn_about_z(math.radians(self.config["mounting_rotation_offset"]))
        body = scale * reading.value
        velocity = R @ body
        covariance = R @ np.diag(np.square(self.options.noise)) @ R.T
        altitude = self._altitude(reading.t_valid) * scale
        fom = figure_of_merit(covariance.tolist())
        self.reckoning.move(velocity, fom, reading.t_valid)
        self._report(
            VelocityReport(
                velocity=(float(velocity[0]), float(velocity[1]), float(velocity[2])),
                valid=True,
                altitude=altitude if altitude > 0 else NO_ALTITUDE,
                fom=fom,
                covariance=tuple(tuple(row) for row in covariance.tolist()),
                transducers=beams(body.tolist(), altitude, True),
            ),
            reading.t_valid,
        )

    def _lost(self) -> None:
        if self.config["acoustic_enabled"]:
            zero = ((0.0, 0.0, 0.0),) * 3
            nothing = beams((0.0, 0.0, 0.0), NO_ALTITUDE, False)
            self._report(VelocityReport((0.0, 0.0, 0.0), False, NO_ALTITUDE, 0.0, zero, nothing), self.station.now)

    def _altitude(self, t: float) -> float:
        """Distance to the floor [m], by the best that the station has; NO_ALTITUDE where there is no floor to see."""
        seen = self.station.latest.get("altimeter")
        if seen is not None:
            fresh = math.isfinite(seen.value[0]) and abs(t - seen.t_valid) <= 2.0
            return float(seen.value[0]) if fresh else NO_ALTITUDE
        depth = self.station.latest.get("pressure")
        if self.options.floor is not None and depth is not None:
            return self.options.floor - float(depth.value[0])
        if not self._warned_of_none:
            self._warned_of_none = True
            self.station.say(
                "dvl: no altimeter on board and no depth of the floor given: "
                "altitude is reported as -1, which means none"
            )
        return NO_ALTITUDE

    def _position(self) -> PositionReport:
        x, y, z = self.reckoning.position.tolist()
        roll, pitch, yaw = np.degrees(self.reckoning.attitude).tolist()
        return PositionReport(self.epoch + self.station.now, x, y, z, self.reckoning.std, roll, pitch, yaw)

    def _report(self, report: VelocityReport, t_valid: float) -> None:
        since = 0.0 if math.isinf(self._last_report) else max(0.0, t_valid - self._last_report)
        self._last_report = t_valid
        sent = max(self.station.now, t_valid)
        self._tell(
            replace(
                report,
                since_last=1e3 * since,
                time_of_validity=self._us(t_valid),
                time_of_transmission=self._us(sent),
            )
        )

    def _us(self, t: float) -> int:
        return round(1e6 * (self.epoch + t))

    def _tell(self, report: Report) -> None:
        if self.people is not None and self.people.clients:
            line = report_line(report)
            for client in list(self.people.clients):
                client.send(line)
