"""Ros2Link on a transport within the process: clocks, sources, and what it does with messages that make no sense."""

import math
import time

import numpy as np
import pytest
from tests.links.ros2.fake import FakeTransport, FakeVehicle

from rovtwin.core.errors import LinkError, LinkTimeout
from rovtwin.core.flow import Command
from rovtwin.links.ros2 import convert
from rovtwin.links.ros2 import messages as msg
from rovtwin.links.ros2.link import BACKLOG, Ros2Link


@pytest.fixture
def vehicle():
    vehicle = FakeVehicle(3, 0.02)
    yield vehicle
    vehicle.link.close()


def test_every_sensor_comes_from_one_topic(vehicle):
    t, eta, nu = vehicle.now, [1.0, 2.0, 3.0, 0.0, 0.0, 0.5], [0.1, 0.2, 0.3, 0.0, 0.0, 0.4]
    vehicle.transport.deliver("/rov/odometry", convert.odometry(t, eta, nu))
    assert sorted(r.sensor for r in vehicle.link.read()) == ["dvl", "position"]
    assert "/rov/position" not in vehicle.transport.subscribers


def test_sources_and_names():
    transport = FakeTransport()
    sources = {"position": "mocap", "attitude": "mocap", "dvl": "dvl", "leak": ""}
    with Ros2Link("rov", 1, sources=sources, names={"mocap": "/optitrack/pose"}, transport=transport) as link:
        message = convert.pose(0.0, [1.0, 2.0, 3.0], [0.0, 0.0, 0.5])
        transport.deliver("/optitrack/pose", message)
        assert {r.sensor: r.value.tolist() for r in link.read()}["position"] == pytest.approx([1.0, 2.0])
        assert "/rov/leak" not in transport.subscribers and "/rov/odometry" not in transport.subscribers
    with pytest.raises(LinkError, match="sources"):
        Ros2Link("rov", 1, sources={"position": "gps"}, transport=FakeTransport())


@pytest.mark.parametrize("off", [-3600.0, 1e9, -1.5, 2.0])
def test_a_stamp_far_from_now_is_refused_and_reported(vehicle, off):
    vehicle.transport.deliver("/rov/imu", convert.imu(max(vehicle.now + off, 0.001), gyro=[0.1, 0.2, 0.3]))
    assert vehicle.link.read() == []
    assert vehicle.link.refused == {"imu": 1} and "synchronise" in vehicle.link.problems["imu"]


def test_a_stamp_of_zero_is_now_and_a_delay_is_kept(vehicle):
    vehicle.transport.deliver("/rov/imu", convert.imu(0.0, gyro=[0.1, 0.2, 0.3]))
    vehicle.now += 0.5
    vehicle.transport.deliver("/rov/imu", convert.imu(vehicle.now - 0.3, gyro=[0.1, 0.2, 0.3]))
    assert [r.t_valid for r in vehicle.link.read()] == pytest.approx([vehicle.now - 0.5, vehicle.now - 0.3])


def test_nothing_is_valid_after_it_came(vehicle):
    vehicle.transport.deliver("/rov/imu", convert.imu(vehicle.now + 0.2, gyro=[0.1, 0.2, 0.3]))
    assert [r.t_valid for r in vehicle.link.read()] == [vehicle.now]


def test_repeats_and_overtaken_readings_are_left_out(vehicle):
    vehicle.now += 0.05
    for t in (100.0, 100.02, 100.02, 100.01, 100.04):
        vehicle.transport.deliver("/rov/imu", convert.imu(t, gyro=[0.1, 0.2, 0.3]))
    assert [r.t_valid for r in vehicle.link.read()] == [100.0, 100.02, 100.04]


@pytest.mark.parametrize(
    ("topic", "message"),
    [
        ("imu", convert.imu(100.0, gyro=[math.nan, 0.0, 0.0])),
        ("imu", msg.Imu(convert.header(100.0, ""), msg.Quaternion(0.0, 0.0, 0.0, 0.0))),
        ("pressure", msg.FluidPressure(convert.header(100.0, ""), math.inf)),
        ("battery", msg.BatteryState(convert.header(100.0, ""))),
        ("odometry", msg.Odometry(msg.Header(msg.Time(-5, 0)))),
    ],
)
def test_nonsense_gives_no_reading(vehicle, topic, message):
    vehicle.transport.deliver(f"/rov/{topic}", message)
    assert vehicle.link.read() == [] and vehicle.link.refused[topic] == 1


