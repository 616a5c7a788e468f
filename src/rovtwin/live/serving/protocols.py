"""The protocols that a vehicle can be served by, by name, and the world that it swims in."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from rovtwin.core.errors import ConfigError
from rovtwin.core.yamlfile import read_yaml
from rovtwin.links.server import Server
from rovtwin.runs.compose.composition import vehicle_of, water_density
from rovtwin.scenario.files import list_scenarios, load_scenario
from rovtwin.scenario.schema import Scenario
from rovtwin.simulation.vehicle_firmware import RATE
from rovtwin.vehicle import list_library
from rovtwin.vehicle.analysis.stability import steady_speed

PLAIN = "lawnmower_calm"  # whose world a vehicle swims in when only the vehicle is named: calm, endless water


class Servable(Protocol):
    """A vehicle that can be served; see `host.ServedVehicle`."""

    drones: tuple[str, ...]
    largest: dict[str, np.ndarray]


@dataclass(frozen=True)
class Where:
    """Addresses that the user gave for one protocol: hosts and, where given, a port; whether others may take part."""

    hosts: list[str] = field(default_factory=list)
    port: int | None = None
    expose: bool = False

    def options(self, host: str = "host") -> dict[str, Any]:
        """As arguments of a server with one host and one port."""
        return ({host: self.hosts[0]} if self.hosts else {}) | ({} if self.port is None else {"port": self.port})


def world_for(what: str, overrides: Sequence[str], seed: int | None) -> Scenario:
    """The scenario of a name: a scenario's own, or a vehicle in calm water with all it could measure with.

    Raises:
        ConfigError: There is neither.
    """
    if not is_vehicle(what):
        try:
            return load_scenario(what, overrides, seed)
        except ConfigError as error:
            if what in list_scenarios() or Path(what).exists():
                raise
            raise ConfigError(
                f"{what}: no such vehicle or scenario. Vehicles: {', '.join(list_library())}; scenarios: "
                "rovtwin scenario list"
            ) from error
    extra = [f"vehicle={what}", "autopilot=model_based", "sensors.dvl.on_board=true", f"name={Path(what).stem}"]
    scenario = load_scenario(PLAIN, [*extra, *overrides], seed)
    if vehicle_of(scenario).power_sources:
        return load_scenario(PLAIN, [*extra, "battery=true", "sensors.battery=true", *overrides], seed)
    return scenario


def is_vehicle(what: str) -> bool:
    """Whether a name is a vehicle's, of the library or a file, and no scenario's."""
    if what in list_library():
        return True
    try:
        data = read_yaml(what)
    except ConfigError:
        return False
    return not {"mission", "test", "world", "vehicle"} & data.keys()


def own_protocol(scenario: Scenario) -> str:
    """The protocol of a vehicle's vendor."""
    names = vehicle_of(scenario).thruster_names
    return "blueye" if all(name.split(".")[-1] in ("surge", "sway", "heave") for name in names) else "mavlink"


def known(names: Sequence[str]) -> list[str]:
    """The names of protocols, each once.

    Raises:
        ConfigError: There is no such protocol.
    """
    unknown = [name for name in names if name not in PROTOCOLS]
    if unknown:
        raise ConfigError(
            f"--protocol: found {unknown[0]!r}, expected one or more of {', '.join(PROTOCOLS)}, or ardusub-json alone"
        )
    return list(dict.fromkeys(names))


def servers_of(
    names: Sequence[str],
    scenario: Scenario,
    vehicle: Servable,
    places: Mapping[str, Where],
    expose: bool = False,
) -> list[Server]:
    """Servers of these protocols.

    Args:
        names: Of protocols, `known`.
        scenario: Of the vehicle.
        vehicle: What they will speak for.
        places: Where each shall listen, if not where it usually does.
        expose: Whether others on the network may take part where a protocol finds its own addresses.
    """
    where = {name: replace(places.get(name, Where()), expose=expose) for name in names}
    return [PROTOCOLS[name](scenario, vehicle, where[name]) for name in names]


