"""Sensors: when they read, what they read, and how wrong they are."""

import numpy as np
import pytest
from scipy import stats
from tests.simulation.helper import mean_interval, state, variance_interval

from rovtwin.core.block import Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Environment
from rovtwin.core.frames import rotation_from_quaternion
from rovtwin.core.numerics import jax, jnp
from rovtwin.core.sensors import SENSORS
from rovtwin.simulation.sensors.kinds import IDEAL
from rovtwin.simulation.sensors.sensor import Sensor, SensorInput, table_5_7

START, DT = Start.at(), 0.002
SEA = Environment.calm(floor=jnp.asarray(20.0))
CHARGE = jnp.array([0.9, 20.0])  # of a battery, and its power [W]
SOMEWHERE = state((4.0, -2.0, 3.0), (0.9, 0.1, -0.3, 0.3), (0.3, -0.1, 0.05, 0.1, 0.2, -0.15))
SOMEWHERE = type(SOMEWHERE)(
    SOMEWHERE.position, SOMEWHERE.attitude / jnp.linalg.norm(SOMEWHERE.attitude), SOMEWHERE.nu, SOMEWHERE.thrust
)
NU_DOT = jnp.array([0.2, 0.1, -0.3, 0.05, -0.02, 0.4])


def record(sensor, steps, seed=0, seen=SOMEWHERE, first=0):
    """What a sensor delivers in each physics step: value (steps, n), valid (steps,), t_valid (steps,)."""

    def run(key):
        def one(memory, k):
            return sensor.step(memory, SensorInput(seen, NU_DOT, k, SEA, CHARGE), DT)

        return jax.lax.scan(one, sensor.init(key, START), jnp.arange(first, first + steps))[1]

    slot = jax.jit(run)(jax.random.key(seed))
    return np.asarray(slot.value)[:, 0], np.asarray(slot.valid)[:, 0], np.asarray(slot.t_valid)[:, 0]


def ideal(sensor, seen=SOMEWHERE):
    return np.asarray(IDEAL[sensor.kind](sensor, SensorInput(seen, NU_DOT, jnp.array(0), SEA, CHARGE)))


