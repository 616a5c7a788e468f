"""Cerulean's DVLs: the vendor's own line, sentences that lie, and what becomes of them as readings."""

import socket
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.links.sensors import HOST, free_port, gather, wait_until

from rovtwin.core.errors import LinkError
from rovtwin.links.cerulean.source import CeruleanSource
from rovtwin.links.cerulean.wire import checksum, parse
from rovtwin.live.connect import described, source
from rovtwin.runs.pace import Clock

# docs.ceruleansonar.com, "$DVPDL and $DVPDX", example: its checksum there, 22, is not that of its bytes, 6E. The two
# lines that users of a DVL-75 recorded without bottom lock have theirs right.
PUBLISHED = b"$DVPDL,101234000,50000,0.001263,-0.019663,-0.745226,-0.000,0.001,-0.005,100*6E"
RECORDED = (
    b"$DVPDL,160401000,100000,0.000000,-0.000000,-0.000000,0.000,-0.000,-0.000,0*55",
    b"$DVPDL,3735501000,200000,0.000000,-0.000000,-0.000000,0.000,-0.000,-0.000,0*62",
)


def sentence(k, moved=(0.05, -0.02, 0.01), confidence=95, interval=0.1, standoff=None):
    x, y, z = moved
    name = "DVPDL" if standoff is None else "DVPDX"
    body = f"{name},{round(1e5 * k)},{round(1e6 * interval)},0,0,0,{x},{y},{z},{confidence}"
    body += "" if standoff is None else f",1,0.5,-0.5,{standoff}"
    return f"${body}*{checksum(body):02X}\r\n".encode()


def test_the_vendors_line():
    deltas = parse(PUBLISHED)
    assert deltas is not None and deltas.standoff is None
    assert (deltas.time, deltas.interval, deltas.confidence) == pytest.approx((101.234, 0.05, 100.0))
    assert deltas.moved == (0.0, 0.001, -0.005)
    assert [parse(line).confidence for line in RECORDED] == [0.0, 0.0]
    assert parse(b"$DVTXT,hello*%02X" % checksum("DVTXT,hello")) is None


@pytest.mark.parametrize(
    ("line", "why"),
    [
        (PUBLISHED.replace(b"*6E", b"*22"), "checksum '22', expected 6E"),
        (PUBLISHED.partition(b"*")[0], "expected \\$..\\*hh"),
        (b"$DVPDL,1,2*%02X" % checksum("DVPDL,1,2"), "found 2 fields"),
        (b"$DVPDL,a,2*%02X" % checksum("DVPDL,a,2"), "expected numbers"),
        (b"\xff\xfe", "no text"),
        (b"", "expected"),
    ],
)
def test_lines_that_lie(line, why):
    with pytest.raises(LinkError, match=why):
        parse(line)


@given(st.binary(max_size=200))
def test_nothing_but_link_errors(data):
    try:
        parse(data)
    except LinkError:
        pass


def send(port, *lines, sender):
    for line in lines:
        sender.sendto(line, (HOST, port))


def test_readings_are_the_mean_velocity_in_the_middle_of_the_interval():
    port = free_port()
    dvl, other = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    with dvl, other, CeruleanSource(HOST, port) as listening:
        for k in range(1, 40):
            send(port, sentence(k, standoff=1.5), sender=dvl)
            time.sleep(0.01)
            if listening.connections:
                break
        wait_until(lambda: listening.connections == 1)
        listening.read()
        send(port, sentence(100), sentence(101, standoff=2.5), sender=dvl)
        got = gather(listening, 3)
        velocities = [r for r in got if r.sensor == "dvl"]
        np.testing.assert_allclose([r.value for r in velocities], [[0.5, -0.2, 0.1]] * 2)
        (height,) = [r for r in got if r.sensor == "altimeter"]
        assert height.value.tolist() == [2.5]
        before = listening.dropped
        send(port, sentence(102, confidence=0), sentence(103, interval=0.0), sentence(104, (9.0, 0, 0)), sender=dvl)
        send(port, sentence(105), sender=other)
        wait_until(lambda: listening.dropped == before + 3)
        assert listening.read() == []


def test_a_dvl_that_falls_silent_is_not_connected(monkeypatch):
    monkeypatch.setattr("rovtwin.links.cerulean.source.SILENT", 0.3)
    port = free_port()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as dvl, CeruleanSource(HOST, port) as listening:

        def speaks(times):
            for k in range(50):
                send(port, sentence(k), sender=dvl)
                time.sleep(0.02)
                if listening.connections == times:
                    return listening.status.endswith(": connected")
            return False

        assert speaks(1)
        wait_until(lambda: "nothing received for 0.3 s" in listening.status)
        assert speaks(2)


def test_by_its_address():
    assert described("cerulean://0.0.0.0:27000").endswith("forward, starboard, down")
    with source(f"cerulean://127.0.0.1:{free_port()}?flu", Clock()) as listening:
        assert listening._sign == -1.0
