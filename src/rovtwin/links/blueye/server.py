"""A twin that the vendor's own client takes for a Blueye drone, or for two: protocol v3, apart from the physics."""

import asyncio
import math
import time
from collections.abc import Mapping, Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass, field, replace
from typing import Any

from rovtwin.core.datum import Datum
from rovtwin.core.errors import LinkError
from rovtwin.links.blueye.drone.divelog import DiveLog
from rovtwin.links.blueye.drone.drone import FASTEST, About, Drone
from rovtwin.links.blueye.drone.telemetry import Telemetry
from rovtwin.links.blueye.mission.notes import INFO
from rovtwin.links.blueye.protobuf import PACKAGE
from rovtwin.links.blueye.services.answers import answer
from rovtwin.links.blueye.services.http import HttpServer
from rovtwin.links.blueye.services.sockets import listen, peer_of, ports_of, received
from rovtwin.links.blueye.wire import Ignored, Watchdog, parse_control
from rovtwin.links.servers.pilot_command import PilotCommand
from rovtwin.links.servers.served_vehicle import ServedVehicle
from rovtwin.links.servers.server import Server

FIRST = 2  # of 127.0.0.x, which the drones get unless set otherwise
REPEAT = 0.05  # a command is repeated so often while the pilot lives [s]
AT_MOST = 0.01  # and not more often than this, whatever a client sends [s]


@dataclass
class BlueyeServer(Server):
    """Serves each drone of a station at an address of its own, for the ports are fixed.

    Attributes:
        hosts: Address of each drone, in the order of ServedVehicle.drones or by name; default 127.0.0.2, 127.0.0.3, ..
        http_port: 80 for the SDK, which needs root; or another and a client with `http_proxy=http://<address>:<port>`.
        watchdog_s: Time without the pilot's watchdog after which the thrusters are off [s]; the SDK feeds it at 1 Hz.
        about: What a drone says of itself.
        fastest: Rates ahead, to starboard and down that full sticks ask of what is held [m/s].
        reaches: Steady speeds ahead and down at the largest force [m/s]: a mission that asks for more gets a warning.
        datum: Where n is on the map, for way-points and the position estimate; None: neither.
    """

    hosts: Sequence[str] | Mapping[str, str] = ()
    http_port: int = 80
    watchdog_s: float = 2.0
    about: About = field(default_factory=About)
    fastest: tuple[float, float, float] = FASTEST
    datum: Datum | None = None
    reaches: tuple[float, float] = (math.inf, math.inf)

    @property
    def addresses(self) -> list[str]:
        hosts = list(self.hosts.values()) if isinstance(self.hosts, Mapping) else list(self.hosts)
        return hosts or ["127.0.0.2"]

    def placed(self, drones: Sequence[str]) -> dict[str, str]:
        """Address of each drone.

        Raises:
            LinkError: There are not as many addresses as drones, or two are the same.
        """
        if isinstance(self.hosts, Mapping):
            hosts = [self.hosts.get(drone, "") for drone in drones]
        else:
            hosts = list(self.hosts) or [f"127.0.0.{FIRST + i}" for i in range(len(drones))]
        if len(hosts) != len(drones) or len(set(hosts)) != len(hosts) or "" in hosts:
            raise LinkError(
                f"blueye: found the addresses {', '.join(hosts) or 'none'} for {len(drones)} drones, expected a "
                f"different one for each ({', '.join(drones) or 'the drone'}): all ports of a drone are fixed"
            )
        return dict(zip(drones, hosts, strict=True))

    async def run(self, station: ServedVehicle) -> None:
        placed = self.placed(station.drones)
        several = len(placed) > 1
        drones = {
            name: Drone(name, self._about(name) if several else self.about, self.watchdog_s, self.fastest, self.reaches)
            for name in station.drones
        }
        infos = {host: _info(drones[name].about) for name, host in placed.items()}
        logs = {host: _log(drones[name].about) for name, host in placed.items()}
        async with AsyncExitStack() as stack:
            for host in placed.values():
                http = HttpServer(infos, host, logs)
                stack.push_async_callback(http.close)
                await listen(http, host, self.http_port)
            ports = [await stack.enter_async_context(ports_of(host)) for host in placed.values()]
            station.say(f"blueye: {', '.join(f'{name} {host}'.strip() for name, host in placed.items())}{self._hint()}")
            made = zip(drones.values(), ports, logs.values(), strict=True)
            served = [Served(drone, station, self.datum, log, *port) for drone, port, log in made]
            try:
                async with asyncio.TaskGroup() as tasks:
                    for one in served:
                        for loop in (one.receive_requests, one.receive_control, one.keep_wishing, one.publish):
                            tasks.create_task(loop())
            finally:
                for one in served:
                    one.disarm()

    def _about(self, name: str) -> About:
        return replace(self.about, serial=f"{self.about.serial}-{name}", hardware=f"{self.about.hardware}-{name}")

    def _hint(self) -> str:
        if self.http_port == 80:
            return ""
        return f"; set http_proxy=http://{self.addresses[0]}:{self.http_port} for the client, which knows port 80 only"


