"""A run as a ROS 2 bag of standard messages, for `ros2 bag play`, Foxglove, PlotJuggler and RViz.

A log is an MCAP file with a schema for each channel, so these programs open it as it is; but its types are our own, in
NED and FRD. The bag has the same flight in ENU and FLU, in types that every ROS 2 knows. Times are those of the run.
"""

import json
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from jaxtyping import Float, Int, Real, UInt8

from rovtwin.core.errors import LogError, exists_already
from rovtwin.core.frames import readings_in_body
from rovtwin.core.log import Log, Series
from rovtwin.core.log.files import exists_error, write_error
from rovtwin.core.log.mcapfile import McapFile
from rovtwin.core.numerics import as_array
from rovtwin.links.ros2 import cdr, convert
from rovtwin.links.ros2 import messages as msg

_RECORD = struct.Struct("<BQHIQQ")  # operation, length, channel, sequence, time of log and of publication
_MESSAGE = 5  # operation of a message record of MCAP
_NANO = 1_000_000_000
# As ROS 2 writes it into bags: reliable, volatile, the last 10.
_QOS = """- history: keep_last
  depth: 10
  reliability: reliable
  durability: volatile
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: automatic
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false
"""


@dataclass
class Topic:
    """Messages of one topic: when each is in the bag [ns], and its bytes, uint8."""

    name: str
    kind: type
    t: Int[np.ndarray, " N"]
    data: UInt8[np.ndarray, "N length"]


def export_rosbag2(log: Log, path: str | Path, namespace: str = "rov", overwrite: bool = False) -> Path:
    """Write a log as a ROS 2 bag: a folder with an MCAP file and `metadata.yaml`; returns the folder.

    Topics: `truth/odometry` and `odometry` (the estimate; nav_msgs/Odometry), `reference` (geometry_msgs/PoseStamped),
    `thrusters` (std_msgs/Float64MultiArray), `wrench` (geometry_msgs/WrenchStamped), `imu`, `pressure`, `position`,
    `dvl`, `altimeter`, `battery` as the sensors delivered them, and `/tf` of the estimate, or of the truth without one.
    A message is stamped with when it was valid, and is in the bag when it was delivered. Readings of inertial sensors
    and Doppler logs are turned into the axes of the body, `base_link`, by the mountings that the log declares.

    Args:
        log: Of a run.
        path: The folder.
        namespace: Of the topics.
        overwrite: Whether a bag that exists may be replaced.

    Raises:
        LogError: The log has nothing to show, or the bag exists or cannot be written.
    """
    path = Path(path)
    topics = list(_topics(log, "/" + namespace.strip("/") if namespace.strip("/") else ""))
    if not topics:
        raise LogError(f"{log.source}: has neither truth, estimate nor sensors of a run: nothing for a ROS 2 bag")
    if (path.exists() and not overwrite) or path.is_file():
        raise (exists_error(path) if path.is_file() else LogError(exists_already(path, "overwrite=True")))
    file = path / f"{path.name}_0.mcap"
    try:
        path.mkdir(exist_ok=True)
        with open(file, "wb") as stream:
            _write(stream, topics)
        (path / "metadata.yaml").write_text(rosbag2_metadata(file.name, topics), encoding="utf-8")
    except OSError as error:
        raise write_error(path, error) from error
    return path


def rosbag2_metadata(file: str, topics: list[Topic]) -> str:
    """`metadata.yaml` of a bag of one file, version 5 of the format: that of Humble, which later releases read too."""
    start = min(int(topic.t[0]) for topic in topics)
    duration = {"nanoseconds": max(int(topic.t[-1]) for topic in topics) - start}
    total = sum(len(topic.t) for topic in topics)
    begin = {"nanoseconds_since_epoch": start}
    about = [
        {
            "topic_metadata": {
                "name": topic.name,
                "type": msg.ros_name(topic.kind),
                "serialization_format": "cdr",
                "offered_qos_profiles": _QOS,
            },
            "message_count": len(topic.t),
        }
        for topic in topics
    ]
    metadata = {
        "version": 5,
        "storage_identifier": "mcap",
        "duration": duration,
        "starting_time": begin,
        "message_count": total,
        "topics_with_message_count": about,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file],
        "files": [{"path": file, "starting_time": begin, "duration": duration, "message_count": total}],
    }
    return yaml.safe_dump({"rosbag2_bagfile_information": metadata}, sort_keys=False)


def _write(stream: Any, topics: list[Topic]) -> None:
    """All topics, a chunk for each second."""
    file = McapFile(stream)
    schemas: dict[type, int] = {}
    numbers = []
    for topic in topics:
        if topic.kind not in schemas:
            name = msg.ros_name(topic.kind)
            schemas[topic.kind] = file.schema(name, "ros2msg", cdr.definition(topic.kind).encode())
        numbers.append(file.channel(topic.name, schemas[topic.kind], "cdr", {"offered_qos_profiles": _QOS}))
    last = max(int(topic.t[-1]) for topic in topics) // _NANO
    edges = np.arange(last + 2) * _NANO
    cuts = [np.searchsorted(topic.t, edges) for topic in topics]
    for k in range(last + 1):
        rows = zip(numbers, topics, cuts, strict=True)
        file.chunk(b"".join(_records(n, topic, cut[k], cut[k + 1]) for n, topic, cut in rows))
    file.finish()


