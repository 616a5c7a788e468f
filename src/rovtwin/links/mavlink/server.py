"""MavlinkServer: the twin as a BlueROV2 with ArduSub, for pymavlink, MAVSDK and ground stations."""

import asyncio
import contextlib
import logging
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from rovtwin.core.datum import Datum
from rovtwin.core.errors import LinkError
from rovtwin.links.mavlink.firmware.autopilot import WARNING, Autopilot
from rovtwin.links.mavlink.firmware.parameters import Parameters
from rovtwin.links.mavlink.mixing import Mixer
from rovtwin.links.mavlink.modes import GUIDED, POSHOLD
from rovtwin.links.mavlink.services.commands import FIRMWARE
from rovtwin.links.mavlink.services.conversation import Conversation
from rovtwin.links.mavlink.services.mission_service import remind
from rovtwin.links.mavlink.services.peers import Peer, Peers
from rovtwin.links.mavlink.services.sockets import open_tcp, open_udp
from rovtwin.links.mavlink.telemetry.scene import Scene, rounds
from rovtwin.links.mavlink.telemetry.streams import MESSAGES, RATES, Schedule
from rovtwin.links.mavlink.wire import Decoder, Encoder, dialect
from rovtwin.links.servers.served_vehicle import ServedVehicle
from rovtwin.links.servers.server import Server

logger = logging.getLogger(__name__)

REPEAT = 0.05  # a command is repeated after this [s]; it holds for 0.3 s at the vehicle
HEARTBEAT = 1.0  # [s], real time
LEAK_REPEAT = 20.0  # a leak is reported again after this, as ArduSub does [s]
SUBMARINE, ARDUPILOT = 12, 3  # MAV_TYPE, MAV_AUTOPILOT
STANDBY, ACTIVE, CRITICAL = 3, 4, 5  # MAV_STATE
TEXT = 50  # bytes of a STATUSTEXT; a longer one comes in pieces


@dataclass
class MavlinkServer(Server):
    """An endpoint as ArduSub's, for one vehicle (or one drone of several).

    It calls a ground station at UDP 14550 as a BlueROV2 does, answers whoever speaks to its own UDP port, and takes
    TCP connections as ArduPilot's software-in-the-loop does.

    Attributes:
        address: Host that both ports are bound to.
        ground_station: Host and port that telemetry is sent to without being asked, `""` for none.
        udp_port: Own UDP port; clients send there, and the ground station is called from there.
        tcp_port: TCP port, or None for no TCP.
        drone: Name of the drone, one of `ServedVehicle.drones`.
        system: MAVLink system id of the vehicle; its component is 1, the autopilot.
        datum: Origin of n on the map.
        mixer: From `mixing.mixer(thrusters)`: axes are then what ArduSub makes of them at the thrusters, linear in
            the command; None takes them as shares of the largest force.
        gain: JS_GAIN_DEFAULT, 0.5 as ArduSub ships; 1 lets full stick be full thrust.
        firmware: Major and minor version of the ArduSub that it is; before 4.5 sticks cannot roll and pitch.
        fastest: Velocity ahead, to the right, down [m/s] and turn rate [rad/s] of a full share in a held direction;
            GUIDED divides velocity set-points by it.
        rates: Telemetry at first, messages by name [Hz, in the vehicle's time]; added to `telemetry.RATES`.
        density: Of the water, for SCALED_PRESSURE2 [kg/m3].
        surface_pressure: [Pa].
    """

    address: str = "127.0.0.1"
    ground_station: str = "127.0.0.1:14550"
    udp_port: int = 14551
    tcp_port: int | None = 5760
    drone: str = ""
    system: int = 1
    datum: Datum = field(default_factory=Datum)
    mixer: Mixer | None = None
    gain: float = 0.5
    firmware: tuple[int, int] = FIRMWARE
    fastest: tuple[float, float, float, float] = (1.0, 1.0, 0.5, 1.0)
    rates: Mapping[str, float] = field(default_factory=dict)
    density: float = 1025.0
    surface_pressure: float = 101325.0

    def __post_init__(self) -> None:
        unknown = sorted(set(self.rates) - MESSAGES.keys())
        if unknown:
            raise LinkError(f"mavlink: rates: no message {unknown[0]}; expected one of {', '.join(MESSAGES)}")
        if self.ground_station:
            _host_and_port(self.ground_station)

    @property
    def addresses(self) -> list[str]:
        """The host that is bound, and the ground station's: who gets telemetry may also steer."""
        called = [_host_and_port(self.ground_station)[0]] if self.ground_station else []
        return [self.address, *called]

    async def run(self, station: ServedVehicle) -> None:
        """Serve until cancelled.

        Raises:
            LinkError: A port cannot be bound, or pymavlink is not installed.
        """
        session = Session(self, station)
        async with contextlib.AsyncExitStack() as open_things:
            await session.open(open_things)
            open_things.callback(session.end)
            async with asyncio.TaskGroup() as tasks:
                for work in (session.telemetry(), session.send_commands(), session.heartbeats()):
                    tasks.create_task(work)


