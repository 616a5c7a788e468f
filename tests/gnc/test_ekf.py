"""The observer: consistent when told the truth, overconfident as printed, and robust against what sensors do."""

from dataclasses import replace

import equinox as eqx
import numpy as np
import pytest
from scipy.stats import chi2
from tests.gnc.observer_cases import (
    DT,
    ONE_A_TICK,
    STD,
    THESIS_SENSORS,
    Run,
    at,
    double_body,
    effective_samples,
    estimation_error,
    manoeuvres,
    nees,
    random_walk,
    readings,
    silent,
    track,
)

from rovtwin.core.block import Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Command, Slot
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.interfaces import ObserverInput
from rovtwin.gnc.thesis.ekf import Ekf, EkfTuning
from rovtwin.gnc.thesis.ekf_tuning import STATES

pytestmark = pytest.mark.system

RUNS, SECONDS = 16, 100.0
NAMES = sorted(THESIS_SENSORS)
START = Start.at((0.0, 0.0, 0.5))
HORIZONTAL = (0, 1)
# Moments small enough for the vehicle to stay upright: the default declares what would tumble it in a minute, because
# the moments of a real vehicle are known that badly.
DECLARED = EkfTuning.consistent(moment_walk=0.05, rate_noise=0.02, attitude_walk=0.0)


@pytest.fixture(scope="module")
def model():
    return double_body()


@pytest.fixture(scope="module")
def fleet(model):
    """Runs that are what the filter is given: start, disturbance, noise of motion and of sensors."""
    tuning = DECLARED
    rng = np.random.default_rng(11)
    n = round(SECONDS / DT)
    intensity = np.sqrt(np.asarray(tuning.process_variance))
    runs = []
    for _ in range(RUNS):
        first = rng.normal(size=18) * np.sqrt(np.asarray(tuning.initial_variance))
        b = random_walk(rng, n, intensity[12:]) + first[12:]
        shaken = rng.normal(size=(n, 6)) * intensity[6:12] / np.sqrt(DT) @ np.asarray(model.inertia).T
        start = at(model, np.r_[0, 0, 0.5] + first[:3], first[3:6], first[6:12])
        acting = 0.5 * (b + np.concatenate([first[None, 12:], b[:-1]]))
        runs.append(replace(Run.of(model, manoeuvres(rng, SECONDS), acting, start, shaken), b=b))
    slots = [readings(rng, run, rates=ONE_A_TICK) for run in runs]
    commands = jnp.stack([jnp.asarray(run.u) for run in runs])
    return commands, np.stack([run.state for run in runs]), jax.tree.map(lambda *s: jnp.stack(s), *slots)


def track_all(model, tuning, fleet):
    u, state, slots = fleet
    ekf = Ekf(model, tuning)
    out = eqx.filter_jit(jax.vmap(lambda slots, u: track(ekf, START, slots, u)))(slots, u)
    x, P, nis, dof, thrust = map(np.asarray, out)
    return estimation_error(x, state), P, nis, dof, thrust


@pytest.fixture(scope="module")
def tracked(model, fleet):
    return track_all(model, DECLARED, fleet)


def interval(samples, dof, level=0.999):
    """Where the mean of that many independent chi-squares of `dof` degrees lies."""
    return chi2.ppf([(1 - level) / 2, (1 + level) / 2], dof * samples) / samples


@pytest.mark.parametrize(
    "states",
    [HORIZONTAL, (2,), (3, 4, 5), (6, 7, 8), (9, 10, 11), (12, 13, 14), (15, 16, 17), tuple(range(18))],
    ids=str,
)
def test_nees(tracked, states):
    """The errors are as large as the filter says, in every group of states, from the first minute on."""
    error, P, *_ = tracked
    some = slice(round(20 / DT), None, 25)
    series = nees(error[:, some], P[:, some], states)
    low, high = interval(effective_samples(series), len(states))
    assert low < series.mean() < high
    # The test has teeth: errors 40 % larger, or covariances twice as large, would not pass.
    assert low > 0.5 * len(states) and high < 1.9 * len(states)


@pytest.mark.parametrize("name", NAMES)
def test_nis(tracked, name):
    """Innovations are white, so here every sample counts."""
    _, _, nis, dof, _ = tracked
    k = NAMES.index(name)
    count = dof[..., k].sum()
    low, high = interval(count, 1)
    assert low < nis[..., k].sum() / count < high
    expected = {"position": 2 * 1, "pressure": 42, "gyro": 3 * 50, "attitude": 3 * 50}[name] * RUNS * SECONDS
    assert count == pytest.approx(expected, rel=0.01)


