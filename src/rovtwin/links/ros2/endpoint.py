"""ROS 2: a vehicle that takes wrenches and tells odometry in a namespace."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rovtwin.core.errors import ConfigError
from rovtwin.links.endpoint import Clock, Endpoint, LinkContext, ServeContext, Where
from rovtwin.links.url import Url

if TYPE_CHECKING:
    from rovtwin.core.link import Link
    from rovtwin.links.ros2.server import Ros2Server


@dataclass(frozen=True)
class Opener:
    """Opens a ROS 2 vehicle in the host's process."""

    namespace: str
    thrusters: Any
    clock: Clock
    expose: bool
    density: float

    def __call__(self) -> "Link":
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


def _link(url: Url, context: LinkContext) -> Opener:
    namespace, exposed = url.rest.strip("/") or "rov", "expose" in url.options
    return Opener(namespace, context.thrusters, context.clock, exposed, context.density)


def _server(context: ServeContext, where: Where) -> "Ros2Server":
    from rovtwin.links.ros2.convert import Water
    from rovtwin.links.ros2.server import Ros2Server

    if where.hosts:
        raise ConfigError("--address ros2=..: ROS 2 finds its nodes by itself; set ROS_DOMAIN_ID, or add --expose")
    largest = tuple(float(x) for x in context.largest[context.drones[0]])
    return Ros2Server(largest=largest, water=Water(density=context.density), expose=where.expose)


ROS2 = Endpoint(
    scheme="ros2",
    address="ros2://NAMESPACE",
    about="a vehicle in ROS 2, through CycloneDDS or rclpy",
    sensors=("pressure", "accelerometer", "gyro", "attitude", "position", "dvl", "altimeter", "battery", "leak"),
    gives_position=True,
    options={"expose": ""},
    requires=("cyclonedds", "ros2"),
    may_be_watched=True,
    link=_link,
    server=_server,
    is_simulated=lambda url: "expose" not in url.options,  # else its nodes are kept to this machine
    reached=lambda server: f"ros2://{server.namespace}",
)
