"""Links to one Blueye and to two, through the vendor's SDK, against our own server.

All ports are fixed, so every test that binds these addresses is in this module.
"""

import asyncio
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress

import blueye.protocol as bp
import numpy as np
import pytest
from blueye.sdk import Drone
from tests.links.blueye.vehicle import TRUTH, Feeder, wait_for_farewells
from tests.links.serving import Served, serving, wait_for

from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError, LinkError, LinkTimeout
from rovtwin.core.flow import Command
from rovtwin.links.blueye.double import DoubleBlueyeLink
from rovtwin.links.blueye.driver.relay import relay
from rovtwin.links.blueye.link import BlueyeLink
from rovtwin.links.blueye.server import BlueyeServer
from rovtwin.links.blueye.services.http import HttpServer

PORT, STARBOARD, NOBODY, RELAY = "127.0.0.10", "127.0.0.11", "127.0.0.12", "127.0.0.13"
HTTP = 8780


@pytest.fixture(autouse=True)
def proxy(monkeypatch):
    monkeypatch.setenv("http_proxy", f"http://{PORT}:{HTTP}")
    monkeypatch.delenv("no_proxy", raising=False)
    monkeypatch.delenv("NO_PROXY", raising=False)


@contextmanager
def vehicle(*hosts: str, drones=("",), **options) -> Iterator[Served]:
    with serving(
        BlueyeServer(hosts=hosts or (PORT,), http_port=HTTP, datum=Datum(), **options), drones=drones
    ) as served:
        assert wait_for(lambda: served.messages)
        try:
            yield served
        finally:
            wait_for_farewells()


@pytest.fixture
def served() -> Iterator[Served]:
    with vehicle() as served:
        yield served


@contextmanager
def feeding(served: Served, **changed) -> Iterator[Feeder]:
    """The vehicle's telemetry in real time, until the block is left."""
    feeder, end = Feeder(served, pace=1.0), threading.Event()

    def feed() -> None:
        while not end.is_set():
            feeder.feed(0.02, **changed)

    thread = threading.Thread(target=feed, daemon=True)
    thread.start()
    try:
        yield feeder
    finally:
        end.set()
        thread.join()


def armed(*arguments, **options) -> BlueyeLink:
    link = BlueyeLink(*arguments, **options)
    link.arm()
    return link


def both_armed() -> DoubleBlueyeLink:
    link = DoubleBlueyeLink((PORT, STARBOARD))
    link.arm()
    return link


def command(*u: float) -> Command:
    return Command(np.array(u))


def newest(served: Served, drone: str = ""):
    return next((w for w in reversed(served.commands) if w.drone == drone), None)


def motion(served: Served, drone: str = "") -> tuple[float, ...]:
    command = newest(served, drone)
    return tuple(command.motion) if command and command.armed else (0.0,) * 6


# One drone


def test_readings_are_the_vehicles_in_si(served):
    with closing(BlueyeLink(PORT, position=True)) as link:
        feeder = Feeder(served)
        feeder.feed(1.2)
        assert wait_for(lambda: len(link._readings) > 200)
        time.sleep(0.1)
        found = link.read()
        values = {r.sensor: r.value for r in found}
        assert values.keys() == TRUTH.keys() - {"force"}
        for sensor, value in values.items():
            np.testing.assert_allclose(value, TRUTH[sensor], rtol=1e-5, atol=1e-5, err_msg=sensor)
        count = {sensor: sum(r.sensor == sensor for r in found) for sensor in values}
        # 50 Hz of everything for 1.2 s; DVL, altimeter and position at the 20 Hz that are asked for
        assert {count[s] for s in ("pressure", "attitude", "gyro", "accelerometer")} == {60}
        assert all(22 <= count[s] <= 26 for s in ("dvl", "altimeter", "position"))
        assert link.read() == [] and link.dropped == 0


def test_reckoned_positions_are_left_out_unless_asked_for(served):
    with closing(BlueyeLink(PORT)) as link:
        Feeder(served).feed(0.3)
        assert wait_for(lambda: len(link._readings) > 50)
        assert "position" not in {r.sensor for r in link.read()}


