"""MAVLink: a vehicle that ArduSub steers."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rovtwin.core.errors import ConfigError
from rovtwin.links.endpoint import Clock, Endpoint, LinkContext, ServeContext, Where
from rovtwin.links.url import Url

if TYPE_CHECKING:
    from rovtwin.core.link import Link
    from rovtwin.links.mavlink.server import MavlinkServer


@dataclass(frozen=True)
class Opener:
    """Opens an ArduSub vehicle in the host's process."""

    url: str
    thrusters: Any
    clock: Clock
    density: float

    def __call__(self) -> "Link":
        from rovtwin.links.mavlink.driver.readings import Readings
        from rovtwin.links.mavlink.link import MavlinkLink
        from rovtwin.links.mavlink.mixing import shares

        readings = Readings(density=self.density)
        return MavlinkLink(self.url, shares(self.thrusters), clock=self.clock, readings=readings)


def _link(url: Url, context: LinkContext) -> Opener:
    return Opener(url.rest, context.thrusters, context.clock, context.density)


def _server(context: ServeContext, where: Where) -> "MavlinkServer":
    from rovtwin.links.mavlink.mixing import mixer
    from rovtwin.links.mavlink.server import MavlinkServer

    vehicle, drones = context.vehicle, context.drones
    if len(drones) != 1:
        raise ConfigError(
            f"mavlink: {vehicle.name} is made of {len(drones)} drones ({', '.join(drones)}), "
            "expected one vehicle; use --protocol blueye"
        )
    options = where.options("address")
    if "port" in options:
        options["udp_port"] = options.pop("port")
    return MavlinkServer(
        datum=context.datum,
        mixer=mixer(vehicle.model().thrusters),
        drone=drones[0],
        fastest=(context.fastest[0], context.fastest[1], context.fastest[2], context.fastest[5]),
        density=context.density,
        **options,
    )


MAVLINK = Endpoint(
    scheme="mavlink",
    address="mavlink://udpin:HOST:PORT, mavlink:///dev/ttyACM0",
    about="a BlueROV2, or another vehicle that ArduSub steers",
    sensors=("pressure", "accelerometer", "gyro", "attitude", "position", "altimeter", "battery", "leak"),
    requires=("pymavlink", "mavlink"),
    link=_link,
    server=_server,
    reached=lambda server: f"mavlink://udpin:{server.ground_station}",
    is_own=lambda vehicle: True,
)
