"""Blind directions in words, tested ranges, what old results and stated priors mean for new ones."""

import json
import logging
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from tests.conftest import shared_folder
from tests.identification.flown import fly
from tests.identification.synthetic import record, steps_command
from typer.testing import CliRunner

from rovtwin.cli import app
from rovtwin.core.errors import ConfigError, IdentificationError
from rovtwin.identification.diagnostics.contradictions import (
    about_dead_bands,
    about_logs_apart,
    about_prior,
    contradicted,
    no_dead_band,
)
from rovtwin.identification.diagnostics.gain import about_gain, gain_by_shape
from rovtwin.identification.diagnostics.plausible import about_equal_thrusters, about_odd_values
from rovtwin.identification.diagnostics.remarks import about_alike, about_narrow, about_water
from rovtwin.identification.diagnostics.validation import pushed_axes
from rovtwin.identification.diagnostics.verdict import _in_words, up_to_scale, verdicts
from rovtwin.identification.identify import identify, step_in_words
from rovtwin.identification.joint.model.catalogue import catalogue, choose
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.result.overlay import to_yaml
from rovtwin.identification.joint.uncertainty.apart import Apart
from rovtwin.identification.logs.evidence_file import read_evidence
from rovtwin.identification.logs.readers import read_tests
from rovtwin.identification.result import Identification
from rovtwin.runs.compose.composition import _say_doubts, compose
from rovtwin.scenario.files import load_scenario
from rovtwin.vehicle import load_vehicle, vehicle_from_dict
from rovtwin.vehicle.description.identified import fingerprint


@pytest.mark.parametrize(
    ("names", "weights", "information", "message"),
    [
        (("linear_damping.surge", "quadratic_damping.surge"), [1.0, -0.8], 0.0, "only their sum"),
        (("linear_damping_astern.sway", "quadratic_damping_astern.sway"), [1.0, -0.8], 0.0, "only their sum"),
        (("linear_damping.surge", "quadratic_damping_astern.surge"), [1.0, -0.8], 0.0, "other combinations"),
        (("added_mass.surge", "quadratic_damping.surge"), [1.0, -0.8], 0.0, "other combinations"),
        (("thrusters.surge.force_ahead", "thrusters.surge.exponent"), [1.0, -0.8], 0.0, "other combinations"),
        (
            ("thrusters.surge.force_ahead", "added_mass.surge", "linear_damping.surge", "restoring.metacentric_height"),
            [1.0, 1.0, 1.0, 1.0],
            0.0,
            "the scale of all forces",
        ),
        (
            ("thrusters.a.exponent", "thrusters.a.dead_band", "thrusters.a.time_constant", "added_mass.surge"),
            [1.0, 1.0, 1.0, 1.0],
            0.0,
            "other combinations",
        ),
        (("added_mass.yaw",), [1.0], 0.0, "say nothing of it"),
        (("added_mass.yaw",), [1.0], 0.8, "say less of it than was known before"),
    ],
)
def test_blind_directions_are_named_for_what_they_are(names, weights, information, message):
    assert message in _in_words(names, np.array(weights), information)


@pytest.fixture(scope="module")
def old():
    """A file as `rovtwin identify` writes it, tether drag among its parameters."""
    vehicle = load_vehicle("double_blueye")
    data = identify(vehicle, [], free=["added_mass.*", "thrusters.*", "tether.drag"]).file()
    for row in data["identified"]["estimate"]["parameters"]:
        if row["name"] == "tether.drag":
            row["value"] = 0.2
    return vehicle_from_dict(data, "identified.yaml")


def test_the_tether_drag_of_an_old_file_is_kept(old):
    found = identify(old, [], old=old)
    assert found.values["tether.drag"] == pytest.approx(0.2)


def test_what_somebody_states_counts_more_than_an_old_file(old):
    text = {"added_mass.surge": {"value": 60.0, "factor": 1.01}}
    found = identify(old, [], old=old, prior=text)
    low, high = found.interval("added_mass.surge")
    assert 58.0 < low < 60.0 < high < 62.0
    assert identify(old, [], old=old).values["added_mass.surge"] == pytest.approx(31.3, rel=1e-3)


