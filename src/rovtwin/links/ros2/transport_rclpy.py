"""Topics of ROS 2 through rclpy: with the middleware (Fast DDS, Cyclone, Zenoh) that the user's ROS 2 is set to."""

import importlib
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rovtwin.core.errors import LinkError
from rovtwin.links.ros2.messages import layout, ros_name
from rovtwin.links.ros2.transport import DEPTH, Transport, ours_of

# Releases that know ROS_LOCALHOST_ONLY and not yet ROS_AUTOMATIC_DISCOVERY_RANGE.
_BEFORE_IRON = ("foxy", "galactic", "humble")


class RclpyTransport(Transport):
    """Topics through a node of its own in a context of its own, spun by one thread.

    Raises:
        LinkError: rclpy cannot start.
    """

    def __init__(self, node: str, domain: int, expose: bool = False):
        import rclpy
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor

        self.dropped = 0
        self._lock = threading.Lock()
        self._closed = False
        self._publishers: dict[str, tuple[type, Any]] = {}
        self._context = Context()
        try:
            with _discovery(expose):
                rclpy.init(args=[], context=self._context, domain_id=domain)
                self._node = rclpy.create_node(node, context=self._context)
        except Exception as error:  # of rclpy and of the middleware it loads
            self._context.try_shutdown()
            raise LinkError(
                f"ROS 2: rclpy cannot start ({error}). Is your ROS 2 sourced and RMW_IMPLEMENTATION installed?"
            ) from error
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin, name="ros2 rclpy", daemon=True)
        self._thread.start()

    def publish(self, topic: str, message: Any) -> None:
        kind = type(message)
        with self._lock:
            if self._closed:
                return
            if topic not in self._publishers:
                self._publishers[topic] = kind, self._node.create_publisher(_ros_type(kind), topic, _qos(True))
            known, publisher = self._publishers[topic]
            if known is not kind:
                raise LinkError(f"ROS 2: {topic} is {ros_name(known)}, found {ros_name(kind)}: use one type a topic")
            try:
                publisher.publish(to_ros(message))
            except Exception as error:  # rclpy's own errors share no base
                raise LinkError(f"ROS 2: {topic} cannot be published ({error})") from error

    def subscribe(self, topic: str, kind: type, callback: Callable[[Any], None], stream: bool = True) -> None:
        def take(message: Any) -> None:
            try:
                ours = ours_of(message, kind)
            except Exception:  # whatever the network made the library stumble over
                self.dropped += 1
                return
            if not self._closed:
                callback(ours)

        with self._lock:
            self._node.create_subscription(_ros_type(kind), topic, take, _qos(not stream))
        self._executor.wake()

    def close(self) -> None:
        with self._lock:
            if self._closed:
                return
            self._closed = True
        self._executor.shutdown(timeout_sec=2.0)
        if threading.current_thread() is not self._thread:
            self._thread.join(5.0)
        self._node.destroy_node()
        self._context.try_shutdown()

    def _spin(self) -> None:
        from rclpy.executors import ExternalShutdownException

        while not self._closed:
            try:
                self._executor.spin_once(timeout_sec=0.2)
            except ExternalShutdownException:
                return
            except Exception:  # a message that rclpy cannot read, or a shutdown under way
                self.dropped += 1


@contextmanager
def _discovery(expose: bool) -> Iterator[None]:
    """Nodes that start within the block find others on this machine only, unless exposed: then as the user set it."""
    if expose:
        yield
        return
    if os.environ.get("ROS_DISTRO") in _BEFORE_IRON:
        settings: dict[str, str | None] = {"ROS_LOCALHOST_ONLY": "1"}
    else:
        settings = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_STATIC_PEERS": None, "ROS_LOCALHOST_ONLY": None}
    before = {name: os.environ.get(name) for name in settings}
    try:
        _set(settings)
        yield
    finally:
        _set(before)


def _set(values: dict[str, str | None]) -> None:
    for name, value in values.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value


def _qos(reliable: bool) -> Any:
    from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy

    return QoSProfile(
        history=QoSHistoryPolicy.KEEP_LAST,
        depth=DEPTH,
        reliability=QoSReliabilityPolicy.RELIABLE if reliable else QoSReliabilityPolicy.BEST_EFFORT,
        durability=QoSDurabilityPolicy.VOLATILE,
    )


def _ros_type(kind: type) -> Any:
    package, _, word = ros_name(kind).split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), word)
    except (ImportError, AttributeError) as error:
        distro = os.environ.get("ROS_DISTRO", "<distro>")
        fix = f"sudo apt install ros-{distro}-{package.replace('_', '-')}"
        raise LinkError(f"ROS 2: there is no {ros_name(kind)} ({error}). To mend it: {fix}") from error


def to_ros(message: Any) -> Any:
    """One of our messages as rclpy has it."""
    kind = type(message)
    made = _ros_type(kind)()
    for name, ros, inner in layout(kind):
        value = getattr(message, name)
        if inner is not None:
            value = [to_ros(item) for item in value] if ros.endswith("[]") else to_ros(value)
        elif "[" in ros:
            value = list(value)
        setattr(made, name, value)
    return made
