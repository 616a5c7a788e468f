"""The error-state filter: its slopes, its corrections, what it does with late, wrong and missing positions."""

import equinox as eqx
import numpy as np
import pytest
from tests.gnc.observer_cases import double_body
from tests.vehicle.discrepancies import block, random_part

from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Slot
from rovtwin.core.frames import quaternion_from_euler, rotation_from_quaternion
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.interfaces import ObserverInput
from rovtwin.gnc.navigation import measurements as readings
from rovtwin.gnc.navigation import prediction as motion
from rovtwin.gnc.navigation.corrections import covariance_inflation
from rovtwin.gnc.navigation.filter import Forecast, NavigationFilter
from rovtwin.gnc.navigation.state import ERRORS, NavigationState
from rovtwin.gnc.navigation.tuning import Mount, Tuning
from rovtwin.gnc.navigation.wave_estimator import SeaState
from rovtwin.vehicle.description.learned import discrepancy_from
from rovtwin.vehicle.description.schema import LearnedDiscrepancy
from rovtwin.vehicle.physics.discrepancy import kernels
from rovtwin.vehicle.physics.thrusters import command_for_force

pytestmark = pytest.mark.system

DT = 0.02
RNG = np.random.default_rng(4)
TURNING = motion.Turning(jnp.array([0.05, -0.04, 0.3]), jnp.array([0.1, 0.05, -0.2]))
WAVES = motion.Waves(jnp.asarray(1.2), jnp.asarray(0.2), jnp.full(3, 1e-4))
TAU = jnp.array([8.0, -3.0, 5.0, 0.5, 0.0, 1.0])


@pytest.fixture(scope="module")
def model():
    return double_body("towing")


@pytest.fixture(scope="module")
def state():
    at = NavigationState.at(Start.at((1.0, 2.0, 3.0)))
    error = 0.3 * RNG.standard_normal(ERRORS)
    turned = eqx.tree_at(lambda s: s.attitude, at, quaternion_from_euler(jnp.array([0.1, -0.2, 0.8])))
    return turned.corrected(jnp.asarray(error))


def slope_of(value, x):
    """Derivative by the error of the state at zero error, by automatic differentiation."""
    return np.asarray(jax.jit(jax.jacfwd(lambda error: value(x.corrected(error))))(jnp.zeros(ERRORS)))


@pytest.mark.parametrize("opinion", ["model", "accelerometer", "waves", "both"])
def test_slopes_are_derivatives(model, state, opinion):
    makers = {
        "model": lambda x: motion.by_model(model, x, TAU, TURNING),
        "accelerometer": lambda x: motion.by_accelerometer(x, jnp.array([0.1, 0.2, -9.7]), jnp.ones(3), TURNING),
        "waves": lambda x: motion.by_waves(x, WAVES),
        "both": lambda x: motion.sum_of(
            motion.by_model(model, x, TAU, TURNING),
            motion.by_waves(x, WAVES),
            rotation_from_quaternion(x.attitude),
        ),
    }
    expected = slope_of(lambda x: makers[opinion](x).value, state)
    np.testing.assert_allclose(makers[opinion](state).slope, expected, atol=1e-9)


@pytest.fixture(scope="module")
def learned(model):
    rng = np.random.default_rng(11)
    parts = [random_part(rng, "surge", "motion"), random_part(rng, "sway", "thrust")]
    found = LearnedDiscrepancy.model_validate(block(parts))
    return model.replace(discrepancy=discrepancy_from(found, model.thrusters.configuration, "learned", 1.0))


def test_slopes_hold_with_a_learned_discrepancy(model, learned, state):
    expected = slope_of(lambda x: motion.by_model(learned, x, TAU, TURNING).value, state)
    found = motion.by_model(learned, state, TAU, TURNING)
    np.testing.assert_allclose(found.slope, expected, atol=1e-9)
    assert np.abs(found.value - motion.by_model(model, state, TAU, TURNING).value).max() > 1e-4