EXTRA = {"name": "sonar", "mass": 1.0, "shape": {"box": [0.1, 0.1, 0.1]}, "pose": {"position": [0.2, 0.0, 0.2]}}


@pytest.mark.parametrize("way", ["as a part", "a copy of the identified file"])
def test_a_part_is_added_in_either_natural_way(old, way, tmp_path):
    if way == "as a part":
        inner = old.to_dict() | {"pose": {"position": [0.0, 0.0, 0.0]}, "name": "rov"}
        for key in ("identified", "sources", "version"):
            inner.pop(key, None)
        data = {"name": "with_sonar", "parts": [inner, EXTRA]}
    else:
        data = old.to_dict()
        data["parts"] = [*data["parts"], EXTRA]
    (tmp_path / "new.yaml").write_text(to_yaml(data, "a text editor"))
    found = identify(load_vehicle(tmp_path / "new.yaml", identified=False), [], old=old)
    assert found.model().weight == pytest.approx(float(old.model().weight) + 9.81, abs=0.01)
    assert found.values["added_mass.surge"] > identify(old, [], old=old).values["added_mass.surge"]


@pytest.mark.system
def test_meshes_travel_with_the_file(old, tmp_path):
    (tmp_path / "garage").mkdir()
    (tmp_path / "garage" / "sonar.stl").write_text("solid sonar\nendsolid\n")
    (tmp_path / "old.yaml").write_text(to_yaml(old.to_dict(), "rovtwin identify"))
    part = EXTRA | {"visuals": [{"mesh": "sonar.stl"}]}
    new = {**old.to_dict(), "parts": [*old.to_dict()["parts"], part]}
    (tmp_path / "garage" / "new.yaml").write_text(to_yaml(new, "a text editor"))
    (tmp_path / "out").mkdir()
    words = [tmp_path / "garage" / "new.yaml", "--prior", tmp_path / "old.yaml", "-o", tmp_path / "out" / "found.yaml"]
    result = CliRunner().invoke(app, ["identify", *map(str, words)])
    assert result.exit_code == 0, result.output
    moved = (tmp_path / "out").rename(tmp_path / "elsewhere")
    assert str(tmp_path) not in (moved / "found.yaml").read_text()
    assert load_vehicle(moved / "found.yaml").file.parts[-1].visuals[0].mesh == str(moved / "found/meshes/sonar.stl")
    assert f"result: {tmp_path / 'out' / 'found.nc'}" in result.output.replace("\n", "")
    assert str(tmp_path).encode() not in (moved / "found.nc").read_bytes()
    held = Identification.load(moved / "found.nc").vehicle
    assert fingerprint(held.file) == fingerprint(load_vehicle(moved / "found.yaml").file)
    assert Path(held.file.parts[-1].visuals[0].mesh).read_text() == "solid sonar\nendsolid\n"


DOUBT = "the estimate has not settled, so no width means anything"


@pytest.fixture
def doubtful(old, tmp_path):
    """A file that somebody kept with --keep, and one with a part more."""
    data = old.to_dict()
    data["identified"]["estimate"]["doubts"] = [DOUBT]
    (tmp_path / "kept.yaml").write_text(to_yaml(data, "rovtwin identify --keep"))
    new = {key: value for key, value in data.items() if key != "identified"}
    (tmp_path / "new.yaml").write_text(to_yaml(new | {"parts": [*data["parts"], EXTRA]}, "a text editor"))
    return tmp_path


def identify_command(folder, *more):
    words = ["identify", str(folder / "new.yaml"), "--prior", str(folder / "kept.yaml"), "-o", str(folder / "out.yaml")]
    return CliRunner().invoke(app, [*words, *more])


def test_what_is_not_to_be_relied_on_is_no_prior_unless_asked_for(doubtful):
    text = identify_command(doubtful)
    assert isinstance(text.exception, IdentificationError) and not (doubtful / "out.yaml").exists()
    assert "kept.yaml: found an identification that is not to be relied on" in str(text.exception)
    assert "--keep" in str(text.exception)
    kept = identify_command(doubtful, "--keep")
    reported = " ".join(kept.output.split())
    assert (
        kept.exit_code == 1
        and "Not to be relied on: 0 of " in reported
        and "Against it: its prior kept.yaml" in reported
    )
    assert load_vehicle(doubtful / "out.yaml").doubts == [f"its prior kept.yaml: {DOUBT}"]


