"""The path through way-points and guidance along it."""

import equinox as eqx
import numpy as np
import pytest
from tests.gnc.flying import DT, LAWNMOWER, estimate_of, points, route, run_lengths

from rovtwin.core.block import Start
from rovtwin.core.flow import ABORTED, DIVE, FINISHED, GO, HOLD, IDLE, PAUSED
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.guidance.mission import mission
from rovtwin.gnc.guidance.path import piece_of
from rovtwin.gnc.guidance.path_following import PathGuidance
from rovtwin.gnc.interfaces import MODE_ABORTED, MODE_PAUSED, MODE_RUNNING, GuidanceInput, Mode
from rovtwin.vehicle import load_vehicle

GUIDANCE = PathGuidance(
    acceleration=0.05,
    sideways=0.06,
    turn_rate=0.5,
    lag=0.6,
    onset=0.4,
    patience=0.5,
    depth_tolerance=0.05,
    rest=0.05,
    depth_step=0.1,
)
START = Start.at((0.0, 0.0, 0.5))


def corner(turn_deg, acceptance=0.2, legs=(4.0, 3.0), **options):
    """The piece at a corner after a first leg to the north."""
    turn = np.radians(turn_deg)
    end = np.array([legs[0], 0.0])
    following = end + legs[1] * np.array([np.cos(turn), np.sin(turn)])
    plan = route([tuple(end), tuple(following)], acceptance=acceptance, **options)
    return (
        piece_of(plan, jnp.asarray(0), jnp.zeros(2), jnp.zeros(()), jnp.asarray(0.06), jnp.asarray(0.1)),
        end,
        following,
    )


@pytest.mark.parametrize("turn", [-140, -90, -30, 20, 90, 120])
def test_an_arc_touches_both_legs_and_passes_the_way_point_within_its_radius(turn):
    piece, end, following = corner(turn)
    begin, direction, _ = piece.at(jnp.zeros(()), jnp.asarray(True))
    out, after, _ = piece.at(piece.arc_length, jnp.asarray(True))
    np.testing.assert_allclose(begin, piece.at(piece.length, jnp.asarray(False))[0], atol=1e-12)
    assert direction == pytest.approx(0.0, abs=1e-12)
    assert after == pytest.approx(np.radians(turn))
    along = (following - end) / np.linalg.norm(following - end)
    off = np.asarray(out) - end
    assert abs(off[0] * along[1] - off[1] * along[0]) < 1e-9 and off @ along > 0
    s = np.linspace(0, float(piece.arc_length), 201)
    way = np.asarray(jax.vmap(lambda x: piece.at(x, jnp.asarray(True))[0])(jnp.asarray(s)))
    assert np.hypot(*(way - end).T).min() <= 0.2 + 1e-9
    steps = np.hypot(*np.diff(way, axis=0).T)
    np.testing.assert_allclose(steps, s[1], rtol=1e-4)  # s is arc length


@pytest.mark.parametrize("case", ["back", "stay", "dive", "last"])
def test_where_the_vehicle_stops_there_is_no_corner(case):
    corners = points([(4, 0), (4, 3)])
    if case == "back":
        corners = points([(4, 0), (0, 0)])
    if case == "stay":
        corners[0]["hold_time"] = 3.0
    if case == "dive":
        corners[1]["depth"] = 4.0
    plan = mission(corners[:1] if case == "last" else corners)
    piece = piece_of(plan, jnp.asarray(0), jnp.zeros(2), jnp.zeros(()), jnp.asarray(0.06), jnp.asarray(0.1))
    assert piece.turn == 0.0 and piece.after == 0.0 and piece.length == pytest.approx(4.0)


def test_a_way_point_on_a_straight_line_is_passed_at_speed():
    piece, *_ = corner(0.0)
    assert piece.turn == 0.0 and piece.after == pytest.approx(0.2)


def test_short_legs_leave_room_for_both_corners():
    piece, *_ = corner(90, acceptance=5.0, legs=(4.0, 1.0))
    assert piece.radius == pytest.approx(0.5)


