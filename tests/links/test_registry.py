"""The registry of endpoints: what each of them says holds, those of other packages are found, broken ones are named."""

import importlib.util
import pickle
import sys

import pytest
from tests.packages import install

from rovtwin.core.errors import ConfigError
from rovtwin.core.sensors import SENSORS
from rovtwin.links import registry
from rovtwin.links.endpoint import Endpoint
from rovtwin.links.url import Url
from rovtwin.live.connect import connect, described, opener, source
from rovtwin.live.serving.beforehand import command_line
from rovtwin.live.serving.protocols import known, servers_of, world_for
from rovtwin.runs.pace import Clock
from rovtwin.scenario.files import load_scenario

PLUGIN = """
from functools import partial
from pathlib import Path

from rovtwin.core.link import Source
from rovtwin.links.endpoint import Endpoint
from rovtwin.links.servers.server import Server

class Ping(Source):
    def __init__(self, host): self.host = host
    def read(self): return []
    def close(self): pass

class PingServer(Server):
    host = "127.0.0.1"
    addresses = ["127.0.0.1"]
    async def run(self, station): pass

PING = Endpoint("ping", "ping://HOST", "a sonar", sensors=("altimeter",), options={"loud": "DB"},
                source=lambda url, clock: Ping(url.rest), server=lambda context, where: PingServer(),
                note=lambda url: "loud" if url.options else "quiet", reached=lambda server: f"ping://{server.host}")
OWN = Endpoint("own", "own://HOST", "a vehicle", link=lambda url, context: partial(Path, url.rest))
BLUEYE = Endpoint("blueye", "blueye://..", "not the real one")
WRONG = 3
"""


@pytest.fixture
def plugin(tmp_path, monkeypatch):
    names = {"ping": "pinger:PING", "own": "pinger:OWN", "blueye": "pinger:BLUEYE", "gone": "pinger:GONE"}
    points = {"rovtwin.links": names | {"wrong": "pinger:WRONG", "other": "pinger:PING", "missing": "nowhere:X"}}
    monkeypatch.syspath_prepend(install(tmp_path / "site", "pinger", PLUGIN, points))
    yield
    sys.modules.pop("pinger", None)


def test_endpoints_of_installed_packages_take_part(plugin):
    with source("ping://10.0.0.2?loud=3", Clock()) as ping:
        assert ping.host == "10.0.0.2"
    assert described("ping://10.0.0.2?loud=3").endswith(": loud")
    with pytest.raises(ConfigError, match="found the option 'quiet', expected loud=DB"):
        source("ping://10.0.0.2?quiet", Clock())
    opened = opener("own://7", load_scenario("square"), Clock())
    assert str(pickle.loads(pickle.dumps(opened))()) == "7"
    assert known(["ping"]) == ["ping"]
    scenario = world_for("bluerov2_heavy", [], None)
    vehicle = type("Vehicle", (), {"drones": ("",), "largest": {"": [1.0] * 6}})()
    servers = servers_of(["mavlink", "ping"], scenario, vehicle, {})
    assert "--sensor ping://127.0.0.1" in command_line("square", False, servers)


def test_broken_ones_are_named_and_disturb_nobody(plugin):
    found = dict(registry.found())
    assert isinstance(found["ping"], Endpoint) and isinstance(found["dvl"], Endpoint)
    failures = {name: str(one) for name, one in registry.found() if isinstance(one, ConfigError)}
    assert failures.keys() == {"blueye", "gone", "wrong", "other", "missing"}
    assert "found an entry point of that name, expected another" in failures["blueye"]
    assert "found no 'GONE' in pinger" in failures["gone"]
    assert "found int, expected a rovtwin.links.endpoint.Endpoint" in failures["wrong"]
    assert "found an endpoint of ping://" in failures["other"]
    assert "found no module 'nowhere'" in failures["missing"]
    with pytest.raises(
        ConfigError, match="expected one of twin://, replay://, blueye://, mavlink://, ros2://, own://$"
    ):
        connect("ftp://1.2.3.4", load_scenario("square"), Clock())
    with pytest.raises(ConfigError, match="missing.*nowhere.*install its package"):
        connect("missing://1.2.3.4", load_scenario("square"), Clock())


@pytest.mark.parametrize("scheme", registry.BUILT_IN)
def test_an_endpoint_is_what_it_says(scheme):
    one = registry.find(scheme)
    assert one is not None and one.scheme == scheme
    assert any((one.link, one.source, one.server, one.firmware)), "it can do nothing"
    assert set(one.sensors) <= SENSORS.keys()
    if one.link or one.source:
        assert all(form.startswith(f"{scheme}://") for form in one.address.split(", "))
    assert not one.gives_position or "position" in one.sensors
    if one.requires:
        module, extra = one.requires
        assert importlib.util.find_spec(module.split(".")[0]) is None or extra in _extras()


def _extras() -> list[str]:
    from importlib.metadata import metadata

    return metadata("rovtwin").get_all("Provides-Extra") or []


def test_what_a_server_is_reached_by_is_an_address_of_its_link_or_source():
    scenario = world_for("blueye_pioneer", [], None)
    vehicle = type("Vehicle", (), {"drones": ("",), "largest": {"": [10.0, 5.0, 11.0, 1.0, 1.0, 1.0]}})()
    names = registry.names_of("server", of=registry.built_in())
    for name, server in servers_of(names, scenario, vehicle, {}).items():
        one = registry.find(name)
        assert one is not None
        url, _ = registry.parse(one.reached(server), "link" if one.link else "source", "")
        assert url.scheme == name and one.is_simulated(url)


def test_listing_needs_no_numerics():
    """Help names the protocols at every start: endpoints import drivers when they open one."""
    import subprocess

    code = "import sys; from rovtwin.links.registry import forms; forms('link'); print('numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


@pytest.mark.parametrize(
    "rest, own",
    [
        ("127.0.0.1:8080", True),
        ("udpin:127.0.0.1:14550", True),
        ("127.0.0.2,127.0.0.3", True),
        ("127.0.0.1,rov.local", False),
        ("127.0.0.1.example.com", False),
        ("192.168.1.101", False),
        ("", False),
    ],
)
def test_only_addresses_of_this_machine_by_number_are_its_own(rest, own):
    assert Url("", "x", rest).is_loopback is own


def test_a_protocol_that_serves_no_clients_is_refused_where_clients_are_served():
    scenario = world_for("bluerov2_heavy", [], None)
    vehicle = type("Vehicle", (), {"drones": ("",), "largest": {"": [1.0] * 6}, "fastest": [1.0] * 6})()
    with pytest.raises(ConfigError, match="ardusub-json: found a protocol that serves no clients"):
        servers_of(["ardusub-json"], scenario, vehicle, {})
