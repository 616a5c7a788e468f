"""What becomes of a vehicle whose line was cut: it is stopped over a new one, whatever went wrong on the way."""

from types import SimpleNamespace

import numpy as np
import pytest

from rovtwin.commission.drill import stage as drill
from rovtwin.commission.drill.again import Again
from rovtwin.commission.drill.exercises import STOP, Push
from rovtwin.commission.drill.off_time import OffTime
from rovtwin.core.errors import LinkError

PUSH = Push("yaw", np.array([0.5, -0.5]))
SPANS = ((0.0, 2.0, "at rest"), (2.0, 3.2, "pushing"), (3.2, 9.2, "cut"))


class Bench:
    """Stands for the flight and for what stops the vehicle."""

    def __init__(self, monkeypatch, ended="", spans=SPANS, cut=True, fails=None, halting=""):
        self.halts, self._cut, self._fails = 0, cut, fails
        self._pulsed = SimpleNamespace(ended=ended, spans=spans, log=None)
        self._halting = halting
        monkeypatch.setattr(drill, "flown", self.flown)
        monkeypatch.setattr(drill, "halted", self.halted)

    def flown(self, work, scenario, exercise, push, model, cut_at=None):
        if cut_at is not None and self._cut:
            cut_at.append(0.0)
        if self._fails:
            raise LinkError(self._fails)
        return self._pulsed

    def halted(self, work, scenario):
        self.halts += 1
        return self._halting

    def cut(self, blind=False):
        vehicle = SimpleNamespace(model=lambda: None)
        return drill._cut(SimpleNamespace(), SimpleNamespace(), vehicle, PUSH, blind)


def test_without_a_yes_nothing_is_cut_and_nothing_is_armed_again(monkeypatch):
    bench = Bench(monkeypatch, ended="it was not confirmed", spans=(), cut=False)
    (check,), row = bench.cut()
    assert bench.halts == 0 and check.verdict == "stop" and "not confirmed" in check.text and not row


@pytest.mark.parametrize(
    "case", [{"ended": "it tilted by 50 deg"}, {"ended": "interrupted"}, {"fails": "the watching line is gone"}]
)
def test_what_ends_early_after_the_cut_is_stopped_over_a_new_line(monkeypatch, case):
    bench = Bench(monkeypatch, **case)
    checks, _ = bench.cut()
    assert bench.halts == 1 and checks[0].verdict == "stop"


def test_what_cannot_be_stopped_is_to_be_switched_off(monkeypatch):
    bench = Bench(monkeypatch, halting="nobody answers")
    (check,), _ = bench.cut()
    assert bench.halts == 1 and check.verdict == "stop" and "SWITCH THE VEHICLE OFF NOW" in check.fix


def test_it_is_stopped_before_anything_is_computed(monkeypatch):
    bench = Bench(monkeypatch)

    def felt(*_):
        assert bench.halts == 1
        return OffTime(1.6, 1.5, 1.7, False)

    monkeypatch.setattr(drill, "_felt", felt)
    checks, row = bench.cut()
    assert [check.verdict for check in checks] == ["ok", "ok"] and row["seconds"] == 1.6


@pytest.mark.parametrize(
    ("after", "felt", "verdict"), [(0.05, True, "ok"), (0.19, True, "stop"), (0.0, False, "warning")]
)
def test_a_line_that_nobody_watches_is_looked_at_again(monkeypatch, after, felt, verdict):
    bench = Bench(monkeypatch, ended="link lost: gone")
    monkeypatch.setattr(drill, "look_again", lambda *_: Again(6.2, 0.2, after, felt))
    checks, row = bench.cut(blind=True)
    assert bench.halts == 1 and checks[0].verdict == verdict and ("at_most_s" in row) == (verdict == "ok")


def test_a_stop_that_nobody_felt_is_a_no_go():
    (check,), _ = drill._judged(STOP, PUSH, None)
    assert check.verdict == "stop" and "Press STOP" in check.fix
    (check,), _ = drill._judged(STOP, PUSH, OffTime(0.9, 0.7, 1.0, False))
    assert check.verdict == "stop" and "expected within 0.5 s" in check.text
