"""Which ROS 2 this process speaks with: rclpy where one is sourced, else cyclonedds."""

import importlib.util
import os
from typing import Literal

from rovtwin.core.errors import LinkError
from rovtwin.links.ros2.confine import confined
from rovtwin.links.ros2.transport import Transport

Middleware = Literal["auto", "rclpy", "cyclonedds"]


MISSING = "ROS 2: neither rclpy nor cyclonedds can be imported. Source your ROS 2, or: pip install 'rovtwin[ros2]'"


def open_transport(
    node: str, domain: int | None = None, expose: bool = False, middleware: Middleware = "auto"
) -> Transport:
    """Join a domain of ROS 2.

    Args:
        node: Name of the node.
        domain: 0 to 232; by default `ROS_DOMAIN_ID` of the environment, else 0.
        expose: Whether other machines may take part; otherwise nothing leaves this one or is received from another.
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
    preferred = "rclpy" if os.environ.get("ROS_DISTRO") else "cyclonedds"
    return preferred if preferred in found else found[0]