@pytest.mark.system
def test_a_result_that_is_not_to_be_relied_on_is_written_with_keep_only(old, tmp_path, monkeypatch):
    (tmp_path / "kept.yaml").write_text(to_yaml(old.to_dict(), "rovtwin identify"))
    (tmp_path / "new.yaml").write_text(to_yaml(old.to_dict(), "rovtwin identify"))
    assert identify_command(tmp_path).exit_code == 0
    (tmp_path / "out.yaml").unlink()
    monkeypatch.setattr("rovtwin.identification.identify.doubts_of_prior", lambda old: [DOUBT])
    text = identify_command(tmp_path, "--json")
    assert text.exit_code == 1 and not (tmp_path / "out.yaml").exists()
    data = json.loads(text.stdout)
    assert (data["reliable"], data["doubts"], data["file"]) == (False, [DOUBT], None)
    assert Identification.load(tmp_path / "out.doubtful.nc").doubts == [DOUBT], "to look into, as the report"
    assert identify_command(tmp_path, "--keep").exit_code == 1
    assert load_vehicle(tmp_path / "out.yaml").doubts == [DOUBT]


def test_the_result_replaces_no_file_of_another_kind(old, tmp_path):
    (tmp_path / "kept.yaml").write_text(to_yaml(old.to_dict(), "rovtwin identify"))
    (tmp_path / "new.yaml").write_text(to_yaml(old.to_dict(), "rovtwin identify"))
    (tmp_path / "out.nc").write_bytes(b"CDF of a log")
    text = identify_command(tmp_path)
    assert isinstance(text.exception, IdentificationError) and "choose another name with -o" in str(text.exception)
    assert (tmp_path / "out.nc").read_bytes() == b"CDF of a log" and not (tmp_path / "out.yaml").exists()


@pytest.mark.system
def test_it_is_reported_when_shown_and_before_it_flies(doubtful, caplog, monkeypatch):
    path = str(doubtful / "kept.yaml")
    for command in ("check", "show"):
        assert DOUBT in " ".join(CliRunner().invoke(app, ["vehicle", command, path]).output.split())
    # Another test of this process may have heard it; libraries of others set up logging for themselves.
    _say_doubts.cache_clear()
    monkeypatch.setattr(logging.getLogger("rovtwin.runs.compose.composition"), "disabled", False)
    caplog.set_level("WARNING", "rovtwin")
    caplog.clear()
    for _ in range(2):
        compose(load_scenario("lawnmower_calm", [f"vehicle={path}"]))
    assert [r.getMessage() for r in caplog.records if DOUBT in r.getMessage()] == [
        f"kept.yaml: what was identified is not to be relied on: {DOUBT}"
    ]


def test_files_written_before_have_no_doubts(old):
    assert old.doubts == [] and load_vehicle("double_blueye").doubts == []
    assert "doubts" not in old.to_dict()["identified"]["estimate"]


def test_an_identified_vehicle_is_no_part_of_another(old, tmp_path):
    (tmp_path / "found.yaml").write_text(to_yaml(old.to_dict(), "rovtwin identify"))
    path = tmp_path / "new.yaml"
    path.write_text("name: new\nparts:\n  - {name: rov, part: found.yaml}\n")
    with pytest.raises(ConfigError, match=r"found.yaml was identified as a whole.* --prior found.yaml"):
        load_vehicle(path)


@pytest.mark.slow
def test_held_out_tests_of_a_prediction_are_predicted(old):
    vehicle = load_vehicle("double_blueye")
    t, u = steps_command(vehicle, 0, 10.0)
    log = record(vehicle.model(), t, u, 10.0)
    found = identify(old, [], validate=[log], old=old)
    assert [p.record for p in found.held_out] == ["synthetic"]
    assert found.held_out[0].scores["gyro.r"].fit > 50


