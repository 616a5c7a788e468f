"""A run as a ROS 2 bag: read back by rosbags and, where it is installed, by rclpy itself."""

import importlib.util
import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from rovtwin.cli import main
from rovtwin.core.errors import LogError
from rovtwin.core.frames import (
    euler_from_quaternion,
    quaternion_from_euler,
    quaternion_from_rotation,
    quaternion_multiply,
)
from rovtwin.core.log import Channel, Log
from rovtwin.core.numerics import jnp
from rovtwin.links.ros2.bag import export_rosbag2

highlevel = pytest.importorskip("rosbags.highlevel")
ETA, NU = ("x", "y", "z", "phi", "theta", "psi"), ("u", "v", "w", "p", "q", "r")


@pytest.fixture
def log() -> Log:
    t = np.arange(0, 3.0, 0.1)
    eta = np.column_stack([t, 2 * t, 3 + t, 0 * t, 0 * t, 0.5 + 0 * t])
    nu = np.column_stack([1 + 0 * t, 0 * t, 0.5 + 0 * t, 0 * t, 0 * t, 0.1 + 0 * t])
    late = t[::10] + 0.05
    data = {
        "truth/eta": (t, eta),
        "truth/nu": (t, nu),
        "autopilot/eta": (t, eta + 0.01),
        "autopilot/nu": (t, nu),
        "autopilot/std": (t, np.tile(np.arange(1.0, 13.0), (len(t), 1))),
        "autopilot/command": (t, np.tile([0.1, -0.2], (len(t), 1))),
        "sensor/gyro": (t, np.column_stack([nu[:, 3:], t])),
        "sensor/attitude": (late, np.column_stack([np.tile([0.0, 0.0, 0.5], (len(late), 1)), t[::10]])),
        "sensor/pressure": (late, np.column_stack([np.full(len(late), 10.0), t[::10]])),
        "sensor/position": (late, np.column_stack([np.tile([3.0, 4.0], (len(late), 1)), t[::10]])),
    }
    fields = {
        "truth/eta": ETA,
        "truth/nu": NU,
        "autopilot/eta": ETA,
        "autopilot/nu": NU,
        "autopilot/command": ("a", "b"),
    }
    fields |= {"autopilot/std": tuple(f"std_{name}" for name in ETA + NU), "sensor/gyro": ("x", "y", "z", "t_valid")}
    fields |= {"sensor/attitude": ("phi", "theta", "psi", "t_valid"), "sensor/pressure": ("depth", "t_valid")}
    fields |= {"sensor/position": ("north", "east", "t_valid")}
    return Log.from_arrays([Channel(name, fields[name], "1", "") for name in data], data)


def read(path: Path) -> dict[str, list]:
    found: dict[str, list] = {}
    with highlevel.AnyReader([path]) as reader:
        for connection, stamp, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            found.setdefault(connection.topic, []).append((stamp, message))
        assert {c.topic: c.msgcount for c in reader.connections} == {t: len(rows) for t, rows in found.items()}
        assert reader.message_count == sum(map(len, found.values()))
    return found


def test_standard_messages_in_the_frames_of_ros(log, tmp_path):
    found = read(export_rosbag2(log, tmp_path / "run"))
    stamp, last = found["/rov/odometry"][-1]
    assert stamp == 2_900_000_000 == last.header.stamp.sec * 10**9 + last.header.stamp.nanosec
    place = last.pose.pose.position
    assert [place.x, place.y, place.z] == pytest.approx([5.81, 2.91, -5.91])
    yaw = math.pi / 2 - 0.51
    assert last.pose.pose.orientation.z == pytest.approx(math.sin(yaw / 2), abs=1e-4)
    assert [last.twist.twist.linear.z, last.twist.twist.angular.z] == pytest.approx([-0.5, -0.1])
    variance = np.diag(last.twist.covariance.reshape(6, 6))
    assert variance == pytest.approx(np.arange(7.0, 13.0) ** 2)
    # North and east change places.
    assert np.diag(last.pose.covariance.reshape(6, 6))[:3] == pytest.approx([4.0, 1.0, 9.0])
    assert found["/rov/truth/odometry"][-1][1].pose.pose.position.z == pytest.approx(-5.9)
    moved = found["/tf"][-1][1].transforms
    assert [(m.header.frame_id, m.child_frame_id) for m in moved] == [("map", "odom"), ("odom", "base_link")]
    assert moved[1].transform.translation.z == pytest.approx(-5.91)
    assert found["/rov/thrusters"][0][1].data.tolist() == [0.1, -0.2]


def test_a_reading_is_stamped_when_valid_and_in_the_bag_when_delivered(log, tmp_path):
    found = read(export_rosbag2(log, tmp_path / "run"))
    stamp, reading = found["/rov/pressure"][1]
    assert stamp == 1_050_000_000 and (reading.header.stamp.sec, reading.header.stamp.nanosec) == (1, 0)
    assert reading.fluid_pressure == pytest.approx(101_325 + 98_066.5)
    assert [found["/rov/position"][0][1].pose.pose.position.x] == [4.0]
    inertial = [m for _, m in found["/rov/imu"]]
    assert len(inertial) == 33
    assert sum(m.orientation_covariance[0] == -1 for m in inertial) == 30
    assert sum(m.angular_velocity_covariance[0] == -1 for m in inertial) == 3