def test_covariance_stays_symmetric_and_positive(tracked):
    _, P, *_ = tracked
    P = P[:, ::250]
    assert np.abs(P - P.swapaxes(-1, -2)).max() < 1e-15
    # Scaled to correlations: the states' units differ by ten orders of magnitude.
    s = np.sqrt(np.diagonal(P, axis1=-2, axis2=-1))
    assert np.linalg.eigvalsh(P / s[..., None] / s[..., None, :]).min() > 1e-9


@pytest.fixture(scope="module")
def tracked_as_printed(model, fleet):
    u, state, slots = fleet
    rng = np.random.default_rng(5)
    # The specific force at rest: accelerations of this fleet are a hundredth of gravity.
    raw = rng.normal(0, STD["accelerometer"], (*u.shape[:2], 1, 3)) - np.array([0, 0, 9.81])
    accelerometer = Slot(jnp.asarray(raw), slots["gyro"].valid, slots["gyro"].t_valid)
    return track_all(model, EkfTuning.as_printed(DT), (u, state, slots | {"accelerometer": accelerometer}))


def test_as_printed_is_overconfident(tracked, tracked_as_printed):
    """Table 7.2 takes its own velocity for a measurement and disturbances for nothing."""
    settled = slice(round(60 / DT), None, 25)
    scores = [nees(run[0][:, settled], run[1][:, settled], HORIZONTAL).mean() for run in (tracked, tracked_as_printed)]
    assert scores[0] < 3 and scores[1] > 50
    errors = [np.sqrt(np.mean(run[0][:, settled, :2] ** 2)) for run in (tracked, tracked_as_printed)]
    assert errors[1] > 2 * errors[0]


