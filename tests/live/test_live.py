"""Flying over a link: URLs, listening before arming, what is flown and logged, what ends it."""

import time
from datetime import UTC, datetime

import numpy as np
import pytest
from tests.runs.test_on_board import scenario as with_parts

import rovtwin.live.connect as connecting
from rovtwin.core.arrays.rotations import rotation_from_euler
from rovtwin.core.datum import datum_of
from rovtwin.core.errors import ConfigError, LinkError, LinkTimeout, LogError
from rovtwin.core.flow import Command, Measurement
from rovtwin.core.frames import rotation_from_quaternion
from rovtwin.core.link import Link, Source
from rovtwin.core.log import Log
from rovtwin.core.programs import compiled
from rovtwin.links.registry import parse
from rovtwin.live import flight as live
from rovtwin.live import readiness
from rovtwin.live.connect import connect, described, on_this_machine, source
from rovtwin.live.flight import fly_live
from rovtwin.live.readiness import SensorMux, listen
from rovtwin.live.record import record
from rovtwin.runs.pace import Clock, Pace
from rovtwin.runs.realtime import HostAutopilot
from rovtwin.scenario.files import load_scenario

pytestmark = pytest.mark.system

SPEED = 10.0
COMPOSED: list = []  # scenarios that were asked for
IN_PIECES: list[tuple] = []  # what was reported of a tick that could not be compiled in one piece


class Fake(Link):
    """A vehicle that says what it is given to say, and keeps what it was sent."""

    def __init__(self, *readings: Measurement):
        self.to_say = list(readings)
        self.sent: list[np.ndarray] = []
        self.stopped = self.armed = self.closed = False

    def read(self):
        text, self.to_say = self.to_say, []
        return text

    def send(self, command: Command) -> None:
        self.sent.append(np.array(command.u))

    def arm(self) -> None:
        self.armed = True

    @property
    def age(self) -> float:
        return 0.0

    def stop(self) -> None:
        self.stopped = True

    def close(self) -> None:
        self.stop()
        self.closed = True


class Instrument(Source):
    def __init__(self, *readings: Measurement):
        self.to_say = list(readings)

    def read(self):
        text, self.to_say = self.to_say, []
        return text

    def close(self) -> None:
        pass


def reading(sensor: str, *value: float, t: float = 0.0) -> Measurement:
    return Measurement(sensor, np.array(value), t)


# URLs


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("192.168.1.101", "no scheme"),
        ("ftp://192.168.1.101", "'ftp'"),
        ("", "no scheme"),
        ("blueye://", "0 addresses, expected 2"),
        ("blueye://1.2.3.4", "1 addresses, expected 2"),
        ("blueye://1.2.3.4,1.2.3.5,1.2.3.6", "3 addresses, expected 2"),
        ("replay://nowhere.mcap", "nowhere.mcap"),
        ("ros2://rov?domain=3", "found the option 'domain', expected expose"),
        ("blueye://1.2.3.4,1.2.3.5?take", "found the option 'take', expected take_control, position"),
        ("blueye://1.2.3.4,1.2.3.5?take_control=yes", "'take_control=yes', expected take_control"),
        ("blueye://1.2.3.4,1.2.3.5?position", "for two drones"),
        ("mavlink://udpin:127.0.0.1:14550?x", "found the option 'x', expected none: mavlink:// has no options"),
        ("twin://?speed=2", "found the option 'speed', expected none"),
    ],
)
def test_a_url_that_cannot_be_used_is_reported_with_what_was_expected(text, found):
    with pytest.raises((ConfigError, LogError)) as error:
        connect(text, load_scenario("lawnmower_calm"), Clock())
    assert found in str(error.value)


def test_a_blueye_link_is_for_blueyes():
    scenario = load_scenario("lawnmower_calm", ["vehicle=bluerov2_heavy"])
    with pytest.raises(ConfigError, match="front_starboard.*expected surge"):
        connect("blueye://1.2.3.4", scenario, Clock())


