"""The page of the estimate: what stops, what warns, what is written."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.commission.people import Scripted

from rovtwin.commission import estimate
from rovtwin.commission.dossier import Dossier
from rovtwin.commission.request import Request
from rovtwin.commission.stage import Stage
from rovtwin.commission.work import Work
from rovtwin.identification.identify import identify
from rovtwin.vehicle import load_vehicle

STAGE = Stage("identify", "Identify", "", "", False, estimate.run)


@pytest.fixture
def work(tmp_path):
    dossier = Dossier.begin(tmp_path / "commissioned", Request("double_blueye", "twin://"))
    return Work(dossier, dossier.next_attempt(1, STAGE).folder, Scripted())


@pytest.fixture(scope="module")
def predicted():
    """Of the parts alone: a result without tests."""
    return identify(load_vehicle("double_blueye"), ())


def shown(result, **more):
    """The same with other verdicts or doubts."""
    names = ("vehicle", "parameters", "verdicts", "doubts", "findings", "records", "values", "interval", "theta")
    data = {
        name: getattr(result, name) for name in (*names, "covariance", "tested", "model", "up_to_scale", "solution")
    }
    return SimpleNamespace(**data | more)


def test_without_a_log_there_is_nothing_to_estimate(work):
    outcome = estimate.run(work)
    assert not outcome.go and "found no log" in outcome.reasons[0] and "--stage excite" in outcome.reasons[0]


@pytest.mark.parametrize(
    ("doubt", "fix"),
    [
        ("the estimate has not settled, so no width means anything", "--minutes"),
        ("the fitted tests last 4.0 s in all, expected at least 10 s", "--stage excite"),
        ("the model misses gyro.p by more than 5 times the declared noise", "residuals"),
        ("its prior old.yaml: has not converged", "without --prior"),
    ],
)
def test_a_doubt_stops_and_says_what_would_help(predicted, doubt, fix):
    checks = list(estimate._about(shown(predicted, doubts=[doubt]), True, "twin://"))
    assert checks[0].verdict == "stop" and doubt in checks[0].text and fix in checks[0].fix


@pytest.mark.parametrize(("link", "count"), [("twin://", 0), ("blueye://127.0.0.2", 1)])
def test_over_a_link_thrusters_include_the_firmware(predicted, link, count):
    checks = [str(one) for one in estimate._about(shown(predicted), True, link)]
    assert sum("own firmware" in line for line in checks) == count


def test_contradictions_warn_with_both_values(predicted):
    p, verdicts = predicted.parameters.free[0], ["contradicted", *predicted.verdicts[1:]]

    def warned(low, high):
        result = shown(predicted, verdicts=verdicts, findings=["one remark"], interval=lambda name: (low, high))
        checks = list(estimate._about(result, True, "twin://"))
        assert ("note", "one remark") in [(check.verdict, check.text) for check in checks]
        (warning,) = [check for check in checks if check.verdict == "warning"]
        assert warning.what == p.name and " to " in warning.text
        return warning

    off = warned(p.base + 1.0, p.base + 2.0)
    assert f"the file says {p.base:.3g}" in off.text and "Is the file right" in off.fix
    apart = warned(p.base - 1.0, p.base + 1.0)
    assert "the file" not in apart.text and "parts of the tests disagree" in apart.text and "battery" in apart.fix


@pytest.mark.system
def test_axes_are_held_against_what_was_asked_for(work, predicted):
    tested = {"surge": (-0.4, 0.5), "sway": (-0.2, 0.2), "heave": (-0.2, 0.2)}
    result = shown(predicted, tested=tested)
    forces = estimate.damping_forces(result)
    checks = {
        check.what: check
        for check in estimate._known(work, result, [estimate._force(one, result, None) for one in forces])
    }
    assert checks["damping in yaw"].verdict == "warning" and "not tested" in checks["damping in yaw"].text
    assert checks["damping in surge"].verdict == "note" and "±5 %" in checks["damping in surge"].text
    narrow = shown(predicted, tested=tested, covariance=1e-6 * predicted.covariance)
    checks = {
        check.what: check.verdict
        for check in estimate._known(work, narrow, [estimate._force(one, narrow, None) for one in forces])
    }
    assert checks["damping in surge"] == "ok"


def test_a_result_in_doubt_leaves_no_vehicle_file(work, predicted, monkeypatch):
    monkeypatch.setattr(estimate, "write_identification_report", lambda result, folder: folder / "report.html")
    kept = []
    result = shown(predicted, doubts=["not settled"], save=lambda path, overwrite: kept.append(Path(path).name))
    assert set(estimate._files(work, result)) == {"result_file", "report_file"} and kept == ["identified.doubtful.nc"]
    assert not (work.folder / "identified.yaml").exists()
    result = shown(predicted, doubts=[], save=lambda path, overwrite: kept.append(Path(path).name), file=predicted.file)
    assert estimate._files(work, result)["vehicle_file"] == "identified.yaml"
    assert load_vehicle(str(work.folder / "identified.yaml")).file.identified is not None
