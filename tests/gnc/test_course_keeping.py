"""A vehicle without sway that is given the truth, in a current: it arrives, holds, comes home, says what it cannot."""

import dataclasses
from functools import cache

import equinox as eqx
import numpy as np
import pytest
from tests.gnc.flying import DT, SQUARE, route, thirty_kg, two_bodies

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import (
    DIVE,
    FINISHED,
    HEADING_GIVEN_UP,
    HOLD,
    NO_REQUEST,
    RETURNED,
    SWEPT,
    WAITING,
    AutopilotInput,
    Environment,
    Estimate,
    Setpoint,
    Slot,
)
from rovtwin.core.frames import euler_from_quaternion, rotation_from_quaternion
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.allocation.prioritised import PriorityAllocation
from rovtwin.gnc.autopilot import Autopilot
from rovtwin.gnc.control.tracking import PathReference, Tracking
from rovtwin.gnc.guidance.course_keeping import CourseInput, CourseKeeping
from rovtwin.gnc.guidance.path_following import PathGuidance
from rovtwin.gnc.guidance.speed_limit import AchievableSpeed
from rovtwin.gnc.safety.contingency import Contingency
from rovtwin.gnc.safety.rules import RULES, Rules
from rovtwin.gnc.safety.supervisor import Supervisor
from rovtwin.gnc.scales import VehicleScales
from rovtwin.vehicle.physics.dynamics import State, coriolis_wrench, damping_wrench, plant_step

MODEL = thirty_kg(T=np.delete(two_bodies(), [1, 4], axis=1))
SCALES = VehicleScales.of(MODEL)
THIRD = float(SCALES.top[0]) / 3.0
WHOLE = round(240.0 / DT)  # ticks: one compilation serves all flights


class Reported(Block):
    """Believes what it is given: eta, nu and the disturbance, shape (18,)."""

    def init(self, key, start):
        return jnp.zeros(())

    def step(self, memory, input, dt):
        reported = input.measurements["truth"].value[0]
        return memory, Estimate.from_euler(
            reported[:6], reported[6:12], reported[12:], 1e-4 * jnp.eye(12), jnp.zeros(1), jnp.zeros(1)
        )


def pilot(plan, rules=None):
    return Autopilot(
        observer=Reported(),
        supervisor=Supervisor() if rules is None else Supervisor(rules),
        guidance=PathGuidance.of(MODEL, steered=True),
        contingency=Contingency.of(MODEL),
        reference=PathReference.of(MODEL),
        control=Tracking.of(MODEL),
        allocation=PriorityAllocation.of(MODEL),
        mission=plan,
        health=MODEL.thrusters.health,
        course=CourseKeeping.of(MODEL),
    )


@eqx.filter_jit
def _fly(autopilot, current, offset):
    environment = eqx.tree_at(lambda e: e.velocity, Environment.calm(), jnp.append(current, 0.0))

    def tick(carry, off):
        memory, state = carry
        R = rotation_from_quaternion(state.attitude)
        nu_r = state.nu.at[:3].add(-R.T @ environment.velocity)
        still, flowing = (coriolis_wrench(MODEL.inertia, nu) + damping_wrench(MODEL, nu) for nu in (state.nu, nu_r))
        carried = MODEL.inertia[:3, :3] @ jnp.cross(state.nu[3:], R.T @ environment.velocity)
        force = R @ ((still - flowing)[:3] - carried)
        euler = euler_from_quaternion(state.attitude)
        reported = jnp.concatenate([state.position.at[:2].add(off), euler, state.nu, force, jnp.zeros(3)])
        received = {"truth": Slot(reported[None], jnp.ones(1, dtype=bool), jnp.zeros(1))}
        memory, out = autopilot.step(memory, AutopilotInput(received, jnp.asarray(NO_REQUEST)), DT)
        seen = (jnp.append(state.position[:2], euler[2]), out.setpoint, out.wrench.saturated, euler)
        return (memory, plant_step(MODEL, state, out.command, environment, DT)), seen

    start = Start.at((0.0, 0.0, 1.0))
    begin = autopilot.init(jax.random.key(0), start), State.at(MODEL, start)
    return jax.lax.scan(tick, begin, offset)[1]


def fly(plan, current=(0.0, 0.0), rules=None, offset=None):
    """x, y and heading, set-points and attitude over `WHOLE` ticks; `offset` of the position told, (n, 2)."""
    offset = jnp.zeros((WHOLE, 2)) if offset is None else jnp.asarray(offset)
    place, setpoint, _, euler = _fly(pilot(plan, rules), jnp.asarray(current, dtype=float), offset)
    return np.asarray(place), jax.tree.map(np.asarray, setpoint), np.asarray(euler)