def test_tests_in_other_water_than_the_vehicles_are_named():
    vehicle = load_vehicle("double_blueye")
    t, u = steps_command(vehicle, 0, 5.0)
    log = record(vehicle.model(), t, u, 5.0, water_density=1025.0)
    assert "1025 kg/m3" in about_water(vehicle, [log])[0]
    assert about_water(vehicle, [record(vehicle.model(), t, u, 5.0, water_density=998.0)]) == []


def test_widths_below_what_any_model_is_right_to_are_named():
    parameters = choose(catalogue(load_vehicle("double_blueye")), ["added_mass.*", "restoring.*"])
    wide = np.full(len(parameters), 0.01)
    assert about_narrow(parameters, np.diag(wide**2)) == []
    wide[[p.name == "restoring.net_buoyancy" for p in parameters.free]] = 1e-4  # [N], not relative
    assert about_narrow(parameters, np.diag(wide**2)) == []
    wide[parameters.names.index("added_mass.sway")] = 2e-4
    wide[parameters.names.index("added_mass.sway_yaw")] = 1e-4
    (text,) = about_narrow(parameters, np.diag(wide**2))
    assert text.startswith("added_mass.sway_yaw, added_mass.sway: known to better than 0.3 %")


def test_only_what_thrusters_pushed_along_is_excited():
    """Two surge thrusters of a Double Blueye, one a millisecond long; nothing at all leaves a decay to judge."""
    model = load_vehicle("double_blueye").model()
    B = np.asarray(model.thrusters.configuration)
    surge, sway = (np.where(np.abs(B[i]) > 0.5, 1.0, 0.0) for i in (0, 1))
    t = np.array([0.0, 5.0, 5.0001])
    log = record(model, t, np.array([surge, sway, 0.0 * sway]), 10.0)
    pushed = pushed_axes(B, log)
    assert pushed[0] and not pushed[1] and not pushed[2]
    assert pushed_axes(B, replace(log, command=0.0 * log.command)).all()


@pytest.fixture(scope="module")
def surge():
    """Three parameters with a prior of 0.4: the first came out far off and narrow, the second far off and wide."""
    parameters = choose(
        catalogue(load_vehicle("double_blueye")), ["added_mass.surge", "added_mass.sway", "*_damping.yaw"]
    )
    n = len(parameters)
    prior = Gaussian(np.zeros(n), 0.16 * np.eye(n))
    theta, std = np.zeros(n), np.full(n, 0.05)
    theta[0], theta[1], std[1] = 1.2, -0.9, 0.3
    return parameters, prior, theta, np.diag(std**2)


def test_what_lies_outside_the_prior_is_named_with_both_values(surge):
    parameters, prior, theta, C = surge
    (text,) = about_prior(parameters, prior, theta, C)
    base = parameters.free[0].base
    assert f"added_mass.surge {base * np.exp(1.2):.3g} kg (" in text
    assert f"against {base:.3g} kg ({base * np.exp(-0.784):.3g} to {base * np.exp(0.784):.3g})" in text
    assert "added_mass.sway" in text and "yaw" not in text
    assert about_prior(parameters, prior, 0.5 * theta, C) == []


def test_an_interval_that_reaches_back_to_the_prior_contradicts_nothing(surge):
    parameters, prior, theta, C = surge
    wide = C.copy()
    wide[1, 1] = 0.5**2
    (text,) = about_prior(parameters, prior, theta, wide)
    assert "added_mass.surge" in text and "added_mass.sway" not in text


def test_thrusters_taken_as_alike_are_named_where_the_model_lacks_something():
    vehicle = load_vehicle("double_blueye")
    parameters = choose(catalogue(vehicle), ["thrusters.*.force_ahead", "added_mass.surge"])
    white, coloured = ({"gyro[0]": SimpleNamespace(inflation=inflation)} for inflation in (1.2, 8.0))
    assert about_alike(parameters, vehicle.thruster_names, white) == []
    (text,) = about_alike(parameters, vehicle.thruster_names, coloured)
    assert "surge: port.surge, starboard.surge" in text and "rovtwin watch" in text and "options.groups" in text
    alone = choose(catalogue(vehicle), ["added_mass.surge"])
    assert about_alike(alone, vehicle.thruster_names, coloured) == []