def test_readings_that_nobody_takes_do_not_pile_up(vehicle):
    vehicle.now += 0.2
    for k in range(BACKLOG + 500):
        vehicle.transport.deliver("/rov/imu", convert.imu(100.0 + 1e-5 * k, gyro=[0.1, 0.2, 0.3]))
    assert len(vehicle.link.read()) == BACKLOG


def test_simulated_time_needs_a_clock_and_is_the_readings_time():
    transport = FakeTransport()
    with Ros2Link("rov", 1, None, use_sim_time=True, transport=transport) as link:
        transport.deliver("/rov/imu", convert.imu(7.0, gyro=[0.1, 0.2, 0.3]))
        assert link.read() == [] and "/clock" in link.problems["imu"]
        transport.deliver("/clock", msg.Clock(convert.stamp(7.1)))
        transport.deliver("/rov/imu", convert.imu(7.0, gyro=[0.1, 0.2, 0.3]))
        assert [r.t_valid for r in link.read()] == [7.0] and link.sim_time() == 7.1
    with pytest.raises(LinkError, match="use_sim_time"):
        Ros2Link("rov", 1, None, transport=FakeTransport())


def test_simulated_time_on_our_clock():
    transport, now = FakeTransport(), [50.0]
    with Ros2Link("rov", 1, lambda: now[0], use_sim_time=True, transport=transport) as link:
        transport.deliver("/clock", msg.Clock(convert.stamp(7.0)))
        transport.deliver("/rov/imu", convert.imu(6.9, gyro=[0.1, 0.2, 0.3]))
        assert [r.t_valid for r in link.read()] == pytest.approx([49.9])


def test_a_wrench_in_flu_and_zeros_at_the_end():
    transport = FakeTransport()
    link = Ros2Link("rov", 2, wrench=lambda u: np.array([10.0 * u[0], 1, 2, 3, 4, 5.0 * u[1]]), transport=transport)
    link.arm()
    link.send(Command(np.array([1.0, 0.5])))
    end = time.monotonic() + 10
    while not transport.published and time.monotonic() < end:
        time.sleep(0.005)
    link.close()
    texts = [m.wrench for topic, m in transport.published if topic == "/rov/cmd_wrench"]
    assert [texts[0].force.x, texts[0].force.y, texts[0].force.z] == [10.0, -1.0, -2.0]
    assert [texts[0].torque.x, texts[0].torque.y, texts[0].torque.z] == [3.0, -4.0, -2.5]
    assert texts[-1].force.x == 0.0 and dict(transport.published)["/rov/arm"].data is False
    assert transport.closed


def test_wrong_number_of_commands_stops(vehicle):
    vehicle.link.arm()
    vehicle.link.send(Command(np.array([0.5, 0.5, 0.5])))
    vehicle.link.send(Command(np.array([0.5])))
    assert not vehicle.applied().any()


@pytest.mark.parametrize("end", ["stop", "close", "nonsense"])
def test_unarmed_link_says_nothing(vehicle, end):
    vehicle.link.send(Command(np.array([0.5, 0.5, 0.5])))
    vehicle.settle()
    if end == "nonsense":
        vehicle.link.send(Command(np.full(3, np.nan)))
    if end != "close":
        vehicle.link.stop()
        vehicle.settle()
    vehicle.link.close()
    assert vehicle.transport.published == []


def test_stopped_link_does_not_arm(vehicle):
    vehicle.link.stop()
    with pytest.raises(LinkError, match="stopped"):
        vehicle.link.arm()
    vehicle.link.close()
    assert vehicle.transport.published == []


