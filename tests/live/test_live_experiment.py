"""Tests flown over a link: what the operator sees, what is logged, what identification makes of it."""

import json

import numpy as np
import pytest

from rovtwin.core.errors import IdentificationError, LinkError, LinkTimeout
from rovtwin.core.flow import HOLD, Measurement, Slot
from rovtwin.core.link import Link
from rovtwin.core.log import Log
from rovtwin.core.numerics import jax
from rovtwin.core.user_files.config import parse
from rovtwin.core.user_files.jsontext import to_json
from rovtwin.identification.logs.readers import read_records
from rovtwin.live import flight as live
from rovtwin.live import readiness
from rovtwin.live.flight import ROOM, fly_live
from rovtwin.live.manoeuvres import REACTION, Prompter, cues_of, plan, touched_spans
from rovtwin.live.readiness import SensorMux, listen
from rovtwin.live.serving.vehicle import served_of
from rovtwin.report.flight import Flight as Seen
from rovtwin.report.run.catalogue import drawable
from rovtwin.report.run.tables import manoeuvre_table
from rovtwin.report.run.verdict import verdict
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.compose.experiment import needs_position, spans_of
from rovtwin.runs.pace import Clock
from rovtwin.runs.realtime import HostAutopilot
from rovtwin.runs.recording.recorder import NOT_IN_TESTS
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import load_vehicle

pytestmark = pytest.mark.system

SPEED = 30.0
ALL = {"position": [1.0, 2.0], "pressure": [3.0], "attitude": [0.0, 0.0, 0.5]} | dict.fromkeys(
    ("gyro", "accelerometer"), [0.0, 0.0, 0.0]
)
MANOEUVRES = [
    {"manoeuvre": "steps", "axis": "surge", "levels": [0.6], "duration": 2, "home": 3},
    {"manoeuvre": "release", "attitude_deg": [30, -10], "by_hand": 4, "duration": 4},
    {"manoeuvre": "doublets", "axis": "yaw", "level": 0.5, "half": 1.0},
]


def short(manoeuvres=MANOEUVRES, **more):
    data = {
        "name": "short",
        "duration": 30,
        "start": {"position": [1, 2, 3], "heading_deg": 30},
        "sensors": {"position": {"noise": 0.03, "rate_hz": 15}},
        "autopilot": {"supervisor": {"deadline_missed": {"action": "ignore"}}},  # the machine of a test is busy
        "rates": {"physics": 100},
        "test": {"manoeuvres": manoeuvres},
    }
    return parse(Scenario, data | more, "short.yaml")


class Still(Link):
    """A vehicle that does not move: it says the same again each period, and keeps what it is given."""

    def __init__(self, clock, without=""):
        self._values = {name: np.array(value) for name, value in ALL.items() if name != without}
        self._clock, self._next = clock, 0.0
        self.sent, self.armed, self.stopped = [], False, False

    def read(self):
        now = self._clock()
        if now < self._next:
            return []
        self._next = now + 0.02
        return [Measurement(name, value, now) for name, value in self._values.items()]

    def send(self, command):
        self.sent.append(np.array(command.u))

    def arm(self):
        self.armed = True

    @property
    def age(self):
        return 0.0

    def stop(self):
        self.stopped = True

    def close(self):
        self.stop()


@pytest.fixture(scope="module")
def scenario():
    return short()


@pytest.fixture(scope="module")
def parts(scenario):
    """Its autopilot, compiled, and its memory at the start."""
    run = compose(scenario)
    slots = {name: Slot.empty(ROOM, slot.value.shape[1]) for name, slot in run.loop.twin.empty().items()}
    memory = run.loop.autopilot.init(jax.random.key(0), run.start)
    return HostAutopilot(run.loop.autopilot, memory, slots, scenario.control_dt), memory


