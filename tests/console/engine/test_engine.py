"""The engine's loop with a vehicle that is not there: what fails ends thrust and is said, and the loop goes on."""

import json
import time
from types import SimpleNamespace

import numpy as np
import pytest
from tests.runs.test_feasibility import NO_HEAVE

pytest.importorskip("zmq", reason="the console needs pyzmq: pip install 'rovtwin[console]'")

from rovtwin.cli.flight.console import _require_flyable
from rovtwin.console.engine import engine as module
from rovtwin.console.engine import flights, ticker, vehicle_session
from rovtwin.console.engine.bridge import Bridge
from rovtwin.console.engine.helm import Helm
from rovtwin.console.engine.reporting.state import Changes, plan_message
from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError, LinkError, LogError
from rovtwin.core.flow import Command
from rovtwin.runs.compose.fitting import own_values
from rovtwin.runs.limits import Limits
from rovtwin.runs.pace import Clock
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema import MissionSection, Waypoint
from rovtwin.vehicle import load_vehicle, vehicle_from_dict

RESTING = {"u": [0.0], "phase": "idle", "reason": "", "health": [1.0], "gives_up_heading": False}


class FakeLink:
    def __init__(self, reported):
        self._calls, self.age, self.stopped, self.refused, self.stopped_at = reported, 0.0, False, None, -np.inf
        self.sent = 0

    def begin_arming(self, asked_at):
        self.refused = ""

    def send(self, command):
        self.sent += 1

    def stop(self):
        self._calls.append("stop")

    def tell(self, order):
        pass

    def close(self):
        self._calls.append("close")


class FakeHelm:
    is_idle, can_resume, row, output = True, False, (None, None), None

    def __init__(self):
        self.breaks = None

    def tick(self, *_):
        if self.breaks is not None:
            raise self.breaks
        return Command(np.zeros(3))

    def idle(self):
        pass

    def restart(self, start):
        pass


class FakeWatch:
    def __init__(self):
        self.coming, self.names = [], []

    def news(self):
        return self.coming.pop() if self.coming else ""

    def message(self, armed):
        return {"kind": "watch", "armed": armed}


class FakeBuilder:
    """Has a vehicle ready as often as it is asked to begin."""

    is_making = False

    def __init__(self, expected, speed, say):
        self.clock, self.speed, self.calls = Clock(speed), speed, []
        self._made = self.step = None

    def begin(self):
        link, mux = FakeLink(self.calls), SimpleNamespace(read=list, drain=lambda: None, zero=0.0)
        simulation = SimpleNamespace(sensor_names=["position"], thruster_names=["port"])
        readiness = SimpleNamespace(start=None, missing=())
        self._made = SimpleNamespace(
            link=link, mux=mux, simulation=simulation, readiness=readiness, helm=FakeHelm(), close=link.close
        )
        self._made.watch = FakeWatch()

    def ready(self):
        made, self._made = self._made, None
        return made


class FakePublisher:
    def __init__(self, address):
        self.events, self.states, self.again = [], [], False

    def publish(self, message):
        self.states.append(message)

    def event(self, level, text, t):
        self.events.append((level, text))

    def state_rests(self):
        return 0.0

    def state_due(self):
        return True

    def all_due(self):
        return self.again

    def close(self):
        pass


class FakeFlight:
    def __init__(self, *_):
        self.folder, self.breaks, self.endings = "runs/1", None, []

    def begin(self, now, utc):
        pass

    def add(self, *_):
        if self.breaks is not None:
            raise self.breaks

    def close(self, ending):
        self.endings.append(ending)
        if self.breaks is not None:
            raise self.breaks