@pytest.mark.parametrize(("received", "limit"), [(True, 3.0), (False, 10.0)])
def test_age_and_a_vehicle_that_falls_silent(received, limit):
    transport, now = FakeTransport(), [50.0]
    with Ros2Link("rov", 1, transport=transport, stamp_clock=lambda: now[0], timer=lambda: now[0]) as link:
        link.arm()
        if received:
            now[0] += 5.0
            transport.deliver("/rov/imu", convert.imu(now[0], gyro=[0.1, 0.2, 0.3]))
            assert link.age == 0.0
        transport.deliver("/rov/imu", convert.imu(9e8, gyro=[0.1, 0.2, 0.3]))
        now[0] += limit - 0.1
        assert link.age == pytest.approx(limit - 0.1) and len(link.read()) == received
        transport.published.clear()
        now[0] += 0.2
        end = time.monotonic() + 10
        while not transport.published and time.monotonic() < end:  # the thrusters go off though nobody reads
            time.sleep(0.005)
        assert dict(transport.published)["/rov/arm"].data is False
        for _ in range(2):
            with pytest.raises(LinkTimeout, match=f"for {limit:g} s.*synchronise"):
                link.read()
        transport.deliver("/rov/imu", convert.imu(now[0], gyro=[0.1, 0.2, 0.3]))
        with pytest.raises(LinkTimeout):
            link.arm()
        assert link.age == math.inf
    assert link.read() == [] and link.age == math.inf


class Fast:
    """A clock by hand that runs `speed` times as fast as the real one."""

    def __init__(self, speed: float):
        self.speed, self.real = speed, 0.0

    def __call__(self) -> float:
        return 40.0 + self.real * self.speed


@pytest.mark.parametrize("speed", [0.5, 1.0, 8.0])
def test_simulated_time_is_found_and_mapped_at_the_clocks_speed(speed):
    """Stamps from 0 on, after a way of 5 to 35 ms: times are late by the shortest."""
    transport, clock, rng = FakeTransport(), Fast(speed), np.random.default_rng(5)
    errors = []
    with Ros2Link("rov", 1, clock, transport=transport, timer=lambda: clock.real) as link:
        for k in range(1000):
            sent = 0.1 + 0.04 * k
            clock.real = sent + 0.005 + 0.03 * rng.random()
            transport.deliver("/clock", msg.Clock(convert.stamp(speed * sent)))
            transport.deliver("/rov/imu", convert.imu(speed * (sent - 0.01), gyro=[0.1, 0.2, 0.3]))
            errors += [r.t_valid - (40.0 + speed * (sent - 0.01)) for r in link.read()]
        assert len(errors) > 990 and not link.problems
    assert 0.0 < min(errors[50:]) and max(errors[50:]) < 0.008 * speed


def test_a_simulation_that_begins_anew_is_followed():
    transport, clock = FakeTransport(), Fast(1.0)
    with Ros2Link("rov", 1, clock, transport=transport, timer=lambda: clock.real) as link:
        found = {}
        for k in range(1, 1000):
            clock.real = 0.02 * k
            now = clock.real % 10.0 + 0.02
            transport.deliver("/clock", msg.Clock(convert.stamp(now)))
            transport.deliver("/rov/imu", convert.imu(now, gyro=[0.1, 0.2, 0.3]))
            found |= {clock(): r.t_valid for r in link.read()}
        late = [seen - valid for seen, valid in found.items()]
        assert min(late) >= 0.0 and max(late) < 0.01
        assert sum(seen > 51.5 for seen in found) > 420, "a second later it is believed"


def test_hosts_time_at_the_clocks_speed():
    transport, clock = FakeTransport(), Fast(4.0)
    stamp_clock = lambda: 1e9 + clock.real  # noqa: E731
    with Ros2Link("rov", 1, clock, transport=transport, stamp_clock=stamp_clock, timer=lambda: clock.real) as link:
        for k in range(1, 100):
            clock.real = 0.1 * k
            transport.deliver("/rov/imu", convert.imu(1e9 + clock.real - 0.05, gyro=[0.1, 0.2, 0.3]))
            assert [r.t_valid for r in link.read()] == pytest.approx([clock() - 0.2], abs=0.02)


def test_hosts_time_beside_a_strangers_clock():
    """Something else on the network publishes /clock: the vehicle's stamps are of the host's clock all the same."""
    transport, now = FakeTransport(), [50.0]
    with Ros2Link("rov", 1, lambda: now[0], transport=transport, stamp_clock=lambda: 1e9 + now[0]) as link:
        transport.deliver("/clock", msg.Clock(convert.stamp(7.0)))
        transport.deliver("/rov/imu", convert.imu(1e9 + 49.9, gyro=[0.1, 0.2, 0.3]))
        assert [r.t_valid for r in link.read()] == pytest.approx([49.9])
    transport = FakeTransport()
    with Ros2Link("rov", 1, use_sim_time=False, transport=transport):
        assert "/clock" not in transport.subscribers