@pytest.mark.parametrize("rate", [1.0, 7.0, 10.0, 42.0, 100.0, 333.333, 500.0])
def test_rate_is_exact_over_a_thousand_seconds(rate):
    sensor = Sensor("pressure", rate)
    k = jnp.arange(500_000)
    ticks = np.asarray(sensor.ticks(k))
    assert ticks.sum() == round(rate * 1000)
    ends = np.flatnonzero(ticks) + 1
    spacing = np.diff(ends)
    assert set(spacing) <= {int(500 // rate), int(-(-500 // rate))}
    # Reading m is taken in the first step that ends at or after m / rate: never early, less than a step late.
    m = np.arange(1, len(ends) + 1)
    late = ends * sensor.rate - m * sensor.physics_rate
    assert late.min() >= 0 and late.max() < sensor.rate
    if rate == int(rate):
        assert np.all(ticks.reshape(1000, 500).sum(1) == rate)
    assert np.cumsum(ticks)[12345] == sensor.readings_before(12346)


def same_draws(actual, expected):
    """Two sensors are two programs: some processors fuse a product and a sum in the one and not in the other."""
    np.testing.assert_allclose(actual, expected, rtol=1e-13, atol=1e-15)


def test_capacity_is_the_most_that_comes_in_a_window():
    for rate, steps in ((42.0, 10), (100.0, 10), (333.0, 10), (1.0, 10), (42.0, 12), (42.0, 7)):
        sensor = Sensor("pressure", rate)
        ticks = np.asarray(sensor.ticks(jnp.arange(50_000)))
        assert np.convolve(ticks, np.ones(steps)).max() == sensor.capacity(steps)


def test_a_narrow_integer_clock_does_not_overflow():
    sensor = Sensor("pressure", 42.0)
    k = jnp.array([51_200_000, 200_000_000], dtype=jnp.int32)
    np.testing.assert_array_equal(sensor.readings_before(k), [int(x) * 21 // 250 for x in np.asarray(k, dtype=int)])


def test_absent_between_ticks_and_never_the_same_twice():
    sensor = Sensor("pressure", 42.0, noise=1e-3)
    value, valid, t_valid = record(sensor, 5000)
    np.testing.assert_array_equal(valid, np.asarray(sensor.ticks(jnp.arange(5000))))
    assert valid.sum() == 420
    assert len(np.unique(value[valid])) == 420
    assert not value[~valid].any() and not t_valid[~valid].any()
    np.testing.assert_allclose(t_valid[valid], (np.flatnonzero(valid) + 1) * DT, rtol=1e-15)


@pytest.mark.parametrize("kind", SENSORS)
def test_noise_and_bias_of_every_kind(kind):
    n = SENSORS[kind].size
    sigma, bias = np.array([0.01, 0.02, 0.03])[:n], np.array([0.1, -0.2, 0.05])[:n]
    sensor = Sensor(kind, 500.0, noise=sigma, bias=bias)
    value, valid, _ = record(sensor, 6000)
    assert valid.all() and value.shape == (6000, n)
    z = (value - ideal(sensor) - bias) / sigma
    low, high = variance_interval(6000)
    assert np.all(np.abs(z.mean(0)) < mean_interval(6000))
    assert np.all((z.var(0, ddof=1) > low) & (z.var(0, ddof=1) < high))
    assert np.all(np.abs((z[1:] * z[:-1]).mean(0)) < mean_interval(6000))  # white in time
    for i in range(n):
        assert stats.kstest(z[:, i], "norm").pvalue > 1e-4
        for j in range(i):
            assert abs((z[:, i] * z[:, j]).mean()) < mean_interval(6000)  # axes on their own


def test_a_magnetometer_reads_the_field_of_the_place():
    """Components and angles of IGRF-14 at 63.45 N 10.4 E on 2025-01-01, as the package ppigrf 2.1.0 gives them."""
    igrf = np.array([13.504135, 1.176857, 50.435171])  # north, east, down [uT]
    level = state((0.0, 0.0, 2.0))
    sensor = Sensor("magnetometer", 50.0, site=(52.225024, 74.956282, 4.980622))
    np.testing.assert_allclose(ideal(sensor, level), igrf, atol=1e-5)
    # Without a place it is at the default one, whose figures are rounded.
    np.testing.assert_allclose(ideal(Sensor("magnetometer", 50.0), level), igrf, atol=0.1)
    R = np.asarray(rotation_from_quaternion(SOMEWHERE.attitude))
    ahead, back = Sensor("magnetometer", 50.0), Sensor("magnetometer", 50.0, rotation=np.diag([-1.0, -1.0, 1.0]))
    np.testing.assert_allclose(R @ ideal(ahead), ideal(ahead, level), atol=1e-12)
    np.testing.assert_allclose(ideal(back), ideal(ahead) * [-1.0, -1.0, 1.0], atol=1e-12)


def test_a_compass_made_of_a_magnetometer_points_to_magnetic_north():
    """Heading by the horizontal field, levelled by roll and pitch, is true heading less declination."""
    phi, theta, psi = ideal(Sensor("attitude", 100.0))
    x, y, z = ideal(Sensor("magnetometer", 50.0, site=(52.2, 75.0, 5.0)))
    ahead = x * np.cos(theta) + (y * np.sin(phi) + z * np.cos(phi)) * np.sin(theta)
    aside = y * np.cos(phi) - z * np.sin(phi)
    np.testing.assert_allclose(np.degrees(np.arctan2(-aside, ahead)), np.degrees(psi) - 5.0, atol=1e-9)


def test_bias_walk_grows_with_the_square_root_of_time():
    n, intensity = 3000, 0.02
    sensor = Sensor("gyro", 100.0, bias_walk=intensity)

    def run(key):
        def one(memory, k):
            return sensor.step(memory, SensorInput(SOMEWHERE, NU_DOT, k, SEA), DT)

        return jax.lax.scan(one, sensor.init(key, START), jnp.arange(500))[1].value[:, 0]

    value = np.asarray(jax.jit(jax.vmap(run))(jax.random.split(jax.random.key(2), n)))
    low, high = variance_interval(n)
    for t in (0.01, 0.1, 1.0):
        walk = value[:, round(t / DT) - 1] - ideal(sensor)
        growth = walk.var(0, ddof=1) / (intensity**2 * t)
        assert np.all((growth > low) & (growth < high)), t


@pytest.mark.system
@pytest.mark.parametrize("rate, latency", [(100.0, 0.002), (100.0, 0.008), (100.0, 0.1), (42.0, 0.3), (1.0, 0.77)])
def test_latency_is_exact(rate, latency):
    """The readings of a sensor without latency, `latency` later; t_valid says when they were valid."""
    steps, late_by = 2500, round(latency / DT)
    faults = {"noise": 0.1, "bias_walk": 0.1, "dropout": 0.2, "clock_offset": 1.0}
    now = record(Sensor("gyro", rate, **faults), steps)
    late = record(Sensor("gyro", rate, latency=latency, **faults), steps)
    for at_once, delayed in zip(now, late, strict=True):
        same_draws(delayed[late_by:].astype(float), at_once[:-late_by].astype(float))
        assert not delayed[:late_by].any()
    assert 0 < late[1].sum()


def test_clock_drifts_from_an_offset():
    sensor = Sensor("pressure", 10.0, clock_drift=2e-3, clock_offset=-0.4)
    _, valid, t_valid = record(sensor, 5000)
    t = (np.flatnonzero(valid) + 1) * DT
    np.testing.assert_allclose(t_valid[valid], 1.002 * t - 0.4, atol=1e-14)


def test_blackouts():
    sensor = Sensor("position", 10.0, noise=0.5, blackouts=[(2.0, 4.0), (7.05, 8.0)])
    value, valid, _ = record(sensor, 5000)
    undisturbed = record(Sensor("position", 10.0, noise=0.5), 5000)
    t = (np.flatnonzero(undisturbed[1]) + 1) * DT
    dark = ((t >= 2.0 - 1e-9) & (t < 4.0 - 1e-9)) | ((t >= 7.05) & (t < 8.0 - 1e-9))
    np.testing.assert_array_equal(valid[undisturbed[1]], ~dark)
    same_draws(value[valid], undisturbed[0][valid])  # the others are as they would have been
    assert not value[~valid].any()


def test_dropouts_and_outliers_come_as_often_as_given():
    sensor = Sensor("position", 500.0, dropout=0.3, outlier=0.05, outlier_size=5.0)
    value, valid, _ = record(sensor, 20_000)
    assert stats.binomtest(int(valid.sum()), 20_000, 0.7).pvalue > 1e-4
    off = value[valid] - ideal(sensor)
    length = np.hypot(*off.T)
    wild = length > 1e-9
    assert stats.binomtest(int(wild.sum()), len(wild), 0.05).pvalue > 1e-4
    np.testing.assert_allclose(length[wild], 5.0, rtol=1e-12)
    bearing = np.arctan2(off[wild, 1], off[wild, 0])
    assert stats.kstest(bearing, "uniform", args=(-np.pi, 2 * np.pi)).pvalue > 1e-4
    runs = np.abs(np.diff(np.flatnonzero(wild)))
    assert runs.min() == 1  # independent of each other: neighbours happen


def test_attitude_stays_wrapped():
    south = state(attitude=(0.0, 0.0, 0.0, 1.0))
    value, _, _ = record(Sensor("attitude", 500.0, noise=0.05), 1000, seen=south)
    psi = value[:, 2]
    assert psi.min() >= -np.pi and psi.max() < np.pi
    assert (psi > 3).any() and (psi < -3).any()


@pytest.mark.parametrize("kind", SENSORS)
def test_gradient_of_a_reading_is_finite(kind):
    """With respect to the sensor's parameters, the vehicle's state and its acceleration; the bias's is one."""

    @jax.jit
    @jax.grad
    def slope(differentiable):
        sensor, seen, nu_dot = differentiable
        memory = sensor.init(jax.random.key(0), START)
        return sensor.step(memory, SensorInput(seen, nu_dot, jnp.array(499), SEA, CHARGE), DT)[1].value.sum()

    sensor = Sensor(kind, 100.0, noise=0.1, bias_walk=0.1, outlier=1.0, outlier_size=1.0, latency=0.0)
    gradient = slope((sensor, SOMEWHERE, NU_DOT))
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradient))
    np.testing.assert_array_equal(gradient[0].bias, 1.0)


def test_randomness_is_the_seeds():
    sensor = table_5_7()["accelerometer"]
    once, again, other = record(sensor, 100), record(sensor, 100), record(sensor, 100, seed=1)
    np.testing.assert_array_equal(once[0], again[0])
    assert np.all(once[0][once[1]] != other[0][other[1]])


def test_table_5_7():
    sensors = table_5_7(extra=["dvl"])
    expected = {
        "position": (1, 0.5, 0.0),
        "pressure": (42, 1e-3, 0.0),
        "accelerometer": (100, 0.0308, 0.017),
        "gyro": (100, 3.08e-5, 6.8e-6),
        "attitude": (100, 1e-3, 0.0),
        "dvl": (10, 5e-3, 0.0),
    }
    assert set(sensors) == set(expected) and set(table_5_7()) == set(expected) - {"dvl"}
    for name, (rate, noise, bias) in expected.items():
        assert sensors[name].rate == 1000 * rate
        assert np.all(sensors[name].noise == noise) and np.all(sensors[name].bias == bias)
    printed = table_5_7(as_printed=True)
    assert np.all(printed["gyro"].bias == 0.017) and np.all(printed["accelerometer"].bias == 6.8e-6)
    late = table_5_7(changes={"position": {"latency": 0.5, "rate_hz": 2.0}})["position"]
    assert late.latency_steps == 250 and late.rate == 2000 and np.all(late.noise == 0.5)


def test_a_dvl_reads_while_the_floor_is_in_its_range():
    """The floor lies 17 m below SOMEWHERE; without a floor it reads whatever its range is."""
    near, far = Sensor("dvl", 10.0, max_range=16.0), Sensor("dvl", 10.0, max_range=40.0)
    close = Sensor("dvl", 10.0, min_range=40.0)
    assert not record(near, 500)[1].any() and not record(close, 500)[1].any() and record(far, 500)[1].sum() == 10
    seen = SensorInput(SOMEWHERE, NU_DOT, jnp.array(499), Environment.calm())
    assert bool(near.step(near.init(jax.random.key(0), START), seen, DT)[1].valid[0])


def test_a_step_of_another_length_is_a_mistake():
    sensor = Sensor("pressure", 42.0)
    now = SensorInput(SOMEWHERE, NU_DOT, jnp.array(0), SEA)
    with pytest.raises(ValueError, match="500"):
        sensor.step(sensor.init(jax.random.key(0), START), now, 0.02)


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: Sensor("sonar", 1.0), "sonar.*position"),
        (lambda: Sensor("gyro", 0.0), "gyro.rate"),
        (lambda: Sensor("gyro", 501.0), "500"),
        (lambda: Sensor("gyro", 10.0, latency=-1.0), "latency"),
        (lambda: Sensor("gyro", 10.0, noise=-1.0), "noise"),
        (lambda: Sensor("gyro", 10.0, noise=(1.0, 2.0)), "expected 1 or 3"),
        (lambda: Sensor("gyro", 10.0, bias=np.nan), "bias"),
        (lambda: Sensor("gyro", 10.0, dropout=1.5), "dropout.*probability"),
        (lambda: Sensor("gyro", 10.0, outlier=-0.1), "outlier"),
        (lambda: Sensor("position", 1.0, blackouts=[(5.0, 4.0)]), "blackouts"),
        (lambda: Sensor("gyro", 10.0, rotation=np.diag([1.0, 1.0, -1.0])), "rotation"),
        (lambda: table_5_7(changes={"sonar": {}}), "sonar"),
        (lambda: table_5_7(changes={"dvl": {}}), "dvl"),
    ],
)
def test_sensors_that_cannot_be(make, words):
    with pytest.raises(ConfigError, match=words):
        make()


