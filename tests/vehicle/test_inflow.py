"""Thrust that an inflow takes."""

import dataclasses

import numpy as np
import pytest

from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Environment
from rovtwin.core.numerics import jax, jnp
from rovtwin.monitoring.state import Motion
from rovtwin.monitoring.state import acceleration as followed
from rovtwin.vehicle import load_vehicle, vehicle_from_dict
from rovtwin.vehicle.analysis.stability import steady_speed
from rovtwin.vehicle.physics.dynamics import State, acceleration, damping_wrench, inflow_of, rollout
from rovtwin.vehicle.physics.thrusters import inflow_damping, inflow_wrench

LOSS = 0.4  # [s/m]


def losing(name, loss=LOSS):
    """A vehicle of the library whose thrusters all lose that much."""

    def changed(x):
        if isinstance(x, list):
            return [changed(one) for one in x]
        if not isinstance(x, dict):
            return x
        found = {key: changed(value) for key, value in x.items()}
        return found | {"inflow_loss": loss} if "direction" in found and {"force", "curve"} & set(found) else found

    data = changed(load_vehicle(name).to_dict())
    return vehicle_from_dict(data, "losing").model()


@pytest.fixture(scope="module")
def model():
    return losing("bluerov2_heavy")


def test_without_a_loss_nothing_is_computed():
    assert load_vehicle("bluerov2_heavy").model().thrusters.inflow_loss is None


def test_at_full_force_it_is_the_stated_share_and_below_it_goes_with_the_root(model):
    full = np.asarray(model.thrusters.force_ahead)
    np.testing.assert_allclose(inflow_damping(model.thrusters, full), LOSS * full, rtol=1e-3)
    quarter = inflow_damping(model.thrusters, -0.25 * np.asarray(model.thrusters.force_astern))
    np.testing.assert_allclose(quarter, 0.5 * LOSS * np.asarray(model.thrusters.force_astern), rtol=5e-3)


@pytest.mark.parametrize("seed", range(5))
def test_it_never_gives_energy(model, seed):
    rng = np.random.default_rng(seed)
    nu, force = rng.normal(size=6), 40.0 * rng.uniform(-1, 1, model.thrusters.count)
    lost = inflow_wrench(model.thrusters.configuration, inflow_damping(model.thrusters, force), nu)
    assert nu @ np.asarray(lost) < 0.0


def test_its_slope_is_finite_at_no_force(model):
    slope = jax.jacfwd(lambda f: inflow_damping(model.thrusters, f))(jnp.zeros(model.thrusters.count))
    assert np.isfinite(slope).all()


@pytest.mark.system
@pytest.mark.parametrize("name", ["double_blueye", "bluerov2_heavy", "torpedo"])
def test_at_the_top_speed_thrust_less_what_is_lost_is_drag(name):
    model, exact = losing(name), load_vehicle(name).model()
    lever = np.asarray(model.thrusters.configuration)[0]
    ahead, astern = np.asarray(model.thrusters.force_ahead), np.asarray(model.thrusters.force_astern)
    thrust = np.where(lever > 0.0, ahead, np.where(lever < 0.0, -astern, 0.0))
    force = float(lever @ thrust)
    top = steady_speed(model, 0, force)
    assert top < 0.97 * steady_speed(exact, 0, force)
    nu, still = top * jnp.eye(6)[0], jnp.array([1.0, 0.0, 0.0, 0.0])
    drag = damping_wrench(model, nu)[0]
    lost = inflow_wrench(model.thrusters.configuration, inflow_damping(model.thrusters, thrust), nu)[0]
    assert force + float(lost) == pytest.approx(float(drag), rel=1e-3)
    # And so the plant has it: what it feels with the inflow differs from without by exactly this.
    tau, calm = model.thrusters.configuration @ thrust, Environment.calm()
    inflow = inflow_of(model, jnp.asarray(thrust))
    feels = [acceleration(model, jnp.array([0.0, 0.0, 10.0]), still, nu, tau, calm, inflow=i) for i in (inflow, None)]
    np.testing.assert_allclose((model.inertia @ (feels[0] - feels[1]))[0], lost, rtol=1e-9)


def test_the_monitor_has_it(model):
    """Its own equations of motion agree with the plant's."""
    rng = np.random.default_rng(2)
    nu, thrust = jnp.asarray(0.5 * rng.normal(size=6)), jnp.asarray(20.0 * rng.uniform(-1, 1, model.thrusters.count))
    q = jnp.array([1.0, 0.0, 0.0, 0.0])
    x = dataclasses.replace(Motion.at(jnp.array([0.0, 0.0, 10.0]), q), nu=nu)
    tau, calm = model.thrusters.configuration @ thrust, Environment.calm()
    plant = acceleration(model, x.position, q, nu, tau, calm, inflow=inflow_of(model, thrust))
    np.testing.assert_allclose(followed(model, model.inertia_inverse, x, thrust), plant, rtol=1e-9, atol=1e-12)


@pytest.mark.system
def test_the_twin_is_slower_in_a_short_push(model):
    sound = load_vehicle("bluerov2_heavy").model()
    u = jnp.sign(jnp.asarray(np.round(sound.thrusters.configuration[0], 6)))
    after = [
        rollout(m, State.at(m, Start.at([0.0, 0.0, 10.0])), Command(jnp.tile(u, (150, 1))), Environment.calm(), 0.01)
        for m in (model, sound)
    ]
    slow, fast = (float(path.nu[-1, 0]) for path in after)
    assert 0.5 * fast < slow < 0.97 * fast
