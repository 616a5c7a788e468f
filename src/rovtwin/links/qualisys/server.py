"""A QTM that sees a station's vehicle as one rigid body."""

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import LinkError
from rovtwin.core.flow import Measurement
from rovtwin.links.clock import Due
from rovtwin.links.qualisys import control, wire
from rovtwin.links.qualisys.control import MASTER_ONLY, Control
from rovtwin.links.qualisys.poses import Lab
from rovtwin.links.qualisys.wire import COMMAND, ERROR, NO_MORE_DATA, XML, Stream
from rovtwin.links.servers.served_vehicle import ServedVehicle
from rovtwin.links.servers.server import Server
from rovtwin.links.servers.tcp_server import MOST_CLIENTS, Client, open_tcp_server

PORT = 22223  # little endian; QTM's base port 22222 and one
LOST = 0.2  # no pose for so long: the body is lost [s]
LOST_PERIOD = 0.1  # between frames without the body [s]
VERSIONS = tuple(f"1.{minor}" for minor in range(8, 26))  # 1.8 is the oldest that the vendor's client speaks
LATER = 0.2  # from the answer to an order until its event: the vendor's client misses one that comes with it [s, real]


@dataclass
class QtmServer(Server):
    """Streams `mocap` of a station in QTM's real-time protocol over TCP.

    Every reading is a frame. When they stop coming for 0.2 s the body is lost: frames with NaN come at 10 Hz.

    Args:
        host: Address to bind.
        port: TCP port; QTM's own for little endian is 22223.
        body: Name of the rigid body.
        lab: Where the lab's frame lies in n.
        rate: Capture frequency that the settings tell [Hz].
        password: With which a client takes control (`control`): it may stop the frames. None: nobody may.
    """

    host: str = "127.0.0.1"
    port: int = PORT
    body: str = "rov"
    lab: Lab = field(default_factory=Lab)
    rate: float = 100.0
    password: str | None = control.PASSWORD
    most_clients: int = MOST_CLIENTS

    @property
    def addresses(self) -> list[str]:
        return [self.host]

    async def run(self, station: ServedVehicle) -> None:
        qtm = _Qtm(self, station)
        where = (self.host, self.port)
        async with open_tcp_server("qtm", *where, qtm.serve, station.say, wire.LONGEST_COMMAND, self.most_clients):
            station.say(f"qtm: speaks at {self.host}:{self.port}")
            async for batch in station.readings():
                qtm.receive(batch)


class _Viewer:
    """A client and what it is sent."""

    def __init__(self, client: Client):
        self.client = client
        self.version = "1.1"  # until it says which
        self.stream: Stream | None = None
        self.once: tuple[str, ...] | None = None
        self._frames = 0
        self._due = Due(1.0)

    def want(self, stream: Stream | None) -> None:
        self.stream = stream
        self._frames = 0
        self._due = Due(1.0 / stream.rate if stream is not None and stream.rate else 1.0)

    def show(self, t: float, frame: Callable[[tuple[str, ...]], bytes]) -> None:
        """A frame that is valid at t [s], where this client wants it."""
        if self.once is not None:
            self.client.send(frame(self.once))
            self.once = None
        if self.stream is None:
            return
        due = self._due(t) if self.stream.rate else self._frames % self.stream.every == 0
        self._frames += 1
        if due:
            self.client.send(frame(self.stream.components))


