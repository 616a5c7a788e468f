"""Required against available force: known answers, and the verdict's limits."""

import numpy as np
import pytest
from tests.simulation.helper import vehicle

from rovtwin.core.numerics import jax, jnp
from rovtwin.runs.feasibility.station_keeping import holding, stemmed, thrust_share
from rovtwin.simulation.environment.airy import AirySea
from rovtwin.simulation.environment.current import ConstantCurrent, ShearedCurrent
from rovtwin.simulation.environment.sea import SeaState
from rovtwin.simulation.environment.waves import ThesisWaves
from rovtwin.simulation.environment.world import World
from rovtwin.vehicle.physics.model import GRAVITY
from rovtwin.vehicle.physics.thrusters import thrusters_from

KEY = jax.random.key(1)
PLACE = (0.0, 0.0, 3.0)
NONE = np.zeros((6, 6))
ALL_AXES = thrusters_from(jnp.eye(6), jnp.full(6, 10.0))
# 6.5 u + 159 u^2 = 10 N, and the flow that 10 N stand up to.
TOP_SPEED = (-6.5 + np.sqrt(6.5**2 + 4 * 159 * 10)) / (2 * 159)


def test_in_a_regular_wave_it_is_froude_krylov_and_added_mass():
    omega, a = 1.0, 0.05
    k = omega**2 / GRAVITY
    sea = AirySea([a], [omega], [k], [0.0])
    model = vehicle(linear_damping_ahead=NONE, quadratic_damping_ahead=NONE)
    found = holding(model, World(waves=sea), KEY, PLACE, 0.0, 2 * np.pi * 20, 0.05)
    at_depth = a * np.exp(-3 * k) * omega**2 / np.sqrt(2)
    force = np.sqrt((found.required[:, :3] ** 2).mean(0))
    inertia = float(model.displaced_mass) + np.diag(model.added_mass)[[0, 2]]
    np.testing.assert_allclose(force[[0, 2]], at_depth * inertia, rtol=0.01)
    assert found.sweep == pytest.approx(a * np.exp(-3 * k) / np.sqrt(2) * np.ones(2), rel=1e-6)
    assert found.mean_flow[0] == pytest.approx(a**2 * omega * k * np.exp(-6 * k), rel=1e-6)
    assert found.verdict == "holds" and found.available == pytest.approx(10.0)


@pytest.mark.parametrize("heading", [0.0, np.pi])
def test_in_a_current_it_is_the_drag(heading):
    found = holding(vehicle(), World(ConstantCurrent([0.2, 0.0, 0.0])), KEY, PLACE, heading, 10.0)
    drag = 6.5 * 0.2 + 159 * 0.2**2
    sign = -1.0 if heading == 0.0 else 1.0
    np.testing.assert_allclose(found.required[:, 0], sign * drag, rtol=1e-9)
    assert found.mean_required[0] == pytest.approx(sign * drag)
    assert found.mean_share == pytest.approx(drag / 10.0, rel=1e-6) and found.verdict == "holds" and found.drift == 0.0


def test_a_current_beyond_its_thrust_carries_it_off():
    found = holding(vehicle(), World(ConstantCurrent([0.5, 0.0, 0.0])), KEY, PLACE, 0.0, 10.0)
    assert found.verdict == "drifts"
    assert found.drift == pytest.approx(0.5 - TOP_SPEED, abs=0.005)


def test_what_counts_is_the_current_at_the_depth():
    sheared = World(ShearedCurrent([0.0, 5.0], [[1.0, 0, 0], [0.0, 0, 0]]))
    high, low = (holding(vehicle(), sheared, KEY, (0.0, 0.0, z), 0.0, 10.0) for z in (1.0, 4.5))
    assert (high.verdict, low.verdict) == ("drifts", "holds")


def test_waves_beyond_its_thrust_sweep_it():
    sea = AirySea.of(SeaState.of(1.5, zero_crossing_period=5.7), count=16)
    found = holding(vehicle(), World(waves=sea), KEY, PLACE, 0.0, 120.0)
    assert found.verdict == "swept" and found.mean_share < 0.2 < 1.0 < np.percentile(found.share, 99)
    assert 0.1 < found.sweep[0] < 0.5


def test_the_force_of_the_thesis_is_required_as_it_is():
    waves = ThesisWaves(4.1, 8.7)
    found = holding(vehicle(), World(waves=waves), KEY, PLACE, 0.0)
    assert np.sqrt((found.required[:, 0] ** 2).mean()) == pytest.approx(float(waves.rms()), rel=0.15)
    assert not found.sweep.any() and found.verdict == "holds"


@pytest.mark.system
def test_a_flow_that_tips_it_over_is_none_it_can_hold():
    """Heave added mass of 400 kg against a righting moment of 5.9 N m: pitch goes at 0.12 m/s."""
    strong = vehicle(
        added_mass=np.diag([9.0, 13.0, 400.0, 2.0, 0.7, 0.9]),
        thrusters=thrusters_from(jnp.eye(6), jnp.full(6, 1000.0)),
    )
    found = holding(strong, World(ConstantCurrent([0.5, 0.0, 0.0])), KEY, PLACE, 0.0, 10.0)
    assert found.verdict == "capsizes" and found.upright < 0.5
    assert found.upright == holding(strong, World(), KEY, PLACE, 0.0, 1.0).upright, "the hull is alike both ways"
    controlled = holding(strong, World(ConstantCurrent([0.5, 0.0, 0.0])), KEY, PLACE, 0.0, 10.0, controlled=(0.6, 0.6))
    assert controlled.verdict == "holds" and controlled.upright == 0.6, "what control adds counts"
    assert np.all(stemmed(strong, [0.0, np.pi]) <= found.upright + 1e-9), "it stems no flow that tips it over"
    across = holding(strong, World(ConstantCurrent([0.5, 0.0, 0.0])), KEY, PLACE, 0.5 * np.pi, 10.0)
    assert across.verdict != "capsizes"


