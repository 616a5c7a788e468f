"""MavlinkLink against the twin's endpoint: what it reads, how it arms, and when it lets go."""

import threading
import time
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest
from tests.links.mavlink.vehicle import ATTITUDE, PLACE, endpoint, free_port, measured, soon
from tests.links.serving import serving

from rovtwin.core.errors import LinkError, LinkTimeout
from rovtwin.core.flow import Command
from rovtwin.links.mavlink import link as link_module
from rovtwin.links.mavlink.driver.boot_clock import BootClock, Order
from rovtwin.links.mavlink.driver.readings import Readings
from rovtwin.links.mavlink.driver.steering import Steering
from rovtwin.links.mavlink.link import MavlinkLink
from rovtwin.links.mavlink.mixing import mixer
from rovtwin.links.mavlink.modes import MODES
from rovtwin.links.mavlink.services.commands import COMMANDS
from rovtwin.links.mavlink.services.conversation import ANSWERS
from rovtwin.links.mavlink.telemetry.streams import RATES
from rovtwin.vehicle import load_vehicle

pytestmark = pytest.mark.system

pytest.importorskip("pymavlink", reason="pymavlink is not installed: pip install 'rovtwin[mavlink]'")

SURGE_SWAY_YAW = np.eye(6)[:, [0, 1, 5]]


@contextmanager
def linked(axes=SURGE_SWAY_YAW, how="udpin", estimate=False, server_options=None, **options):
    server = endpoint(**(server_options or {}))
    urls = {"udpin": f"mavlink://udpin:{server.ground_station}", "tcp": f"tcp:127.0.0.1:{server.tcp_port}"}
    with serving(server) as served:
        assert soon(lambda: bool(served.messages))
        served.feed(0.0, measured(0.0, estimate))
        with MavlinkLink(urls[how], axes, **options) as link:
            yield served, link


def collect(link, served, seconds=0.5, estimate=False):
    """Readings while the vehicle measures at 50 Hz."""
    found = []
    for k in range(1, round(seconds / 0.02) + 1):
        served.feed(k * 0.02, measured(k * 0.02, estimate))
        time.sleep(0.02)
        found += link.read()
    return found


def last_motion(served):
    return served.commands[-1].motion if served.commands else (0.0,) * 6


@pytest.mark.parametrize("how", ["udpin", "tcp"])
def test_readings_are_si(how):
    with linked(how=how, readings=Readings(position=True)) as (served, link):
        found = collect(link, served)
    by = {r.sensor: r.value for r in found}
    np.testing.assert_allclose(by["attitude"], ATTITUDE, atol=1e-6)
    np.testing.assert_allclose(by["gyro"], [0.01, -0.02, 0.03], atol=1e-6)
    np.testing.assert_allclose(by["accelerometer"], [1.0, 0.5, -9.7], atol=0.01)  # mg
    np.testing.assert_allclose(by["pressure"], [PLACE[2]], atol=1e-4)
    np.testing.assert_allclose(by["position"], PLACE[:2], atol=1e-6)
    np.testing.assert_allclose(by["altimeter"], [7.25], atol=0.005)
    np.testing.assert_allclose(by["battery"], [0.83, 120.0], rtol=0.02)
    assert by["leak"] == [0.0]


@pytest.mark.parametrize("depth", ["VFR_HUD", "GLOBAL_POSITION_INT"])
def test_depth_from_elsewhere(depth):
    with linked(readings=Readings(depth=depth)) as (served, link):
        found = collect(link, served, estimate=True)
    depths = [r.value[0] for r in found if r.sensor == "pressure"]
    assert depths and np.allclose(depths, PLACE[2], atol=1e-3)
    with pytest.raises(LinkError, match="depth"):
        Readings(depth="SONAR")


