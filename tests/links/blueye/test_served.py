"""The Double Blueye's twin over its protocols: the vendors' unmodified clients arm, dive, turn and measure it.

All ports of a drone are fixed, so every test that binds these addresses is in this module.
"""

import asyncio
import json
import socket
import time
import urllib.request

import blueye.protocol as bp
import numpy as np
import pytest
import qtm_rt
from blueye.sdk import Drone
from tests.links.twins import ServedTwin, free_port, twin_served

pytestmark = pytest.mark.system

PORT, STARBOARD, HTTP = "127.0.0.20", "127.0.0.21", 8790


@pytest.fixture(scope="module")
def ports() -> dict[str, int]:
    return {name: free_port() for name in ("ugps", "dvl", "qtm")}


@pytest.fixture(scope="module")
def twin(ports):
    addresses = [f"blueye={PORT}:{HTTP}", f"blueye={STARBOARD}:{HTTP}"]
    addresses += [f"{name}=127.0.0.1:{port}" for name, port in ports.items()]
    with twin_served("double_blueye", ["blueye", *ports], addresses, speed=2.0) as twin:
        yield twin


@pytest.fixture(scope="module", autouse=True)
def began(twin) -> tuple[float, float]:
    """Real time and the vehicle's at the beginning of this module [s]."""
    twin.until(lambda: twin.history, 60.0)
    return time.monotonic(), twin.history[-1][0]


@pytest.fixture(scope="module")
def drones(twin):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("http_proxy", f"http://{PORT}:{HTTP}")  # as a user without root tells the SDK where port 80 is
        patch.delenv("no_proxy", raising=False)
        patch.delenv("NO_PROXY", raising=False)
        drones = [Drone(ip) for ip in (PORT, STARBOARD)]
        yield drones
        for drone in drones:
            drone.disconnect()


def newest(drone: Drone, kind) -> object:
    return drone.telemetry.get(kind)


def surge(drones: list[Drone], share: float) -> None:
    for drone in drones:
        drone.motion.set_surge(share)


def test_both_drones_connect_and_are_in_control(drones):
    assert all(drone.connected and drone.in_control for drone in drones)
    assert len({drone.serial_number for drone in drones}) == 2


def test_they_dive_and_telemetry_is_the_truth(twin: ServedTwin, drones):
    began = twin.eta[2]
    for drone in drones:
        drone.motion.set_heave(0.5)
    twin.until(lambda: twin.eta[2] > began + 0.4)
    for drone in drones:
        drone.motion.set_heave(0.0)
        drone.motion.enable_auto_depth(True)
    twin.until(
        lambda: (
            np.abs(twin.history[-1][1]["nu"][2]) < 0.005
            and np.ptp([h[1]["eta"][2] for h in twin.history[-100:]]) < 0.01
        )
    )
    for drone in drones:
        assert abs(newest(drone, bp.DepthTel).depth.value - twin.eta[2]) < 0.02
        attitude = newest(drone, bp.AttitudeTel).attitude
        np.testing.assert_allclose([attitude.roll, attitude.pitch], np.degrees(twin.eta[3:5]), atol=0.5)
        assert newest(drone, bp.ControlModeTel).state.auto_depth


def test_auto_depth_holds_under_a_turn_of_the_pair(twin: ServedTwin, drones):
    """Ahead with one and astern with the other turns the pair; each drone keeps its depth by itself."""
    depth, heading = twin.eta[2], twin.eta[5]
    drones[0].motion.set_surge(0.4)
    drones[1].motion.set_surge(-0.4)
    twin.until(lambda: np.abs((twin.eta[5] - heading + np.pi) % (2 * np.pi) - np.pi) > 1.0)
    surge(drones, 0.0)
    assert abs(twin.eta[2] - depth) < 0.05
    reported = np.radians([newest(drone, bp.AttitudeTel).attitude.yaw for drone in drones])
    # The newest message is up to a twentieth of a second old, at well below 1 rad/s.
    np.testing.assert_allclose((reported - twin.eta[5] + np.pi) % (2 * np.pi) - np.pi, 0.0, atol=0.15)


