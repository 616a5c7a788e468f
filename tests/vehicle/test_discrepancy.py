"""The learned wrench: no source of energy, zero where it must be, the prior far from its data, in and out of files."""

import equinox as eqx
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from tests.vehicle.discrepancies import block, file_with, random_part
from tests.vehicle.random_vehicles import build, seeds

from rovtwin.core.block import Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Command, Environment
from rovtwin.core.numerics import jax, jnp
from rovtwin.vehicle import load_vehicle, vehicle_from_dict
from rovtwin.vehicle.description.learned import discrepancy_from
from rovtwin.vehicle.description.schema import LearnedDiscrepancy
from rovtwin.vehicle.physics.discrepancy import discrepancy_variance, discrepancy_wrench, novelty
from rovtwin.vehicle.physics.dynamics import State, acceleration, damping_wrench, learned_wrench, rollout

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
T = np.eye(6)  # thrusters that push along every axis


def drawn(seed, of=("motion", "thrust"), count=4):
    rng = np.random.default_rng(seed)
    parts = [random_part(rng, AXES[i], of[i % len(of)]) for i in rng.permutation(6)[:count]]
    return discrepancy_from(LearnedDiscrepancy.model_validate(block(parts)), T, "drawn.yaml", 1.0)


@pytest.mark.system
@settings(max_examples=60, deadline=None)
@given(seeds)
def test_motion_and_damping_together_never_give_energy(seed):
    rng = np.random.default_rng(seed)
    model = build(seed)
    learned = drawn(seed, of=("motion",), count=6)
    nu = rng.normal(size=(200, 6)) * rng.choice([1e-4, 0.1, 1.0, 5.0], (200, 1)) * rng.integers(0, 2, (200, 6))

    power, scale = _powers(model, learned, jnp.asarray(nu))
    assert np.all(np.asarray(power) <= 1e-9 * (1.0 + np.asarray(scale)))


@jax.jit
def _powers(model, learned, nu):
    """nu . (tau_motion - D nu), and how large its terms are [W], shapes (n,)."""

    def one(nu):
        drag = damping_wrench(model, nu)
        return nu @ (discrepancy_wrench(learned, nu, jnp.zeros(6), drag) - drag), jnp.abs(nu) @ jnp.abs(drag)

    return jax.vmap(one)(nu)


@pytest.mark.system
def test_energy_is_really_taken_off_somewhere():
    """Else the test above would hold of a wrench that never pushes."""
    learned, nu = drawn(1, of=("motion",), count=6), np.random.default_rng(0).normal(size=(300, 6))
    free = jax.vmap(lambda v: v @ discrepancy_wrench(learned, v, jnp.zeros(6), 1e6 * v))(jnp.asarray(nu))
    held = jax.vmap(lambda v: v @ discrepancy_wrench(learned, v, jnp.zeros(6), 0.0 * v))(jnp.asarray(nu))
    assert np.sum(np.asarray(free) > 1e-3) > 50
    np.testing.assert_allclose(np.asarray(held), np.minimum(np.asarray(free), 0.0), atol=1e-9)


def test_no_motion_no_wrench_and_no_thrust_no_wrench_of_thrust():
    learned, zero = drawn(3), jnp.zeros(6)
    np.testing.assert_allclose(discrepancy_wrench(learned, zero, zero, zero), 0.0, atol=1e-12)
    nu, tau = jnp.asarray([0.4, -0.2, 0.1, 0.3, 0.2, -0.5]), jnp.asarray([5.0, -3.0, 4.0, 1.0, 1.0, -2.0])
    drag = 1e6 * nu  # so much that no energy is taken off
    without = discrepancy_wrench(learned, nu, zero, drag)
    of_thrust = np.asarray(jnp.sum(learned.along * (1.0 - learned.motion), axis=1))
    np.testing.assert_allclose(np.asarray(without)[of_thrust > 0], 0.0, atol=1e-12)
    assert np.any(np.abs(np.asarray(discrepancy_wrench(learned, nu, tau, drag) - without)) > 1e-3)


def test_far_from_its_data_it_says_nothing_and_knows_that():
    learned = drawn(5)
    far, thrust = jnp.full(6, 40.0), jnp.full(6, 400.0)
    np.testing.assert_allclose(discrepancy_wrench(learned, far, thrust, 1e6 * far), 0.0, atol=1e-9)
    prior = np.asarray(jnp.sum(learned.along * learned.std**2, axis=1))
    np.testing.assert_allclose(discrepancy_variance(learned, far, thrust), prior, rtol=1e-9)
    assert float(novelty(learned, far, thrust)) == pytest.approx(1.0)
    assert float(novelty(learned, jnp.zeros(6), jnp.zeros(6))) == pytest.approx(0.0, abs=1e-6)


