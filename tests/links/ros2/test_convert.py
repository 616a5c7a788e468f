"""ENU/FLU at the boundary: axioms of the frames, messages there and back, and that nothing strange gets through."""

import dataclasses
import math
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rovtwin.core import frames
from rovtwin.core.errors import LinkError
from rovtwin.links.ros2 import cdr, convert, listen
from rovtwin.links.ros2 import messages as msg
from rovtwin.links.ros2.pilot import Pilot

EXAMPLES = 300
WATER = convert.Water()
angles = st.tuples(
    st.floats(-math.pi, math.pi), st.floats(-1.5, 1.5), st.floats(-math.pi, math.pi)
)  # roll, pitch short of the singularity, yaw
numbers = st.floats(allow_nan=True, allow_infinity=True, width=64)


def rotation(xyzw) -> np.ndarray:
    x, y, z, w = xyzw
    return np.asarray(frames.rotation_from_quaternion(np.array([w, x, y, z])))


# --------------------------------------------------------------------------------------------------------- frames


def test_axes_are_right_handed_and_there_and_back_is_nothing():
    for change in (convert.enu, convert.flu):
        matrix = change(np.eye(3))
        assert np.linalg.det(matrix) == pytest.approx(1.0)
        assert np.array_equal(change(change(np.array([1.0, 2.0, 3.0]))), [1.0, 2.0, 3.0])
    assert convert.enu([1.0, 2.0, 3.0]).tolist() == [2.0, 1.0, -3.0]
    assert convert.flu([1.0, 2.0, 3.0]).tolist() == [1.0, -2.0, -3.0]


def test_a_dive_is_negative_z_and_a_turn_to_starboard_negative_about_z():
    found = convert.odometry(0.0, [0, 0, 5.0, 0, 0, 0], [0, 0, 0.3, 0, 0, 0.2])
    assert found.pose.pose.position.z == -5.0
    assert found.twist.twist.linear.z == -0.3
    assert found.twist.twist.angular.z == -0.2
    assert found.header.frame_id == "odom" and found.child_frame_id == "base_link"


@pytest.mark.parametrize(("heading", "yaw"), [(0.0, 90.0), (90.0, 0.0), (180.0, -90.0), (-90.0, 180.0), (45.0, 45.0)])
def test_heading_east_is_yaw_zero(heading, yaw):
    x, y, z, w = convert.orientation([0.0, 0.0, math.radians(heading)])
    assert abs(x) < 1e-12 and abs(y) < 1e-12
    found = math.degrees(2 * math.atan2(z, w))
    assert (found - yaw + 180) % 360 - 180 == pytest.approx(0.0, abs=1e-9)


@pytest.mark.system
@given(angles)
@settings(max_examples=EXAMPLES, deadline=None)
def test_orientation_is_the_same_attitude_seen_in_the_frames_of_ros(euler):
    """v in FLU, taken to ENU by ROS's quaternion, is v in FRD, taken to NED by ours."""
    v = np.array([0.3, -0.5, 0.8])
    ours = np.asarray(frames.rotation_from_euler(np.array(euler))) @ v
    theirs = rotation(convert.orientation(euler)) @ convert.flu(v)
    np.testing.assert_allclose(theirs, convert.enu(ours), atol=1e-12)
    back = convert.euler(convert.orientation(euler))
    np.testing.assert_allclose(frames.rotation_from_euler(back), frames.rotation_from_euler(np.array(euler)), atol=1e-9)


def test_specific_force_at_rest_points_up():
    at_rest = convert.imu(0.0, accelerometer=[0.0, 0.0, -9.81])
    assert at_rest.linear_acceleration.z == 9.81
    assert at_rest.orientation_covariance[0] == -1 and at_rest.linear_acceleration_covariance[0] == 0


