"""The messages of ROS 2 that we speak, as plain dataclasses.

Names and types of the fields are those of the published interface definitions, the same in Humble, Jazzy and Kilted
(which is why `sensor_msgs/Range` is not among them: it has one field more since Iron). From these classes come the
types of cyclonedds (`transport_cyclone`), the schemas and the bytes of bags (`cdr`) and what rclpy gets.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Annotated, Any, TypeVar, get_type_hints

Float64 = Annotated[float, "float64"]
Float32 = Annotated[float, "float32"]
Int32 = Annotated[int, "int32"]
UInt32 = Annotated[int, "uint32"]
UInt8 = Annotated[int, "uint8"]
Float64s = Annotated[Sequence[float], "float64[]"]
Float32s = Annotated[Sequence[float], "float32[]"]
Strings = Annotated[Sequence[str], "string[]"]
Matrix3 = Annotated[Sequence[float], "float64[9]"]
Matrix6 = Annotated[Sequence[float], "float64[36]"]

TYPES: dict[str, type] = {}  # by full name, such as `sensor_msgs/msg/Imu`
_T = TypeVar("_T", bound=type)


def _of(package: str):
    """Register the class as `<package>/msg/<its name>`."""

    def register(cls: _T) -> _T:
        cls.ROS = f"{package}/msg/{cls.__name__}"  # type: ignore[attr-defined]
        TYPES[cls.ROS] = cls  # type: ignore[attr-defined]
        return cls

    return register


def ros_name(cls: type) -> str:
    """Full name of a message class, such as `sensor_msgs/msg/Imu`."""
    return cls.ROS  # type: ignore[attr-defined]


def layout(cls: type) -> list[tuple[str, str, type | None]]:
    """Fields of a message class: name, type as ROS writes it, and the class where it is a message or a list of them."""
    hints = get_type_hints(cls, include_extras=True)
    found: list[tuple[str, str, type | None]] = []
    for item in fields(cls):
        hint: Any = hints[item.name]
        if hint is str or hint is bool:
            found.append((item.name, {str: "string", bool: "bool"}[hint], None))
        elif hasattr(hint, "ROS"):
            found.append((item.name, ros_name(hint), hint))
        elif isinstance(hint.__metadata__[0], str):
            found.append((item.name, hint.__metadata__[0], None))
        else:
            found.append((item.name, ros_name(hint.__metadata__[0]) + "[]", hint.__metadata__[0]))
    return found


def _zeros(count: int) -> Any:
    return field(default_factory=lambda: (0.0,) * count)


@_of("builtin_interfaces")
@dataclass
class Time:
    """Seconds and nanoseconds of a clock."""

    sec: Int32 = 0
    nanosec: UInt32 = 0


@_of("std_msgs")
@dataclass
class Header:
    """When and in which frame."""

    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@_of("std_msgs")
@dataclass
class Bool:
    """Yes or no."""

    data: bool = False


@_of("std_msgs")
@dataclass
class MultiArrayDimension:
    """One dimension of an array."""

    label: str = ""
    size: UInt32 = 0
    stride: UInt32 = 0


@_of("std_msgs")
@dataclass
class MultiArrayLayout:
    """Dimensions of an array; empty for a plain list."""

    dim: Annotated[Sequence[MultiArrayDimension], MultiArrayDimension] = ()
    data_offset: UInt32 = 0


@_of("std_msgs")
@dataclass
class Float64MultiArray:
    """Numbers."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    data: Float64s = ()


@_of("geometry_msgs")
@dataclass
class Vector3:
    """A vector."""

    x: Float64 = 0.0
    y: Float64 = 0.0
    z: Float64 = 0.0


@_of("geometry_msgs")
@dataclass
class Point:
    """A place [m]."""

    x: Float64 = 0.0
    y: Float64 = 0.0
    z: Float64 = 0.0


@_of("geometry_msgs")
@dataclass
class Quaternion:
    """An attitude, scalar last."""

    x: Float64 = 0.0
    y: Float64 = 0.0
    z: Float64 = 0.0
    w: Float64 = 1.0


@_of("geometry_msgs")
@dataclass
class Pose:
    """Place and attitude."""

    position: Point = field(default_factory=Point)
    orientation: Quaternion = field(default_factory=Quaternion)


@_of("geometry_msgs")
@dataclass
class PoseWithCovariance:
    """Covariance of x, y, z and rotations about these axes, by rows."""

    pose: Pose = field(default_factory=Pose)
    covariance: Matrix6 = _zeros(36)


