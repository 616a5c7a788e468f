"""Fail-safes flown: what happens in the water when it is called, and that only the operator ends it."""

import functools

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import PHASES
from rovtwin.runs.fly import fly
from rovtwin.scenario.files import load_scenario

pytestmark = pytest.mark.system

NEVER = 9e3  # [s]
# One set of faults and requests for all: other times compile to the same program.
FAULTS = ("leak", "link_lost", "operator_silent", "deadline_missed")
AT = 15.0


def flight(*changes, faults=None, requests=None, duration=60):
    """One flown with these changes; faults by name and requests in order, each with its time [s]."""
    faults, requests = faults or {}, requests or []
    spans = {name: at if isinstance(at, tuple) else (at, NEVER + 1) for name, at in faults.items()}
    never = (NEVER, NEVER + 1)
    times = [{"fault": k, "at": spans.get(k, never)[0], "until": spans.get(k, never)[1]} for k in FAULTS]
    silent = {"sensor": "position", "fault": "silent", "at": faults.get("position", NEVER)}
    dead = [{"thruster": f"port.{name}", "fault": "dead", "at": faults.get(name, NEVER)} for name in ("surge", "heave")]
    asked = [*requests, *[{"at": NEVER, "ask": "pause"}] * (3 - len(requests))]
    settings = {"faults": [*times, silent, *dead], "operator": asked, "battery": {"charge": 1.0}, "duration": duration}
    settings |= {"world.floor": 4.0, "world.surface": True, "log.rate": 10}
    settings |= {f"sensors.{name}.on_board": True for name in ("battery", "altimeter")}
    texts = [f"{key}={value}".replace("True", "true") for key, value in settings.items()]
    return fly(load_scenario("lawnmower_calm", ["autopilot=model_based", *texts, *changes]))


def phases(run):
    """Names of the phases in order."""
    numbers = run.log["autopilot/mode"]["phase"].astype(int)
    return [PHASES[numbers[0]], *(PHASES[k] for k in numbers[1:][np.diff(numbers) != 0])]


def depth(run):
    return run.log["truth/eta"]["z"]


@functools.cache
def leaking():
    return flight(faults={"leak": AT})


@pytest.mark.slow
def test_a_leak_brings_it_up():
    run = leaking()
    assert phases(run)[-2:] == ["surfacing", "surfaced"] and depth(run)[-1] < 0.8
    assert run.figures["reason"] == "leak" and not run.completed
    first = run.figures["decisions"][0]
    assert first["what"] == "surfacing" and first["cause"] == "leak" and AT < first["t"] < AT + 1.5


@pytest.mark.slow
def test_an_action_can_be_chosen():
    run = flight("autopilot.supervisor.leak=stop", faults={"leak": AT})
    assert phases(run)[-1] == "aborted" and run.figures["reason"] == "leak"
    assert np.all(run.log["autopilot/command"].values[-1] == 0.0)


@pytest.mark.slow
def test_a_battery_that_runs_low_sends_it_home():
    run = flight("battery.charge=0.18", "autopilot.supervisor.battery_low.after=30", duration=90)
    assert phases(run)[-2:] == ["returning", "returned"] and run.figures["reason"] == "battery low"
    assert np.hypot(*run.log["truth/eta"].values[-1, :2]) < 1.2


@pytest.mark.slow
def test_one_that_is_nearly_empty_brings_it_up():
    run = flight("battery.charge=0.08")
    assert phases(run)[-1] == "surfaced" and run.figures["reason"] == "battery critical"


CAUSES = {
    "link_lost": ("surfacing", "link lost", 5.0),
    "deadline_missed": ("surfacing", "deadline missed", 1.0),
    "position": ("surfacing", "positions lost", 10.0),
    "operator_silent": ("held", "operator silent", 10.0),
}
QUICK = ("link_lost", "position")


@pytest.mark.parametrize(
    "fault", [*QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in CAUSES if name not in QUICK)]
)
def test_what_is_lost_is_noticed_in_time(fault):
    phase, reason, after = CAUSES[fault]
    limits = ("autopilot.supervisor.operator_silent=10", "autopilot.supervisor.positions_lost=10")
    run = flight(*limits, faults={fault: AT}, duration=35)
    first = next(one for one in run.figures["decisions"] if "is known to" not in one["what"])
    assert (first["what"], first["cause"]) == (phase, reason)
    assert AT + after - 1.1 < first["t"] < AT + after + 1.5  # a position comes once a second


def test_nothing_but_the_operator_goes_on():
    """Held when silent, still held when the operator is back, on again after arm and resume."""
    requests = [{"at": 33.0, "ask": "resume"}, {"at": 36.0, "ask": "arm"}, {"at": 40.0, "ask": "resume"}]
    limit = "autopilot.supervisor.operator_silent=5"
    run = flight(limit, faults={"operator_silent": (AT, 28.0)}, requests=requests, duration=50)
    texts = [(one["what"], one["cause"]) for one in run.figures["decisions"]]
    assert texts == [("held", "operator silent"), ("paused", "operator"), ("goes on (go)", "operator")]
    assert [round(one["t"]) for one in run.figures["decisions"]] == [20, 36, 40]