# -- faults


def test_silent_biased_and_frozen_within_their_spans():
    """A gyro at 100 Hz for 2 s: what the fault does within its span, and the same draws as without it elsewhere."""
    plain = Sensor("gyro", 100.0, noise=0.1)
    faults = {"offsets": [(0.2, 0.4, [0.5, 0.0, -1.0]), (0.3, 0.4, 1.0)], "frozen": [(0.8, 1.2)]}
    broken = Sensor("gyro", 100.0, noise=0.1, blackouts=[(1.5, np.inf)], **faults)
    (a, sound, _), (b, valid, t) = record(plain, 1000), record(broken, 1000)
    a, b, t = a[sound], b[sound], t[sound]
    at = 0.01 * np.arange(1, 201)
    lost = at >= 1.5 - 1e-9
    np.testing.assert_array_equal(valid[sound], ~lost)
    assert not b[lost].any() and not t[lost].any()
    first, second = (at > 0.2 - 1e-9) & (at < 0.3 - 1e-9), (at > 0.3 - 1e-9) & (at < 0.4 - 1e-9)
    np.testing.assert_allclose(b[first] - a[first], np.tile([0.5, 0.0, -1.0], (10, 1)), atol=1e-12)
    np.testing.assert_allclose(b[second] - a[second], np.tile([1.5, 1.0, 0.0], (10, 1)), atol=1e-12)
    frozen = (at > 0.8 - 1e-9) & (at < 1.2 - 1e-9)
    same_draws(b[frozen], np.broadcast_to(a[78], (40, 3)))  # the reading of 0.79 s
    np.testing.assert_allclose(t[frozen], at[frozen], rtol=1e-12)  # with new time stamps
    rest = ~(first | second | frozen | lost)
    same_draws(b[rest], a[rest])