def test_what_a_learned_discrepancy_leaves_open_is_process_noise(model, learned, state):
    def doubt(at, model):
        return np.asarray(motion.learned_doubt(model, at, TAU, TURNING.omega))

    fast = eqx.tree_at(lambda s: s.velocity, state, jnp.full(3, 30.0))
    assert np.all(doubt(fast, learned)[:2] >= doubt(state, learned)[:2]) and doubt(fast, learned)[0] > 1e-4
    inverse = np.asarray(motion.force_inverse(learned))
    discrepancy = learned.discrepancy
    _, whole = kernels(discrepancy, jnp.full(6, 30.0), TAU)  # thrust is where it was
    prior = np.asarray(jnp.sum(discrepancy.along * discrepancy.std**2 * whole, axis=1))[:3]
    np.testing.assert_allclose(doubt(fast, learned), inverse**2 @ prior, rtol=1e-6)
    assert motion.learned_doubt(model, fast, TAU, TURNING.omega) == 0.0

    def velocity_std(model):
        filter = NavigationFilter(model, Tuning.of(model))
        memory = eqx.tree_at(lambda m: m.x.velocity, filter.init(None, Start.at((0.0, 0.0, 2.0))), fast.velocity)
        command = Command(jnp.zeros(model.thrusters.count))
        after, _ = jax.jit(lambda m: filter.step(m, ObserverInput({"pressure": slot(2.0)}, command), DT))(memory)
        return np.sqrt(np.diag(after.P))[3]

    assert velocity_std(learned) > velocity_std(model)


def slot(*values, t=0.0):
    value = jnp.atleast_2d(jnp.asarray(values, dtype=float))
    return Slot(value, jnp.ones(len(value), dtype=bool), jnp.full(len(value), t))


@pytest.mark.parametrize("sensor", ["attitude", "pressure", "position", "dvl"])
def test_residuals_fall_as_their_slopes_say(state, sensor):
    mount = Mount(0.1, (0.2, -0.1, 0.3), np.eye(3))
    now, omega, still = jnp.asarray(5.0), TURNING.omega, jnp.zeros(3)
    makers = {
        "attitude": lambda x: readings.attitude(x, slot([0.1, -0.2, 0.8], t=5.0), mount, omega, now, 2.0),
        "pressure": lambda x: readings.pressure(x, slot([3.0], t=5.0), mount, still, jnp.zeros(()), now, 2.0),
        "position": lambda x: readings.position(x, jnp.array([1.0, 2.0]), jnp.zeros(()), jnp.zeros(2), mount),
        "dvl": lambda x: readings.dvl(x, slot([0.1, 0.2, 0.0], t=5.0), mount, omega, jnp.zeros(3), still, now, 2.0),
    }
    at = state
    if sensor == "attitude":  # a small angle: the slope holds where the reading is
        at = eqx.tree_at(lambda s: s.attitude, state, quaternion_from_euler(jnp.array([0.1, -0.2, 0.8])))
    expected = -slope_of(lambda x: makers[sensor](x).residual, at)
    if sensor == "attitude":
        expected = expected[:, 6:9]
        np.testing.assert_allclose(makers[sensor](at).slope[:, 6:9], expected, atol=1e-9)
    elif sensor == "dvl":  # what the attitude does to the waves' share is left out
        np.testing.assert_allclose(makers[sensor](at).slope[:, 3:6], expected[:, 3:6], atol=1e-9)
        np.testing.assert_allclose(makers[sensor](at).slope[:, 12:15], expected[:, 12:15], atol=1e-9)
    else:
        np.testing.assert_allclose(makers[sensor](at).slope, expected, atol=1e-9)


