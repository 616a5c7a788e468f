"""A learned wrench: its derivatives, where there is something to learn, the joint estimate and the decision."""

import numpy as np
import pytest
import yaml
from tests.identification.broken import axis_steps
from tests.identification.learned import study
from tests.identification.synthetic import record, slopes_of_the_ends
from tests.vehicle.discrepancies import block, file_with, random_part

from rovtwin.core.errors import ConfigError, IdentificationError
from rovtwin.core.numerics import jax
from rovtwin.identification.diagnostics.validation import Prediction, Score
from rovtwin.identification.discrepancy.acceptance import decided
from rovtwin.identification.discrepancy.regression import Windows, regressed
from rovtwin.identification.discrepancy.sparse import sparse
from rovtwin.identification.discrepancy.training import extended
from rovtwin.identification.identify import identify
from rovtwin.identification.joint.build import problem_of
from rovtwin.identification.joint.model.catalogue import catalogue, choose
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.solver.options import Options
from rovtwin.identification.result import Identification
from rovtwin.vehicle import load_vehicle, vehicle_from_dict
from rovtwin.vehicle.description.learned import discrepancy_from
from rovtwin.vehicle.description.schema import LearnedDiscrepancy
from rovtwin.vehicle.physics.discrepancy import discrepancy_variance, discrepancy_wrench

VEHICLE = load_vehicle("double_blueye")
FREE = ["added_mass.surge", "quadratic_damping.yaw", "thrusters.surge.force_ahead"]
SETTINGS = Options.read({"segment": 2.0})


@pytest.fixture(scope="module")
def learning():
    """A problem with weights of three parts, away from where they are zero."""
    rng = np.random.default_rng(4)
    parts = [
        random_part(rng, "surge", "motion"),
        random_part(rng, "surge", "thrust"),
        random_part(rng, "yaw", "motion"),
    ]
    learned = LearnedDiscrepancy.model_validate(block(parts))
    parameters = extended(choose(catalogue(VEHICLE), FREE), learned)
    t, u = axis_steps(VEHICLE, 0, 6.0, hold=1.5)
    log = record(VEHICLE.model(), t, u, 6.0, signals=("position", "attitude", "gyro", "velocity"))
    n = len(parameters)
    return problem_of(parameters, Gaussian(np.zeros(n), np.eye(n)), [log], (), SETTINGS)


@pytest.mark.system
def test_derivatives_by_weights_and_parameters_are_those_of_the_simulation(learning):
    rng, n = np.random.default_rng(1), len(learning.prior.mean)
    theta = np.concatenate([0.1 * rng.normal(size=3), 0.5 * rng.normal(size=n - 3)])
    found, exact = slopes_of_the_ends(learning, theta)
    scale = np.abs(exact).max(axis=(0, 2), keepdims=True)
    assert np.abs(exact[..., 3:]).max() > 1e-3
    np.testing.assert_allclose(found / scale, exact / scale, atol=0.01)


# Where there is something to learn, and what: windows of a vehicle whose missing wrench is known.


def windows(missing, seed=0, count=240, noise=0.05, able=(1, 1, 1, 0, 0, 1), axes=(1,)):
    """Windows of random motions and thrusts, in which `missing(nu, tau)` is what the model lacks."""
    rng = np.random.default_rng(seed)
    nu = rng.normal(size=(count, 1, 6)) * [0.3, 0.2, 0.2, 0.0, 0.0, 0.4] + 0.01 * rng.normal(size=(count, 5, 6))
    nu[:, :, 3:5] = 0.0
    tau = rng.normal(size=(count, 1, 6)) * [10.0, 8.0, 9.0, 0.0, 0.0, 3.0] * np.ones((1, 5, 1))
    wrench = np.mean(missing(nu, tau), axis=1)
    wrench = wrench + noise * rng.normal(size=wrench.shape)
    seen = np.zeros((count, 6), bool)
    seen[:, list(axes)] = True  # what is not seen costs nothing
    return Windows(wrench, seen, nu, tau, np.array(able, bool))


def duct(nu, tau):
    """Sway thrust that is lost with surge, smoothly; the form of no kernel."""
    out = np.zeros_like(nu)
    out[..., 1] = -tau[..., 1] * (1.0 - np.exp(-6.0 * nu[..., 0] ** 2))
    return out


@pytest.mark.system
def test_noise_alone_teaches_nothing():
    assert regressed(windows(lambda nu, tau: np.zeros_like(nu))) is None


@pytest.fixture(scope="module")
def of_a_duct():
    found = regressed(windows(duct))
    assert found is not None
    return found


@pytest.mark.system
def test_a_duct_is_learned_as_thrust_in_sway_and_predicts_other_windows(of_a_duct):
    found = of_a_duct
    assert [(part.axis, part.of) for part in found.parts] == [("sway", "thrust")]
    learned = discrepancy_from(found, np.eye(6), "learned", 1.0)
    other = windows(duct, seed=1, noise=0.0)
    nu, tau = other.nu_r.mean(axis=1), other.tau.mean(axis=1)
    reported = jax.vmap(lambda v, f: discrepancy_wrench(learned, v, f, 1e6 * v))(nu, tau)
    left = np.asarray(reported)[:, 1] - other.missing[:, 1]
    assert np.std(left) < 0.35 * np.std(other.missing[:, 1])
    # It knows where it knows: errors are within its own width nearly everywhere.
    variance = np.asarray(jax.vmap(lambda v, f: discrepancy_variance(learned, v, f))(nu, tau))[:, 1]
    assert np.mean(np.abs(left) < 2.0 * np.sqrt(variance + 0.05**2)) > 0.85