@pytest.mark.system
def test_nothing_is_taken_or_moved_before_arming(served):
    """Somebody else drives by auto depth and heading, as the app does, while a link comes, looks and goes."""
    pilot = Drone(PORT)
    pilot.motion.set_surge(0.5)
    pilot.motion.enable_auto_depth(True)
    pilot._ctrl_client._messages_to_send.put(bp.WatchdogCtrl(client_id=pilot.client_id))
    assert wait_for(lambda: motion(served)[0] == 0.5 and newest(served).hold_depth)
    with feeding(served):
        link = BlueyeLink(PORT)
        link.send(command(-1.0, 0.0, 0.0))
        assert wait_for(lambda: link.read())
        time.sleep(1.2)  # longer than the SDK waits with its first watchdog
        link.close()
        wait_for_farewells()
        assert motion(served)[0] == 0.5 and newest(served).hold_depth and newest(served).armed
        reports = [w.motion[0] for w in served.commands if w.armed and w.hold_depth]
        assert set(reports) == {0.5}
    pilot.disconnect()


@pytest.mark.system
def test_a_free_drone_stays_free_until_armed(served):
    with closing(BlueyeLink(PORT)) as link, feeding(served):
        link.send(command(1.0, 0.0, 0.0))
        time.sleep(1.2)
        assert served.commands == [] and "nobody is in control" in served.messages[-1]
        start = time.monotonic()
        link.arm()
        link.arm()
        assert time.monotonic() - start < 8.0
        assert wait_for(lambda: newest(served) and newest(served).armed, 0.8)
        assert motion(served) == (0.0,) * 6, "what was commanded before counts for nothing"
        link.send(command(0.5, 0.0, 0.0))
        assert wait_for(lambda: motion(served)[0] == 0.5)
        link.read()
        assert wait_for(lambda: "1 clients" in served.messages[-1]), "the observer has left"
        assert wait_for(lambda: "pressure" in {r.sensor for r in link.read()}), "still heard"


def test_a_link_that_was_stopped_or_closed_is_not_armed(served):
    link = BlueyeLink(PORT)
    link.stop()
    for end in (link.stop, link.close):
        end()
        with pytest.raises(LinkError, match="stopped or closed"):
            link.arm()
    assert served.commands == []


def test_times_are_those_of_arrival_on_the_given_clock(served):
    with closing(BlueyeLink(PORT, clock=lambda: 1234.5)) as link:
        Feeder(served).feed(0.1)
        assert wait_for(lambda: link._readings)
        assert {r.t_valid for r in link.read()} == {1234.5}


def test_command_goes_through_the_thrusters_curve(served):
    with closing(armed(PORT, curve=lambda u: np.sign(u) * u**2)) as link:
        link.send(command(0.5, -0.5, 1.0))
        assert wait_for(lambda: motion(served) == (0.25, -0.25, 1.0, 0.0, 0.0, 0.0), 1.0)
        time.sleep(0.2)
        link.send(command(0.5, 0.0, 0.0))
        assert wait_for(lambda: motion(served)[:3] == (0.25, 0.0, 0.0), 0.5)
        # 0.3 s without another one
        assert wait_for(lambda: not any(motion(served)), 0.6)


def test_send_returns_at_once_and_wrong_shapes_stop(served):
    with closing(armed(PORT)) as link:
        start = time.perf_counter()
        for _ in range(100):
            link.send(command(0.5, 0.5, 0.5))
            link.read()
        assert time.perf_counter() - start < 0.5
        assert wait_for(lambda: any(motion(served)))
        with pytest.raises(ValueError, match=r"\(2,\), expected \(3,\)"):
            link.send(command(0.5, 0.5))
        assert wait_for(lambda: not any(motion(served)), 0.25), "before the command has expired by itself"


def test_controllers_of_the_drone_stay_off(served):
    with closing(armed(PORT)) as link, feeding(served):
        assert wait_for(lambda: newest(served) and newest(served).armed, 0.8), "armed before the SDK does it"
        reports: list[tuple[bool, bool]] = []
        link._drone.telemetry.add_msg_callback(
            [bp.ControlModeTel], lambda name, tel: reports.append((tel.state.auto_depth, tel.state.auto_heading))
        )
        link._drone.motion.enable_auto_depth(True)
        link._drone.motion.enable_auto_heading(True)
        assert wait_for(lambda: any(depth for depth, _ in reports) and any(heading for _, heading in reports))
        assert wait_for(lambda: reports[-1] == (False, False), 1.0)
        # Telemetry says so first; the vehicle gets it with the next wish, 10 to 50 ms later.
        assert wait_for(lambda: not newest(served).hold_depth and not newest(served).hold_heading, 0.5)