def test_shares_of_model_sensor_and_waves_leave_no_more_noise_than_any_of_them():
    """Var((w_m, w_w) | sum) by the usual formula, against what `_noise` hands to the prediction."""
    S = {"model": 4e-6, "waves": 1e-4, "sensor": 1e-5}
    total = sum(S.values())
    joint = np.diag([S["model"], S["waves"]])
    left = joint - np.outer([S["model"], S["waves"]], [S["model"], S["waves"]]) / total
    filter = NavigationFilter(double_body(), Tuning.of(double_body()))
    one = jnp.ones(3)
    forecast = Forecast(None, None, S["model"] * one, S["waves"] * one, one / total)
    x = NavigationState.at(Start.at((0.0, 0.0, 1.0), 0.7))
    Q = np.asarray(filter._noise(x, forecast, jnp.zeros(()))) - np.diag(np.asarray(filter.tuning.walk) ** 2)
    R = np.asarray(rotation_from_quaternion(x.attitude))
    np.testing.assert_allclose(Q[3:6, 3:6], left[0, 0] * np.eye(3), atol=1e-18)
    np.testing.assert_allclose(Q[12:15, 12:15], left[1, 1] * np.eye(3), atol=1e-18)
    np.testing.assert_allclose(Q[12:15, 3:6], left[1, 0] * R, atol=1e-18)
    assert np.linalg.eigvalsh(Q)[0] > -1e-18


def test_the_sea_is_estimated_from_its_acceleration():
    """A sine of 1 rad/s in north with the accelerometer's noise: variance and frequency; in a calm nothing is left."""
    rng, amplitude, frequency = np.random.default_rng(1), 0.05, 0.8
    t = np.arange(0, 150, DT)
    noise = 0.02

    def received_of(amplitude):
        a = np.zeros((len(t), 3)) + noise * rng.standard_normal((len(t), 3))
        a[:, 0] += amplitude * np.sin(frequency * t)

        def tick(sea, a):
            return sea.after(a, jnp.full(3, noise**2), jnp.asarray(True), DT), sea.frequency

        return jax.lax.scan(tick, SeaState.unknown(), jnp.asarray(a))

    rough, frequencies = received_of(amplitude)
    assert float(rough.acceleration_variance[0]) == pytest.approx(0.5 * amplitude**2, rel=0.15)
    assert np.mean(frequencies[-1000:]) == pytest.approx(frequency, rel=0.15)
    calm, _ = received_of(0.0)
    assert np.abs(np.asarray(calm.acceleration_variance)).max() < 0.02 * 0.5 * amplitude**2


# The filter at work: a vehicle at rest, positions as a list of (time, reading, stamp).

MOUNTS = {"position": Mount(0.5), "attitude": Mount(1e-3), "pressure": Mount(1e-3), "gyro": Mount(3e-5)}


@eqx.filter_jit
def listened(filter, positions, valid, stamps):
    def tick(memory, inputs):
        value, there, stamp = inputs
        yes, now = jnp.ones(1, dtype=bool), memory.ticks * DT
        slots = {
            "attitude": Slot(jnp.zeros((1, 3)), yes, now[None]),
            "gyro": Slot(jnp.zeros((1, 3)), yes, now[None]),
            "position": Slot(value[None], there[None], stamp[None]),
            "pressure": Slot(jnp.full((1, 1), 2.0), yes, now[None]),
        }
        memory, estimate = filter.step(memory, ObserverInput(slots, Command(jnp.zeros(6))), DT)
        return memory, (estimate.eta, estimate.covariance, estimate.nis_dof)

    start = Start.at((0.0, 0.0, 2.0))
    return jax.lax.scan(tick, filter.init(jax.random.key(0), start), (positions, valid, stamps))[1]


SECONDS = 60


def positions_once_a_second(change=None, late=0.0):
    """Arrays for `listened`: noisy readings of a vehicle at rest at the origin, every 50 ticks."""
    n = round(SECONDS / DT)
    rng = np.random.default_rng(2)
    value, valid = np.zeros((n, 2)), np.arange(n) % 50 == 49
    value[valid] = 0.5 * rng.standard_normal((valid.sum(), 2))
    if change is not None:
        change(value, valid)
    return jnp.asarray(value), jnp.asarray(valid), jnp.asarray(np.arange(n) * DT - late)


@pytest.fixture(scope="module")
def at_rest(model):
    return NavigationFilter(model, Tuning.of(model, MOUNTS))