@pytest.mark.system
def test_what_is_learned_is_what_a_file_keeps(of_a_duct):
    found = of_a_duct
    again = LearnedDiscrepancy.model_validate(yaml.safe_load(yaml.safe_dump(found.model_dump(mode="json"))))
    for a, b in zip(
        jax.tree.leaves(discrepancy_from(found, np.eye(6), "", 1.0)),
        jax.tree.leaves(discrepancy_from(again, np.eye(6), "", 1.0)),
        strict=True,
    ):
        np.testing.assert_array_equal(a, b)


def test_a_sparse_regression_finds_a_term_of_its_library_and_drops_the_others():
    def term(nu, tau):
        out = np.zeros_like(nu)
        out[..., 5] = 0.4 * tau[..., 1] * nu[..., 0]
        return out

    found = sparse(windows(term, axes=range(6)))
    assert any("Y u" in line for line in found.lines() if line.startswith("yaw"))
    at = np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0]), np.array([0.0, 5.0, 0.0, 0.0, 0.0, 0.0])
    assert float(found.wrench(*at)[5]) == pytest.approx(0.6, rel=0.1)
    assert np.count_nonzero(found.coefficients) < 8


# The decision.


def predictions(errors):
    scores = [{"gyro.r": Score(0.0, float(e), 1.0, 1.0)} for e in errors]
    return [Prediction(f"block {i}", 5.0, {}, s, {"gyro.r": True}) for i, s in enumerate(scores)]


@pytest.mark.parametrize(
    ("now", "taken"),
    [
        ([0.5, 0.5, 0.5, 0.5], True),
        ([0.97, 0.97, 0.97, 0.97], False),  # better, but not by the margin
        ([0.2, 1.3, 0.7, 1.2], False),  # better on average, by chance
        ([1.5, 1.4, 1.6, 1.5], False),
        ([0.5, 0.5, 0.5, np.inf], False),
    ],
)
def test_it_is_taken_where_predictions_get_better_by_the_margin_and_by_more_than_chance(now, taken):
    made = decided(predictions([1.0] * 4), predictions(now))
    assert made.taken is taken and made.words.endswith("taken" if taken else "left out")
    if np.isfinite(now).all():
        assert made.errors["gyro.r"][0] == pytest.approx(1.0)


@pytest.mark.system
def test_tests_too_short_to_be_divided_are_refused_before_minutes_are_spent():
    t, u = axis_steps(VEHICLE, 0, 12.0)
    log = record(VEHICLE.model(), t, u, 12.0)
    with pytest.raises(IdentificationError, match="discrepancy: found 12 s of tests, .* or choose: --discrepancy off"):
        identify(VEHICLE, [log], free=FREE, options={"discrepancy": "auto"})
    with pytest.raises(ConfigError, match="discrepancy: found 'always', expected"):
        identify(VEHICLE, [log], free=FREE, options={"discrepancy": "always"})


# An earlier result.


@pytest.fixture(scope="module")
def earlier():
    return vehicle_from_dict(file_with(VEHICLE), "earlier.yaml")


@pytest.mark.system
def test_an_earlier_learned_wrench_stays_as_it_was_and_is_written_again(earlier, tmp_path):
    result = identify(VEHICLE, old=earlier)
    assert any("the learned wrench of earlier.yaml stays as it was" in line for line in result.findings)
    again = vehicle_from_dict(result.file(), "again.yaml")
    for a, b in zip(
        jax.tree.leaves(earlier.model().discrepancy), jax.tree.leaves(again.model().discrepancy), strict=True
    ):
        np.testing.assert_array_equal(a, b)
    loaded = Identification.load(result.save(tmp_path / "result.nc"))
    assert loaded.discrepancy == result.discrepancy
    for a, b in zip(jax.tree.leaves(result.model()), jax.tree.leaves(loaded.model()), strict=True):
        np.testing.assert_array_equal(a, b)


def test_with_other_parts_it_is_left_out(earlier):
    data = VEHICLE.to_dict()
    data["parts"].append({"name": "sonar", "mass": 1.0, "shape": {"box": [0.1, 0.1, 0.1]}})
    result = identify(vehicle_from_dict(data, "new.yaml"), old=earlier)
    assert result.discrepancy is None and result.model().discrepancy is None
    assert any("holds for its parts alone: left out" in line for line in result.findings)


@pytest.mark.slow
def test_predictions_of_a_vehicle_with_forces_that_its_model_lacks_err_half_as_much():
    """Sway and yaw, where the duct is missing; the other axes are predicted no worse by more than a tenth."""
    found = study("double_blueye")
    for component in ("velocity.v", "gyro.r"):
        assert found["learned"][component] < 0.5 * found["without"][component]
    assert all(rms < 1.1 * found["without"][component] for component, rms in found["learned"].items())