def test_silence_grows_the_age_and_ends_the_link(served):
    now = [0.0]
    with closing(armed(PORT, timer=lambda: now[0])) as link:
        Feeder(served).feed(0.1)
        assert wait_for(lambda: link.read())
        link.send(command(0.5, 0.0, 0.0))
        assert wait_for(lambda: any(motion(served)))
        assert link.age == 0.0
        time.sleep(0.2)
        link.read()
        now[0] = 2.9
        assert link.age == pytest.approx(2.9) and link.read() == []
        now[0] = 3.1
        with pytest.raises(LinkTimeout, match=f"blueye://{PORT}: silent for 3 s"):
            link.read()
        assert link.age == np.inf
        # For good: a vehicle that comes back does not drive on
        Feeder(served).feed(0.1)
        link.send(command(0.5, 0.0, 0.0))
        with pytest.raises(LinkTimeout):
            link.read()
        assert wait_for(lambda: not any(motion(served)))
    assert link.read() == []


def test_another_client_is_in_control(served):
    pilot = Drone(PORT)
    with closing(BlueyeLink(PORT)) as link, pytest.raises(LinkError, match="another client is in control"):
        link.arm()
    with closing(BlueyeLink(PORT, observer=True)) as watching:
        pilot.motion.set_surge(0.5)
        pilot._ctrl_client._messages_to_send.put(bp.WatchdogCtrl(client_id=pilot.client_id))
        Feeder(served).feed(0.2)
        assert wait_for(lambda: watching.read()) and wait_for(lambda: motion(served)[0] == 0.5)
        watching.send(command(1.0, 1.0, 1.0))
        watching.stop()
        with pytest.raises(LinkError, match="opened to look only"):
            watching.arm()
        time.sleep(0.2)
        assert motion(served)[0] == 0.5
    with closing(armed(PORT, take_control=True)) as link:
        link.send(command(0.25, 0.0, 0.0))
        assert wait_for(lambda: motion(served)[0] == 0.25)
        pilot.disconnect()


def test_another_client_takes_control(served):
    with closing(armed(PORT)) as link, feeding(served):
        link.send(command(0.5, 0.0, 0.0))
        assert wait_for(lambda: motion(served)[0] == 0.5)
        other = Drone(PORT, disconnect_other_clients=True)
        taken = time.monotonic()

        def lost() -> bool:
            try:
                link.read()
            except LinkError as error:
                return "another client has taken control" in str(error)
            return False

        assert wait_for(lost, 1.0) and time.monotonic() - taken < 0.5
        assert link.age == np.inf
        other._ctrl_client._messages_to_send.put(bp.WatchdogCtrl(client_id=other.client_id))

        def flies() -> bool:
            other.motion.set_surge(0.75)  # again and again, as pilots do: a last zero of ours may be on its way
            return motion(served)[0] == 0.75

        assert wait_for(flies)
        link.send(command(-1.0, 0.0, 0.0))
        assert not wait_for(lambda: motion(served)[0] < 0.0, 0.2), "who has lost control commands nothing"
        assert wait_for(flies)
        other.disconnect()


def test_garbage_in_telemetry_is_counted(served):
    with closing(BlueyeLink(PORT)) as link:
        for name in ("DepthTel", "CalibratedImuTel", "ConnectedClientsTel", "ControlModeTel", "BatteryBQ40Z50Tel"):
            link._take(name, b"\x0a\xff\xff")
        link._take("NoSuchTel", b"\x00")
        assert link.dropped == 5 and link.read() == []
        Feeder(served).feed(0.1)
        assert wait_for(lambda: link.read())


@pytest.mark.parametrize("frames", [[b"\xff\xfe", b""], [b"blueye.protocol.DepthTel"]])
def test_message_that_the_sdk_cannot_take_does_not_end_its_thread(served, frames):
    with closing(BlueyeLink(PORT)) as link:
        watcher = link._drone._telemetry_watcher
        watcher._handle_message(frames)  # what its thread calls
        assert link.dropped == 1
        Feeder(served).feed(0.1)
        assert wait_for(lambda: link.read())


def test_timer_that_is_set_back_makes_no_command_young(served):
    timer = [5000.0]
    with closing(armed(PORT, timer=lambda: timer[0])) as link:
        link.send(command(0.5, 0.0, 0.0))
        assert wait_for(lambda: any(motion(served)))
        timer[0] -= 3600.0
        assert wait_for(lambda: not any(motion(served)), 0.5)


@pytest.mark.parametrize("timeout", [2.0])
def test_nobody_at_the_address(monkeypatch, timeout):
    monkeypatch.delenv("http_proxy")
    start = time.monotonic()
    with pytest.raises(LinkError, match=f"blueye://{NOBODY}: cannot be connected .* expected a Blueye drone"):
        BlueyeLink(NOBODY, timeout=timeout)
    assert time.monotonic() - start < timeout + 1


