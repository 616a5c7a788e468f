"""Structure chosen by prediction: how tests are divided, and which groups of parameters are worth their freedom."""

import numpy as np
import pytest
from tests.identification.synthetic import record

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.diagnostics.validation import Prediction, Score
from rovtwin.identification.identify import identify
from rovtwin.identification.joint.model.catalogue import catalogue, choose
from rovtwin.identification.joint.model.prior import default_prior
from rovtwin.identification.logs.record import Record, Signal
from rovtwin.identification.structure import (
    LADDER,
    Rung,
    change_between,
    climbed,
    folds,
    lines_about,
    restricted,
    rung_of,
    up_to,
)
from rovtwin.vehicle import load_vehicle

VEHICLE = load_vehicle("double_blueye")
EVERYTHING = catalogue(VEHICLE)


def a_test(name="one", duration=60.0):
    t = np.arange(0.0, duration, 0.1)
    gyro = Signal(t, np.zeros((len(t), 3)))
    return Record(name, t, np.zeros((len(t), 6)), {"gyro": gyro}, end=duration)


def test_every_parameter_has_a_rung_and_full_is_all_of_them():
    assert {rung_of(name) for name in EVERYTHING.names} == set(LADDER)
    assert up_to("inflow", EVERYTHING.names) == list(EVERYTHING.names)
    assert set(EVERYTHING.names) - set(up_to("full", EVERYTHING.names)) == {
        name for name in EVERYTHING.names if name.endswith(".inflow_loss")
    }
    linear = up_to("linear", EVERYTHING.names)
    assert "linear_damping.surge" in linear and "quadratic_damping.surge" not in linear
    assert not any("dead_band" in name for name in linear) and "thrusters.surge.force_ahead" in linear


def test_a_hull_alike_to_port_and_starboard_couples_lengthwise_with_lengthwise():
    symmetric = ("added_mass.surge_heave", "linear_damping.surge_pitch", "added_mass.sway_yaw", "added_mass.roll_yaw")
    assert {rung_of(name) for name in symmetric} == {"symmetric"}
    others = ("added_mass.surge_sway", "linear_damping.heave_roll", "quadratic_damping.pitch_yaw")
    assert {rung_of(name) for name in others} == {"full"}


def test_every_second_is_fitted_once_and_predicted_once():
    records = [a_test("one", 61.0), a_test("two", 12.0), a_test("three", 20.0)]  # four blocks, one and two
    (fit, held_out), (again, other) = folds(records)
    assert [id(r) for r in fit] == [id(r) for r in other] and [id(r) for r in held_out] == [id(r) for r in again]
    assert sum(r.duration for r in [*fit, *held_out]) == pytest.approx(93.0)
    assert {r.name for r in fit} | {r.name for r in held_out} == {"one", "two", "three"}


def test_what_cannot_be_divided_says_so():
    with pytest.raises(IdentificationError, match="found 12 s of tests, expected 4 tests, or blocks of at least 8 s"):
        folds([a_test(duration=12.0)])
    with pytest.raises(IdentificationError, match="found 'lineer', expected one of auto, linear"):
        up_to("lineer", EVERYTHING.names)


def oracle(gains, scatter=0.0):
    """A predictor whose error falls by what each rung in it gains; quadratic damping helps here and harms there."""

    held_out = [r for _, half in folds([a_test()]) for r in half]

    def predicted(free, words):
        rungs = {rung_of(name) for name in free}
        rms = np.exp(-sum(gains.get(rung, 0.0) for rung in rungs))
        uneven = [scatter * (-1.0) ** (r.start < 30.0) * ("quadratic" in rungs) for r in held_out]
        scores = [{"gyro.p": Score(0.0, float(rms * np.exp(x)), 1.0, 1.0)} for x in uneven]
        return [Prediction(r.name, 5.0, {}, s, {"gyro.p": True}) for r, s in zip(held_out, scores, strict=True)]

    return predicted