def test_a_sensor_frozen_from_the_start_repeats_its_first_reading():
    value, valid, _ = record(Sensor("pressure", 42.0, noise=0.1, frozen=[(0.0, np.inf)]), 500)
    assert len(np.unique(value[valid])) == 1 and value[valid][0] != 0.0


def test_a_frozen_sensor_repeats_the_last_reading_that_came():
    """Lost readings are none; latency delays the repeats like all else."""
    faults = {"noise": 0.1, "dropout": 0.5, "frozen": [(1.0, 1.5)]}
    value, valid, t = record(Sensor("pressure", 100.0, **faults), 1000)
    last = value[valid & (t < 1.0 - 1e-9)][-1]
    inside = valid & (t > 1.0 - 1e-9) & (t < 1.5 - 1e-9)
    assert 10 < inside.sum() < 40
    np.testing.assert_array_equal(value[inside], np.broadcast_to(last, (inside.sum(), 1)))
    late, valid_late, t_late = record(Sensor("pressure", 100.0, latency=0.1, **faults), 1000)
    same_draws(late[50:][valid_late[50:]], value[:950][valid[:950]])
    np.testing.assert_array_equal(t_late[50:], t[:950])


@pytest.mark.parametrize(
    "fault", [{"offsets": [(1.0, 0.5, 0.0)]}, {"offsets": [(0.0, 1.0, [1.0, 2.0])]}, {"frozen": [(2.0, 2.0)]}]
)
def test_faults_that_cannot_be_are_refused(fault):
    with pytest.raises(ConfigError, match="offsets|frozen"):
        Sensor("gyro", 100.0, **fault)


