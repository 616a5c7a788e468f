"""What the endpoint decides, without sockets: sticks, channels, modes, set-points and fail-safes."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from tests.conftest import shared_folder

from rovtwin.core.datum import Datum
from rovtwin.links.mavlink.firmware.autopilot import Autopilot
from rovtwin.links.mavlink.firmware.guided import Order, order_of_attitude, order_of_global, order_of_local
from rovtwin.links.mavlink.firmware.parameters import Parameters
from rovtwin.links.mavlink.firmware.pilot import (
    Sticks,
    axes_of_channels,
    axes_of_sticks,
    pulses_of_sticks,
    sticks_of_axes,
)
from rovtwin.links.mavlink.modes import MODES

HERE = (10.0, 20.0, 5.0, math.pi / 2)  # heading east
PLACE_ONLY = 0b110111111000  # position wanted; velocity, acceleration, yaw and its rate ignored
VELOCITY_ONLY = 0b010111000111  # velocity and yaw rate wanted


@pytest.fixture
def messages():
    return []


@pytest.fixture
def pilot(messages):
    return Autopilot(Parameters(1, 1.0, 1025.0), lambda severity, text: messages.append(text))


def armed(pilot, mode=19, now=0.0):
    assert pilot.set_mode(mode) and pilot.arm(255, now, "")
    return pilot


@pytest.mark.parametrize(
    ("sticks", "axis", "value"),
    [
        (Sticks(x=1000), 0, 1.0),
        (Sticks(y=-500), 1, -0.5),
        (Sticks(z=1000), 2, -1.0),  # up
        (Sticks(z=0), 2, 1.0),
        (Sticks(t=100, enabled_extensions=2), 3, 0.25),
        (Sticks(s=-400, enabled_extensions=1), 4, -1.0),
        (Sticks(s=900), 4, 1.0),  # a channel has no more; the bits are not looked at
        (Sticks(r=250), 5, 0.25),
    ],
)
def test_sticks(sticks, axis, value):
    expected = np.zeros(6)
    expected[axis] = value
    np.testing.assert_allclose(axes_of_sticks(sticks, 1.0), expected)


@pytest.mark.parametrize(
    ("sticks", "channel", "pulse"),
    [
        (Sticks(x=400), 5, 1580),
        (Sticks(s=100), 1, 1600),
        (Sticks(t=-100), 2, 1400),
        (Sticks(z=1000), 3, 1700),
        (Sticks(y=-26), 6, 1494),
    ],
)
def test_the_gain_of_a_pilot_is_not_that_of_s_and_t(sticks, channel, pulse):
    """At ArduSub's own gain, in microseconds."""
    expected = np.full(6, 1500.0)
    expected[channel - 1] = pulse
    np.testing.assert_array_equal(pulses_of_sticks(sticks, 0.5), expected)
    before = pulses_of_sticks(sticks, 0.5, extended=False)
    np.testing.assert_array_equal(before, np.full(6, 1500.0) if channel < 3 else expected, "ArduSub before 4.5")


@pytest.mark.parametrize("throttle", [1.0, 3.0])
def test_sticks_that_are_let_go_push_nothing_at_any_gain(throttle):
    """A gain comes as a number of single precision; the base of the throttle is a whole number."""
    for gain in np.arange(10, 101, dtype=np.float32) / np.float32(100.0):
        pulses = pulses_of_sticks(Sticks(), float(gain), throttle)
        scale = np.float32(0.8 * float(gain) * throttle)  # as joystick.cpp has it
        expected = int(np.float32(500) * scale + np.float32(int(np.float32(1500) - np.float32(500) * scale)))
        assert pulses[2] == expected and list(np.delete(pulses, 2)) == [1500.0] * 5
    assert pulses_of_sticks(Sticks(), float(np.float32(0.3)))[2] == 1500.0