def test_arms_in_manual_and_flies():
    with linked(server_options={"gain": 0.5}) as (served, link):
        assert not link.armed
        link.send(Command(np.array([0.2, 0.1, -0.3])))
        time.sleep(0.1)
        assert not served.commands
        link.arm()
        assert link.armed and link.gain == 0.5
        link.send(Command(np.array([0.2, 0.1, -0.3])))
        assert soon(lambda: any(last_motion(served)))
        np.testing.assert_allclose(last_motion(served), [0.2, 0.1, 0, 0, 0, -0.3], atol=1e-3)
        link.send(Command(np.array([1.0, 0.0, 0.0])))
        assert soon(lambda: last_motion(served)[0] == 0.5), "half thrust is all that half gain gives"
        link.stop()
        assert soon(lambda: not served.commands[-1].armed)
        with pytest.raises(LinkError, match="stopped"):
            link.arm()


@pytest.mark.parametrize(("firmware", "turned"), [((4, 5), [0.3, -0.2]), ((4, 1), [0.0, 0.0])])
def test_rolls_and_pitches_as_the_version_does(firmware, turned, monkeypatch):
    """By microseconds, without the pilot's gain, from 4.5 on; not at all before."""
    warned = []
    monkeypatch.setattr(link_module.logger, "warning", lambda text, *values: warned.append(text % values))
    with linked(axes=np.eye(6), server_options={"gain": 0.5, "firmware": firmware}) as (served, link):
        link.arm()
        assert link.firmware == firmware
        link.send(Command(np.array([0.1, 0.0, 0.0, 0.3, -0.2, 0.0])))
        expected = [0.1, 0, 0, *turned, 0]
        assert soon(lambda: np.allclose(last_motion(served), expected, atol=1 / 399)), last_motion(served)
    assert "the pilot's gain is 0.5: no more than that share" in " ".join(warned)
    assert ("ArduSub 4.1 does not roll and pitch" in " ".join(warned)) == (firmware == (4, 1))


@pytest.mark.parametrize("silent", [512, 520])
def test_the_version_is_asked_for_in_either_way(silent, monkeypatch):
    monkeypatch.delitem(COMMANDS, silent)
    with linked() as (_served, link):
        link.arm()
        assert link.firmware == (4, 5)


def test_a_vehicle_that_does_not_say_what_its_sticks_do_is_not_armed(monkeypatch):
    for number in (512, 520):
        monkeypatch.delitem(COMMANDS, number)
    with linked(time_limit=2.0) as (served, link):
        with pytest.raises(LinkTimeout, match="AUTOPILOT_VERSION .or give `firmware`"):
            link.arm()
        assert not served.commands
    monkeypatch.delitem(ANSWERS, "PARAM_REQUEST_READ")
    with linked(time_limit=2.0, gain=0.5, firmware=(4, 5)) as (served, link):
        with pytest.raises(LinkTimeout, match="JS_THR_GAIN .or give `throttle_gain`"):
            link.arm()
        assert not served.commands


def test_throttle_has_a_gain_of_its_own(monkeypatch):
    """Twice as much up and down: 0.2 down are 0.2, also where the first answers get lost."""
    answers, lost = ANSWERS["PARAM_REQUEST_READ"], iter(range(3))
    monkeypatch.setitem(
        ANSWERS, "PARAM_REQUEST_READ", lambda *asked: answers(*asked) if next(lost, None) is None else None
    )
    with linked(axes=np.eye(6)) as (served, link):
        link._line.send(link._dialect.MAVLink_param_set_message(1, 1, b"JS_THR_GAIN", 2.0, 9))
        link.arm()
        link.send(Command(np.array([0.0, 0.0, 0.2, 0.0, 0.0, 0.0])))
        assert soon(lambda: abs(last_motion(served)[2] - 0.2) < 1 / 399), last_motion(served)


def test_the_gain_in_force_comes_from_a_firmware_that_streams_nothing_by_itself(caplog):
    """ArduSub has no interval for named values (measured: 511 for 251 is denied): they come by their stream."""
    with linked(gain=None, server_options={"rates": dict.fromkeys(RATES, 0.0)}) as (served, link):
        feed = threading.Thread(target=collect, args=(link, served, 1.5))
        feed.start()
        link.arm()
        feed.join()
    assert link._steering.in_force and "does not say the gain in force" not in caplog.text