def test_covariance_is_that_of_the_converted_errors():
    """Against a cloud of points: pose errors as ROS means them, turns about the fixed axes of ENU."""
    rng = np.random.default_rng(3)
    euler = np.array([0.4, -0.6, 2.1])
    root = rng.normal(size=(12, 12)) * 1e-4
    covariance = root @ root.T
    errors = rng.multivariate_normal(np.zeros(12), covariance, 20_000)
    found = convert.odometry(0.0, [*np.zeros(3), *euler], np.zeros(6), covariance)
    center = rotation(convert.orientation(euler))
    turns = []
    for error in errors[:, 3:6]:
        turned = rotation(convert.orientation(euler + error)) @ center.T
        turns.append([turned[2, 1], turned[0, 2], turned[1, 0]])
        if len(turns) == 4000:
            break
    there = np.concatenate([convert.enu(errors[:4000, :3]), turns], axis=1)
    expected = np.cov(there.T)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    pose = np.reshape(found.pose.covariance, (6, 6))
    assert np.abs((pose - expected) / scale).max() < 0.08
    twist = np.concatenate([convert.flu(errors[:, 6:9]), convert.flu(errors[:, 9:])], axis=1)
    expected = np.cov(twist.T)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((np.reshape(found.twist.covariance, (6, 6)) - expected) / scale).max() < 0.08


# ----------------------------------------------------------------------------------------------------- there and back


def test_readings_come_back_as_they_were():
    eta, nu = np.array([3.0, -2.0, 4.0, 0.1, -0.2, 2.5]), np.array([0.4, -0.1, 0.05, 0.01, 0.02, -0.3])
    found = listen.odometry(convert.odometry(1.0, eta, nu))
    np.testing.assert_allclose(found["position"], eta[:2])
    np.testing.assert_allclose(found["pressure"], eta[2:3])
    np.testing.assert_allclose(found["attitude"], eta[3:])
    np.testing.assert_allclose(found["dvl"], nu[:3])
    np.testing.assert_allclose(found["gyro"], nu[3:])
    found = listen.imu(convert.imu(1.0, eta[3:], nu[3:], [0.1, 0.2, -9.7]))
    np.testing.assert_allclose(found["attitude"], eta[3:])
    np.testing.assert_allclose(found["accelerometer"], [0.1, 0.2, -9.7])
    assert listen.imu(convert.imu(1.0, gyro=nu[3:])).keys() == {"gyro"}
    assert listen.pressure(convert.pressure(1.0, 12.5, WATER), WATER)["pressure"][0] == pytest.approx(12.5)
    np.testing.assert_allclose(listen.mocap(convert.pose(1.0, eta[:3], eta[3:]))["attitude"], eta[3:])
    np.testing.assert_allclose(listen.position(convert.position(1.0, [7.0, 8.0]))["position"], [7.0, 8.0])
    np.testing.assert_allclose(listen.velocity(convert.velocity(1.0, nu[:3]))["dvl"], nu[:3])
    assert listen.altimeter(convert.floor(1.0, 3.5))["altimeter"] == [3.5]
    np.testing.assert_allclose(listen.battery(convert.battery(1.0, 0.8, 60.0, 15.0))["battery"], [0.8, 60.0])
    assert listen.battery(convert.battery(1.0, 0.8, 60.0))["battery"].tolist() == [0.8, 0.0]


def test_pressure_at_ten_metres_of_fresh_water_is_about_two_atmospheres():
    assert convert.pressure(0.0, 10.0, WATER).fluid_pressure == pytest.approx(199_391.5)


def test_wrench_becomes_shares_in_frd():
    wrench = msg.WrenchStamped(wrench=msg.Wrench(msg.Vector3(50.0, 10.0, 20.0), msg.Vector3(1.0, 2.0, -5.0)))
    found = listen.wrench(wrench, "base_link", (100.0, 100.0, 10.0, 0.0, 20.0, 10.0))
    # Up and to port are negative; more than the largest is the largest; roll cannot be given at all.
    assert found == pytest.approx((0.5, -0.1, -1.0, 0.0, -0.1, 0.5))


def test_way_point_in_map():
    found = listen.target(convert.pose(0.0, [4.0, -3.0, 2.0], [0.0, 0.0, 0.7]), ("map", "odom"))
    assert found == pytest.approx((4.0, -3.0, 2.0, 0.7))


# ---------------------------------------------------------------------------------------------------------- garbage


