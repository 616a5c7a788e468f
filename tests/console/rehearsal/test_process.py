"""The process that rehearses, from inside: what goes into its pipe, what takes its place, what it refuses."""

from types import SimpleNamespace

import pytest

from rovtwin.console.rehearsal import process as module
from rovtwin.console.rehearsal.process import Rehearsing, Superseded, charge_of
from rovtwin.console.rehearsal.request import Request
from rovtwin.core.errors import RovtwinError
from rovtwin.runs.loop import SHORT
from rovtwin.scenario.files import load_scenario

ROW = {"x": 3.0, "y": 1.0, "depth": 2.0, "speed": 0.2}


def request(**more):
    return Request(7, (ROW,), (1.0, -2.0, 0.7), 90.0, **more)


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("lawnmower_calm")


class FakePipe:
    """Keeps what is sent; a newer request waits in it after so many."""

    def __init__(self, until=99):
        self.sent, self._until = [], until

    def poll(self):
        return len(self.sent) >= self._until

    def send(self, message):
        self.sent.append(message)

    @property
    def keys(self):
        return [next(iter(news)) for _, news in self.sent]


@pytest.fixture
def quick(monkeypatch):
    """Flights that take no time; `refused`: what the vehicle cannot do."""
    refused = []

    class FakeRehearsal:
        supply = SimpleNamespace(sources=[])
        base = SimpleNamespace(model=None, loop=None, vehicle=SimpleNamespace(name="blue"))

        def __init__(self, scenario, charge):
            self.scenario = scenario

        def nominal(self, progress):
            progress(0.5)

        def drawn(self, progress, short):
            assert short() == SHORT
            progress(0.5)

    monkeypatch.setattr(module, "Rehearsal", FakeRehearsal)
    monkeypatch.setattr(module, "forecast", lambda *flights: {"flights": len(flights) - 1})
    monkeypatch.setattr(module, "judge", lambda *_: refused)
    return refused


FAST = SimpleNamespace(begin=lambda rehearsal: None, short=lambda: SHORT)


def test_the_vehicle_as_it_is_known_comes_first_and_all_has_a_name(quick, scenario):
    pipe = FakePipe()
    Rehearsing(pipe, request()).run(scenario, FAST)
    assert all(number == 7 for number, _ in pipe.sent)
    assert pipe.keys == ["doing", "doing", "doing", "forecast", "doing", "forecast"]
    first, last = (news["forecast"] for _, news in pipe.sent if "forecast" in news)
    assert (first["flights"], first["whole"]) == (1, False) and (last["flights"], last["whole"]) == (2, True)
    assert "no battery" in last["charge_by"] and last["water"].startswith("no current, the twin's")
    assert last["rows"] == [ROW] and last["utc"]


@pytest.mark.parametrize("after", range(1, 4))
def test_a_newer_request_takes_its_place(quick, scenario, after):
    pipe = FakePipe(until=after)
    with pytest.raises(Superseded):
        Rehearsing(pipe, request()).run(scenario, FAST)
    assert len(pipe.sent) <= after + 1


def test_what_the_vehicle_cannot_do_is_not_flown(quick, scenario):
    quick.append(SimpleNamespace(refused=True, line="way-point 1: a current of 2 m/s is more than its top speed"))
    pipe = FakePipe()
    with pytest.raises(RovtwinError, match="more than its top speed"):
        Rehearsing(pipe, request()).run(scenario, FAST)
    assert pipe.keys == ["doing"]


def test_the_charge_is_the_gauges_then_the_scenarios_then_full(scenario):
    half = load_scenario("lawnmower_calm", ["battery={charge: 0.5}"])
    assert charge_of(request(charge=0.3), half) == (0.3, "30 % at the start, by the gauge")
    assert charge_of(request(), half)[0] == 0.5 and "by the scenario" in charge_of(request(), half)[1]
    assert charge_of(request(is_twin=False), half)[0] == charge_of(request(), scenario)[0] == 1.0