def test_throttle_has_a_gain_of_its_own():
    assert pulses_of_sticks(Sticks(z=750), 0.5, throttle=1.5)[2] == 1650.0
    axes = np.array([0.0, 0.0, 0.6, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(axes_of_sticks(sticks_of_axes(axes, 0.5, 1.5), 0.5, 1.5), axes, atol=1 / 399)


def test_channels_are_those_of_a_real_vehicle():
    """Telemetry of a BlueROV2 with ArduSub 4.1 at sea: sticks of its ground station, channels of its autopilot."""
    pytest.importorskip("pymavlink", reason="pymavlink is not installed: pip install 'rovtwin[mavlink]'")
    from pymavlink import mavutil

    path = shared_folder("data", "ardusub_real") / "small.tlog"
    log = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    kinds = ["MANUAL_CONTROL", "NAMED_VALUE_FLOAT", "RC_CHANNELS"]
    held, gain, compared = [], None, 0
    while (message := log.recv_match(type=kinds)) is not None:
        if message.get_type() == "MANUAL_CONTROL":
            held = [*held[-1:], Sticks(message.x, message.y, message.z, message.r, message.s, message.t)]
        elif message.get_type() == "NAMED_VALUE_FLOAT":
            gain = message.value if message.name == "PilotGain" else gain
        elif gain is not None and len(held) == 2 and held[0] == held[1]:
            channels = [getattr(message, f"chan{i}_raw") for i in range(1, 7)]
            np.testing.assert_array_equal(channels, pulses_of_sticks(held[1], gain, extended=False))
            compared += 1
    assert gain == 0.5 and compared > 50


@pytest.mark.parametrize("bad", [Sticks(x=1001), Sticks(z=-1), Sticks(z=1001), Sticks(r=-32768)])
def test_sticks_out_of_range_are_none(bad):
    assert axes_of_sticks(bad, 1.0) is None


def test_absent_stick_is_let_go():
    sticks = Sticks(x=0x7FFF, y=0x7FFF, z=0x7FFF, r=100, s=0x7FFF, t=0x7FFF)
    np.testing.assert_allclose(axes_of_sticks(sticks, 1.0), [0, 0, 0, 0, 0, 0.1])


def test_gain_is_undone():
    axes = np.array([0.2, -0.1, 0.3, 0.05, -0.25, 0.4])
    np.testing.assert_allclose(axes_of_sticks(sticks_of_axes(axes, 0.5), 0.5), axes, atol=1 / 399)
    most = [0.5, 0.5, 0.5, 1.0, 1.0, 0.5]  # roll and pitch have no gain
    np.testing.assert_allclose(axes_of_sticks(sticks_of_axes(np.ones(6), 0.5), 0.5), most, atol=1 / 399)


def test_channels():
    """ArduSub's order: pitch, roll, throttle (up), yaw, forward, lateral."""
    axes = axes_of_channels([1540, 1580, 1900, 1100, 1700, 1300], np.zeros(6))
    np.testing.assert_allclose(axes, [0.5, -0.5, -1.0, 0.2, 0.1, -1.0])


def test_channels_left_and_given_back():
    before = np.full(6, 0.5)
    np.testing.assert_allclose(axes_of_channels([65535, 65535, 0, 65535, 0, 1500], before), [0, 0, 0, 0.5, 0.5, 0.5])
    assert axes_of_channels([900, *[65535] * 5], before) is None


def test_modes_are_holds(pilot):
    holds = {
        number: (w.hold_level, w.hold_heading, w.hold_depth, w.hold_position)
        for number in MODES
        for w in [armed(pilot, number).command(0.0)]
    }
    off, on = (False,) * 4, (True,) * 4
    assert holds == {
        **{19: off, 1: off, 16: on, 4: on},
        **{0: (True, True, False, False), 2: (True, True, True, False), 9: (True, True, True, False)},
    }


@pytest.mark.parametrize("number", [3, 7, 20, 21, 99, 2**32 - 1])
def test_modes_that_are_refused_say_why(pilot, messages, number):
    assert not pilot.set_mode(number)
    assert pilot.mode.number == 19 and messages and len(messages[0]) > 20


def test_surface_comes_up_and_holds_the_depth_there(pilot):
    """As the firmware does: it asks for up by itself, and at 0.1 m changes to ALT_HOLD."""
    armed(pilot, 9)
    pilot.steer(255, np.array([0.2, 0.0, 0.5, 0.0, 0.0, 0.0]), 0.0)
    assert pilot.command(0.0).motion[2] == -1.0
    pilot.arrive(0.11)
    assert pilot.mode.number == 9
    pilot.arrive(0.1)
    assert pilot.mode.number == 2 and pilot.command(0.0).motion[2] == 0.0


def test_surface_ends_without_a_depth(pilot, messages):
    """It would push up for ever."""
    armed(pilot, 9)
    pilot.lose_depth()
    assert pilot.mode.number == 19 and not any(pilot.command(0.0).motion) and messages[-1].startswith("Depth lost")
    pilot.lose_depth()
    assert messages[-2:] != [messages[-1]] * 2, "said once"


@pytest.mark.parametrize("number", [4, 9, 16])
def test_modes_that_hold_a_place_need_one(pilot, messages, number):
    pilot.knows_place = lambda: False
    assert not pilot.set_mode(number) and messages[-1].endswith("requires position")


def test_arming_without_attitude(pilot, messages):
    assert not pilot.arm(255, 0.0, "no attitude yet")
    assert not pilot.command(0.0).armed and messages == ["Arm: no attitude yet"]


def test_only_my_ground_station_steers(pilot):
    armed(pilot)
    assert not pilot.steer(245, np.ones(6), 0.0)
    assert not any(pilot.command(0.0).motion)
    pilot.parameters.set("SYSID_MYGCS", 245)
    assert pilot.steer(245, np.ones(6), 0.0) and pilot.command(0.0).motion == (1.0,) * 6


def test_lost_pilot_disarms_after_3_s(pilot, messages):
    armed(pilot)
    pilot.steer(255, np.full(6, 0.5), 1.0)
    for now in (2.0, 3.9):
        pilot.heartbeat(255, now)
        pilot.check(now)
        assert pilot.command(now).motion[0] == 0.5
    pilot.heartbeat(255, 4.1)
    pilot.check(4.1)
    assert not pilot.armed and "Lost manual control" in messages
    assert not any(pilot.command(4.1).motion)


def test_lost_pilot_can_be_neutral_instead(pilot, messages):
    assert pilot.parameters.set("FS_PILOT_INPUT", 1)
    armed(pilot)
    pilot.steer(255, np.full(6, 0.5), 0.0)
    for now in (3.5, 4.5):
        pilot.heartbeat(255, now)
        pilot.check(now)
    assert pilot.armed and not any(pilot.command(4.5).motion) and messages.count("Lost manual control") == 1


def test_lost_ground_station_disarms_after_2_5_s(pilot):
    """As long as ArduSub 4.5 waits: 2.6 s to the text, measured."""
    armed(pilot, 4)
    pilot.obey(255, Order(target=HERE), 1.0)
    pilot.check(3.4)
    assert pilot.command(3.4).target == HERE
    pilot.check(3.6)
    assert not pilot.armed and pilot.target is None


def test_heartbeats_of_others_do_not_count(pilot):
    armed(pilot, 4)
    pilot.heartbeat(7, 5.5)
    pilot.check(6.0)
    assert not pilot.armed


def test_set_points_of_others_are_flown_and_keep_no_fail_safe_from_acting(pilot):
    armed(pilot, 4)
    assert pilot.obey(7, Order(target=HERE), 4.0) and pilot.command(4.0).target == HERE
    pilot.check(5.1)
    assert not pilot.armed


def test_set_points_of_who_armed_are_a_sign_of_life(pilot):
    assert pilot.set_mode(4) and pilot.arm(245, 0.0, "")
    assert pilot.obey(245, Order(target=HERE), 2.0)
    pilot.check(4.4)
    assert pilot.armed


def test_heights_above_the_water_are_its_surface():
    assert order_of_local(local(z=-7.0), HERE, None).target[2] == 0.0
    assert order_of_local(local(8, z=-7.0), HERE, None).target[2] == 0.0
    message = SimpleNamespace(
        coordinate_frame=6, type_mask=PLACE_ONLY, lat_int=634500000, lon_int=103600000, alt=12.0, yaw=0.0
    )
    assert order_of_global(message, HERE, None, Datum(), 0.0).target[2] == 0.0


def test_sticks_do_not_outlive_disarming(pilot):
    armed(pilot)
    pilot.steer(255, np.ones(6), 0.0)
    pilot.disarm()
    pilot.arm(255, 0.1, "")
    assert not any(pilot.command(0.1).motion)


def test_sticks_do_not_outlive_a_change_of_mode(pilot):
    armed(pilot)
    pilot.steer(255, np.ones(6), 0.0)
    pilot.set_mode(2)
    assert not any(pilot.command(0.1).motion)


def local(frame=1, mask=PLACE_ONLY, **fields):
    zero = dict.fromkeys(("x", "y", "z", "vx", "vy", "vz", "yaw", "yaw_rate"), 0.0)
    return SimpleNamespace(coordinate_frame=frame, type_mask=mask, **(zero | fields))


@pytest.mark.parametrize(
    ("frame", "place"),
    [
        (1, (1.0, 2.0, 3.0)),
        (7, (11.0, 22.0, 8.0)),
        # Ahead is east: 1 m ahead and 2 m to the right (south).
        *[(frame, (8.0, 21.0, 8.0)) for frame in (8, 9, 12)],
    ],
)
def test_places_by_frame(frame, place):
    order = order_of_local(local(frame, x=1.0, y=2.0, z=3.0), HERE, None)
    np.testing.assert_allclose(order.target, (*place, HERE[3]), atol=1e-12)


def test_ignored_coordinates_stay():
    order = order_of_local(local(mask=PLACE_ONLY | 0b11, x=math.nan, y=math.nan, z=7.0), HERE, (1.0, 2.0, 3.0, 0.5))
    assert order.target == (1.0, 2.0, 7.0, 0.5)
    order = order_of_local(local(12, PLACE_ONLY | 0b110, x=2.0, y=math.nan, z=math.nan), HERE, None)
    np.testing.assert_allclose(order.target, (10.0, 22.0, 5.0, HERE[3]), atol=1e-12)


def test_desired_yaw():
    mask = PLACE_ONLY & ~1024
    assert order_of_local(local(mask=mask, yaw=1.0), HERE, None).target[3] == 1.0
    assert order_of_local(local(9, mask, yaw=1.0), HERE, None).target[3] == pytest.approx(HERE[3] + 1.0)


def test_velocity():
    order = order_of_local(local(1, VELOCITY_ONLY, vx=0.2, vy=0.4, vz=-0.1, yaw_rate=0.3), HERE, None)
    np.testing.assert_allclose(order.velocity, (0.4, -0.2, -0.1, 0.3), atol=1e-12)  # north is to the left
    assert order_of_local(local(8, VELOCITY_ONLY, vx=0.2), HERE, None).velocity[:2] == (0.2, 0.0)


def test_velocity_lasts_3_s(pilot):
    armed(pilot, 4)
    pilot.obey(255, Order(velocity=(0.5, 0.0, 0.5, -2.0)), 1.0)
    command = pilot.command(3.9)
    assert command.motion == (0.5, 0.0, 1.0, 0.0, 0.0, -1.0) and command.hold_position and command.target is None
    assert not any(pilot.command(4.1).motion)


@pytest.mark.parametrize(
    "message",
    [
        local(2),
        local(x=math.nan),
        local(x=math.inf),
        local(x=20_000.0),
        local(mask=0xFFFF),
        local(1, VELOCITY_ONLY, vx=math.nan),
        local(mask=PLACE_ONLY & ~1024, yaw=math.inf),
    ],
)
def test_bad_set_points_move_nothing(pilot, messages, message):
    armed(pilot, 4)
    order = order_of_local(message, HERE, None)
    assert order.refusal and not pilot.obey(255, order, 0.0)
    assert pilot.target is None and not any(pilot.command(0.0).motion) and messages


def test_set_points_count_in_guided_only(pilot):
    armed(pilot, 2)
    assert not pilot.obey(255, Order(target=HERE), 0.0) and pilot.command(0.0).target is None


def attitude(roll=0.0, pitch=0.0, yaw=0.0, thrust=0.5, mask=0):
    (cf, ct, cp), (sf, st, sp) = np.cos(np.array([roll, pitch, yaw]) / 2), np.sin(np.array([roll, pitch, yaw]) / 2)
    w, x = cf * ct * cp + sf * st * sp, sf * ct * cp - cf * st * sp
    y, z = cf * st * cp + sf * ct * sp, cf * ct * sp - sf * st * cp
    return SimpleNamespace(q=[float(v) for v in (w, x, y, z)], thrust=thrust, type_mask=mask)


def test_attitude_turns_and_dives():
    here = (0.0, 0.0, 2.0, 3.0)
    order = order_of_attitude(attitude(yaw=-3.0, thrust=0.25), here, 0.3)  # over the seam: to the right
    np.testing.assert_allclose(order.velocity, (0.0, 0.0, 0.15, math.tau - 6.0), atol=1e-9)
    assert order_of_attitude(attitude(roll=0.05, pitch=-0.05), here, 0.3).velocity is not None
    for wrong in (
        *(attitude(roll=0.2), attitude(pitch=-0.2), attitude(thrust=math.nan), attitude(mask=64), attitude(mask=128)),
        SimpleNamespace(q=[0.0] * 4, thrust=0.5, type_mask=0),
        SimpleNamespace(q=[math.nan] * 4, thrust=0.5, type_mask=0),
    ):
        assert order_of_attitude(wrong, here, 0.3).refusal
    assert order_of_attitude(attitude(), None, 0.3).refusal


def test_a_refusal_is_reported_once_and_again_after_it_went_well(pilot, messages):
    armed(pilot, 4)
    count = len(messages)
    for order in (Order(refusal="no"), Order(refusal="no"), Order(target=HERE), Order(refusal="no")):
        pilot.obey(255, order, 0.0)
    assert messages[count:] == ["Set-point refused: no"] * 2


def test_places_need_a_place():
    assert order_of_local(local(), None, None).refusal


def test_global_place():
    datum = Datum()
    message = SimpleNamespace(
        coordinate_frame=6, type_mask=PLACE_ONLY, lat_int=634501000, lon_int=103600000, alt=-4.0, yaw=0.0
    )
    order = order_of_global(message, HERE, None, datum, datum.height)
    np.testing.assert_allclose(order.target[:3], (11.15, 0.0, 4.0), atol=0.05)
    message.lat_int = 2**31 - 1
    assert order_of_global(message, HERE, None, datum, datum.height).refusal
    message.coordinate_frame, message.alt = 5, math.nan
    assert order_of_global(message, HERE, None, datum, datum.height).refusal


@pytest.mark.parametrize(("name", "value"), [("SYSID_THISMAV", 2), ("FS_PILOT_TIMEOUT", math.nan), ("NO", 1)])
def test_parameters_that_cannot_be_set(pilot, name, value):
    before = pilot.parameters.listed()
    assert not pilot.parameters.set(name, value) and pilot.parameters.listed() == before
