"""ROS 1 and ROS 2 bags, MCAP among them, through `rosbags`: every topic becomes a table of its numbers.

A message is flattened to names such as `pose.pose.position.x`; its time is that of its header, else when it was
recorded. Signals of the usual messages are known: Odometry, PoseStamped, PoseWithCovarianceStamped, Imu, in ENU and
FLU as REP 103 wants. Commands are found where one topic fits the vehicle's thrusters: a JointState with their names,
or a multi-array of as many values.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.core.errors import IdentificationError
from rovtwin.core.extras import require
from rovtwin.identification.logs.log_spec import CommandSpec, SignalSpec
from rovtwin.identification.logs.readers.raw import Raw, Table, spec

LONGEST = 64  # arrays beyond it are images and scans, not states
_XYZ, _XYZW = ("x", "y", "z"), ("x", "y", "z", "w")


def read_rosbag(path: Path, thrusters: list[str]) -> Raw:
    """Tables of all topics of numbers, and the signals and commands that follow from their types."""
    require("rosbags", "ros", f"{path}: a ROS bag")
    from rosbags.highlevel import AnyReader, AnyReaderError
    from rosbags.typesys import Stores, get_typestore

    rows: dict[str, list[dict[str, float]]] = {}
    times: dict[str, list[float]] = {}
    notes: list[str] = []
    try:
        # Bags without message definitions: the standard types do.
        with AnyReader([_bag(path)], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            types = {c.topic: str(c.msgtype) for c in reader.connections}
            for connection, stamp, data in reader.messages():
                message = reader.deserialize(data, connection.msgtype)
                rows.setdefault(connection.topic, []).append(dict(_numbers(message, "")))
                times.setdefault(connection.topic, []).append(_time(message, stamp))
    except (AnyReaderError, OSError, ValueError, KeyError) as error:
        raise IdentificationError(f"{path}: cannot be read as a ROS bag ({error})") from None
    tables = {}
    for topic, messages in rows.items():
        columns = tuple(dict.fromkeys(name for message in messages for name in message))
        if columns:
            values = np.array([[message.get(name, np.nan) for name in columns] for message in messages])
            tables[topic] = Table(values, columns, np.array(times[topic]))
        else:
            notes.append(f"{path}: {topic} ({types[topic]}) holds no numbers that can be used")
    signals, remarks = _signals(tables, types)
    return Raw(path, tables, signals, _commands(tables, types, thrusters), notes=(*notes, *remarks))


def _bag(path: Path) -> Path:
    """What rosbags opens: the folder of a ROS 2 bag also where one of its files was named."""
    return path.parent if path.suffix == ".db3" and (path.parent / "metadata.yaml").is_file() else path


def _time(message: Any, stamp: int) -> float:
    """Of the header, where it was set, else of the recording [s]."""
    header = getattr(message, "header", None)
    if header is not None and (header.stamp.sec or header.stamp.nanosec):
        return header.stamp.sec + 1e-9 * header.stamp.nanosec
    return 1e-9 * stamp


def _numbers(value: Any, name: str) -> Iterator[tuple[str, float]]:
    """Every number of a message with its place in it; a JointState's values go by the joints' names."""
    if isinstance(value, (bool, int, float, np.number)):
        yield name, float(value)
    elif isinstance(value, np.ndarray):
        if value.size <= LONGEST and value.dtype.kind in "fiub":
            yield from ((f"{name}.{i}", float(v)) for i, v in enumerate(value.ravel()))
    elif hasattr(value, "__dataclass_fields__") and not name.endswith("header"):
        joints = getattr(value, "name", None)
        for key in value.__dataclass_fields__:
            inner, place = getattr(value, key), f"{name}.{key}" if name else key
            if key == "header" or key.startswith("__") or "covariance" in key:
                continue
            if isinstance(joints, list) and isinstance(inner, np.ndarray) and len(inner) == len(joints):
                yield from ((f"{place}.{joint}", float(v)) for joint, v in zip(joints, inner, strict=True))
            else:
                yield from _numbers(inner, place)


def _specs(topic: str, kind: str) -> dict[str, SignalSpec]:
    """What a message of a usual type holds."""

    def of(place: str, names: tuple[str, ...], **more: Any) -> SignalSpec:
        return spec(table=topic, columns=[f"{place}.{name}" for name in names], **more)

    def pose(place: str) -> dict[str, SignalSpec]:
        return {
            "position": of(f"{place}.position", _XYZ, frame="enu"),
            "attitude": of(f"{place}.orientation", _XYZW, quaternion="xyzw", frame="enu"),
        }

    known = {
        "Imu": lambda: {
            "gyro": of("angular_velocity", _XYZ, frame="flu"),
            "accelerometer": of("linear_acceleration", _XYZ, frame="flu"),
        },
        "Odometry": lambda: {
            **pose("pose.pose"),
            "velocity": of("twist.twist.linear", _XYZ, frame="flu"),
            "gyro": of("twist.twist.angular", _XYZ, frame="flu"),
        },
        "PoseStamped": lambda: pose("pose"),
        "PoseWithCovarianceStamped": lambda: pose("pose.pose"),
    }
    make = known.get(kind.rsplit("/", 1)[-1])
    return make() if make else {}


def _signals(tables: dict[str, Table], types: dict[str, str]) -> tuple[dict[str, SignalSpec], list[str]]:
    found: dict[str, SignalSpec] = {}
    notes = []
    # An IMU's own rates before those that an estimator made of them.
    for topic in sorted(tables, key=lambda name: (not types[name].endswith("/Imu"), name)):
        for name, described in _specs(topic, types[topic]).items():
            if name in found:
                notes.append(f"{name}: {found[name].table} taken, not {topic}; signals.{name}.from changes that")
            else:
                found[name] = described
    return found, notes


def _commands(tables: dict[str, Table], types: dict[str, str], thrusters: list[str]) -> CommandSpec | None:
    candidates = []
    for topic, table in tables.items():
        for value in ("velocity", "effort", "position"):
            columns = [f"{value}.{name}" for name in thrusters]
            if types[topic].endswith("/JointState") and all(column in table.columns for column in columns):
                candidates.append((topic, columns))
                break
        data = [name for name in table.columns if name.startswith("data.")]
        if types[topic].endswith("MultiArray") and len(data) == len(thrusters):
            candidates.append((topic, data))
    if len(candidates) != 1:
        return None
    topic, columns = candidates[0]
    return CommandSpec.model_validate({"from": topic, "columns": columns})