@jax.jit
def travel(plan, modes, drift):
    """A vehicle that is where the set-point was a tick ago, but for a drift (n, 2): pose and set-point."""

    def tick(carry, inputs):
        memory, eta = carry
        mode, off = inputs
        given = GuidanceInput(estimate_of(eta), plan, Mode(mode, jnp.zeros((), dtype=int)))
        memory, setpoint = GUIDANCE.step(memory, given, DT)
        away = setpoint.eta - eta
        dive = jnp.clip(away[2], -0.3 * DT, 0.3 * DT)
        turn = jnp.clip((away[5] + jnp.pi) % (2 * jnp.pi) - jnp.pi, -0.5 * DT, 0.5 * DT)
        after = jnp.concatenate([setpoint.eta[:2] + off, eta[2:3] + dive, jnp.zeros(2), eta[5:] + turn])
        return (memory, after), (eta, setpoint, memory.speed)

    begin = GUIDANCE.init(jax.random.key(0), START), jnp.array([0, 0, 0.5, 0, 0, 0])
    return jax.lax.scan(tick, begin, (modes, drift))[1]


def flown(plan, seconds=240, modes=None, drift=None):
    n = round(seconds / DT)
    modes = np.full(n, MODE_RUNNING) if modes is None else modes
    drift = np.zeros((n, 2)) if drift is None else drift
    return jax.tree.map(np.asarray, travel(plan, jnp.asarray(modes), jnp.asarray(drift)))


@pytest.fixture(scope="module")
def lawnmower():
    return flown(route(LAWNMOWER))


def test_the_whole_mission_is_flown_in_order(lawnmower):
    _, setpoint, _ = lawnmower
    assert run_lengths(setpoint.phase) == [DIVE, GO, HOLD, FINISHED]
    assert run_lengths(setpoint.waypoint) == list(range(7))
    # 33 m at 0.2 m/s are 165 s, less what corners cut, more what speeding up costs.
    assert np.flatnonzero(setpoint.phase == FINISHED)[0] * DT < 190


def test_the_point_moves_smoothly_and_within_its_limits(lawnmower):
    eta, setpoint, speed = lawnmower
    going = setpoint.phase == GO
    place = setpoint.eta[:, :2]
    rate = np.diff(place, axis=0) / DT
    fast = np.hypot(*rate.T)
    assert fast.max() < 0.2 + 1e-6
    acceleration = np.diff(speed) / DT
    assert acceleration.max() <= float(GUIDANCE.acceleration) + 1e-9
    assert acceleration.min() >= -2 * float(GUIDANCE.acceleration) - 1e-9
    # Where it stops for good, from a crawl of a few mm/s, the rest of its speed goes at once.
    moving = (speed[1:-1] > 5e-3) & (speed[2:] > 5e-3)
    jerk = np.diff(acceleration)[moving] / DT
    assert np.abs(jerk).max() <= 2 * float(GUIDANCE.acceleration / GUIDANCE.onset) + 1e-6
    sideways = np.hypot(*(np.diff(rate, axis=0) / DT).T)[going[2:]]
    assert np.quantile(sideways, 0.99) < 0.12  # both at once, and the step at an arc's ends


def test_every_way_point_is_passed_within_its_radius(lawnmower):
    eta, *_ = lawnmower
    for place in LAWNMOWER:
        assert np.hypot(*(eta[:, :2] - place).T).min() < 0.2 + 1e-3


def test_the_point_waits_for_a_vehicle_that_is_held_back():
    plan = route([(10, 0)])
    n = round(60 / DT)
    drift = np.zeros((n, 2))
    drift[round(20 / DT) :, 0] = -1.5
    _, setpoint, speed = flown(plan, 60, drift=drift)
    assert speed[round(18 / DT)] == pytest.approx(0.2, abs=1e-3)
    assert speed[-1] < 1e-6 and setpoint.phase[-1] == GO


def test_paused_it_comes_to_rest_on_the_path_and_goes_on():
    n = round(120 / DT)
    modes = np.full(n, MODE_RUNNING)
    modes[round(25 / DT) : round(50 / DT)] = MODE_PAUSED
    _, setpoint, speed = flown(route([(8, 0)]), 120, modes)
    rest = slice(round(32 / DT), round(50 / DT))
    assert (setpoint.phase[rest] == PAUSED).all() and speed[rest].max() < 1e-3
    assert np.ptp(setpoint.eta[rest, 0]) < 1e-2
    assert setpoint.phase[-1] == FINISHED