@pytest.mark.parametrize(
    "text",
    [
        *("dvl://", "dvl://host:port", "dvl://host:99999", "qtm://:22223/rov", "blueye://1.2.3.4", "dvl://host/x"),
        *("ugps://host?topside=1,2", "ugps://host?topside=1,2,nan", "ugps://host?topside", "ugps://host?raw&filtered"),
        *("ugps://host?raw=1", "ugps://host?heading=3", "qtm://host/rov?origin=1,2,x", "qtm://host/rov?heading=1,2"),
        *("dvl://host?rotation=inf", "dvl://host?rotation=1&rotation=2", "dvl://host?topside=1,2,3"),
    ],
)
def test_a_source_that_cannot_be_used(text):
    with pytest.raises(ConfigError, match="expected"):
        source(text, Clock())


def test_hosts_and_ports():
    dvl, _ = parse("dvl://192.168.194.95", "source", "--sensor")
    assert dvl.host_port(16171) == ("192.168.194.95", 16171)
    assert parse("dvl://[::1]:8000", "source", "--sensor")[0].host_port(16171) == ("::1", 8000)
    assert parse("replay://a%20b.mcap", "link", "--link", also=("replay",))[0].rest == "a b.mcap"


def kept(text: str):
    """A source of an address where nobody answers, closed again."""
    with source(text, Clock(50.0)) as found:
        return found


def test_the_description_of_a_topside_unit_holds():
    gps = kept("ugps://127.0.0.1:9?topside=10,-20,90")
    assert gps._topside == pytest.approx((10.0, -20.0, np.pi / 2)) and gps._path.endswith("raw")
    assert gps._period == 0.01, "no more often than it can be asked, however fast time runs"
    assert kept("ugps://127.0.0.1:9?filtered")._path.endswith("filtered")
    assert described("ugps://h?topside=10,-20,90").endswith(
        "topside at north 10 m, east -20 m, its mark towards 90 deg; raw positions"
    )
    assert "north 0 m, east 0 m, its mark towards 0 deg; filtered" in described("ugps://h?filtered")


def test_the_description_of_a_lab_holds():
    """x towards east: y, to its left, is north; up is up."""
    lab = kept("qtm://127.0.0.1:9/rov?heading=90&origin=1,2,-3")._lab
    np.testing.assert_allclose(lab.to_eta(np.array([5.0, 7.0, 1.0]), np.eye(3))[:3], [8.0, 7.0, -4.0], atol=1e-9)
    assert lab.to_eta(np.zeros(3), np.eye(3))[5] == pytest.approx(np.pi / 2)
    assert "north 1 m, east 2 m, down -3 m, its x axis towards 90 deg" in described(
        "qtm://h/r?heading=90&origin=1,2,-3"
    )
    np.testing.assert_allclose(kept("qtm://127.0.0.1:9/rov")._lab.R_nq, np.diag([1.0, -1.0, -1.0]), atol=1e-12)


def test_the_description_of_a_dvl_and_a_drone_holds():
    dvl = kept("dvl://127.0.0.1:9?rotation=90")
    np.testing.assert_allclose(dvl._turn, [[0.0, -1.0], [1.0, 0.0]], atol=1e-12)
    assert "turned 90 deg clockwise" in described("dvl://h?rotation=90")
    assert "control is taken" in described("blueye://a,b?take_control") and "no client" in described("blueye://a,b")
    assert described("twin://") == "twin://"
    with pytest.raises(ConfigError, match="turn"):
        described("dvl://h?turn=3")


def test_take_control_reaches_the_links(monkeypatch):
    opened = []
    monkeypatch.setattr(connecting, "_hosted", lambda opener, scenario, stop_at: opened.append(opener))
    scenario = load_scenario("lawnmower_calm")
    connect("blueye://1.2.3.4,1.2.3.5?take_control", scenario, Clock())
    connect("blueye://1.2.3.4,1.2.3.5", scenario, Clock(), observe=True)
    assert [(o.hosts, o.take_control, o.observe) for o in opened] == [
        (("1.2.3.4", "1.2.3.5"), True, False),
        (("1.2.3.4", "1.2.3.5"), False, True),
    ]


# Listening


def whole(t: float = 0.0) -> list[Measurement]:
    return [
        *(reading("position", 1.0 + i, -2.0, t=t) for i in (-0.5, 0.0, 0.5)),
        *(reading("pressure", 3.0, t=t), reading("attitude", 0.01, -0.02, 1.5, t=t)),
        *(reading("gyro", 0, 0, 0, t=t), reading("accelerometer", 0, 0, -9.8, t=t)),
    ]


