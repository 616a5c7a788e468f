"""From URLs to links and sources: `blueye://192.168.1.101`, `replay://run.mcap`, `dvl://192.168.194.95`.

What a protocol's addresses mean is said by its endpoint, `links/<vendor>/endpoint.py`; computed and replayed vehicles
are opened here.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.core.link import Link, Source
from rovtwin.core.log import Log
from rovtwin.core.numerics import jax
from rovtwin.links import registry
from rovtwin.links.endpoint import LinkContext
from rovtwin.links.host import Opener
from rovtwin.links.remote_link import RemoteLink
from rovtwin.links.replay import ReplayLink
from rovtwin.links.twin import TwinLink
from rovtwin.links.url import Url
from rovtwin.runs.compose.composition import compose, vehicle_of, water_density
from rovtwin.runs.compose.sensors import rotated, sensors_of
from rovtwin.runs.pace import Clock
from rovtwin.scenario.schema import Scenario, SensorSection
from rovtwin.simulation.stepping import step_twin


def connect(text: str, scenario: Scenario, clock: Clock, observe: bool = False, stop_at: Path | None = None) -> Link:
    """The vehicle at a URL, open. A real one is held by a process of its own, which outlives ours.

    Args:
        text: The URL.
        scenario: Its vehicle, and for `twin://` its world.
        clock: That readings are stamped with.
        observe: Only look: where the protocol tells pilots from watchers, be one of these.
        stop_at: Where the process of a real one makes a socket at which any message stops the thrusters.

    Raises:
        ConfigError: The URL cannot be used, or not for this vehicle.
        LinkError: Nobody answers there.
    """
    url, endpoint = registry.parse(text, "link", "--link", also=tuple(HERE))
    if endpoint is None:
        return HERE[url.scheme](url, scenario, clock)
    return _hosted(opener(text, scenario, clock, observe), scenario, stop_at)


def as_read(text: str, scenario: Scenario) -> Scenario:
    """The scenario with its sensors where, and along the axes along which, the link at a URL reads them.

    A vehicle behind a protocol tells attitude, rates and specific force along its own axes, however its imu is built
    in; turned by the imu's mounting once more, the heading of one that looks aft would be 180 deg off.

    Raises:
        ConfigError: The URL cannot be used, or the scenario's sensors do not fit its vehicle.
    """
    url, endpoint = registry.parse(text, "link", "--link", also=tuple(HERE))
    if endpoint is None:
        return scenario
    by_name, none = scenario.sensors.by_name, [0.0, 0.0, 0.0]
    names = rotated(sensors_of(scenario, vehicle_of(scenario)))
    changed = {name: by_name.get(name, SensorSection()).model_copy(update={"attitude_deg": none}) for name in names}
    for name in endpoint.at_origin(url):
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
    url, endpoint = registry.parse(text, "link", "--link")
    assert endpoint is not None and endpoint.link is not None  # or `parse` had refused it
    return endpoint.link(url, LinkContext(vehicle_of(scenario), clock, water_density(scenario), observe))


def source(text: str, clock: Clock) -> Source:
    """The instrument at a URL, open.

    Raises:
        ConfigError: The URL cannot be used.
        LinkError: Its driver is not installed.
    """
    url, endpoint = registry.parse(text, "source", "--sensor")
    assert endpoint is not None and endpoint.source is not None  # or `parse` had refused it
    return endpoint.source(url, clock)


def at_origin(text: str, sensor: str) -> bool:
    """Whether the instrument at a URL reports a sensor's readings at CO, and so not those of one that is carried."""
    endpoint = registry.find(text.partition("://")[0])
    if endpoint is None or endpoint.source is None:
        return False
    return sensor in endpoint.at_origin(Url.of(text, endpoint.options, "--sensor"))


def on_this_machine(text: str) -> bool:
    """Whether the vehicle at a URL is certainly no real one: computed, replayed, or served at a loopback address."""
    url, endpoint = registry.parse(text, "link", "--link", also=tuple(HERE))
    return endpoint is None or endpoint.is_simulated(url)


def is_computed(text: str) -> bool:
    """Whether the vehicle at a URL is no other process's: computed or replayed in our own, on no line."""
    return registry.parse(text, "link", "--link", also=tuple(HERE))[1] is None


def may_be_watched(text: str) -> bool:
    """Whether a second line may watch the vehicle at a URL while one steers it."""
    _, endpoint = registry.parse(text, "link", "--link", also=tuple(HERE))
    return endpoint is not None and endpoint.may_be_watched


def described(text: str) -> str:
    """One line for the user: the URL, and which frame and rights are assumed of what is there.

    Raises:
        ConfigError: The URL cannot be used.
    """
    kind = "source" if text.partition("://")[0] in registry.names_of("source") else "link"
    url, endpoint = registry.parse(text, kind, "--link, --sensor", also=tuple(HERE))
    note = endpoint.note(url) if endpoint else ""
    return f"{text}: {note}" if note else text


def _twin(url: Url, scenario: Scenario, clock: Clock) -> Link:
    simulation = compose(scenario)
    # Its time is not the test's, so that a hand would tilt it some other time: as with a served twin, nobody does.
    twin, dt = replace(simulation.loop.twin, hand=None), scenario.control_dt
    memory = twin.init(jax.random.split(simulation.key)[1], simulation.start)

    def advance(memory: Any, command: Any, k: int) -> Any:
        return step_twin(twin, memory, command.u, np.asarray(k), dt=dt)[:2]

    count = twin.model.thrusters.count
    return TwinLink(advance, memory, count, dt, clock, prompt=clock.speed <= 1.0)


def _replay(url: Url, scenario: Scenario, clock: Clock) -> Link:
    return ReplayLink(Log.read(Path(url.rest)), len(vehicle_of(scenario).thruster_names), clock)


def _hosted(opener: Opener, scenario: Scenario, stop_at: Path | None) -> Link:
    return RemoteLink(opener, len(vehicle_of(scenario).thruster_names), stop_at)


HERE: dict[str, Callable[[Url, Scenario, Clock], Link]] = {"twin": _twin, "replay": _replay}
"""Vehicles that are no process's but ours, by scheme."""
