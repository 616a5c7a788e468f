"""The BlueROV2 Heavy's twin over MAVLink: unmodified pymavlink arms it, flies it in every mode, and reads the truth."""

import time

import numpy as np
import pytest
from tests.links.twins import ServedTwin, free_port, twin_served

from rovtwin.links.mavlink.server import MavlinkServer

pytestmark = pytest.mark.system

mavutil = pytest.importorskip("pymavlink.mavutil")
mavlink = mavutil.mavlink
NEUTRAL = 500


class Pilot:
    """A ground station: heartbeats and sticks, and what the vehicle says."""

    def __init__(self, port: int):
        self.line = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=255)
        self.sticks = (0, 0, NEUTRAL, 0)
        self.sent = 0.0

    def turn(self) -> None:
        """What a ground station does ten times a second; in between, listen."""
        if time.monotonic() - self.sent > 0.1:
            self.sent = time.monotonic()
            self.line.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)
            self.line.mav.manual_control_send(1, *self.sticks, 0)
        while self.line.recv_msg() is not None:
            pass

    def command(self, number: int, *parameters: float) -> int:
        """The result of a command."""
        self.line.mav.command_long_send(1, 1, number, 0, *(*parameters, *[0.0] * 7)[:7])
        return self.line.recv_match(
            type="COMMAND_ACK", condition=f"COMMAND_ACK.command=={number}", blocking=True, timeout=5
        ).result

    def mode(self, number: int) -> None:
        assert self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, number) == mavlink.MAV_RESULT_ACCEPTED

    def newest(self, name: str):
        return self.line.messages[name]


@pytest.fixture(scope="module")
def twin():
    port = free_port()
    server = MavlinkServer(ground_station="", udp_port=port, tcp_port=None)
    with twin_served("bluerov2_heavy", [], more=[server], speed=2.0) as twin:
        twin.port = port
        yield twin


@pytest.fixture(scope="module")
def pilot(twin: ServedTwin):
    pilot = Pilot(twin.port)
    twin.until(lambda: (pilot.turn(), pilot.line.messages.get("ATTITUDE"))[1])
    assert pilot.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == mavlink.MAV_RESULT_ACCEPTED
    yield pilot
    pilot.line.close()


def flown(twin: ServedTwin, pilot: Pilot, sticks, true, seconds=15.0):
    pilot.sticks = sticks
    twin.until(lambda: (pilot.turn(), true())[1], seconds)
    pilot.sticks = (0, 0, NEUTRAL, 0)


def rested(twin: ServedTwin, pilot: Pilot, speed=0.02):
    """Until it has been at rest for a second of its time."""
    slow = lambda: len(twin.history) > 50 and all(np.linalg.norm(h[1]["nu"]) < speed for h in twin.history[-50:])  # noqa: E731
    flown(twin, pilot, (0, 0, NEUTRAL, 0), slow)


def test_depth_hold_dives_and_holds(twin, pilot):
    pilot.mode(2)
    flown(twin, pilot, (0, 0, 0, 0), lambda: twin.eta[2] > 1.5)  # the throttle stick all the way down
    rested(twin, pilot)
    held = twin.eta[2]
    ahead = twin.eta[0] + 1.0
    flown(twin, pilot, (600, 0, NEUTRAL, 0), lambda: twin.eta[0] > ahead)
    assert abs(twin.eta[2] - held) < 0.1


def test_telemetry_is_the_truth(twin, pilot):
    rested(twin, pilot)
    attitude, vfr = pilot.newest("ATTITUDE"), pilot.newest("VFR_HUD")
    np.testing.assert_allclose([attitude.roll, attitude.pitch, attitude.yaw], twin.eta[3:], atol=0.02)
    assert abs(-vfr.alt - twin.eta[2]) < 0.05
    estimated = pilot.newest("LOCAL_POSITION_NED")
    # Its own filter, on one fix a second of 0.5 m, with a DVL between them.
    assert np.hypot(estimated.x - twin.eta[0], estimated.y - twin.eta[1]) < 1.0


def test_heading_hold_and_turn(twin, pilot):
    began = twin.eta[5]
    flown(twin, pilot, (0, 0, NEUTRAL, 500), lambda: twin.eta[5] > began + 1.0)
    rested(twin, pilot)
    assert twin.eta[5] > began + 0.9


def test_manual_is_open_loop(twin, pilot):
    """In MANUAL a stick is force: to the right is to the right, whatever the vehicle then does."""
    pilot.mode(19)
    flown(twin, pilot, (0, 800, NEUTRAL, 0), lambda: twin.history[-1][1]["nu"][1] > 0.3)


def test_guided_goes_to_a_place(twin, pilot):
    pilot.mode(4)
    goal = np.array([twin.eta[0] + 1.0, twin.eta[1] - 1.0, 2.5])
    mask = 0b0000110111111000  # only the position counts
    sent = [0.0]

    def there():
        if time.monotonic() - sent[0] > 0.2:
            sent[0] = time.monotonic()
            pilot.line.mav.set_position_target_local_ned_send(
                0, 1, 1, mavlink.MAV_FRAME_LOCAL_NED, mask, *goal, 0, 0, 0, 0, 0, 0, 0, 0
            )
        return np.linalg.norm(twin.eta[:3] - goal) < 0.6 and abs(twin.eta[2] - 2.5) < 0.1

    flown(twin, pilot, (0, 0, NEUTRAL, 0), there, 40.0)


def test_a_ground_station_that_is_gone_leaves_no_thrust(twin, pilot):
    pilot.mode(19)
    flown(twin, pilot, (500, 0, NEUTRAL, 0), lambda: twin.history[-1][1]["nu"][0] > 0.2)
    gone = time.monotonic()  # from now on the pilot says nothing
    twin.until(lambda: not twin.command.any(), 10.0)
    assert time.monotonic() - gone < 3.5  # FS_PILOT_TIMEOUT is 3 s


def test_disarmed_it_does_not_move(twin, pilot):
    twin.until(lambda: (pilot.turn(), pilot.line.messages["HEARTBEAT"])[1])
    assert not twin.command.any()
    pilot.sticks = (800, 0, NEUTRAL, 0)
    end = time.monotonic() + 1.0
    while time.monotonic() < end:
        pilot.turn()
    assert not twin.command.any()


def test_surface_comes_up_and_holds_there(twin, pilot):
    """ArduSub's SURFACE: up by itself, then ALT_HOLD at the surface."""
    assert pilot.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == mavlink.MAV_RESULT_ACCEPTED
    pilot.mode(2)
    flown(twin, pilot, (0, 0, 0, 0), lambda: twin.eta[2] > 1.0)
    pilot.mode(9)
    flown(twin, pilot, (0, 0, NEUTRAL, 0), lambda: pilot.newest("HEARTBEAT").custom_mode == 9, 5.0)
    flown(twin, pilot, (0, 0, NEUTRAL, 0), lambda: pilot.newest("HEARTBEAT").custom_mode == 2, 30.0)
    assert twin.eta[2] < 0.25
