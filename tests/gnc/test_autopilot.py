import equinox as eqx
import numpy as np
import pytest
from tests.gnc.flying import DT, LAWNMOWER, SQUARE, Perfect, feel, fly, route, run_lengths, thirty_kg, two_bodies

from rovtwin.core.block import Start
from rovtwin.core.flow import (
    ABORT,
    ABORTED,
    DIVE,
    ESTIMATE_LOST,
    FINISHED,
    GO,
    HOLD,
    IDLE,
    NO_REASON,
    NO_REQUEST,
    NOT_A_NUMBER,
    OPERATOR,
    PAUSE,
    PAUSED,
    RESUME,
    TURN,
)
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.autopilot import Autopilot
from rovtwin.gnc.safety.rules import RULES, Rules
from rovtwin.gnc.safety.supervisor import Supervisor
from rovtwin.vehicle.physics.thrusters import static_force

KEY = jax.random.key(0)
START = Start.at((0.0, 0.0, 0.5))
# Two sizes of the same scan, so that it compiles twice for the whole file.
LONG, SHORT = round(400 / DT), round(80 / DT)


@pytest.fixture(scope="module")
def model():
    # Roll damping as the thesis has it: with less, its roll gains (K_i without K_d) rock the vehicle.
    return thirty_kg(linear_damping_ahead=np.diag([6.5, 5.0, 10.0, 3.78, 1.0, 0.2]))


def pilot(model, corners=SQUARE, gains="table_7_1", **options):
    supervisor = options.pop("supervisor", None)
    return Autopilot.thesis(model, Perfect(), route(corners, **options), gains=gains, supervisor=supervisor)


@eqx.filter_jit
def tick(autopilot, memory, input):
    return autopilot.step(memory, input, DT)


def requests(n, **at):
    """One request per tick; `at` maps seconds (t20=PAUSE) to requests."""
    asked = np.full(n, NO_REQUEST)
    for when, request in at.items():
        asked[round(float(when[1:]) / DT)] = request
    return jnp.asarray(asked)


def flown(*args, **kwargs):
    return jax.tree.map(np.asarray, fly(*args, **kwargs))


def cross_track(truth, setpoint):
    on = setpoint.on_leg
    start, way = setpoint.leg_start[on, :2], (setpoint.leg_end - setpoint.leg_start)[on, :2]
    away = truth[on, :2] - start
    return (way[:, 0] * away[:, 1] - way[:, 1] * away[:, 0]) / np.linalg.norm(way, axis=1)


# Missions


@pytest.mark.system
@pytest.mark.parametrize("gains", ["table_7_1", "pole_placement"])
def test_square_of_the_thesis(model, gains):
    truth, output = flown(pilot(model, gains=gains), model, START, requests(LONG))
    assert run_lengths(output.setpoint.phase) == [DIVE, TURN, GO, HOLD] * 4 + [FINISHED]
    assert np.all(output.setpoint.reason == NO_REASON)
    assert np.sqrt(np.mean(cross_track(truth, output.setpoint) ** 2)) < 0.2
    assert np.hypot(*truth[-1, :2]) < 0.2 and abs(truth[-1, 2] - 3.0) < 0.1  # finished holds station
    assert np.abs(output.command.u).max() <= 1.0


@pytest.mark.slow
def test_lawn_mower_of_the_thesis_keeps_to_speed_with_gains_from_the_model(model):
    plan = route(LAWNMOWER, speed=0.2)
    autopilot = Autopilot.thesis(model, Perfect(), plan, gains="pole_placement", obey_speed=True)
    truth, output = flown(autopilot, model, START, requests(LONG))
    assert output.setpoint.phase[-1] == FINISHED
    error = cross_track(truth, output.setpoint)
    assert np.sqrt(np.mean(error**2)) < 0.08 and np.abs(error).max() < 0.25
    on = output.setpoint.on_leg
    assert np.hypot(truth[on, 6], truth[on, 7]).max() < 0.25