def _host_and_port(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise LinkError(f"mavlink: ground_station {text!r}: expected host and port, such as 127.0.0.1:14550")
    return host, int(port)


class Session:
    """One run of a server: its sockets, peers and the autopilot behind them."""

    def __init__(self, server: MavlinkServer, station: ServedVehicle):
        self._server, self._station = server, station
        self._dialect = dialect()
        self._peers = Peers(self._new_peer)
        parameters = Parameters(server.system, server.gain, server.density)
        self.autopilot = Autopilot(parameters, self._say, server.mixer, server.fastest, server.drone)
        scene = Scene(
            dict(station.latest),
            station,
            server.drone,
            self._dialect,
            server.datum,
            server.density,
            server.surface_pressure,
            self.autopilot,
        )
        self.talk = Conversation(
            self.autopilot, scene, server.system, 1, time.monotonic, self._everybody, server.firmware
        )
        self.autopilot.knows_place = lambda: scene.fix() is not None
        self._sent_armed = False
        self._leak_text_at = -LEAK_REPEAT
        self._texts = 0  # numbers of texts that came in pieces
        self._datagrams = Decoder()
        self.broken = 0  # pieces of input that were no frame
        self.failed: dict[str, int] = {}  # messages whose answer failed, by type

    async def open(self, open_things: contextlib.AsyncExitStack) -> None:
        """Bind the ports and say where; what is opened is closed with `open_things`."""
        server = self._server
        udp = await open_udp(server.address, server.udp_port, self._datagram)
        open_things.callback(udp.close)
        where = [f"udp {server.address}:{server.udp_port}"]
        if server.tcp_port is not None:
            tcp = await open_tcp(server.address, server.tcp_port, self._connected, self._stream, self._gone)
            open_things.callback(tcp.close)
            where.append(f"tcp {server.address}:{server.tcp_port}")
        if server.ground_station:
            called = _host_and_port(server.ground_station)
            peer = self._peers.get(
                called, server.ground_station, lambda data: udp.sendto(data, called), time.monotonic()
            )
            assert peer is not None
            peer.called = True
            where.append(f"calls {server.ground_station}")
        self.talk.scene.on_map(0.0, 0.0, 0.0)  # loads the geodesy now, which takes 44 ms: the first telemetry was late
        self._station.say(f"mavlink: {', '.join(where)} (system {server.system})")
        self._udp = udp

    def end(self) -> None:
        """Leave nothing armed behind."""
        self.autopilot.disarm()
        self._send_command()

    async def telemetry(self) -> None:
        """Send what is due with every batch of readings."""
        scene = self.talk.scene
        async for batch in self._station.readings():
            for readings in rounds(batch):
                scene.take(readings)
                for peer in self._peers.all():
                    for message in peer.schedule.due(scene):
                        peer.send(message)

    async def send_commands(self) -> None:
        """Repeat the command while armed, and watch over who lives."""
        while True:
            now = time.monotonic()
            self.autopilot.check(now)
            if (depth := self.talk.scene.fresh_depth()) is None:
                self.autopilot.lose_depth()
            else:
                self.autopilot.arrive(depth)
            self._send_command()
            self._tell_of_leak(now)
            remind(self.talk, now)
            for peer in self._peers.forget(now):
                self._station.say(f"mavlink: {peer.name} is silent")
            await asyncio.sleep(REPEAT)

    async def heartbeats(self) -> None:
        """Tell all that the vehicle is there."""
        while True:
            self._everybody(self._heartbeat())
            await asyncio.sleep(HEARTBEAT)

    def _tell_of_leak(self, now: float) -> None:
        leak = self.talk.scene.reading("leak")
        if leak is not None and leak.value[0] > 0.5 and now - self._leak_text_at > LEAK_REPEAT:
            self._leak_text_at = now
            self._say(WARNING, "Leak Detected")

    def _heartbeat(self) -> Any:
        mode, armed = self.autopilot.mode, self.autopilot.armed
        # MAV_MODE_FLAG: custom mode, stabilised and manual input, which ArduSub has in every mode; guided, armed.
        base = 1 | 16 | 64 | (8 if mode in (GUIDED, POSHOLD) else 0) | (128 if armed else 0)
        state = CRITICAL if self.autopilot.failing else ACTIVE if armed else STANDBY
        return self._dialect.MAVLink_heartbeat_message(SUBMARINE, ARDUPILOT, base, mode.number, state, 3)

    def _send_command(self) -> None:
        """While armed, every time; after that once, that it is not any more."""
        armed = self.autopilot.armed
        if armed or self._sent_armed:
            self._station.command(self.autopilot.command(time.monotonic()))
        self._sent_armed = armed

    def _say(self, severity: int, text: str) -> None:
        letters = text.encode("ascii", "replace")
        pieces = [letters[i : i + TEXT] for i in range(0, len(letters), TEXT)]
        self._texts = self._texts % 65535 + 1
        for number, piece in enumerate(pieces):
            identity = self._texts if len(pieces) > 1 else 0  # by it the pieces find together
            self._everybody(self._dialect.MAVLink_statustext_message(severity, piece, identity, number))
        self._station.say(f"mavlink: {text}")

    def _everybody(self, message: Any) -> None:
        for peer in self._peers.all():
            peer.send(message)

    def _new_peer(self, name: str, write: Any) -> Peer:
        encoder = Encoder(self._server.system, 1)
        return Peer(name, write, encoder, Schedule(RATES | dict(self._server.rates)), time.monotonic())

    def _datagram(self, data: bytes, sender: tuple[str, int]) -> None:
        messages = self._decoded(self._datagrams, data)
        self._datagrams.reset()  # datagrams hold whole frames: nothing is left over for the next
        if not messages:
            return
        known = sender in self._peers.by_address
        name, now = f"{sender[0]}:{sender[1]}", time.monotonic()
        peer = self._peers.get(sender, name, lambda frame: self._udp.sendto(frame, sender), now)
        if peer is None:
            return
        if not known:
            self._station.say(f"mavlink: {peer.name} speaks")
            peer.send(self._heartbeat())
        self._take(messages, peer)

    def _connected(self, key: Any, name: str, write: Any) -> bool:
        peer = self._peers.get(key, name, write, time.monotonic())
        if peer is not None:
            peer.close = key.close
            self._station.say(f"mavlink: {name} connected")
            peer.send(self._heartbeat())
        return peer is not None

    def _stream(self, key: Any, decoder: Decoder, data: bytes) -> None:
        peer = self._peers.by_address.get(key)
        if peer is not None:
            self._take(self._decoded(decoder, data), peer)

    def _gone(self, key: Any, name: str) -> None:
        self._peers.drop(key)
        self._station.say(f"mavlink: {name} disconnected")

    def _decoded(self, decoder: Decoder, data: bytes) -> list[Any]:
        before = decoder.broken
        try:
            messages = decoder.feed(data)
        except LinkError:
            messages = []
            self.broken += 1
        self.broken += decoder.broken - before
        return messages

    def _take(self, messages: list[Any], peer: Peer) -> None:
        peer.received_at = time.monotonic()
        before = (self.autopilot.mode, self.autopilot.armed)
        changed = [self._answer(message, peer) for message in messages]
        if any(changed):
            self._send_command()
        if (self.autopilot.mode, self.autopilot.armed) != before:
            self._everybody(self._heartbeat())  # sooner than an ArduSub tells it: nobody needs to wait a second

    def _answer(self, message: Any, peer: Peer) -> bool:
        """As `Conversation.take`; an error of ours costs the answer to this message, and not the server."""
        try:
            return self.talk.take(message, peer)
        except Exception as error:
            kind = message.get_type()
            self.failed[kind] = self.failed.get(kind, 0) + 1
            if self.failed[kind] == 1:
                logger.error("mavlink: answering %s", kind, exc_info=error)
                self._say(WARNING, f"{kind} is not answered: an error of the endpoint's")
            return True  # it may have changed something before it failed