def test_a_pilot_moves_the_set_point():
    sticks = [{"at": 0.0, "ask": "pilot"}, {"at": 0.5, "ask": "pilot", "velocity": [0.2, 0, 0], "turn_rate_deg": 6}]
    run = flight(requests=sticks, duration=4)
    assert phases(run) == ["piloted"]
    psi = run.log["autopilot/setpoint"]["psi"][-20:]
    assert np.allclose(np.diff(psi) * 10.0, np.radians(6.0), atol=1e-6)  # logged at 10 Hz
    gone = flight(faults={"operator_silent": 2.0}, requests=sticks, duration=4).log["autopilot/setpoint"]
    late = gone.t > 2.7  # the command of a silent pilot lives for half a second
    assert np.ptp(gone["psi"][late]) < 1e-9 and np.ptp(gone["psi"][~late]) > 0.1


@pytest.mark.slow
def test_a_fence_turns_it_back():
    run = flight("autopilot.supervisor.geofence=3", duration=70)
    away = np.hypot(*run.log["truth/eta"].values[:, :2].T)
    assert run.figures["reason"] == "geofence" and phases(run)[-1] == "returned"
    assert away.max() < 4.5 and away[-1] < 1.2


@pytest.mark.slow
def test_a_polygon_turns_it_back():
    run = flight("autopilot.supervisor.geofence.polygon=[[-2, -2], [4, -2], [4, 2], [-2, 2]]", duration=70)
    assert run.figures["reason"] == "geofence" and run.log["truth/eta"]["x"].max() < 5.0


@pytest.mark.slow
def test_it_stops_where_the_floor_is_near():
    run = flight("autopilot.supervisor.altitude_limit=1.5", duration=40)  # the floor is at 4 m, the mission at 3 m
    assert phases(run)[-1] == "held" and run.figures["reason"] == "altitude limit"
    assert depth(run).max() < 3.0


@pytest.mark.slow
def test_the_time_runs_out():
    run = flight("autopilot.supervisor.time_out=20", duration=60)
    assert run.figures["reason"] == "time out" and run.figures["decisions"][0]["t"] == pytest.approx(20.0, abs=0.2)


def test_a_surge_thruster_that_is_lost_is_named_and_ends_the_mission_at_the_surface():
    run = flight(faults={"surge": 30.0}, duration=70)
    texts = [one["what"] for one in run.figures["decisions"]]
    assert "port_surge no longer used" in texts and phases(run)[-1] == "surfaced"
    assert run.figures["reason"] == "thruster failed" and run.figures["decisions"][0]["t"] < 40.0


def test_a_heave_thruster_that_is_lost_changes_nothing_but_the_allocation():
    run = flight("world.net_buoyancy=4.0", faults={"heave": 10.0}, duration=45)
    assert [one["what"] for one in run.figures["decisions"]] == ["port_heave no longer used"]
    health, command = run.log["autopilot/health"]["port_heave"], run.log["autopilot/command"]["port_heave"]
    assert health[-1] == 0.0 and np.all(command[health == 0.0][1:] == 0.0)
    assert abs(depth(run)[-1] - 3.0) < 0.05 and phases(run)[-1] == "go"


def test_an_altitude_limit_needs_an_altimeter():
    with pytest.raises(ConfigError, match="altitude_limit: no altimeter is on board"):
        fly(load_scenario("lawnmower_calm", ["autopilot.supervisor.altitude_limit=1"]))


BAD = {
    "autopilot.supervisor.leak=sink": "leak: found 'sink'",
    "autopilot.supervisor.leek=hold": "leek",
    "autopilot.supervisor.battery_low=1.5": "battery_low",
    "autopilot.supervisor.depth_limit=-3": "depth_limit",
    "autopilot.supervisor.attitude_limit_deg=160": "attitude_limit_deg",
    "autopilot.supervisor.geofence.polygon=[[0,0],[1,1]]": "polygon",
    "autopilot.supervisor.leak.limit=1": "leak",
    "operator=[{at: 3, ask: dance}]": "ask",
    "faults=[{fault: link_lost, sensor: position}]": "link_lost",
}


def test_beyond_ninety_degrees_the_thesis_takes_no_attitude_limit():
    limit = "autopilot.supervisor.attitude_limit_deg=120"
    assert load_scenario("lawnmower_calm", [limit]).autopilot.supervisor.attitude_limit_deg.limit == 120.0
    with pytest.raises(ConfigError, match="found 120, expected at most 85.*autopilot=model_based"):
        load_scenario("lawnmower_calm", ["autopilot=thesis", limit])


@pytest.mark.parametrize("change", list(BAD))
def test_bad_settings_are_named(change):
    with pytest.raises(ConfigError, match=BAD[change]):
        load_scenario("lawnmower_calm", [change])
