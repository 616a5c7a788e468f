"""Topics of ROS 2 through cyclonedds: no ROS needed at this end.

ROS 2 on DDS: topic `/a/b` is `rt/a/b`, type `pkg/msg/Type` is `pkg::msg::dds_::Type_`, final, in plain CDR (XCDR1).
"""

import os
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from rovtwin.core.errors import LinkError
from rovtwin.links.ros2.messages import layout, ros_name
from rovtwin.links.ros2.transport import DEPTH, Transport, ours_of

if TYPE_CHECKING:
    from cyclonedds.core import ReadCondition
    from cyclonedds.domain import Domain
    from cyclonedds.pub import DataWriter
    from cyclonedds.qos import Qos
    from cyclonedds.topic import Topic

BATCH = 32  # samples taken from a reader at a time
# Kilted describes its types in a way that Cyclone finds different for arrays, although the bytes are the same: match by
# the name of the type, as ROS 2 did before (../shared/protocols.md).
_COMPATIBLE = "<Compatibility><IgnoreTypeInformation>1.15</IgnoreTypeInformation></Compatibility>"
_LOOPBACK = (
    "<General><Interfaces><NetworkInterface address='127.0.0.1' multicast='false'/></Interfaces>"
    "<AllowMulticast>false</AllowMulticast></General>"
    # Without multicast, participants are looked for at the ports of the first 33 on this machine.
    "<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>"
    "<Peers><Peer address='127.0.0.1'/></Peers></Discovery>"
)


class CycloneTransport(Transport):
    """Topics through cyclonedds; one thread takes what arrives.

    Raises:
        LinkError: The domain cannot be joined.
    """

    def __init__(self, domain: int, expose: bool = False):
        from cyclonedds.core import DDSException, GuardCondition, WaitSet
        from cyclonedds.domain import DomainParticipant

        self.dropped = 0
        self._closed = threading.Event()
        self._lock = threading.Lock()
        self._writers: dict[str, tuple[type, DataWriter]] = {}
        self._readers: list[tuple[type, Any, ReadCondition, Callable[[Any], None]]] = []
        self._domain = _join(domain, expose)
        try:
            self._participant = DomainParticipant(domain)
            self._wake = GuardCondition(self._participant)
            self._waitset = WaitSet(self._participant)
            self._waitset.attach(self._wake)
        except DDSException as error:
            _leave(domain)
            raise LinkError(
                f"ROS 2: domain {domain} cannot be joined ({error}). More than 33 participants on this machine? "
                "End some, or choose another domain"
            ) from error
        self._thread = threading.Thread(target=self._listen, name="ros2 cyclonedds", daemon=True)
        self._thread.start()

    def publish(self, topic: str, message: Any) -> None:
        from cyclonedds.core import DDSException
        from cyclonedds.pub import DataWriter

        kind = type(message)
        with self._lock:
            if self._closed.is_set():
                return
            if topic not in self._writers:
                self._writers[topic] = kind, DataWriter(self._participant, self._topic(topic, kind), qos=_qos(True))
            known, writer = self._writers[topic]
            if known is not kind:
                raise LinkError(f"ROS 2: {topic} is {ros_name(known)}, found {ros_name(kind)}: use one type a topic")
            try:
                writer.write(to_idl(message))
            except DDSException as error:
                raise LinkError(f"ROS 2: {topic} cannot be published ({error})") from error

    def subscribe(self, topic: str, kind: type, callback: Callable[[Any], None], stream: bool = True) -> None:
        from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState
        from cyclonedds.sub import DataReader

        with self._lock:
            reader = DataReader(self._participant, self._topic(topic, kind), qos=_qos(not stream))
            condition = ReadCondition(reader, SampleState.Any | ViewState.Any | InstanceState.Any)
            self._readers.append((kind, reader, condition, callback))
            self._waitset.attach(condition)
            self._wake.set(True)

    def close(self) -> None:
        with self._lock:
            if self._closed.is_set():
                return
            self._closed.set()
            self._wake.set(True)
        if threading.current_thread() is not self._thread:
            self._thread.join(5.0)
        with self._lock:
            self._writers.clear()
            self._readers.clear()
            del self._participant, self._waitset, self._wake
            _leave(self._domain)

    def _topic(self, topic: str, kind: type) -> "Topic":
        from cyclonedds.topic import Topic

        return Topic(self._participant, f"rt{topic}", idl_type(kind))

    def _listen(self) -> None:
        from cyclonedds.util import duration

        while not self._closed.is_set():
            self._waitset.wait(duration(milliseconds=200))
            self._wake.set(False)
            with self._lock:
                readers = list(self._readers)
            for kind, reader, condition, callback in readers:
                self._take(kind, reader, condition, callback)

    def _take(self, kind: type, reader: Any, condition: "ReadCondition", callback: Callable[[Any], None]) -> None:
        """Hand over what a reader has. What cannot be read costs its batch, never the thread."""
        while not self._closed.is_set():
            try:
                samples = reader.take(BATCH, condition)
                # A publisher that leaves sends a sample without content.
                messages = [ours_of(sample, kind) for sample in samples if isinstance(sample, idl_type(kind))]
            except Exception:  # whatever the network made the library stumble over
                self.dropped += 1
                return
            for message in messages:
                if not self._closed.is_set():
                    callback(message)
            if len(samples) < BATCH:
                return


