"""Server: a vendor's protocol spoken for a vehicle, and who may reach it."""

import abc
import ipaddress
from collections.abc import Sequence

from rovtwin.core.errors import ConfigError
from rovtwin.links.servers.served_vehicle import ServedVehicle


class Server(abc.ABC):
    """A vendor's protocol, spoken for a vehicle. Picklable before it runs: it runs in a process of its own."""

    @abc.abstractmethod
    async def run(self, station: ServedVehicle) -> None:
        """Serve until cancelled. When it returns or is cancelled, all sockets are closed and no drone is armed.

        Raises:
            LinkError: An address cannot be bound.
        """

    @property
    @abc.abstractmethod
    def addresses(self) -> list[str]:
        """Hosts it binds; `require_loopback` looks at them."""


def require_loopback(servers: Sequence[Server], exposed: bool) -> list[str]:
    """`loopback_only` of all that servers bind."""
    return loopback_only([address for server in servers for address in server.addresses], exposed)


def loopback_only(addresses: Sequence[str], exposed: bool) -> list[str]:
    """Those of the addresses that others than this machine reach; there must be none unless `exposed`.

    Raises:
        ConfigError: There are, and nobody asked for that.
    """
    for address in addresses:
        if not _is_address(address):
            raise ConfigError(f"--address {address}: found no IP address, expected one such as 127.0.0.1 or 127.0.0.2")
    found = [address for address in addresses if not _is_loopback(address)]
    if found and not exposed:
        raise ConfigError(
            f"--address {found[0]}: others on the network could steer the vehicle; expected a loopback address "
            "(127.0.0.1, 127.0.0.2, ..). If this is what you want, add --expose"
        )
    return found


def _is_address(address: str) -> bool:
    try:
        ipaddress.ip_address(address)
    except ValueError:
        return address == "localhost"
    return True


def _is_loopback(address: str) -> bool:
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return address == "localhost"


def address_taken(where: str, error: Exception) -> str:
    """What to say of an address that cannot be bound."""
    return (
        f"{where}: cannot be bound ({getattr(error, 'strerror', None) or error}). Is another server running there? "
        "Stop it, or choose another --address or --port"
    )