def test_one_wrong_position_is_refused(at_rest):
    def wrong(value, valid):
        value[30 * 50 - 1] += [4.0, 3.0]

    eta, _, dof = map(np.asarray, listened(at_rest, *positions_once_a_second(wrong)))
    plain, _, all_of_them = map(np.asarray, listened(at_rest, *positions_once_a_second()))
    assert dof[:, 2].sum() == all_of_them[:, 2].sum() - 2  # sorted: attitude, gyro, position, pressure
    assert np.abs(eta[-1, :2] - plain[-1, :2]).max() < 0.15


def test_a_filter_that_errs_is_found_again_within_five_fixes(at_rest):
    """The readings jump by 18 m and stay there: no gate may lock the filter out."""

    def jump(value, valid):
        value[30 * 50 :] += [15.0, 10.0]

    eta, P, _ = map(np.asarray, listened(at_rest, *positions_once_a_second(jump)))
    before, after = eta[30 * 50 + 49], eta[30 * 50 + 5 * 50]
    assert np.abs(before[:2]).max() < 1.0
    assert np.abs(after[:2] - [15.0, 10.0]).max() < 2.0
    assert np.sqrt(P[30 * 50 + 5 * 50, 0, 0]) < 2.0


def test_while_nothing_comes_the_filter_grows_unsure(at_rest):
    def gone(value, valid):
        valid[20 * 50 : 50 * 50] = False

    _, P, _ = map(np.asarray, listened(at_rest, *positions_once_a_second(gone)))
    std = np.sqrt(P[:, 0, 0])
    assert std[50 * 50 - 2] > 3.0 * std[20 * 50 - 2]
    assert std[-1] < 0.5 * std[50 * 50 - 2]


def test_a_late_position_tells_where_the_vehicle_was(model):
    """At 0.5 m/s and 1.5 s of age, taken as new a reading would be 0.75 m off."""
    speed, age = 0.5, 1.5
    tuning = Tuning.of(model, {"position": Mount(0.05), "attitude": Mount(1e-3), "gyro": Mount(3e-5)})
    tuning = eqx.tree_at(lambda t: t.initial_std, tuning, tuning.initial_std.at[3].set(1.0))
    sure = NavigationFilter(model, tuning)

    @eqx.filter_jit
    def run(filter):
        def tick(memory, k):
            now, yes = k * DT, jnp.ones(1, dtype=bool)
            there = jnp.array([[speed * (now - age), 0.0]])
            slots = {
                "attitude": Slot(jnp.zeros((1, 3)), yes, now[None]),
                "gyro": Slot(jnp.zeros((1, 3)), yes, now[None]),
                "position": Slot(there, ((k % 25 == 0) & (now > age))[None], (now - age)[None]),
            }
            drag = model.linear_damping_ahead[0, 0] * speed + model.quadratic_damping_ahead[0, 0] * speed**2
            u = command_of(model, drag)
            memory, estimate = filter.step(memory, ObserverInput(slots, Command(u)), DT)
            return memory, estimate.eta[0] - speed * now

        memory = filter.init(jax.random.key(0), Start.at((0.0, 0.0, 2.0)))
        return jax.lax.scan(tick, memory, jnp.arange(2000))[1]

    error = np.asarray(run(sure))
    assert np.abs(error[1500:]).max() < 0.1
    assert np.abs(np.asarray(run(eqx.tree_at(lambda f: f.tuning.max_age, sure, jnp.asarray(0.0))))[1500:]).min() > 0.5


def command_of(model, force):
    """Commands of the surge thrusters that make a force."""
    surge = model.thrusters.configuration[0]
    return command_for_force(model.thrusters, surge * force / jnp.sum(surge**2))


@eqx.filter_jit
def at_a_wrong_start(filter, start):
    def tick(memory, _):
        now, yes = memory.ticks * DT, jnp.ones(1, dtype=bool)
        slots = {
            "attitude": Slot(jnp.zeros((1, 3)), yes, now[None]),
            "gyro": Slot(jnp.zeros((1, 3)), yes, now[None]),
            "pressure": Slot(jnp.full((1, 1), 2.0), yes, now[None]),
        }
        memory, estimate = filter.step(memory, ObserverInput(slots, Command(jnp.zeros(6))), DT)
        return memory, estimate.eta

    return jax.lax.scan(tick, filter.init(jax.random.key(0), start), None, 60)[1]