@pytest.mark.parametrize(
    ("read", "message", "expected_text"),
    [
        (lambda m: listen.wrench(m, "base_link", (1,) * 6), "nan_force", "finite"),
        (lambda m: listen.wrench(m, "base_link", (1,) * 6), "map_frame", "frame_id"),
        (lambda m: listen.target(m, ("map",)), "zero_quaternion", "unit quaternion"),
        (lambda m: listen.target(m, ("map",)), "inf_place", "finite"),
        (listen.battery, "full_and_more", "percentage"),
        (lambda m: listen.stamp_of(m), "no_time", "stamp"),
    ],
)
def test_nonsense_is_refused(read, message, expected_text):
    made = {
        "nan_force": msg.WrenchStamped(wrench=msg.Wrench(msg.Vector3(math.nan))),
        "map_frame": msg.WrenchStamped(msg.Header(frame_id="map")),
        "zero_quaternion": msg.PoseStamped(pose=msg.Pose(orientation=msg.Quaternion(0.0, 0.0, 0.0, 0.0))),
        "inf_place": msg.PoseStamped(pose=msg.Pose(msg.Point(math.inf))),
        "full_and_more": msg.BatteryState(percentage=80.0),
        "no_time": msg.Time(5, 2_000_000_000),
    }
    with pytest.raises(LinkError, match=expected_text):
        read(made[message])


def values_of(ros: str, inner):
    base, _, size = ros.partition("[")
    if inner is not None and not size:
        return anything(inner)
    plain = {
        **{"string": st.text(max_size=8), "bool": st.booleans(), "float64": numbers, "float32": numbers},
        **{"int32": st.integers(-(2**31), 2**31 - 1), "uint32": st.integers(0, 2**32 - 1)},
        "uint8": st.integers(0, 255),
    }
    one = plain[base] if inner is None else anything(inner)
    if not size:
        return one
    if size == "]":
        return st.lists(one, max_size=4)
    # Numbers of a covariance do not matter but for the first: fill up with zeros.
    return one.map(lambda first: [first] + [0.0] * (int(size[:-1]) - 1))


def anything(kind: type):
    """Any message of a type."""
    return st.builds(kind, **{name: values_of(ros, inner) for name, ros, inner in msg.layout(kind)})


def readers():
    frame = ("map", "odom")
    return {
        msg.Imu: listen.imu,
        msg.FluidPressure: lambda m: listen.pressure(m, WATER),
        msg.Odometry: listen.odometry,
        msg.PoseStamped: lambda m: {"target": np.array(listen.target(m, frame))},
        msg.PoseWithCovarianceStamped: listen.position,
        msg.TwistWithCovarianceStamped: listen.velocity,
        msg.PointStamped: listen.altimeter,
        msg.BatteryState: listen.battery,
        msg.WrenchStamped: lambda m: {"wrench": np.array(listen.wrench(m, "base_link", (10.0,) * 6))},
    }


def fuzz(kind: type, read, examples: int) -> None:
    @given(anything(kind))
    @settings(max_examples=examples, deadline=None, suppress_health_check=list(HealthCheck), database=None)
    def check(message):
        try:
            found = listen.guarded(read, message)
            listen.guarded(listen.stamp_of, message.header.stamp)
        except LinkError:
            return
        for value in found.values():
            assert np.isfinite(value).all()

    check()


@pytest.mark.parametrize("kind", readers(), ids=lambda kind: kind.__name__)
def test_any_message_gives_finite_readings_or_a_link_error(kind):
    fuzz(kind, readers()[kind], 100)