def test_readings_of_turned_sensors_are_along_the_axes_of_base_link(tmp_path):
    """An IMU upside down and a quarter to starboard, a DVL half round, an altimeter that looks ahead from the bow."""
    t = np.array([0.0, 0.1])
    R = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # its x to starboard, y ahead, z up
    omega, force = np.array([0.1, 0.2, 0.3]), np.array([1.0, 2.0, -9.0])
    attitude = np.array([0.0, 0.0, 0.5])  # of b: heading 0.5 rad; of the IMU that of R_nb R
    q = quaternion_multiply(quaternion_from_euler(jnp.array(attitude)), quaternion_from_rotation(jnp.array(R)))
    readings = {
        "gyro": (R.T @ omega, "xyz"), "accelerometer": (R.T @ force, "xyz"), "dvl": (np.array([-0.4, 0.1, 0.0]), "uvw"),
        "attitude": (np.asarray(euler_from_quaternion(q)), ("phi", "theta", "psi")),
        "altimeter": (np.array([2.0]), ("range",)),
    }  # fmt: skip
    data = {f"sensor/{name}": (t, np.column_stack([np.tile(v, (2, 1)), t])) for name, (v, _) in readings.items()}
    channels = [Channel(f"sensor/{name}", (*names, "t_valid"), "1", "") for name, (_, names) in readings.items()]
    sheets = {name: {"rotation": R.tolist()} for name in ("gyro", "accelerometer", "attitude")}
    sheets |= {"dvl": {"rotation": np.diag([-1.0, -1.0, 1.0]).tolist()}}
    sheets |= {"altimeter": {"rotation": np.eye(3).tolist(), "lever": [0.3, 0.0, 0.1]}}
    log = Log.from_arrays(channels, data, {"sensors": json.dumps(sheets)})
    found = read(export_rosbag2(log, tmp_path / "run"))
    imu = found["/rov/imu"][0][1]
    rate, specific, moved = imu.angular_velocity, imu.linear_acceleration, found["/rov/dvl"][0][1].twist.twist.linear
    assert imu.header.frame_id == "base_link"
    assert [rate.x, rate.y, rate.z] == pytest.approx([0.1, -0.2, -0.3])  # FLU
    assert [specific.x, specific.y, specific.z] == pytest.approx([1.0, -2.0, 9.0])
    assert [moved.x, moved.y] == pytest.approx([0.4, 0.1])
    yaw = math.pi / 2 - 0.5
    assert abs(imu.orientation.z) == pytest.approx(math.sin(yaw / 2)) and imu.orientation.x == pytest.approx(0.0)
    point = found["/rov/altimeter"][0][1].point
    assert [point.x, point.y, point.z] == pytest.approx([2.3, 0.0, -0.1])


@pytest.mark.skipif(importlib.util.find_spec("rclpy") is None, reason="no rclpy: see the extra 'test'")
def test_rclpy_reads_the_messages(log, tmp_path):
    """In a process of its own: rclpy brings its libraries with it."""
    path = export_rosbag2(log, tmp_path / "run")
    code = f"""
import importlib
from mcap.reader import make_reader
from rclpy.serialization import deserialize_message
with open({str(next(path.glob("*.mcap")))!r}, "rb") as stream:
    for schema, channel, message in make_reader(stream).iter_messages():
        package, _, name = schema.name.split("/")
        if package != "tf2_msgs":  # is not among the wheels
            found = deserialize_message(message.data, getattr(importlib.import_module(package + ".msg"), name))
            if channel.topic == "/rov/odometry":
                last = found
print(last.pose.pose.position.z, last.header.frame_id, last.child_frame_id)
"""
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60).stdout
    depth, *frames = out.split()
    assert float(depth) == pytest.approx(-5.91) and frames == ["odom", "base_link"]


def test_metadata_are_those_of_a_bag(log, tmp_path):
    path = export_rosbag2(log, tmp_path / "run")
    reported = yaml.safe_load((path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert reported["storage_identifier"] == "mcap" and reported["relative_file_paths"] == ["run_0.mcap"]
    assert (path / "run_0.mcap").exists()
    assert reported["duration"]["nanoseconds"] == 2_900_000_000


def test_what_is_there_is_kept(log, tmp_path):
    export_rosbag2(log, tmp_path / "run")
    with pytest.raises(LogError, match="exists already"):
        export_rosbag2(log, tmp_path / "run")
    export_rosbag2(log, tmp_path / "run", overwrite=True)


def test_a_log_of_something_else(tmp_path):
    log = Log.from_arrays([Channel("a", ("x",), "m", "")], {"a": ([0.0], [[1.0]])})
    with pytest.raises(LogError, match="nothing for a ROS 2 bag"):
        export_rosbag2(log, tmp_path / "run")


def test_command_line(log, tmp_path, monkeypatch, capsys):
    log.write(tmp_path / "log.mcap")
    monkeypatch.setattr(
        sys, "argv", ["rovtwin", "log", "export", str(tmp_path / "log.mcap"), str(tmp_path / "bag"), "--to", "rosbag2"]
    )
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code in (0, None)
    assert len(read(tmp_path / "bag")["/rov/odometry"]) == 30