def _records(channel: int, topic: Topic, start: int, stop: int) -> bytes:
    """Message records of some rows of a topic."""
    length = _RECORD.size - 9 + topic.data.shape[1]
    heads = [_RECORD.pack(_MESSAGE, length, channel, k, int(topic.t[k]), int(topic.t[k])) for k in range(start, stop)]
    return b"".join(head + topic.data[start + k].tobytes() for k, head in enumerate(heads))


# ------------------------------------------------------------------------------------------------ channels to topics


def _topics(log: Log, root: str) -> Iterator[Topic]:
    for prefix, topic in (("truth", "truth/odometry"), ("autopilot", "odometry")):
        if f"{prefix}/eta" in log and f"{prefix}/nu" in log and len(log[f"{prefix}/eta"]):
            yield _odometry(log, prefix, f"{root}/{topic}")
    tracked = [name for name in ("autopilot/eta", "truth/eta") if name in log and len(log[name])]
    if tracked:
        yield _tf(log[tracked[0]])
    for channel, (topic, make) in _MAKERS.items():
        if channel in log and len(log[channel]):
            kind, t_valid, columns, template = make(log, log[channel])
            yield _made(f"{root}/{topic}", kind, log[channel].t, t_valid, columns, template)
    if (inertial := _imu(log, f"{root}/imu")) is not None:
        yield inertial


def _nano(t: Real[np.ndarray, " N"]) -> Int[np.ndarray, " N"]:
    return np.rint(np.asarray(t) * _NANO).astype(np.int64)


def _made(name: str, kind: type, t: Any, t_valid: Any, columns: dict[str, Any], template: Any) -> Topic:
    stamps = {}
    if t_valid is not None:
        sec, nanosec = np.divmod(np.maximum(_nano(t_valid), 0), _NANO)
        stamps = {"header.stamp.sec": sec, "header.stamp.nanosec": nanosec}
    return Topic(name, kind, _nano(t), cdr.encode_many(template, {**stamps, **columns}))


def _xyz(path: str, values: Float[np.ndarray, "N k"], names: str = "xyz") -> dict[str, Float[np.ndarray, " N"]]:
    return {f"{path}.{name}": values[:, k] for k, name in enumerate(names)}


def _pose(path: str, eta: Float[np.ndarray, "N 6"]) -> dict[str, Float[np.ndarray, " N"]]:
    turned = _xyz(f"{path}.orientation", convert.orientation(eta[:, 3:]), "xyzw")
    return {**_xyz(f"{path}.position", convert.enu(eta[:, :3])), **turned}


def _odometry(log: Log, prefix: str, name: str) -> Topic:
    pose, moved = log[f"{prefix}/eta"], log[f"{prefix}/nu"]
    rows = min(len(pose), len(moved))
    t, eta, nu = pose.t[:rows], pose.values[:rows], moved.values[:rows]
    columns = _pose("pose.pose", eta)
    columns |= _xyz("twist.twist.linear", convert.flu(nu[:, :3])) | _xyz("twist.twist.angular", convert.flu(nu[:, 3:]))
    if prefix == "autopilot" and "autopilot/std" in log and len(log["autopilot/std"]) >= rows:
        # The log keeps the diagonal only: correlations are left out.
        variance = np.square(log["autopilot/std"].values[:rows])[:, :, None] * np.eye(12)
        columns["pose.covariance"] = convert.pose_covariance(variance[:, :6, :6], eta[:, 3:]).reshape(rows, 36)
        columns["twist.covariance"] = convert.twist_covariance(variance[:, 6:, 6:]).reshape(rows, 36)
    template = msg.Odometry(msg.Header(frame_id=convert.ODOM), convert.BASE)
    return _made(name, msg.Odometry, t, t, columns, template)


def _tf(series: Series) -> Topic:
    template = msg.TFMessage(
        [
            msg.TransformStamped(msg.Header(frame_id=convert.MAP), convert.ODOM),
            msg.TransformStamped(msg.Header(frame_id=convert.ODOM), convert.BASE),
        ]
    )
    sec, nanosec = np.divmod(_nano(series.t), _NANO)
    columns = {
        f"transforms.{k}.header.stamp.{name}": v for k in (0, 1) for name, v in (("sec", sec), ("nanosec", nanosec))
    }
    moved = "transforms.1.transform"
    columns |= _xyz(f"{moved}.translation", convert.enu(series.values[:, :3]))
    columns |= _xyz(f"{moved}.rotation", convert.orientation(series.values[:, 3:]), "xyzw")
    return _made("/tf", msg.TFMessage, series.t, None, columns, template)


