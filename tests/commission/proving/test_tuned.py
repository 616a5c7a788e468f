"""The autopilot that is proven: tuned only if somebody asks for it and if it is better, and then flown later."""

from types import SimpleNamespace

import pytest
from tests.commission.proving.dossiers import LAST, Asked, identified_so_far, work_on

from rovtwin.commission.proving import tuned as module
from rovtwin.commission.proving.missions import open_water
from rovtwin.commission.proving.tuned import autopilot_of, tuned
from rovtwin.commission.stage import Outcome
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import parse
from rovtwin.core.user_files.files import write_text
from rovtwin.scenario.schema import ModelBasedSection, Scenario
from rovtwin.vehicle import load_vehicle

MODEL = load_vehicle("double_blueye").model()
SCENARIO = parse(Scenario, {"vehicle": "double_blueye"} | open_water(MODEL), "made")
QUICK = parse(ModelBasedSection, {"control": {"damping_ratio": 1.4}}, "autopilot")


@pytest.fixture
def work(tmp_path):
    return work_on(identified_so_far(tmp_path / "c", None), "prove", Asked(no="Fly"))


def found(better):
    """What a tuning gives."""
    return SimpleNamespace(
        section=QUICK,
        held_out=SimpleNamespace(better=better),
        seconds={"all": 12.0},
        search=SimpleNamespace(costs=[1.0]),
    )


def write_like_a_tuning(found, folder, report):
    path = folder / "autopilot.yaml"
    write_text(path, "type: model_based\ncontrol: {damping_ratio: 1.4}\n")
    return {"autopilot": path}


def test_nobody_asks_for_it(work, monkeypatch):
    monkeypatch.setattr(module, "tune", lambda *_: pytest.fail("it tuned"))
    work.person.no = "Tune"
    made, line, figures = tuned(work, SCENARIO)
    assert made is SCENARIO and line.verdict == "note" and "not tuned" in line.text and not figures["tuned"]


def test_a_budget_that_is_too_short_is_no_failure(work, monkeypatch):
    def too_short(*_):
        raise ConfigError("--budget-s: too short")

    monkeypatch.setattr(module, "tune", too_short)
    made, line, _ = tuned(work, SCENARIO)
    assert made is SCENARIO and line.verdict == "note" and "too short" in line.text


@pytest.mark.parametrize("better", [True, False])
def test_only_what_is_better_is_proven_and_flown(work, monkeypatch, better):
    monkeypatch.setattr(module, "tune", lambda *_: found(better))
    monkeypatch.setattr(module, "sentences", lambda _: ("It is as it is", []))
    monkeypatch.setattr(module, "write_tuned", write_like_a_tuning)
    made, line, figures = tuned(work, SCENARIO)
    assert made.autopilot == (QUICK if better else SCENARIO.autopilot) and line.text.endswith("It is as it is")
    assert figures["tuned"] == better and figures["tuning_wall_s"] == 12.0
    attempt = work.dossier.attempts("prove")[-1]
    work.dossier.end(attempt, Outcome(measured=figures))
    later = work_on(work.dossier, LAST[-1].name, work.person)
    section = parse(ModelBasedSection, autopilot_of(later)["autopilot"], "autopilot.yaml")
    assert section == (QUICK if better else SCENARIO.autopilot)
