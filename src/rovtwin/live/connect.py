"""From URLs to links and sources: `blueye://192.168.1.101`, `replay://run.mcap`, `dvl://192.168.194.95`."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import numpy as np

from rovtwin.core.errors import ConfigError
from rovtwin.core.link import Link, Source
from rovtwin.core.log import Log
from rovtwin.core.numerics import jax
from rovtwin.links.host import Opener
from rovtwin.links.hosted import HostedLink
from rovtwin.links.replay import ReplayLink
from rovtwin.links.rotations import rotation_from_euler
from rovtwin.links.twin import TwinLink
from rovtwin.runs.compose.composition import compose, vehicle_of, water_density
from rovtwin.runs.compose.sensors import rotated, sensors_of
from rovtwin.runs.pace import Clock
from rovtwin.scenario.schema import Scenario, SensorSection
from rovtwin.simulation.twin import TwinInput

# Scheme -> its options, each with the numbers that it takes, or none: `?topside=1,2,90&raw`
OPTIONS: dict[str, dict[str, str]] = {
    "blueye": {"take_control": "", "position": ""},
    "ros2": {"expose": ""},
    "ugps": {"topside": "NORTH,EAST,HEADING_DEG", "raw": "", "filtered": ""},
    "qtm": {"heading": "DEG", "origin": "NORTH,EAST,DOWN"},
    "dvl": {"rotation": "DEG"},
}


@dataclass(frozen=True)
class Url:
    """An address as the user gave it: `scheme://rest?option&option=number,number`.

    Attributes:
        text: All of it.
        scheme: What is before `://`.
        rest: What is between that and the options.
        options: Those that were given, each with its numbers [m, degrees].
    """

    text: str
    scheme: str
    rest: str
    options: dict[str, tuple[float, ...]] = field(default_factory=dict)

    @classmethod
    def of(cls, text: str, known: dict[str, Any], option: str) -> "Url":
        """Taken apart.

        Raises:
            ConfigError: No scheme, or one that nobody speaks; an option that there is not, or not with such numbers.
        """
        scheme, found, rest = text.partition("://")
        if not found or scheme not in known:
            names = ", ".join(f"{name}://" for name in known)
            raise ConfigError(
                f"{option} {text}: found {'no scheme' if not found else repr(scheme)}, expected one of {names}"
            )
        rest, _, query = rest.partition("?")
        options: dict[str, tuple[float, ...]] = {}
        for part in filter(None, query.split("&")):
            name, numbers = _parse_option(unquote(part), OPTIONS.get(scheme, {}), f"{option} {text}", scheme)
            if name in options:
                raise ConfigError(f"{option} {text}: found the option '{name}' twice, expected it once")
            options[name] = numbers
        return cls(text, scheme, unquote(rest), options)

    def host_port(self, port: int) -> tuple[str, int]:
        """Host and port, the latter as given or the protocol's own.

        Raises:
            ConfigError: There is no host, the port is no number, or there is more than that.
        """
        try:
            parts = urlsplit(f"//{self.rest}")
            host, given = parts.hostname, parts.port
        except ValueError as error:
            raise ConfigError(f"{self.text}: {error}, expected {self.scheme}://HOST[:PORT]") from None
        if not host:
            raise ConfigError(f"{self.text}: found no host, expected {self.scheme}://HOST[:PORT]")
        if parts.path.strip("/"):
            raise ConfigError(f"{self.text}: found '{parts.path}' after it, expected {self.scheme}://HOST[:PORT]")
        return host, given or port


def _parse_option(part: str, known: dict[str, str], where: str, scheme: str) -> tuple[str, tuple[float, ...]]:
    """An option's name and numbers."""
    name, given, text = part.partition("=")
    if name not in known:
        forms = ", ".join(f"{n}={form}" if form else n for n, form in known.items())
        expected = forms or f"none: {scheme}:// has no options"
        raise ConfigError(f"{where}: found the option '{name}', expected {expected}")
    form = known[name]
    wrong = ConfigError(f"{where}: found the option '{part}', expected {name}{'=' if form else ''}{form}")
    if not form:
        if given:
            raise wrong
        return name, ()
    try:
        numbers = tuple(float(number) for number in text.split(","))
    except ValueError:
        raise wrong from None
    if len(numbers) != len(form.split(",")) or not all(map(math.isfinite, numbers)):
        raise wrong
    return name, numbers


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
    if url.scheme in HERE:
        return HERE[url.scheme](url, scenario, clock)
    return _hosted(opener(text, scenario, clock, observe), scenario)


