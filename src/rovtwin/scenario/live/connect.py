"""From URLs to links and sources: `blueye://192.168.1.101`, `replay://run.mcap`, `dvl://192.168.194.95`."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from rovtwin.core.errors import ConfigError
from rovtwin.core.link import Link, Source
from rovtwin.core.log import Log
from rovtwin.core.numerics import jax
from rovtwin.links.hosted import HostedLink
from rovtwin.links.replay import ReplayLink
from rovtwin.links.twin import TwinLink
from rovtwin.scenario.composition import compose, vehicle_of
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


def connect(text: str, scenario: Scenario, clock: Clock) -> Link:
    """The vehicle at a URL, open. A real one is held by a process of its own, which outlives ours.

    Raises:
        ConfigError: The URL cannot be used, or not for this vehicle.
        LinkError: Nobody answers there.
    """
    url = Url.of(text, LINKS, "--link")
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


LINKS: dict[str, Callable[[Url, Scenario, Clock], Link]] = {"twin": _twin, "replay": _replay}
SOURCES: dict[str, Callable[[Url, Clock], Source]] = {}