@pytest.fixture
def hasty(monkeypatch):
    monkeypatch.setattr(readiness, "SETTLING", 0.0)


def test_the_start_is_where_the_vehicle_is(hasty):
    vehicle = Fake()
    mux = SensorMux(vehicle, [])
    vehicle_says = iter([[], whole(), *[[]] * 10_000])
    vehicle.read = lambda: next(vehicle_says)
    received = listen(mux, ["position", "dvl"], patience=0.4, speed=SPEED, position_noise=0.6)
    np.testing.assert_allclose(received.start.position, [1.0, -2.0, 3.0])
    np.testing.assert_allclose(received.start.position_std, 0.6 / np.sqrt(3.0))  # the mean of three
    assert received.missing == ("dvl",)
    assert {"position", "gyro"} <= received.rates.keys()


def test_the_start_of_a_vehicle_whose_compass_looks_aft_has_its_own_heading(hasty):
    """Over twin:// and replay:// a sensor tells the attitude of its own axes."""
    vehicle, aft = Fake(), np.diag([-1.0, -1.0, 1.0])
    says = iter([[], whole(), *[[]] * 10_000])
    vehicle.read = lambda: next(says)
    started = listen(SensorMux(vehicle, []), ["position"], patience=0.4, speed=SPEED, rotation=aft).start
    expected = rotation_from_euler(np.array([0.01, -0.02, 1.5])) @ aft.T
    np.testing.assert_allclose(rotation_from_quaternion(started.attitude), expected, atol=1e-12)


@pytest.mark.parametrize("silent", ["position", "pressure", "attitude", "gyro", "accelerometer"])
def test_a_sensor_without_readings_is_named(hasty, silent):
    vehicle = Fake()
    says = iter([[], [r for r in whole() if r.sensor != silent], *[[]] * 10_000])
    vehicle.read = lambda: next(says)
    with pytest.raises(LinkTimeout, match=f"expected {silent}"):
        listen(SensorMux(vehicle, []), [], patience=0.2)


def test_what_an_instrument_measures_is_not_taken_from_the_vehicle_too():
    vehicle, gps = Fake(reading("position", 0, 0), reading("pressure", 1.0)), Instrument()
    mux = SensorMux(vehicle, [gps])
    assert [r.sensor for r in mux.read()] == ["position", "pressure"]
    vehicle.to_say, gps.to_say = [reading("position", 0, 0), reading("pressure", 1.0)], [reading("position", 5, 5)]
    assert [(r.sensor, r.value[0]) for r in mux.read()] == [("pressure", 1.0), ("position", 5.0)]
    vehicle.to_say = [reading("position", 0, 0)]
    assert mux.read() == []


def test_the_start_is_not_a_mean_of_two_frames(hasty):
    """The vehicle's own positions, in a frame of its own, until the first of an instrument; then only these."""
    vehicle, gps = Fake(), Instrument()
    says = iter([[], whole(), *[[]] * 10_000])
    fixes = iter([[], [], [], *([reading("position", 30.0, 20.0)] for _ in range(3)), *[[]] * 10_000])
    vehicle.read, gps.read = lambda: next(says), lambda: next(fixes)
    received = listen(SensorMux(vehicle, [gps]), [], speed=SPEED)
    np.testing.assert_allclose(received.start.position[:2], [30.0, 20.0])


def test_times_count_from_the_beginning_of_the_flight():
    mux = SensorMux(Fake(reading("pressure", 1.0, t=12.5)), [])
    mux.zero = 10.0
    assert mux.read()[0].t_valid == pytest.approx(2.5)


# Flights


@pytest.fixture(scope="module")
def scenario():
    # The machine of a test is busy, and time runs fast.
    ignore = "autopilot.supervisor.deadline_missed.action=ignore"
    return load_scenario("lawnmower_calm", ["autopilot=model_based", "duration=20", ignore], 3)


