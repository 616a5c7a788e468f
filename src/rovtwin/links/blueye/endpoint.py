"""Blueye: one drone, or two bolted together into one vehicle, over the protocol of its SDK."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rovtwin.core.errors import ConfigError
from rovtwin.links.endpoint import Clock, Endpoint, LinkContext, ServeContext, Where
from rovtwin.links.url import Url

if TYPE_CHECKING:
    from rovtwin.core.link import Link
    from rovtwin.links.blueye.server import BlueyeServer
    from rovtwin.vehicle import Vehicle

AXES = ("surge", "sway", "heave")  # thrusters of a drone, as our vehicle files have them
HTTP_PORT = 80


@dataclass(frozen=True)
class Opener:
    """Opens one drone, or two as one vehicle, in the host's process."""

    hosts: tuple[str, ...]
    thrusters: Any
    clock: Clock
    observe: bool
    take_control: bool = False
    position: bool = False

    def __call__(self) -> "Link":
        from rovtwin.links.blueye.double import DoubleBlueyeLink
        from rovtwin.links.blueye.driver.thrust import force_shares
        from rovtwin.links.blueye.link import BlueyeLink

        rights: dict[str, Any] = {"observer": self.observe, "take_control": self.take_control}
        if len(self.hosts) == 1:
            curve = force_shares(self.thrusters, range(3))
            return BlueyeLink(self.hosts[0], curve=curve, clock=self.clock, position=self.position, **rights)
        curves = [force_shares(self.thrusters, range(3 * i, 3 * i + 3)) for i in range(2)]
        return DoubleBlueyeLink(self.hosts, curves=curves, clock=self.clock, **rights)


def _hosts(url: Url) -> tuple[str, ...]:
    return tuple(host.strip() for host in url.rest.split(",") if host.strip())


def _link(url: Url, context: LinkContext) -> Opener:
    hosts, vehicle = _hosts(url), context.vehicle
    if ported := [host for host in hosts if ":" in host]:
        raise ConfigError(
            f"--link {url.text}: found a port in {ported[0]}, expected an address: a Blueye's ports are fixed. "
            "For a twin served with --port, set http_proxy=http://ADDRESS:PORT"
        )
    _require_blueyes(vehicle, f"--link {url.text}: {vehicle.name} has", most=2)
    drones = len(vehicle.thruster_names) // 3
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
    return Opener(hosts, context.thrusters, context.clock, context.observe, **rights)


def _require_blueyes(vehicle: "Vehicle", where: str, most: int) -> None:
    """Raise ConfigError unless its thrusters are those of one Blueye, or of so many."""
    names = vehicle.thruster_names
    ends = [name.split(".")[-1] for name in names]
    drones = len(ends) // 3
    if ends != [*AXES] * drones or not 1 <= drones <= most:
        raise ConfigError(
            f"{where} the thrusters {', '.join(names)}, expected surge, sway, heave of one Blueye or two, as "
            "blueye_pioneer and double_blueye have them"
        )


def _server(context: ServeContext, where: Where) -> "BlueyeServer":
    import numpy as np

    from rovtwin.links.blueye.server import BlueyeServer
    from rovtwin.vehicle.analysis.stability import steady_speed

    _require_blueyes(context.vehicle, "--protocol blueye: found", most=len(context.drones))
    model, whole = context.vehicle.model(), np.sum(list(context.largest.values()), axis=0)
    ahead, down = (steady_speed(model, axis, float(whole[axis])) for axis in (0, 2))
    return BlueyeServer(
        where.hosts or [f"127.0.0.{2 + i}" for i in range(len(context.drones))],
        http_port=where.port or HTTP_PORT,
        fastest=(context.fastest[0], context.fastest[1], context.fastest[2]),
        datum=context.datum,
        reaches=(ahead, down),
    )


def _note(url: Url) -> str:
    others = "control is taken from other clients" if "take_control" in url.options else "no client is sent away"
    place = "; positions as it reckons them itself" if "position" in url.options else ""
    return f"{others} when arming{place}"


def _at_origin(url: Url) -> tuple[str, ...]:
    """What two drones tell is joined at CO."""
    return ("pressure", "accelerometer") if len(_hosts(url)) > 1 else ()


def _camera(url: Url) -> str | None:
    """H.264 over RTSP at a fixed address (Blueye SDK documentation); of two drones the first one's."""
    hosts = _hosts(url)
    return f"rtsp://{hosts[0]}:8554/test" if hosts else None


def _environment(server: "BlueyeServer") -> str:
    port = server.http_port
    return "" if port == HTTP_PORT else f"http_proxy=http://{server.addresses[0]}:{port} "


BLUEYE = Endpoint(
    scheme="blueye",
    address="blueye://IP, blueye://PORT_IP,STARBOARD_IP",
    about="a Blueye, or two bolted together, by the protocol of its SDK",
    sensors=("pressure", "accelerometer", "gyro", "attitude", "dvl", "altimeter", "position", "battery", "leak"),
    options={"take_control": "", "position": ""},
    requires=("blueye.sdk", "blueye"),
    may_be_watched=True,
    link=_link,
    server=_server,
    note=_note,
    at_origin=_at_origin,
    camera=_camera,
    reached=lambda server: f"blueye://{','.join(server.addresses)}",
    environment=_environment,
    is_own=lambda vehicle: all(name.split(".")[-1] in AXES for name in vehicle.thruster_names),
)
