"""The contract of `core.link.Link`, held by every Link in the package, each on a vehicle the test can look at.

Links are found by importing the package; a new one gets its line in RIGS.
"""

import importlib
import inspect
import pkgutil
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager

import numpy as np
import pytest
from tests.links.ros2.fake import FakeVehicle
from tests.links.vehicles import PlainLink, ThreadHosted

import rovtwin.links
from rovtwin.core.flow import Measurement, Slot
from rovtwin.core.link import Link
from rovtwin.core.log import Channel, Log
from rovtwin.links.replay import ReplayLink
from rovtwin.links.twin import TwinLink
from rovtwin.testing import source
from rovtwin.testing.link import CLAUSES, LinkRig

THRUSTERS = 3
PERIOD = 0.02


@contextmanager
def twin_rig() -> Iterator[LinkRig]:
    """The twin's link on a vehicle of two sensors, one at every period and one at every fifth."""
    now, thrusters = [0.0], [np.zeros(THRUSTERS)]

    def advance(memory, command, k):
        thrusters[0] = np.array(command.u)
        t = (k + 1) * PERIOD
        slow = k % 5 == 4
        depth = Slot(np.array([[2.0 + t]]), np.array([True]), np.array([t]))
        position = Slot(np.array([[1.0, t]]) * slow, np.array([slow]), np.array([t]) * slow)
        return memory + 1, {"pressure": depth, "position": position}

    link = TwinLink(advance, 0, THRUSTERS, PERIOD, lambda: now[0])

    def wait(seconds: float) -> None:
        now[0] += seconds

    def listen() -> list[Measurement]:
        # The twin moves when it is read, one period at a time.
        return [reading for _ in range(round(now[0] / PERIOD) - link.tick + 1) for reading in link.read()]

    def applied() -> np.ndarray:
        wait(PERIOD)
        listen()
        return thrusters[0]

    with link:
        yield LinkRig(link, wait, listen, applied)


@contextmanager
def replay_rig() -> Iterator[LinkRig]:
    """A log of two sensors, and a clock by hand."""
    now, t = [0.0], PERIOD * np.arange(1, 500)
    depth = Channel("sensor/pressure", ("depth", "t_valid"), ("m", "s"), "n")
    rates = Channel("sensor/gyro", tuple("xyz"), "rad/s", "b")
    data = {"sensor/pressure": (t, np.stack([2.0 + t, t], axis=1)), "sensor/gyro": (t[4::5], np.zeros((99, 3)))}
    link = ReplayLink(Log.from_arrays([depth, rates], data), THRUSTERS, lambda: now[0])

    def wait(seconds: float) -> None:
        now[0] += seconds

    with link:
        yield LinkRig(link, wait, link.read, lambda: link.command)


@contextmanager
def remote_rig() -> Iterator[LinkRig]:
    """A link that believes every command for ever, hosted in a thread; the process is tested by itself."""
    inner: list[PlainLink] = []

    def opener() -> PlainLink:
        inner.append(PlainLink())
        return inner[0]

    link = ThreadHosted(opener, THRUSTERS)

    def applied() -> np.ndarray:
        time.sleep(0.05)
        return inner[0].u

    with link:
        yield LinkRig(link, time.sleep, lambda: (time.sleep(0.1), link.read())[1], applied)


@contextmanager
def blueye_rig(double: bool) -> Iterator[LinkRig]:
    """A link to one Blueye, or to two, behind our own server; its time is the test's, real time only lets it work."""
    from tests.links.blueye.rig import BlueyeRig

    rig = BlueyeRig(double, PERIOD)
    with closing(rig), rig.link:
        yield LinkRig(rig.link, rig.wait, rig.listen, rig.applied, 2 if double else 1)


