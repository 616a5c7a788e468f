"""Transport: topics of ROS 2, through whichever middleware is at hand."""

import abc
import importlib.util
import os
from collections.abc import Callable
from typing import Any, Literal, Self

from rovtwin.core.errors import LinkError
from rovtwin.links.ros2.confine import confined
from rovtwin.links.ros2.messages import layout

Middleware = Literal["auto", "rclpy", "cyclonedds"]
DEPTH = 10  # of the history of a topic: ROS 2's default
MISSING = "ROS 2: neither rclpy nor cyclonedds can be imported. Source your ROS 2, or: pip install 'rovtwin[ros2]'"


class Transport(abc.ABC):
    """Publishes and subscribes; may have threads. Names of topics are absolute, such as `/rov/odometry`.

    What we publish is reliable and volatile with a history of 10, as ROS 2 has it by default: such a publisher serves
    reliable and best-effort subscribers alike. A subscription is best effort where `stream`, so that it hears
    publishers of sensor data, too; else reliable.

    Attributes:
        dropped: Messages that could not be read at all.
    """

    dropped: int = 0

    @abc.abstractmethod
    def publish(self, topic: str, message: Any) -> None:
        """Publish one of `messages`; the type of a topic is that of its first message. Returns at once.

        Raises:
            LinkError: The topic has another type, or this middleware lacks it.
        """

    @abc.abstractmethod
    def subscribe(self, topic: str, kind: type, callback: Callable[[Any], None], stream: bool = True) -> None:
        """Hear a topic. `callback` gets messages of class `kind` in a thread of the transport, and must not block."""

    @abc.abstractmethod
    def close(self) -> None:
        """Leave the network; no callback is called any more. May be called twice."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def open_transport(
    node: str, domain: int | None = None, expose: bool = False, middleware: Middleware = "auto"
) -> Transport:
    """Join a domain of ROS 2.

    Args:
        node: Name of the node.
        domain: 0 to 232; by default `ROS_DOMAIN_ID` of the environment, else 0.
        expose: Whether other machines may take part; otherwise nothing leaves this one or is heard from another.
        middleware: `auto` takes rclpy where a ROS 2 is sourced (`ROS_DISTRO`), else cyclonedds, else rclpy.

    Raises:
        LinkError: No middleware is installed, or the network cannot be joined.
    """
    number = domain_id(domain)
    chosen = _choose() if middleware == "auto" else middleware
    try:
        if chosen == "rclpy":
            from rovtwin.links.ros2.transport_rclpy import RclpyTransport

            with confined(not expose):
                return RclpyTransport(node, number, expose)
        from rovtwin.links.ros2.transport_cyclone import CycloneTransport

        with confined(not expose):
            return CycloneTransport(number, expose)
    except ImportError as error:
        fix = "source your ROS 2" if chosen == "rclpy" else "pip install 'rovtwin[ros2]'"
        raise LinkError(f"ROS 2: {chosen} cannot be imported ({error}). To mend it: {fix}") from error


def domain_id(domain: int | None) -> int:
    """The domain to join; see `open_transport`.

    Raises:
        LinkError: It is none of 0 to 232.
    """
    found = os.environ.get("ROS_DOMAIN_ID") or "0" if domain is None else str(domain)
    try:
        number = int(found)
    except ValueError:
        number = -1
    if not 0 <= number <= 232:  # beyond it the ports of RTPS would be too large
        where = "ROS_DOMAIN_ID" if domain is None else "domain"
        raise LinkError(f"ROS 2: {where} is {found}, expected a number from 0 to 232, the one that your nodes use")
    return number


def _choose() -> str:
    found = [name for name in ("rclpy", "cyclonedds") if importlib.util.find_spec(name)]
    if not found:
        raise LinkError(MISSING)
    wanted = "rclpy" if os.environ.get("ROS_DISTRO") else "cyclonedds"
    return wanted if wanted in found else found[0]


def ours_of(message: Any, kind: type) -> Any:
    """A middleware's message as one of ours, whichever it is: it has the same fields; arrays become lists."""
    values = {}
    for name, ros, inner in layout(kind):
        value = getattr(message, name)
        if inner is not None:
            value = [ours_of(item, inner) for item in value] if ros.endswith("[]") else ours_of(value, inner)
        elif "[" in ros:
            value = value.tolist() if hasattr(value, "tolist") else list(value)
        values[name] = value
    return kind(**values)