def as_read(text: str, scenario: Scenario) -> Scenario:
    """The scenario with its sensors where, and along the axes along which, the link at a URL reads them.

    A vehicle behind a protocol tells attitude, rates and specific force along its own axes, however its imu is built
    in; turned by the imu's mounting once more, the heading of one that looks aft would be 180 deg off. What two drones
    say is joined at CO.

    Raises:
        ConfigError: The scenario's sensors do not fit its vehicle.
    """
    scheme, _, rest = text.partition("://")
    if scheme not in HOSTED:
        return scenario
    by_name, none = scenario.sensors.by_name, [0.0, 0.0, 0.0]
    names = rotated(sensors_of(scenario, vehicle_of(scenario)))
    changed = {name: by_name.get(name, SensorSection()).model_copy(update={"attitude_deg": none}) for name in names}
    if scheme == "blueye" and "," in rest.partition("?")[0]:
        for name in ("pressure", "accelerometer"):
            one = changed.get(name, by_name[name])
            if one.position is None:
                changed[name] = one.model_copy(update={"position": none})
    if not changed:
        return scenario
    return scenario.model_copy(update={"sensors": scenario.sensors.model_copy(update=changed)})


def opener(text: str, scenario: Scenario, clock: Clock, observe: bool = False) -> Opener:
    """What opens the real vehicle at a URL in a process of its own, see `connect`.

    Raises:
        ConfigError: The URL cannot be used, or not for this vehicle.
    """
    url = Url.of(text, HOSTED, "--link")
    if observe and url.scheme == "blueye":
        return _blueye(url, scenario, clock, observe)
    return HOSTED[url.scheme](url, scenario, clock)


def source(text: str, clock: Clock) -> Source:
    """The instrument at a URL, open.

    Raises:
        ConfigError: The URL cannot be used.
        LinkError: Its driver is not installed.
    """
    url = Url.of(text, SOURCES, "--sensor")
    return SOURCES[url.scheme](url, clock)


def on_this_machine(text: str) -> bool:
    """Whether the vehicle at a URL is certainly no real one: computed, replayed, or served at a loopback address."""
    scheme, _, rest = text.partition("://")
    if scheme in ("twin", "replay"):
        return True
    if scheme == "ros2":
        return not rest.endswith("?expose")
    hosts = [host for part in rest.split("?")[0].split(",") for host in re.findall(r"\d+\.\d+\.\d+\.\d+", part)]
    return bool(hosts) and all(host.startswith("127.") for host in hosts)


def described(text: str) -> str:
    """One line for the user: the URL, and which frame and rights are assumed of what is there.

    Raises:
        ConfigError: The URL cannot be used.
    """
    url = Url.of(text, LINKS | SOURCES, "--link, --sensor")
    tell = _TOLD.get(url.scheme)
    return f"{text}: {tell(url)}" if tell else text


def _twin(url: Url, scenario: Scenario, clock: Clock) -> Link:
    composed = compose(scenario)
    # Its time is not the test's, so that a hand would tilt it some other time: as with a served twin, nobody does.
    twin, dt = replace(composed.loop.twin, hand=None), scenario.control_dt
    memory = twin.init(jax.random.split(composed.key)[1], composed.start)
    step = jax.jit(lambda twin, memory, command, k: twin.step(memory, TwinInput(command, k), dt))

    def advance(memory: Any, command: Any, k: int) -> Any:
        memory, moved = step(twin, memory, command, k)
        return memory, moved.measurements

    count = twin.model.thrusters.count
    return TwinLink(advance, memory, count, dt, clock, prompt=clock.speed <= 1.0)


def _replay(url: Url, scenario: Scenario, clock: Clock) -> Link:
    return ReplayLink(Log.read(Path(url.rest)), len(vehicle_of(scenario).thruster_names), clock)


def _hosted(opener: Opener, scenario: Scenario) -> Link:
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
    take_control: bool = False
    position: bool = False

    def __call__(self) -> Link:
        from rovtwin.links.blueye.double import DoubleBlueyeLink
        from rovtwin.links.blueye.link import BlueyeLink
        from rovtwin.links.blueye.thrust import force_shares

        rights: dict[str, Any] = {"observer": self.observe, "take_control": self.take_control}
        if len(self.hosts) == 1:
            curve = force_shares(self.thrusters, range(3))
            return BlueyeLink(self.hosts[0], curve=curve, clock=self.clock, position=self.position, **rights)
        curves = [force_shares(self.thrusters, range(3 * i, 3 * i + 3)) for i in range(2)]
        return DoubleBlueyeLink(self.hosts, curves=curves, clock=self.clock, **rights)