def places_of(names: Sequence[str], addresses: Sequence[str], port: int | None = None) -> dict[str, Where]:
    """Where each protocol shall listen.

    Args:
        names: Of protocols.
        addresses: As given: HOST[:PORT] for the first protocol, PROTOCOL=HOST[:PORT] for a certain one.
        port: Of the first protocol.

    Raises:
        ConfigError: An address that is none, or of another protocol.
    """
    places: dict[str, Where] = {}
    for text in addresses:
        name, found, rest = text.partition("=")
        name, rest = (name, rest) if found else (names[0], text)
        if name not in names:
            raise ConfigError(f"--address {text}: found {name!r}, expected one of the protocols {', '.join(names)}")
        host, _, given = rest.rpartition(":") if rest.count(":") == 1 else (rest, "", "")
        if not host or (given and not (given.isdecimal() and 0 < int(given) < 65536)):
            raise ConfigError(f"--address {text}: expected HOST or HOST:PORT, such as 127.0.0.2 or 127.0.0.1:8080")
        before = places.get(name, Where())
        places[name] = Where([*before.hosts, host], int(given) if given else before.port)
    if port is not None:
        places[names[0]] = replace(places.get(names[0], Where()), port=port)
    return places


def _blueye(scenario: Scenario, vehicle: Servable, where: Where) -> Server:
    from rovtwin.links.blueye.server import BlueyeServer

    described = vehicle_of(scenario)
    names = described.thruster_names
    if any(name.split(".")[-1] not in ("surge", "sway", "heave") for name in names):
        raise ConfigError(
            f"--protocol blueye: found the thrusters {', '.join(names)}, expected surge, sway, heave of one Blueye "
            "or two, as blueye_pioneer and double_blueye have them"
        )
    hosts = where.hosts or [f"127.0.0.{2 + i}" for i in range(len(vehicle.drones))]
    largest = np.sum(list(vehicle.largest.values()), axis=0)
    ahead, down = (steady_speed(described.model(), axis, float(largest[axis])) for axis in (0, 2))
    return BlueyeServer(
        hosts,
        http_port=where.port or 80,
        fastest=(RATE[0], RATE[1], RATE[2]),
        datum=scenario.origin,
        reaches=(ahead, down),
    )


def _mavlink(scenario: Scenario, vehicle: Servable, where: Where) -> Server:
    from rovtwin.links.mavlink.mixing import mixer
    from rovtwin.links.mavlink.server import MavlinkServer

    described = vehicle_of(scenario)
    if len(vehicle.drones) != 1:
        raise ConfigError(
            f"mavlink: {described.name} is made of {len(vehicle.drones)} drones ({', '.join(vehicle.drones)}), "
            "expected one vehicle; use --protocol blueye"
        )
    options = where.options("address")
    if "port" in options:
        options["udp_port"] = options.pop("port")
    return MavlinkServer(
        datum=scenario.origin,
        mixer=mixer(described.model().thrusters),
        drone=vehicle.drones[0],
        fastest=(RATE[0], RATE[1], RATE[2], RATE[5]),
        density=water_density(scenario),
        **options,
    )


def _ros2(scenario: Scenario, vehicle: Servable, where: Where) -> Server:
    from rovtwin.links.ros2.convert import Water
    from rovtwin.links.ros2.server import Ros2Server

    if where.hosts:
        raise ConfigError("--address ros2=..: ROS 2 finds its nodes by itself; set ROS_DOMAIN_ID, or add --expose")
    largest = tuple(float(x) for x in vehicle.largest[vehicle.drones[0]])
    return Ros2Server(largest=largest, water=Water(density=water_density(scenario)), expose=where.expose)


def _dvl(scenario: Scenario, vehicle: Servable, where: Where) -> Server:
    from rovtwin.links.waterlinked.dvl_server import WEB_PORT, DvlServer

    return DvlServer(floor=scenario.world.floor, web_port=WEB_PORT, **where.options())


def _ugps(scenario: Scenario, vehicle: Servable, where: Where) -> Server:
    from rovtwin.links.waterlinked.ugps_server import UgpsServer

    return UgpsServer(datum=scenario.origin, **where.options())


def _qtm(scenario: Scenario, vehicle: Servable, where: Where) -> Server:
    from rovtwin.links.qualisys.server import QtmServer

    return QtmServer(rate=float(scenario.rates.control), **where.options())


PROTOCOLS: dict[str, Callable[[Scenario, Servable, Where], Server]] = {
    "blueye": _blueye,
    "mavlink": _mavlink,
    "ros2": _ros2,
    "dvl": _dvl,
    "ugps": _ugps,
    "qtm": _qtm,
}
"""Builders of servers, by the protocol's name."""