def test_aborted_it_says_so_and_before_the_start_it_stays_where_the_vehicle_is():
    modes = np.full(200, MODE_ABORTED)
    _, setpoint, _ = flown(route([(8, 0)]), 4, modes)
    assert (setpoint.phase == ABORTED).all()
    _, setpoint, _ = flown(route([(8, 0)]), 4, np.zeros(200, dtype=int))
    assert (setpoint.phase == IDLE).all()
    np.testing.assert_allclose(setpoint.eta[:, :2], 0.0, atol=1e-12)


@eqx.filter_jit
def drifting(guidance, plan, psi):
    """A vehicle that goes to the set-point's place and depth, with the heading psi that the water gives it, (n,)."""

    def tick(carry, psi):
        memory, eta = carry
        eta = eta.at[5].set(psi)
        given = GuidanceInput(estimate_of(eta), plan, Mode(jnp.asarray(MODE_RUNNING), jnp.zeros((), dtype=int)))
        memory, setpoint = guidance.step(memory, given, DT)
        dive = jnp.clip(setpoint.eta[2] - eta[2], -0.3 * DT, 0.3 * DT)
        return (memory, eta.at[:2].set(setpoint.eta[:2]).at[2].add(dive)), setpoint

    begin = guidance.init(jax.random.key(0), START), jnp.array([0, 0, 0.5, 0, 0, 0])
    return jax.lax.scan(tick, begin, psi)[1]


@pytest.mark.parametrize("heading", [{}, {"heading": 0.0}])
def test_without_thrust_in_yaw_no_dive_and_no_corner_waits_for_a_heading(heading):
    guidance = PathGuidance.of(load_vehicle("blueye_pioneer").model())
    psi = jnp.linspace(1.0, 2.5, round(120 / DT))
    setpoint = drifting(guidance, route([(3, 0), (3, 3)], depth=2.0, **heading), psi)
    assert run_lengths(setpoint.phase) == [DIVE, GO, HOLD, FINISHED] and run_lengths(setpoint.waypoint) == [0, 1]
    np.testing.assert_allclose(setpoint.eta[:, 5], psi)
    # The corner takes nothing from the speed but what its radius does.
    speed = np.hypot(*np.asarray(setpoint.nu)[:, :2].T)
    corner = np.hypot(*(np.asarray(setpoint.eta)[:, :2] - [3.0, 0.0]).T) < 0.3
    assert speed[corner].min() > 0.05


@pytest.mark.system
@pytest.mark.parametrize(("phase", "mode"), [(DIVE, 0), (GO, 0), (HOLD, 0), (FINISHED, 0), (HOLD, MODE_PAUSED)])
@pytest.mark.parametrize("end", [(6.0, 0.0), (0.0, 0.0)], ids=["leg north", "leg without length"])
def test_a_vehicle_looks_where_it_can_stay_whatever_it_is_about(phase, mode, end):
    """The speed of a leg that a current has a part along hid that sway does not stem what is left when it waits."""
    guidance, current = PathGuidance.of(load_vehicle("double_blueye").model()), jnp.array([0.15, -0.25])
    sustained = guidance.sustained
    estimate = estimate_of([0.0, 0.0, 3.0, 0.0, 0.0, 0.0])
    estimate = eqx.tree_at(lambda e: e.bias, estimate, estimate.bias.at[:2].set(-sustained._drag(-current)))
    np.testing.assert_allclose(sustained.current(estimate), current, atol=1e-9)
    memory = guidance.init(jax.random.key(0), START)
    memory = eqx.tree_at(lambda m: m.phase, memory, jnp.asarray(phase))
    given = GuidanceInput(estimate, route([end], depth=3.0), Mode(jnp.asarray(mode or MODE_RUNNING), jnp.asarray(0)))
    _, headings = jax.lax.scan(
        lambda m, _: (lambda after, asked: (after, asked.heading))(*guidance.step(m, given, DT)), memory, None, 6000
    )
    before, psi = float(headings[-2]), float(headings[-1])
    assert psi == pytest.approx(before, abs=1e-6)
    stemmed = abs(np.sin(psi) * float(current[0]) - np.cos(psi) * float(current[1]))
    assert stemmed <= float(sustained.aside_speed()) + 1e-6