def test_mean_and_variance_are_those_of_a_gaussian_process():
    """Against the textbook's regression on the same readings (Rasmussen and Williams 2006, eq. 2.25 and 2.26)."""
    rng, axis = np.random.default_rng(2), 0
    part = random_part(rng, "surge", "motion", m=6)
    inverse = np.array([0.0 if length is None else 1.0 / length for length in part["lengths"]])
    X = np.array(part["centres"])  # readings at the centres, so that m functions hold all there is
    y, noise = rng.normal(size=6), 0.3

    def k(a, b):
        a, b = a[:, :6] * inverse[:6], b[:, :6] * inverse[:6]
        own = np.exp(-0.5 * np.sum(a**2, axis=1)), np.exp(-0.5 * np.sum(b**2, axis=1))
        return part["std"] ** 2 * (np.exp(-0.5 * np.sum((a[:, None] - b[None]) ** 2, axis=2)) - np.outer(*own))

    K, z = k(X, X), np.array([[0.3, -0.1, 0.2, 0.4, 0.0, -0.3]])
    mean = k(z, X) @ np.linalg.solve(K + noise**2 * np.eye(6), y)
    variance = k(z, z) - k(z, X) @ np.linalg.solve(K + noise**2 * np.eye(6), k(X, z))
    L = np.linalg.cholesky(K)  # features L^T w: y = L w + noise, w ~ N(0, 1)
    S = np.linalg.inv(np.eye(6) + L.T @ L / noise**2)
    found = part | {"weights": (S @ L.T @ y / noise**2).tolist(), "covariance": S.tolist()}
    learned = discrepancy_from(LearnedDiscrepancy.model_validate(block([found])), T, "", 1.0)
    nu = jnp.asarray(z[0, :6])
    assert float(discrepancy_wrench(learned, nu, jnp.zeros(6), 1e6 * nu)[axis]) == pytest.approx(mean[0], rel=1e-5)
    assert float(discrepancy_variance(learned, nu, jnp.zeros(6))[axis]) == pytest.approx(variance[0, 0], rel=1e-5)


@pytest.mark.system
def test_it_is_in_the_equations_of_motion_under_gradients_and_batches():
    vehicle = vehicle_from_dict(file_with(load_vehicle("double_blueye")))
    model = vehicle.model()
    bare = model.replace(discrepancy=None)
    nu, tau = jnp.asarray([0.3, 0.2, -0.1, 0.1, 0.2, 0.3]), jnp.asarray([10.0, 5.0, 0.0, 0.0, 0.0, 1.0])
    q = jnp.array([1.0, 0.0, 0.0, 0.0])
    calm = Environment.calm()
    gained = acceleration(model, jnp.zeros(3), q, nu, tau, calm) - acceleration(bare, jnp.zeros(3), q, nu, tau, calm)
    learned = learned_wrench(model, nu, tau)
    np.testing.assert_allclose(model.inertia @ gained, learned, atol=1e-9)
    assert np.abs(np.asarray(learned)).max() > 1e-2
    assert learned_wrench(bare, nu, tau) == 0.0

    def distance(model, u):
        state = State.at(model, Start.at([0.0, 0.0, 5.0]))
        path = rollout(model, state, Command(jnp.tile(u, (50, 1))), calm, 0.02)
        return path.position[-1, 0]

    u = jnp.full(model.thrusters.count, 0.4)
    slope = eqx.filter_grad(distance)(model, u).discrepancy
    assert slope is not None
    assert np.isfinite(np.asarray(slope.coefficients)).all() and np.abs(np.asarray(slope.coefficients)).max() > 0.0
    both = jax.vmap(distance, in_axes=(None, 0))(model, jnp.stack([u, 0.5 * u]))
    assert float(both[0]) == pytest.approx(float(distance(model, u)), rel=1e-9)


def test_a_file_keeps_it(tmp_path):
    data = file_with(load_vehicle("double_blueye"))
    path = tmp_path / "identified.yaml"
    path.write_text(yaml.safe_dump(data))
    first = load_vehicle(path)
    again = vehicle_from_dict(first.to_dict())
    for a, b in zip(jax.tree.leaves(first.model()), jax.tree.leaves(again.model()), strict=True):
        np.testing.assert_array_equal(a, b)
    assert first.model().discrepancy is not None and load_vehicle("double_blueye").model().discrepancy is None


def test_forces_of_motion_grow_with_the_density_of_the_water():
    vehicle = vehicle_from_dict(file_with(load_vehicle("double_blueye"), of=("motion",)))
    here, salt = vehicle.model(), vehicle.model(water_density=1.03 * vehicle.assembly.density)
    np.testing.assert_allclose(salt.discrepancy.coefficients, 1.03 * here.discrepancy.coefficients, rtol=1e-9)


WRONG = [
    (lambda p: p["lengths"].pop(), "lengths: found 11"),
    (lambda p: p["weights"].pop(), "found 4 weights and 5 centres, expected as many"),
    (lambda p: p["covariance"].pop(), "covariance: expected 5 rows of 5"),
    (lambda p: p.update(axis="sideways"), "axis: found 'sideways', expected"),
    (lambda p: p["covariance"][0].__setitem__(0, 3.0), "covariance: found variances from .* expected 0 to 1"),
    (lambda p: p["lengths"].__setitem__(6, 2.0), r"lengths\[6\]: found 2, expected null: a part of motion is no"),
    (
        lambda p: (p.update(of="thrust"), p["lengths"].__setitem__(10, 2.0)),
        r"lengths\[10\]: found 2, for thrust in pitch, but no thruster of this vehicle pushes",
    ),
]


@pytest.mark.parametrize(("change", "words"), WRONG, ids=[words[:20] for _, words in WRONG])
def test_what_does_not_fit_the_vehicle_is_refused_in_words(change, words):
    data = file_with(load_vehicle("double_blueye"), of=("motion",))
    change(data["identified"]["discrepancy"]["parts"][0])
    with pytest.raises(ConfigError, match=words):
        vehicle_from_dict(data)
