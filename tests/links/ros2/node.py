"""A real rclpy node in a process of its own: tells on stdout what it hears, steers, and is killed by the test.

It knows nothing of rovtwin: what it says is what any user's node would see.
"""

import json
import time

import rclpy
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.qos import qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, FluidPressure, Imu
from std_msgs.msg import Bool


def tell(what: str, **values) -> None:
    print(json.dumps({"topic": what, **values}), flush=True)


def xyz(v) -> list[float]:
    return [v.x, v.y, v.z]


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("user")

    def odometry(m: Odometry) -> None:
        q, pose, twist = m.pose.pose.orientation, m.pose, m.twist
        tell(
            "odometry",
            frames=[m.header.frame_id, m.child_frame_id],
            stamp=m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec,
            place=xyz(pose.pose.position),
            q=[*xyz(q), q.w],
            linear=xyz(twist.twist.linear),
            angular=xyz(twist.twist.angular),
            covariance=pose.covariance.tolist()[:8],
        )

    def imu(m: Imu) -> None:
        tell("imu", gyro=xyz(m.angular_velocity), force=xyz(m.linear_acceleration), absent=m.orientation_covariance[0])

    # With ROS's default profile and with that of sensors: both must be served.
    node.create_subscription(Odometry, "/rov/odometry", odometry, 10)
    node.create_subscription(Imu, "/rov/imu", imu, qos_profile_sensor_data)
    node.create_subscription(FluidPressure, "/rov/pressure", lambda m: tell("pressure", p=m.fluid_pressure), 10)
    node.create_subscription(BatteryState, "/rov/battery", lambda m: tell("battery", share=m.percentage), 10)
    node.create_subscription(Clock, "/clock", lambda m: tell("clock", sec=m.clock.sec), 10)
    arm, steer = (
        node.create_publisher(Bool, "/rov/arm", 10),
        node.create_publisher(WrenchStamped, "/rov/cmd_wrench", 10),
    )
    wrench = WrenchStamped()
    wrench.header.frame_id = "base_link"
    wrench.wrench.force.x, wrench.wrench.force.z, wrench.wrench.torque.z = 50.0, -20.0, -5.0
    armed, began = 0, time.monotonic()
    while time.monotonic() - began < 60:
        rclpy.spin_once(node, timeout_sec=0.05)
        if steer.get_subscription_count() and arm.get_subscription_count():
            # Arms a few times: the first may come before the server's reader is matched at both ends.
            if armed < 10:
                arm.publish(Bool(data=True))
                armed += 1
            steer.publish(wrench)


main()
