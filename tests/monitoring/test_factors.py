"""Factors on a model, and the motion that the monitor follows with them."""

import numpy as np
import pytest

from rovtwin.core.flow import Environment
from rovtwin.core.numerics import jax, jnp
from rovtwin.monitoring.factors import Factors, changed
from rovtwin.monitoring.state import ERRORS, Motion, acceleration, linearised, stepped
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.physics.dynamics import acceleration as of_plant

VEHICLES = ("double_blueye", "bluerov2_heavy", "torpedo", "tilt_six")


def somewhere(rng):
    """A state with everything in it that is not zero, but for the gyro's bias."""
    q = rng.standard_normal(4)
    zero = jnp.zeros(3)
    return Motion(
        jnp.asarray([1.0, 2.0, 50.0]), jnp.asarray(q / np.linalg.norm(q)), jnp.asarray(0.5 * rng.standard_normal(6)),
        zero, zero, jnp.asarray(0.3 * rng.standard_normal(2)), zero,
    )  # fmt: skip


@pytest.mark.parametrize("name", VEHICLES)
def test_at_zero_it_moves_as_the_plant_does(name):
    model, rng = load_vehicle(name).model(), np.random.default_rng(1)
    x, thrust = somewhere(rng), jnp.asarray(rng.standard_normal(model.thrusters.count))
    ours = acceleration(changed(model, jnp.zeros(16 + model.thrusters.count)), model.inertia_inverse, x, thrust)
    water = Environment.calm(velocity=jnp.append(x.current, 0.0))
    theirs = of_plant(model, x.position, x.attitude, x.nu, model.thrusters.configuration @ thrust, water)
    np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("name", VEHICLES)
def test_added_mass_stays_positive_and_damping_takes_energy(name):
    vehicle, rng = load_vehicle(name), np.random.default_rng(2)
    model = vehicle.model()
    L = np.linalg.cholesky(Factors.of(model, vehicle.thruster_names, 0.5).covariance)
    for _ in range(20):
        other = changed(model, jnp.asarray(L @ rng.standard_normal(len(L))))
        assert np.linalg.eigvalsh(np.asarray(other.added_mass + other.added_mass.T)).min() > -1e-9
        assert np.linalg.eigvalsh(np.asarray(other.inertia + other.inertia.T)).min() > 0.0


@pytest.mark.system
@pytest.mark.parametrize("name", ["double_blueye", "tilt_six"])
def test_slopes_are_those_of_differences(name):
    model, rng = load_vehicle(name).model(), np.random.default_rng(3)
    p = 16 + model.thrusters.count
    x, thrust, h = somewhere(rng), jnp.asarray(rng.standard_normal(model.thrusters.count)), 0.02
    held = jnp.asarray(0.1 * rng.standard_normal(p))
    inverse = jnp.linalg.inv(changed(model, held).inertia)
    after, _, F, G = jax.jit(linearised, static_argnums=5)(model, held, inverse, x, thrust, h)

    @jax.jit
    def there(error, shift):
        other = changed(model, held + shift)
        return stepped(other, jnp.linalg.inv(other.inertia), x.moved(error), thrust, h)[0].away(after)

    def slope(of, size, step=1e-6):
        return np.stack([(of(step * e) - of(-step * e)) / (2 * step) for e in np.eye(size)], axis=1)

    np.testing.assert_allclose(F, slope(lambda e: np.asarray(there(e, jnp.zeros(p))), ERRORS), atol=2e-6)
    # The mass in M^-1 is differenced here, and is not inverted there.
    np.testing.assert_allclose(G, slope(lambda s: np.asarray(there(jnp.zeros(ERRORS), s)), p), atol=2e-6)


def test_a_state_and_back():
    x, error = somewhere(np.random.default_rng(4)), 1e-3 * np.arange(1.0, ERRORS + 1)
    np.testing.assert_allclose(x.moved(jnp.asarray(error)).away(x), error, atol=2e-7)