@pytest.mark.system
def test_drone_that_says_who_it_is_and_no_more():
    """Its replies are lost, for which the SDK would wait for ever."""
    loop = asyncio.new_event_loop()
    info = {"sw_version": "3.4.0", "serial_number": "x", "hardware_id": "y"}
    http = HttpServer({PORT: info}, PORT)
    loop.run_until_complete(http.start(PORT, HTTP))
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()
    start = time.monotonic()
    with pytest.raises(LinkError, match="cannot be connected"):
        BlueyeLink(PORT, timeout=3.0)
    assert time.monotonic() - start < 4
    info["sw_version"] = "2.1.0"
    with pytest.raises(LinkError, match="software 3.2 or later"):
        BlueyeLink(PORT, timeout=3.0)
    del info["sw_version"]
    with pytest.raises(LinkError, match="sw_version"):
        BlueyeLink(PORT, timeout=3.0)
    asyncio.run_coroutine_threadsafe(http.close(), loop).result(5)
    loop.call_soon_threadsafe(loop.stop)
    thread.join()
    loop.close()


def test_connection_that_comes_too_late_is_let_go(monkeypatch):
    """The SDK waits for ever where a reply is lost; if it comes after all, nobody is left in control."""
    left = threading.Event()
    monkeypatch.setattr(Drone, "connect", lambda self, **options: time.sleep(0.4))
    monkeypatch.setattr(Drone, "disconnect", lambda self: left.set())
    with pytest.raises(LinkTimeout, match="no answer within 0.2 s"):
        BlueyeLink(PORT, timeout=0.2)
    assert not left.is_set() and left.wait(2)


def test_closing_stops_and_lets_go(served):
    link = armed(PORT)
    link.send(command(1.0, 0.0, 0.0))
    assert wait_for(lambda: motion(served)[0] == 1.0)
    start = time.perf_counter()
    link.close()
    assert time.perf_counter() - start < 0.05
    assert wait_for(lambda: not newest(served).armed, 1.0)
    assert wait_for(lambda: "nobody is in control" in served.messages[-1], 1.0)


PILOT = """
import sys, time
from blueye.sdk import Drone
drone = Drone(sys.argv[1])
drone.motion.set_surge(1.0)
print("flying", flush=True)
time.sleep(60)
"""


@pytest.mark.system
def test_client_that_is_killed_thrusts_no_longer_than_the_watchdog(served):
    """kill -9: no farewell, half-open connections, nothing but silence."""
    pilot = subprocess.Popen([sys.executable, "-c", PILOT, PORT], stdout=subprocess.PIPE)
    assert pilot.stdout is not None and pilot.stdout.readline() == b"flying\n"
    assert wait_for(lambda: motion(served)[0] == 1.0)
    pilot.send_signal(signal.SIGKILL)
    pilot.wait()
    killed = time.monotonic()
    assert wait_for(lambda: not newest(served).armed, 3.0)
    assert time.monotonic() - killed < 2.0 + 0.3
    # Started again after that, it is in control at once.
    again = Drone(PORT)
    assert again.in_control
    again.disconnect()


# Two drones


@contextmanager
def two() -> Iterator[tuple[Served, Served]]:
    """Two drones with processes of their own, as real ones have."""
    with vehicle(PORT) as port, serving(BlueyeServer(hosts=(STARBOARD,), http_port=HTTP)) as starboard:
        assert wait_for(lambda: starboard.messages)
        # The proxy stands at one of them, and knows both only if they are one server's.
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("requests.get", _past_the_proxy)
            try:
                yield port, starboard
            finally:
                wait_for_farewells()


def _past_the_proxy(url: str, **options):
    import requests

    host = url.split("/")[2]
    with requests.Session() as session:
        session.trust_env = False
        return session.get(url.replace(host, f"{host}:{HTTP}"), **options)


def test_command_is_split_and_readings_are_joined():
    with vehicle(PORT, STARBOARD, drones=("port", "starboard")) as served:
        with closing(both_armed()) as link, feeding(served):
            assert wait_for(lambda: link.age < 0.1)
            link.send(command(0.1, 0.2, 0.3, -0.1, -0.2, -0.3))
            for drone, share in (("port", (0.1, 0.2, 0.3)), ("starboard", (-0.1, -0.2, -0.3))):
                assert wait_for(lambda d=drone, s=share: motion(served, d)[:3] == pytest.approx(s), 0.25), drone
            link.read()
            time.sleep(0.5)
            found = link.read()
            values = {r.sensor: r.value for r in found}
            for sensor in ("pressure", "attitude", "gyro", "accelerometer", "dvl"):
                np.testing.assert_allclose(values[sensor], TRUTH[sensor], atol=1e-5, err_msg=sensor)
            assert "position" not in values, "two drones reckon from two zeros"
            assert sum(r.sensor == "gyro" for r in found) < 35, "two drones' readings are one vehicle's"
            for sensor in values:
                times = [r.t_valid for r in found if r.sensor == sensor]
                assert times == sorted(set(times))
            with pytest.raises(ValueError, match=r"expected \(6,\)"):
                link.send(command(0.1, 0.2, 0.3))