@pytest.fixture(scope="module", autouse=True)
def once(parts):
    """Compiled once: every flight begins anew with it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(live, "HostAutopilot", lambda *arguments: parts[0])
        patch.setattr(readiness, "SETTLING", 0.0)
        yield


@pytest.fixture(scope="module")
def flight(scenario, tmp_path_factory):
    """The test with a vehicle behind a link, and what was reported."""
    clock, reported = Clock(SPEED), []
    vehicle, folder = Still(clock), tmp_path_factory.mktemp("live") / "run"
    flown = fly_live(scenario, vehicle, [], clock, folder, arm=lambda ready: True, tell=reported.append)
    assert vehicle.armed and vehicle.stopped
    return flown, reported


def test_a_test_over_a_link_is_done_and_says_so_as_a_simulated_one(flight):
    flown, _ = flight
    assert flown.completed and flown.figures["test"] and flown.figures["duration_s"] == pytest.approx(15.0)
    assert flown.figures["effort_n2s"] is None and flown.figures["cross_track_rms_m"] is None
    assert "judged_by" not in flown.figures, "there is nothing to judge"
    seen = Seen(flown.log)
    assert verdict(seen).headline == "Test done in 15 s"
    assert {"pose", "velocity", "timing"} <= {entry.name for entry in drawable(seen)}
    assert manoeuvre_table(seen).rows[2][1] == "hand (tilted by hand)"


def test_what_does_not_exist_in_a_test_is_not_logged(flight):
    log = flight[0].log
    unknown = {"score/cross_track", "score/nees", *NOT_IN_TESTS}
    assert not unknown & set(log.channels) and not any(name.startswith("truth/") for name in log.channels)
    assert np.allclose(np.diff(log["autopilot/command"].t), 0.02)
    assert {"host/timing", "autopilot/mode", "sensor/position", "sensor/gyro"} <= set(log.channels)


def test_identification_reads_it_and_leaves_out_the_hand_and_its_reaction(flight):
    records = read_records(flight[0].folder / "log.mcap", load_vehicle("double_blueye"))
    assert [record.duration for record in records] == pytest.approx([5.0, 6.0 - REACTION], abs=0.5)
    surge = records[0].command_at(np.array([1.0]))[0]
    assert sorted(np.round(surge[[0, 3]], 1)) == [0.6, 0.6]
    assert not records[1].command_at(np.array([records[1].start + 1.0])).any(), "thrusters are off in a release"


def test_nobody_tilts_a_twin_that_is_served(scenario):
    """Its time is not that of the test."""
    assert compose(scenario).loop.twin.hand is not None and served_of(scenario)[0].twin.hand is None


def test_the_operator_gets_prompts_of_what_comes_and_when_to_let_go(flight, scenario):
    reports = [(cue.t, cue.text, cue.hand) for cue in flight[1]]
    tilt = "30 deg with the starboard side down and 10 deg with the bow down"
    assert reports == [
        (0.0, "steps surge +0.6, 2 s", False),
        (0.0, f"soon by hand: {tilt}. Wait for the word", True),
        (2.0, "home, 3 s", False),
        (5.0, f"TILT IT, thrusters are off: {tilt}. Hold it still", True),
        (6.0, "3", True),
        (7.0, "2", True),
        (8.0, "1", True),
        (9.0, "LET GO, hands away: release at 30, -10 deg, 4 s", True),
        (13.0, "doublets yaw, 2 s", False),
    ]
    lines = [(0.0, "steps surge +0.6"), (2.0, "home"), (5.0, f"BY HAND: {tilt}")]
    assert plan(scenario) == [*lines, (9.0, "release at 30, -10 deg"), (13.0, "doublets yaw")]


def test_cues_come_in_time_once_and_say_what_goes_on(scenario):
    prompter = Prompter(scenario)
    assert len(prompter.at(0.0)) == 2 and prompter.now == "steps surge +0.6"
    assert prompter.at(1.98) == [] and [cue.t for cue in prompter.at(5.0 - 1e-12)] == [2.0, 5.0]
    assert prompter.now == "hand" and len(prompter.at(100.0)) == 5 and prompter.at(100.0) == []


def test_a_mission_tells_nothing():
    mission = load_scenario("square")
    assert cues_of(mission) == [] and plan(mission) == [] and Prompter(mission).at(100.0) == []


def test_a_test_that_begins_tilted_says_so_before_arming():
    release = {"manoeuvre": "release", "attitude_deg": [-20, 0], "by_hand": 0, "duration": 4}
    tilted = short([release, MANOEUVRES[0]], start={"position": [0, 0, 3], "attitude_deg": [-20, 0]})
    assert (
        plan(tilted)[0][1]
        == "BY HAND, before you arm: 20 deg with the port side down. Hold it until you are asked to let go"
    )
    assert cues_of(tilted)[0].text.startswith("LET GO")
    hand, release = touched_spans(tilted)[:2]
    assert (hand["start"], hand["end"], hand["hand"]) == (0.0, REACTION, True)
    assert (release["start"], release["end"], release["hand"]) == (REACTION, 4.0, False)


def test_only_hands_change_the_spans(scenario, flight):
    planned, touched = spans_of(scenario), touched_spans(scenario)
    assert json.loads(flight[0].log.metadata["test"]) == json.loads(to_json(touched))
    assert touched[2]["end"] == touched[3]["start"] == planned[2]["end"] + REACTION
    assert [touched[i] for i in (0, 1, 4)] == [planned[i] for i in (0, 1, 4)]


# What ends it, and what it needs


def test_a_link_lost_in_mid_test_stops_the_thrusters_and_keeps_the_log(tmp_path, scenario):
    clock = Clock(SPEED)
    vehicle = Still(clock)
    read = vehicle.read

    def lost():
        if len(vehicle.sent) == 80:
            raise LinkError("the cable is cut")
        return read()

    vehicle.read = lost
    flown = fly_live(scenario, vehicle, [], clock, tmp_path / "run", arm=lambda ready: True)
    assert flown.figures["reason"] == "link lost: the cable is cut" and not flown.completed
    assert np.abs(vehicle.sent[-1]).max() > 0.5, "in the middle of the pull"
    assert vehicle.stopped and len(Log.read(tmp_path / "run" / "log.mcap")["autopilot/command"]) == 80
    (record,) = read_records(tmp_path / "run" / "log.mcap", load_vehicle("double_blueye"))
    assert record.duration == pytest.approx(1.6, abs=0.5)


def test_without_thrust_all_is_computed_and_no_identification_takes_it(tmp_path, scenario):
    clock, run = Clock(SPEED), tmp_path / "run"
    vehicle = Still(clock)
    flown = fly_live(scenario, vehicle, [], clock, run, arm=lambda ready: True, thrust=False)
    assert flown.completed and not vehicle.armed and len(vehicle.sent) == 751 and not np.any(vehicle.sent)
    assert np.abs(flown.log["autopilot/command"].values).max() >= 0.6
    with pytest.raises(IdentificationError, match="--no-thrust.*never sent"):
        read_records(run / "log.mcap", load_vehicle("double_blueye"))


def listened_to(scenario, without="", patience=2.0):
    """What is received of a vehicle without one of its sensors."""
    clock = Clock(SPEED)
    needed = live.needed_by(scenario)
    return listen(SensorMux(Still(clock, without), []), ["position"], patience=patience, speed=SPEED, needed=needed)


@pytest.mark.parametrize(
    ("manoeuvre", "needs"),
    [
        ({"manoeuvre": "steps", "axis": "yaw", "levels": [0.5], "home": 3}, True),
        ({"manoeuvre": "steps", "axis": "yaw", "levels": [0.5], "between": 3}, True),
        ({"manoeuvre": "multisine", "axes": {"surge": {"frequencies_hz": [0.2], "amplitudes": [0.4]}}}, True),
        ({"manoeuvre": "multisine", "axes": {"heave": {"frequencies_hz": [0.2], "amplitudes": [0.4]}}}, False),
        ({"manoeuvre": "steps", "axis": "surge", "levels": [0.5], "settle": 3}, False),
        ({"manoeuvre": "release", "attitude_deg": [30, 0]}, False),
    ],
)
def test_only_a_test_that_comes_home_needs_positions(manoeuvre, needs):
    expected = short([manoeuvre])
    assert needs_position(expected) == needs
    assert needs_position(short([manoeuvre], operator=[{"at": 1.0, "ask": "pause"}])), "it holds its place then"
    np.testing.assert_allclose(listened_to(expected).start.position, [1.0, 2.0, 3.0])
    if needs:
        with pytest.raises(LinkTimeout, match="expected position too.*--sensor ugps.*without home, between, and keep"):
            listened_to(expected, without="position", patience=0.2)
    else:
        found = listened_to(expected, without="position")
        np.testing.assert_allclose(found.start.position, [0.0, 0.0, 3.0])
        assert found.missing == ("position",)


@pytest.mark.parametrize("silent", ["pressure", "attitude", "gyro"])
def test_a_test_needs_what_it_reads(scenario, silent):
    with pytest.raises(LinkTimeout, match=f"expected {silent}"):
        listened_to(scenario, without=silent, patience=0.2)


def test_without_positions_no_thruster_looks_for_home(parts):
    """On the way home positions cease for 5 s: the vehicle does not follow what it last accepted of its speed."""
    autopilot, memory = parts
    autopilot.restart(memory)

    def tick(*position):
        readings = [Measurement(name, np.array(ALL[name]), 0.0) for name in ("pressure", "attitude", "gyro")]
        readings += [Measurement("position", np.array(position), 0.0)] if position else []
        return autopilot.step(readings)

    def eta():
        return autopilot.unpacked([autopilot.taken], [autopilot.given])[1].estimate.position[0]

    for k in range(110):
        tick(1.0 + 0.01 * k, 2.0)  # with 0.5 m/s off to the north, until the way home has begun
    assert autopilot.phase == HOLD and np.abs(tick(2.1, 2.0).u).max() > 0.1
    for _ in range(140):
        assert np.isfinite(tick().u).all()
    assert eta()[0] > 3.0, "for a while the last speed is the best guess"
    for _ in range(15):
        command = tick()
    gone = eta()[:2]
    tick()
    assert np.allclose(eta()[:2], gone), "then it is none"
    np.testing.assert_allclose(command.u[[0, 1, 3, 4]], 0.0, atol=0.12)  # the heading alone
    tick(5.0, 6.0)
    np.testing.assert_allclose(eta()[:2], [5.0, 6.0])