# -- altimeter and leak


def test_an_altimeter_reads_along_its_beam():
    """Level at 3 m over a floor at 20 m: 17 m straight down, 17 / cos 30 deg when the beam leans by 30 deg."""
    level = state((1.0, 2.0, 3.0))
    for lean, place in ((0.0, 3.0), (np.pi / 6, 3.0), (0.0, 4.0)):
        R = np.array(Sensor("altimeter", 10.0).rotation)
        turn = np.array([[np.cos(lean), 0, -np.sin(lean)], [0, 1, 0], [np.sin(lean), 0, np.cos(lean)]])
        sensor = Sensor("altimeter", 10.0, rotation=turn @ R, lever=(0.5, 0.0, place - 3.0))
        value, valid, _ = record(sensor, 100, seen=level)
        np.testing.assert_allclose(value[valid], (20.0 - place) / np.cos(lean), rtol=1e-12)
        assert valid.sum() == 2


@pytest.mark.system
def test_an_altimeter_has_no_reading_where_there_is_no_echo():
    """Beyond its range, level or looking up, from below the floor, and without a floor; finite fillers all the same."""
    down = state((0.0, 0.0, 3.0))
    blind = {
        "too far": (Sensor("altimeter", 10.0, max_range=16.9), down, SEA),
        "level": (Sensor("altimeter", 10.0, rotation=np.eye(3)), down, SEA),
        "up": (Sensor("altimeter", 10.0), state((0.0, 0.0, 3.0), (0.0, 1.0, 0.0, 0.0)), SEA),
        "below": (Sensor("altimeter", 10.0), state((0.0, 0.0, 21.0)), SEA),
        "no floor": (Sensor("altimeter", 10.0, frozen=[(0.1, 1.0)]), down, Environment.calm()),
    }
    for why, (sensor, seen, sea) in blind.items():
        memory = sensor.init(jax.random.key(0), START)
        for k in (49, 99):
            memory, slot = sensor.step(memory, SensorInput(seen, NU_DOT, jnp.asarray(k), sea), DT)
            assert not slot.valid.any() and not slot.value.any(), why
    assert record(Sensor("altimeter", 10.0, max_range=17.1), 100, seen=down)[1].any()


