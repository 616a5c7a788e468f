"""Listening to QTM: frames, bodies, and servers that lie, die or stall."""

import asyncio
import struct
import sys
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.links.sensors import HOST, free_port, peer, reading, wait_until
from tests.links.serving import serving

from rovtwin.core.arrays.rotations import turn_about_z
from rovtwin.core.errors import LinkError
from rovtwin.links.qualisys import wire
from rovtwin.links.qualisys.guarded import guarded_protocol
from rovtwin.links.qualisys.poses import Lab
from rovtwin.links.qualisys.server import QtmServer
from rovtwin.links.qualisys.source import QtmSource

pytest.importorskip("qtm_rt", reason="pip install 'rovtwin[qualisys]'")
ETA = (1.5, -2.0, 3.0, 0.1, -0.2, 2.5)


def gather(source, count, feed=lambda: None, seconds=5.0):
    got = []

    def enough():
        feed()
        got.extend(source.read())
        return len(got) >= count

    wait_until(enough, seconds)
    return got


class Vehicle:
    """Feeds a pose of the next hundredth second whenever it is called."""

    def __init__(self, served, eta=ETA):
        self.served, self.eta, self.k = served, eta, 0

    def __call__(self):
        self.k += 1
        self.served.feed(0.01 * self.k, [reading("mocap", 0.01 * self.k, *self.eta)])


@pytest.mark.parametrize("sensors", [("mocap", "position"), ("mocap", "position", "attitude"), ("position",)])
def test_poses_are_those_that_were_fed(sensors):
    port = free_port()
    lab = Lab(R_nq=turn_about_z(0.4) @ np.diag([1.0, -1.0, -1.0]), origin=(5.0, 6.0, 0.5), lever=(0.1, 0.2, 0.3))
    with (
        serving(QtmServer(port=port, lab=lab)) as served,
        QtmSource(HOST, port=port, lab=lab, sensors=sensors) as source,
    ):
        got = gather(source, 5 * len(sensors), Vehicle(served))
        expected = {"mocap": ETA, "position": ETA[:2], "attitude": ETA[3:]}
        assert {r.sensor for r in got} == set(sensors)
        for r in got:
            np.testing.assert_allclose(r.value, expected[r.sensor], atol=2e-6)
        assert source.connections == 1 and source.dropped == 0 and "connected" in source.status


@pytest.mark.system
def test_times_are_those_of_qtm():
    port = free_port()
    with serving(QtmServer(port=port)) as served, QtmSource(HOST, "rov", port=port) as source:
        vehicle = Vehicle(served)
        wait_until(lambda: (vehicle(), source.connections)[1])
        start = 0.01 * vehicle.k
        time.sleep(0.05)
        source.read()
        began = time.monotonic()
        for k in range(20):
            t = start + 0.05 * (k + 1)
            time.sleep(max(0.0, began + 0.05 * (k + 1) - time.monotonic()))
            served.feed(t, [reading("mocap", t, *ETA)])
        got = [r for r in gather(source, 40) if r.sensor == "mocap"]
        steps = np.diff([r.t_valid for r in got])
        assert len(got) == 20 and np.median(steps) == pytest.approx(0.05, abs=2e-3)
        assert all(r.t_valid <= time.monotonic() for r in got)


def test_lost_body_is_quiet():
    port = free_port()
    with serving(QtmServer(port=port)) as served, QtmSource(HOST, port=port) as source:
        vehicle = Vehicle(served)
        gather(source, 1, vehicle)
        time.sleep(0.1)
        source.read()
        start = served.station.now
        for k in range(1, 20):
            served.feed(start + 0.1 * k, [reading("pressure", start + 0.1 * k, 1.0)])
        time.sleep(0.1)
        assert source.read() == [] and source.dropped == 0
        assert "connected" in source.status


def test_unknown_body_is_reported():
    port = free_port()
    with serving(QtmServer(port=port, body="rov")), QtmSource(HOST, "boat", port=port) as source:
        wait_until(lambda: "no rigid body 'boat'; QTM has: rov" in source.status)
        assert source.read() == []


def test_server_that_dies_and_comes_back():
    port = free_port()
    with QtmSource(HOST, port=port, sensors=("position",)) as source:
        wait_until(lambda: "trying again" in source.status)
        for life in range(2):
            with serving(QtmServer(port=port)) as served:
                got = gather(source, 1, Vehicle(served, (float(life), *ETA[1:])), 8.0)
                assert got[0].value[0] == pytest.approx(life)
            wait_until(lambda: "trying again" in source.status)
            source.read()
        assert source.connections == 2


def greeting(*then):
    """A QTM up to the stream, then bytes."""

    def answer(client):
        client.sendall(wire.text_packet(wire.COMMAND, "QTM RT Interface connected"))
        client.recv(4096)
        client.sendall(wire.text_packet(wire.COMMAND, "Version set to 1.25"))
        client.recv(4096)
        client.sendall(wire.text_packet(wire.XML, wire.parameters_xml("1.25", ["rov"], ["6d"], 100.0)))
        client.recv(4096)
        for data in then:
            client.sendall(data)
        client.recv(4096)

    return answer


def frame(t, x=1.0, R=None):
    return wire.data_packet(t, 1, ("6dres",), np.array([x, 2.0, 3.0]), np.eye(3) if R is None else R)


