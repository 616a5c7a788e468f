"""Vendors' formats: one motion, written by each format's own library, comes back in NED and FRD."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.conftest import shared_folder

from rovtwin.core.arrays.rotations import euler_from_rotation, rotation_from_euler
from rovtwin.core.errors import IdentificationError
from rovtwin.identification.logs.evidence_file import LogSpec, SourceSpec
from rovtwin.identification.logs.readers import detect, read_record
from rovtwin.identification.logs.readers.c3d import rigid_fit
from rovtwin.identification.logs.readers.qtm import read_qtm
from rovtwin.identification.logs.readers.reading import read_raw
from rovtwin.vehicle import load_vehicle

T = np.arange(0.0, 3.0, 0.05)
EULER = np.stack([0.3 * np.sin(T), 0.2 * np.cos(T), 0.5 * T], axis=1)
PLACE = np.stack([T, 0.5 * T, 2.0 + 0.1 * T], axis=1)
RATE = np.stack([0.1 * np.cos(T), 0.2 * np.sin(T), 0.5 + 0 * T], axis=1)
SPEED = np.stack([0.4 * np.cos(T), 0.1 * np.sin(T), 0.05 + 0 * T], axis=1)
FLIP = np.array([1.0, -1.0, -1.0])
NED_ENU = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
R_NB = rotation_from_euler(EULER)
MARKERS = {"bow": [0.2, 0, -0.1], "port": [-0.1, -0.2, -0.1], "starboard": [-0.1, 0.2, -0.12], "mast": [0, 0, -0.3]}


@pytest.fixture(scope="module")
def vehicle():
    return load_vehicle("bluerov2")


@pytest.fixture(scope="module")
def command(vehicle):
    return np.random.default_rng(2).uniform(-1, 1, (len(T), len(vehicle.thruster_names)))


def check_pose(record, atol=1e-6):
    position, attitude = record.signals["position"], record.signals["attitude"]
    expected = [np.interp(position.t, T, axis) for axis in PLACE.T]
    np.testing.assert_allclose(position.value, np.stack(expected, axis=1), atol=atol)
    kept = np.searchsorted(T, attitude.t - 1e-6)
    np.testing.assert_allclose(attitude.value, euler_from_rotation(R_NB)[kept], atol=atol)


def with_commands(folder, vehicle, command, source):
    """A motion capture file and the CSV that has the commands, as one test."""
    header = ",".join(["t", *vehicle.thruster_names])
    np.savetxt(folder / "commands.csv", np.column_stack([T, command]), delimiter=",", header=header, comments="")
    spec = LogSpec.model_validate({"name": "run", "files": [source, {"file": "commands.csv"}]})
    return read_record(folder, vehicle, spec)


def test_qtm_angles_are_those_of_the_matrix():
    """The public export itself says its convention: R = Rx(roll) Ry(pitch) Rz(yaw), stored column by column."""
    path = shared_folder("data", "qualisys") / "psv_model_6d.tsv"
    raw = read_qtm(path)
    table = raw.tables["PSVH"].values
    seen = np.isfinite(table).all(axis=1)
    assert seen.sum() > 2000
    matrix = table[seen, 7:16].reshape(-1, 3, 3).transpose(0, 2, 1)
    from_angles = Rotation.from_euler("XYZ", table[seen, 3:6], degrees=True).as_matrix()
    np.testing.assert_allclose(matrix, from_angles, atol=2e-5)
    # Row by row it would be another rotation.
    assert np.abs(matrix.transpose(0, 2, 1) - from_angles).max() > 1e-3


def test_qtm_with_gaps(tmp_path, vehicle, command):
    R_wv = np.diag(FLIP) @ R_NB @ np.diag(FLIP)
    angles = Rotation.from_matrix(R_wv).as_euler("XYZ", degrees=True)
    rows = np.column_stack(
        [1000 * PLACE * FLIP, angles, 0 * T, R_wv.transpose(0, 2, 1).reshape(-1, 9)],
    )
    rows[10:15] = 0.0
    lines = ["FREQUENCY\t20", "BODY_NAMES\tROV", "Frame\tTime\tROV X\tY\tZ\tRoll\tPitch\tYaw\tResidual\tRot[0]"]
    lines += [
        f"{i + 1}\t{t:.5f}\t" + "\t".join(f"{x:.8f}" for x in row)
        for i, (t, row) in enumerate(zip(T, rows, strict=True))
    ]
    lines[3 + 20] = f"21\t{T[20]:.5f}" + "\t" * 16
    (tmp_path / "qtm.tsv").write_text("\n".join(lines) + "\n")
    record = with_commands(tmp_path, vehicle, command, {"file": "qtm.tsv"})
    assert len(record.signals["position"].t) == len(T) - 6
    check_pose(record)
    assert any("not seen in 6 of 60" in note for note in record.notes)


def test_motion_capture_alone_asks_for_commands(tmp_path, vehicle):
    path = shared_folder("data", "qualisys") / "psv_model_6d.tsv"
    with pytest.raises(IdentificationError, match="list the file that has them under 'files'"):
        read_record(path, vehicle)


def write_c3d(path, points, labels, rotations=None):
    ezc3d = pytest.importorskip("ezc3d")
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [20.0]
    file["parameters"]["POINT"]["LABELS"]["value"] = labels
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["data"]["points"] = points
    if rotations is not None:
        file.add_parameter("ROTATION", "LABELS", ["ROV"])
        file.add_parameter("ROTATION", "RATE", [20.0])
        file.add_parameter("ROTATION", "RATIO", [1])
        file["data"]["rotations"] = rotations
    file.write(str(path))


def test_c3d_through_markers_with_drop_outs(tmp_path, vehicle, command):
    rng = np.random.default_rng(3)
    local = np.array(list(MARKERS.values()))
    world = (np.einsum("nij,mj->nmi", R_NB, local) + PLACE[:, None]) * FLIP * 1000
    world += rng.normal(0, 0.3, world.shape)
    world[5, 1] = np.nan  # three are left
    world[9, 1:3] = np.nan  # two are left
    points = np.ones((4, len(MARKERS), len(T)))
    points[:3] = world.transpose(2, 1, 0)
    write_c3d(tmp_path / "run.c3d", points, list(MARKERS))
    record = with_commands(tmp_path, vehicle, command, {"file": "run.c3d", "markers": MARKERS})
    assert len(record.signals["position"].t) == len(T) - 1
    check_pose(record, atol=4e-3)
    assert any("residual rms" in note for note in record.notes)


def test_c3d_with_its_own_rotations(tmp_path, vehicle, command):
    transforms = np.tile(np.eye(4)[:, :, None, None], (1, 1, 1, len(T)))
    transforms[:3, :3, 0] = np.moveaxis(np.diag(FLIP) @ R_NB @ np.diag(FLIP), 0, 2)
    transforms[:3, 3, 0] = (1000 * PLACE * FLIP).T
    write_c3d(tmp_path / "run.c3d", np.ones((4, 1, len(T))), ["one"], transforms)
    check_pose(with_commands(tmp_path, vehicle, command, {"file": "run.c3d"}), atol=1e-4)


def test_rigid_fit_is_exact_and_never_mirrors():
    rng = np.random.default_rng(4)
    for _ in range(50):
        model, R = rng.normal(size=(4, 3)), Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
        found, p = rigid_fit(model, model @ R.T + [1, 2, 3])
        np.testing.assert_allclose(found, R, atol=1e-9)
        np.testing.assert_allclose(p, [1, 2, 3], atol=1e-9)
    flat = np.array([[1.0, 0, 0], [0, 1, 0], [-1, -1, 0]])
    assert np.linalg.det(rigid_fit(flat, flat * [1, 1, -1])[0]) == pytest.approx(1.0)


def test_c3d_without_rotations_asks_for_markers(tmp_path, vehicle):
    write_c3d(tmp_path / "run.c3d", np.ones((4, 4, len(T))), list(MARKERS))
    with pytest.raises(IdentificationError, match="places in b"):
        read_record(tmp_path / "run.c3d", vehicle)
    source = SourceSpec.model_validate({"file": "run.c3d", "markers": {"bwo": [0, 0, 0]}})
    with pytest.raises(IdentificationError, match="Did you mean 'bow'"):
        read_raw(tmp_path / "run.c3d", source, vehicle)


def write_bag(path, command, kind):
    """Odometry, an IMU and a multi-array of commands, as ROS 1, ROS 2 (SQLite) or ROS 2 (MCAP)."""
    pytest.importorskip("rosbags")
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)
    kinds = store.types
    odometry, imu, array = "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu", "std_msgs/msg/Float64MultiArray"
    enu_flu = Rotation.from_matrix(NED_ENU @ R_NB @ np.diag(FLIP)).as_quat()
    vector, quaternion = kinds["geometry_msgs/msg/Vector3"], kinds["geometry_msgs/msg/Quaternion"]

    def header(t):
        ns = round(t * 1e9) + 1_700_000_000_000_000_000
        stamp = kinds["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
        more = {"seq": 0} if kind == "ros1" else {}
        return kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="map", **more), ns

    def messages():
        for i, t in enumerate(T):
            head, ns = header(t)
            point = kinds["geometry_msgs/msg/Point"](*(NED_ENU @ PLACE[i]))
            pose = kinds["geometry_msgs/msg/Pose"](position=point, orientation=quaternion(*enu_flu[i]))
            twist = kinds["geometry_msgs/msg/Twist"](linear=vector(*SPEED[i] * FLIP), angular=vector(0.0, 0.0, 9.0))
            cov = np.zeros(36)
            yield (
                odometry,
                "/odom",
                ns,
                kinds[odometry](
                    header=head,
                    child_frame_id="rov",
                    pose=kinds["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=cov),
                    twist=kinds["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=cov),
                ),
            )
            turning = kinds[imu](
                header=head,
                orientation=quaternion(*enu_flu[i]),
                orientation_covariance=np.zeros(9),
                angular_velocity=vector(*RATE[i] * FLIP),
                angular_velocity_covariance=np.zeros(9),
                linear_acceleration=vector(0.0, 0.0, 9.81),
                linear_acceleration_covariance=np.zeros(9),
            )
            yield imu, "/imu", ns, turning
            layout = kinds["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
            yield array, "/thrusters", ns, kinds[array](layout=layout, data=command[i])

    if kind == "ros1":
        writer, serialise = rosbag1.Writer(path), store.serialize_ros1
    else:
        plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
        writer, serialise = rosbag2.Writer(path, version=9, storage_plugin=plugin), store.serialize_cdr
    with writer:
        connections = {}
        for msgtype, topic, ns, message in messages():
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, msgtype, typestore=store)
            writer.write(connections[topic], ns, serialise(message, msgtype))
    return path


@pytest.mark.parametrize("kind", ["ros1", "ros2", "mcap", "mcap file"])
def test_ros_bags(tmp_path, vehicle, command, kind):
    path = write_bag(tmp_path / ("run.bag" if kind == "ros1" else "run"), command, kind.split()[0])
    if kind == "mcap file":
        path = next(path.glob("*.mcap"))
    assert detect(path) == "rosbag"
    record = read_record(path, vehicle)
    check_pose(record)
    np.testing.assert_allclose(record.signals["gyro"].value, RATE[: len(record.signals["gyro"].t)], atol=1e-9)
    np.testing.assert_allclose(record.signals["velocity"].value, SPEED[: len(record.signals["velocity"].t)], atol=1e-9)
    np.testing.assert_allclose(record.signals["accelerometer"].value[0], [0, 0, -9.81], atol=1e-9)
    np.testing.assert_allclose(record.command, command[: len(record.command)])
    assert any("gyro: /imu taken, not /odom" in note for note in record.notes)


def varint(number):
    """A length as protobuf writes it: 7 bits a byte, least significant first."""
    head = bytearray()
    while number > 127:
        head.append(number & 127 | 128)
        number >>= 7
    return bytes([*head, number])


def write_bez(path, command, cut=0):
    """A log of a Blueye as its SDK reads it: length-prefixed BinlogRecord messages, compressed."""
    bp = pytest.importorskip("blueye.protocol")
    import gzip

    from google.protobuf.any_pb2 import Any as AnyMessage

    start, out = datetime(2026, 1, 1, tzinfo=UTC), bytearray()

    def add(t, message):
        inner = AnyMessage()
        inner.Pack(type(message).pb(message), type_url_prefix="type.googleapis.com")
        record = bp.BinlogRecord(
            payload=inner,
            unix_timestamp=start + timedelta(seconds=t),
            clock_monotonic=datetime(1970, 1, 1, 1, tzinfo=UTC) + timedelta(seconds=t),
        )
        data = bp.BinlogRecord.serialize(record)
        out.extend(varint(len(data)) + data)

    for i, t in enumerate(T.tolist()):
        roll, pitch, yaw = np.degrees(EULER[i]).tolist()
        add(t, bp.AttitudeTel(attitude={"roll": roll, "pitch": pitch, "yaw": yaw}))
        add(t, bp.DepthTel(depth={"value": PLACE[i, 2]}))
        p, q, r = RATE[i].tolist()
        add(t, bp.CalibratedImuTel(imu={"gyroscope": {"x": p, "y": q, "z": r}}))
        surge, sway, heave, yaw = command[i, :4].tolist()
        force = {"surge": 10 * surge, "sway": 5 * sway, "heave": 11 * heave, "yaw": yaw}
        add(t, bp.ControlForceTel(control_force=force))
    data = gzip.compress(bytes(out))
    path.write_bytes(data[: len(data) - cut])
    return path


BLUEYE = {
    "commands": {
        "from": "ControlForceTel",
        "columns": ["surge", "sway", "heave"],
        "mix": {"surge": [0.1, 0, 0], "sway": [0, 0.2, 0], "heave": [0, 0, 1 / 11]},
    }
}


@pytest.mark.parametrize("cut", [0, 40], ids=["whole", "cut off"])
def test_blueye_logs(tmp_path, command, cut):
    path = write_bez(tmp_path / "dive.bez", command, cut)
    record = read_record(path, load_vehicle("blueye_pioneer"), LogSpec.model_validate({"file": path.name, **BLUEYE}))
    attitude, depth, gyro = (record.signals[name] for name in ("attitude", "depth", "gyro"))
    n = len(depth.t)
    assert n >= (len(T) - 1 if not cut else 40)
    np.testing.assert_allclose(depth.value[:, 0], PLACE[:n, 2], atol=1e-5)
    np.testing.assert_allclose(gyro.value, RATE[: len(gyro.t)], atol=1e-6)
    np.testing.assert_allclose(rotation_from_euler(attitude.value), R_NB[: len(attitude.t)], atol=1e-5)
    np.testing.assert_allclose(record.command, command[: len(record.command), :3], atol=1e-6)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("x.bez", "found no messages"),
        ("x.bag", "cannot be read as a ROS bag"),
        ("x.c3d", "cannot be read as C3D"),
        ("x.tsv", "6-DOF export of QTM"),
    ],
)
def test_broken_files_are_refused(tmp_path, vehicle, name, message):
    (tmp_path / name).write_bytes(b"not at all what it says\n")
    with pytest.raises(IdentificationError, match=message):
        read_record(tmp_path / name, vehicle)
