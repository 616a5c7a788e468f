"""Vehicles whose vertical thrusters tilt them, and those whose vertical thrusters have heave and roll to make."""

import dataclasses

import equinox as eqx
import numpy as np
import pytest
from tests.gnc.flying import DT, aft, estimate_of, thirty_kg, truth_of

from rovtwin.core.block import Start
from rovtwin.core.flow import Environment, Reference
from rovtwin.core.frames import quaternion_from_euler
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.allocation.prioritised import PriorityAllocation
from rovtwin.gnc.allocation.shared_thrust import SharedThrust
from rovtwin.gnc.control.heave_feedback import HeaveFeedback
from rovtwin.gnc.control.tracking import Tracking
from rovtwin.gnc.interfaces import AllocationInput, ControlInput
from rovtwin.gnc.scales import VehicleScales
from rovtwin.vehicle.analysis.stability import by_products, tilt_of_thrust
from rovtwin.vehicle.physics.actuation import wrench_of_forces
from rovtwin.vehicle.physics.dynamics import State, plant_step


@eqx.filter_jit
def flown(model, control, allocation, start, speed, depth=3.0, time=40.0):
    """Truth (n, 12) of a leg due north at a speed, with perfect feedback of the state."""

    def tick(carry, t):
        integral, memory, state = carry
        truth = truth_of(state)
        north, zero = speed * t, jnp.zeros(5)
        reference = Reference.from_euler(
            jnp.zeros(6).at[0].set(north).at[2].set(depth), jnp.concatenate([speed[None], zero]), jnp.zeros(6)
        )
        given = ControlInput(estimate_of(truth[:6], truth[6:]), reference, jnp.zeros(6))
        integral, wrench = control.step(integral, given, DT)
        memory, got = allocation.step(memory, AllocationInput(wrench.tau, jnp.ones(model.thrusters.count)), DT)
        return (integral, memory, plant_step(model, state, got.command, Environment.calm(), DT)), truth

    begin = (control.init(None, None), allocation.init(None, None), start)
    return jax.lax.scan(tick, begin, DT * jnp.arange(int(time / DT)))[1]


def leg(model, control, speed, pitch=0.05):
    attitude = quaternion_from_euler(jnp.array([0.0, pitch, 0.0]))
    start = State.at(model, Start(jnp.array([0.0, 0.0, 3.0]), attitude, jnp.zeros(6)))
    return np.asarray(flown(model, control, PriorityAllocation.of(model), start, jnp.asarray(speed)))


def each_for_itself(model):
    """The controller whose depth loop knows of no tilt."""
    untilted = Tracking.of(thirty_kg())
    return dataclasses.replace(Tracking.of(model), tilting=None, K_p=untilted.K_p, K_d=untilted.K_d)


@pytest.mark.system
@pytest.mark.parametrize("share", [-0.9, 0.3, 0.9])
def test_a_leg_is_flown_level_though_heave_thrust_pitches(share):
    model = aft(0.2)
    speed = share * float(min(VehicleScales.of(model).level_speed[0], VehicleScales.of(model).top[0]))
    late = leg(model, Tracking.of(model), speed)[-500:]
    assert np.abs(np.degrees(late[:, 4])).max() < 4.0
    assert np.degrees(np.ptp(late[:, 4])) < 1.0
    assert np.abs(late[:, 2] - 3.0).max() < 0.02


@pytest.mark.system
def test_depth_control_that_knows_of_no_tilt_stands_on_its_nose():
    """What the feedback is for: without it the same vehicle comes to rest at 43 degrees."""
    model = aft(0.2)
    speed = 0.9 * float(VehicleScales.of(model).top[0])
    assert np.abs(np.degrees(leg(model, each_for_itself(model), speed)[-500:, 4])).max() > 20.0


@pytest.mark.system
def test_a_constant_lift_costs_little_depth():
    """Buoyancy pitches it by the thrust that holds it down; that tilt is expected, not fought."""
    model = aft(0.15).replace(buoyancy=297.3)
    late = leg(model, Tracking.of(model), 0.15)[-500:]
    assert np.abs(late[:, 2] - 3.0).max() < 0.02
    assert np.abs(late[:, 4]).min() > 0.02  # it is tilted: the test is one of the tilt at rest