@pytest.mark.system
def test_a_frozen_altimeter_reads_on_where_there_is_no_echo():
    """It repeats its last reading out of reach too, but not while it is silent; without one there is none to repeat."""
    sensor = Sensor("altimeter", 10.0, max_range=18.0, frozen=[(0.15, 1.0)], blackouts=[(0.35, 0.45)])
    for first, expected in ((3.0, [True, True, True, False, True]), (1.0, [False] * 5)):
        memory = sensor.init(jax.random.key(0), START)
        for i, depth in enumerate([first, 1.0, 1.0, 1.0, 1.0]):
            seen = SensorInput(state((0.0, 0.0, depth)), NU_DOT, jnp.asarray(50 * i + 49), SEA)
            memory, slot = sensor.step(memory, seen, DT)
            assert bool(slot.valid[0]) == expected[i]
            assert float(slot.value[0, 0]) == pytest.approx(17.0 if expected[i] else 0.0)


def test_a_leak_sensor_says_so():
    sensor = Sensor("leak", 1.0)
    for leak, reads in ((jnp.asarray(True), 1.0), (jnp.asarray(False), 0.0), (None, 0.0)):
        seen = SensorInput(SOMEWHERE, NU_DOT, jnp.asarray(499), SEA, leak=leak)
        _, slot = sensor.step(sensor.init(jax.random.key(0), START), seen, DT)
        assert slot.valid[0] and float(slot.value[0, 0]) == reads
