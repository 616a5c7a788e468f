"""Tests flown from the console: what their operator sees, when thrusters may run, what is logged and read again."""

import itertools
import json

import numpy as np
import pytest

pytest.importorskip("zmq", reason="the console needs pyzmq: pip install 'rovtwin[console]'")

from rovtwin.console.engine.experiment_helm import ExperimentHelm
from rovtwin.console.engine.flights import FlightLog
from rovtwin.console.engine.manoeuvres import Manoeuvres
from rovtwin.console.engine.world import WorldLink
from rovtwin.core.datum import datum_of
from rovtwin.core.flow import PHASES, REASONS, Measurement
from rovtwin.core.log import Log
from rovtwin.identification.logs.readers import read_records
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.pace import Clock
from rovtwin.scenario.files import load_scenario

ZERO = 7.0  # an engine's clock when the test begins [s]


@pytest.fixture(scope="module")
def scenario():
    """A pull, then a hand that tilts and a release: four seconds."""
    return load_scenario(
        "test_mixed",
        (
            "test.manoeuvres=[{manoeuvre: steps, axis: surge, levels: [0.5], duration: 1, settle: 0.5},"
            "{manoeuvre: release, attitude_deg: [30, 0], by_hand: 1, duration: 1.5}]",
        ),
        None,
    )


@pytest.fixture(scope="module")
def simulation(scenario):
    return compose(scenario)


@pytest.fixture(scope="module")
def helm(simulation, scenario):
    return ExperimentHelm(simulation, scenario)


class Standing(Clock):
    """A clock that is set by hand."""

    now = 0.0

    def __call__(self):
        return self.now


def test_operator_gets_manoeuvre_remaining_time_and_what_to_do(scenario):
    test = Manoeuvres(scenario)
    assert test.report()["cue"] == "Arm, then Start" and not test.report()["running"]
    laid_out = test.laid_out()
    assert [row["what"] for row in laid_out["manoeuvres"]] == ["steps surge", "release at 30, 0 deg"]
    assert laid_out["manoeuvres"][1]["start"] == 1.5 and laid_out["duration"] == 4.0
    test.begin()
    seen = {}
    for k in range(200):
        texts = [cue.text for cue in test.tick()]
        seen[round(0.02 * k, 2)] = texts, test.report()
    assert seen[0.0][1]["what"] == "steps surge +0.5"
    assert seen[1.2][1]["what"] == "settle" and seen[1.2][1]["manoeuvre"] == 0
    assert seen[1.2][1]["remaining"] == pytest.approx(0.3, abs=0.03)
    assert seen[1.5][0][0].startswith("TILT IT") and seen[1.5][1]["hand"]
    assert seen[2.5][0] == ["LET GO, hands away: release at 30, 0 deg, 1.5 s"]
    assert seen[3.9][1]["cue"].startswith("LET GO") and seen[3.9][1]["manoeuvre"] == 1
    test.end("finished")
    assert test.report()["cue"] == "finished: thrusters are off" and not test.report()["hand"]


def test_hand_is_counted_down():
    longer = load_scenario("test_mixed", ("test.manoeuvres=[{manoeuvre: release, attitude_deg: [30, 0]}]",), None)
    test = Manoeuvres(longer)
    test.begin()
    cues = []
    for _ in range(round(8.5 / longer.control_dt)):
        test.tick()
        cues.append(test.report()["cue"])
    assert [cue[:10] for cue in dict.fromkeys(cues)] == [
        "TILT IT, t",
        "let go in ",
        "let go in ",
        "let go in ",
        "LET GO, ha",
    ]


@pytest.mark.system
def test_experiment_helm_rests_until_started_and_after_an_abort_begins_anew(helm, simulation):
    quiet = (0.0, 0.0, 0.0)
    helm.restart(simulation.start)
    for _ in range(5):
        assert not np.any(helm.tick((), quiet).u)
    helm.start()
    pulls = [helm.tick((), quiet).u for _ in range(10)]
    assert helm.is_running and np.abs(pulls).max(axis=1).min() > 0.3
    helm.abort()
    assert not np.any(helm.tick((), quiet).u) and helm.is_over and not helm.is_running
    helm.start()
    assert np.abs(helm.tick((), quiet).u).max() > 0.3
    helm.idle()
    assert not np.any(helm.tick((), quiet).u) and helm.is_idle


def test_what_ended_first_is_how_a_test_ended(helm, simulation, scenario):
    """Minutes after a test the computer may be busy: it is no longer the test's."""

    sizes, now = {"position": 2, "pressure": 1, "attitude": 3, "gyro": 3}, itertools.count()

    def ticks(count, late=0.0):
        for _ in range(count):
            t = next(now) * scenario.control_dt
            helm.tick([Measurement(name, np.zeros(n), t) for name, n in sizes.items()], (0.0, 0.0, late))
        return PHASES[int(helm.output.setpoint.phase)], REASONS[int(helm.output.setpoint.reason)]

    helm.restart(simulation.start)
    helm.start()
    assert ticks(202) == ("finished", "")
    assert ticks(150, late=100.0) == ("finished", "") and helm.is_over
    helm.start()
    ticks(10)
    assert ticks(100, late=100.0) == ("aborted", "deadline missed")
    assert ticks(300) == ("aborted", "deadline missed"), "the time of the test went on"
    helm.idle()


@pytest.mark.system
def test_flown_test_is_logged_on_its_own_clock_and_cut_where_a_hand_held(helm, simulation, scenario, tmp_path):
    """A whole test against the twin's link: the simulated hand tilts when the test says so, whenever that is."""
    clock, dt = Standing(1.0), scenario.control_dt
    world = WorldLink(simulation, dt, clock)
    helm.restart(simulation.start)
    before = round(ZERO / dt)
    world._tick = before  # as if the engine had listened for a while
    world.tell(("test", ZERO))
    log = FlightLog(scenario, simulation, helm, tmp_path / "run")
    log.begin(ZERO, "2026-05-01T12:00:00.250Z")
    helm.start()
    tilted = []
    for k in range(before, before + 202):
        clock.now = k * dt
        readings = [r for r in world.read() if r.sensor != "truth"]
        world.send(helm.tick(readings, (0.0, 0.0, 0.0)))
        tilted.append(np.degrees(world._truth[3]))
        log.add(0.0, 0.0)
    assert helm.is_over
    summary = log.close("finished")
    assert summary["completed"] and summary["test"]
    tilted = np.array(tilted)
    assert np.abs(tilted[:74]).max() < 5.0 and tilted[120:126].mean() == pytest.approx(30.0, abs=8.0)
    reported = Log.read(tmp_path / "run" / "log.mcap")
    assert json.loads(reported.metadata["test"])[2]["hand"] and reported.metadata["live"] == "true"
    assert datum_of(reported.metadata).utc_start == "2026-05-01T12:00:00.250000Z"
    assert abs(reported["sensor/gyro"]["t_valid"][-1] - reported["sensor/gyro"].t[-1]) < 0.1
    pull, release = read_records(tmp_path / "run" / "log.mcap", simulation.vehicle)
    assert pull.duration == pytest.approx(1.5, abs=0.05)
    assert release.duration == pytest.approx(1.0, abs=0.05)  # half a second less: hands are slow