def test_a_narrow_estimate_outside_its_prior_is_contradicted_and_a_wide_one_is_not(surge):
    parameters, prior, theta, C = surge
    against = contradicted(prior, theta, C, None)
    assert against == {0}
    solution = SimpleNamespace(covariance=C)
    assert verdicts(prior, solution, against)[:3] == ["contradicted", "partly", "learnt"]


@pytest.mark.parametrize("stated", [0.0, 0.05])
def test_a_dead_band_that_nobody_stated_may_be_none(stated):
    """Its prior, 0.01 and positive, cannot hold zero; the finding then suspected the prior or the log."""
    model = load_vehicle("double_blueye").model()
    bands = np.full_like(np.asarray(model.thrusters.dead_band), stated)
    model = model.replace(thrusters=replace(model.thrusters, dead_band=bands))
    everything = catalogue(load_vehicle("double_blueye"), None, model)
    parameters = choose(everything, ["thrusters.*.dead_band", "added_mass.surge"])
    n, i = len(parameters), [name.endswith("dead_band") for name in parameters.names].index(True)
    prior, theta, C = Gaussian(np.zeros(n), np.eye(n)), np.zeros(n), 0.01 * np.eye(n)
    theta[i] = -7.0
    allowed = no_dead_band(parameters, prior, theta)
    text, against = about_dead_bands(parameters, prior, theta, C), contradicted(prior, theta, C, None, allowed)
    if stated:
        assert allowed == [] and text == [] and against == {i} and about_prior(parameters, prior, theta, C)
        return
    assert allowed == [i] and against == set() and about_prior(parameters, prior, theta, C) == []
    below = f"{parameters.names[i]} below {0.01 * np.exp(-7.0 + 0.196):.2g}"
    assert text == [f"no dead band was seen (95 %; the vehicle file states none): {below}"]
    theta[i] = 7.0
    assert no_dead_band(parameters, prior, theta) == [] and contradicted(prior, theta, C, None) == {i}


def test_what_was_learnt_is_reported_to_depend_on_the_scale_of_forces():
    parameters = choose(catalogue(load_vehicle("double_blueye")), ["thrusters.*.force_*", "added_mass.surge"])
    n = len(parameters)
    prior = 0.07**2 * np.ones((n, n)) + 0.2**2 * np.eye(n)
    only = up_to_scale(parameters, 0.07**2 * np.ones((n, n)) + 1e-6 * np.eye(n), 0.07**2 * np.ones((n, n)))
    assert only == ", up to the common scale of all forces, which only the prior knows: 7 %"
    better = up_to_scale(parameters, prior, 0.04**2 * np.ones((n, n)))
    assert better == ", up to the common scale of all forces, known to 4 %"
    assert up_to_scale(parameters, prior, 0.01**2 * np.ones((n, n))) == ""


def test_progress_is_reported_while_waiting():
    assert step_in_words(12, 80, 0.5, 200.0) == (
        "step 12 of at most 80 (most end after 20 to 40), 3:20 min, largest change 0.5 standard deviations"
    )
    assert step_in_words(1, 80, np.inf, 4.0) == "step 1 of at most 80 (most end after 20 to 40), 0:04 min"


def test_logs_that_disagree_by_themselves_contradict_each_other(surge):
    parameters, prior, _, C = surge
    n = len(parameters)
    theta = np.zeros((2, n))
    theta[1, 2] = 0.6
    apart = Apart(("run_1", "run_2"), theta, np.full((2, n), 0.1), np.full((2, 2, n), 0.14))
    assert contradicted(prior, np.zeros(n), C, apart) == {2}
    (text,) = about_logs_apart(parameters, apart)
    assert parameters.names[2] in text and "by run_1" in text and "by run_2" in text
    assert about_logs_apart(parameters, replace(apart, theta=0.3 * theta)) == []


