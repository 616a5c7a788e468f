"""Thrusters that are lost are found, and only those; what cannot be found is not claimed."""

from itertools import combinations

import equinox as eqx
import numpy as np
import pytest
from tests.gnc.flying import DT, estimate_of, thirty_kg, truth_of

from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Environment
from rovtwin.core.numerics import as_array, jax, jnp
from rovtwin.gnc.allocation.prioritised import PriorityAllocation
from rovtwin.gnc.interfaces import AllocationInput
from rovtwin.gnc.safety.control_authority import FINE, HEAVE_LOST, UNABLE, ControlAuthority
from rovtwin.gnc.safety.thruster_diagnosis import HealthInput, ThrusterHealth
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.physics.dynamics import State, plant_step
from rovtwin.vehicle.physics.thrusters import command_for_force

SECONDS = 40.0
PORT, STARBOARD = (0, 1, 2), (3, 4, 5)
MODEL = thirty_kg()
MONITOR = ThrusterHealth.of(MODEL, (PORT, STARBOARD))
FAULT_AT = 20.0
T = np.arange(round(SECONDS / DT)) * DT


def commands():
    """Ahead and back, with turns, dives and a little sway: forces of each thruster that differ, shape (ticks, 6)."""
    surge = 4.0 + 2.0 * np.sin(0.5 * T)
    turn, heave = 1.5 * np.sin(0.8 * T + 1.0), 2.0 + np.sin(0.6 * T)
    force = np.stack([surge + turn, np.sin(0.4 * T), heave, surge - turn, np.sin(0.4 * T), heave], axis=1)
    return jax.vmap(lambda f: command_for_force(MODEL.thrusters, f))(jnp.asarray(force))


COMMANDS = commands()


@jax.jit
def flown(plant, share, push, commands, fault_at=FAULT_AT):
    """Health of the monitor, (ticks, n): from `fault_at` [s] on thrusters keep a share, and a wrench pushes."""
    start = Start.at([0, 0, 3])

    def one(carry, given):
        state, memory, before = carry
        t, u = given
        estimate = estimate_of(truth_of(state)[:6], state.nu)
        memory, health = MONITOR.step(memory, HealthInput(estimate, Command(before)), DT)
        late = t >= fault_at
        weak = eqx.tree_at(lambda m: m.thrusters.health, plant, jnp.where(late, share, jnp.ones(6)))
        wrench = Environment.calm(wrench=jnp.where(late, push, jnp.zeros(6)))
        return (plant_step(weak, state, Command(u), wrench, DT), memory, u), health

    begin = State.at(plant, start), MONITOR.init(jax.random.key(0), start), jnp.zeros(6)
    return jax.lax.scan(one, begin, (jnp.asarray(T), commands))[1]


def estimated(share=(1,) * 6, push=np.zeros(6), plant=MODEL):
    return np.asarray(flown(plant, as_array(share), as_array(push), COMMANDS))


def without(*lost, left=0.0, count=6):
    share = np.ones(count)
    share[list(lost)] = left
    return share


@pytest.mark.parametrize("lost", [0, 2, 3, 5])
@pytest.mark.parametrize("left", [0.0, -1.0], ids=["dead", "reversed"])
def test_a_lost_thruster_is_found_within_ten_seconds_and_no_other(lost, left):
    health = estimated(without(lost, left=left))
    assert np.all(health[T < FAULT_AT] == 1.0), "before it was lost"
    assert np.array_equal(health[T > FAULT_AT + 10.0][0], without(lost)), "within ten seconds"
    assert np.array_equal(health[-1], without(lost))


@pytest.mark.parametrize("lost", [0, 3])
def test_one_that_is_dead_from_the_start_is_found_though_it_is_asked_for_the_same_all_the_time(lost):
    steady = jnp.broadcast_to(COMMANDS[0], COMMANDS.shape)
    health = np.asarray(flown(MODEL, as_array(without(lost)), jnp.zeros(6), steady, 0.0))
    assert np.array_equal(health[T > 20.0][0], without(lost)), "within twenty seconds"


def test_a_unit_is_found():
    health = estimated(without(*PORT))[-1]
    # Its sway thruster makes no moment: whether it is lost with the others, only the unit's hypothesis says.
    assert health[0] == 0.0 and health[2] == 0.0 and np.all(health[3:] == 1.0)


@pytest.mark.parametrize("lost", [1, 4])
def test_a_thruster_without_a_moment_is_not_claimed_lost(lost):
    assert np.all(estimated(without(lost)) == 1.0)


