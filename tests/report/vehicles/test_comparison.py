"""`rovtwin compare`: what vehicle files state, how far they differ, and what is printed, drawn and written."""

import json
import sys

import numpy as np
import pytest

import rovtwin.cli
from rovtwin.cli.vehicle.compare import labels
from rovtwin.identification.diagnostics.differences import as_a_whole, difference
from rovtwin.identification.diagnostics.stated import Value, stated
from rovtwin.identification.joint.model.catalogue import catalogue, choose
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.result.overlay import identified_file, to_yaml
from rovtwin.report.vehicles.comparison import agreement, compare_files, difference_text, relative_text, value_text
from rovtwin.vehicle import load_vehicle, vehicle_from_dict

FREE = ["added_mass.surge", "linear_damping.surge", "quadratic_damping.surge", "thrusters.surge.*"]
GROUPS = {"mine": (0, 3), "sway": (1, 4), "heave": (2, 5)}
TESTED = {"surge": (-0.2, 0.3), "thrusters.surge": (-0.7, 0.7)}


def identified(shift=0.0, std=0.05, correlation=0.0, groups=None, free=FREE):
    """A vehicle with an `identified:` block; `shift` of linear and quadratic damping [log], by their correlation."""
    vehicle = load_vehicle("double_blueye")
    parameters = choose(catalogue(vehicle, groups), free)
    theta, C = np.zeros(len(parameters)), std**2 * np.eye(len(parameters))
    i, j = (parameters.names.index(f"{k}_damping.surge") for k in ("linear", "quadratic"))
    theta[[i, j]] = shift
    C[i, j] = C[j, i] = correlation * std**2
    prior = Gaussian(np.zeros(len(parameters)), 0.25 * np.eye(len(parameters)))
    verdicts = ["learnt"] * len(parameters)
    return identified_file(vehicle, parameters, theta, C, prior, verdicts, ["tank_1 (fit, 60 s)"], [], TESTED)


@pytest.fixture(scope="module")
def files():
    text = {"first": identified(), "second": identified([0.04, 0.04], correlation=-0.97), "plain": None}
    loaded = {n: vehicle_from_dict(d, n) if d else load_vehicle("double_blueye") for n, d in text.items()}
    return {name: stated(vehicle, name) for name, vehicle in loaded.items()}


def run(monkeypatch, capsys, *words):
    monkeypatch.setattr(sys, "argv", ["rovtwin", "compare", *map(str, words)])
    with pytest.raises(SystemExit) as stopped:
        rovtwin.cli.main()
    return stopped.value.code, capsys.readouterr()


def test_an_interval_wider_than_its_value_is_given_by_its_ends():
    """`±43188 %` stood for a dead band of which the tests saw none."""
    assert value_text(Value(10.0, "N", 0.05, True), short=True) == "10 ±9.8 %"
    assert value_text(Value(1e-5, "1", 3.4, True), short=True).startswith("1e-05 (0.000000013 to 0.00")


def test_a_file_states_what_was_identified():
    one = stated(vehicle_from_dict(identified([0.1, 0.2], 0.07), "x"), "x")
    assert one.values["linear_damping.surge"].value == pytest.approx(6.48 * np.exp(0.1), rel=1e-6)
    assert one.values["linear_damping.surge"].std == pytest.approx(0.07)
    assert np.isnan(one.values["added_mass.yaw"].std)
    assert one.tested["surge"] == [-0.2, 0.3]
    # What it states is the model that twin and autopilot load, and theta moves it from there.
    model = one.vehicle.model()
    n = len(one.parameters)
    here = one.model_at(np.zeros(n))
    assert np.allclose(here.linear_damping_ahead, model.linear_damping_ahead, rtol=1e-12)
    moved = one.model_at(0.1 * np.eye(n)[one.parameters.names.index("linear_damping.surge")])
    assert moved.linear_damping_ahead[0, 0] == pytest.approx(model.linear_damping_ahead[0, 0] * np.exp(0.1))


def test_groups_of_the_options_are_those_of_the_file():
    free = [name.replace("surge.*", "mine.*") for name in FREE]
    one = stated(vehicle_from_dict(identified(groups=GROUPS, free=free), "x"), "x")
    assert one.parameters.groups["mine"] == (0, 3)
    assert np.isfinite(one.values["thrusters.mine.force_ahead"].std)


def test_a_difference_is_in_standard_deviations_of_both():
    a, b = Value(10.0, "N", 0.03, True), Value(11.0, "N", 0.04, True)
    found = difference(a, b)
    assert found.relative == pytest.approx(0.1)
    assert found.deviations == pytest.approx(np.log(1.1) / 0.05) and found.both
    exact = difference(a, Value(11.0, "N", float("nan"), True))
    assert exact.deviations == pytest.approx(np.log(1.1) / 0.03) and not exact.both
    assert "~" in difference_text(exact) and "~" not in difference_text(found)
    signed = difference(Value(-1.0, "N", 0.3, False), Value(1.0, "N", 0.4, False))
    assert np.isnan(signed.relative) and signed.deviations == pytest.approx(4.0)
    neither = difference(Value(0.0, "N", float("nan"), False), Value(1.0, "N", float("nan"), True))
    assert np.isnan(neither.deviations)