@pytest.mark.parametrize("sensor", ["attitude", "pressure"])
def test_no_sensor_is_locked_out_for_good(model, sensor):
    """A start that is 0.5 rad or 1 m off: what a sensor says in earnest for a third of a second is accepted."""
    filter = NavigationFilter(model, Tuning.of(model, MOUNTS))
    start = Start.at((0.0, 0.0, 3.0 if sensor == "pressure" else 2.0), 0.5 if sensor == "attitude" else 0.0)

    eta = np.asarray(at_a_wrong_start(filter, start))
    i = 2 if sensor == "pressure" else 5
    right = 2.0 if sensor == "pressure" else 0.0
    assert abs(eta[5, i] - right) > 0.4  # at first it is taken for an outlier
    assert abs(eta[-1, i] - right) < 0.02


@eqx.filter_jit
def accelerated(filter, readings):
    """A vehicle at rest whose accelerometer says something, tick by tick: largest speed, variance of the sea."""

    def tick(memory, extra):
        now, yes = memory.ticks * DT, jnp.ones(1, dtype=bool)
        slots = {
            "accelerometer": Slot(jnp.array([[0.0, 0.0, -9.81]]) + extra, yes, now[None]),
            "attitude": Slot(jnp.zeros((1, 3)), yes, now[None]),
            "gyro": Slot(jnp.zeros((1, 3)), yes, now[None]),
            "position": Slot(jnp.zeros((1, 2)), (memory.ticks % 50 == 49)[None], now[None]),
            "pressure": Slot(jnp.full((1, 1), 2.0), yes, now[None]),
        }
        memory, estimate = filter.step(memory, ObserverInput(slots, Command(jnp.zeros(6))), DT)
        return memory, (estimate.nu[:3], estimate.bias[:3], memory.sea.acceleration_variance, estimate.eta[:3])

    memory = filter.init(jax.random.key(0), Start.at((0.0, 0.0, 2.0)))
    return jax.lax.scan(tick, memory, readings)[1]


ACCELERATED = MOUNTS | {"accelerometer": Mount(0.0308)}


@pytest.mark.parametrize("fault", ["spike", "offset", "dead"])
def test_a_broken_accelerometer_moves_nothing(model, fault):
    """One reading of 50 m/s2, 5 m/s2 for a second, zeros for good: refused, not integrated, and no waves either."""
    n = round(30 / DT)
    extra = np.zeros((n, 3))
    begin = round(20 / DT)
    if fault == "spike":
        extra[begin, 0] = 50.0
    if fault == "offset":
        extra[begin : begin + 50, 0] = 5.0
    if fault == "dead":
        extra[begin:, 2] = 9.81
    nu, bias, sea, eta = map(
        np.asarray, accelerated(NavigationFilter(model, Tuning.of(model, ACCELERATED)), jnp.asarray(extra))
    )
    assert np.abs(nu[begin:]).max() < 0.05 and np.abs(eta[begin:, :2]).max() < 0.3
    assert np.abs(bias[begin:]).max() < 5.0
    assert sea[-1].max() < 2.0 * max(sea[begin - 1].max(), 1e-5)


def test_a_force_that_lasts_is_learnt_from_the_accelerometer(model):
    """0.4 m/s2 for good, which a tether that is caught may do: taken for a force within a second, in large part."""
    extra = np.zeros((round(22 / DT), 3))
    extra[round(20 / DT) :, 0] = 0.4
    _, bias, _, _ = map(
        np.asarray, accelerated(NavigationFilter(model, Tuning.of(model, ACCELERATED)), jnp.asarray(extra))
    )
    mass = float(model.inertia[0, 0])
    assert 0.3 * 0.4 * mass < bias[round(21 / DT), 0] < 1.2 * 0.4 * mass


def test_what_is_not_a_number_is_ignored(at_rest):
    def broken(value, valid):
        value[20 * 50 - 1] = np.nan

    eta, _, dof = map(np.asarray, listened(at_rest, *positions_once_a_second(broken)))
    assert np.isfinite(eta).all() and dof[20 * 50 - 1, 2] == 0