def test_the_gain_in_force_counts_and_its_changes_are_reported():
    steering = Steering(None, 1.0, (4, 5))

    def parameter(name, value):
        return steering.take("NAMED_VALUE_FLOAT", SimpleNamespace(name=name, value=value))

    steering.take("PARAM_VALUE", SimpleNamespace(param_id="JS_GAIN_DEFAULT", param_value=0.1))
    assert steering.gain == 0.1 and "does not say the gain in force" in " ".join(steering.limits())
    assert parameter("PilotGain", 0.5) == "" and steering.gain == 0.5, "the firmware does not go below JS_GAIN_MIN"
    assert parameter("PilotGain", 0.75) == "the pilot's gain is 0.75 now, 0.5 before" and steering.gain == 0.75
    assert "down" in steering.limits()[0] and len(steering.limits()) == 1 and steering.reach == 0.75
    given = Steering(1.0, 2.0, (4, 5))
    texts = [given.take("NAMED_VALUE_FLOAT", SimpleNamespace(name=b"PilotGain", value=0.5)) for _ in range(2)]
    assert texts == ["it says that the pilot's gain is 0.5; 1, which was given, counts", ""] and given.gain == 1.0
    shallow = Steering(1.0, 0.5, (4, 5))
    assert shallow.reach == 0.5 and "raise JS_THR_GAIN" in shallow.limits()[0]
    assert given.reach == 1.0 and given.limits() == [] and "down" not in Steering(0.5, 2.0, (4, 5)).limits()[0]
    unreported = Steering(0.5, 1.0, None)
    unreported.take("AUTOPILOT_VERSION", SimpleNamespace(flight_sw_version=0))
    assert unreported.firmware is None, "0 is no version"


def test_wrench_arrives_at_the_vehicle():
    """Commands that six axes can say give the served vehicle the forces that they give by themselves."""
    heavy = mixer(load_vehicle("bluerov2_heavy").model().thrusters)
    u = heavy.commands(np.array([0.3, -0.1, 0.2, 0.05, -0.1, 0.15]))
    with linked(axes=heavy.axes, server_options={"mixer": heavy}) as (served, link):
        link.arm()
        link.send(Command(u))
        assert soon(lambda: any(last_motion(served)))
        there = heavy.command_of_motion(np.array(last_motion(served)))
        error = (heavy.wrench(there) - heavy.wrench(u)) / heavy.largest
        assert np.abs(error).max() < 0.01


def test_arming_refused_says_why():
    server = endpoint()
    with serving(server), MavlinkLink(f"udpin:{server.ground_station}", SURGE_SWAY_YAW) as link:
        with pytest.raises(LinkError, match="no attitude yet"):
            link.arm()


def test_other_mode_is_not_steered():
    """Somebody takes the vehicle over: our axes would be rates there."""
    with linked() as (served, link):
        link.arm()
        link.send(Command(np.array([0.5, 0.0, 0.0])))
        assert soon(lambda: any(last_motion(served)))
        link._send_command(176, 1.0, 2.0)  # as another client would
        assert soon(lambda: link._mode == 2)
        count = len(served.commands)
        for _ in range(5):
            link.send(Command(np.array([0.5, 0.0, 0.0])))
            time.sleep(0.05)
        later = served.commands[count + 3 :]
        assert later and MODES[2].hold_depth and all(w.hold_depth and not any(w.motion) for w in later)


def test_link_that_is_killed_disarms_by_the_vehicles_own_time_out():
    with linked() as (served, link):
        link.arm()
        link._line.send(link._dialect.MAVLink_param_set_message(1, 1, b"FS_PILOT_TIMEOUT", 0.3, 9))
        link.send(Command(np.array([0.5, 0.0, 0.0])))
        assert soon(lambda: any(last_motion(served)))
        link._line.send = lambda message: None  # the process is gone: nothing is said any more
        assert soon(lambda: not served.commands[-1].armed, 1.0)


