"""Listening to an Underwater GPS: frames, what is new, and kits that lie, die or stall."""

import json
import math
import time

import numpy as np
import pytest
from tests.links.sensors import HOST, free_port, gather, peer, reading, wait_until
from tests.links.serving import serving

from rovtwin.core.datum import Datum
from rovtwin.core.errors import LinkError
from rovtwin.links.http_wire import response_bytes
from rovtwin.links.waterlinked import ugps_wire as wire
from rovtwin.links.waterlinked.ugps_server import UgpsServer
from rovtwin.links.waterlinked.ugps_source import UgpsSource

FIX = wire.body_of(wire.AcousticPosition(10.0, 3.0, 4.0, 0.5, True, (1.0,), (-60.0,), (-90.0,), (1.0,)))


def test_positions_are_those_that_were_fed():
    port = free_port()
    pose = (5.0, -2.0, math.radians(30.0))
    server = UgpsServer(port=port, topside=(5.0, -2.0, 30.0))
    with serving(server) as served, UgpsSource(HOST, port, topside=pose, rate=50.0) as source:
        wait_until(lambda: source.connections == 1)
        places = [(10.0, 3.0), (10.5, 3.5), (10.5, 3.5), (-4.0, 8.0)]
        for k, place in enumerate(places):
            served.feed(0.25 * k, [reading("position", 0.25 * k, *place)])
            before = time.monotonic()
            (got,) = gather(source, 1)
            assert got.sensor == "position" and before - 0.5 < got.t_valid <= time.monotonic()
            np.testing.assert_allclose(got.value, place, atol=1e-9)
        time.sleep(0.2)
        assert source.read() == []  # the same fix, asked for ten times more, is not new
        assert source.dropped == 0


def test_topside_that_moves():
    """Its place and heading come from the kit, by the map."""
    port = free_port()
    datum = Datum(63.4, 10.4)
    server = UgpsServer(port=port, topside=(20.0, 30.0, 200.0), datum=datum)
    with serving(server) as served, UgpsSource(HOST, port, datum=datum, rate=50.0) as source:
        wait_until(lambda: source.connections == 1)
        served.feed(0.0, [reading("position", 0.0, 12.0, -7.0)])
        (got,) = gather(source, 1)
        np.testing.assert_allclose(got.value, [12.0, -7.0], atol=1e-3)


def test_positions_that_are_not_valid_are_quiet():
    port = free_port()
    server = UgpsServer(port=port, needs_depth=True)
    with serving(server) as served, UgpsSource(HOST, port, rate=50.0) as source:
        wait_until(lambda: source.connections == 1)
        served.feed(0.0, [reading("position", 0.0, 1.0, 2.0)])
        time.sleep(0.2)
        assert source.read() == []
        source.tell_depth(3.0)
        source.tell_depth(math.nan)  # no number is no depth
        (got,) = gather(source, 1)
        np.testing.assert_allclose(got.value, [1.0, 2.0])


def test_depth_arrives():
    port = free_port()
    with serving(UgpsServer(port=port)) as served, UgpsSource(HOST, port, rate=50.0) as source:
        wait_until(lambda: source.connections == 1)
        source.tell_depth(3.25, 8.0)
        time.sleep(0.2)
        served.feed(0.0, [reading("pressure", 0.0, 9.0), reading("position", 0.0, 1.0, 2.0)])
        gather(source, 1)
        assert source._seen is not None and source._seen.z == 3.25


def answering(*answers):
    """One answer a connection, the last one again and again."""
    rest = list(answers)

    def answer(client):
        client.recv(4096)
        client.sendall(rest.pop(0) if len(rest) > 1 else rest[0])
        client.close()

    return answer


def ok(**changes):
    return response_bytes(200, FIX | changes, False)


@pytest.mark.parametrize(
    "bad",
    [
        *(b"", b"garbage\r\n\r\n", b"HTTP/1.1 200 OK\r\n\r\n{", b"HTTP/1.1 200 OK\r\nContent-Length: 50\r\n\r\n{}"),
        response_bytes(500, {}, False),
        response_bytes(200, FIX | {"x": "far"}, False),
        ok(x=1e9),
        b"HTTP/1.1 200 OK\r\n\r\n" + json.dumps(FIX | {"x": math.nan}).encode(),
        b"HTTP/1.1 200 OK\r\n\r\n" + b"x" * 300_000,
        b"HTTP/1.1 200 OK\r\nContent-Length: 999999999\r\n\r\n",
    ],
)
def test_answers_that_are_none_are_counted(bad):
    port = free_port()
    with peer(answering(ok(), bad, ok(x=20.0)), port), UgpsSource(HOST, port, rate=50.0) as source:
        got = gather(source, 2)
        assert [r.value[0] for r in got] == [10.0, 20.0]
        assert source.dropped == 1


def test_kit_that_never_finishes(monkeypatch):
    """A byte now and then keeps no socket's time-out from starting anew; the whole request has one of its own."""
    monkeypatch.setattr("rovtwin.links.waterlinked.ugps_source.PATIENCE", 0.3)
    port = free_port()

    def drip(client):
        client.recv(4096)
        for _ in range(40):
            client.sendall(b"H")
            time.sleep(0.05)

    with peer(drip, port), UgpsSource(HOST, port, rate=50.0) as source:
        wait_until(lambda: "no whole answer" in source.status)
        assert source.read() == []


def test_kit_that_dies_and_comes_back():
    port = free_port()
    with UgpsSource(HOST, port, rate=50.0) as source:
        wait_until(lambda: "trying again" in source.status)
        for life in range(2):
            with serving(UgpsServer(port=port)) as served:
                wait_until(lambda: source.connections == life + 1, 8.0)  # noqa: B023
                served.feed(0.0, [reading("position", 0.0, float(life), 0.0)])
                (got,) = gather(source, 1)
                assert got.value[0] == life
            wait_until(lambda: "trying again" in source.status)
            assert source.read() == []


@pytest.mark.system
def test_closing_does_not_wait_for_the_kit():
    port = free_port()
    with peer(lambda client: time.sleep(1.0), port):
        source = UgpsSource(HOST, port)
        time.sleep(0.2)
        start = time.monotonic()
        source.close()
        assert time.monotonic() - start < 0.8
        assert not source._thread.is_alive()


def test_no_such_rate():
    with pytest.raises(LinkError, match="rate 0 Hz"):
        UgpsSource(HOST, rate=0.0)