class _Qtm:
    """The program: who looks, and the last frame."""

    def __init__(self, options: QtmServer, station: ServedVehicle):
        self.options, self.station = options, station
        self.viewers: set[_Viewer] = set()
        self.malformed = 0
        self.frame = 0
        self.control = Control(options.password)
        self._seen = -math.inf
        self._lost_due = Due(LOST_PERIOD)
        self._commands: dict[str, Callable[[_Viewer, list[str]], bytes]] = {
            "version": self._version,
            "qtmversion": lambda viewer, words: _reply("QTM Version is 2024.1 (build 0, rovtwin)"),
            "byteorder": lambda viewer, words: _reply("Byte order is little endian"),
            "checklicense": lambda viewer, words: _reply("License pass"),
            "getstate": lambda viewer, words: wire.event_packet(self.control.state),
            "getlastevent": lambda viewer, words: wire.event_packet(self.control.state),
            "getparameters": self._parameters,
            "getcurrentframe": self._current,
            "streamframes": self._stream,
            "takecontrol": lambda viewer, words: _answered(*self.control.take(viewer.client.name, words)),
            "releasecontrol": lambda viewer, words: _reply(self._release(viewer.client.name)),
        }

    # What clients ask.

    async def serve(self, client: Client) -> None:
        """One client, as long as it makes sense."""
        viewer = _Viewer(client)
        self.viewers.add(viewer)
        try:
            client.send(_reply("QTM RT Interface connected"))
            while not client.gone:
                header = await client.reader.readexactly(wire.HEADER.size)
                size, kind = wire.parse_header(header, wire.LONGEST_COMMAND)
                body = await client.reader.readexactly(size - wire.HEADER.size)
                client.send(self._answer(viewer, kind, body))
        except LinkError as error:  # after a wrong size there is no telling where the next packet begins
            self.malformed += 1
            client.send(_refusal(f"Parse error: {error}"))
            await client.finish()
        finally:
            self.viewers.discard(viewer)
            self._release(client.name)

    def _answer(self, viewer: _Viewer, kind: int, body: bytes) -> bytes:
        try:
            if kind == XML:
                return _refusal(
                    "Setting parameters failed: the twin's are fixed" if self._rules(viewer) else MASTER_ONLY
                )
            if kind != COMMAND:
                raise LinkError("not a command")
            name, *words = wire.command_words(body)
            if name.lower() in control.ORDERS:
                return self._obey(viewer, name.lower(), words)
            return self._commands[name.lower()](viewer, words)
        except (KeyError, LinkError):
            self.malformed += 1
            return _refusal("Parse error")

    def _rules(self, viewer: _Viewer) -> bool:
        return self.control.master == viewer.client.name

    def _release(self, who: str) -> str:
        """Control is given back: nobody is left without frames, for the twin has no operator of its own."""
        before, ruled = self.control.state, self.control.master == who
        if ruled and before not in control.STREAMING:
            self.control.state = control.PLAYING
            self._changed(before, f"{who} gave up control")
        return self.control.release(who)

    def _obey(self, viewer: _Viewer, order: str, words: list[str]) -> bytes:
        """An order to the measurement. What follows from it all clients get, a little later."""
        before = self.control.state
        answer = _answered(*self.control.obey(viewer.client.name, order, words))
        self._changed(before, f"{viewer.client.name} asked for {order}")
        return answer

    def _changed(self, before: int, why: str) -> None:
        state = self.control.state
        if state == before:
            return
        asyncio.get_running_loop().call_later(LATER, self._tell_all, wire.event_packet(state))
        if (state in control.STREAMING) != (before in control.STREAMING):
            self.station.say(f"qtm: {why}: {'frames again' if state in control.STREAMING else 'no frames'}")

    def _tell_all(self, packet: bytes) -> None:
        for viewer in self.viewers:
            viewer.client.send(packet)

    def _version(self, viewer: _Viewer, words: list[str]) -> bytes:
        if not words:
            return _reply(f"Version is {viewer.version}")
        if words[0] not in VERSIONS:
            return _refusal("Version NOT supported")
        viewer.version = words[0]
        return _reply(f"Version set to {viewer.version}")

    def _parameters(self, viewer: _Viewer, words: list[str]) -> bytes:
        sections = [word.lower() for word in words]
        if not {*wire.SECTIONS, "all"} & set(sections):
            return _refusal(f"Parameters not available: the twin has {', '.join(wire.SECTIONS)}")
        settings = wire.parameters_xml(viewer.version, [self.options.body], sections, self.options.rate)
        return wire.text_packet(XML, settings)

    def _current(self, viewer: _Viewer, words: list[str]) -> bytes:
        components = wire.parse_components(words)
        if not self._has_frames:
            return wire.packet(NO_MORE_DATA, b"")
        viewer.once = components  # the next frame, when it comes
        return b""

    def _stream(self, viewer: _Viewer, words: list[str]) -> bytes:
        viewer.want(wire.parse_stream(words))
        # QTM answers with data; without any yet it says so, and sends when there is.
        return wire.packet(NO_MORE_DATA, b"") if viewer.stream is not None and not self._has_frames else b""

    @property
    def _has_frames(self) -> bool:
        return self.frame > 0 and self.control.state in control.STREAMING

    # What the vehicle measures.

    def receive(self, batch: list[Measurement]) -> None:
        """Readings as they come; without any for a while, frames that have lost the body."""
        for reading in batch:
            if reading.sensor == "mocap" and reading.value.shape == (6,) and np.isfinite(reading.value).all():
                self._seen = reading.t_valid
                self._show(reading.t_valid, *self.options.lab.to_lab(reading.value))
        now = self.station.now
        if now < self._seen - 1.0:  # the vehicle's time starts anew
            self._seen = now
        if self.frame and now - self._seen > LOST and self._lost_due(now):
            self._show(now, np.full(3, np.nan), np.full((3, 3), np.nan))

    def _show(self, t: float, place: Float[np.ndarray, "3"], R: Float[np.ndarray, "3 3"]) -> None:
        self.frame += 1
        if not self._has_frames:
            return
        made: dict[tuple[str, ...], bytes] = {}

        def frame(components: tuple[str, ...]) -> bytes:
            if components not in made:
                made[components] = wire.data_packet(t, self.frame, components, place, R)
            return made[components]

        for viewer in list(self.viewers):
            viewer.show(t, frame)


def _reply(text: str) -> bytes:
    return wire.text_packet(COMMAND, text)


def _answered(text: str, is_error: bool) -> bytes:
    return _refusal(text) if is_error else _reply(text)


def _refusal(text: str) -> bytes:
    return wire.text_packet(ERROR, text)