@contextmanager
def mavlink_rig() -> Iterator[LinkRig]:
    """An ArduSub's link on the twin's own endpoint, armed; three axes stand for three thrusters."""
    pytest.importorskip("pymavlink", reason="pymavlink is not installed: pip install 'rovtwin[mavlink]'")
    from tests.links.mavlink.vehicle import endpoint, measured, soon
    from tests.links.serving import serving

    from rovtwin.links.mavlink.link import MavlinkLink
    from rovtwin.links.mavlink.telemetry.streams import RATES

    axes = [0, 1, 5]
    off = dict.fromkeys(RATES, 0.0)
    server = endpoint(tcp_port=None, rates=off, gain=1.0)
    with serving(server) as served:
        assert soon(lambda: bool(served.messages))
        served.feed(0.0, measured(0.0))
        expected = off | {"ATTITUDE": 50.0, "SCALED_PRESSURE2": 50.0}
        with MavlinkLink(f"udpout:127.0.0.1:{server.udp_port}", np.eye(6)[:, axes], rates=expected) as link:
            yield _armed(link, served, measured, axes)


def _armed(link, served, measured, axes) -> LinkRig:
    link.arm()
    tick = [0]

    def wait(seconds: float) -> None:
        for _ in range(round(seconds / PERIOD)):
            tick[0] += 1
            served.feed(tick[0] * PERIOD, measured(tick[0] * PERIOD))
            time.sleep(PERIOD)

    def listen() -> list[Measurement]:
        time.sleep(0.05)
        return link.read()

    # The link asks for a stream of 2 Hz for the gain in force: the battery's one reading in it has no rate to hold.
    wait(3 * PERIOD)
    listen()

    def applied() -> np.ndarray:
        time.sleep(0.08)
        command = served.commands[-1] if served.commands else None
        return np.array(command.motion)[axes] if command and command.armed else np.zeros(THRUSTERS)

    return LinkRig(link, wait, listen, applied)


@contextmanager
def ros2_rig() -> Iterator[LinkRig]:
    """A ROS 2 vehicle that obeys `cmd_thrusters`, without a network."""
    vehicle = FakeVehicle(THRUSTERS, PERIOD)
    vehicle.link.arm()
    with vehicle.link:
        yield LinkRig(vehicle.link, vehicle.wait, vehicle.link.read, vehicle.applied)


RIGS: dict[str, Callable[[], AbstractContextManager[LinkRig]]] = {
    "twin.TwinLink": twin_rig,
    "mavlink.link.MavlinkLink": mavlink_rig,
    "ros2.link.Ros2Link": ros2_rig,
    "replay.ReplayLink": replay_rig,
    "remote_link.RemoteLink": remote_rig,
    "blueye.link.BlueyeLink": lambda: blueye_rig(double=False),
    "blueye.double.DoubleBlueyeLink": lambda: blueye_rig(double=True),
}


def find_links() -> set[str]:
    """Every concrete Link of the package by module and name."""
    for found in pkgutil.walk_packages(rovtwin.links.__path__, "rovtwin.links."):
        importlib.import_module(found.name)
    links, rest = set(), [Link]
    while rest:
        for cls in rest.pop().__subclasses__():
            rest.append(cls)
            # The console's twin may be armed again after a stop: tests/console/engine/test_world.py.
            if cls.__module__.startswith("rovtwin.links.") and not inspect.isabstract(cls):
                links.add(f"{cls.__module__}.{cls.__qualname__}".removeprefix("rovtwin.links."))
    return links


def test_every_link_has_a_rig():
    missing, gone = sorted(find_links() - RIGS.keys()), sorted(RIGS.keys() - find_links())
    assert not missing, f"add a rig to RIGS in {__name__} for: {', '.join(missing)}"
    assert not gone, f"no such Link any more, take it out of RIGS: {', '.join(gone)}"


@pytest.fixture(params=sorted(RIGS))
def rig(request):
    with RIGS[request.param]() as rig:
        yield rig


@pytest.mark.parametrize("clause", CLAUSES, ids=lambda clause: clause.__name__)
def test_it_holds(rig, clause):
    """The clauses are `rovtwin.testing.link`'s, which links of other packages are held to as well."""
    clause(rig)


def test_links_and_sources_keep_one_clause_of_with_blocks():
    assert set(CLAUSES) & set(source.CLAUSES) == {source.lets_errors_out_of_a_with_block}