def test_equal_thrusters_that_come_out_unequal_are_named():
    vehicle = load_vehicle("bluerov2")
    groups = {"front": (0, 1), "rear": (2, 3), "up": (4, 5)}
    parameters = choose(catalogue(vehicle, groups), ["thrusters.rear.force_ahead", "thrusters.up.force_ahead"])
    t = parameters.model.thrusters
    assert float(t.force_ahead[0]) == float(t.force_ahead[4]), "of one kind in this vehicle"
    (text,) = about_equal_thrusters(parameters, np.log([0.8, 0.36]), 1e-4 * np.eye(2))
    assert "1 : 0.8 : 0.36 (front as in the file, rear, up; force ahead" in text
    assert about_equal_thrusters(parameters, np.log([0.8, 0.36]), np.eye(2)) == [], "nobody knows them that well"
    assert about_equal_thrusters(parameters, np.log([0.95, 1.05]), 1e-4 * np.eye(2)) == []


def test_values_that_no_vehicle_has_are_named():
    vehicle = load_vehicle("double_blueye")
    everything = catalogue(vehicle)
    expected = {"added_mass.surge": 500.0, "thrusters.surge.exponent": 5.0}
    parameters = choose(everything, expected)
    (text,) = about_odd_values(parameters, parameters.thetas(expected), {})
    assert "added mass in surge is" in text and "times the displaced mass" in text
    assert "thrusters.surge.exponent is 5" in text
    assert about_odd_values(everything, np.zeros(len(everything)), {"surge": (-0.2, 0.3)}) == []
    pushing = replace(parameters, model=parameters.model.replace(linear_damping_ahead=-np.eye(6)))
    (text,) = about_odd_values(pushing, pushing.thetas({}), {"yaw": (-0.1, 0.001)})
    assert "damping in yaw is negative at 0.001 rad/s" in text


EXAMPLES = Path(__file__).parents[3] / "examples"


@pytest.fixture(scope="module")
def forces():
    """All forces of a vehicle with a table of thrust, whose dead band is part of its shape."""
    parameters = choose(catalogue(load_vehicle("bluerov2_heavy")), ["thrusters.*.force_*", "added_mass.*"])
    return parameters, Gaussian(np.zeros(len(parameters)), 0.07 * np.eye(len(parameters)))


def out_at(parameters, **factors):
    """theta with the forces of each group at a factor."""
    group = [n.split(".")[1] if ".force_" in n else "" for n in parameters.names]
    return np.log([factors.get(g, 1.0) for g in group])


@pytest.mark.system
def test_forces_at_a_common_factor_put_the_gain_of_the_commands_in_doubt(forces):
    parameters, prior = forces
    driven = fly("bluerov2_heavy", "multisine", 3)
    halved = replace(driven, command=0.5 * driven.command)
    (text,) = about_gain(parameters, prior, out_at(parameters, horizontal=2.6, vertical=1.8), [halved])
    assert "forces of all thrusters came out at 2.2 times" in text and "horizontal 2.6, vertical 1.8" in text
    assert "best with commands 2 times as large" in text
    for check in ("'mix'", "PWM", "battery"):
        assert check in text
    (less,) = about_gain(parameters, prior, out_at(parameters, horizontal=0.5, vertical=0.55), [driven])
    assert "0.52 times what was known before" in less and "best as it is" in less


@pytest.mark.parametrize(
    "factors", [{"horizontal": 2.6}, {"horizontal": 1.4, "vertical": 1.3}, {"horizontal": 3, "vertical": 0.9}]
)
def test_forces_that_differ_or_fit_are_no_gain(forces, factors):
    parameters, prior = forces
    assert about_gain(parameters, prior, out_at(parameters, **factors), []) == []
    some = choose(parameters, ["thrusters.horizontal.*"])
    half = Gaussian(np.zeros(len(some)), np.eye(len(some)))
    assert about_gain(some, half, np.log(np.full(len(some), 2.6)), []) == [], "the others were taken as exact"


@pytest.mark.system
def test_the_gain_of_the_tank_is_found_from_the_dead_band():
    """Its evidence file says half; the shape of force against command says all of it."""
    shared_folder("data", "bluerov2_heavy_tank")
    evidence = read_evidence(EXAMPLES / "bluerov2_heavy_tank" / "evidence.yaml")
    vehicle = load_vehicle("bluerov2_heavy")
    runs = [test.whole for test in read_tests(evidence, vehicle) if test.use == "fit" and test.whole is not None]
    stated = evidence.file.logs[0].commands.mix["front_port"][0]
    assert stated * gain_by_shape(vehicle.model(), runs) == pytest.approx(1.0)
