"""Predict, then fly: the prediction stands before the flight, a true model agrees with it, an untrue one does not."""

import csv
import json
from types import SimpleNamespace

import numpy as np
import pytest
from tests.campaign.identified import identified_vehicle
from tests.commission.proving.dossiers import Asked, identified_so_far, work_on

from rovtwin.commission import predict, prove
from rovtwin.commission.proving import prediction
from rovtwin.commission.request import sha256
from rovtwin.commission.stage import Check
from rovtwin.core.errors import ConfigError
from rovtwin.live import connect
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.ensemble.bands import Held
from rovtwin.runs.ensemble.efforts import Foreseen

DRAG = ("linear_damping_ahead", "linear_damping_astern", "quadratic_damping_ahead", "quadratic_damping_astern")


def test_without_an_identified_file_nothing_is_predicted(tmp_path):
    with pytest.raises(ConfigError, match="stage identify first"):
        predict.run(work_on(identified_so_far(tmp_path / "c", None), "predict", Asked()))


def with_more_drag(scenario):
    """The twin of a scenario whose drag is 30 % larger than its file says."""
    model = compose(scenario).model
    return compose(scenario, model.replace(**{name: 1.3 * getattr(model, name) for name in DRAG}))


@pytest.fixture
def flown_once(monkeypatch):
    """Each attempt at the stage draws the same flights: they are flown once."""
    kept, really = [], prediction.fly_all

    def fly_all(runs, progress):
        if not kept:
            kept.append(really(runs, progress))
        assert len(kept[0]) == len(runs)
        return kept[0]

    monkeypatch.setattr(prediction, "fly_all", fly_all)


@pytest.mark.slow
def test_prove_predict_and_fly_over_a_link(tmp_path, monkeypatch, flown_once):
    person = Asked()
    dossier = identified_so_far(tmp_path / "c", identified_vehicle(tmp_path / "identified.yaml"))
    proven = prove.run(work_on(dossier, "prove", person))
    assert proven.go, proven.reasons
    dossier.end(dossier.attempts("prove")[-1], proven)
    rows = proven.measured["envelope"]
    assert [(row["current_m_s"], row["missions"], row["succeeded"]) for row in rows] == [(0.0, 3, 3), (0.1, 3, 3)]
    assert rows[0]["interval_95"][0] == pytest.approx(0.025 ** (1 / 3))
    assert (proven.measured["seed"], proven.measured["samples"]) == (dossier.request.seed, dossier.request.samples)
    assert proven.measured["largest_current_m_s"] == 0.1 and person.shares[-1][1] == 1.0

    refused = predict.run(work_on(dossier, "predict", Asked(no="Thrusters")))
    assert not refused.go and "not confirmed" in refused.reasons[0] and "inside" not in refused.measured

    work = work_on(dossier, "predict", person)
    outcome = predict.run(work)
    assert outcome.go, outcome.reasons
    measured = json.loads(json.dumps(outcome.measured))
    assert set(measured["inside"]) == {"north", "east", "depth", "heading"} and measured["verdict"] == "inside"
    name = measured["prediction_file"]
    assert sha256(work.folder / name) == measured["sha256"][name]
    assert all((work.folder / name).is_file() for name in outcome.files)
    with open(work.folder / measured["prediction_file"]) as file:
        table = list(csv.DictReader(file))
    assert all(float(row["north_low_m"]) <= float(row["north_high_m"]) for row in table)
    assert np.isclose(float(table[1]["t_s"]), 0.1)

    monkeypatch.setattr(connect, "compose", with_more_drag)
    other = predict.run(work_on(dossier, "predict", person))
    assert not other.go and other.measured["verdict"] == "outside"
    wrong = {row["axis"]: row["ratio"] for row in other.measured["effort"] if row["verdict"] == "outside"}
    assert wrong and all(ratio > 1.1 for ratio in wrong.values())


@pytest.mark.parametrize(
    ("rooms", "strays"), [([-0.04, 0.1], [0.0, 0.24]), ([0.1], [0.0]), ([-0.3, 0.0, 0.05], [0.0, 0.5, 0.7])]
)
def test_corners_move_inwards_where_drawn_flights_come_near_a_wall(monkeypatch, rooms, strays):
    """A vehicle without sway left its path by more than its positions err; the stage stopped over its own mission."""
    sized, left = [], list(rooms)
    stop = [Check("stop", "room", "so that nothing is flown")]
    monkeypatch.setattr(predict, "load_vehicle", lambda path: None)
    monkeypatch.setattr(predict, "_accuracy", lambda *_: 0.03)
    monkeypatch.setattr(predict, "_sized", lambda work, vehicle, path, accuracy, strays=0.0: sized.append(strays))
    monkeypatch.setattr(predict, "_predicted", lambda *_: (SimpleNamespace(room=left.pop(0)), stop, {}))
    person = SimpleNamespace(progress=lambda *_: None, say=lambda line: None)
    assert not predict.run(SimpleNamespace(identified=lambda: "", person=person)).go
    assert sized == pytest.approx(strays) and not left


def test_a_page_says_how_many_samples_there_are_and_how_many_count():
    good = Held("north", 0.93, 760, 19.4, (0.8, 1.0), 0.3, 0.4, 0.003, 0.05, 0.0125)
    line = predict._path(good)
    assert line.verdict == "ok" and "93.0 % of 760 samples" in line.text and "as good as 19 independent" in line.text
    near = predict._path(Held("depth", 0.4, 760, 17.0, (0.8, 1.0), 1 / 80, 5.0, 0.03, 0.05, 0.0125))
    assert near.verdict == "warning" and "0.03 m, 5.0 half-widths" in near.text and "dead zone" in near.fix
    bad = predict._path(Held("depth", 0.4, 760, 17.0, (0.8, 1.0), 1 / 80, 15.0, 0.06, 0.05, 0.0125))
    assert bad.verdict == "stop" and "15.0 half-widths" in bad.text and bad.fix


@pytest.mark.parametrize(
    ("chance", "beyond", "verdict", "mark"),
    [(0.3, 0.2, "inside", "ok"), (0.025, 0.03, "near", "warning"), (0.025, 0.2, "outside", "stop")],
)
def test_a_path_is_judged_as_a_whole_too(chance, beyond, verdict, mark):
    row = Held("north", 0.32, 760, 2.5, (0.6, 1.0), 0.025, 12.9, beyond, 0.05, 0.0125)
    assert row.agrees and predict._together([row], chance) == verdict
    assert predict._all_axes(verdict, chance).verdict == mark


def test_a_page_says_how_far_the_effort_is_off():
    one = Foreseen("heave", np.log(165.0), 0.027, 79)
    assert predict._effort(one, 168.0, 4).verdict == "ok"
    line = predict._effort(one, 1.4 * 165.0, 4)
    assert line.verdict == "stop" and "+40 %" in line.text and "-5 to +6 %" in line.text
