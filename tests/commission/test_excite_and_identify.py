"""Scale, excite and identify over a link, of a vehicle whose truth nobody knows."""

import numpy as np
import pytest
from tests.commission.people import Scripted
from tests.commission.truths import hidden_truth

from rovtwin.commission import estimate, excite, scale
from rovtwin.commission import work as work_module
from rovtwin.commission.dossier import Dossier
from rovtwin.commission.evidence.forces import TASK
from rovtwin.commission.request import Request
from rovtwin.commission.run import commission
from rovtwin.commission.stage import Stage
from rovtwin.live.connect import connect
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.constants import AXES
from rovtwin.vehicle.physics.dynamics import damping_wrench

STAGES = [
    Stage("scale", "Scale", "", "", True, scale.run),
    Stage("excite", "Excite", "", "", True, excite.run),
    Stage("identify", "Identify", "", "", False, estimate.run),
]


@pytest.mark.slow
def test_the_truth_of_a_hidden_vehicle_is_found_within_the_intervals(tmp_path, monkeypatch):
    truth = hidden_truth("double_blueye", 3, tmp_path / "truth.yaml")
    reading = scale.pull_of(truth.model(), "surge", 1.0).expected
    hidden = {"vehicle": str(tmp_path / "truth.yaml")}
    monkeypatch.setattr(
        work_module,
        "connect",
        lambda link, scenario, clock, observe=False: connect(link, scenario.model_copy(update=hidden), clock, observe),
    )
    person = Scripted([2.0 * reading, reading], no=["One more pull"])
    request = Request("double_blueye", "twin://", tank="6x3x1.5", minutes=3.0, speed=4.0)
    dossier = commission(request, tmp_path / "commissioned", STAGES, person)

    excited = dossier.measured("excite")
    assert excited["minutes"] <= 3.2 and {row["axis"] for row in excited["intervals"]} == set(TASK)
    found = dossier.passed("identify")
    assert found is not None, [one.outcome for one in dossier.attempts("identify")]
    assert load_vehicle(str(found.folder / "identified.yaml")).file.identified is not None
    measured, model = found.outcome.measured, truth.model()
    inside, wide = [], []
    for row in measured["damping"]:
        at = np.zeros(6)
        axis = AXES.index(row["axis"])
        at[axis] = row["speed"]
        low, high = row["interval_95"]
        inside.append(low <= float(damping_wrench(model, at)[axis]) <= high)
        wide.append(row["half_width_share"])
    print({row["axis"]: row["half_width_share"] for row in measured["damping"]}, inside)
    assert np.mean(inside) >= 0.85 and max(wide) < 0.06
    values = dict(zip(truth.parameters.names, truth.parameters.values(truth.theta), strict=True))
    known = [
        row["interval_95"][0] <= values[row["name"]] <= row["interval_95"][1]
        for row in measured["parameters"]
        if row["name"] in values
    ]
    print(f"{sum(known)} of {len(known)} parameters inside")
    assert np.mean(known) > 0.85
    for one in measured["budget"]:
        parts = [row["std"] for row in one["contributions"]]
        assert one["combined_std"] == pytest.approx(np.linalg.norm(parts)) and one["coverage_factor"] == 2.0
        assert {row["type"] for row in one["contributions"]} == {"A", "B"}
        stated = [row for row in measured["damping"] if row["axis"] in one["quantity"] and row["force"] == one["value"]]
        for row in stated:
            assert one["expanded_share"] == pytest.approx(row["half_width_share"])
    pulled = next(row for row in measured["budget"][0]["contributions"] if row["source"] == "reading of the scale")
    assert pulled["std"] / abs(measured["budget"][0]["value"]) == pytest.approx(0.02, rel=0.6)
    assert measured["repeatability"] and all(np.isfinite(row["en"]) for row in measured["repeatability"])

    again = commission(request, tmp_path / "commissioned", STAGES, Scripted(), only=["excite"])
    attempt = again.attempts("excite")[-1]
    assert attempt.outcome.seconds == 0.0, "what is flown is not flown again"
    assert attempt.outcome.measured["logs"] == ["../1/part-1/log.mcap"]
    assert isinstance(Dossier.open(tmp_path / "commissioned"), Dossier)
