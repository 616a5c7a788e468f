"""Attitude is a quaternion from estimate to wrench: a pitch of 90 degrees is one like any other."""

import dataclasses

import numpy as np
import pytest
from tests.gnc.flying import DT, thirty_kg

from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Environment, Estimate, Reference, Setpoint, Slot
from rovtwin.core.frames import heading_of, level_attitude, quaternion_exp, quaternion_multiply, rotation_error
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.control.reference_model import ReferenceModel
from rovtwin.gnc.control.tracking import PathReference, Tracking
from rovtwin.gnc.guard import nothing
from rovtwin.gnc.interfaces import ControlInput, ObserverInput
from rovtwin.gnc.navigation.filter import NavigationFilter
from rovtwin.gnc.navigation.tuning import Tuning
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.physics.dynamics import State, plant_step
from rovtwin.vehicle.physics.thrusters import command_for_force, thrusters_from

HEADING = 0.9
PITCHES = np.radians(np.linspace(89.9, 90.1, 41))
NOTHING = 1e-4 * jnp.eye(12), jnp.zeros(1), jnp.zeros(1)


def pitched(angle):
    """Heading HEADING, and then a pitch [rad] that may go beyond 90 degrees."""
    return quaternion_multiply(level_attitude(HEADING), quaternion_exp(jnp.zeros(3).at[1].set(angle)))


def estimate_at(angle):
    """Of a vehicle that moves along all axes, in what looks like a current."""
    nu, bias = jnp.array([0.2, -0.1, 0.1, 0.05, 0.2, -0.1]), jnp.array([3.0, -2.0, 1.0, 0.0, 0.0, 0.0])
    return Estimate(jnp.array([1.0, 2.0, 3.0]), pitched(angle), nu, bias, *NOTHING)


def reference_at(angle):
    place, three = jnp.array([1.3, 1.8, 3.2]), jnp.zeros(3)
    return Reference(place, pitched(angle), three.at[0].set(0.2), three.at[1].set(0.1), three, three)


def neutral():
    """A vehicle that nothing rights, with a thruster each way along and about every axis."""
    T = jnp.eye(6)
    thrusters = thrusters_from(T, jnp.array([30.0, 30.0, 30.0, 6.0, 6.0, 6.0]), time_constant=jnp.full(6, 0.1))
    return thirty_kg(
        T=np.eye(6),
        thrusters=thrusters,
        center_of_gravity=[0.0] * 3,
        rigid_body_mass=np.diag([30.0] * 3 + [2.83, 0.9, 3.11]),
    )


@pytest.fixture(scope="module")
def wrench():
    control = Tracking.of(load_vehicle("bluerov2_heavy").model())
    memory = control.init(None, None)

    def tau(angle):
        given = ControlInput(estimate_at(angle), reference_at(1.2), jnp.zeros(6))
        return control.step(memory, given, DT)[1].tau

    return jax.jit(tau)


def test_the_wrench_is_continuous_through_a_pitch_of_ninety_degrees(wrench):
    tau = np.stack([wrench(angle) for angle in PITCHES])
    steps = np.abs(np.diff(tau, axis=0))
    assert np.isfinite(tau).all()
    # Every step is as large as the next one: what turns round gives one that is not.
    assert np.all(steps.max(axis=0) < 1.5 * np.median(steps, axis=0) + 1e-6)


@pytest.mark.system
def test_the_wrench_has_a_gradient_at_ninety_degrees(wrench):
    h, upright = 1e-5, 0.5 * np.pi
    slope = jax.jacobian(wrench)(upright)
    np.testing.assert_allclose(slope, (wrench(upright + h) - wrench(upright - h)) / (2 * h), rtol=1e-4, atol=1e-4)


