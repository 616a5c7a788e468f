import equinox as eqx
import numpy as np
import pytest
from tests.gnc.flying import DT, LAWNMOWER, SQUARE, estimate_of, points, route, run_lengths

from rovtwin.core.block import Start
from rovtwin.core.flow import ABORTED, DIVE, FINISHED, GO, HOLD, IDLE, PAUSED, TURN
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.guidance.mission import mission
from rovtwin.gnc.interfaces import MODE_ABORTED, MODE_IDLE, MODE_PAUSED, MODE_RUNNING, GuidanceInput, Mode
from rovtwin.gnc.thesis.los_guidance import Guidance

GUIDANCE = Guidance()
KEY = jax.random.key(0)


def mode_of(mode):
    return Mode(jnp.asarray(mode), jnp.zeros((), dtype=int))


@eqx.filter_jit
def travel(plan, eta, modes, speed=0.5):
    """A vehicle without mass goes straight to the set-point, at most `speed` m/s and 0.5 rad/s; pose and set-point."""

    def tick(carry, mode):
        memory, eta = carry
        memory, setpoint = GUIDANCE.step(memory, GuidanceInput(estimate_of(eta), plan, mode_of(mode)), DT)
        away = setpoint.eta - eta
        turn = (away[5] + jnp.pi) % (2 * jnp.pi) - jnp.pi
        step = away[:3] * jnp.minimum(1.0, speed * DT / jnp.maximum(jnp.linalg.norm(away[:3]), 1e-9))
        turn = jnp.clip(turn, -0.5 * DT, 0.5 * DT)
        after = jnp.concatenate([eta[:3] + step, jnp.zeros(2), eta[5:] + turn])
        return (memory, after), (eta, setpoint)

    start = Start.at(eta[:3], eta[5])
    return jax.lax.scan(tick, (GUIDANCE.init(KEY, start), eta), modes)[1]


def fly(corners, start=(0.0, 0.0, 0.5), heading=0.0, seconds=150, modes=None, **options):
    eta = jnp.array([*start, 0.0, 0.0, heading])
    plan = corners if hasattr(corners, "position") else route(corners, **options)
    modes = jnp.full(round(seconds / DT), MODE_RUNNING) if modes is None else jnp.asarray(modes)
    return jax.tree.map(np.asarray, travel(plan, eta, modes))


def once(memory, eta, plan, mode=MODE_RUNNING):
    return GUIDANCE.step(memory, GuidanceInput(estimate_of(eta), plan, mode_of(mode)), DT)


def memory_in(phase, waypoint=0, leg_start=(0.0, 0.0), heading=0.0):
    """Guidance in the middle of a mission."""
    memory = GUIDANCE.init(KEY, Start.at(heading=heading))
    return eqx.tree_at(
        lambda m: (m.phase, m.waypoint, m.first, m.leg_start),
        memory,
        (jnp.asarray(phase), jnp.asarray(waypoint), jnp.asarray(False), jnp.array(leg_start)),
    )


# Phases


@pytest.mark.parametrize("corners", [LAWNMOWER, SQUARE], ids=["table 8.3", "square of 7.4"])
def test_phases_in_order_through_the_thesis_missions(corners):
    eta, setpoint = fly(corners)
    assert run_lengths(setpoint.phase) == [DIVE, TURN, GO, HOLD] * len(corners) + [FINISHED]
    assert run_lengths(setpoint.waypoint) == list(range(len(corners)))
    reached = np.flatnonzero((setpoint.phase[1:] == HOLD) & (setpoint.phase[:-1] == GO)) + 1
    for corner, tick in zip(corners, reached, strict=True):
        # Reached within the radius, and not long before it: switched at its rim.
        assert 0.15 < np.hypot(*(eta[tick, :2] - corner)) < 0.2 + 0.5 * DT
    legs = setpoint.phase == GO
    np.testing.assert_array_equal(setpoint.on_leg, legs)
    assert np.all(np.abs(eta[legs, 2] - 3.0) < 0.1)  # no leg before the depth is reached
    headings = [eta[np.flatnonzero(legs & (setpoint.waypoint == k))[0], 5] for k in range(len(corners))]
    ways = np.diff(np.array([(0, 0), *corners]), axis=0)
    np.testing.assert_allclose(np.cos(headings - np.arctan2(ways[:, 1], ways[:, 0])), 1.0, atol=0.006)


