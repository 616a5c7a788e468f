"""Transport: topics of ROS 2, through whichever middleware is at hand."""

import abc
from collections.abc import Callable
from typing import Any, Self

from rovtwin.links.ros2.messages import layout

DEPTH = 10  # of the history of a topic: ROS 2's default


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
