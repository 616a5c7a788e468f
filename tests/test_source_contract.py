"""The contract of `core.link.Source`, held by every Source in the package that is no Link, each on its own server.

Sources are found by importing the package; a new one gets its line in RIGS. Links have a contract of their own.
"""

import importlib
import inspect
import pkgutil
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import pytest
from tests.links.sensors import HOST, free_port, reading, wait_until
from tests.links.serving import serving

import rovtwin.links
from rovtwin.core.link import Link, Source
from rovtwin.links.cerulean.source import CeruleanSource
from rovtwin.links.cerulean.wire import checksum
from rovtwin.links.servers.server import Server
from rovtwin.links.waterlinked.dvl_server import DvlServer
from rovtwin.links.waterlinked.dvl_source import DvlSource
from rovtwin.links.waterlinked.ugps_server import UgpsServer
from rovtwin.links.waterlinked.ugps_source import UgpsSource
from rovtwin.testing.source import CLAUSES, SourceRig


@contextmanager
def served_rig(
    server: Server, open_source: Callable[[], Source], sensors: set[str], step: float
) -> Iterator[SourceRig]:
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

        rig = SourceRig(source, measure, sensors, {"mocap": 6}, getattr(source, "where", ""))
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


@contextmanager
def cerulean_rig() -> Iterator[SourceRig]:
    """A DVL that sends a sentence each time it measures."""
    port, k = free_port(), [0]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as dvl, CeruleanSource(HOST, port) as source:

        def measure() -> None:
            k[0] += 1
            body = f"DVPDX,{50_000 * k[0]},50000,0,0,0,0.02,0.001,0,90,1,0,0,3.0"
            dvl.sendto(f"${body}*{checksum(body):02X}\r\n".encode(), (HOST, port))

        def reached() -> bool:
            measure()
            return bool(source.connections)

        wait_until(reached, 10.0, every=0.05)
        time.sleep(0.1)  # what is still on its way comes in
        source.read()
        yield SourceRig(source, measure, {"dvl", "altimeter"}, thread=source.where)


RIGS = {
    "cerulean.source.CeruleanSource": cerulean_rig,
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


@pytest.mark.parametrize("clause", CLAUSES, ids=lambda clause: clause.__name__)
def test_it_holds(rig, clause):
    """The clauses are `rovtwin.testing.source`'s, which instruments of other packages are held to as well."""
    clause(rig)
