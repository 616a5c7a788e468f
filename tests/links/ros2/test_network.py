"""Over the network (loopback): the server and a real rclpy node, the server and our link, what is refused."""

import importlib.util
import json
import math
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from tests.links.serving import serving

from rovtwin.core.errors import LinkError
from rovtwin.core.flow import Command, Measurement
from rovtwin.links.ros2 import convert
from rovtwin.links.ros2 import messages as msg
from rovtwin.links.ros2.confine import confined
from rovtwin.links.ros2.link import Ros2Link
from rovtwin.links.ros2.middleware import open_transport
from rovtwin.links.ros2.server import Ros2Server
from rovtwin.links.servers.server import require_loopback

pytest.importorskip("cyclonedds")
DOMAIN = 40 + os.getpid() % 40  # two test runs on one machine must not hear each other
PATIENCE = 30.0
no_rclpy = importlib.util.find_spec("rclpy") is None
with_rclpy = pytest.mark.skipif(no_rclpy, reason="no rclpy: see the extra 'test' in pyproject.toml")
ETA, NU = np.array([3.0, -2.0, 4.0, 0.0, 0.0, math.radians(30)]), np.array([0.5, 0.1, 0.2, 0.0, 0.0, 0.3])
FORCES = (100.0, 100.0, 100.0, 10.0, 10.0, 10.0)


def until(condition, step=lambda: None) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        step()
        time.sleep(0.02)


def readings(t: float) -> list[Measurement]:
    return [
        Measurement("estimate", np.concatenate([ETA, NU]), t),
        Measurement("gyro", NU[3:], t),
        Measurement("accelerometer", np.array([0.0, 0.0, -9.81]), t),
        Measurement("pressure", ETA[2:3], t),
        Measurement("battery", np.array([0.75, 40.0]), t),
    ]


class Feeding:
    """Feeds a served station, 50 times a second of real time."""

    def __init__(self, served, t: float = 1000.0):
        self.served, self.t = served, t

    def __call__(self) -> None:
        self.t += 0.02
        self.served.feed(self.t, readings(self.t))


@pytest.mark.system
@pytest.mark.skipif(
    importlib.util.find_spec("rclpy") is None, reason="no rclpy: see the extra 'test' in pyproject.toml"
)
def test_a_real_rclpy_node_hears_odometry_and_steers():
    environment = {
        **{k: v for k, v in os.environ.items() if k not in ("ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS")},
        **{"ROS_DOMAIN_ID": str(DOMAIN), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
    }
    received: dict[str, dict] = {}
    server = Ros2Server(largest=FORCES, domain=DOMAIN, middleware="cyclonedds", std={"estimate": (0.1,) * 12})
    with serving(server) as served:
        command = [sys.executable, str(Path(__file__).with_name("node.py"))]
        node = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)

        def listen() -> None:
            for line in node.stdout:
                if line.startswith("{"):
                    found = json.loads(line)
                    received[found["topic"]] = found

        thread = threading.Thread(target=listen, daemon=True)
        thread.start()
        try:
            feed = Feeding(served)
            topics = {"odometry", "imu", "pressure", "battery", "clock"}
            until(lambda: received.keys() >= topics and any(any(w.motion) for w in served.commands), feed)
            odometry = received["odometry"]
            assert odometry["frames"] == ["odom", "base_link"] and 1000 < odometry["stamp"] <= feed.t + 1e-6
            # North-east-down to east-north-up: a depth is a negative z; heading 30 deg is a yaw of 60.
            assert odometry["place"] == pytest.approx([-2.0, 3.0, -4.0])
            yaw = math.radians(60)
            assert odometry["q"] == pytest.approx([0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)], abs=1e-12)
            assert odometry["linear"] == pytest.approx([0.5, -0.1, -0.2])
            assert odometry["angular"] == pytest.approx([0.0, 0.0, -0.3])
            assert odometry["covariance"] == pytest.approx([0.01, 0, 0, 0, 0, 0, 0, 0.01])
            assert received["imu"]["gyro"] == pytest.approx([0.0, 0.0, -0.3])
            assert received["imu"]["force"] == pytest.approx([0.0, 0.0, 9.81]) and received["imu"]["absent"] == -1
            assert received["pressure"]["p"] == pytest.approx(101_325 + 4.0 * 1000 * 9.80665)
            assert received["battery"]["share"] == pytest.approx(0.75)
            assert received["clock"]["sec"] >= 1000
            pilot_command = next(w for w in served.commands if any(w.motion))
            # Up 20 N is a heave of -0.2, a torque to starboard a positive yaw.
            assert pilot_command.armed and pilot_command.motion == pytest.approx((0.5, 0.0, 0.2, 0.0, 0.0, 0.5))
            node.kill()
            until(lambda: not served.commands[-1].armed)
            count = len(served.commands)
            time.sleep(0.3)
            assert len(served.commands) == count, "a client that is gone wishes nothing"
        finally:
            node.kill()
            node.wait()
            thread.join(5)