def test_yaw_of_the_drones_own_turns_them_too(twin: ServedTwin, drones):
    """A Pioneer turns by its two stern thrusters, whatever it is bolted to; clockwise seen from above is positive."""
    for drone in drones:
        drone.motion.set_yaw(0.6)
    twin.until(lambda: twin.history[-1][1]["nu"][5] > 0.1)
    for drone in drones:
        drone.motion.set_yaw(0.0)


def test_one_drone_disconnected_has_its_thrusters_off(twin: ServedTwin, drones):
    for drone in drones:
        drone.motion.enable_auto_depth(False)
        drone.motion.set_heave(0.3)
    twin.until(lambda: (np.abs(twin.command[[3, 7]]) > 0.1).all())
    drones[1].disconnect()
    twin.until(lambda: not twin.command[4:].any())
    assert twin.command[3] != 0.0
    drones[1].connect()
    drones[0].motion.set_heave(0.0)


def test_dvl_and_positions_and_motion_capture_are_the_truth(twin: ServedTwin, drones, ports):
    surge(drones, 0.5)
    twin.until(lambda: twin.history[-1][1]["nu"][0] > 0.15)
    velocity = dvl_report(ports["dvl"])
    assert velocity["velocity_valid"] is True
    speeds = np.array([truth["nu"][:3] for _, truth in twin.history[-25:]])
    reported = np.array([velocity["vx"], velocity["vy"], velocity["vz"]])
    assert ((reported > speeds.min(axis=0) - 0.03) & (reported < speeds.max(axis=0) + 0.03)).all()
    surge(drones, 0.0)

    position = get(f"http://127.0.0.1:{ports['ugps']}/api/v1/position/acoustic/filtered")
    assert position["position_valid"] is True
    # One fix a second with a standard deviation of 0.5 m, and up to a second of way at 0.3 m/s.
    assert np.hypot(position["x"] - twin.eta[0], position["y"] - twin.eta[1]) < 5 * 0.5 + 0.3

    pose = asyncio.run(motion_capture(ports["qtm"]))
    north, east, down = pose[0] / 1000, -pose[1] / 1000, -pose[2] / 1000
    np.testing.assert_allclose([north, east, down], twin.eta[:3], atol=0.15)


def dvl_report(port: int) -> dict:
    with socket.create_connection(("127.0.0.1", port), timeout=5) as line, line.makefile() as stream:
        for text in stream:
            report = json.loads(text)
            if report["type"] == "velocity":
                return report
    raise AssertionError("no velocity came")


def get(url: str) -> dict:
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    with opener.open(url, timeout=5) as answer:
        return json.load(answer)


async def motion_capture(port: int) -> np.ndarray:
    """A pose by the vendor's client: place [mm] in QTM's frame."""
    connection = await qtm_rt.connect("127.0.0.1", port=port, version="1.25")
    assert connection is not None
    frames: asyncio.Queue = asyncio.Queue()
    await connection.stream_frames(components=["6deuler"], on_packet=frames.put_nowait)
    packet = await asyncio.wait_for(frames.get(), 5)
    _, bodies = packet.get_6d_euler()
    connection.disconnect()
    return np.array(bodies[0][0])


def test_the_vehicles_clock_kept_pace(twin: ServedTwin, began):
    """Twice real time from this module's first period to its last, however busy the clients were.

    The machine is shared: time that the vehicle could not catch up with is a fifth at most.
    """
    real, simulated = began
    time.sleep(max(0.0, real + 2.0 - time.monotonic()))  # for when this test runs alone
    rate = (twin.history[-1][0] - simulated) / (time.monotonic() - real)
    assert rate == pytest.approx(2.0, rel=0.2)