@pytest.mark.system
def test_gains_without_integral_never_finish_against_buoyancy(model):
    """2 N up: table 7.1 stops 2 m above the depth and stays in the dive for ever; the integral brings it down."""
    lift = jnp.array([0, 0, -2.0, 0, 0, 0])
    _, output = flown(pilot(model), model, START, requests(LONG), lift)
    assert run_lengths(output.setpoint.phase) == [DIVE]
    truth, output = flown(pilot(model, gains="pole_placement"), model, START, requests(LONG), lift)
    assert output.setpoint.phase[-1] == FINISHED
    assert abs(truth[-1, 2] - 3.0) < 0.05


# The operator and the supervisor


def test_pause_holds_station_and_resume_goes_on(model):
    autopilot = pilot(model, gains="pole_placement")
    truth, output = flown(autopilot, model, START, requests(LONG, t30=PAUSE, t150=RESUME))
    paused = output.setpoint.phase == PAUSED
    assert np.flatnonzero(paused)[[0, -1]].tolist() == [round(30 / DT), round(150 / DT) - 1]
    spot = truth[round(30 / DT), :3]
    assert np.linalg.norm(truth[round(140 / DT) : round(150 / DT), :3] - spot, axis=1).max() < 0.1
    assert output.setpoint.phase[-1] == FINISHED


@pytest.mark.system
def test_waits_for_the_word_with_thrusters_off(model):
    asked = np.full(SHORT, NO_REQUEST)
    asked[:500] = PAUSE
    truth, output = flown(pilot(model), model, START, jnp.asarray(asked))
    assert np.all(output.setpoint.phase[:500] == IDLE) and output.setpoint.phase[500] == DIVE
    assert not np.any(output.command.u[:500])
    np.testing.assert_allclose(truth[500], truth[0], atol=1e-9)
    assert np.any(output.command.u[501])


def test_abort_stops_the_thrusters_at_once_and_for_good(model):
    _, output = flown(pilot(model), model, START, requests(SHORT, t20=ABORT, t30=RESUME, t40=PAUSE))
    at = round(20 / DT)
    assert np.any(output.command.u[at - 1])
    assert not np.any(output.command.u[at:]) and not np.any(output.wrench.tau[at:])
    assert np.all(output.setpoint.phase[at:] == ABORTED) and np.all(output.setpoint.reason[at:] == OPERATOR)


@pytest.mark.parametrize("entry", [0, 5, 11])
def test_no_nan_reaches_the_command(model, entry):
    """One bad tick is enough to abort; the estimate in the log keeps its NaN, all else stays a number."""
    at = round(20 / DT)
    offset = np.zeros((SHORT, 12))
    offset[at, entry] = np.nan
    _, output = flown(pilot(model), model, START, requests(SHORT), None, jnp.asarray(offset))
    assert np.any(np.isnan(output.estimate.eta[at])) or np.any(np.isnan(output.estimate.nu[at]))
    rest = (output.command, output.setpoint, output.reference, output.wrench)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(rest))
    assert not np.any(output.command.u[at:])
    assert np.all(output.setpoint.reason[at:] == NOT_A_NUMBER) and output.setpoint.phase[-1] == ABORTED


def test_lost_estimate_aborts(model):
    autopilot = pilot(
        model, supervisor=Supervisor(Rules.of({"estimate lost": RULES["estimate lost"]._replace(limit=2.0)}))
    )
    memory = autopilot.init(KEY, START)
    truth = jnp.array([0, 0, 0.5] + [0.0] * 9)
    memory, output = tick(autopilot, memory, feel(truth, NO_REQUEST, std=1.9))
    assert int(output.setpoint.phase) == DIVE
    memory, output = tick(autopilot, memory, feel(truth, NO_REQUEST, std=2.1))
    assert int(output.setpoint.phase) == ABORTED and int(output.setpoint.reason) == ESTIMATE_LOST


# What goes out


