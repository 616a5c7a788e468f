"""The monitor of the console's flights: in the log, in the summary, as events, and why it is not there."""

import time
from itertools import groupby
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("zmq", reason="the console needs pyzmq: pip install 'rovtwin[console]'")

from tests.console.known import identified
from tests.identification.synthetic import record, steps_command
from tests.monitoring.test_flight import DT, ticks_of

from rovtwin.console.engine.flights import FlightLog
from rovtwin.console.engine.reporting.watching import IN_A_TEST, VehicleWatch
from rovtwin.core.flow import AutopilotOutput, Command, Estimate, Progress, Reference, Setpoint, Slot, Wrench
from rovtwin.core.log import Log
from rovtwin.core.numerics import jnp
from rovtwin.live import beside
from rovtwin.monitoring.factors import Factors, changed
from rovtwin.monitoring.flight import Found
from rovtwin.runs.compose.composition import compose
from rovtwin.scenario.files import load_scenario

pytestmark = pytest.mark.system

SECONDS, ZERO = 65.0, 7.0  # of the flight; an engine's clock when it is armed


class Scripted:
    """A helm whose ticks are those of a log: readings on an engine's clock, and the commands that were given."""

    def __init__(self, given, simulation):
        _, self._slots, self._command = ticks_of(given, 0.0, given.duration)
        self._sensors, self.row = len(simulation.sensor_names), (-1, -1)

    def tick(self):
        self.row = (self.row[0] + 1,) * 2

    def unpacked(self, taken, given):
        rows = np.array(taken)
        slots = {n: Slot(s.value[rows], s.valid[rows], s.t_valid[rows] + ZERO) for n, s in self._slots.items()}

        def zeros(*shape):
            return np.zeros((len(rows), *shape))

        estimate = Estimate(
            zeros(3), zeros(4), zeros(6), zeros(6), zeros(12, 12), zeros(self._sensors), zeros(self._sensors), zeros(6)
        )
        progress = Progress(*(zeros() for _ in range(3)), zeros(2))
        setpoint = Setpoint(zeros(3), zeros(4), zeros(6), *(zeros(3),) * 2, *(zeros(),) * 4, zeros(), progress)
        moved = Reference(zeros(3), zeros(4), *(zeros(3),) * 4), Wrench(zeros(6), zeros(6))
        command = self._command[rows]
        return slots, AutopilotOutput(Command(command), estimate, setpoint, *moved, np.ones_like(command))


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """A scenario of a vehicle that was identified, composed."""
    path = identified(tmp_path_factory.mktemp("known") / "known.yaml")
    scenario = load_scenario("square", [f"vehicle={path}"])
    return scenario, compose(scenario)


@pytest.fixture(scope="module")
def flown(known, tmp_path_factory):
    """A flight with a port thruster of 50 % and 4 N of weight more: the watch, its events, its summary, its log."""
    scenario, simulation = known
    model, vehicle = simulation.vehicle.model(), simulation.vehicle
    factors = Factors.of(model, vehicle.thruster_names, 1.0)
    theta = np.zeros(len(factors.each))
    theta[factors.names.index("force.port.surge")] = np.log(0.5)
    theta[factors.names.index("restoring.net_buoyancy")] = -4.0
    t, u = steps_command(vehicle, 3, SECONDS, hold=5.0)
    given = record(changed(model, jnp.asarray(theta)), t, 0.5 * u, SECONDS, 3)
    watch, helm = VehicleWatch(simulation, scenario), Scripted(given, simulation)
    folder = tmp_path_factory.mktemp("flown")
    log = FlightLog(scenario, simulation, helm, folder / "run", watch)
    log.begin(ZERO, "2026-05-01T12:00:00.250Z")
    news = []
    for k in range(round(SECONDS / DT)):
        helm.tick()
        log.add(0.0, 0.0)
        while (monitor := log._monitor)._busy is not None and not monitor._busy.done():
            time.sleep(1e-3)  # here a second takes no second
        if text := watch.news():
            news.append((k * DT, text))
    return watch, news, log.close("disarmed"), Log.read(folder / "run" / "log.mcap")


