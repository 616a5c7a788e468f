"""The pull on a scale: what is asked of the person, what a reading is held against, what it becomes."""

from types import SimpleNamespace

import numpy as np
import pytest
from tests.commission.people import Scripted

from rovtwin.commission import scale
from rovtwin.commission.dossier import Dossier
from rovtwin.commission.request import Request
from rovtwin.commission.stage import Outcome, Stage
from rovtwin.commission.work import Work
from rovtwin.identification.joint.model.catalogue import catalogue
from rovtwin.identification.joint.solver.anchors import static_evidence
from rovtwin.vehicle import load_vehicle

STAGE = Stage("scale", "Scale", "", "", True, scale.run)


@pytest.fixture(scope="module")
def model():
    return load_vehicle("double_blueye").model()


def work_of(tmp_path, person, link="twin://"):
    dossier = Dossier.begin(tmp_path / "commissioned", Request("double_blueye", link))
    return Work(dossier, dossier.next_attempt(1, STAGE).folder, person)


def test_without_a_scale_the_page_says_what_is_lost(tmp_path):
    outcome = scale.run(work_of(tmp_path, Scripted()))
    assert outcome.go and outcome.measured == {"anchors": []} and "thrust curve" in outcome.skipped
    assert outcome.seconds == 0.0 and not outcome.files


def test_a_reading_becomes_an_anchor_that_identification_takes(tmp_path, model):
    pull = scale.pull_of(model, "surge", 1.0)
    person = Scripted([1000.0, 1.03 * pull.expected], no=["One more pull"])
    work = work_of(tmp_path, person)
    outcome = scale.run(work)
    assert outcome.go and not outcome.skipped
    (found,) = outcome.measured["anchors"]
    assert found["bollard"]["force"] == pytest.approx(1.03 * pull.expected)
    assert found["bollard"]["sd"] == pytest.approx(np.hypot(0.02 * 1.03 * pull.expected, 5.0))
    residuals = static_evidence(catalogue(load_vehicle("double_blueye")), outcome.measured["anchors"])
    expected = -0.03 * pull.expected / found["bollard"]["sd"]
    everything = catalogue(load_vehicle("double_blueye"))
    assert float(residuals(np.zeros(len(everything)))[0]) == pytest.approx(expected), "the pull is the same one"
    assert (work.folder / "pull_surge.png").read_bytes().startswith(b"\x89PNG")
    assert Outcome.from_dict(outcome.to_dict()) == outcome


def test_a_reading_that_was_typed_before_a_break_is_not_lost(tmp_path, model):
    """Killed while it asked for a second pull, it used to ask for the first one again."""
    pull = scale.pull_of(model, "surge", 1.0)

    class Killed(Scripted):
        def confirm(self, question):
            raise KeyboardInterrupt

    work = work_of(tmp_path, Killed([1000.0, 1.03 * pull.expected]))
    with pytest.raises(KeyboardInterrupt):
        scale.run(work)
    person = Scripted(no=["One more pull"])
    with pytest.raises(KeyboardInterrupt):  # killed once more, as it offers the reading
        scale.run(Work(work.dossier, work.dossier.next_attempt(1, STAGE).folder, Killed()))
    again = Work(work.dossier, work.dossier.next_attempt(1, STAGE).folder, person)
    outcome = scale.run(again)
    assert f"Before the break the scale read {1.03 * pull.expected:.3g} N in surge" in person.questions[0]
    assert outcome.go and outcome.measured["anchors"] == [scale.anchor(pull, 1.03 * pull.expected, 1000.0)]

    work.dossier.end(work.dossier.attempts("scale")[-1], outcome)
    repeated = Work(work.dossier, work.dossier.next_attempt(1, STAGE).folder, Scripted())
    assert scale.before_the_break(repeated) == [], "a stage that is passed and repeated begins anew"


def test_who_doubts_an_earlier_reading_pulls_again(tmp_path, model):
    pull = scale.pull_of(model, "surge", 1.0)
    work = work_of(tmp_path, Scripted())
    scale._Page(work, 500.0).take(pull, scale.Reading("surge", 1.0, pull.expected, 500.0))
    person = Scripted([1000.0, 0.9 * pull.expected], no=["Before the break", "One more pull"])
    outcome = scale.run(Work(work.dossier, work.dossier.next_attempt(1, STAGE).folder, person))
    assert outcome.measured["anchors"][0]["bollard"]["force"] == pytest.approx(0.9 * pull.expected)
    after = Work(work.dossier, work.dossier.next_attempt(1, STAGE).folder, Scripted(no=["Before the break"]))
    assert [one.force for one in scale.before_the_break(after)] == [pytest.approx(0.9 * pull.expected)], "the newest"
    scale.run(after)
    later = Work(work.dossier, work.dossier.next_attempt(1, STAGE).folder, Scripted())
    assert scale.before_the_break(later) == [], "who said no is not asked again"
    (after.folder / scale.READINGS).write_text('[{"dire', encoding="utf-8")
    assert [one.force for one in scale.before_the_break(later)] == [pytest.approx(0.9 * pull.expected)], "half a file"