def _blueye(url: Url, scenario: Scenario, clock: Clock, observe: bool = False) -> Opener:
    hosts = tuple(host.strip() for host in url.rest.split(",") if host.strip())
    if ported := [host for host in hosts if ":" in host]:
        raise ConfigError(
            f"--link {url.text}: found a port in {ported[0]}, expected an address: a Blueye's ports are fixed. "
            "For a twin served with --port, set http_proxy=http://ADDRESS:PORT"
        )
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
    if drones == 2 and "position" in url.options:
        raise ConfigError(
            f"--link {url.text}: found the option 'position' for two drones, expected it for one: each reckons from a "
            "zero of its own. Take positions from --sensor"
        )
    rights = {"take_control": "take_control" in url.options, "position": "position" in url.options}
    return _Blueye(hosts, _thrusters(scenario), clock, observe, **rights)


def _blueye_told(url: Url) -> str:
    others = "control is taken from other clients" if "take_control" in url.options else "no client is sent away"
    place = "; positions as it reckons them itself" if "position" in url.options else ""
    return f"{others} when arming{place}"


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


def _mavlink(url: Url, scenario: Scenario, clock: Clock) -> Opener:
    return _Mavlink(url.rest, _thrusters(scenario), clock, water_density(scenario))


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


def _ros2(url: Url, scenario: Scenario, clock: Clock) -> Opener:
    namespace, exposed = url.rest.strip("/") or "rov", "expose" in url.options
    return _Ros2(namespace, _thrusters(scenario), clock, exposed, water_density(scenario))


def _dvl(url: Url, clock: Clock) -> Source:
    from rovtwin.links.waterlinked.dvl_source import PORT, DvlSource

    rotation = math.radians(_rotation(url))
    return DvlSource(*url.host_port(PORT), clock, rotation=rotation, altimeter=True)


def _rotation(url: Url) -> float:
    (degrees,) = url.options.get("rotation", (0.0,))
    return degrees


def _dvl_told(url: Url) -> str:
    return f"its forward axis turned {_rotation(url):g} deg clockwise from the vehicle's"


def _ugps(url: Url, clock: Clock) -> Source:
    from rovtwin.links.waterlinked.ugps_source import PORT, UgpsSource

    north, east, degrees = _topside(url)
    topside = (north, east, math.radians(degrees))
    rate = min(100.0, 10.0 * clock.speed)
    return UgpsSource(*url.host_port(PORT), clock, topside=topside, rate=rate, raw=_raw(url))


def _topside(url: Url) -> tuple[float, ...]:
    return url.options.get("topside", (0.0, 0.0, 0.0))


def _raw(url: Url) -> bool:
    """Positions before the kit's own filter, unless told otherwise: the autopilot filters itself."""
    if {"raw", "filtered"} <= url.options.keys():
        raise ConfigError(f"--sensor {url.text}: found the options 'raw' and 'filtered', expected one of them")
    return "filtered" not in url.options


def _ugps_told(url: Url) -> str:
    north, east, degrees = _topside(url)
    kind = "raw" if _raw(url) else "filtered"
    return f"topside at north {north:g} m, east {east:g} m, its mark towards {degrees:g} deg; {kind} positions"


def _qtm(url: Url, clock: Clock) -> Source:
    from rovtwin.links.qualisys.poses import HALF_TURN, Lab
    from rovtwin.links.qualisys.source import PORT, QtmSource

    where, _, body = url.rest.partition("/")
    host, port = Url(url.text, url.scheme, where).host_port(PORT)
    degrees, origin = _lab(url)
    turn = rotation_from_euler(np.array([0.0, 0.0, math.radians(degrees)]))
    lab = Lab(R_nq=(turn @ np.array(HALF_TURN)).tolist(), origin=origin)
    return QtmSource(host, body or None, port, clock, lab)


def _lab(url: Url) -> tuple[float, tuple[float, ...]]:
    """Heading of the lab's x axis [degrees], and its origin in n [m]."""
    (degrees,) = url.options.get("heading", (0.0,))
    return degrees, url.options.get("origin", (0.0, 0.0, 0.0))


def _qtm_told(url: Url) -> str:
    degrees, (north, east, down) = _lab(url)
    return (
        f"the lab's origin at north {north:g} m, east {east:g} m, down {down:g} m, its x axis towards {degrees:g} deg, "
        "its z up"
    )


HOSTED: dict[str, Callable[[Url, Scenario, Clock], Opener]] = {"blueye": _blueye, "mavlink": _mavlink, "ros2": _ros2}
HERE: dict[str, Callable[[Url, Scenario, Clock], Link]] = {"twin": _twin, "replay": _replay}
LINKS = HOSTED | HERE
SOURCES: dict[str, Callable[[Url, Clock], Source]] = {"ugps": _ugps, "dvl": _dvl, "qtm": _qtm}
_TOLD: dict[str, Callable[[Url], str]] = {
    "blueye": _blueye_told,
    "ugps": _ugps_told,
    "dvl": _dvl_told,
    "qtm": _qtm_told,
}
