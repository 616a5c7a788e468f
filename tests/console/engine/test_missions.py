"""What was flown is what a log tells, and what replay, report and map show: also where it changed in flight."""

import json
import shutil
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("zmq", reason="the console needs pyzmq: pip install 'rovtwin[console]'")

from rovtwin.console.engine.flights import FlightLog
from rovtwin.console.replays.marks import marks_of
from rovtwin.console.replays.replay import Recording
from rovtwin.core.flow import FINISHED, GO, PAUSED
from rovtwin.core.log import Log, repair
from rovtwin.core.log.maps import map_of
from rovtwin.core.log.missions import missions_of
from rovtwin.report.flight import Flight
from rovtwin.report.run.tables import mission_table
from rovtwin.runs.compose.composition import compose
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema import MissionSection, Waypoint

ARMED = 100.0  # by the helm's clock [s]
SQUARE = [(0, 0), (4, 0), (4, 4)]
HOME = [(1, 1)]


@pytest.fixture(scope="module")
def simulation():
    """Of a scenario whose own plan, seven way-points, is never flown here."""
    return compose(load_scenario("lawnmower_calm", ["autopilot=model_based"]))


def with_plan(simulation, places):
    points = [Waypoint(position=[float(x), float(y), 2.0], speed=0.2, acceptance=0.2) for x, y in places]
    return simulation.scenario.model_copy(update={"mission": MissionSection(waypoints=points)})


@pytest.fixture
def flight(simulation, tmp_path):
    """Armed before anything was planned; no thrust, no sensors."""
    made = FlightLog(simulation.scenario, simulation, SimpleNamespace(), tmp_path / "runs" / "one")
    made.begin(ARMED, "2026-11-26T06:00:00Z")
    return made


def fly(flight, start, end, phase):
    """Ten samples a second of a vehicle that stands at (2, 2), in one phase, at its first way-point."""
    t = np.arange(start, end - 1e-9, 0.1)
    eta, mode = np.tile([2.0, 2, 2, 0, 0, 0], (len(t), 1)), np.tile([phase, 0, 0, 1.0], (len(t), 1))
    flight._log.write_many("autopilot/eta", t, eta)
    flight._log.write_many("autopilot/mode", t, mode)


def flown_square_then_home(flight, simulation):
    """Three seconds armed, a square from then on, home from 6 s, until 9 s."""
    fly(flight, 0.0, 3.0, PAUSED)
    flight.flown(with_plan(simulation, SQUARE), ARMED + 3.0)
    fly(flight, 3.0, 6.0, GO)
    flight.flown(with_plan(simulation, HOME), ARMED + 6.0)
    fly(flight, 6.0, 9.0, FINISHED)


def places(points):
    return [tuple(point["position"][:2]) for point in points]


def test_what_was_started_is_what_replay_report_and_map_show(flight, simulation):
    flown_square_then_home(flight, simulation)
    flight.close("disarmed")
    recording = Recording.open(flight.folder)
    assert [recording.state(t)["count"] for t in (1.0, 4.0, 7.0)] == [0, 3, 1]
    shown = [[(p["x"], p["y"]) for p in recording.plan(recording.mission_at(t))["flown"]] for t in (1.0, 4.0, 7.0)]
    assert shown == [[], SQUARE, HOME]
    started = [(m["t"], m["text"]) for m in marks_of(recording) if m["mark"] == "mission"]
    assert started == [(3.0, "mission started: 3 way-points"), (6.0, "mission started: 1 way-point")]
    assert not [m for m in marks_of(recording) if m["mark"] == "waypoint"]
    assert [point.name for point in map_of(recording.log).waypoints] == ["1.1", "1.2", "1.3", "2.1"]
    report = Flight(recording.log)
    assert [(w["name"], w["x"], w["y"]) for w in report.waypoints] == [
        *(("1.1", 0, 0), ("1.2", 4, 0), ("1.3", 4, 4)), ("2.1", 1, 1)
    ]  # fmt: skip
    assert [row[-3] for row in mission_table(report).rows] == ["3.0", "3.0", "3.0", "6.0"]
    assert places(json.loads(recording.log.metadata["mission"])) == HOME  # for programs that know one mission only
    assert len(load_scenario(str(flight.folder / "scenario.yaml"), (), None).waypoints) == 1


def test_one_mission_is_numbered_as_before(flight, simulation):
    fly(flight, 0.0, 1.0, GO)
    flight.flown(with_plan(simulation, SQUARE), ARMED + 1.0)
    fly(flight, 1.0, 2.0, GO)
    flight.close("disarmed")
    log = Log.read(flight.folder / "log.mcap")
    assert [point.name for point in map_of(log).waypoints] == ["1", "2", "3"]
    assert "Flown from [s]" not in mission_table(Flight(log)).head


def test_a_plan_that_was_never_started_was_not_flown(flight):
    fly(flight, 0.0, 1.0, PAUSED)
    flight.close("disarmed")
    recording = Recording.open(flight.folder)
    assert recording.missions == [] and recording.plan(recording.mission_at(0.5))["flown"] == []
    assert Flight(recording.log).waypoints == [] and map_of(recording.log).waypoints == []


def test_a_killed_engine_leaves_what_it_flew(flight, simulation, tmp_path):
    flown_square_then_home(flight, simulation)
    flight._log.flush()
    shutil.copy(flight.folder / "log.mcap", tmp_path / "killed.mcap")
    flight.close("")
    repair(tmp_path / "killed.mcap", tmp_path / "whole.mcap")
    missions = missions_of(Log.read(tmp_path / "whole.mcap").metadata)
    assert [(one.t, places(one.waypoints)) for one in missions] == [(3.0, SQUARE), (6.0, HOME)]


def test_a_mission_that_is_started_writes_itself_only(flight, simulation, monkeypatch):
    written = []
    monkeypatch.setattr(flight._log, "annotate", written.append)
    for k in range(3):
        flight.flown(with_plan(simulation, SQUARE if k < 2 else HOME), ARMED + k)
    assert len({key for one in written for key in one if key != "mission"}) == 3
    assert len(str(written[1])) == len(str(written[0])) > len(str(written[2]))
    flight._log.close()


def test_missions_of_earlier_logs_are_one_list():
    point = {"position": [1.0, 2.0, 3.0]}
    listed = json.dumps([{"t": 3.0, "waypoints": [point]}, {"t": 6.0, "waypoints": []}])
    assert [one.t for one in missions_of({"mission": "[]", "missions": listed})] == [3.0, 6.0]
    damaged = {"missions": "[]", "missions.0": "{", "missions.1": '{"t": 1, "waypoints": []}'}
    assert [one.t for one in missions_of(damaged)] == [1.0]