def test_what_stands_up_to_a_flow_from_ahead_and_not_from_abeam_turns():
    """The verdict said "holds" and the list below it "at most 0.3 m/s from abeam"."""
    strong = vehicle(thrusters=thrusters_from(jnp.eye(6), jnp.full(6, 1000.0)))
    current = World(ConstantCurrent([0.0, 0.4, 0.0]))
    for controlled, verdict in (((0.6, 0.5), "holds"), ((0.6, 0.3), "turns"), ((0.35, 0.3), "capsizes")):
        found = holding(strong, current, KEY, PLACE, 0.0, 10.0, controlled=controlled)
        assert found.verdict == verdict and found.upright == pytest.approx(controlled[1])
        assert (verdict == "holds") == (stemmed(strong, [np.pi / 2], controlled)[0] > 0.4)
    slanting = holding(strong, current, KEY, PLACE, np.pi / 4, 10.0, controlled=(0.6, 0.3))
    assert slanting.upright == pytest.approx(1.0 / np.hypot(np.sqrt(0.5) / 0.6, np.sqrt(0.5) / 0.3))


@pytest.mark.parametrize("from_astern", [False, True])
def test_what_it_stands_up_to_from_ahead_and_from_astern_is_not_the_same(from_astern):
    """A hull whose heave drag acts behind CO, like a tail's: 391 kg u^2 = 5.89 N m + c u ahead, - c u backwards."""
    c = 4.0
    damping = np.diag([6.5, 9.0, 20.0, 3.0, 1.3, 0.5])
    damping[2, 4] = damping[4, 2] = c
    lopsided = vehicle(added_mass=np.diag([9.0, 13.0, 400.0, 2.0, 0.7, 0.9]), linear_damping_ahead=damping)
    current = World(ConstantCurrent([0.1 if from_astern else -0.1, 0.0, 0.0]))
    found = holding(lopsided, current, KEY, PLACE, 0.0, 1.0)
    munk, righting, linear = 391.0, 30 * GRAVITY * 0.02, -c if from_astern else c
    expected = (linear + np.sqrt(linear**2 + 4 * munk * righting)) / (2 * munk)
    assert found.upright == pytest.approx(expected, rel=1e-3)


def test_where_nothing_is_required_the_force_there_is_counts_in_surge():
    strong_ahead = vehicle(thrusters=thrusters_from(jnp.eye(6), jnp.array([20.0, 10, 15, 10, 10, 10])))
    found = holding(strong_ahead, World(), KEY, PLACE, 0.0, 1.0)
    assert (found.available, found.available_heave) == pytest.approx((20.0, 15.0))


def test_what_a_current_takes_is_compared_with_thrust_that_way():
    """30 N ahead and 10 N astern: against a current from ahead there are 30 N, in waves to and fro 10."""
    ahead = jnp.full(6, 30.0)
    model = vehicle(thrusters=thrusters_from(jnp.eye(6), ahead, force_astern=ahead / 3.0))
    for north, available in ((-0.3, 30.0), (0.3, 10.0)):
        found = holding(model, World(ConstantCurrent([north, 0.0, 0.0])), KEY, PLACE, 0.0, 1.0)
        assert found.available == pytest.approx(available)
    to_and_fro = holding(model, World(waves=ThesisWaves(4.1, 8.7)), KEY, PLACE, 0.0, 60.0)
    assert to_and_fro.available == pytest.approx(10.0)


def test_forces_do_not_hide_a_moment_that_is_missing_nor_a_moment_a_force():
    tau = np.array([[5.0, 0, 0, 0, 0, 0.04], [0.05, 0, 0, 0, 0, 8.0]])
    no_yaw, no_surge = (thrusters_from(jnp.delete(jnp.eye(6), axis, 1), jnp.full(5, 10.0)) for axis in (5, 0))
    assert np.isinf(thrust_share(no_yaw, tau)).all() and np.isinf(thrust_share(no_surge, tau)).all()
    assert thrust_share(no_yaw, tau * [1, 0, 0, 0, 0, 0.01])[0] == pytest.approx(0.5)


def test_share_of_the_thrusters():
    tau = np.zeros((3, 6))
    tau[0, 0], tau[1, 2], tau[2, 5] = 5.0, -20.0, 1.0
    np.testing.assert_allclose(thrust_share(ALL_AXES, tau), [0.5, 2.0, 0.1])
    half = thrusters_from(jnp.eye(6), jnp.full(6, 10.0), health=jnp.array([0.5, 1, 1, 1, 1, 1]))
    assert thrust_share(half, tau)[0] == pytest.approx(1.0)
    surge_only = thrusters_from(jnp.eye(6)[:, :1], jnp.full(1, 10.0))
    assert list(np.isinf(thrust_share(surge_only, tau))) == [False, True, True]
    moments = np.zeros((1, 6))
    moments[0, 3:5] = 100.0
    assert thrust_share(ALL_AXES, moments)[0] == 0.0, "roll and pitch are left to the righting moment"
