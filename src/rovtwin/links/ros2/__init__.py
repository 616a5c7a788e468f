"""ROS 2: the twin as a ROS 2 vehicle (`server`), a ROS 2 vehicle behind a Link (`link`), runs as bags (`bag`).

ROS speaks ENU and FLU (REP 103), the rest of the project NED and FRD: `convert` is where one becomes the other.
`transport` talks to the network through `rclpy` where a ROS 2 is sourced, else through `cyclonedds`
(`pip install 'rovtwin[ros2]'`), which needs no ROS at all.
"""