@pytest.fixture
def engine(monkeypatch):
    """An engine with a vehicle that is connected, not armed."""
    monkeypatch.setattr(module, "SessionBuilder", FakeBuilder)
    monkeypatch.setattr(module, "Publisher", FakePublisher)
    monkeypatch.setattr(module, "setup_of", lambda *_: {})
    monkeypatch.setattr(ticker, "flown", lambda *_: dict(RESTING))
    monkeypatch.setattr(ticker.Consistency, "take", lambda *_: None)
    monkeypatch.setattr(module, "AGAIN", 0.0)
    monkeypatch.setattr(flights, "FlightLog", FakeFlight)
    scenario = SimpleNamespace(name="calm", control_dt=0.02, waypoints=[], origin=Datum(63.4, 10.4), test=None)
    expected = SimpleNamespace(scenario=scenario, is_twin=True, link="twin://", sensors=(), stop_at=None, held=None)
    made = module.Engine(expected, "ipc://nowhere")
    monkeypatch.setattr(made, "scenario_with", lambda waypoints: scenario)
    made._builder.begin()
    turn(made)
    return made


def turn(engine, seconds=0.025, obey=lambda: None):
    """Let a tick pass by."""
    time.sleep(seconds)
    engine._turn(obey, lambda seconds: None)


def armed(engine):
    engine.arm(time.monotonic())
    for _ in range(100):  # the log is opened beside the loop
        if not engine.switch.armed:
            turn(engine)
    assert engine.switch.armed and engine._logbook.folder == "runs/1"
    return engine


def run(engine, turns):
    """The loop itself, for so many turns."""
    left = [turns]

    def wait(seconds):
        left[0] -= 1
        engine.over = left[0] <= 0
        time.sleep(0.005)

    engine.run(lambda: None, wait)


def events_with(engine, text):
    return [level for level, found in engine._publisher.events if text in found]


def test_a_mistake_of_ours_ends_thrust_and_is_reported_and_the_loop_goes_on(engine):
    armed(engine).session.helm.breaks = TypeError("a mistake of ours")
    link, begin = engine.session.link, engine._builder.begin
    sent = link.sent
    engine._builder.begin = lambda: None  # the loop would make a vehicle anew
    run(engine, 8)
    assert engine._builder.calls[-1] == "close" and link.sent == sent
    assert not engine.switch.armed and events_with(engine, "TypeError: a mistake of ours") == ["danger"]
    last = engine._publisher.states[-1]
    assert last["stage"] == "lost" and "a mistake of ours" in last["alerts"][0]["cause"]
    begin()
    engine.over = False
    turn(engine)
    assert engine._stage == "ready"  # once the operator presses Reconnect


def test_a_vehicle_that_is_lost_as_it_is_taken_over_is_closed(engine):
    engine.reconnect()
    reported, taken = engine._builder.calls, engine._builder._made

    def lost():
        raise LinkError("no word from it")

    taken.mux.drain = lost
    reported.clear()
    begin, engine._builder.begin = engine._builder.begin, lambda: None
    run(engine, 2)
    assert reported == ["close"] and events_with(engine, "link lost: no word from it") == ["danger"]
    engine._builder.begin, engine.over = begin, False


def test_what_has_changed_of_the_vehicle_is_an_event_an_alert_and_a_message(engine):
    watch = armed(engine).session.watch
    watch.coming, watch.names = ["surge drag +14 ± 3 % since the identification"], ["surge drag"]
    turn(engine)
    turn(engine)
    assert events_with(engine, "surge drag +14 ± 3 %") == ["warning"]
    (alert,) = engine._publisher.states[-1]["alerts"]
    assert alert["level"] == "warning" and alert["what"] == "changed: surge drag"
    engine._plan_message = dict
    engine._publisher.again = True
    turn(engine)
    assert engine._publisher.states[-1] == {"kind": "watch", "armed": True}


def test_events_are_reported_with_the_time_of_the_tick(engine):
    times = []
    engine._publisher.event = lambda level, text, t: times.append(t)
    for _ in range(3):
        turn(engine)
        engine.event("info", "now")
    assert times == sorted(times) and times[0] > 0.0
    assert times[-1] == pytest.approx(engine._ticker.ticks * 0.02)
    engine.reconnect()
    engine.event("info", "let go")
    assert times[-1] == times[-2]


