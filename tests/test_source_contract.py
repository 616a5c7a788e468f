"""The contract of `core.link.Source`, held by every Source in the package that is no Link, each on its own server.

Sources are found by importing the package; a new one gets its line in RIGS. Links have a contract of their own.
"""

import importlib
import inspect
import pkgutil
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field

import numpy as np
import pytest
from tests.links.sensors import HOST, free_port, reading, wait_until
from tests.links.serving import serving

import rovtwin.links
from rovtwin.core.flow import Measurement
from rovtwin.core.link import Link, Source
from rovtwin.links.server import Server
from rovtwin.links.waterlinked.dvl_server import DvlServer
from rovtwin.links.waterlinked.dvl_source import DvlSource
from rovtwin.links.waterlinked.ugps_server import UgpsServer
from rovtwin.links.waterlinked.ugps_source import UgpsSource

SIZES = {"position": 2, "pressure": 1, "accelerometer": 3, "gyro": 3, "attitude": 3, "dvl": 3, "altimeter": 1}
SIZES |= {"battery": 2, "leak": 1, "mocap": 6}
AT_ONCE = 0.5  # what counts as returning at once, on a busy machine [s]


@dataclass
class Rig:
    """A source and the vehicle whose instruments it listens to.

    Attributes:
        source: Open, its instrument reached.
        measure: Lets the vehicle measure everything once, a twentieth of a second after the last time.
        sensors: Names of the readings that one round of measuring gives.
    """

    source: Source
    measure: Callable[[], None]
    sensors: set[str]
    read: list[Measurement] = field(default_factory=list)

    def listen(self, rounds: int = 1) -> list[Measurement]:
        """Measure, and read until each round has come through."""
        got: list[Measurement] = []
        for _ in range(rounds):
            self.measure()
            came: list[Measurement] = []

            def whole(came=came) -> bool:
                came.extend(self.source.read())
                return {r.sensor for r in came} >= self.sensors

            wait_until(whole)
            got += came
        return got


@contextmanager
def served_rig(server: Server, open_source: Callable[[], Source], sensors: set[str], step: float) -> Iterator[Rig]:
    """A source on one of our own servers, on a vehicle that turns and moves."""
    with ExitStack() as stack:
        served = stack.enter_context(serving(server))
        source = stack.enter_context(open_source())
        k = [0]

        def measure() -> None:
            k[0] += 1
            t = step * k[0]
            batch = [
                reading("attitude", t, 0.0, 0.1, 0.01 * k[0]),
                reading("pressure", t, 2.0),
                reading("altimeter", t, 3.0),
                reading("dvl", t, 0.5, 0.01 * k[0], 0.0),
                reading("position", t, 1.0 + t, 2.0),
                reading("mocap", t, 1.0 + t, 2.0, 3.0, 0.0, 0.1, 0.01 * k[0]),
            ]
            served.feed(t, batch)

        rig = Rig(source, measure, sensors)
        reached = threading.Event()

        def received_of() -> bool:
            measure()
            if source.read():
                reached.set()
            return reached.is_set()

        wait_until(received_of, 10.0, every=0.05)
        time.sleep(0.1)  # what is still on its way comes in
        source.read()
        yield rig


def dvl_rig():
    port = free_port()
    return served_rig(DvlServer(port=port), lambda: DvlSource(HOST, port, altimeter=True), {"dvl", "altimeter"}, 0.05)


def ugps_rig():
    port = free_port()
    return served_rig(UgpsServer(port=port), lambda: UgpsSource(HOST, port, rate=50.0), {"position"}, 0.25)


def qtm_rig():
    pytest.importorskip("qtm_rt", reason="pip install 'rovtwin[qualisys]'")
    from rovtwin.links.qualisys.server import QtmServer
    from rovtwin.links.qualisys.source import SENSORS, QtmSource

    port = free_port()
    return served_rig(QtmServer(port=port), lambda: QtmSource(HOST, port=port, sensors=SENSORS), set(SENSORS), 0.05)


RIGS = {
    "qualisys.source.QtmSource": qtm_rig,
    "waterlinked.dvl_source.DvlSource": dvl_rig,
    "waterlinked.ugps_source.UgpsSource": ugps_rig,
}


def find_sources() -> set[str]:
    """Every concrete Source of the package that is no Link, by module and name."""
    for found in pkgutil.walk_packages(rovtwin.links.__path__, "rovtwin.links."):
        importlib.import_module(found.name)
    sources, rest = set(), [Source]
    while rest:
        for cls in rest.pop().__subclasses__():
            rest.append(cls)
            if (
                cls.__module__.startswith("rovtwin.links.")
                and not inspect.isabstract(cls)
                and not issubclass(cls, Link)
            ):
                sources.add(f"{cls.__module__}.{cls.__qualname__}".removeprefix("rovtwin.links."))
    return sources


def test_every_source_has_a_rig():
    missing, gone = sorted(find_sources() - RIGS.keys()), sorted(RIGS.keys() - find_sources())
    assert not missing, f"add a rig to RIGS in {__name__} for: {', '.join(missing)}"
    assert not gone, f"no such Source any more, take it out of RIGS: {', '.join(gone)}"


@pytest.fixture(params=sorted(RIGS))
def rig(request):
    with RIGS[request.param]() as rig:
        yield rig


def timed(call: Callable[[], object]) -> object:
    start = time.monotonic()
    result = call()
    assert time.monotonic() - start < AT_ONCE, "did not return at once"
    return result


def test_readings(rig):
    """A list of Measurements of known names and sizes, finite, each valid before now and none before the last."""
    got = rig.listen(10)
    assert {r.sensor for r in got} == rig.sensors
    for r in got:
        assert isinstance(r, Measurement)
        assert isinstance(r.value, np.ndarray) and r.value.dtype == float and r.value.shape == (SIZES[r.sensor],)
        assert np.isfinite(r.value).all() and np.isfinite(r.t_valid)
        assert r.t_valid <= time.monotonic()
    for sensor in rig.sensors:
        times = [r.t_valid for r in got if r.sensor == sensor]
        assert times == sorted(times)


def test_none_lost_none_twice(rig):
    """Ten rounds are ten readings of each sensor."""
    got = rig.listen(10)
    time.sleep(0.1)
    got += rig.source.read()
    for sensor in rig.sensors:
        assert len([r for r in got if r.sensor == sensor]) == 10


def test_values_are_the_callers(rig):
    """Writing into what was read changes nothing that is read later."""
    first = rig.listen()
    for r in first:
        r.value[:] = -1e3
    assert all((r.value > -1e3).all() for r in rig.listen())


def test_quiet_is_no_error(rig):
    """Nothing new is an empty list, however often one asks, and at once."""
    for _ in range(5):
        assert timed(rig.source.read) == []


def test_close_twice(rig):
    rig.listen()
    rig.measure()
    timed(rig.source.close)
    timed(rig.source.close)
    assert rig.source.read() == []
    rig.measure()
    time.sleep(0.15)
    assert rig.source.read() == []


def test_leaving_a_with_block_closes(rig):
    with rig.source as source:
        assert source is rig.source
        assert rig.listen()
    rig.measure()
    time.sleep(0.15)
    assert rig.source.read() == []


def test_error_inside_a_with_block_comes_out(rig):
    with pytest.raises(ZeroDivisionError), rig.source:
        raise ZeroDivisionError


def test_closing_leaves_no_thread(rig):
    name = rig.source.where
    assert any(thread.name == name for thread in threading.enumerate())
    rig.source.close()
    wait_until(lambda: not any(thread.name == name for thread in threading.enumerate()))
