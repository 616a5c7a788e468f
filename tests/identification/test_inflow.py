"""Thrust lost to the inflow, as a parameter: derivatives, recovery, what a file keeps, the rung of the ladder."""

import numpy as np
import pytest
from tests.identification.broken import axis_steps
from tests.identification.synthetic import full_pull, record, slopes_of_the_ends

from rovtwin.identification.diagnostics.remarks import about_inflow
from rovtwin.identification.identify import default_free, identify
from rovtwin.identification.joint.build import problem_of
from rovtwin.identification.joint.model.catalogue import catalogue, choose
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.prior import default_prior
from rovtwin.identification.joint.solver.options import Options
from rovtwin.identification.result import Identification
from rovtwin.identification.structure import restricted, rung_of
from rovtwin.vehicle import load_vehicle, vehicle_from_dict

VEHICLE = load_vehicle("bluerov2_heavy")
EVERYTHING = catalogue(VEHICLE)
LOSS = "thrusters.horizontal.inflow_loss"
FREE = ["added_mass.surge", "*_damping.surge", "thrusters.horizontal.force_ahead", "thrusters.horizontal.time_constant",
        LOSS]  # fmt: skip
SIGNALS = ("position", "attitude", "gyro", "velocity")


def moving(parameters, truth, seed, duration):
    """A log of a vehicle with these parameters, pushed along its axes."""
    model = parameters.model_at(truth)[0]
    t, u = axis_steps(VEHICLE, seed, duration, hold=2.0, axes=(0, 1, 5))
    return record(model, t, u, duration, seed, SIGNALS)


@pytest.mark.system
def test_derivatives_are_those_of_the_simulation():
    parameters = choose(EVERYTHING, FREE)
    log = moving(parameters, np.zeros(len(parameters)), 0, 6.0)
    n = len(parameters)
    problem = problem_of(parameters, Gaussian(np.zeros(n), np.eye(n)), [log], (), Options.read({"segment": 2.0}))
    theta = np.where(np.isin(parameters.names, [LOSS]), 0.3, 0.1)
    found, exact = slopes_of_the_ends(problem, theta)
    scale = np.abs(exact).max(axis=(0, 1), keepdims=True)
    assert scale.min() > 1e-4
    np.testing.assert_allclose(found / scale, exact / scale, atol=0.01)


@pytest.mark.system
def test_it_is_distinguished_from_drag_and_kept(tmp_path):
    parameters = choose(EVERYTHING, FREE)
    truth = np.where(np.isin(parameters.names, [LOSS]), 0.25, 0.0)
    log = moving(parameters, truth, 3, 40.0)
    result = identify(
        VEHICLE,
        [log],
        free=FREE,
        anchors=[{"bollard": {"direction": "surge", "command": 1.0, "force": full_pull(parameters.model), "sd": 1.0}}],
    )
    low, high = result.interval(LOSS)
    assert low < 0.25 < high and 0.0 < low, (low, high)
    assert high - low < 0.15
    kept = vehicle_from_dict(result.file(), "kept").model()
    rows = list(parameters.groups["horizontal"])
    np.testing.assert_allclose(np.asarray(kept.thrusters.inflow_loss)[rows], result.values[LOSS], rtol=1e-6)
    loaded = Identification.load(result.save(tmp_path / "kept.nc"))
    np.testing.assert_array_equal(loaded.model().thrusters.inflow_loss, result.model().thrusters.inflow_loss)
    again = identify(VEHICLE, [], old=vehicle_from_dict(result.file(), "kept"))
    assert again.values[LOSS] == pytest.approx(result.values[LOSS], rel=1e-6)


@pytest.mark.system
def test_what_the_file_states_counts_where_an_earlier_result_has_none(tmp_path):
    earlier = identify(VEHICLE, [], free=["added_mass.surge"])
    data = VEHICLE.to_dict()
    for thruster in data["thrusters"]:
        thruster["inflow_loss"] = 0.2
    result = identify(vehicle_from_dict(data, "stated"), [], old=vehicle_from_dict(earlier.file(), "earlier"))
    np.testing.assert_allclose(result.model().thrusters.inflow_loss, 0.2)
    loaded = Identification.load(result.save(tmp_path / "stated.nc"))
    np.testing.assert_allclose(loaded.model().thrusters.inflow_loss, 0.2)


def test_a_gain_by_the_inflow_is_none_in_the_file_and_that_is_reported():
    parameters = choose(EVERYTHING, FREE)
    below = np.where(np.isin(parameters.names, [LOSS]), -0.05, 0.0)
    assert about_inflow(parameters, below) == [f"{LOSS} came out below 0, which no propeller has: the file states 0"]
    assert about_inflow(parameters, -below) == []


def test_nothing_asks_for_it_unless_the_structure_does_or_the_file_has_it():
    names = [name for name in EVERYTHING.names if name.endswith(".inflow_loss")]
    assert names and all(rung_of(name) == "inflow" for name in names)
    assert not set(names) & set(default_free(EVERYTHING, []))
    assert set(names) <= set(default_free(EVERYTHING, [], inflow=True))
    data = VEHICLE.to_dict()
    for thruster in data["thrusters"]:
        thruster["inflow_loss"] = 0.2
    stated = catalogue(vehicle_from_dict(data, "stated"))
    assert set(names) <= set(default_free(stated, []))


def test_a_pattern_for_all_thrusters_does_not_mean_it():
    assert not [n for n in choose(EVERYTHING, ["thrusters.*", "*"]).names if "inflow" in n or "gyro" in n]
    named = choose(EVERYTHING, ["thrusters.*.inflow_loss", "sensors.gyro.*"]).names
    assert any("inflow" in n for n in named) and any("gyro" in n for n in named)


def test_without_its_rung_it_costs_nothing():
    parameters = choose(EVERYTHING, FREE)
    assert parameters.model.thrusters.inflow_loss is not None
    some, _ = restricted(parameters, default_prior(parameters, VEHICLE), [n for n in parameters.names if n != LOSS])
    assert some.model.thrusters.inflow_loss is None


@pytest.mark.parametrize(("name", "least", "most"), [("bluerov2_heavy", 0.1, 0.5), ("double_blueye", 0.4, 2.0)])
def test_its_prior_goes_with_the_top_speed(name, least, most):
    vehicle = load_vehicle(name)
    parameters = choose(catalogue(vehicle), ["thrusters.*.inflow_loss"])
    widths = np.sqrt(np.diag(default_prior(parameters, vehicle).covariance))
    assert (widths > least).all() and (widths < most).all()