def test_a_vehicle_that_is_lost_is_let_go_of_before_its_log_is_closed(engine):
    flight = armed(engine)._logbook._flight
    order = engine._builder.calls
    flight.close = lambda ending: order.append("log")

    def lost():
        raise LinkError("no word from it")

    engine.session.mux.read = lost
    turn(engine)
    assert order[-2:] == ["close", "log"] and engine._stage == "lost"
    assert events_with(engine, "link lost: no word from it") == ["danger"]


@pytest.mark.parametrize("error", [LogError("disk full"), OSError(28, "No space left"), ValueError("a mistake")])
def test_a_log_that_fails_in_flight_ends_no_flight(engine, error):
    flight = armed(engine)._logbook._flight
    flight.breaks = error
    sent = engine.session.link.sent
    turn(engine)
    turn(engine)
    assert engine.switch.armed and engine.session.link.sent >= sent + 2
    assert events_with(engine, "flying on without a log") == ["danger"] and flight.endings == ["the log failed"]
    engine.stop()
    assert not engine.switch.armed and engine.switch.stopped


def test_without_room_for_a_log_nothing_is_armed(engine, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(flights, "FlightLog", full)
    engine.arm(time.monotonic())
    for _ in range(100):
        if engine.switch.arming:
            turn(engine)
    assert not engine.switch.armed and not engine.switch.arming and engine._builder.calls[-1] == "stop"
    assert events_with(engine, "not armed: the flight cannot be logged") == ["danger"]


def test_a_stop_that_went_past_us_is_noticed_while_time_stands_still(engine):
    armed(engine).run_at(None, False)
    engine.session.link.stopped_at = time.monotonic()
    turn(engine)
    assert engine.switch.stopped and not engine.switch.armed and events_with(engine, "STOP") == ["danger"]


def test_arming_comes_to_an_end_while_time_stands_still(engine):
    engine.run_at(None, False)
    engine.arm(time.monotonic())
    for _ in range(100):  # the log is opened beside the loop
        if not engine.switch.armed:
            turn(engine)
    assert engine.switch.armed and engine.session.link.sent == 0


def test_a_vehicle_that_cannot_be_closed_keeps_nobody_from_ending(engine):
    def broken():
        raise OSError("its socket broke")

    flight = armed(engine)._logbook._flight
    engine.session.close = broken
    engine.over = True
    engine.run(lambda: None, lambda seconds: None)
    assert flight.endings == ["ended"]


def test_a_builder_makes_no_second_session_while_one_waits_to_be_taken(monkeypatch):
    """Two would steer one vehicle, and STOP would reach the newer one only."""
    made = []
    monkeypatch.setattr(
        vehicle_session.SessionBuilder, "_session", lambda self: made.append(1) or f"vessel {len(made)}"
    )
    builder = vehicle_session.SessionBuilder(SimpleNamespace(), 1.0, lambda stage, note: None)
    for _ in range(2):
        builder.begin()
        builder._thread.join(2.0)
    assert made == [1] and builder.ready() == "vessel 1" and builder.ready() is None
    builder.begin()
    builder._thread.join(2.0)
    assert builder.ready() == "vessel 2"


def test_sources_are_let_go_of_when_one_of_them_fails(monkeypatch):
    closed, fine = [], SimpleNamespace(close=lambda: closed.append("source"))

    def source(url, clock):
        if url == "bad":
            raise LinkError("port in use")
        return fine

    builder = vehicle_session.SessionBuilder(
        SimpleNamespace(is_twin=False, link="x", sensors=("good", "bad")), 1.0, lambda *_: None
    )
    builder._helm = (None, None, None, None)
    monkeypatch.setattr(builder, "_open", lambda: SimpleNamespace(close=lambda: closed.append("link")))
    monkeypatch.setattr(vehicle_session, "source", source)
    with pytest.raises(LinkError):
        builder._session()
    assert closed == ["link", "source"]


def test_way_points_on_the_map_are_reported_in_metres():
    """A console that took them for (0, 0, 0) would fly there once they are submitted."""
    datum = Datum(63.4, 10.4)
    reported = plan_message([Waypoint(geodetic=[63.401, 10.4, 3.0]), Waypoint(position=[1.0, 2.0, 3.0])], True, datum)
    (north, east, down), metres = (row["position"] for row in reported["waypoints"])
    assert north == pytest.approx(111.5, abs=1.0) and abs(east) < 0.1 and down == pytest.approx(3.0, abs=0.01)
    assert metres == [1.0, 2.0, 3.0] and "geodetic" not in reported["waypoints"][0]


class Plain:
    """An engine that only keeps what it was asked."""

    def __init__(self):
        self.asked, self.session, self.may_arm, self.is_twin = [], None, True, True
        self.switch = SimpleNamespace(armed=False, arming=False)

    def stop(self):
        self.asked.append("stop")

    def arm(self, asked_at):
        self.asked.append(asked_at)

    def note_operator(self):
        raise TypeError("a mistake of ours")


@pytest.fixture
def bridge(tmp_path):
    made = Bridge(Plain(), f"ipc://{tmp_path / 'orders'}")
    yield made
    made.close()


def answer(bridge, do, sent, **what):
    return bridge.answer(json.dumps({"do": do, "sent": sent, "id": 1} | what).encode())


def test_stale_and_undated_orders_are_refused_but_stop(bridge):
    now = time.monotonic()
    for sent in (now - 2.0, now + 60.0, float("nan"), float("inf"), None, "now", [now], 10**400):
        assert "too old" in answer(bridge, "arm", sent)["error"]
        assert answer(bridge, "stop", sent)["ok"]
    assert set(bridge._engine.asked) == {"stop"}
    assert answer(bridge, "arm", now)["ok"] and bridge._engine.asked[-1] == now


def test_a_mistake_of_ours_in_an_order_is_answered(bridge):
    assert "TypeError" in answer(bridge, "alive", time.monotonic())["error"]


def test_a_message_that_is_nested_too_deep_is_not_understood(bridge):
    for text in (b"[" * 100_000, b'{"do":' * 5000, b"\xff", b"null", b"{}"):
        assert "not understood" in bridge.answer(text)["error"]


class Moored(Helm):
    """Of a vehicle that is connected, at a place `at` once it is armed; it flies nothing."""

    is_running, output = False, None  # type: ignore[assignment]

    def __init__(self, model, at):
        self._has_terrain, self._model = False, model
        if at is not None:
            self.output = SimpleNamespace(estimate=SimpleNamespace(position=np.array(at)))


def moored(bridge, scenario, twin, at=None, model=None):
    """Gives the bridge an engine with such a vehicle; what it is asked to fly is appended to the list."""
    model, taken = model or load_vehicle("double_blueye").model(), []
    simulation = SimpleNamespace(model=model, loop=SimpleNamespace(twin=SimpleNamespace(model=model)))
    bridge._engine = SimpleNamespace(
        session=SimpleNamespace(helm=Moored(model, at), simulation=simulation),
        is_twin=twin,
        switch=SimpleNamespace(armed=at is not None),
        scenario_with=lambda w: scenario.model_copy(update={"mission": MissionSection(waypoints=w)}),
        submit=taken.append,
        fly=lambda helm, mission, plan: taken.append(plan[0]),
        event=lambda *_: None,
    )
    return taken


TOO_FAST = "a current of 2 m/s to the east is more than its top speed"


def test_a_mission_that_the_vehicle_cannot_fly_is_refused_in_a_twin(bridge):
    scenario = load_scenario("square", ["world.current=[0, 2, 0]"])
    way = [{"position": w.position, "speed": w.speed, "acceptance": w.acceptance} for w in scenario.waypoints]
    taken = moored(bridge, scenario, twin=True)
    found = answer(bridge, "submit", time.monotonic(), waypoints=way)
    assert TOO_FAST in found["error"] and taken == []
    checks = answer(bridge, "check", time.monotonic(), waypoints=way)["checks"]
    assert checks[0]["level"] == "error" and TOO_FAST in checks[0]["what"]
    taken = moored(bridge, scenario, twin=False)  # a real vehicle's water is not the scenario's
    assert answer(bridge, "submit", time.monotonic(), waypoints=way)["ok"] and len(taken) == 1


def test_where_it_can_go_is_judged_from_where_it_is(bridge):
    """Without thrust in heave it can go to a place as deep as it is, and to no other."""
    scenario, flat = load_scenario("square"), vehicle_from_dict(NO_HEAVE, "flat").model()
    assert abs(scenario.start.position[2] - 7.0) > 1.0
    taken = moored(bridge, scenario, twin=True, at=(5.0, 6.0, 7.0), model=flat)
    assert answer(bridge, "goto", time.monotonic(), x=5.0, y=9.0, speed=0.2)["ok"] and len(taken) == 1
    found = answer(bridge, "goto", time.monotonic(), x=5.0, y=9.0, depth=2.0, speed=0.2)
    assert "no thrust in heave" in found["error"] and len(taken) == 1


@pytest.mark.parametrize("name", ["double_blueye", "minerva", "gladius_mini"])
def test_it_goes_to_a_place_at_the_vehicles_own_speed_and_as_near_as_fits_it(bridge, name):
    model = load_vehicle(name).model()
    taken = moored(bridge, load_scenario("square"), twin=True, at=(5.0, 6.0, 3.0), model=model)
    own = own_values(Limits.of(model))
    assert answer(bridge, "goto", time.monotonic(), x=5.0, y=9.0)["ok"]
    assert answer(bridge, "goto", time.monotonic(), x=5.0, y=9.0, speed=0.05)["ok"]
    assert [(w.speed, w.acceptance) for w in taken] == [(own["speed"], own["acceptance"]), (0.05, own["acceptance"])]


def test_the_console_does_not_begin_with_a_mission_that_cannot_be_flown():
    scenario = load_scenario("square", ["world.current=[0, 2, 0]"])
    with pytest.raises(ConfigError, match=TOO_FAST):
        _require_flyable(scenario, "twin://")
    _require_flyable(scenario, "blueye://192.168.1.101,192.168.1.102")


def test_what_is_made_ready_is_reported_step_by_step(monkeypatch, tmp_path):
    """First starts stood at one word for minutes: each step is shown with its number and how long it takes so far."""
    notes, steps = [], []

    def say(stage, note):
        notes.append((stage, note))
        if builder.step is not None:
            steps.append(builder.step.message())

    def compiled():
        builder._go_on(2)
        time.sleep(0.02)
        builder._go_on(3)
        raise LinkError("no such vehicle")

    builder = vehicle_session.SessionBuilder(SimpleNamespace(is_twin=True, sensors=(), link="twin://"), 1.0, say)
    monkeypatch.setattr(builder, "_open", lambda: SimpleNamespace(close=lambda: None))
    monkeypatch.setattr(builder, "_compiled", compiled)
    builder._make()
    assert [(one["step"], one["of"], one["what"]) for one in steps[:3]] == [
        (i + 1, 5, what) for i, what in enumerate(vehicle_session.STEPS[:3])
    ]
    assert steps[2]["whole"] >= 0.02 > steps[2]["seconds"]
    assert notes[1] == ("connecting", "compiling the autopilot (2 of 5)") and notes[-1] == ("lost", "no such vehicle")
    assert builder.step is None


def test_what_the_operator_asked_for_is_no_alarm():
    changes = Changes()
    assert changes.of("aborted", "operator") == ("warning", "aborted: operator")
    assert changes.of("aborted", "leak") == ("danger", "aborted: leak")