def test_the_pull_stays_within_what_the_scale_can_read(model):
    full = scale.pull_of(model, "surge", 1.0).expected
    assert scale.within(model, "surge", 2.0 * full).command == 1.0
    weaker = scale.within(model, "surge", full)
    assert scale.LEAST <= weaker.command < 1.0 and weaker.expected <= scale.USED * full
    assert scale.within(model, "surge", 0.1 * full) is None


@pytest.mark.parametrize(
    ("factor", "verdict", "words"),
    [
        (1.05, "ok", "expected"),
        (1.5, "warning", "battery"),
        (0.7, "warning", "battery"),
        (1.0 / 9.81, "stop", "shows kilograms"),
        (1000.0 / 9.81, "stop", "shows grams"),
        (1.0 / 4.448, "stop", "shows pounds"),
        (0.01, "stop", "Was the line taut"),
        (0.0, "stop", "Was the line taut"),
        (-1.0, "stop", "Was the line taut"),
    ],
)
def test_a_reading_is_held_against_the_file(model, factor, verdict, words):
    pull = scale.pull_of(model, "surge", 1.0)
    check = scale.judged(pull, factor * pull.expected)
    assert check.verdict == verdict and words in f"{check.text} {check.fix}"
    assert f"{pull.expected:.3g} N" in check.text, "found and expected"


def test_what_buoyancy_takes_from_the_scale_in_heave_is_put_back():
    model = load_vehicle("bluerov2_heavy").model()
    pull = scale.pull_of(model, "heave", 1.0)
    lift = float(model.buoyancy - model.weight)
    assert abs(lift) > 0.5 and pull.lift == pytest.approx(lift) and scale.pull_of(model, "surge", 1.0).lift == 0.0
    found = scale.anchor(pull, pull.expected, 100.0)["bollard"]
    assert found["force"] == pytest.approx(pull.expected + lift)
    assert found["sd"] > scale.anchor(scale.pull_of(model, "surge", 1.0), pull.expected, 100.0)["bollard"]["sd"]


@pytest.fixture
def real(monkeypatch):
    """A vehicle that is no twin; what is sent to it."""
    seen = SimpleNamespace(pulses=[], ended="")

    def fly_pulses(scenario, link, sources, clock, folder, pulses, guard, confirm, progress):
        if not confirm():
            return SimpleNamespace(spans=(), ended="it was not confirmed")
        seen.pulses = list(pulses)
        return SimpleNamespace(spans=((0.0, 1.0, ""), (1.0, 11.0, "")), ended=seen.ended)

    monkeypatch.setattr(scale, "on_this_machine", lambda link: False)
    monkeypatch.setattr(scale, "fly_pulses", fly_pulses)
    return seen


@pytest.fixture(autouse=True)
def nobody_there(monkeypatch):
    """No link is opened."""
    from contextlib import nullcontext

    there = SimpleNamespace(link=None, sources=[], clock=None)
    monkeypatch.setattr(Work, "connected", lambda self, scenario: nullcontext(there))


def test_a_pull_is_asked_for_and_grows(tmp_path, model, real):
    pull = scale.pull_of(model, "surge", 1.0)
    person = Scripted([1000.0, pull.expected], no=["One more pull"])
    outcome = scale.run(work_of(tmp_path, person))
    assert outcome.go and outcome.seconds == 11.0
    sizes = [np.abs(one.command).max() for one in real.pulses]
    assert sizes == sorted(sizes) and sizes[-1] == 1.0 and sizes[0] < 0.5
    assert sum(one.seconds for one in real.pulses) == pytest.approx(scale.RISE + scale.SECONDS)
    words = " ".join(person.lines)
    assert "stern" in words and "pull_surge.png" in words and f"{pull.expected:.0f} N" in words
    assert any("May the thrusters pull ahead" in question for question in person.questions)


def test_without_a_yes_nothing_is_pulled(tmp_path, real):
    outcome = scale.run(work_of(tmp_path, Scripted([1000.0, 50.0], no=["May the thrusters"])))
    assert not outcome.go and "not confirmed" in outcome.reasons[0] and not real.pulses
    assert outcome.measured["anchors"] == []


def test_a_pull_that_ended_early_is_no_reading(tmp_path, real):
    real.ended = "the leak sensor reports water"
    outcome = scale.run(work_of(tmp_path, Scripted([1000.0, 50.0])))
    assert not outcome.go and "water" in outcome.reasons[0] and outcome.measured["anchors"] == []
