"""The protocols that a vehicle can be served by, by name, and the world that it swims in."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.yamlfile import read_yaml
from rovtwin.links import registry
from rovtwin.links.endpoint import Endpoint, ServeContext, Where
from rovtwin.links.servers.server import Server
from rovtwin.runs.compose.composition import vehicle_of, water_density
from rovtwin.scenario.files import list_scenarios, load_scenario
from rovtwin.scenario.schema import Scenario
from rovtwin.simulation.vehicle_firmware import RATE
from rovtwin.vehicle import list_library

PLAIN = "lawnmower_calm"  # whose world a vehicle swims in when only the vehicle is named: calm, endless water


class Servable(Protocol):
    """A vehicle that can be served; see `host.ServedVehicle`."""

    drones: tuple[str, ...]
    largest: dict[str, Float[np.ndarray, "6"]]


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
    vehicle = vehicle_of(scenario)
    return next(one.scheme for one in registry.built_in() if one.server is not None and one.is_own(vehicle))


def known(names: Sequence[str]) -> list[str]:
    """The names of protocols, each once.

    Raises:
        ConfigError: There is no such protocol.
    """
    for name in names:
        endpoint = registry.find(name)
        if endpoint is None or (endpoint.server is None and endpoint.firmware is None):
            alone = "".join(f", or {one} alone" for one in registry.names_of("firmware"))
            served = ", ".join(registry.names_of("server"))
            raise ConfigError(f"--protocol: found {name!r}, expected one or more of {served}{alone}")
        if endpoint.server is None and len(set(names)) > 1:
            raise ConfigError(
                f"--protocol {name}: found others beside it, expected it alone: its firmware keeps the time"
            )
    return list(dict.fromkeys(names))


def firmware_of(names: Sequence[str]) -> Endpoint | None:
    """The endpoint of a firmware that keeps the time, where one is asked for; see `known`."""
    endpoint = registry.find(names[0]) if names else None
    return endpoint if endpoint is not None and endpoint.firmware is not None else None


def servers_of(
    names: Sequence[str],
    scenario: Scenario,
    vehicle: Servable,
    places: Mapping[str, Where],
    expose: bool = False,
) -> dict[str, Server]:
    """Servers of these protocols, by name.

    Args:
        names: Of protocols, `known`.
        scenario: Of the vehicle.
        vehicle: What they will speak for.
        places: Where each shall listen, if not where it usually does.
        expose: Whether others on the network may take part where a protocol finds its own addresses.

    Raises:
        ConfigError: A protocol serves no clients: its firmware keeps the time.
    """
    context = ServeContext(
        vehicle=vehicle_of(scenario),
        drones=vehicle.drones,
        largest=vehicle.largest,
        fastest=RATE,
        density=water_density(scenario),
        datum=scenario.origin,
        floor=scenario.world.floor,
        rate=float(scenario.rates.control),
    )
    servers = {}
    for name in names:
        endpoint = registry.find(name)
        if endpoint is None or endpoint.server is None:
            expected = ", ".join(registry.names_of("server"))
            raise ConfigError(f"{name}: found a protocol that serves no clients, expected one or more of {expected}")
        servers[name] = endpoint.server(context, replace(places.get(name, Where()), expose=expose))
    return servers


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
