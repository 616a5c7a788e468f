"""Endpoint: all that the rest of the package knows of a vendor's protocol.

An endpoint stands in `links/<vendor>/endpoint.py` and is found by `registry`. It imports drivers and servers only when
it opens one, so that listing endpoints stays quick and needs no vendor's package.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    import numpy as np

    from rovtwin.core.datum import Datum
    from rovtwin.core.link import Source
    from rovtwin.links.host import Opener
    from rovtwin.links.servers.server import Server
    from rovtwin.links.url import Url
    from rovtwin.vehicle import Vehicle


class Clock(Protocol):
    """Time that readings are stamped with [s], `speed` times as fast as the wall's; picklable."""

    speed: float

    def __call__(self) -> float: ...


@dataclass(frozen=True)
class LinkContext:
    """What a link may know before it is opened.

    Attributes:
        vehicle: The one that is expected at the other end.
        clock: That readings are stamped with.
        density: Of the water that it swims in [kg/m3].
        observe: Only look: where the protocol tells pilots from watchers, be one of these.
    """

    vehicle: "Vehicle"
    clock: Clock
    density: float
    observe: bool = False

    @property
    def thrusters(self) -> Any:
        """The vehicle's thrusters as NumPy arrays, which another process takes without starting JAX."""
        import numpy as np

        from rovtwin.core.numerics import jax

        return jax.tree.map(np.asarray, self.vehicle.model().thrusters)


@dataclass(frozen=True)
class ServeContext:
    """What a server may know of the vehicle that it speaks for.

    Attributes:
        vehicle: As described.
        drones: Names of the drones that it is made of; one empty name where it is one.
        largest: Wrench along each axis that a full stick may give, b at the drone [N, N m], shape (6,), by drone.
        fastest: Motion that a full stick asks for [m/s, rad/s], shape (6,).
        density: Of its water [kg/m3].
        datum: Origin of its world on the map.
        floor: Depth of the floor [m], None: endless.
        rate: Of its control loop [Hz].
    """

    vehicle: "Vehicle"
    drones: tuple[str, ...]
    largest: "Mapping[str, np.ndarray]"
    fastest: tuple[float, ...]
    density: float
    datum: "Datum"
    floor: Any
    rate: float


@dataclass(frozen=True)
class Where:
    """Addresses that the user gave for one protocol: hosts and, where given, a port; whether others may take part."""

    hosts: list[str] = field(default_factory=list)
    port: int | None = None
    expose: bool = False

    def options(self, host: str = "host") -> dict[str, Any]:
        """As arguments of a server with one host and one port."""
        return ({host: self.hosts[0]} if self.hosts else {}) | ({} if self.port is None else {"port": self.port})


@dataclass(frozen=True)
class Firmware:
    """A vendor's firmware that runs beside us, keeps the time and asks for physics, one step for each of its frames.

    Attributes:
        commands: From its outputs and names of thrusters to u, shape (n,).
        thrusters: Names of those that it drives.
        vehicle: Of the library, that it is the firmware of.
        pace: What a user has to do to make it run faster.
        state: Makes the answer to a frame of time [s], gyro [rad/s], specific force [m/s2] in b, position [m] and
            velocity [m/s] in n, shapes (3,), and attitude, quaternion b to n, shape (4,).
        lockstep: Makes the server from `advance(outputs, dt)`, `reset()`, where it listens, and what takes its words.
    """

    commands: Callable[..., Any]
    thrusters: tuple[str, ...]
    vehicle: str
    pace: str
    state: Callable[..., Any]
    lockstep: Callable[..., Any]


@dataclass(frozen=True)
class Endpoint:
    """A protocol, by the scheme of its addresses.

    Attributes:
        scheme: What stands before `://`, and the protocol's name for `rovtwin serve`.
        address: Forms of its addresses, for help.
        about: Whose protocol it is, a line for a list.
        sensors: What it measures, names of `core.sensors`.
        gives_position: Whether an autopilot needs no other source of positions beside it.
        options: Those of an address (`?name=NUMBER,NUMBER`): forms of their numbers by name, "" for none.
        requires: Module of the vendor's that it needs and the extra that brings it; None: nothing.
        link: Makes what opens a vehicle, in a process of its own: it is picklable. None: it is no vehicle's.
        source: Opens an instrument. None: it is no instrument's.
        server: Makes a server, which is picklable. None: it cannot be served.
        firmware: Gives the physics of a firmware that keeps the time, which is served alone. None: there is none.
        note: One line on which frame and rights an address assumes, "" for none.
        is_simulated: Whether what is there is certainly no real vehicle.
        may_be_watched: Whether a second line may watch the vehicle while one steers it.
        at_origin: Sensors whose readings are reported at CO, wherever the vehicle carries them.
        camera: Address of the stream of its camera, None: not known.
        reached: Address at which a server is reached by a link or a source.
        environment: What has to stand before a command that reaches the server so, "" for nothing.
        is_own: Whether it is the protocol of a vehicle's vendor; the first endpoint that says so is served.
    """

    scheme: str
    address: str
    about: str
    sensors: tuple[str, ...] = ()
    gives_position: bool = False
    options: Mapping[str, str] = field(default_factory=dict)
    requires: tuple[str, str] | None = None
    link: "Callable[[Url, LinkContext], Opener] | None" = None
    source: "Callable[[Url, Clock], Source] | None" = None
    server: "Callable[[ServeContext, Where], Server] | None" = None
    firmware: "Callable[[], Firmware] | None" = None
    note: "Callable[[Url], str]" = lambda url: ""
    is_simulated: "Callable[[Url], bool]" = lambda url: url.is_loopback
    may_be_watched: bool = False
    at_origin: "Callable[[Url], tuple[str, ...]]" = lambda url: ()
    camera: "Callable[[Url], str | None]" = lambda url: None
    reached: "Callable[[Any], str]" = lambda server: ""
    environment: "Callable[[Any], str]" = lambda server: ""
    is_own: "Callable[[Vehicle], bool]" = lambda vehicle: False
