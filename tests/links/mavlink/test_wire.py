"""Frames from anybody: no exception but LinkError, no unbounded memory, and no number that is none reaches a wish."""

import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.links.mavlink.vehicle import measured

from rovtwin.core.errors import LinkError
from rovtwin.links.mavlink import link as link_module
from rovtwin.links.mavlink.driver.readings import Readings
from rovtwin.links.mavlink.link import MavlinkLink
from rovtwin.links.mavlink.server import MavlinkServer, Session
from rovtwin.links.mavlink.wire import LONGEST, Decoder, Encoder
from rovtwin.links.servers.served_vehicle import ServedVehicle

pytest.importorskip("pymavlink", reason="pymavlink is not installed: pip install 'rovtwin[mavlink]'")
from pymavlink.dialects.v20 import ardupilotmega as dialect

EXAMPLES = pytest.mark.parametrize("examples", [200, pytest.param(100_000, marks=pytest.mark.slow)])
# What the endpoint answers to, and what the link reads: their payloads are fuzzed with a good checksum.
NAMES = (
    *("HEARTBEAT", "MANUAL_CONTROL", "RC_CHANNELS_OVERRIDE", "SET_MODE", "SET_POSITION_TARGET_LOCAL_NED"),
    *("SET_POSITION_TARGET_GLOBAL_INT", "COMMAND_LONG", "COMMAND_INT", "PARAM_REQUEST_LIST", "PARAM_REQUEST_READ"),
    *("PARAM_SET", "MISSION_REQUEST_LIST", "MISSION_COUNT", "TIMESYNC", "REQUEST_DATA_STREAM", "STATUSTEXT"),
    *("ATTITUDE", "RAW_IMU", "SCALED_IMU2", "SCALED_PRESSURE2", "VFR_HUD", "GLOBAL_POSITION_INT"),
    *("LOCAL_POSITION_NED", "DISTANCE_SENSOR", "SYS_STATUS", "COMMAND_ACK", "NAMED_VALUE_FLOAT"),
)
KINDS = {found.msgname: found for found in dialect.mavlink_map.values() if found.msgname in NAMES}
GOOD = Encoder(255, 190).frame(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))


def framed(kind, payload: bytes, system: int, component: int) -> bytes:
    """A frame of a kind with any payload and a good checksum."""
    body = bytes([len(payload), 0, 0, 7, system, component]) + kind.id.to_bytes(3, "little") + payload
    checksum = dialect.x25crc(body + bytes([kind.crc_extra])).crc
    return b"\xfd" + body + checksum.to_bytes(2, "little")


def frames() -> st.SearchStrategy[bytes]:
    """Frames with a good checksum and random payloads, half of them of pieces that address our vehicle."""

    def frame(kind):
        size = kind.unpacker.size
        payload = st.one_of(
            st.binary(max_size=size), st.lists(st.sampled_from(PIECES)).map(lambda p: b"".join(p)[:size])
        )
        return st.builds(framed, st.just(kind), payload, st.sampled_from([255, 1, 0, 42]), st.sampled_from([1, 190, 0]))

    return st.sampled_from(sorted(KINDS.values(), key=lambda kind: kind.id)).flatmap(frame)


NUMBERS = [0.0, 1.0, 19.0, 4.0, 30.0, -1.0, 1e30, math.nan, math.inf, -math.inf]
PIECES = [np.float32(v).tobytes() for v in NUMBERS] + [
    b"\1\1",
    b"\1",
    b"\0",
    b"\x90\1",
    b"\xb0\0",
    b"\xff\x7f",
    b"\xff",
]


def aimed() -> st.SearchStrategy[bytes]:
    """Frames that are whole but for their values: sticks and set-points for our vehicle."""
    sticks = st.tuples(*[st.integers(-1100, 1100)] * 4).map(
        lambda v: dialect.MAVLink_manual_control_message(1, *v, 0, 0, 3, v[0], v[1])
    )
    values = st.tuples(*[st.floats(-3.0, 3.0, width=32) | st.sampled_from(NUMBERS)] * 11)
    frame, mask = st.sampled_from([1, 7, 8, 9, 12, 2]), st.integers(0, 4095)
    places = st.builds(
        lambda f, m, v: dialect.MAVLink_set_position_target_local_ned_message(0, 1, 1, f, m, *v), frame, mask, values
    )
    return (sticks | places).map(lambda message: Encoder(255, 190).frame(message))


def streams() -> st.SearchStrategy[bytes]:
    return st.lists(st.one_of(st.binary(max_size=60), frames(), aimed(), st.just(GOOD)), max_size=6).map(b"".join)