def test_force_follows_the_command_through_the_lag(fleet, tracked, tracked_as_printed):
    """Exactly as the plant's; the thesis's filter takes the command for the force."""
    command = np.asarray(fleet[0]) * np.array([10.0, 5.0, 11.0] * 2)
    force, expected = np.zeros_like(command[:, 0]), []
    for k in range(200):
        force = command[:, k] + np.exp(-DT / 0.2) * (force - command[:, k])
        expected.append(force)
    np.testing.assert_allclose(tracked[4][:, :200], np.stack(expected, 1), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(tracked_as_printed[4], command, rtol=1e-12)


def test_as_printed_is_table_7_2():
    tuning = EkfTuning.as_printed(DT)
    R = {"position": 0.5, "pressure": 0.017, "attitude": 1e-3, "accelerometer": 0.308, "gyro": 3.08e-5}
    for name, value in R.items():
        assert float(tuning.measurement_variance[name]) == value
    Q = [1e-8, 1e-8, 1e-10, 1e-6, 1e-6, 1e-6] + [1e-10] * 12
    # (2.41) with (2.42): Gamma Q Gamma' = T^2 Q is added in each tick.
    np.testing.assert_allclose(tuning.process_variance * DT, DT**2 * np.array(Q), rtol=1e-12)
    assert tuning.pseudo_velocity and not tuning.thruster_lag and not tuning.gate


def test_consistent_takes_variances_from_standard_deviations():
    R = EkfTuning.consistent({"position": 0.8}, force_walk=0.1).measurement_variance
    assert float(R["position"]) == pytest.approx(0.64)
    assert float(R["pressure"]) == pytest.approx(1e-6)
    assert float(R["gyro"]) == pytest.approx(3.08e-5**2)
    np.testing.assert_allclose(EkfTuning.consistent(force_walk=0.1).process_variance[12:15], 0.01)


# ---------------------------------------------------------------------------------------------------------------------
# One run, looked at in different lights. The slots keep their structure, so that the filter is compiled once.

ALL = ("accelerometer", "attitude", "dvl", "gyro", "position", "pressure")
B = np.array([3.0, -2.0, 1.5, 0.3, -0.2, 0.4])


@pytest.fixture(scope="module")
def turning(model):
    """80 s with a constant disturbance, turning through +-pi again and again at up to 0.5 rad/s."""
    n = round(80 / DT)
    u = np.tile([0.6, 0.1, 0.0, 0.2, 0.1, 0.0], (n, 1))
    return Run.of(model, u, B, at(model, euler=(0.0, 0.0, 3.0)))


@pytest.fixture(scope="module")
def turning_slots(turning):
    return readings(np.random.default_rng(2), turning, ALL)


TURNING_START = Start.at((0.0, 0.0, 0.5), 3.0)


def follow(model, run, slots, tuning=None):
    x, P, nis, dof, thrust = map(
        np.asarray, track(Ekf(model, tuning or EkfTuning.consistent()), TURNING_START, slots, jnp.asarray(run.u))
    )
    return estimation_error(x, run.state), x, P, nis, dof


LATE = slice(round(40 / DT), None)


def test_constant_disturbance_is_found_in_b(model, turning, turning_slots):
    error, x, P, *_ = follow(model, turning, silent(turning_slots, "dvl"))
    sigma = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
    assert np.all(np.abs(error[-1, 12:]) < 4 * sigma[-1, 12:])
    np.testing.assert_allclose(x[-1, 12:15], B[:3], atol=0.7)
    np.testing.assert_allclose(x[LATE, 15:].mean(0), B[3:], atol=0.05)


def test_b_learns_through_its_own_noise(model, turning, turning_slots):
    """With E where (2.38) prints it, and b known to be zero at the start, b would stay zero for ever."""
    tuning = EkfTuning.consistent(force_walk=0.0, moment_walk=0.0)
    known = tuning.initial_variance.at[12:].set(0.0)
    tuning = eqx.tree_at(lambda t: t.initial_variance, tuning, known)
    _, x, *_ = follow(model, turning, silent(turning_slots, "dvl"), tuning)
    assert np.all(x[:, 12:] == 0)


def test_heading_passes_pi_unharmed(model, turning, turning_slots):
    error, x, *_ = follow(model, turning, silent(turning_slots, "dvl"))
    crossings = np.sum(np.abs(np.diff(x[:, 5])) > np.pi)
    assert crossings >= 3
    assert np.abs(error[:, 3:6]).max() < 5e-3
    assert np.all((x[:, 3:6] >= -np.pi) & (x[:, 3:6] < np.pi))


def test_readings_from_within_the_tick(model, turning, turning_slots):
    """Half of the attitudes and gyro rates are 10 ms old, depths up to 20: compared with the state of then."""
    slots = silent(turning_slots, "dvl")
    *_, nis, dof = follow(model, turning, slots)
    attitude = sorted(ALL).index("attitude")
    assert nis[LATE, attitude].sum() / dof[LATE, attitude].sum() == pytest.approx(1.0, abs=0.05)
    *_, nis, dof = follow(model, turning, slots, EkfTuning.consistent(max_age=0.0))
    assert nis[LATE, attitude].sum() / dof[LATE, attitude].sum() > 2.0


def test_positions_may_come_late(model):
    """0.8 s of latency, stamped: compared with where the vehicle was then. Unstamped they would hold it back."""
    u = np.tile([0.6, 0.0, 0.0, 0.6, 0.0, 0.0], (round(80 / DT), 1))
    straight = Run.of(model, u, None, at(model, euler=(0.0, 0.0, 3.0)))
    # Positions quieter than the filter believes: the lag is to be seen, not the noise.
    slots = silent(readings(np.random.default_rng(6), straight, ALL, std=STD | {"position": 0.05}), "dvl")
    late = jax.tree.map(lambda leaf: jnp.roll(leaf, 40, axis=0), slots["position"])
    slots["position"] = eqx.tree_at(lambda s: s.valid, late, late.valid.at[:40].set(False))
    behind = []
    for max_age in (1.0, 0.1):
        error, *_ = follow(model, straight, slots, EkfTuning.consistent(max_age=max_age))
        behind.append(-error[LATE, :2].mean(0) @ np.array([np.cos(3.0), np.sin(3.0)]))
    lag = 0.8 * straight.x[-1, 6]
    assert behind[0] == pytest.approx(0.0, abs=0.2 * lag)
    assert behind[1] == pytest.approx(lag, rel=0.35)


def test_gyro_bias_is_allowed_for(model, turning, turning_slots):
    """No state of its own, so the attitude is assumed to wander: else it would be off by many of its small sigmas."""
    slots = silent(turning_slots, "dvl")
    slots["gyro"] = eqx.tree_at(lambda s: s.value, slots["gyro"], slots["gyro"].value + 6.8e-6)
    scores = []
    for walk in (3e-5, 0.0):
        error, _, P, *_ = follow(model, turning, slots, EkfTuning.consistent(attitude_walk=walk))
        scores.append(nees(error[LATE], P[LATE], (3, 4, 5)).mean())
    assert scores[0] < 6 and scores[1] > 20


def test_dvl_bounds_the_drift(model, turning, turning_slots):
    without, *_ = follow(model, turning, silent(turning_slots, "dvl"))
    with_dvl, *_ = follow(model, turning, turning_slots)
    ratio = np.sqrt(np.mean(with_dvl[LATE, :2] ** 2) / np.mean(without[LATE, :2] ** 2))
    assert ratio < 0.8
    assert np.sqrt(np.mean(with_dvl[LATE, 6:9] ** 2)) < 5e-3


@pytest.mark.parametrize("name", [n for n in ALL if n != "accelerometer"])
def test_each_sensor_alone_at_its_own_rate(model, turning, turning_slots, name):
    """A tick with a reading makes the states it reads surer, one without makes nothing surer; dof count readings."""
    slots = silent(turning_slots, *(other for other in ALL if other != name))
    _, _, P, _, dof = follow(model, turning, slots)
    k = sorted(ALL).index(name)
    came = np.asarray(slots[name].valid).sum(1) * len(STATES[name])
    assert np.all(dof[:, k] <= came) and dof[:, k].sum() > 0.95 * came.sum()
    assert np.all(np.delete(dof, k, axis=1) == 0)
    # The component that is read is never much less sure than after a single reading.
    read = np.flatnonzero(dof[:, k])
    for i in STATES[name]:
        assert np.all(P[read, i, i] <= STD[name] ** 2 * 1.1)
    if name in ("position", "pressure"):
        early = slice(0, round(20 / DT))
        between = np.diff(P[early, STATES[name][0], STATES[name][0]])[dof[early, k][1:] == 0]
        assert np.mean(between > 0) > 0.8


def test_accelerometer_is_left_out(model, turning, turning_slots):
    _, x, _, nis, dof = follow(model, turning, turning_slots)
    wild = turning_slots | {"accelerometer": jax.tree.map(lambda a: a, turning_slots["accelerometer"])}
    wild["accelerometer"] = eqx.tree_at(lambda s: s.value, wild["accelerometer"], jnp.full((len(x), 2, 3), 1e6))
    _, same, *_ = follow(model, turning, wild)
    assert np.array_equal(x, same)
    assert dof[:, 0].sum() == 0 and nis[:, 0].sum() == 0


def test_missing_sensors(model, turning, turning_slots):
    """A vehicle with nothing but positions and a compass: the dictionary has no more, and the filter runs."""
    slots = {name: turning_slots[name] for name in ("attitude", "position")}
    error, _, _, nis, _ = follow(model, turning, slots)
    assert nis.shape[1] == 2
    assert np.sqrt(np.mean(error[LATE, :2] ** 2)) < 0.5
    _, x, P, nis, _ = follow(model, turning, {})
    assert nis.shape[1] == 0 and np.all(np.isfinite(x))
    assert P[-1, 0, 0] > 1.0


def with_outliers(slots, share, size, seed=9):
    rng = np.random.default_rng(seed)
    position = slots["position"]
    came = np.flatnonzero(np.asarray(position.valid)[:, 0])
    odd = rng.choice(came[5:], round(share * len(came)), replace=False)
    angle = rng.uniform(0, 2 * np.pi, len(odd))
    value = np.array(position.value)
    value[odd, 0] += size * np.stack([np.cos(angle), np.sin(angle)], 1)
    return slots | {"position": Slot(jnp.asarray(value), position.valid, position.t_valid)}, odd


def test_gate_rejects_outliers_and_keeps_the_rest(model, turning, turning_slots):
    clean = silent(turning_slots, "dvl")
    dirty, odd = with_outliers(clean, 0.15, 5.0)
    k = sorted(ALL).index("position")
    without, *_, dof_without = follow(model, turning, clean)
    assert dof_without[:, k].sum() == 2 * np.asarray(clean["position"].valid).sum()
    gated, *_, dof = follow(model, turning, dirty)
    assert np.all(dof[odd, k] == 0)
    assert dof[:, k].sum() == dof_without[:, k].sum() - 2 * len(odd)
    open_door, *_ = follow(model, turning, dirty, EkfTuning.consistent(gate={"position": 1e12, "dvl": 1e12}))

    def rms(error):
        return np.sqrt(np.mean(error[LATE, :2] ** 2))

    assert rms(gated) < 1.3 * rms(without)
    assert rms(open_door) > 2 * rms(gated)


def test_gate_gives_in_to_a_lasting_jump(model, turning, turning_slots):
    """Carried off by 8 m, say by a diver: five positions in a row are not outliers."""
    position = turning_slots["position"]
    jumped = jnp.where((jnp.arange(len(turning.u)) * DT > 40)[:, None, None], 8.0, 0.0)
    slots = silent(turning_slots, "dvl") | {
        "position": Slot(
            jnp.where(position.valid[..., None], position.value + jumped, 0.0), position.valid, position.t_valid
        )
    }
    error, *_ = follow(model, turning, slots)
    assert np.abs(error[round(44 / DT), :2]).max() < 3
    np.testing.assert_allclose(error[-1, :2], 8.0, atol=2.0)


def test_not_a_number_shows(model, turning, turning_slots):
    attitude = turning_slots["attitude"]
    bad = eqx.tree_at(lambda s: s.value, attitude, attitude.value.at[2000, 0, 1].set(jnp.nan))
    _, x, *_ = follow(model, turning, turning_slots | {"attitude": bad})
    assert np.all(np.isfinite(x[:2000])) and not np.any(np.isfinite(x[2001:, 4]))
    filler = eqx.tree_at(
        lambda s: (s.value, s.valid),
        attitude,
        (attitude.value.at[2000, 0].set(jnp.nan), attitude.valid.at[2000, 0].set(False)),
    )
    _, x, *_ = follow(model, turning, turning_slots | {"attitude": filler})
    assert np.all(np.isfinite(x))


def test_batched_equals_single(model, fleet, tracked):
    u, state, slots = fleet
    one = track(Ekf(model, DECLARED), START, jax.tree.map(lambda leaf: leaf[3], slots), u[3])
    np.testing.assert_allclose(estimation_error(one[0], state[3]), tracked[0][3], atol=1e-9)


def test_thrust_noise_widens_the_covariance_with_the_force(model, turning, turning_slots):
    slots = silent(turning_slots, "dvl")
    _, _, sure, *_ = follow(model, turning, slots)
    _, _, unsure, *_ = follow(model, turning, slots, EkfTuning.consistent(thrust_noise=0.5))
    assert unsure[-1, 0, 0] > 1.2 * sure[-1, 0, 0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sensor_std": {"positon": 0.5}}, "positon"),
        ({"sensor_std": {"position": 0.0}}, "positive"),
        ({"gate": {"sonar": 9.0}}, "sonar"),
        ({"force_walk": -1.0}, "force_walk"),
        ({"rate_noise": float("nan")}, "rate_noise"),
    ],
)
def test_nonsense_is_refused(change, message):
    with pytest.raises(ConfigError, match=message):
        EkfTuning.consistent(**change)


