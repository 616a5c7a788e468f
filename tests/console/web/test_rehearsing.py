"""The rehearsal as the web server sees it: what is asked for, what pages are given, what is kept of a flight."""

import json

import pytest
from tests.console.loops import ran

pytest.importorskip("zmq", reason="the console needs pyzmq: pip install 'rovtwin[console]'")
pytest.importorskip("nicegui", reason="the console needs NiceGUI: pip install 'rovtwin[console]'")

from tests.console.web.test_swath_layer import AtOnce, FakeClient

from rovtwin.console.rehearsal.flight import FILE
from rovtwin.console.web import hub as hubs
from rovtwin.console.web import rehearsing as module
from rovtwin.console.web.rehearsing import Rehearsing
from rovtwin.console.wire import Place
from rovtwin.core.errors import ConfigError, LogError
from rovtwin.scenario.files import load_scenario


class FakeProcess:
    """Takes requests; `gone`: it has ended."""

    def __init__(self, scenario=None):
        self.asked, self.gone = [], False

    def ask(self, request):
        if self.gone:
            raise BrokenPipeError
        self.asked.append(request)

    def close(self):
        pass


def predicted(whole=True, **more):
    remark = {"level": "warning", "what": "way-point 1: a thruster has 3 % of its force left", "points": [0]}
    return {"whole": whole, "remarks": [remark], "inside": {}, "bands": None, "places": [[0, 0, 0], [3, 0, 1]]} | more


@pytest.fixture
def desk(tmp_path, monkeypatch):
    monkeypatch.setattr(hubs, "Client", FakeClient)
    desk = hubs.Hub(Place(tmp_path), load_scenario("lawnmower_calm"))
    desk.worker = AtOnce()
    desk.client.last["state"] = {"kind": "state", "eta": [1.0, 2.0, 0.5, 0.0, 0.0, 0.3], "phase": "idle", "folder": ""}
    desk.draft.add({"x": 3.0, "y": 0.0, "depth": 1.0})
    return desk


@pytest.fixture
def process(monkeypatch):
    one = FakeProcess()
    monkeypatch.setattr(module, "RehearsalProcess", lambda scenario: one)
    return one


@pytest.fixture
def rehearsing(desk, process):
    return Rehearsing(desk, load_scenario("lawnmower_calm"), True)


def newest(desk, kind):
    """A message as who comes late is given it."""
    page = desk.come("late")
    texts = [json.loads(text) for text in page._texts]
    desk.leave(page)
    return next((one for one in texts if one["kind"] == kind), None)


def ask(rehearsing, **what):
    return ran(rehearsing.order({"op": "now"} | what))


def answered(rehearsing, **news):
    rehearsing.take(rehearsing._number, news)


def test_the_plan_is_flown_from_where_the_vehicle_is(desk, rehearsing, process):
    ask(rehearsing)
    (request,) = process.asked
    assert request.place == (1.0, 2.0, 0.5) and request.heading_deg == pytest.approx(17.19, abs=0.01)
    assert [row["x"] for row in request.rows] == [3.0] and request.floor is None and request.charge is None
    assert newest(desk, "rehearsing")["busy"]


def test_what_comes_first_is_shown_first_and_what_goes_on_has_a_name(desk, rehearsing):
    ask(rehearsing)
    answered(rehearsing, doing="flying 39 drawn vehicles", share=0.25)
    rehearsing._tell(at_once=True)
    message = newest(desk, "rehearsing")
    assert (message["doing"], message["share"], message["busy"]) == ("flying 39 drawn vehicles", 0.25, True)
    answered(rehearsing, forecast=predicted(whole=False))
    assert newest(desk, "rehearsal")["whole"] is False and newest(desk, "rehearsing")["busy"]
    answered(rehearsing, forecast=predicted())
    late = newest(desk, "rehearsal")
    assert late["whole"] and "inside" not in late and not newest(desk, "rehearsing")["busy"]


def test_remarks_are_checks_of_their_rows_until_the_plan_changes(desk, rehearsing):
    ask(rehearsing)
    answered(rehearsing, forecast=predicted())
    (check,) = desk.plan()["checks"]
    assert check["points"] == [0] and check["what"].startswith("rehearsal: way-point 1")
    desk.draft.edit(0, {"depth": 1.5})
    assert desk.plan()["checks"] == []


