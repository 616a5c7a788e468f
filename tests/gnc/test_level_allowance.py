"""A vehicle in the closed loop that takes a force for a current, and then meets the current."""

import numpy as np
import pytest

from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Environment, Estimate, Reference
from rovtwin.core.frames import euler_from_quaternion, rotation_from_euler
from rovtwin.core.numerics import as_array, jax, jnp
from rovtwin.gnc.control.tracking import Tracking
from rovtwin.gnc.interfaces import ControlInput
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.physics.dynamics import State, damping_wrench, plant_step
from rovtwin.vehicle.physics.thrusters import command_for_force

DT, LEARNS = 0.02, 2.0  # [s]; the observer knows the disturbance by so much later
REAL = 60.0  # [s]


@pytest.fixture(scope="module")
def bluerov2():
    return load_vehicle("bluerov2").model()


def held(model, current, force, seconds):
    """Path (n, 6) of eta of a vehicle that is to keep its place in a current and beside a force, both along north."""
    control, allocate = Tracking.of(model), jnp.linalg.pinv(model.thrusters.configuration)
    place = Reference.from_euler(jnp.array([0.0, 0.0, 3.0, 0.0, 0.0, 0.0]), jnp.zeros(6), jnp.zeros(6))

    def tick(carry, now):
        memory, state, bias = carry
        flow, push = now[0] * jnp.eye(3)[0], now[1] * jnp.eye(3)[0]
        eta = jnp.concatenate([state.position, euler_from_quaternion(state.attitude)])
        R = rotation_from_euler(eta[3:])
        through = state.nu.at[:3].add(-R.T @ flow)
        disturbance = R @ (damping_wrench(model, state.nu) - damping_wrench(model, through))[:3] + push
        bias = bias + (1.0 - jnp.exp(-DT / LEARNS)) * (disturbance - bias)
        unsure = 1e-4 * jnp.eye(12), jnp.zeros(1), jnp.zeros(1)
        estimate = Estimate.from_euler(eta, state.nu, jnp.concatenate([bias, jnp.zeros(3)]), *unsure)
        memory, wrench = control.step(memory, ControlInput(estimate, place, jnp.zeros(6)), DT)
        command = Command(command_for_force(model.thrusters, allocate @ wrench.tau))
        water = Environment.calm(velocity=flow, wrench=jnp.concatenate([R.T @ push, jnp.zeros(3)]))
        return (memory, plant_step(model, state, command, water, DT), bias), eta

    start = control.init(None, None), State.at(model, Start.at([0.0, 0.0, 3.0])), jnp.zeros(3)
    steps = round(seconds / DT)
    inputs = jnp.stack([as_array(current)[:steps], as_array(force)[:steps]], axis=1)
    return np.asarray(jax.jit(lambda s: jax.lax.scan(tick, s, inputs)[1])(start))


@pytest.mark.system
def test_a_force_that_looks_like_a_current_is_stemmed_and_the_current_itself_given_way_to(bluerov2):
    """A tether pulls as hard as 0.8 m/s of water would, 1.6 times what it stays level in; then it is that water."""
    t = DT * np.arange(round(100.0 / DT))
    rises = np.clip((t - REAL) / 3.0, 0.0, 1.0)
    drag = float(damping_wrench(bluerov2, jnp.zeros(6).at[0].set(0.8))[0])
    eta = held(bluerov2, -0.8 * rises, -drag * np.clip(t / 20.0, 0.0, 1.0) * (1.0 - rises), 100.0)
    pulled, late = eta[t < REAL], eta[(t > REAL - 5.0) & (t < REAL)]
    assert np.degrees(np.abs(pulled[:, 3:5]).max()) < 3.0
    assert np.ptp(late[:, 0]) < 0.1, "it holds; it drifted at 0.3 m/s"
    tilt = np.degrees(np.hypot(*eta[:, 3:5].T))
    assert tilt.max() < 40.0, "27 of one that is allowed nothing, 53 where it was taken back slowly"