PUSHES = {
    "caught tether": [-8.0, 3.0, -4.0, 0.0, 0.0, 0.0],
    "a push with a moment": [-3.0, 2.0, 0.0, 0.0, 0.0, 0.5],
    "shifted ballast": [0.0, 0.0, 1.0, 0.4, 0.3, 0.0],
    "nothing": [0.0] * 6,
}


@pytest.mark.parametrize("push", list(PUSHES))
def test_what_pushes_from_outside_is_no_lost_thruster(push):
    assert np.all(estimated(push=PUSHES[push]) == 1.0)


@pytest.mark.parametrize("drag", [0.75, 1.25])
def test_a_model_that_is_wrong_is_no_lost_thruster(drag):
    names = ("linear_damping_ahead", "quadratic_damping_ahead")
    heavier = {name: 1.1 * getattr(MODEL, name) for name in ("rigid_body_mass", "added_mass")}
    plant = thirty_kg(**heavier, **{name: drag * getattr(MODEL, name) for name in names})
    assert np.all(estimated(0.9 * np.ones(6), plant=plant) == 1.0)


def test_weak_by_a_third_is_not_lost():
    assert np.all(estimated(without(0, left=0.67)) == 1.0)


@pytest.mark.system
def test_an_estimate_that_is_not_a_number_leaves_the_memory_usable():
    memory = MONITOR.init(jax.random.key(0), Start.at())
    broken = HealthInput(estimate_of(np.full(6, np.nan), np.full(6, np.nan)), Command(jnp.zeros(6)))
    memory, health = MONITOR.step(memory, broken, DT)
    assert np.all(np.asarray(health) == 1.0)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(memory))


TORPEDO = load_vehicle("torpedo").model()
ACROSS_THE_BOW = estimate_of(np.array([0, 0, 3, 0, 0, 0.3]), np.array([0.6, 0.05, 0, 0, 0, 0.01]))


def test_the_covariance_of_a_residual_has_what_an_error_of_the_current_makes_of_the_flow():
    monitor = ThrusterHealth.of(TORPEDO)
    estimate = eqx.tree_at(lambda e: e.bias, ACROSS_THE_BOW, jnp.array([-2.0, 3.0, 0, 0, 0, 0]))
    c, s = np.cos(0.3), np.sin(0.3)
    U = []
    for b, std in zip([[c, s], [-s, c]], monitor.force_std, strict=True):
        ends = [
            eqx.tree_at(lambda e: e.bias, estimate, estimate.bias.at[:2].add(sign * std * jnp.array(b)))
            for sign in (1, -1)
        ]
        U.append(0.5 * np.subtract(*(np.asarray(monitor._flow(e)) for e in ends)))
    stern = np.asarray(monitor.weight)[4]
    pushed = stern > 0.0
    N = np.diag(1.0 / stern[pushed])
    R = N + sum(np.outer(u[pushed], u[pushed]) for u in U)
    x = np.array([0.3, -1.2, 0.4, 0.1, -0.5, 0.9])
    (weighed,) = monitor._weighed(estimate, jnp.broadcast_to(x, monitor.weight.shape))
    np.testing.assert_allclose(np.asarray(weighed)[4][pushed], np.linalg.solve(R, x[pushed]), rtol=1e-9)
    assert abs(U[1][5]) > 2 * np.sqrt(1.0 / stern[5]), "Munk's moment of an error across the bow is the larger part"


@pytest.mark.slow
def test_a_slender_hull_in_a_current_across_its_course_has_no_thruster_failure():
    from rovtwin import fly, load_scenario

    flight = fly(load_scenario("square", ["vehicle=torpedo", "world.current=[0, 0.62, 0]", "seed=1"]))
    assert flight.figures["completed"], flight.figures["reason"]


@pytest.mark.slow
@pytest.mark.parametrize("vehicle, thruster, seed", [("torpedo", "lateral_stern", 4), ("blueye_x3", "port", 3)])
def test_one_that_dies_in_a_mission_is_found_within_fifteen_seconds(vehicle, thruster, seed):
    """A thruster at rest shows nothing: of seeds 1 to 6 of the torpedo four are found in 9 s, two after 17 and 27 s."""
    from rovtwin import fly, load_scenario

    fault = f"faults=[{{thruster: {thruster}, at: 30, fault: dead}}]"
    decisions = fly(load_scenario("square", [f"vehicle={vehicle}", fault, f"seed={seed}"])).figures["decisions"]
    assert [(d["what"], d["t"] < 45) for d in decisions if "no longer" in d["what"]] == [
        (f"{thruster} no longer used", True)
    ]