def _qos(reliable: bool) -> "Qos":
    from cyclonedds.qos import Policy, Qos
    from cyclonedds.util import duration

    return Qos(
        Policy.Reliability.Reliable(duration(milliseconds=100)) if reliable else Policy.Reliability.BestEffort,
        Policy.Durability.Volatile,
        Policy.History.KeepLast(DEPTH),
        Policy.DataRepresentation(use_cdrv0_representation=True),
    )


@dataclass
class _Joined:
    """A domain of this process: Cyclone wants each configured once."""

    domain: "Domain"
    expose: bool
    users: int = 0


_domains: dict[int, _Joined] = {}
_domains_lock = threading.Lock()


def _join(number: int, expose: bool) -> int:
    from cyclonedds.core import DDSException
    from cyclonedds.domain import Domain

    with _domains_lock:
        joined = _domains.get(number)
        if joined is None:
            try:
                joined = _domains[number] = _Joined(Domain(number, _config(expose)), expose)
            except DDSException as error:
                raise LinkError(
                    f"ROS 2: domain {number} cannot be set up ({error}). Does this process use cyclonedds already? "
                    "Is there a loopback interface, and is CYCLONEDDS_URI (used with expose only) right?"
                ) from error
        if joined.expose != expose:
            raise LinkError(
                f"ROS 2: domain {number} is open in this process with expose={joined.expose}, found {expose}: "
                "a domain has one setting a process"
            )
        joined.users += 1
    return number


def _leave(number: int) -> None:
    with _domains_lock:
        joined = _domains[number]
        joined.users -= 1
        if not joined.users:
            del _domains[number]


def _config(expose: bool) -> str:
    """What Cyclone is set to; on an exposed domain a user's CYCLONEDDS_URI comes on top of it."""
    inside = _COMPATIBLE + ("" if expose else _LOOPBACK)
    ours = f"<CycloneDDS><Domain Id='any'>{inside}</Domain></CycloneDDS>"
    users = os.environ.get("CYCLONEDDS_URI", "") if expose else ""
    return f"{ours},{users}" if users else ours


@cache
def idl_type(kind: type) -> Any:
    """The type of cyclonedds for one of our message classes."""
    from cyclonedds.idl import annotations, make_idl_struct, types

    columns: dict[str, Any] = {}
    for name, ros, inner in layout(kind):
        base, _, size = ros.partition("[")
        element = idl_type(inner) if inner else {"string": str, "bool": bool}.get(base) or getattr(types, base)
        if size:
            element = types.sequence[element] if size == "]" else types.array[element, int(size[:-1])]
        columns[name] = element
    package, _, word = ros_name(kind).split("/")
    return annotations.final(make_idl_struct(f"{word}_", f"{package}::msg::dds_::{word}_", columns))


def to_idl(message: Any) -> Any:
    """One of our messages as cyclonedds has it."""
    kind = type(message)
    values = {}
    for name, ros, inner in layout(kind):
        value = getattr(message, name)
        if inner is not None:
            value = [to_idl(item) for item in value] if ros.endswith("[]") else to_idl(value)
        elif "[" in ros:
            value = list(value)
        values[name] = value
    return idl_type(kind)(**values)