def off_the_leg(place, setpoint):
    """Distance to the leg once a leg's first two metres are behind [m]."""
    start, end = setpoint.leg_start[:, :2], setpoint.leg_end[:, :2]
    way = (end - start) / np.linalg.norm(end - start, axis=1, keepdims=True).clip(1e-9)
    away = place[:, :2] - start
    settled = setpoint.on_leg & ((away * way).sum(axis=1) > 2.0)
    return np.abs(away[:, 0] * way[:, 1] - away[:, 1] * way[:, 0])[settled]


STEP = eqx.filter_jit(lambda course, memory, input: course.step(memory, input, DT))
SQUARES = route([(4 * x / 3, 4 * y / 3) for x, y in SQUARE], depth=2.0)
CURRENTS = [(0.0, 0.0), (0.0, THIRD), (-0.7 * THIRD, 0.7 * THIRD)]


@cache
def square(current):
    return fly(SQUARES, current)


@pytest.mark.system
@pytest.mark.parametrize("current", CURRENTS)
def test_a_square_is_completed_in_calm_and_in_a_third_of_the_top_speed(current):
    place, setpoint, euler = square(current)
    assert setpoint.phase[-1] == FINISHED and setpoint.waypoint[-1] == 3
    assert off_the_leg(place, setpoint).max() < SCALES.length
    assert np.degrees(np.abs(euler[:, :2]).max()) < 20


@pytest.mark.system
@pytest.mark.parametrize("current", CURRENTS[1:])
def test_at_the_end_it_holds_the_place_with_the_bow_into_the_current(current):
    place, setpoint, _ = square(current)
    last = place[-round(20 / DT) :]
    assert np.linalg.norm(last[:, :2], axis=1).max() < 0.5 * SCALES.length
    into = np.arctan2(-current[1], -current[0])
    assert np.abs(np.angle(np.exp(1j * (last[:, 2] - into)))).max() < np.radians(10)


@pytest.mark.system
def test_in_calm_water_it_stays_within_its_slack():
    place, setpoint, _ = square((0.0, 0.0))
    held = setpoint.phase == FINISHED
    assert np.linalg.norm(place[held][:, :2], axis=1).max() < SCALES.length + 0.2  # acceptance: it arrives there


@pytest.mark.system
def test_a_way_point_that_was_passed_beside_is_come_back_to():
    """The position jumps a metre as the vehicle arrives, as when a filter has had none for a while."""
    plan = route([(4, 0)], depth=1.0)
    arrives = round(18.0 / DT)
    offset = np.zeros((WHOLE, 2))
    offset[arrives:] = [1.0, 0.6]
    place, setpoint, _ = fly(plan, (0.0, 0.0), offset=offset)
    reported = place[:, :2] + offset
    before = np.linalg.norm(reported[arrives] - [4, 0])
    assert before > 0.2, "or there is nothing to come back to"
    assert setpoint.phase[-1] == FINISHED
    first = int(np.argmax(setpoint.phase == FINISHED))
    assert np.linalg.norm(reported[first] - [4, 0]) < 0.25
    assert first > arrives, "it finishes when it has come back, not before the jump"
    assert reported[arrives:first, 0].max() > 4.0 + 0.2, "it goes past the way-point first, by more than the acceptance"
    # The point is not at its end yet and waits there, so that no miss is counted.
    assert WAITING in setpoint.progress.state[arrives:first] and setpoint.progress.misses.max() == 0


def test_a_heading_that_was_given_up_is_not_taken_again_at_the_limit():
    """In a current about as fast as sway thrust covers, a filter's noise must not turn the vehicle to and fro."""
    course = dataclasses.replace(CourseKeeping.of(MODEL), aside=jnp.asarray(0.1))
    memory = course.init(jax.random.key(0), Start.at())
    zero = jnp.zeros(())
    asked = Setpoint.level(
        jnp.zeros(3), zero, jnp.zeros(6), jnp.zeros(3), jnp.zeros(3), zero, zero, jnp.asarray(HOLD), zero
    )
    asked = dataclasses.replace(asked, fixed_heading=jnp.asarray(True))
    given_up = []
    for current in (0.05, 0.3, 0.11, 0.15, 0.11, 0.02):  # [m/s] across the heading
        drag = MODEL.linear_damping_ahead[1, 1] * current + MODEL.quadratic_damping_ahead[1, 1] * current**2
        bias = jnp.zeros(6).at[1].set(drag)
        reported = Estimate.from_euler(
            jnp.zeros(6), jnp.zeros(6), bias, 1e-12 * jnp.eye(12), jnp.zeros(1), jnp.zeros(1)
        )
        memory = dataclasses.replace(memory, current=jnp.asarray([0.0, current]))  # it is smoothed
        for _ in range(2):  # a memory is taken over in the first step
            memory, _ = STEP(course, memory, CourseInput(asked, reported))
        given_up.append(bool(memory.turns))
    assert given_up == [False, True, True, True, True, False]