def test_our_link_flies_our_server_and_readings_come_back_as_they_were():
    now = time.monotonic()

    def wrench(u):
        return np.array([50.0 * u[0], 0.0, 50.0 * u[1], 0.0, 0.0, 5.0 * u[2]])

    server = Ros2Server("fleet/rov_1", FORCES, DOMAIN, sim_time=False, middleware="cyclonedds")
    with serving(server) as served:
        feed = Feeding(served)
        link = Ros2Link("fleet/rov_1", 3, wrench=wrench, domain=DOMAIN, middleware="cyclonedds")
        with link:
            link.arm()
            found: dict[str, Measurement] = {}
            expected = {"position", "dvl", "gyro", "accelerometer", "pressure", "battery"}

            def step() -> None:
                feed()
                found.update((r.sensor, r) for r in link.read())
                link.send(Command(np.array([1.0, -0.5, 0.2])))

            until(lambda: found.keys() >= expected and served.commands and any(served.commands[-1].motion), step)
            np.testing.assert_allclose(found["position"].value, ETA[:2])
            np.testing.assert_allclose(found["dvl"].value, NU[:3])
            np.testing.assert_allclose(found["gyro"].value, NU[3:])
            np.testing.assert_allclose(found["accelerometer"].value, [0.0, 0.0, -9.81])
            np.testing.assert_allclose(found["pressure"].value, ETA[2:3])
            assert all(now < r.t_valid <= time.monotonic() for r in found.values())
            assert served.commands[-1].motion == pytest.approx((0.5, 0.0, -0.25, 0.0, 0.0, 0.1))
            link.stop()
            until(lambda: not served.commands[-1].armed)
            until(lambda: [x for x in served.messages if x.endswith("armed")] == ["ROS 2: armed", "ROS 2: disarmed"])
            assert not link.problems, link.problems


class Watch:
    """Our clock: begins at 700, `speed` times as fast as the real one."""

    def __init__(self, speed: float):
        self.speed, self.began = speed, time.monotonic()

    def __call__(self) -> float:
        return 700.0 + (time.monotonic() - self.began) * self.speed


@pytest.mark.system
@pytest.mark.parametrize("speed", [1.0, 4.0])
def test_our_link_finds_out_that_our_server_stamps_in_simulated_time(speed):
    clock = Watch(speed)
    server = Ros2Server("sim", FORCES, DOMAIN, middleware="cyclonedds")
    with (
        serving(server, speed=speed) as served,
        Ros2Link("sim", 3, clock, domain=DOMAIN, middleware="cyclonedds") as link,
    ):
        began, late = clock(), []

        def feed() -> None:
            t = clock() - began
            served.feed(t, [Measurement("gyro", np.array([t, 0.0, 0.0]), t)])
            # The reading itself says when it was measured.
            late.extend(r.t_valid - (began + r.value[0]) for r in link.read())

        until(lambda: len(late) > 80, feed)
        assert np.abs(late[-30:]).max() < 0.1
        assert link.age < 1.0