def test_what_a_double_blueye_can_do_without():
    model = load_vehicle("double_blueye").model()
    ability = ControlAuthority.of(model, (PORT, STARBOARD))
    can = {
        (): FINE,
        (0,): UNABLE,  # the other surge thruster alone turns it
        (3,): UNABLE,
        (1,): FINE,
        (2,): FINE,
        (1, 4): UNABLE,  # no sway
        (2, 5): HEAVE_LOST,
        (0, 1, 2): UNABLE,
        (0, 1, 3, 4): UNABLE,  # more than the table knows, but both heave thrusters are left
        (0, 2, 4, 5): HEAVE_LOST,
    }
    assert {lost: int(ability.judged(as_array(without(*lost)))) for lost in can} == can


@pytest.mark.system
def test_a_bluerov2_heavy_goes_on_without_any_one_thruster():
    ability = ControlAuthority.of(load_vehicle("bluerov2_heavy").model())
    assert {int(ability.judged(as_array(1.0 - np.eye(8)[k]))) for k in range(8)} == {FINE}


def test_one_of_a_fore_and_an_aft_vertical_thruster_brings_the_vehicle_up_and_controls_no_pitch():
    """With both it controls depth and pitch; with one every push up or down pitches it, and control made it swing."""
    columns = [[1, 0, 0, 0, 0, 0.1], [1, 0, 0, 0, 0, -0.1], [0, 1, 0, 0, 0, 0.05], [0, 1, 0, 0, 0, -0.05]]
    columns += [[0, 0, 1, 0, -0.5, 0], [0, 0, 1, 0, 0.5, 0]]
    ability = ControlAuthority.of(thirty_kg(T=np.array(columns).T))
    sound = as_array(np.ones(6))
    assert int(ability.judged(sound)) == FINE and ability.axes(sound).all()
    for number in (4, 5):
        left = as_array(1.0 - np.eye(6)[number])
        assert int(ability.judged(left)) == UNABLE
        assert ability.axes(left)[4] == 0.0 and np.asarray(ability.axes(left))[[0, 1, 2, 5]].all()


@pytest.mark.system
def test_two_of_three_vertical_thrusters_push_no_moment_through_the_horizontal_ones():
    """They have one moment beside heave. For the other, horizontal ones 2 cm below CO once gave 50 N the wrong way."""
    azimuths = np.deg2rad([-35.0, 35.0, 35.0, -35.0])
    places = [(-0.38, -0.26), (-0.38, 0.26), (0.38, -0.26), (0.38, 0.26)]
    level = [
        [np.cos(a), np.sin(a), 0, -0.02 * np.sin(a), 0.02 * np.cos(a), x * np.sin(a) - y * np.cos(a)]
        for a, (x, y) in zip(azimuths, places, strict=True)
    ]
    upright = [[0, 0, 1, y, -x, 0] for x, y in [(0.28, 0.0), (-0.2, -0.2), (-0.2, 0.2)]]
    model = thirty_kg(T=np.array([*level, *upright]).T)
    ability, allocation = ControlAuthority.of(model), PriorityAllocation.of(model, slew=np.inf, start=0.0, stop=0.0)
    assert ability.axes(as_array(np.ones(7))).all()
    left = as_array(without(5, count=7))
    axes = np.asarray(ability.axes(left))
    assert not axes[3:5].any() and axes[[0, 1, 2, 5]].all()
    tau = axes * np.array([-10.0, -8.0, -2.0, 1.0, 1.0, 0.5])
    _, allocated = allocation.step(allocation.init(None, None), AllocationInput(as_array(tau), left, axes), 0.1)
    np.testing.assert_allclose(np.asarray(allocated.made)[[0, 1, 2, 5]], tau[[0, 1, 2, 5]], atol=0.01)


def test_two_opposite_corners_of_four_vertical_thrusters_leave_roll_and_pitch_to_the_righting_moment():
    ability = ControlAuthority.of(load_vehicle("bluerov2_heavy").model())
    names = load_vehicle("bluerov2_heavy").thruster_names
    upright = [k for k, name in enumerate(names) if "vertical" in name]
    assert len(upright) == 4
    found = {
        tuple(bool(x) for x in np.asarray(ability.axes(as_array(without(*pair, count=8))))[3:5])
        for pair in combinations(upright, 2)
    }
    assert (True, True) not in found and (False, False) in found