def test_an_answer_of_an_older_request_does_not_count(desk, rehearsing):
    ask(rehearsing)
    old = rehearsing._number
    desk.draft.edit(0, {"depth": 2.0})
    ask(rehearsing)
    rehearsing.take(old, {"forecast": predicted()})
    assert newest(desk, "rehearsal") is None and newest(desk, "rehearsing")["busy"]


def test_a_change_of_plan_current_or_fence_makes_it_stale_and_due_again(desk, rehearsing, process, monkeypatch):
    monkeypatch.setattr(module.time, "monotonic", lambda: clock[0])
    clock = [0.0]
    ask(rehearsing)
    answered(rehearsing, forecast=predicted())
    for change in (
        lambda: desk.draft.edit(0, {"speed": 0.3}),
        lambda: desk.client.last["state"].update(added_current=[0.1, 0.0]),
        lambda: ran(rehearsing.order({"op": "water", "speed": 0.2, "toward": 0.0})),
        lambda: desk.client.last.update(
            setup={"kind": "setup", "fence_drawn": True, "fence": {"polygon": [[0, 0], [9, 0], [9, 9]]}}
        ),
    ):
        many = len(process.asked)
        change()
        clock[0] += 2.0
        ran(rehearsing.turn())
        assert newest(desk, "rehearsing")["stale"] and len(process.asked) == many
        clock[0] += 2.0
        ran(rehearsing.turn())
        assert len(process.asked) == many + 1
        assert newest(desk, "rehearsing")["stale"], "until the new one is there, the page has the old one"
        answered(rehearsing, forecast=predicted())
        assert not newest(desk, "rehearsing")["stale"]
    assert process.asked[-1].water.current == pytest.approx((0.2, 0.0)) and process.asked[-1].added == (0.1, 0.0)
    assert process.asked[-2].fence is None and process.asked[-1].fence == ((0.0, 0.0), (9.0, 0.0), (9.0, 9.0))


def test_it_is_not_repeated_where_that_is_switched_off(desk, rehearsing, process, monkeypatch):
    monkeypatch.setattr(module.time, "monotonic", lambda: clock[0])
    clock = [0.0]
    ask(rehearsing)
    ran(rehearsing.order({"op": "again", "on": False}))
    desk.draft.edit(0, {"speed": 0.3})
    for _ in range(3):
        clock[0] += 5.0
        ran(rehearsing.turn())
    assert len(process.asked) == 1 and not newest(desk, "rehearsing")["again"]


def without_plan(desk):
    desk.draft.clear()


def without_position(desk):
    del desk.client.last["state"]["eta"]


def refused(desk):
    desk.drafting.refusals = [{"level": "error", "what": "way-point 1: outside the tank"}]


@pytest.mark.parametrize(
    ("spoil", "why"),
    [(without_plan, "the plan is empty"), (without_position, "no position"), (refused, "refuse the plan: way-point 1")],
)
def test_what_cannot_be_rehearsed_is_refused_in_words(desk, rehearsing, process, spoil, why):
    spoil(desk)
    with pytest.raises(ConfigError, match=why):
        ask(rehearsing)
    assert process.asked == []


@pytest.mark.parametrize("what", [{"op": "fly"}, {"op": "again", "on": 1}, {"op": "water", "speed": 0.2}])
def test_an_order_that_is_none_is_refused(rehearsing, what):
    with pytest.raises(ConfigError):
        ran(rehearsing.order(what))


def test_a_process_that_died_is_reported_and_another_takes_its_place(desk, rehearsing, process, monkeypatch):
    process.gone = True
    ask(rehearsing)
    message = newest(desk, "rehearsing")
    assert not message["busy"] and "was killed" in message["why"] and "Rehearse again" in message["why"]
    other = FakeProcess()
    monkeypatch.setattr(module, "RehearsalProcess", lambda scenario: other)
    ask(rehearsing)
    assert len(other.asked) == 1 and newest(desk, "rehearsing")["why"] == ""


def test_why_it_failed_is_shown(desk, rehearsing):
    ask(rehearsing)
    answered(rehearsing, error="the leg to way-point 1: against a current of 2 m/s it makes no way")
    message = newest(desk, "rehearsing")
    assert "makes no way" in message["why"] and not message["busy"]