def test_a_rung_is_kept_where_it_predictschange_between_and_only_there():
    gains = {"linear": 0.5, "quadratic": 0.1, "astern": -0.2, "thrusters": 0.005, "symmetric": 0.05}
    kept, rungs = climbed(EVERYTHING.names, oracle(gains))
    assert {rung.name: rung.kept for rung in rungs} == {
        "linear": True, "quadratic": True, "astern": False, "thrusters": False, "symmetric": True, "full": False,
        "inflow": False,
    }  # fmt: skip
    assert {rung_of(name) for name in kept} == {"linear", "quadratic", "symmetric"}
    assert rungs[0].change == pytest.approx(-0.5) and rungs[2].change == pytest.approx(0.2)


def test_a_gain_within_its_standard_error_is_none():
    _, rungs = climbed(EVERYTHING.names, oracle({"linear": 0.5, "quadratic": 0.05}, scatter=0.2))
    assert not rungs[1].kept and rungs[1].change == pytest.approx(-0.05) and rungs[1].std > 0.1
    _, rungs = climbed(EVERYTHING.names, oracle({"linear": 0.5, "quadratic": 0.5}, scatter=0.2))
    assert rungs[1].kept


def test_what_is_not_free_stays_at_what_is_most_likely_before():
    start = default_prior(EVERYTHING, VEHICLE, {"quadratic_damping.surge": {"value": 123.0, "sd": 1.0}})
    some, known = restricted(EVERYTHING, start, up_to("linear", EVERYTHING.names))
    model = some.model_at(known.mean)[0]
    assert float(model.quadratic_damping_ahead[0, 0]) == pytest.approx(123.0)
    assert len(some) == len(known.mean) == len(up_to("linear", EVERYTHING.names))
    rows = [EVERYTHING.names.index(name) for name in some.names]
    np.testing.assert_array_equal(known.covariance, start.covariance[np.ix_(rows, rows)])


def test_a_rung_that_ends_a_run_away_is_kept_and_one_that_begins_one_is_not():
    assert change_between({(0, "p"): 0.0, (1, "p"): 0.0}, {(0, "p"): np.inf, (1, "p"): 0.1}) == (-np.inf, 0.0)
    assert change_between({(0, "p"): np.inf, (1, "p"): 0.0}, {(0, "p"): 0.0, (1, "p"): 0.1}) == (np.inf, 0.0)
    change, std = change_between({(0, "p"): np.inf, (1, "p"): 0.0}, {(0, "p"): np.inf, (1, "p"): 0.1})
    assert change == pytest.approx(-0.05) and np.isfinite(std)
    text = lines_about([Rung("quadratic", ("a",), -np.inf, 0.0, True), Rung("full", ("b",), np.inf, 0.0, False)])
    assert "follow the motion where they ran away: kept" in text[0] and "run away: left" in text[1]


def test_widths_are_those_of_the_percentage():
    (text,) = lines_about([Rung("linear", ("a",), -3.0, 0.2, True)])
    assert "-95.0 % +- 1.0: kept" in text


FREE = ["added_mass.surge", "*_damping.surge", "thrusters.surge.force_*"]


@pytest.fixture(scope="module")
def surging():
    """A record of a vehicle whose quadratic damping in surge is twice what its file says, and nothing else is amiss."""
    parameters = choose(EVERYTHING, ["quadratic_damping.surge"])
    model = parameters.model_at(np.array([np.log(2.0)]))[0]
    t = np.arange(0.0, 80.0, 0.1)
    u = np.zeros((len(t), 6))
    surge = [i for i, name in enumerate(VEHICLE.thruster_names) if "surge" in name]
    u[:, surge] = np.sign(np.sin(0.35 * t + np.sin(0.11 * t)))[:, None] * (0.6 + 0.4 * np.sin(0.05 * t))[:, None]
    return record(model, t, u, 80.0)


@pytest.mark.slow
def test_auto_finds_what_is_amiss_and_says_what_it_left(surging):
    found = identify(VEHICLE, [surging], free=FREE, options={"structure": "auto"})
    assert {rung.name: rung.kept for rung in found.ladder} == {"linear": True, "quadratic": True}
    assert any("structure 'quadratic'" in line for line in found.findings)


@pytest.mark.system
def test_a_structure_that_cannot_be_is_refused(surging):
    with pytest.raises(IdentificationError, match="have none of the parameters that are free"):
        identify(VEHICLE, [surging], free=["quadratic_damping.surge"], options={"structure": "linear"})
    with pytest.raises(IdentificationError, match="no tests by which to choose"):
        identify(VEHICLE, options={"structure": "auto"})