@pytest.mark.system
@pytest.mark.parametrize(
    "junk",
    [
        *(b"\0" * 8, struct.pack("<II", 2**32 - 1, 3), struct.pack("<II", 12, 3) + b"abcd", b"\xff" * 64),
        *(struct.pack("<II", 8, 99), wire.packet(wire.DATA, wire.FRAME.pack(0, 0, 2**31) + b"\0" * 16)),
        *(wire.packet(wire.EVENT, b""), wire.packet(wire.EVENT, b"\xff")),
        wire.packet(wire.DATA, wire.FRAME.pack(0, 0, 1) + struct.pack("<IIIhh", 20, 11, 2**30, 0, 0)),
    ],
)
def test_garbage_ends_the_visit(junk):
    """What would have the vendor's client loop for ever, eat memory or throw is left, and QTM tried again."""
    port = free_port()
    with peer(greeting(frame(0.0), junk), port) as visits, QtmSource(HOST, port=port, sensors=("mocap",)) as source:
        got = gather(source, 2)
        assert visits[0] >= 2 and all(r.value[0] == pytest.approx(1.0) for r in got)


def test_frames_that_are_no_poses_are_counted():
    port = free_port()
    empty = wire.packet(wire.DATA, wire.FRAME.pack(0, 0, 0))
    bad = (frame(0.01, R=2.0 * np.eye(3)), frame(0.02, R=-np.eye(3)), empty)
    good = (frame(0.0, 1.0), frame(0.05, 2.0))
    with peer(greeting(good[0], *bad, good[1]), port), QtmSource(HOST, port=port, sensors=("mocap",)) as source:
        got = gather(source, 2)
        assert [r.value[0] for r in got] == pytest.approx([1.0, 2.0])
        assert source.dropped == 3


def test_infinite_place_is_dropped():
    port = free_port()
    place = struct.pack("<3f9ff", np.inf, 0.0, 0.0, *np.eye(3).ravel(), 0.0)
    bad = wire.packet(wire.DATA, wire.FRAME.pack(0, 1, 1) + struct.pack("<IIIhh", 16 + len(place), 11, 1, 0, 0) + place)
    with peer(greeting(bad, frame(0.01)), port), QtmSource(HOST, port=port, sensors=("mocap",)) as source:
        (got,) = gather(source, 1)
        assert np.isfinite(got.value).all() and source.dropped == 1


def test_silent_server_holds_up_nobody(monkeypatch):
    monkeypatch.setattr("rovtwin.links.qualisys.source.PATIENCE", 0.3)
    port = free_port()
    with peer(lambda client: client.recv(1) and client.recv(1), port), QtmSource(HOST, port=port) as source:
        wait_until(lambda: "does not answer as QTM does" in source.status)
        assert source.read() == []


@pytest.mark.system
def test_closing_does_not_wait():
    port = free_port()
    with peer(lambda client: time.sleep(1.0), port):
        source = QtmSource(HOST, port=port)
        time.sleep(0.2)
        start = time.monotonic()
        source.close()
        assert time.monotonic() - start < 0.8 and not source._thread.is_alive()


def test_without_the_vendors_client(monkeypatch):
    monkeypatch.setitem(sys.modules, "qtm_rt", None)
    with pytest.raises(LinkError, match=r"pip install 'rovtwin\[qualisys\]'"):
        QtmSource(HOST)


def test_no_such_reading():
    with pytest.raises(LinkError, match="depth: no such reading; expected some of mocap, position, attitude"):
        QtmSource(HOST, sensors=("depth",))


_PACKETS = [
    wire.data_packet(1.0, 1, ("6dres",), np.ones(3), np.eye(3)),
    wire.data_packet(1.0, 1, tuple(wire.COMPONENTS), np.full(3, np.nan), np.eye(3)),
    wire.text_packet(wire.COMMAND, "Version set to 1.25"),
    wire.text_packet(wire.ERROR, "Parse error"),
    wire.event_packet(1),
    wire.packet(wire.NO_MORE_DATA, b""),
]


@st.composite
def _streams(draw):
    """A few packets with bits of them exchanged, and where the network cuts them."""
    data = bytearray(b"".join(draw(st.lists(st.sampled_from(_PACKETS), min_size=1, max_size=3))))
    for at, byte in draw(st.lists(st.tuples(st.integers(0, len(data) - 1), st.integers(0, 255)), max_size=5)):
        data[at] = byte
    return bytes(data), draw(st.integers(0, len(data)))


@pytest.fixture(scope="module")
def fuzzed():
    """A source that is closed, and a loop for the vendor's client."""
    source = QtmSource(HOST, port=free_port())
    source.close()
    loop = asyncio.new_event_loop()
    asyncio.set_event_loop(loop)
    yield source, loop
    asyncio.set_event_loop(None)
    loop.close()


def _survives(fuzzed, stream):
    source, _ = fuzzed
    data, cut = stream
    protocol = guarded_protocol(lambda reason: None)
    protocol.set_on_packet(source._take)
    protocol.data_received(data[:cut])
    protocol.data_received(data[cut:])
    assert protocol.failure is None or isinstance(protocol.failure, LinkError)
    assert len(protocol.waiting) <= len(data) and source.read() == []


@settings(max_examples=400)
@given(stream=_streams())
def test_fuzz_of_the_vendors_client(fuzzed, stream):
    _survives(fuzzed, stream)


@pytest.mark.slow
@settings(max_examples=100_000)
@given(stream=_streams())
def test_fuzz_of_the_vendors_client_long(fuzzed, stream):
    _survives(fuzzed, stream)