def _imu(log: Log, name: str) -> Topic | None:
    """Attitude, gyro and accelerometer that were valid and delivered at the same instant are one message."""
    found = {s: log[f"sensor/{s}"] for s in ("attitude", "gyro", "accelerometer") if f"sensor/{s}" in log}
    keys = {
        s: np.stack([_nano(series.t), _nano(series["t_valid"])], axis=1) for s, series in found.items() if len(series)
    }
    if not keys:
        return None
    times = np.unique(np.concatenate(list(keys.values())), axis=0)
    columns: dict[str, np.ndarray] = {}
    parts = {
        "attitude": ("orientation", "xyzw", convert.orientation),
        "gyro": ("angular_velocity", "xyz", convert.flu),
        "accelerometer": ("linear_acceleration", "xyz", convert.flu),
    }
    index = {tuple(row): k for k, row in enumerate(times.tolist())}
    for sensor, (field, names, change) in parts.items():
        covariance = np.zeros((len(times), 9))
        covariance[:, 0] = -1.0  # absent, unless a reading says otherwise
        values = np.tile([0.0] * (len(names) - 1) + [float(len(names) == 4)], (len(times), 1))
        if sensor in keys:
            rows = [index[tuple(row)] for row in keys[sensor].tolist()]
            values[rows], covariance[rows, 0] = change(_in_body(log, sensor)), 0.0
        columns |= _xyz(field, values, names)
        columns[f"{field}_covariance"] = covariance
    template = msg.Imu(msg.Header(frame_id=convert.BASE))
    return _made(name, msg.Imu, times[:, 0] / _NANO, times[:, 1] / _NANO, columns, template)


def _sheet(log: Log, sensor: str) -> dict[str, Any]:
    """What a log says of one of its sensors: `lever` [m] and `rotation` to b among it; empty where it says nothing."""
    try:
        return json.loads(log.metadata.get("sensors", "{}")).get(sensor, {})
    except ValueError:
        return {}


def _in_body(log: Log, sensor: str) -> Float[np.ndarray, "N 3"]:
    """Three readings of a sensor, along the axes of b; as they are where the log says no mounting."""
    values, rotation = log[f"sensor/{sensor}"].values[:, :3], _sheet(log, sensor).get("rotation")
    if rotation is None or np.allclose(rotation, np.eye(3)):
        return values
    return np.asarray(readings_in_body(as_array(values), sensor, as_array(rotation)))


_Made = tuple[type, np.ndarray | None, dict[str, np.ndarray], Any]


def _pressure(_: Log, series: Series) -> _Made:
    water = convert.Water()
    absolute = water.atmosphere + water.density * water.gravity * series["depth"]
    return msg.FluidPressure, series["t_valid"], {"fluid_pressure": absolute}, msg.FluidPressure(_base())


def _position(_: Log, series: Series) -> _Made:
    place = convert.enu(np.column_stack([series["north"], series["east"], np.zeros(len(series))]))
    return (
        msg.PoseWithCovarianceStamped,
        series["t_valid"],
        _xyz("pose.pose.position", place),
        convert.position(0, (0, 0)),
    )


def _dvl(log: Log, series: Series) -> _Made:
    moved = _xyz("twist.twist.linear", convert.flu(_in_body(log, "dvl")))
    return msg.TwistWithCovarianceStamped, series["t_valid"], moved, convert.velocity(0, (0, 0, 0))


def _altimeter(log: Log, series: Series) -> _Made:
    sheet = _sheet(log, "altimeter")
    beam, lever = np.array([0.0, 0.0, 1.0]), np.zeros(3)  # straight down from CO, where the log does not say
    if "rotation" in sheet:
        beam, lever = np.array(sheet["rotation"])[:, 0], np.array(sheet.get("lever", lever))
    seen = _xyz("point", convert.flu(lever + np.outer(series["range"], beam)))
    return msg.PointStamped, series["t_valid"], seen, convert.floor(0, 0)


def _battery(_: Log, series: Series) -> _Made:
    return msg.BatteryState, series["t_valid"], {"percentage": series["charge"]}, convert.battery(0, 0, 0)


def _reference(_: Log, series: Series) -> _Made:
    return msg.PoseStamped, series.t, _pose("pose", series.values), convert.pose(0, [0] * 3, [0] * 3)


def _wrench(_: Log, series: Series) -> _Made:
    force, torque = convert.flu(series.values[:, :3]), convert.flu(series.values[:, 3:])
    columns = _xyz("wrench.force", force) | _xyz("wrench.torque", torque)
    return msg.WrenchStamped, series.t, columns, msg.WrenchStamped(_base())


def _thrusters(_: Log, series: Series) -> _Made:
    empty = convert.numbers([0.0] * series.values.shape[1])
    return msg.Float64MultiArray, None, {"data": series.values}, empty


def _base() -> msg.Header:
    return msg.Header(frame_id=convert.BASE)


# channel -> (topic, type, times of validity, columns and template of it)
_MAKERS: dict[str, tuple[str, Callable[[Log, Series], _Made]]] = {
    "autopilot/reference": ("reference", _reference),
    "autopilot/tau": ("wrench", _wrench),
    "autopilot/command": ("thrusters", _thrusters),
    "sensor/pressure": ("pressure", _pressure),
    "sensor/position": ("position", _position),
    "sensor/dvl": ("dvl", _dvl),
    "sensor/altimeter": ("altimeter", _altimeter),
    "sensor/battery": ("battery", _battery),
}
