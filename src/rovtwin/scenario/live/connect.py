"""From URLs to links and sources: `blueye://192.168.1.101`, `replay://run.mcap`, `dvl://192.168.194.95`."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import numpy as np

from rovtwin.core.errors import ConfigError
from rovtwin.core.link import Link, Source
from rovtwin.core.log import Log
from rovtwin.core.numerics import jax
from rovtwin.links.hosted import HostedLink
from rovtwin.links.replay import ReplayLink
from rovtwin.links.twin import TwinLink
from rovtwin.scenario.composition import compose, vehicle_of, water_density
from rovtwin.scenario.pace import Clock
from rovtwin.scenario.schema import Scenario
from rovtwin.simulation.twin import TwinInput


@dataclass(frozen=True)
class Url:
    """An address as the user gave it: `scheme://rest?options`."""

    text: str
    scheme: str
    rest: str

    @classmethod
    def of(cls, text: str, known: dict[str, Any], option: str) -> "Url":
        """Taken apart.

        Raises:
            ConfigError: No scheme, or one that nobody speaks.
        """
        scheme, found, rest = text.partition("://")
        if not found or scheme not in known:
            names = ", ".join(f"{name}://" for name in known)
            raise ConfigError(
                f"{option} {text}: found {'no scheme' if not found else repr(scheme)}, expected one of {names}"
            )
        return cls(text, scheme, unquote(rest))

    def host_port(self, port: int) -> tuple[str, int]:
        """Host and port, the latter as given or the protocol's own.

        Raises:
            ConfigError: There is no host, or the port is no number.
        """
        try:
            parts = urlsplit(f"//{self.rest}")
            host, given = parts.hostname, parts.port
        except ValueError as error:
            raise ConfigError(f"{self.text}: {error}, expected {self.scheme}://HOST[:PORT]") from None
        if not host:
            raise ConfigError(f"{self.text}: found no host, expected {self.scheme}://HOST[:PORT]")
        return host, given or port


def connect(text: str, scenario: Scenario, clock: Clock, observe: bool = False) -> Link:
    """The vehicle at a URL, open. A real one is held by a process of its own, which outlives ours.

    Args:
        text: The URL.
        scenario: Its vehicle, and for `twin://` its world.
        clock: That readings are stamped with.
        observe: Only look: where the protocol tells pilots from watchers, be one of these.

    Raises:
        ConfigError: The URL cannot be used, or not for this vehicle.
        LinkError: Nobody answers there.
    """
    url = Url.of(text, LINKS, "--link")
    if observe and url.scheme == "blueye":
        return _blueye(url, scenario, clock, observe)
    return LINKS[url.scheme](url, scenario, clock)


def source(text: str, clock: Clock) -> Source:
    """The instrument at a URL, open.

    Raises:
        ConfigError: The URL cannot be used.
        LinkError: Its driver is not installed.
    """
    url = Url.of(text, SOURCES, "--sensor")
    return SOURCES[url.scheme](url, clock)


def _twin(url: Url, scenario: Scenario, clock: Clock) -> Link:
    composed = compose(scenario)
    twin, dt = composed.loop.twin, scenario.control_dt
    memory = twin.init(jax.random.split(composed.key)[1], composed.start)
    step = jax.jit(lambda twin, memory, command, k: twin.step(memory, TwinInput(command, k), dt))

    def advance(memory: Any, command: Any, k: int) -> Any:
        memory, moved = step(twin, memory, command, k)
        return memory, moved.measurements

    count = twin.model.thrusters.count
    return TwinLink(advance, memory, count, dt, clock)


def _replay(url: Url, scenario: Scenario, clock: Clock) -> Link:
    return ReplayLink(Log.read(Path(url.rest)), len(vehicle_of(scenario).thruster_names), clock)


def _hosted(opener: Callable[[], Link], scenario: Scenario) -> Link:
    return HostedLink(opener, len(vehicle_of(scenario).thruster_names))


def _thrusters(scenario: Scenario) -> Any:
    """The vehicle's thrusters as NumPy arrays, which another process takes without starting JAX."""
    return jax.tree.map(np.asarray, vehicle_of(scenario).model().thrusters)