def _info(about: About) -> dict[str, str]:
    info = {"sw_version": about.software, "serial_number": about.serial, "hardware_id": about.hardware}
    return info | {"features": about.features}


def _log(about: About) -> DiveLog:
    return DiveLog(about.serial, about.hardware, about.software)


class Served:
    """A drone at its sockets."""

    def __init__(
        self,
        drone: Drone,
        station: ServedVehicle,
        datum: Datum | None,
        log: DiveLog,
        telemetry: Any,
        requests: Any,
        control: Any,
    ):
        self.drone, self._station, self._log = drone, station, log
        self._telemetry = Telemetry(drone, datum, station.say)
        self._alone = len(station.drones) == 1  # half of a pair does not know where it is
        self._out, self._requests, self._control = telemetry, requests, control
        self._news = asyncio.Event()
        self._was_armed = False

    async def receive_requests(self) -> None:
        """Answer requests, each with one reply."""
        while True:
            frames = await received(self._requests)
            before = self.drone.clients.in_control, len(self.drone.clients.all)
            content = [frame.bytes for frame in frames]
            reply = answer(content, self.drone, self._telemetry, peer_of(frames), time.monotonic())
            await self._requests.send_multipart(reply)
            if before != (self.drone.clients.in_control, len(self.drone.clients.all)):
                self._tell_clients()
            self._tell_of_mission()
            await asyncio.sleep(0)  # a flood of requests must not starve the rest

    def _tell_clients(self) -> None:
        clients = self.drone.clients
        pilot = clients.pilot
        who = f"{pilot.client.name} (client {pilot.id}) is in control" if pilot else "nobody is in control"
        self._station.say(f"blueye {self.drone.name}: {len(clients.all)} clients, {who}".replace(" :", ":"))
        self._send("ConnectedClientsTel")
        self._send("ControlModeTel")
        self._news.set()

    async def receive_control(self) -> None:
        """Take what clients command."""
        while True:
            frames = await received(self._control)
            try:
                control = parse_control([frame.bytes for frame in frames])
            except LinkError:
                self.drone.dropped += 1
            else:
                changed = self.drone.obey(control, peer_of(frames), time.monotonic())
                self._tell_of_mission()
                if changed:
                    self._send("ControlModeTel")
                    self._send("LightsTel")
                if not isinstance(control, Ignored | Watchdog) or self.drone.armed != self._was_armed:
                    self._news.set()
            await asyncio.sleep(0)

    async def keep_wishing(self) -> None:
        """Repeat the pilot's command while its watchdog is fed; at once when it is new, and once when it is no more."""
        while True:
            try:
                async with asyncio.timeout(REPEAT):
                    await self._news.wait()
            except TimeoutError:
                pass
            self._news.clear()
            ended = self.drone.look(time.monotonic())
            self._tell_of_mission()
            if ended:
                self._station.say(f"blueye {self.drone.name}: {ended}".replace(" :", ":"))
                self._send("ControlModeTel")
                self._send("LightsTel")
            if self.drone.armed:
                self._was_armed = True
                self._station.command(self.drone.command())
            else:
                self.disarm()
            await asyncio.sleep(AT_MOST)

    def disarm(self) -> None:
        """Thrusters off, said once."""
        if self._was_armed:
            self._was_armed = False
            self._station.command(PilotCommand(self.drone.name, armed=False))

    async def publish(self) -> None:
        """Telemetry from the station's readings."""
        async for batch in self._station.readings():
            contents = self._telemetry.contents
            self.drone.can_keep_position = self._alone and "position" in contents.latest
            for name, payload in self._telemetry.take(self._station.now, batch):
                self._publish(name, payload)
            if self.drone.fly(contents.here(self._alone)):
                self._send("ControlModeTel")
            self._log.saw_depth(self.drone.here.depth or 0.0)
            self._tell_of_mission()
            await asyncio.sleep(0)

    def _tell_of_mission(self) -> None:
        """What has become of a mission, to clients and, where it is no routine, to the user."""
        notes = self.drone.mission.taken_notes()
        for note in notes:
            self._telemetry.contents.note = (note, self.drone.clock())
            self._send("NotificationTel")
            if note.level > INFO:
                self._station.say(f"blueye {self.drone.name}: mission: {note.text}".replace(" :", ":"))
        if notes:
            self._send("MissionStatusTel")
            self._news.set()

    def _send(self, name: str) -> None:
        payload = self._telemetry.build(name)
        if payload is not None and self._telemetry.rates[name] > 0:
            self._publish(name, payload)

    def _publish(self, name: str, payload: bytes) -> None:
        self._out.send_multipart([(PACKAGE + name).encode(), payload])
        self._log.keep(name, payload, self._station.now, self.drone.clock())