@pytest.mark.slow
def test_a_hundred_thousand_messages():
    """A ninth of them of each type."""
    for kind, read in readers().items():
        fuzz(kind, read, 100_000 // len(readers()) + 1)


# ---------------------------------------------------------------------------------------------------- bytes and names


def test_types_are_those_of_ros_2():
    """Field by field, against the interface definitions that rosbags carries, of Humble and of Jazzy."""
    typesys = pytest.importorskip("rosbags.typesys")
    for store in (typesys.Stores.ROS2_HUMBLE, typesys.Stores.ROS2_JAZZY, typesys.Stores.ROS2_KILTED):
        known = typesys.get_typestore(store)
        ours = typesys.get_typestore(typesys.Stores.EMPTY)
        for name, kind in msg.TYPES.items():
            found = typesys.get_types_from_msg(cdr.definition(kind), name)
            ours.register({k: v for k, v in found.items() if k not in ours.fielddefs})
            assert ours.fielddefs[name][1] == known.fielddefs[name][1], name


@pytest.mark.parametrize("name", sorted(msg.TYPES))
def test_bytes_are_read_by_rosbags(name):
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    message = filled(msg.TYPES[name])
    assert same(store.deserialize_cdr(cdr.encode(message), name), message)


def filled(kind: type, count: list[int] | None = None):
    """A message in which every number is another."""
    count = count or [0]

    def one(base, inner):
        if inner is not None:
            return filled(inner, count)
        count[0] += 1
        return {"string": "a" * (count[0] % 5), "bool": True}.get(base, count[0] % 200)

    values = {}
    for name, ros, inner in msg.layout(kind):
        base, _, size = ros.partition("[")
        length = None if not size else 3 if size == "]" else int(size[:-1])
        values[name] = one(base, inner) if length is None else [one(base, inner) for _ in range(length)]
    return kind(**values)


def same(theirs, ours) -> bool:
    if dataclasses.is_dataclass(ours):
        return all(same(getattr(theirs, f.name), getattr(ours, f.name)) for f in dataclasses.fields(ours))
    if isinstance(ours, list):
        return len(theirs) == len(ours) and all(same(a, b) for a, b in zip(theirs, ours, strict=True))
    return theirs == ours


def test_many_messages_are_the_same_bytes_as_one_by_one():
    x = np.array([1.5, -2.5, 3.5])
    many = cdr.encode_many(convert.position(0, (0, 0)), {"pose.pose.position.x": x, "header.stamp.sec": [7, 8, 9]})
    for k in range(3):
        one = convert.position(0, (0, 0))
        one.pose.pose.position.x, one.header.stamp.sec = x[k], 7 + k
        assert many[k].tobytes() == cdr.encode(one)
    assert struct.unpack_from("<i", many[2].tobytes(), 4) == (9,)


# ------------------------------------------------------------------------------------------------------------- pilot


class TestPilot:
    half = (0.5, 0, 0, 0, 0, 0)

    def test_nothing_is_commanded_before_a_client_arms(self):
        pilot = Pilot("", 0.5)
        assert not pilot.receive_motion(0.0, self.half) and not pilot.receive_target(0.0, (1, 2, 3, 0))
        assert pilot.command(0.0) is None

    def test_a_wrench_that_stops_coming_disarms_once_even_while_arm_goes_on(self):
        pilot = Pilot("", 0.5)
        pilot.receive_arm(0.0, True)
        pilot.receive_motion(0.1, self.half)
        assert pilot.command(0.55).motion == self.half
        pilot.receive_arm(0.59, True)
        command = pilot.command(0.65)
        assert command is not None and not command.armed and not any(command.motion)
        assert pilot.command(0.7) is None
        assert not pilot.receive_motion(0.7, self.half), "a wrench alone must not arm"

    def test_a_way_point_holds_while_arm_is_repeated(self):
        pilot = Pilot("", 0.5)
        for k in range(20):
            pilot.receive_arm(0.2 * k, True)
            if k == 0:
                assert pilot.receive_target(0.0, (1.0, 2.0, 3.0, 0.5))
            assert pilot.command(0.2 * k + 0.1).target == (1.0, 2.0, 3.0, 0.5)
        assert not pilot.command(4.5).armed
        assert pilot.command(4.6) is None

    def test_a_wrench_overrides_and_forgets_a_way_point(self):
        pilot = Pilot("", 0.5)
        pilot.receive_arm(0.0, True)
        pilot.receive_target(0.0, (1.0, 2.0, 3.0, 0.5))
        pilot.receive_motion(0.1, self.half)
        assert pilot.command(0.1).target is None
        assert not pilot.receive_target(0.2, (1.0, 2.0, 3.0, 0.5))

    def test_false_disarms_at_once(self):
        pilot = Pilot("", 0.5)
        pilot.receive_arm(0.0, True)
        pilot.receive_motion(0.0, self.half)
        pilot.receive_arm(0.1, False)
        assert not pilot.command(0.1).armed and pilot.command(0.1) is None and pilot.end() is None

    def test_the_end_disarms(self):
        pilot = Pilot("", 0.5)
        pilot.receive_arm(0.0, True)
        assert not pilot.end().armed