def test_age_and_a_vehicle_that_falls_silent(monkeypatch):
    with serving(endpoint(udp_port=(port := free_port()), tcp_port=None)) as served:
        assert soon(lambda: bool(served.messages))
        served.feed(0.0, measured(0.0))
        link = MavlinkLink(f"udpout:127.0.0.1:{port}", SURGE_SWAY_YAW)
        link.arm()
        assert collect(link, served, 0.3) and link.age < 1.0
    assert soon(lambda: link.age > 0.5) and not link._stopped
    monkeypatch.setattr("rovtwin.links.mavlink.link.LOST_AFTER", 0.8)
    assert soon(lambda: link._stopped), "nobody needs to read for the thrusters to go off"
    for _ in range(2):
        with pytest.raises(LinkTimeout, match="silent"):
            link.read()
    assert link.age == float("inf") and time.monotonic() < link._disarm_until
    with pytest.raises(LinkTimeout, match="silent"):
        link.arm()
    link.close()
    assert link.read() == [] and link.age == float("inf")


def kinds_sent(link):
    """What the link sends from now on: names of messages, and of commands their numbers."""
    sent, send = [], link._line.send

    def record(message):
        command = getattr(message, "command", None)
        sent.append((message.get_type(), command, getattr(message, "param1", None) if command == 400 else None))
        send(message)

    link._line.send = record
    return sent


@pytest.mark.parametrize("end", ["stop", "close", "refused"])
def test_unarmed_link_leaves_the_vehicle_to_its_pilot(end):
    with linked() as (served, link):
        sent = kinds_sent(link)
        link.send(Command(np.array([0.5, 0.5, 0.5])))
        time.sleep(0.2)
        if end == "refused":  # of the mode: it was never asked to arm
            link._target = 77
            link._time_limit = 0.3
            with pytest.raises(LinkError):
                link.arm()
        link.stop()
        time.sleep(0.2)
        link.close()
        assert not served.commands
    assert "MANUAL_CONTROL" not in {kind for kind, _, _ in sent}
    assert 400 not in {command for _, command, _ in sent}
    if end != "refused":
        assert {kind for kind, command, _ in sent if command != 511} <= {"HEARTBEAT"}


class WithoutArming(dict):
    """Answers to commands, that to arming lost."""

    def __setitem__(self, command, result):
        if command != 400:
            super().__setitem__(command, result)


def test_stop_ends_arming_at_once_and_disarms():
    with linked(gain=1.0, time_limit=5.0) as (_served, link):
        sent = kinds_sent(link)
        acks = link._acks = WithoutArming()
        threading.Timer(0.6, link.stop).start()
        start = time.monotonic()
        with pytest.raises(LinkError, match="stopped"):
            link.arm()
        assert time.monotonic() - start < 1.5 and 400 not in acks
        assert ("COMMAND_LONG", 400, 1.0) in sent
        assert soon(lambda: ("COMMAND_LONG", 400, 0.0) in sent)
        assert soon(lambda: not link.armed)


def test_arming_has_one_limit_and_disarms_when_it_gives_up(monkeypatch):
    monkeypatch.setattr("rovtwin.links.mavlink.link.ARMING", 1.0)
    with linked(gain=1.0) as (_served, link):
        sent, send = kinds_sent(link), link._line.send
        link._line.send = lambda m: None if getattr(m, "param1", None) == 1.0 and m.command == 400 else send(m)
        start = time.monotonic()
        with pytest.raises(LinkTimeout, match="arming"):
            link.arm()
        assert time.monotonic() - start < 2.0
        assert soon(lambda: ("COMMAND_LONG", 400, 0.0) in sent)
        time.sleep(0.1)
        count = sum(kind == "MANUAL_CONTROL" for kind, _, _ in sent)
        time.sleep(0.2)
        assert sum(kind == "MANUAL_CONTROL" for kind, _, _ in sent) == count, "it is its pilot's again"
        link._line.send = send
        monkeypatch.undo()
        link.arm()  # one may try again
        time.sleep(0.6)
        assert link.armed


