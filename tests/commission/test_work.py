"""What a stage works with: the line that steers has the socket of STOP, one that only looks does not take it."""

from contextlib import contextmanager

from tests.commission.people import Scripted
from tests.commission.waterside import Yes

from rovtwin.commission import work as working
from rovtwin.commission.dossier import Dossier
from rovtwin.commission.request import Request
from rovtwin.commission.run import commission
from rovtwin.commission.stage import Outcome, Stage
from rovtwin.commission.work import Work


def test_the_line_that_steers_is_stopped_past_the_stage(tmp_path, monkeypatch):
    given = []

    @contextmanager
    def connect(url, scenario, clock, observe=False, stop_at=None):
        given.append((observe, stop_at))
        yield None

    monkeypatch.setattr(working, "connect", connect)
    request, stop = Request("double_blueye", "twin://"), tmp_path / "stop"

    def run(work):
        with work.connected(None) as there, work.connected(None, observe=True, beside=there):
            return Outcome()

    stages = [Stage("one", "One", "a purpose", "next", True, run)]
    commission(request, tmp_path / "c", stages, Yes(), stop_at=stop)
    assert given == [(False, stop), (True, None)]
    given.clear()
    run(Work(Dossier.open(tmp_path / "c"), tmp_path, Yes()))
    assert given == [(False, None), (True, None)], "in a terminal Ctrl-C does it"


def test_it_is_known_whether_thrusters_may_turn(tmp_path):
    entered = []

    def run(work):
        assert work.may_move("May it fly?")
        work.at_rest()
        work.person.no = ("again",)
        assert not work.may_move("May it fly again?")
        return Outcome()

    request, stages = Request("double_blueye", "twin://"), [Stage("one", "One", "a purpose", "next", True, run)]
    commission(request, tmp_path / "c", stages, Scripted(), enter=entered.append)
    assert entered == ["asking", "turning", "resting", "asking", "resting"]