def test_a_reference_turns_over_as_it_turns_level():
    """Heading, roll and pitch of Euler angles would each jump by half a turn on the way."""
    model = ReferenceModel.thesis()
    zero, no = jnp.zeros((), int), jnp.asarray(False)
    asked = Setpoint(jnp.zeros(3), pitched(2.5), jnp.zeros(6), jnp.zeros(3), jnp.zeros(3), no, zero, zero, zero)
    begin = model.init(None, Start(jnp.zeros(3), pitched(0.0), jnp.zeros(6)))
    _, path = jax.lax.scan(lambda m, _: model.step(m, asked, DT), begin, None, length=400)
    np.testing.assert_allclose(heading_of(path.attitude), HEADING, atol=1e-9)
    rate = np.asarray(path.angular_velocity)
    np.testing.assert_allclose(rate[:, [0, 2]], 0.0, atol=1e-9)
    assert np.abs(np.diff(rate[:, 1])).max() < 1.5**2 * 2.5 * DT
    np.testing.assert_allclose(rotation_error(asked.attitude, path.attitude[-1]), 0.0, atol=0.01)


@pytest.mark.system
def test_a_vehicle_that_nothing_rights_is_turned_beyond_ninety_degrees_and_kept_there():
    model, aim = neutral(), np.radians(120.0)
    reference, control = PathReference.of(model), Tracking.of(model)
    zero, no = jnp.zeros((), int), jnp.asarray(False)
    place = jnp.array([0.0, 0.0, 3.0])
    asked = Setpoint(place, pitched(aim), jnp.zeros(6), place, place, no, zero, zero, zero)
    start = Start(place, pitched(0.0), jnp.zeros(6))

    def tick(carry, _):
        path, memory, state = carry
        path, now = reference.step(path, asked, DT)
        estimate = Estimate(state.position, state.attitude, state.nu, jnp.zeros(6), *NOTHING)
        memory, wrench = control.step(memory, ControlInput(estimate, now, jnp.zeros(6)), DT)
        command = Command(command_for_force(model.thrusters, wrench.tau))
        return (path, memory, plant_step(model, state, command, Environment.calm(), DT)), (state, wrench.tau)

    begin = reference.init(None, start), control.init(None, start), State.at(model, start)
    _, (states, tau) = jax.lax.scan(tick, begin, None, length=3000)
    pitch = jax.vmap(lambda q: rotation_error(q, pitched(0.0)))(states.attitude)
    assert pitch[:, 1].max() > aim - 0.02 and np.abs(pitch[:, [0, 2]]).max() < 0.01
    np.testing.assert_allclose(pitch[-1], [0.0, aim, 0.0], atol=0.01)
    upright = np.argmax(pitch[:, 1] > 0.5 * np.pi)
    assert np.abs(np.diff(tau[upright - 5 : upright + 5], axis=0)).max() < 0.1  # a heading turned round: 6 N m
    np.testing.assert_allclose(states.position[-1], place, atol=0.05)


@pytest.mark.system
def test_the_filter_is_as_sure_of_an_upright_vehicle_as_of_a_level_one():
    """By Euler angles its covariance was 1e33 there."""
    model = load_vehicle("bluerov2_heavy").model()
    observer = NavigationFilter(model, Tuning.of(model))
    command, none = Command(jnp.zeros(model.thrusters.count)), {"pressure": Slot.empty(1, 1)}
    for angle in (0.0, 0.5 * np.pi):
        start = Start(jnp.array([0.0, 0.0, 3.0]), pitched(angle), jnp.zeros(6))
        _, estimate = observer.step(observer.init(None, start), ObserverInput(none, command), DT)
        turns = np.asarray(estimate.covariance)[3:6, 3:6]
        assert np.isfinite(turns).all() and np.abs(turns).max() < 0.1
        np.testing.assert_allclose(rotation_error(estimate.attitude, pitched(angle)), 0.0, atol=1e-3)


def test_nothing_is_zero_and_level():
    none = nothing(dataclasses.replace(estimate_at(0.3), nu=jnp.full(6, jnp.nan)))
    assert all(np.all(np.asarray(leaf) == 0.0) for leaf in (none.position, none.nu, none.covariance))
    np.testing.assert_array_equal(none.attitude, [1.0, 0.0, 0.0, 0.0])