def test_nobody_there():
    start = time.monotonic()
    with pytest.raises(LinkTimeout, match="no heartbeat"):
        MavlinkLink(f"udpin:127.0.0.1:{free_port()}", SURGE_SWAY_YAW, time_limit=0.3)
    assert time.monotonic() - start < 1.5
    assert not [t for t in threading.enumerate() if t.name.startswith("mavlink")]


@pytest.mark.parametrize("url", ["nonsense", "udpin:nohost", "/tmp/log.elf", "tcp:127.0.0.1:1", "udpin:127.0.0.1:abc"])
def test_bad_url(url):
    with pytest.raises(LinkError, match="mavlink"):
        MavlinkLink(url, SURGE_SWAY_YAW, time_limit=0.2)


def test_server_gone_is_noticed():
    """TCP tells when the other side is gone: the link says that it cannot be used any more."""
    server = endpoint()
    with serving(server) as served:
        assert soon(lambda: bool(served.messages))
        link = MavlinkLink(f"tcp:127.0.0.1:{server.tcp_port}", SURGE_SWAY_YAW)
    assert soon(lambda: bool(link._line.failure))
    with pytest.raises(LinkError, match="closed"):
        for _ in range(3):
            link.read()
    link.close()


@pytest.mark.parametrize("speed", [1.0, 20.0])
def test_boot_clock_takes_the_shortest_delay(speed):
    clock, rng = BootClock(speed), np.random.default_rng(3)
    boots = np.arange(1000) * 0.02
    arrivals = 500.0 + boots + 0.01 + rng.exponential(0.02, 1000)
    times = np.array([clock.host_time(*pair) for pair in zip(speed * boots, speed * arrivals, strict=True)]) / speed
    assert np.all(np.diff(times) > 0)
    late = times[200:] - (500.0 + boots[200:])
    assert 0.009 < late.min() and late.max() < 0.015


def test_boot_clock_puts_nothing_after_its_arrival():
    """The first message took half a second, the others none: the offset comes down slowly."""
    clock = BootClock()
    clock.host_time(100.0, 0.5)
    arrivals = 0.52 + 0.02 * np.arange(20)
    assert all(clock.host_time(100.0 + arrival, arrival) == arrival for arrival in arrivals)


@pytest.mark.parametrize("jump", [-3000.0, 3000.0])
@pytest.mark.parametrize("whose", ["vehicle", "host"])
def test_boot_clock_survives_a_jump(jump, whose):
    clock, order = BootClock(), Order()
    kept = 0
    for k in range(400):
        shift = jump if k >= 200 else 0.0
        boot = 4000.0 + k * 0.02 + (shift if whose == "vehicle" else 0.0)
        arrival = 9000.0 + k * 0.02 + (shift if whose == "host" else 0.0)
        t = clock.host_time(boot, arrival)
        assert abs(t - arrival) < 0.01
        kept += order.forward("gyro", t, arrival)
    assert kept == 400


def test_boot_clock_follows_drift():
    """A clock that runs 100 ppm fast is followed: after an hour the readings are not a third of a second off."""
    clock = BootClock()
    errors = [clock.host_time(k * 0.5 * 1.0001, 10.0 + k * 0.5) - (10.0 + k * 0.5) for k in range(7200)]
    assert max(map(abs, errors)) < 0.005


@pytest.mark.parametrize("speed", [1.0, 20.0])
def test_late_and_repeated_readings_are_dropped(speed):
    order = Order(speed)
    times = [speed * t for t in (1.0, 1.2, 1.2, 1.0, 1.4)]
    assert [order.forward("gyro", t, 0.0) for t in times] == [True, True, False, False, True]