def test_passes_outside_the_acceptance_are_counted():
    guidance = PathGuidance.of(MODEL, steered=True)
    memory = guidance.init(jax.random.key(0), Start.at())
    from rovtwin.gnc.guidance.path import piece_of
    from rovtwin.gnc.guidance.path_following import _missed

    plan = route([(4, 0)])
    piece = piece_of(plan, jnp.asarray(0), jnp.zeros(2), jnp.zeros(()), 0.06, 0.1)
    counted = []
    for distance in (0.8, 0.5, 0.4, 0.55, 0.65, 0.9, 0.6, 0.3, 0.45, 0.55):
        nearest, misses = _missed(memory, piece, jnp.asarray(True), jnp.asarray(distance))
        memory = dataclasses.replace(memory, nearest=nearest, misses=misses)
        counted.append(int(misses))
    assert counted == [0, 0, 0, 0, 1, 2, 2, 2, 2, 3]


@pytest.mark.parametrize("current", [(0.0, 0.0), (0.0, THIRD)])
def test_a_heading_is_kept_where_the_place_can_be_held_with_it_and_given_up_where_not(current):
    plan = route([(3, 0)], depth=1.0, heading=1.0)
    place, setpoint, _ = fly(plan, current)
    last = slice(-round(20 / DT), None)
    assert np.linalg.norm(place[last, :2] - [3, 0], axis=1).max() < SCALES.length + 0.2
    if current[1]:
        assert np.all(setpoint.progress.state[last] == HEADING_GIVEN_UP)
        assert np.abs(place[last, 2] + np.pi / 2).max() < 0.2  # bow into it
    else:
        assert np.abs(place[last, 2] - 1.0).max() < 0.1
        assert not np.any(setpoint.progress.state[last] == HEADING_GIVEN_UP)


def test_a_current_that_is_too_strong_is_reported():
    place, setpoint, _ = fly(SQUARES, (0.0, -1.3 * float(SCALES.top[0])))
    assert np.all(setpoint.progress.state[round(20 / DT) :] == SWEPT)
    assert np.all(setpoint.phase <= HOLD)
    np.testing.assert_allclose(setpoint.progress.current[-1], [0.0, -1.3 * float(SCALES.top[0])], atol=0.05)


def test_it_comes_home_across_a_current():
    rules = Rules.of({"time out": RULES["time out"]._replace(limit=30.0)})
    place, setpoint, _ = fly(SQUARES, (0.0, THIRD), rules)
    assert setpoint.phase[-1] == RETURNED
    assert np.linalg.norm(place[-1, :2]) < 1.6 * SCALES.length


def test_velocity_through_the_water_makes_the_course_good_before_the_speed():
    sustained = AchievableSpeed.of(MODEL)
    most = float(sustained.most[0, 0])
    current = jnp.array([0.0, 0.6 * most])
    w, swept = sustained.course(jnp.array([0.3 * most, 0.0]), current)
    np.testing.assert_allclose(w, [0.3 * most, -0.6 * most])
    assert not swept
    w, swept = sustained.course(jnp.array([2.0 * most, 0.0]), current)
    np.testing.assert_allclose(w, [0.8 * most, -0.6 * most], rtol=1e-6)
    assert not swept
    w, swept = sustained.course(jnp.array([0.3 * most, 0.0]), 2.0 * current)
    np.testing.assert_allclose(w, [0.0, -most], atol=1e-3)
    assert swept
    assert sustained.made_good(jnp.asarray(0.0), current) == pytest.approx(0.8 * most)
    assert sustained.made_good(jnp.asarray(0.0), 2.0 * current) < 0.0


@pytest.mark.system
def test_a_pilot_steers_himself():
    block = CourseKeeping.of(MODEL)
    from tests.block_examples import estimates, setpoints

    from rovtwin.core.flow import PILOTED
    from rovtwin.gnc.guidance.course_keeping import CourseInput

    first = jax.tree.map(lambda x: x[0], (setpoints(), estimates()))
    asked = dataclasses.replace(first[0], phase=jnp.asarray(PILOTED))
    memory = block.init(jax.random.key(0), Start.at())
    _, out = block.step(memory, CourseInput(asked, first[1]), DT)
    assert eqx.tree_equal(out, asked)
    _, out = block.step(memory, CourseInput(dataclasses.replace(asked, phase=jnp.asarray(DIVE)), first[1]), DT)
    assert not eqx.tree_equal(out.position, asked.position)