def test_a_start_that_is_known_is_known_with_the_waves_in_it(model):
    """Place and waves' displacement are not known apart: their sum is as sure as the start, whatever the sea."""
    tuning = Tuning.of(model, MOUNTS)
    for std in (0.0, 0.3):
        start = Start(jnp.zeros(3), jnp.array([1.0, 0.0, 0.0, 0.0]), jnp.zeros(6), jnp.asarray(std))
        P = np.asarray(NavigationFilter(model, tuning).init(jax.random.key(0), start).P)
        together = P[:2, :2] + P[:2, 9:11] + P[9:11, :2] + P[9:11, 9:11]
        np.testing.assert_allclose(together, std**2 * np.eye(2), atol=1e-12)
        assert np.linalg.eigvalsh(P).min() > -1e-12


def test_with_a_doppler_log_the_filter_is_consistent(model):
    """40 vehicles at rest, five seconds of velocities: the place is where the start was, and as sure as it was."""
    n, vehicles = 250, 40
    rng = np.random.default_rng(3)
    filter = NavigationFilter(model, Tuning.of(model, MOUNTS | {"dvl": Mount(0.005)}))
    velocity = jnp.asarray(0.005 * rng.standard_normal((vehicles, n, 3)))
    away = np.pad(rng.standard_normal((vehicles, 2)), ((0, 0), (0, 1)))

    @eqx.filter_jit
    def listened_to(places, std):
        yes, level = jnp.ones(1, dtype=bool), jnp.array([1.0, 0.0, 0.0, 0.0])

        def one(place, velocity):
            def tick(memory, inputs):
                v, k = inputs
                now = (k * DT)[None]
                slots = {
                    "attitude": Slot(jnp.zeros((1, 3)), yes, now),
                    "gyro": Slot(jnp.zeros((1, 3)), yes, now),
                    "dvl": Slot(v[None], (k % 5 == 4)[None], now),
                }
                return filter.step(memory, ObserverInput(slots, Command(jnp.zeros(6))), DT)

            begun = filter.init(jax.random.key(0), Start(place, level, jnp.zeros(6), std))
            # Without an accelerometer nothing says that the water is calm.
            calm = jnp.zeros(3), jnp.zeros(3)
            begun = eqx.tree_at(lambda m: (m.sea.acceleration_variance, m.sea.velocity_variance), begun, calm)
            estimate = jax.lax.scan(tick, begun, (velocity, jnp.arange(n)))[1]
            return estimate.eta[-1, :2], estimate.covariance[-1, :2, :2]

        return jax.vmap(one)(places, velocity)

    for std in (0.0, 0.3):
        error, P = map(np.asarray, listened_to(jnp.asarray(std * away), jnp.asarray(std)))
        nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(P), error)
        assert 1.43 < nees.mean() < 2.67, f"{std}: 95 % of chi-square with 80 degrees of freedom, over 40"


def test_swinging_in_roll_is_not_taken_for_sway(model):
    """Gravity is that of the attitude in which the accelerometer was read, not that of the start of the tick."""
    filter = NavigationFilter(model, Tuning.of(model, MOUNTS | {"accelerometer": Mount(0.03)}))
    n, angle, rate = 200, 0.5, 2.5

    @eqx.filter_jit
    def swung():
        def tick(memory, k):
            t = k * DT + jnp.array([-0.5 * DT, 0.0])
            roll, zero = angle * (1.0 - jnp.cos(rate * t)), jnp.zeros(2)
            yes = jnp.ones(2, dtype=bool)
            down = jnp.stack([zero, jnp.sin(roll), jnp.cos(roll)], axis=1)
            slots = {
                "attitude": Slot(jnp.stack([roll, zero, zero], axis=1), yes, t),
                "gyro": Slot(jnp.stack([angle * rate * jnp.sin(rate * t), zero, zero], axis=1), yes, t),
                "accelerometer": Slot(-9.80665 * down, yes, t),
            }
            return filter.step(memory, ObserverInput(slots, Command(jnp.zeros(6))), DT)

        return jax.lax.scan(tick, filter.init(jax.random.key(0), Start.at((0.0, 0.0, 2.0))), jnp.arange(n))[1].nu

    assert np.abs(np.asarray(swung())[:, 1]).max() < 0.02  # [m/s]