def test_dive_stays_over_the_spot_and_turn_stays_there():
    eta, setpoint = fly([(6.0, 0.0)], start=(1.0, 2.0, 0.5), heading=1.0)
    diving, turning = setpoint.phase == DIVE, setpoint.phase == TURN
    np.testing.assert_allclose(setpoint.eta[diving], np.tile([1, 2, 3, 0, 0, 1.0], (diving.sum(), 1)))
    bearing = np.arctan2(-2.0, 5.0)
    np.testing.assert_allclose(setpoint.eta[turning], np.tile([1, 2, 3, 0, 0, bearing], (turning.sum(), 1)))
    assert abs(eta[turning, 5][-1] - bearing) < 0.1 + 0.5 * DT
    np.testing.assert_allclose(setpoint.eta[setpoint.phase == GO][:, :3], [[6, 0, 3]] * (setpoint.phase == GO).sum())


def test_legs_are_those_that_errors_are_measured_from():
    _, setpoint = fly(SQUARE, start=(-1.0, 0.5, 0.5))
    starts = [setpoint.leg_start[(setpoint.phase == GO) & (setpoint.waypoint == k)][0] for k in range(4)]
    np.testing.assert_allclose(starts, [(-1, 0.5, 3), (3, 0, 3), (3, 3, 3), (0, 3, 3)])
    ends = [setpoint.leg_end[(setpoint.phase == GO) & (setpoint.waypoint == k)][0] for k in range(4)]
    np.testing.assert_allclose(ends, [(*corner, 3) for corner in SQUARE])


def test_first_leg_starts_where_the_dive_ended():
    """A current carried the vehicle away while it dived."""
    plan, memory = route([(6.0, 0.0)]), GUIDANCE.init(KEY, Start.at())
    memory, _ = once(memory, [0, 0, 0.5, 0, 0, 0], plan)
    memory, _ = once(memory, [0.2, -0.7, 2.95, 0, 0, 0], plan)
    memory, setpoint = once(memory, [0.2, -0.7, 2.95, 0, 0, 0], plan)
    assert int(setpoint.phase) == TURN
    np.testing.assert_allclose(setpoint.leg_start, [0.2, -0.7, 3.0])
    assert float(setpoint.eta[5]) == pytest.approx(np.arctan2(0.7, 5.8))


def test_hold_takes_its_time_at_the_way_point():
    _, setpoint = fly([(2.0, 0.0), (2.0, 2.0)], hold_time=7.0, seconds=60)
    held = [np.sum((setpoint.phase == HOLD) & (setpoint.waypoint == k)) * DT for k in range(2)]
    np.testing.assert_allclose(held, 7.0, atol=DT)
    here = setpoint.eta[(setpoint.phase == HOLD) & (setpoint.waypoint == 0)]
    np.testing.assert_allclose(here, np.tile(here[0], (len(here), 1)))
    np.testing.assert_allclose(here[0, :3], [2, 0, 3])


def test_fixed_heading_is_kept_all_along():
    plan = mission(points(SQUARE, heading=-2.5))
    _, setpoint = fly(plan)
    later = setpoint.phase != DIVE
    np.testing.assert_allclose(setpoint.eta[later & (setpoint.phase != FINISHED), 5], -2.5)
    assert setpoint.phase[-1] == FINISHED