@pytest.fixture(scope="module", autouse=True)
def once():
    """Composed and compiled once: an autopilot that goes on from where it was is good enough for what ends a flight."""
    compose, simulation, autopilot = live.compose, {}, []

    def composed_once(scenario):
        COMPOSED.append(scenario)
        if scenario.name not in simulation:
            simulation[scenario.name] = compose(scenario)
        return simulation[scenario.name]

    def made(*arguments):
        if not autopilot:
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(compiled.logger, "debug", lambda *reported: IN_PIECES.append(reported))
                autopilot.append(HostAutopilot(*arguments))
        return autopilot[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(live, "compose", composed_once)
        patch.setattr(live, "HostAutopilot", made)
        patch.setattr(live, "settle", lambda: None)  # of all that the tests before left: seconds; see test_urgent.py
        yield


@pytest.fixture(scope="module")
def flight(tmp_path_factory, scenario):
    """20 s with the twin behind a link, ten times as fast."""
    clock = Clock(SPEED)
    link = connect("twin://", scenario, clock)
    received = []
    folder = tmp_path_factory.mktemp("live") / "run"

    def arm(ready):
        time.sleep(1.0)  # somebody thinks
        received.append((ready, datetime.now(UTC)))
        return True

    return fly_live(scenario, link, [], clock, folder, arm=arm), received, link


def test_a_flight_over_a_link_is_logged_without_truth(flight):
    flown, received, link = flight
    ((ready, armed),) = received
    assert ready.missing == ()
    log = Log.read(flown.folder / "log.mcap")
    assert not any(name.startswith("truth/") for name in log.channels)
    assert log.metadata["live"] == "true"
    began = datetime.fromisoformat(datum_of(log.metadata).utc_start)
    assert 0.0 < (began - armed).total_seconds() < 60.0, "its zero is the time of day"
    timing = log["host/timing"]
    assert len(timing) == 1001 and timing["thrust_on"].all()
    assert flown.figures["judged_by"] == "the autopilot's own estimate"
    assert flown.figures["nees_position_mean"] is None and flown.figures["late_ms_max"] > 0
    assert flown.figures["reason"].startswith("not finished after 20 s: on its way to way-point 1 of 7, ")
    # It dived, by what its pressure sensor says.
    depth = log["sensor/pressure"]
    assert depth["depth"][0] < 0.6 < 1.5 < depth["depth"][-1]
    assert np.abs(log["autopilot/eta"]["z"][-1] - depth["depth"][-1]) < 0.02
    assert link.read() == [], "the link is closed"


def test_a_tick_is_compiled_in_one_piece(flight):
    """Else it takes two and a half times as long, and XLA prints a warning on every flight."""
    assert IN_PIECES == []


def test_who_does_not_arm_moves_nothing(tmp_path, scenario):
    clock = Clock(SPEED)
    link = connect("twin://", scenario, clock)
    sent = []
    link.send = lambda command: sent.append(command)
    flown = fly_live(scenario, link, [], clock, tmp_path / "run", arm=lambda ready: False)
    assert sent == [] and flown.figures["reason"] == "not armed" and not flown.completed


def test_without_thrust_everything_is_computed_and_nothing_moves(tmp_path, scenario):
    clock = Clock(SPEED)
    link = connect("twin://", scenario, clock)
    sent, armed = [], []
    link.send = lambda command: sent.append(np.array(command.u))
    link.arm = lambda: armed.append(True)
    short = scenario.model_copy(update={"duration": 3.0})
    flown = fly_live(short, link, [], clock, tmp_path / "run", arm=lambda ready: True, thrust=False)
    assert len(sent) == 151 and not np.any(sent) and armed == []
    assert COMPOSED[-1].autopilot.supervisor.thruster_failed.action == "ignore"  # forces that do not come
    assert np.abs(flown.log["autopilot/command"].values).max() > 0.1
    assert not flown.log["host/timing"]["thrust_on"].any() and flown.log.metadata["thrust"] == "false"


def test_a_vehicle_that_is_lost_in_flight_ends_it(tmp_path, scenario):
    clock = Clock(SPEED)
    link = connect("twin://", scenario, clock)
    sent = []

    def send(command):
        sent.append(command)
        if len(sent) > 30:
            link.read = lost

    def lost():
        raise LinkError("the cable is cut")

    link.send = send
    flown = fly_live(scenario, link, [], clock, tmp_path / "run", arm=lambda ready: True)
    assert flown.figures["reason"] == "link lost: the cable is cut" and len(sent) < 40
    assert (tmp_path / "run" / "summary.json").exists()


def test_an_error_in_flight_closes_the_link(tmp_path, scenario):
    vehicle = Fake()
    with pytest.raises(ZeroDivisionError):
        fly_live(scenario, vehicle, [], Clock(), tmp_path / "run", arm=lambda ready: True, say=lambda text: 1 / 0)
    assert vehicle.closed and vehicle.sent == []


def test_a_log_begins_when_the_flight_does(tmp_path, scenario, flight):
    """However long it took to compile and to listen."""
    clock = Clock(SPEED)
    link = connect(f"replay://{flight[0].folder}/log.mcap", scenario, clock)
    time.sleep(0.5)
    flown = fly_live(scenario, link, [], clock, tmp_path / "run", arm=lambda ready: True)
    came, were = flown.log["sensor/pressure"], flight[0].log["sensor/pressure"]
    assert came["depth"][0] == were["depth"][0]
    assert came.t[-1] > 0.95 * were.t[-1], "to its end; a late tick takes no more readings than it has room for"
    assert datum_of(flown.log.metadata).utc_start == datum_of(flight[0].log.metadata).utc_start, "as then"


def test_another_speed_is_for_twins():
    for url in (
        "twin://",
        "replay://x.mcap",
        "blueye://127.0.0.2,127.0.0.3",
        "mavlink://udpout:127.0.0.1:14551",
        "ros2://rov",
    ):
        assert on_this_machine(url)
    for url in (
        "blueye://192.168.1.101",
        "blueye://127.0.0.2,10.0.0.3",
        "mavlink://udpin:0.0.0.0:14550",
        "ros2://rov?expose",
    ):
        assert not on_this_machine(url)


# Recording


def test_a_record_has_every_reading_that_came(tmp_path, scenario, hasty):
    clock, vehicle, gps = Clock(), Fake(), Instrument()
    sent = iter([[], [reading("pressure", 1.0, t=0.1), reading("strange", 1.0)], [reading("pressure", 1.5, t=0.2)]])
    vehicle.read = lambda: next(sent, [])
    gps.to_say = []
    counts = record(scenario, vehicle, [gps], clock, tmp_path / "pool.mcap", 0.2)
    assert counts == {"pressure": 2} and vehicle.sent == []
    log = Log.read(tmp_path / "pool.mcap")
    np.testing.assert_allclose(log["sensor/pressure"]["depth"], [1.0, 1.5])
    began = datetime.fromisoformat(datum_of(log.metadata).utc_start)
    assert abs((datetime.now(UTC) - began).total_seconds()) < 60.0


def test_a_record_has_the_second_sensor_of_a_kind_and_names_once_what_it_leaves_out(tmp_path, hasty):
    vehicle, text = Fake(), []
    names = ["pressure", "pressure_2", "leak_2", "strange", "leak_2", "pressure_2"]
    sent = iter([[], [reading(name, 1.0, t=0.1) for name in names]])
    vehicle.read = lambda: next(sent, [])
    path = tmp_path / "pool.mcap"
    assert record(with_parts(), vehicle, [], Clock(), path, 0.1, warn=text.append) == {"pressure": 1, "pressure_2": 2}
    np.testing.assert_allclose(Log.read(path)["sensor/pressure_2"]["depth"], [1.0, 1.0])
    assert [line.partition(":")[0] for line in text] == ["leak_2", "strange"]


# Time


def test_a_loop_that_is_late_is_counted():
    now = [0.0]
    pace = Pace(sleep=lambda s: now.__setitem__(0, now[0] + s))
    assert pace.wait(1.0, lambda: now[0]) == pytest.approx(0.0, abs=1e-9)
    now[0] = 2.0103
    assert pace.wait(2.0, lambda: now[0]) == pytest.approx(0.0103)
    assert pace.wait(2.0, lambda: now[0], speed=2.0) == pytest.approx(0.00515)
    for _ in range(97):
        pace.wait(now[0], lambda: now[0])
    figures = pace.figures()
    assert figures["late_ms_max"] == pytest.approx(10.3) and figures["late_ms_p50"] == pytest.approx(0.1)
    assert 5.0 < figures["late_ms_p99"] < 5.4
    now[0] = 1e9
    pace.wait(0.0, lambda: now[0])
    assert pace.counts.sum() == 101, "however late, it has its place"