def test_what_has_changed_is_an_event_once_and_in_the_log_and_its_summary(flown):
    watch, news, summary, log = flown
    text = "; ".join(text for _, text in news)
    assert text.count("force of port.surge against others") == 1 and "since the identification" in text
    assert "look at port.surge: a propeller" in text and "heavier in the water" in text
    assert any(line.startswith("force of port.surge against others") for line in summary["changed"])
    value, std = log["monitor/value"], log["monitor/std"]
    assert len(value.t) == pytest.approx(60, abs=2) and "monitor" not in summary
    assert np.exp(value["thruster_port_surge"][-1]) == pytest.approx(0.5, abs=0.1)
    assert std["thruster_port_surge"][-1] < 0.1


def test_the_page_is_given_what_is_learnt_and_what_has_changed(flown):
    watch, *_ = flown
    message = watch.message(armed=False)
    rows = {row["name"]: row for row in message["rows"]}
    assert rows["thruster.port.surge"]["changed"] and rows["thruster.port.surge"]["interval"][2] < -10.0
    assert not rows["thruster.starboard.surge"]["changed"] and rows["top_speed.surge"]["learnt"]
    assert message["note"].startswith("The last flight") and "identification of" in message["against"]
    assert rows["thruster.starboard.surge"]["mirrors"] == "port.surge" and not rows["thruster.port.heave"]["mirrors"]
    titles = [title for title, _ in groupby(row["group"] for row in message["rows"])]
    assert len(titles) == len(set(titles)) and titles[0].startswith("Top speed")
    assert watch.names == ["force of port.surge against others", "net buoyancy"]


def test_the_next_flight_begins_with_nothing(flown):
    watch, *_ = flown
    kept, before = watch._monitor, watch.message(armed=False)
    assert watch.begin() is not kept and watch.names == [] and watch.news() == ""
    assert before["rows"] and watch.message(armed=True)["rows"] == []


def test_a_mistake_in_it_ends_no_flight_and_no_log(known, monkeypatch):
    scenario, simulation = known
    watch = VehicleWatch(simulation, scenario)
    watch.begin().found = Found([], [], [], 20.0)
    monkeypatch.setattr(watch, "_rows_of", lambda found: 1 / 0)
    assert watch.news() == "" and watch.news() == "" and watch.names == []
    assert watch.message(armed=True)["note"] == "Not watched: ZeroDivisionError: division by zero."


def test_what_is_not_watched_says_why(known, tmp_path):
    scenario, simulation = known
    test = VehicleWatch(simulation, scenario.model_copy(update={"test": "any"}))
    assert test.begin() is None and test.message(armed=True)["note"] == f"Not watched: {IN_A_TEST}."
    blind = SimpleNamespace(loop=SimpleNamespace(twin=SimpleNamespace(sensors={})), vehicle=simulation.vehicle)
    watch = VehicleWatch(blind, scenario)
    message = watch.message(armed=True)
    assert not message["watched"] and message["note"] == "Not watched: no attitude or no gyro on board."
    log = FlightLog(scenario, simulation, None, tmp_path / "run", watch)
    assert log.close("disarmed")["monitor"] == "did not run: no attitude or no gyro on board"
    assert "monitor/value" not in Log.read(tmp_path / "run" / "log.mcap")


def test_a_watch_that_was_given_up_is_no_flight_without_changes():
    """The page said "Not watched" and the summary listed what the monitor went on to find."""
    assert beside.changed(None) == {}
    assert beside.changed(None, "no gyro") == {"changed": [], "monitor": "did not run: no gyro"}
    running = SimpleNamespace(trouble="", found=SimpleNamespace(changes=[], doubts=["a sign is wrong"]))
    assert beside.changed(running, "ValueError: x") == {"changed": [], "monitor": "stopped: ValueError: x"}
    assert beside.changed(running) == {"changed": [], "monitor": "in doubt: a sign is wrong"}