def test_station_keeping_turns_to_its_heading_and_stays():
    plan = mission([{"x": 0.0, "y": 0.0, "depth": 3.0, "heading": 0.0, "hold_time": 40.0}])
    eta, setpoint = fly(plan, start=(0.05, -0.02, 0.5), heading=1.5, seconds=60)
    assert run_lengths(setpoint.phase) == [DIVE, TURN, GO, HOLD, FINISHED]
    np.testing.assert_allclose(eta[-1], [0, 0, 3, 0, 0, 0], atol=1e-6)


def test_leg_shorter_than_the_radius_does_not_turn_the_vehicle():
    """Its bearing is that of the noise of a position."""
    corners = [(3.0, 0.0), (2.95, -0.1), (3.0, 3.0)]
    eta, setpoint = fly(corners, seconds=60)
    assert setpoint.phase[-1] == FINISHED
    np.testing.assert_allclose(setpoint.eta[setpoint.waypoint == 1, 5], 0.0, atol=1e-9)


def test_depth_error_on_a_leg_does_not_keep_the_vehicle_from_a_way_point():
    memory, _ = once(memory_in(GO), [5.9, 0.1, 3.5, 0, 0, 0], route(LAWNMOWER))
    assert int(memory.phase) == HOLD
    memory, _ = once(memory_in(GO), [5.9, 0.2, 3.0, 0, 0, 0], route(LAWNMOWER))
    assert int(memory.phase) == GO


# Line of sight


def test_heading_of_the_line_of_sight():
    """Thesis 2.43-2.45, written out."""
    rng = np.random.default_rng(3)
    step = eqx.filter_jit(once)
    for _ in range(20):
        a, b, p = rng.uniform(-5, 5, (3, 2))
        _, setpoint = step(memory_in(GO, leg_start=tuple(a)), [*p, 3, 0, 0, 0], route([tuple(b)]))
        alpha = np.arctan2(b[1] - a[1], b[0] - a[0])
        e = -(p[0] - a[0]) * np.sin(alpha) + (p[1] - a[1]) * np.cos(alpha)
        chi = alpha + np.arctan(-e / 2.0)
        np.testing.assert_allclose(np.exp(1j * float(setpoint.eta[5])), np.exp(1j * chi), atol=1e-12)
        assert abs(float(setpoint.eta[5])) <= np.pi


@pytest.mark.parametrize("offset", [1.5, -1.5])
@pytest.mark.parametrize("bearing", [0.0, 3.0, -2.0])
def test_line_of_sight_converges_to_the_line(offset, bearing):
    """A vehicle that goes where it looks: e_dot = -U e / sqrt(Delta^2 + e^2), Fossen (2021), sec. 12.4."""
    along, across = np.array([np.cos(bearing), np.sin(bearing)]), np.array([-np.sin(bearing), np.cos(bearing)])
    plan = route([tuple(40.0 * along)])
    speed, n = 0.4, 1500

    def tick(position, _):
        eta = jnp.concatenate([position, jnp.array([3.0, 0, 0, 0])])
        _, setpoint = once(memory_in(GO), eta, plan)
        chi = setpoint.eta[5]
        return position + speed * DT * jnp.array([jnp.cos(chi), jnp.sin(chi)]), position

    path = np.asarray(jax.jit(lambda p: jax.lax.scan(tick, p, None, length=n)[1])(jnp.asarray(offset * across)))
    e = path @ across
    expected = [offset]
    for _ in range(n - 1):
        expected.append(expected[-1] - speed * DT * expected[-1] / np.hypot(2.0, expected[-1]))
    np.testing.assert_allclose(e, expected, atol=1e-9)
    assert abs(e[-1]) < 0.01 * abs(offset)