def load_wrench_is_what_the_thrusters_are_sent(model):
    _, output = flown(pilot(model, gains="pole_placement"), model, START, requests(SHORT))
    reported = jax.vmap(lambda u: static_force(model.thrusters, u))(output.command.u) @ two_bodies().T
    free = ~np.any(output.wrench.saturated, axis=1)
    assert 0.1 < free.mean() < 0.999
    np.testing.assert_allclose(reported[free], output.wrench.tau[free], atol=1e-8)
    shortened = np.any(np.abs(reported - output.wrench.tau) > 1e-6, axis=1)
    assert np.all(~free[shortened])


class Spy(Perfect):
    """Shows in the disturbance which command it was given."""

    def step(self, memory, input, dt):
        memory, estimate = super().step(memory, input, dt)
        return memory, eqx.tree_at(lambda e: e.bias, estimate, input.command.u)


@pytest.mark.system
def test_observer_gets_the_command_that_was_sent(model):
    autopilot = Autopilot.thesis(model, Spy(), route(SQUARE))
    _, output = flown(autopilot, model, START, requests(SHORT))
    assert not np.any(output.estimate.bias[0])
    np.testing.assert_array_equal(output.estimate.bias[1:], output.command.u[:-1])


def test_unknown_gains_are_named(model):
    with pytest.raises(ValueError, match="'fast', expected one of table_7_1, table_3_2, pole_placement"):
        Autopilot.thesis(model, Perfect(), route(SQUARE), gains="fast")  # type: ignore[arg-type]


# The contract of a Block


@pytest.mark.slow
def test_loop_scan_and_batch_agree(model):
    autopilot = pilot(model, gains="pole_placement")
    n = 40
    rng = np.random.default_rng(1)
    truth = np.cumsum(rng.normal(0, 0.02, (n, 12)), axis=0)
    truth[:, 2] += 2.9
    inputs = jax.vmap(lambda t, r: feel(t, r))(jnp.asarray(truth), requests(n, t0=PAUSE))
    memory = begin = autopilot.init(KEY, START)

    looped = []
    for k in range(n):
        memory, output = tick(autopilot, memory, jax.tree.map(lambda leaf, k=k: leaf[k], inputs))
        looped.append(output)
    kinds = [(leaf.shape, leaf.dtype, leaf.weak_type) for leaf in jax.tree.leaves(begin)]
    assert [(leaf.shape, leaf.dtype, leaf.weak_type) for leaf in jax.tree.leaves(memory)] == kinds
    assert jax.tree.structure(begin) == jax.tree.structure(memory)

    def scan(inputs):
        return jax.lax.scan(lambda m, i: autopilot.step(m, i, DT), begin, inputs)[1]

    scanned = jax.jit(scan)(inputs)
    batched = jax.jit(jax.vmap(scan))(jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), inputs))
    scanned, batched, looped = jax.tree.map(np.asarray, (scanned, batched, looped))
    for k, expected in enumerate(looped):
        for got in (jax.tree.map(lambda leaf: leaf[k], scanned), jax.tree.map(lambda leaf: leaf[1, k], batched)):  # noqa: B023
            jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-10), got, expected)


@pytest.mark.system
def test_gradient_by_gains_is_finite_and_right(model):
    autopilot, truth = pilot(model), jnp.array([0.1, 0.2, 0.5, 0.02, 0.01, 0.3] + [0.01] * 6)

    def push(K_p):
        changed = eqx.tree_at(lambda a: a.control.K_p, autopilot, K_p)
        memory = changed.init(KEY, START)
        for _ in range(2):
            memory, output = changed.step(memory, feel(truth, NO_REQUEST), DT)
        return output.command.u @ jnp.arange(1.0, 7.0)

    K_p = jnp.array([1.5, 1.0, 1.0, 3.0, 0.0, 0.6])
    value_and_slope = jax.jit(jax.value_and_grad(push))
    _, slope = value_and_slope(K_p)
    h = 1e-6
    for axis in (0, 2, 5):
        side = h * np.eye(6)[axis]
        by_hand = (value_and_slope(K_p + side)[0] - value_and_slope(K_p - side)[0]) / (2 * h)
        assert float(slope[axis]) == pytest.approx(float(by_hand), rel=1e-6) and slope[axis] != 0
    assert np.all(np.isfinite(slope))