def test_correlations_decide_as_a_whole(files):
    """Both coefficients up by 0.8 sd: nothing each, but their sum was known six times better."""
    whole = as_a_whole(files["plain"], files["second"])
    assert whole is not None
    assert whole.count == 8
    v = np.array([0.04, 0.04]) / 0.05
    assert whole.distance == pytest.approx(v @ np.linalg.inv([[1, -0.97], [-0.97, 1]]) @ v, rel=1e-3)
    assert whole.chance < 1e-3
    single = difference(files["plain"].values["linear_damping.surge"], files["second"].values["linear_damping.surge"])
    assert abs(single.deviations) < 1
    nothing = as_a_whole(files["plain"], files["plain"])
    assert nothing is None


def test_the_same_file_agrees_with_itself(files):
    whole = as_a_whole(files["first"], files["first"])
    assert whole is not None and whole.distance == 0.0 and whole.chance == 1.0


def test_forces_have_bands_where_a_file_was_identified(files):
    both = compare_files([files["first"], files["second"], files["plain"]], difference, as_a_whole)
    surge = [f for f in both.forces() if f.direction == "surge"]
    assert [f.speed for f in surge] == pytest.approx([-0.2, -0.1, 0.15, 0.3], abs=0.005)
    fastest = surge[-1]
    assert fastest.force[0] == pytest.approx(6.48 * 0.3 + 158.86 * 0.09, rel=1e-6)
    assert fastest.force[2] == pytest.approx(fastest.force[0])
    (low, high), (low2, high2), plain = fastest.band
    assert low < fastest.force[0] < high and np.isnan(plain[0])
    assert high2 - low2 < high - low  # the correlation narrows the force, not its coefficients
    assert fastest.deviations[0] == 0 and fastest.deviations[1] > 0
    assert len(agreement(both)) == 2


@pytest.mark.system
def test_the_command_prints_tables_and_writes_the_report(tmp_path, monkeypatch, capsys):
    before, after = tmp_path / "before.yaml", tmp_path / "after.yaml"
    before.write_text(to_yaml(identified(), "a test"))
    after.write_text(to_yaml(identified([0.3, 0.3]), "a test"))
    code, out = run(monkeypatch, capsys, before, after, "-o", tmp_path / "page")
    assert code in (0, None)
    assert "quadratic_damping.surge" in out.out and "+35 % (+4.2 sd)" in out.out
    assert "after differs from before by more than their errors" in out.out
    page = (tmp_path / "page" / "report.html").read_text()
    assert "They differ by more than their errors" in page and "tank_1 (fit, 60 s)" in page
    assert {p.stem for p in (tmp_path / "page" / "figures").glob("*.png")} == {"damping", "thrust", "added_mass"}


@pytest.mark.system
@pytest.mark.parametrize(
    ("columns", "head"),
    [
        (160, "double_blueye  double_blueye_thesis  bluerov2"),
        (120, "double_blueye  double_blueye_thesis  Difference"),
        (80, "first  other  Difference"),
    ],
)
def test_names_and_numbers_stay_whole_however_narrow_the_screen(monkeypatch, capsys, columns, head):
    monkeypatch.setenv("COLUMNS", str(columns))
    _, out = run(monkeypatch, capsys, "double_blueye", "double_blueye_thesis", "bluerov2")
    lines = out.out.splitlines()
    assert max(map(len, lines)) <= columns
    words = [" ".join(line.split()) for line in lines]
    assert any(" ".join(head.split()) in line for line in words)
    assert any(line.startswith("quadratic_damping.heave N s²/m² 156.5 1198") for line in words)


def test_for_a_machine(monkeypatch, capsys):
    code, out = run(monkeypatch, capsys, "double_blueye", "bluerov2_heavy", "--json")
    data = json.loads(out.out)
    assert code in (0, None)
    assert [f["label"] for f in data["files"]] == ["double_blueye", "bluerov2_heavy"]
    rows = {row["name"]: row for row in data["parameters"]}
    assert rows["added_mass.heave"]["values"][0]["value"] == pytest.approx(44.6, rel=0.01)
    assert rows["thrusters.surge.force_ahead"]["values"][1] is None
    assert data["as_a_whole"] == [None] and data["report"] is None


@pytest.mark.parametrize(
    ("words", "message"),
    [(["double_blueye"], "give two or more"), (["double_blueye", "double_bluye"], "double_blueye")],
)
def test_what_cannot_be_compared_is_reported(monkeypatch, capsys, words, message):
    code, out = run(monkeypatch, capsys, *words)
    assert code == 2 and message in out.err and "Traceback" not in out.err


def test_labels_are_short_and_different():
    assert labels(["a.yaml", "b"]) == ["a", "b"]
    assert labels(["x/a.yaml", "y/a.yaml"]) == ["x/a", "y/a"]
    assert labels(["a", "a"]) == ["a (1)", "a (2)"]


@pytest.mark.parametrize(
    ("share", "message"), [(0.123, "+12 %"), (-0.011, "-1.1 %"), (-1e-6, "+0.0 %"), (13.4, "x 14.4")]
)
def test_relative_differences_in_few_digits(share, message):
    assert relative_text(share) == message
