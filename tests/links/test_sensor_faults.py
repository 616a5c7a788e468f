"""Instruments over a wire that misbehaves: no reading that was not measured, and readings again once it is whole."""

import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest
from tests.links.faults.wire import Fault, Loop, TcpProxy, Wire
from tests.links.sensors import HOST, free_port, reading
from tests.links.serving import serving

from rovtwin.links.qualisys.server import QtmServer
from rovtwin.links.qualisys.source import QtmSource
from rovtwin.links.waterlinked.dvl_server import DvlServer
from rovtwin.links.waterlinked.dvl_source import DvlSource
from rovtwin.links.waterlinked.ugps_server import UgpsServer
from rovtwin.links.waterlinked.ugps_source import UgpsSource

KINDS = {
    "dvl": (DvlServer, lambda port: DvlSource(HOST, port)),
    "ugps": (UgpsServer, lambda port: UgpsSource(HOST, port, rate=20.0)),
    "qtm": (QtmServer, lambda port: QtmSource(HOST, port=port, sensors=("position",))),
}
FAULTS = {
    "delay": Fault(delay=0.5),
    "torn": Fault(cut=0.2),
    "garbage": Fault(garbage=0.2),
    "half-open": Fault(hole=True),
}
TRUTH = {"dvl": [0.5, -0.25, 0.125], "position": [12.0, -7.0]}


@contextmanager
def fed(served):
    """The vehicle's readings in real time; its place moves a little, so that every fix is a new one."""
    end = threading.Event()

    def feed() -> None:
        k = 0
        while not end.wait(0.02):
            k += 1
            moved = np.array([12.0 + 0.01 * (k % 2), -7.0])
            pose = np.array([*moved, 2.0, 0.0, 0.0, 0.3])
            batch = {"dvl": TRUTH["dvl"], "altimeter": [3.0], "position": moved, "mocap": pose, "attitude": pose[3:]}
            served.feed(0.02 * k, [reading(name, 0.02 * k, *value) for name, value in batch.items()])

    thread = threading.Thread(target=feed, daemon=True)
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join()


class SensorMux:
    """Reads on and looks at what it reads."""

    def __init__(self, source):
        self.source, self.last = source, -np.inf

    def received(self, count: int, seconds: float) -> int:
        """Number of readings until there are so many, or the time is over."""
        end, found = time.monotonic() + seconds, 0
        while found < count and time.monotonic() < end:
            for one in self.source.read():
                np.testing.assert_allclose(one.value, TRUTH[one.sensor], atol=0.02)
                assert self.last <= one.t_valid <= time.monotonic(), "times go back, or ahead"
                self.last, found = one.t_valid, found + 1
            time.sleep(0.01)
        return found


@pytest.mark.system
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("fault", FAULTS)
def test_wrong_readings_never_and_right_ones_again(kind, fault):
    threads: list[str] = []
    with pytest.MonkeyPatch.context() as patch, Loop() as loop:
        patch.setattr(threading, "excepthook", lambda what: threads.append(str(what.exc_value)))
        server, source_of = KINDS[kind]
        here, there, wire = free_port(), free_port(), Wire()
        proxy = loop.open(TcpProxy(wire, (HOST, here), (HOST, there)))
        with serving(server(port=there)) as served, fed(served), source_of(here) as source:
            mux = SensorMux(source)
            assert mux.received(5, 20.0) == 5
            wire.set(down=FAULTS[fault]) if fault != "half-open" else wire.set(FAULTS[fault])
            mux.received(10_000, 1.0)
            wire.mend()
            if fault == "half-open":
                loop.run(proxy.reset())
            assert mux.received(5, 30.0) == 5, source.status
        assert not threads, threads
