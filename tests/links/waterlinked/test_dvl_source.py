"""Listening to a DVL: what becomes of its reports, and of one that lies, dies or floods."""

import json
import math
import time

import numpy as np
import pytest
from tests.links.sensors import HOST, free_port, gather, peer, reading, wait_until
from tests.links.serving import serving

from rovtwin.core.errors import LinkError
from rovtwin.links.background import BACKLOG
from rovtwin.links.waterlinked.dvl_server import DvlServer
from rovtwin.links.waterlinked.dvl_source import DvlSource
from rovtwin.links.waterlinked.dvl_wire import VelocityReport, report_line


def line(k, **changes):
    values = {"velocity": (0.1 * k, 0.0, 0.0), "valid": True, "altitude": 2.0, "fom": 0.01}
    stamp = round(1e6 * (1.6e9 + 0.1 * k))
    values |= {"time_of_validity": stamp, "time_of_transmission": stamp + 20_000}
    return report_line(VelocityReport(**(values | changes)))


def sending(*lines, then=lambda client: client.recv(1)):
    def answer(client):
        for item in lines:
            client.sendall(item)
        then(client)

    return answer


def test_values_are_those_that_were_fed():
    port = free_port()
    with serving(DvlServer(port=port)) as served, DvlSource(HOST, port, altimeter=True) as source:
        wait_until(lambda: any("connected" in text for text in served.messages))
        offsets = []
        for k in range(10):
            t = 5.0 + 0.05 * k
            served.feed(t, [reading("altimeter", t, 3.0), reading("dvl", t, 0.1 * k, -0.2, 0.3)])
            offsets.append(time.monotonic() - t)
            time.sleep(0.05)
        got = gather(source, 20)
        velocities = [r for r in got if r.sensor == "dvl"]
        np.testing.assert_allclose([r.value for r in velocities], [[0.1 * k, -0.2, 0.3] for k in range(10)])
        assert [r.value.tolist() for r in got if r.sensor == "altimeter"] == [[3.0]] * 10
        # Times: those of the vehicle, but for a constant that is the offset of the clocks.
        late = np.array([r.t_valid - (5.0 + 0.05 * k) for k, r in enumerate(velocities)]) - np.array(offsets)
        assert np.abs(late).max() < 0.3
        assert source.connections == 1 and source.dropped == 0 and "connected" in source.status


def test_mounting_angle():
    port = free_port()
    with peer(sending(line(10)), port), DvlSource(HOST, port, rotation=math.pi / 2) as source:
        (got,) = gather(source, 1)
        np.testing.assert_allclose(got.value, [0.0, 1.0, 0.0], atol=1e-12)


def test_what_is_no_velocity_over_ground_is_quiet():
    port = free_port()
    water = json.dumps(json.loads(line(1)) | {"type": "velocity_water"}).encode() + b"\n"
    quiet = (line(1, valid=False), water, b'{"type": "new"}\n', line(1, altitude=-1.0))
    with peer(sending(*quiet, line(2)), port), DvlSource(HOST, port, altimeter=True) as source:
        got = gather(source, 3)
        assert [(r.sensor, r.value[0]) for r in got] == [("dvl", 0.1), ("dvl", 0.2), ("altimeter", 2.0)]
        assert source.dropped == 0


def test_garbage_between_reports_is_counted():
    port = free_port()
    bad = (b"{\n", b"\xff\xfe\n", line(1).replace(b"0.1,", b"NaN,", 1), line(1, velocity=(500.0, 0.0, 0.0)), b"\r\n")
    with peer(sending(line(1), *bad, line(2)), port), DvlSource(HOST, port) as source:
        got = gather(source, 2)
        assert [r.value[0] for r in got] == pytest.approx([0.1, 0.2])
        assert source.dropped == 4


def test_reports_in_pieces():
    port = free_port()
    whole = line(1) + line(2) + line(3)

    def answer(client):
        for start in range(0, len(whole), 97):
            client.sendall(whole[start : start + 97])
            time.sleep(0.002)
        client.recv(1)

    with peer(answer, port), DvlSource(HOST, port) as source:
        assert len(gather(source, 3)) == 3


def test_endless_line_is_left():
    """Memory stays bounded, and the source comes back later."""
    port = free_port()

    def answer(client):
        for _ in range(64):
            client.sendall(b"x" * 4096)

    with peer(answer, port) as visits, DvlSource(HOST, port) as source:
        wait_until(lambda: "not as a DVL does" in source.status)
        wait_until(lambda: visits[0] >= 2)
        assert source.read() == []


def test_flood_is_bounded():
    port = free_port()
    with peer(sending(b"".join(line(k % 50) for k in range(3000))), port), DvlSource(HOST, port) as source:
        wait_until(lambda: len(source._readings) == BACKLOG)
        assert len(source.read()) <= BACKLOG


def test_server_that_dies_and_comes_back():
    port = free_port()
    with DvlSource(HOST, port) as source:
        assert source.read() == []
        for life in range(2):
            with serving(DvlServer(port=port)) as served:
                wait_until(lambda: any("connected" in text for text in served.messages), 8.0)
                served.feed(0.0, [reading("dvl", 0.0, float(life), 0.0, 0.0)])
                (got,) = gather(source, 1)
                assert got.value[0] == life
            wait_until(lambda: "trying again" in source.status)
            assert source.read() == []
        assert source.connections == 2


def test_connection_that_is_silent_is_left(monkeypatch):
    """A DVL that lost power says nothing, not even good-bye."""
    monkeypatch.setattr("rovtwin.links.waterlinked.dvl_source.PATIENCE", 0.3)
    port = free_port()
    with peer(sending(line(1), then=lambda client: None), port) as visits, DvlSource(HOST, port) as source:
        wait_until(lambda: visits[0] >= 2)
        assert len(gather(source, 2)) >= 2


def test_clock_of_the_device_jumps():
    """NTP sets the DVL's clock by an hour: within two seconds times are right again, and never in the future."""
    now = [100.0]
    port = free_port()
    source = DvlSource(HOST, port, clock=lambda: now[0])
    source.close()  # the map alone is looked at: no thread
    times = []
    for k in range(100):
        now[0] = 100.0 + 0.1 * k
        stamp = round(1e6 * (1.6e9 + 0.1 * k + (3600.0 if k >= 50 else 0.0)))
        report = VelocityReport((0.0,) * 3, True, 1.0, 0.1, time_of_validity=stamp - 20_000, time_of_transmission=stamp)
        times.append(source._time(report, now[0]))
    error = np.array(times) - (100.0 + 0.1 * np.arange(100) - 0.02)
    assert np.abs(error[:50]).max() < 1e-6 and np.abs(error[62:]).max() < 1e-6
    assert np.abs(error).max() < 0.021


def test_no_such_port():
    with pytest.raises(LinkError, match="port 70000"):
        DvlSource(HOST, 70000)