def test_a_gated_compass_is_used_across_south(model):
    """Readings on both sides of +-pi differ by little; a gate that forgot to wrap would reject them."""
    ekf = Ekf(model, EkfTuning.consistent(gate={"attitude": 30.0}))
    memory = ekf.init(jax.random.key(0), Start.at(heading=np.pi - 1e-3))
    attitude = Slot(jnp.array([[0.0, 0.0, 1e-3 - np.pi]]), jnp.array([True]), jnp.array([0.02]))
    command = Command(jnp.zeros(model.thrusters.count))
    _, estimate = jax.jit(lambda m: ekf.step(m, ObserverInput({"attitude": attitude}, command), 0.02))(memory)
    assert estimate.nis_dof[0] == 3.0 and estimate.nis[0] < 1.0


def test_rejections_of_one_of_two_positions_do_not_hang_on_the_other(model):
    """One is 8 m off, the other right: only the first is rejected, and accepted after as many as if it were alone."""
    ekf = Ekf(model, EkfTuning.consistent({"position": 0.5, "position_2": 0.5}))
    there, command = jnp.array([True]), Command(jnp.zeros(model.thrusters.count))
    off, right = (Slot(jnp.array([[x, 0.0]]), there, jnp.zeros(1)) for x in (8.0, 0.0))
    input = ObserverInput({"position": off, "position_2": right}, command)
    step = jax.jit(lambda memory: ekf.step(memory, input, DT))
    memory, estimated = ekf.init(jax.random.key(0), START), []
    for _ in range(6):
        memory, estimate = step(memory)
        estimated.append([float(dof) for dof in estimate.nis_dof])
    assert estimated == [[0.0, 2.0]] * 5 + [[2.0, 2.0]]