def test_where_heave_does_not_tilt_nothing_is_fed_back():
    assert HeaveFeedback.of(thirty_kg()) is None
    assert HeaveFeedback.of(aft(0.15)) is not None


def test_a_bandwidth_that_is_given_counts():
    own, quick = HeaveFeedback.of(aft(0.15)), HeaveFeedback.of(aft(0.15), 1.6, 1.0)
    slow = float(VehicleScales.of(aft(0.15)).bandwidth[2])
    np.testing.assert_allclose(quick.gains[:, 0], own.gains[:, 0] * (1.6 / slow) ** 2, rtol=0.05)
    assert np.all(HeaveFeedback.of(aft(0.15), None, 2.0).gains[:, 1] > 1.1 * own.gains[:, 1])


def test_by_products_are_levers_about_cg_of_what_nothing_balances():
    np.testing.assert_allclose(wrench_of_forces(aft(0.15))[4], [0.0, 0.0, 0.15], atol=1e-9)
    lever = by_products(aft(0.15))
    np.testing.assert_allclose(lever, [[0, 0, 0], [-0.03, 0.0, 0.15]], atol=1e-9)  # surge acts 30 mm above CG
    tilt = tilt_of_thrust(aft(0.15))
    assert tilt[1, 2] == pytest.approx(np.arctan(0.15 * 22.0 / (294.3 * 0.03)), rel=1e-6)


def test_a_dive_is_no_faster_than_its_tilt_allows():
    steep, level = VehicleScales.of(aft(0.3)).dive_speed, VehicleScales.of(thirty_kg()).dive_speed
    assert 0.0 < steep < 0.7 * level


class TestSharedThrust:
    """Two vertical thrusters make heave and roll: 22 N, 6.2 N m."""

    LIMITS = SharedThrust.of(thirty_kg())

    def cut(self, heave, roll):
        return np.asarray(self.LIMITS.cut(jnp.array([0.0, 0.0, heave, roll, 0.0, 0.0])))[2:4]

    def test_heave_is_whole_where_no_roll_is_asked_for(self):
        np.testing.assert_allclose(self.cut(-40.0, 0.0), [-22.0, 0.0])

    def test_roll_has_what_heave_leaves(self):
        np.testing.assert_allclose(self.cut(-40.0, 9.0), [-22.0, 0.0], atol=1e-9)
        np.testing.assert_allclose(self.cut(16.5, -9.0), [16.5, -0.25 * 6.16])
        np.testing.assert_allclose(self.cut(5.5, 3.0), [5.5, 3.0])

    def test_what_is_asked_for_together_can_be_made(self):
        """Without sway: it was thrown sideways to make a moment in roll with thrusters 2 cm above CO."""
        T = np.asarray(thirty_kg().thrusters.configuration).copy()
        T[3] -= 0.02 * T[1]
        model = thirty_kg(T=T)
        allocation = PriorityAllocation.of(model, slew=np.inf)
        tau = SharedThrust.of(model).cut(jnp.array([0.0, 0.0, 22.0, 4.0, 0.0, 0.0]))
        _, got = allocation.step(allocation.init(None, None), AllocationInput(tau, jnp.ones(6)), DT)
        np.testing.assert_allclose(got.made, tau, atol=0.1)

    def test_thrusters_of_their_own_share_nothing(self):
        T = np.c_[np.asarray(thirty_kg().thrusters.configuration), np.eye(6)[:, 3]]
        force = jnp.array([10.0, 5.0, 11.0, 10.0, 5.0, 11.0, 8.0])
        model = thirty_kg(
            thrusters=dataclasses.replace(thirty_kg(T=T).thrusters, force_ahead=force, force_astern=force)
        )
        limits = SharedThrust.of(model)
        assert not np.asarray(limits.shared).any()
        np.testing.assert_allclose(limits.cut(jnp.array([0.0, 0, 22.0, 8.0, 0, 0]))[2:4], [22.0, 8.0])