@eqx.filter_jit
def sinking(filter, depth, speed, acceleration, noise):
    """A level vehicle that sinks as told, tick by tick, commands zero: depth, and how many pressures were used."""

    def tick(memory, inputs):
        z, w, a, (of_depth, of_speed, of_acceleration) = inputs
        now, yes = (memory.ticks * DT)[None], jnp.ones(1, dtype=bool)
        tenth = (memory.ticks % 5 == 0)[None]
        slots = {
            "accelerometer": Slot(jnp.array([[0.0, 0.0, a - 9.80665]]) + of_acceleration, yes, now),
            "attitude": Slot(jnp.zeros((1, 3)), yes, now),
            "dvl": Slot(jnp.array([[0.0, 0.0, w]]) + of_speed, tenth, now),
            "gyro": Slot(jnp.zeros((1, 3)), yes, now),
            "pressure": Slot(jnp.full((1, 1), z) + of_depth, tenth, now),
        }
        memory, estimate = filter.step(memory, ObserverInput(slots, Command(jnp.zeros(6))), DT)
        return memory, (estimate.eta[2], estimate.nis_dof[4], estimate.bias[2])

    memory = filter.init(jax.random.key(0), Start.at((0.0, 0.0, 2.0)))
    return jax.lax.scan(tick, memory, (depth, speed, acceleration, noise))[1]


@pytest.mark.parametrize("seed", [0, 1])
def test_a_thruster_that_is_gone_is_not_taken_for_a_wave(model, seed):
    """0.04 m/s2 of heave at once and for good: no pressure is refused, depth stays with it, the force is learnt."""
    mounts = MOUNTS | {"accelerometer": Mount(0.05), "dvl": Mount(0.005), "pressure": Mount(0.01)}
    n, begin = round(50 / DT), round(30 / DT)
    mass, drag = float(model.inertia[2, 2]), float(model.linear_damping_ahead[2, 2])
    quadratic = float(model.quadratic_damping_ahead[2, 2])
    force, w, z = 0.04 * mass, np.zeros(n + 1), np.full(n + 1, 2.0)
    for k in range(begin, n):
        w[k + 1] = w[k] + DT * (force - drag * w[k] - quadratic * w[k] ** 2) / mass
        z[k + 1] = z[k] + 0.5 * DT * (w[k] + w[k + 1])
    rng = np.random.default_rng(seed)
    noise = tuple(std * rng.standard_normal((n, 1, m)) for std, m in ((0.01, 1), (0.005, 3), (0.05, 3)))
    reported = (jnp.asarray(x) for x in (z[1:], w[1:], np.diff(w) / DT))
    filter = NavigationFilter(model, Tuning.of(model, mounts))
    depth, used, bias = map(np.asarray, sinking(filter, *reported, jax.tree.map(jnp.asarray, noise)))
    assert np.abs(depth - z[1:])[begin:].max() < 0.03
    assert used[begin:].sum() == (n - begin) / 5
    assert bias[-1] == pytest.approx(force, rel=0.2)


def test_a_depth_that_was_taken_for_a_wave_leaves_the_whole_as_sure_as_it_was(model, state):
    """What opens is the split into slow depth and wave where they point the same way, and depth itself for the rest."""
    x = eqx.tree_at(lambda s: s.wave_place, state, jnp.array([0.0, 0.0, -0.1]))
    for residual, whole in ((-0.1, 0.0), (-0.5, 0.5**2 - 0.1**2), (0.1, 0.1**2)):
        opened = np.asarray(covariance_inflation("pressure", jnp.array([residual]), x, model))
        both = np.eye(ERRORS)[2] + np.eye(ERRORS)[11]
        assert opened[2, 2] == pytest.approx(residual**2)
        assert both @ opened @ both == pytest.approx(whole, abs=1e-12)
        assert np.linalg.eigvalsh(opened).min() > -1e-12
