"""The budget of an estimate: contributions that add up to what is stated, each from where it comes."""

import numpy as np
import pytest
from tests.identification.synthetic import full_pull, record, steps_command

from rovtwin.commission.evidence.budget import DENSITY, PLACE, UNSTATED, budget
from rovtwin.commission.evidence.forces import damping_forces, thrust_forces
from rovtwin.identification.identify import identify
from rovtwin.vehicle import load_vehicle

pytestmark = pytest.mark.slow
FREE = ["linear_damping.surge", "quadratic_damping.surge", "thrusters.*.force_*"]


@pytest.fixture(scope="module")
def result():
    vehicle = load_vehicle("double_blueye")
    full = full_pull(vehicle.model())
    anchor = {"bollard": {"direction": "surge", "command": 1.0, "force": full, "sd": 0.02 * full}}
    test = record(vehicle.model(), *steps_command(vehicle, 1, 12.0), 12.0)
    return identify(vehicle, [test], free=FREE, anchors=[anchor])


def by_source(row):
    return {one["source"]: one for one in row["contributions"]}


def test_contributions_add_up_to_what_is_stated(result):
    forces = damping_forces(result, ["surge"])
    rows = budget(result, forces, ["a pull"])
    for row, one in zip(rows, forces, strict=True):
        parts = np.array([part["std"] for part in row["contributions"]])
        assert row["combined_std"] == pytest.approx(np.linalg.norm(parts))
        assert row["expanded"] == pytest.approx(2.0 * row["combined_std"]) and row["coverage_factor"] == 2.0
        beside = [p["std"] for p in row["contributions"] if p["source"].startswith(("places", "density"))]
        fit = np.sqrt(row["combined_std"] ** 2 - np.sum(np.square(beside)))
        assert fit == pytest.approx(one.std(result.covariance), rel=0.05), "the rest is the fit's own"
        assert row["quantity"].startswith("damping in surge at") and row["unit"] == "N"


def test_the_pull_is_type_b_and_says_little_where_masses_are_held(result):
    (one,) = thrust_forces(result, ["surge"])
    (row,) = budget(result, [one], ["a pull"])
    found = by_source(row)
    pull, readings = found["reading of the scale"], found["readings of this test"]
    assert pull["type"] == "B" and readings["type"] == "A" and 0.0 < pull["std"] < 0.1 * readings["std"]
    # One reading of standard deviation s moves the thrust that it is of by its variance over s.
    C = np.linalg.inv(result.solution.information + result.problem.information)
    assert pull["std"] == pytest.approx(one.slope @ C @ one.slope / (0.02 * one.value), rel=0.02)
    assert not any("density" in source for source in found), "thrust was measured as it is"
    assert "reading of the scale" not in by_source(budget(result, thrust_forces(result, ["surge"]))[0])


def test_density_counts_by_whether_it_was_stated(result):
    (one, *_) = damping_forces(result, ["surge"])
    (row,) = budget(result, [one], ["a pull"])
    (density,) = [part for source, part in by_source(row).items() if "density" in source]
    stated = all(record.water_density for record in result.problem.segments.records)
    expected = (DENSITY if stated else UNSTATED) / 1000.0 * abs(one.value)
    assert density["std"] == pytest.approx(expected, rel=0.03)


def test_where_a_sensor_sits_hardly_counts_in_straight_pulls_and_more_than_nothing(result):
    (row,) = budget(result, [damping_forces(result, ["surge"])[0]], ["a pull"])
    places = by_source(row)[f"places of position and depth sensors, {1e3 * PLACE:g} mm"]
    assert places["type"] == "B" and 0.0 < places["std"] < 0.2 * abs(row["value"])