@pytest.fixture
def flight(desk, rehearsing, tmp_path, monkeypatch):
    """A mission that was rehearsed and started; `go(**state)` is the next state."""
    looks = []

    def flown_beside(folder, forecast, scenario, over):
        looks.append(over)
        return {"verdict": "inside", "looks": len(looks)}

    monkeypatch.setattr(module, "flown_beside", flown_beside)
    monkeypatch.setattr(module, "WRITTEN", 0.0)
    ask(rehearsing)
    answered(rehearsing, forecast=predicted())
    folder = tmp_path / "run"
    folder.mkdir()

    def go(**state):
        desk.client.last["state"].update(state)
        ran(rehearsing.look_at_flight())
        return looks

    go(folder=str(folder))
    desk.started()
    return folder, go


def test_what_was_predicted_lies_in_the_folder_before_the_flight_is_over(flight):
    folder, go = flight
    assert go(phase="go") == []
    kept = json.loads((folder / FILE).read_text())
    assert kept["format"] == 1 and "flown" not in kept["rehearsals"][0]


def test_the_flight_is_compared_at_its_end_and_when_its_log_is_closed(desk, flight):
    folder, go = flight
    go(phase="go")
    assert go(phase="finished") == [False] and go(phase="hold") == [False]
    assert newest(desk, "rehearsal")["flown"]["verdict"] == "inside"
    assert go(folder="") == [False, True]
    assert json.loads((folder / FILE).read_text())["rehearsals"][0]["flown"]["looks"] == 2
    assert go(phase="idle") == [False, True]


def test_a_flight_is_not_compared_before_the_log_on_the_disk_has_its_end(flight, monkeypatch):
    """The end came too late into the log: a mission that was flown to its end counted as not completed."""
    _, go = flight
    monkeypatch.setattr(module, "WRITTEN", 1e6)
    go(phase="go")
    assert go(phase="finished") == []
    monkeypatch.setattr(module, "WRITTEN", 0.0)
    assert go(phase="hold") == [False]


def test_the_end_of_the_mission_before_is_not_that_of_this_one(flight):
    _, go = flight
    assert go(phase="finished") == []


def test_a_plan_that_was_not_rehearsed_is_not_compared(desk, rehearsing, tmp_path):
    desk.started()
    desk.client.last["state"].update(folder=str(tmp_path), phase="go")
    ran(rehearsing.look_at_flight())
    assert not (tmp_path / FILE).exists()


def test_a_log_that_cannot_be_read_is_an_event(desk, rehearsing, flight, monkeypatch):
    _, go = flight
    page = desk.come("b1")
    desk.worker.refuses = LogError("log.mcap: damaged")
    go(phase="go")
    go(phase="finished")
    events = [json.loads(text)["text"] for text in page._texts if json.loads(text)["kind"] == "event"]
    assert events == ["predicted against flown: log.mcap: damaged"]


@pytest.mark.parametrize("looked", [True, False], ids=["a look between", "none"])
def test_the_next_flight_has_a_folder_of_its_own_however_soon_it_begins(desk, flight, looked):
    folder, go = flight
    go(phase="go")
    assert go(phase="finished") == [False]
    after = folder.parent / "next"
    after.mkdir()
    desk.client.last["state"].update(folder=str(after), phase="idle")
    if looked:
        assert go() == [False, True]
    desk.started()
    go(phase="go")
    assert json.loads((folder / FILE).read_text())["rehearsals"][0]["flown"]["looks"] == (2 if looked else 1)
    go(phase="finished")
    assert (after / FILE).exists()
    assert json.loads((folder / FILE).read_text())["rehearsals"][0]["flown"]["looks"] == (2 if looked else 1)


def test_a_mistake_of_ours_in_a_comparison_is_an_event_too(desk, rehearsing, flight):
    _, go = flight
    page = desk.come("b1")
    desk.worker.refuses = KeyError("autopilot/eta")
    go(phase="go")
    go(phase="finished")
    events = [json.loads(text)["text"] for text in page._texts if json.loads(text)["kind"] == "event"]
    assert events == ["predicted against flown: 'autopilot/eta'"]