def check_stream(data: bytes, cuts: list[int]) -> None:
    decoder, start = Decoder(), 0
    for cut in [*sorted(c % (len(data) + 1) for c in cuts), len(data)]:
        try:
            messages = decoder.feed(data[start:cut])
        except LinkError:
            messages = []
        assert all(m.get_type() in {k.msgname for k in dialect.mavlink_map.values()} for m in messages)
        assert decoder.kept <= LONGEST
        start = cut


@EXAMPLES
def test_any_stream(examples):
    strategy = given(streams(), st.lists(st.integers(0, 400), max_size=3))
    settings(max_examples=examples, deadline=None, database=None)(strategy(check_stream))()


class Endpoint:
    """A served vehicle without sockets: takes datagrams, keeps wishes."""

    def __init__(self):
        self.commands, self.sent = [], []
        self.station = ServedVehicle(send=self.commands.append)
        self.station.feed(0.0, measured(0.0, estimate=True))
        self.session = Session(MavlinkServer(), self.station)
        self.session._udp = self
        self.steered = self.sent_to = 0

    def sendto(self, data, address):
        self.sent.append(data)

    def check(self, data: bytes) -> None:
        # Whatever the last one changed: armed, in GUIDED or steered by sticks.
        self.session.autopilot.arm(255, 0.0, "")
        self.session.autopilot.set_mode(4 if len(data) % 2 else 19)
        self.session._datagram(data, ("127.0.0.1", 1000))
        for command in self.commands:
            self.steered += any(command.motion)
            self.sent_to += command.target is not None
            assert len(command.motion) == 6 and all(abs(m) <= 1.0 for m in command.motion)
            assert command.target is None or all(math.isfinite(v) for v in command.target)
        self.commands.clear()
        self.sent.clear()


@EXAMPLES
def test_any_datagram_at_the_server(examples):
    endpoint = Endpoint()
    settings(max_examples=examples, deadline=None, database=None)(given(streams())(endpoint.check))()
    # The fuzz gets through to where it could do harm.
    assert endpoint.steered > 0 and endpoint.sent_to > 0
    assert len(endpoint.session._peers.all()) == 1 and len(endpoint.session.talk.ignored) < 300


class SilentLine:
    """A line that nothing is sent over."""

    url, failure = "silent", ""

    def __init__(self, *_):
        pass

    def start(self):
        pass

    def send(self, message):
        pass

    def close(self):
        pass


@EXAMPLES
def test_any_message_at_the_link(examples, monkeypatch):
    monkeypatch.setattr(link_module, "Line", SilentLine)
    monkeypatch.setattr(MavlinkLink, "_await_vehicle", lambda self, url: None)
    monkeypatch.setattr(link_module, "LOST_AFTER", math.inf)  # no heartbeat comes here, and 100,000 take minutes
    monkeypatch.setattr(MavlinkLink, "_await_vehicle", lambda self, url: None)
    link = MavlinkLink("silent", np.eye(6), target=1, readings=Readings(position=True))
    found = 0

    def check(data: bytes) -> None:
        nonlocal found
        for message in Decoder().feed(data):
            link._on_message(message)
        readings = link.read()
        found += len(readings)
        assert all(np.all(np.isfinite(r.value)) and math.isfinite(r.t_valid) for r in readings)
        assert link.gain is None or 0.05 <= link.gain <= 1.0

    settings(max_examples=examples, deadline=None, database=None)(given(frames())(check))()
    link.close()
    assert found > 0


def test_good_frames_survive_garbage_between_them():
    decoder = Decoder()
    found = decoder.feed(b"\x00\x11" + GOOD + b"rubbish" + GOOD)
    assert [m.get_type() for m in found] == ["HEARTBEAT", "HEARTBEAT"] and decoder.broken == 2


def test_endless_stream_keeps_no_memory():
    """A stream that always ends within a frame: what was read is let go of."""
    decoder, half = Decoder(), GOOD + GOOD[:7]
    rest = GOOD[7:]
    tracemalloc.start()
    decoder.feed(half)
    for _ in range(2000):
        assert len(decoder.feed(rest + GOOD[:7])) == 1
    before = tracemalloc.get_traced_memory()[0]
    for _ in range(2000):
        decoder.feed(rest + GOOD[:7])
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 10_000 and decoder.kept == 7


def test_numbers_of_frames_count_up():
    encoder, decoder = Encoder(1, 1), Decoder()
    message = dialect.MAVLink_heartbeat_message(12, 3, 1, 19, 3, 3)
    found = [m for _ in range(300) for m in decoder.feed(encoder.frame(message))]
    assert [m.get_seq() for m in found] == [k % 256 for k in range(300)]