@pytest.mark.system
@pytest.mark.parametrize("lost", [0, 1])
def test_one_drone_lost_stops_the_other_within_half_a_second(lost):
    with two() as both:
        stays, goes = both[1 - lost], both[lost]
        with closing(both_armed()) as link, feeding(stays):
            with feeding(goes):
                assert wait_for(lambda: link.age < 0.1)
                link.send(command(*[0.5] * 6))
                assert wait_for(lambda: any(motion(stays)) and any(motion(goes)))
            silent = time.monotonic()
            while any(motion(stays)) and time.monotonic() < silent + 1.0:
                link.send(command(*[0.5] * 6))  # the autopilot knows nothing of it yet
                link.read()
                time.sleep(0.02)
            assert time.monotonic() - silent < 0.5
            # Each has a connection of its own: on a busy machine the other's server reads its stop a moment later.
            assert wait_for(lambda: not any(motion(goes)), max(0.0, silent + 0.5 - time.monotonic())), "neither thrusts"
            assert 0.3 < link.age < 0.6 and link.ages[1 - lost] < 0.1
            time.sleep(0.1)
            assert "gyro" in {r.sensor for r in link.read()}, "the one that is left is still heard"
            with feeding(goes):
                assert wait_for(lambda: link.age < 0.1)
                link.send(command(*[0.5] * 6))
                assert wait_for(lambda: any(motion(stays)) and any(motion(goes)), 1.0)


def test_command_that_is_half_a_number_stops_both():
    with vehicle(PORT, STARBOARD, drones=("port", "starboard")) as served:
        with closing(both_armed()) as link, feeding(served):
            assert wait_for(lambda: link.age < 0.1)
            link.send(command(*[0.5] * 6))
            assert wait_for(lambda: any(motion(served, "port")) and any(motion(served, "starboard")))
            link.send(command(0.5, 0.5, 0.5, 0.5, 0.5, np.nan))
            assert wait_for(lambda: not any(motion(served, "port")) and not any(motion(served, "starboard")), 0.25)


@pytest.mark.system
def test_one_of_two_cannot_be_reached(served):
    with pytest.raises(LinkError, match=STARBOARD):
        DoubleBlueyeLink((PORT, STARBOARD), timeout=3.0)
    assert wait_for(lambda: "nobody is in control" in served.messages[-1]), "the other one is let go"


def test_one_of_two_refuses_to_be_armed():
    with vehicle(PORT, STARBOARD, drones=("port", "starboard")) as served:
        pilot = Drone(STARBOARD)
        with closing(DoubleBlueyeLink((PORT, STARBOARD))) as link, feeding(served):
            start = time.monotonic()
            with pytest.raises(LinkError, match=r"another client is in control.*take_control"):
                link.arm()
            assert time.monotonic() - start < 8.0
            link.send(command(*[0.5] * 6))
            time.sleep(0.3)
            assert not any(any(w.motion) for w in served.commands), "half a vehicle does not start"
        pilot.disconnect()


def test_two_drones_have_two_addresses():
    with pytest.raises(ConfigError, match="two different addresses"):
        DoubleBlueyeLink((PORT, PORT))


def test_drone_behind_a_relay(served):
    """As a drone in a network namespace of its own is reached."""
    loop = asyncio.new_event_loop()
    task = loop.create_task(relay(RELAY, PORT, ports=(5555, 5556, 5557)))

    def run() -> None:
        with suppress(asyncio.CancelledError):
            loop.run_until_complete(task)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        with closing(armed(RELAY)) as link:
            Feeder(served).feed(0.2)
            assert wait_for(lambda: "pressure" in {r.sensor for r in link.read()})
            link.send(command(0.5, 0.0, 0.0))
            assert wait_for(lambda: motion(served)[0] == 0.5)
        wait_for_farewells()
    finally:
        loop.call_soon_threadsafe(task.cancel)
        thread.join(5)
        loop.close()
