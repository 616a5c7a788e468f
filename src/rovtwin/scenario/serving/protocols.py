"""The protocols that a vehicle can be served by, by name."""

from collections.abc import Callable, Sequence

from rovtwin.core.errors import ConfigError
from rovtwin.links.server import Server
from rovtwin.scenario.schema import Scenario

PROTOCOLS: dict[str, Callable[..., Server]] = {}


def servers_of(
    names: Sequence[str], scenario: Scenario, drones: Sequence[str], addresses: Sequence[str]
) -> list[Server]:
    """Servers of these protocols.

    Raises:
        ConfigError: There is no such protocol, or too few addresses.
    """
    unknown = [name for name in names if name not in PROTOCOLS]
    if unknown or not names:
        found = repr(unknown[0]) if unknown else "none"
        raise ConfigError(f"--protocol: found {found}, expected one or more of {', '.join(PROTOCOLS)}")
    return [PROTOCOLS[name](scenario, tuple(drones), list(addresses)) for name in names]