def test_speed_points_along_the_leg_seen_from_the_vehicle():
    _, setpoint = once(memory_in(GO, leg_start=(0.0, 1.0)), [2, 1.5, 3, 0, 0, 0], route([(6.0, 1.0)], speed=0.2))
    psi = float(setpoint.eta[5])
    np.testing.assert_allclose(setpoint.nu, [0.2 * np.cos(psi), -0.2 * np.sin(psi), 0, 0, 0, 0], atol=1e-12)
    assert psi < 0
    for phase, nu in [(DIVE, [0, 0, 0.2, 0, 0, 0]), (TURN, np.zeros(6)), (HOLD, np.zeros(6))]:
        _, setpoint = once(memory_in(phase), [2, 1.5, 1, 0, 0, 0], route([(6.0, 1.0)], speed=0.2))
        np.testing.assert_allclose(setpoint.nu, nu)


# Modes


def test_waits_where_it_is_until_it_may_run():
    eta, setpoint = fly(SQUARE, start=(1.0, 1.0, 0.5), heading=2.0, modes=[MODE_IDLE] * 50 + [MODE_RUNNING] * 3)
    assert run_lengths(setpoint.phase) == [IDLE, DIVE]
    np.testing.assert_allclose(setpoint.eta[:50], np.tile([1, 1, 0.5, 0, 0, 2.0], (50, 1)))


@pytest.mark.parametrize("phase", [DIVE, TURN, GO, HOLD])
def test_pause_holds_the_spot_and_the_mission_goes_on_after_it(phase):
    plan = route([(2.0, 0.0), (2.0, 2.0)], hold_time=3.0)
    free_eta, free = fly(plan, heading=1.0, seconds=60)
    at = np.flatnonzero((free.phase == phase) & (free.waypoint == 0))[20]
    modes = np.full(3000, MODE_RUNNING)
    modes[at : at + 200] = MODE_PAUSED
    eta, setpoint = fly(plan, heading=1.0, modes=modes)
    during = slice(at, at + 200)
    assert np.all(setpoint.phase[during] == PAUSED) and not np.any(setpoint.on_leg[during])
    assert np.all(setpoint.waypoint[during] == 0)
    np.testing.assert_allclose(setpoint.eta[during], np.tile(free_eta[at], (200, 1)), atol=1e-12)
    assert setpoint.phase[at + 200] == phase
    # The massless vehicle stood still: everything after is as before, 200 ticks later.
    np.testing.assert_allclose(eta[at + 200 :], free_eta[at:2800], atol=1e-9)
    np.testing.assert_array_equal(setpoint.phase[at + 200 :], free.phase[at:2800])


def test_abort_freezes_the_set_point_even_when_the_estimate_is_no_number():
    plan = route(SQUARE)
    memory, _ = once(memory_in(GO), [1, 0, 3, 0, 0, 0], plan)
    after, setpoint = once(memory, np.full(6, np.nan), plan, MODE_ABORTED)
    assert int(setpoint.phase) == ABORTED
    assert eqx.tree_equal(after, memory)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves((after, setpoint)))


def test_finished_stays_finished_but_for_an_abort():
    plan = route(SQUARE)
    for mode, phase in [(MODE_RUNNING, FINISHED), (MODE_PAUSED, FINISHED), (MODE_ABORTED, ABORTED)]:
        _, setpoint = once(memory_in(FINISHED, waypoint=3), [0, 0, 3, 0, 0, 0], plan, mode)
        assert int(setpoint.phase) == phase


def test_mission_without_way_points_stays_idle():
    plan = eqx.tree_at(lambda m: m.count, route(SQUARE), jnp.zeros((), dtype=int))
    memory, setpoint = once(GUIDANCE.init(KEY, Start.at()), np.zeros(6), plan)
    assert int(memory.phase) == int(setpoint.phase) == IDLE


@pytest.mark.system
def test_gradient_is_finite_on_a_leg_of_no_length():
    plan = route([(0.0, 0.0)])

    def heading(position):
        return once(memory_in(GO), jnp.concatenate([position, jnp.zeros(4)]), plan)[1].eta[5]

    assert np.all(np.isfinite(jax.grad(heading)(jnp.zeros(2))))