@dataclass(frozen=True)
class _Blueye:
    """Opens one drone, or two as one vehicle, in the host's process."""

    hosts: tuple[str, ...]
    thrusters: Any
    clock: Clock
    observe: bool

    def __call__(self) -> Link:
        from rovtwin.links.blueye.double import DoubleBlueyeLink
        from rovtwin.links.blueye.link import BlueyeLink
        from rovtwin.links.blueye.thrust import force_shares

        if len(self.hosts) == 1:
            curve = force_shares(self.thrusters, range(3))
            return BlueyeLink(self.hosts[0], curve=curve, clock=self.clock, observer=self.observe)
        curves = [force_shares(self.thrusters, range(3 * i, 3 * i + 3)) for i in range(2)]
        return DoubleBlueyeLink(self.hosts, curves=curves, clock=self.clock, observer=self.observe)


def _blueye(url: Url, scenario: Scenario, clock: Clock, observe: bool = False) -> Link:
    hosts = tuple(host.strip() for host in url.rest.split(",") if host.strip())
    vehicle = vehicle_of(scenario)
    ends = [name.split(".")[-1] for name in vehicle.thruster_names]
    drones = len(ends) // 3
    if ends != ["surge", "sway", "heave"] * drones or drones not in (1, 2):
        raise ConfigError(
            f"--link {url.text}: {vehicle.name} has the thrusters {', '.join(vehicle.thruster_names)}, expected surge, "
            "sway, heave of one Blueye or two, as blueye_pioneer and double_blueye have them"
        )
    if len(hosts) != drones:
        raise ConfigError(
            f"--link {url.text}: found {len(hosts)} addresses, expected {drones} for {vehicle.name}: "
            f"blueye://{'192.168.1.101' if drones == 1 else 'PORT,STARBOARD'}"
        )
    return _hosted(_Blueye(hosts, _thrusters(scenario), clock, observe), scenario)


@dataclass(frozen=True)
class _Mavlink:
    """Opens an ArduSub vehicle in the host's process."""

    url: str
    thrusters: Any
    clock: Clock
    density: float

    def __call__(self) -> Link:
        from rovtwin.links.mavlink.link import MavlinkLink
        from rovtwin.links.mavlink.mixing import shares
        from rovtwin.links.mavlink.readings import Readings

        readings = Readings(density=self.density)
        return MavlinkLink(self.url, shares(self.thrusters), clock=self.clock, readings=readings)


def _mavlink(url: Url, scenario: Scenario, clock: Clock) -> Link:
    return _hosted(_Mavlink(url.rest, _thrusters(scenario), clock, water_density(scenario)), scenario)


@dataclass(frozen=True)
class _Ros2:
    """Opens a ROS 2 vehicle in the host's process."""

    namespace: str
    thrusters: Any
    clock: Clock
    expose: bool
    density: float

    def __call__(self) -> Link:
        from rovtwin.links.mavlink.mixing import mixer
        from rovtwin.links.ros2.convert import Water
        from rovtwin.links.ros2.link import Ros2Link

        return Ros2Link(
            self.namespace,
            self.thrusters.count,
            clock=self.clock,
            wrench=mixer(self.thrusters).wrench,
            sources={"position": "position", "dvl": "dvl"},
            water=Water(density=self.density),
            expose=self.expose,
        )


def _ros2(url: Url, scenario: Scenario, clock: Clock) -> Link:
    namespace, _, option = url.rest.partition("?")
    if option not in ("", "expose"):
        raise ConfigError(f"--link {url.text}: found ?{option}, expected ros2://NAMESPACE or ros2://NAMESPACE?expose")
    name = namespace.strip("/") or "rov"
    return _hosted(_Ros2(name, _thrusters(scenario), clock, bool(option), water_density(scenario)), scenario)


def _dvl(url: Url, clock: Clock) -> Source:
    from rovtwin.links.waterlinked.dvl_source import PORT, DvlSource

    return DvlSource(*url.host_port(PORT), clock, altimeter=True)


def _ugps(url: Url, clock: Clock) -> Source:
    from rovtwin.links.waterlinked.ugps_source import PORT, UgpsSource

    return UgpsSource(*url.host_port(PORT), clock, rate=10.0 * clock.speed)


def _qtm(url: Url, clock: Clock) -> Source:
    from rovtwin.links.qualisys.source import PORT, QtmSource

    where, _, body = url.rest.partition("/")
    host, port = Url(url.text, url.scheme, where).host_port(PORT)
    return QtmSource(host, body or None, port, clock)


LINKS: dict[str, Callable[[Url, Scenario, Clock], Link]] = {
    "blueye": _blueye,
    "mavlink": _mavlink,
    "ros2": _ros2,
    "twin": _twin,
    "replay": _replay,
}
SOURCES: dict[str, Callable[[Url, Clock], Source]] = {"ugps": _ugps, "dvl": _dvl, "qtm": _qtm}