@_of("geometry_msgs")
@dataclass
class Twist:
    """Velocity [m/s] and angular velocity [rad/s]."""

    linear: Vector3 = field(default_factory=Vector3)
    angular: Vector3 = field(default_factory=Vector3)


@_of("geometry_msgs")
@dataclass
class TwistWithCovariance:
    """Covariance of the six, by rows."""

    twist: Twist = field(default_factory=Twist)
    covariance: Matrix6 = _zeros(36)


@_of("geometry_msgs")
@dataclass
class Wrench:
    """Force [N] and torque [N m]."""

    force: Vector3 = field(default_factory=Vector3)
    torque: Vector3 = field(default_factory=Vector3)


@_of("geometry_msgs")
@dataclass
class Transform:
    """From a child frame to its parent."""

    translation: Vector3 = field(default_factory=Vector3)
    rotation: Quaternion = field(default_factory=Quaternion)


@_of("geometry_msgs")
@dataclass
class PointStamped:
    """A place in a frame."""

    header: Header = field(default_factory=Header)
    point: Point = field(default_factory=Point)


@_of("geometry_msgs")
@dataclass
class PoseStamped:
    """A pose in a frame."""

    header: Header = field(default_factory=Header)
    pose: Pose = field(default_factory=Pose)


@_of("geometry_msgs")
@dataclass
class PoseWithCovarianceStamped:
    """A pose in a frame, and how well it is known."""

    header: Header = field(default_factory=Header)
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)


@_of("geometry_msgs")
@dataclass
class TwistWithCovarianceStamped:
    """A velocity in a frame, and how well it is known."""

    header: Header = field(default_factory=Header)
    twist: TwistWithCovariance = field(default_factory=TwistWithCovariance)


@_of("geometry_msgs")
@dataclass
class WrenchStamped:
    """A wrench in a frame."""

    header: Header = field(default_factory=Header)
    wrench: Wrench = field(default_factory=Wrench)


@_of("geometry_msgs")
@dataclass
class TransformStamped:
    """Where a child frame is in that of the header."""

    header: Header = field(default_factory=Header)
    child_frame_id: str = ""
    transform: Transform = field(default_factory=Transform)


@_of("tf2_msgs")
@dataclass
class TFMessage:
    """Some of the tree of frames."""

    transforms: Annotated[Sequence[TransformStamped], TransformStamped] = ()


@_of("rosgraph_msgs")
@dataclass
class Clock:
    """Simulated time."""

    clock: Time = field(default_factory=Time)


@_of("nav_msgs")
@dataclass
class Odometry:
    """Pose in the header's frame, twist in the child's."""

    header: Header = field(default_factory=Header)
    child_frame_id: str = ""
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)
    twist: TwistWithCovariance = field(default_factory=TwistWithCovariance)


@_of("sensor_msgs")
@dataclass
class Imu:
    """Attitude, angular velocity [rad/s] and specific force [m/s2]; -1 first in the covariance of what is absent."""

    header: Header = field(default_factory=Header)
    orientation: Quaternion = field(default_factory=Quaternion)
    orientation_covariance: Matrix3 = _zeros(9)
    angular_velocity: Vector3 = field(default_factory=Vector3)
    angular_velocity_covariance: Matrix3 = _zeros(9)
    linear_acceleration: Vector3 = field(default_factory=Vector3)
    linear_acceleration_covariance: Matrix3 = _zeros(9)


@_of("sensor_msgs")
@dataclass
class FluidPressure:
    """Absolute pressure [Pa]; a variance of 0 means unknown."""

    header: Header = field(default_factory=Header)
    fluid_pressure: Float64 = 0.0
    variance: Float64 = 0.0


@_of("sensor_msgs")
@dataclass
class BatteryState:
    """Volt, degrees Celsius, ampere (negative when discharging), ampere hours; NaN where unmeasured."""

    header: Header = field(default_factory=Header)
    voltage: Float32 = float("nan")
    temperature: Float32 = float("nan")
    current: Float32 = float("nan")
    charge: Float32 = float("nan")
    capacity: Float32 = float("nan")
    design_capacity: Float32 = float("nan")
    percentage: Float32 = float("nan")
    power_supply_status: UInt8 = 0
    power_supply_health: UInt8 = 0
    power_supply_technology: UInt8 = 0
    present: bool = False
    cell_voltage: Float32s = ()
    cell_temperature: Float32s = ()
    location: str = ""
    serial_number: str = ""