@pytest.mark.system
def test_garbage_moves_nothing_and_the_server_goes_on():
    server = Ros2Server("rov", FORCES, DOMAIN, middleware="cyclonedds")
    nan, good = msg.WrenchStamped(wrench=msg.Wrench(msg.Vector3(math.nan))), msg.WrenchStamped()
    good.wrench.force.x = 10.0
    late = msg.WrenchStamped(msg.Header(msg.Time(5, 0)), msg.Wrench(msg.Vector3(90.0)))
    elsewhere = msg.WrenchStamped(msg.Header(frame_id="map"), msg.Wrench(msg.Vector3(90.0)))
    with serving(server) as served, open_transport("client", DOMAIN, middleware="cyclonedds") as client:
        feed = Feeding(served)

        def send(*messages):
            feed()
            client.publish("/rov/arm", msg.Bool(True))
            for message in messages:
                client.publish("/rov/cmd_wrench", message)

        for bad, expected_text in ((nan, "finite"), (late, "stamp"), (elsewhere, "frame_id")):
            served.messages.clear()
            if expected_text == "finite":
                until(lambda: any("finite" in line for line in served.messages), lambda: send(nan))
            else:
                # It says so once for all that is refused on a topic: here it is enough that nothing moves.
                for _ in range(10):
                    send(bad)
                    time.sleep(0.02)
        assert not any(any(w.motion) for w in served.commands)
        until(lambda: any(w.motion[0] == pytest.approx(0.1) for w in served.commands), lambda: send(good))
        way = convert.pose(feed.t, [1.0, 2.0, 3.0], [0.0, 0.0, 0.5])
        until(lambda: not served.commands[-1].armed)
        until(lambda: served.messages[-1] == "ROS 2: its client is silent: disarmed")

        def go():
            feed()
            client.publish("/rov/arm", msg.Bool(True))
            way.header.stamp = convert.stamp(feed.t)
            client.publish("/rov/cmd_pose", way)

        until(lambda: served.commands[-1].target is not None, go)
        assert served.commands[-1].target == pytest.approx((1.0, 2.0, 3.0, 0.5))
    assert not served.commands[-1].armed, "the server ended with the vehicle armed"


@pytest.mark.system
@pytest.mark.skipif(
    importlib.util.find_spec("rclpy") is None, reason="no rclpy: see the extra 'test' in pyproject.toml"
)
def test_our_rclpy_transport_and_our_cyclone_transport_hear_each_other():
    """The rclpy end in a process of its own, and simulated time through /clock."""
    code = f"""
import time, numpy as np
from rovtwin.core.flow import Command
from rovtwin.links.ros2.link import Ros2Link
link = Ros2Link("rov", 1, None, use_sim_time=True, wrench=lambda u: np.array([100.0, 0, 0, 0, 0, 0]) * u,
                domain={DOMAIN}, middleware="rclpy")
link.arm()
end = time.monotonic() + {PATIENCE}
while time.monotonic() < end:
    link.send(Command(np.array([0.25])))
    for r in link.read():
        if r.sensor == "position":
            print("READ", *r.value, r.t_valid, flush=True)
    time.sleep(0.02)
"""
    server = Ros2Server("rov", FORCES, DOMAIN, middleware="cyclonedds")
    with serving(server) as served:
        node = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
        lines: list[str] = []
        threading.Thread(target=lambda: lines.extend(iter(node.stdout.readline, "")), daemon=True).start()
        try:
            feed = Feeding(served)
            until(lambda: any("READ" in line for line in lines) and any(w.motion[0] for w in served.commands), feed)
            words = next(line for line in lines if "READ" in line).split()
            assert [float(x) for x in words[1:3]] == ETA[:2].tolist()
            assert 1000 < float(words[3]) <= feed.t + 1e-6, "simulated time"
            assert next(w for w in served.commands if w.motion[0]).motion[0] == pytest.approx(0.25)
        finally:
            node.kill()
            node.wait()


# ------------------------------------------------------------------------------------------------ who may reach it


def test_only_this_machine_unless_exposed():
    assert require_loopback([Ros2Server()], exposed=False) == []
    assert require_loopback([Ros2Server(expose=True)], exposed=True) == ["0.0.0.0"]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Linux only")
def test_confined_sockets_hear_the_loopback_device_only(monkeypatch):
    """Another device is stood in for by a filter for a device that does not exist."""
    import socket

    def is_received(device: int | None) -> bool:
        if device is not None:
            monkeypatch.setattr(socket, "if_nametoindex", lambda name: device)
        with confined(True):
            ear = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            ear.bind(("0.0.0.0", 0))
        with ear, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mouth:
            ear.settimeout(1.0 if device is None else 0.1)
            mouth.sendto(b"x", ("127.0.0.1", ear.getsockname()[1]))
            try:
                return ear.recv(10) == b"x"
            except TimeoutError:
                return False

    assert is_received(None)
    assert not is_received(4321)


@pytest.mark.parametrize("domain", ["250", "-1", "seven"])
def test_a_domain_that_is_none(domain, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    with pytest.raises(LinkError, match="ROS_DOMAIN_ID"):
        open_transport("n")


@pytest.mark.parametrize("namespace", ["", "a b", "/9", "a//b", "ä"])
def test_a_namespace_that_is_none(namespace):
    with pytest.raises(LinkError, match="namespace"):
        Ros2Server(namespace)


def test_without_a_middleware_the_message_says_what_to_install(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(LinkError, match=r"pip install 'rovtwin\[ros2\]'"):
        open_transport("n", 40)
