"""The twin: plant, world and sensors on one clock; the same alone, in a loop and in a crowd."""

import equinox as eqx
import numpy as np
import pytest
from tests.simulation.helper import vehicle

from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Environment
from rovtwin.core.frames import euler_from_quaternion, rotation_from_quaternion
from rovtwin.core.numerics import jax, jnp
from rovtwin.simulation.environment.current import ConstantCurrent
from rovtwin.simulation.environment.waves import ThesisWaves
from rovtwin.simulation.environment.world import World
from rovtwin.simulation.mismatch import perturbed
from rovtwin.simulation.sensors.sensor import Sensor, table_5_7
from rovtwin.simulation.twin import Twin, TwinInput
from rovtwin.vehicle.physics.dynamics import rollout
from rovtwin.vehicle.physics.model import GRAVITY

DT = 0.02
START = Start.at((0.0, 0.0, 0.5), 0.3)
SEA = World(ConstantCurrent([0.0, 0.1, 0.0]), ThesisWaves(4.1, 8.7, drift_intensity=(0.03, 0.03)))
KEYS = jax.random.split(jax.random.key(11), 3)


def command(k):
    """Something that never repeats."""
    return Command(0.6 * jnp.sin(jnp.array([0.31, 0.47, 0.23, 0.8, 0.9, 0.7]) * (k * DT) + jnp.arange(6.0)))


def fly(twin, key, ticks):
    def tick(memory, k):
        return twin.step(memory, TwinInput(command(k), k), DT)

    return jax.lax.scan(tick, twin.init(key, START), jnp.arange(ticks))


@pytest.fixture(scope="module")
def twin():
    some = {name: table_5_7()[name] for name in ("accelerometer", "attitude", "pressure")}
    return Twin(vehicle(), SEA, some | {"late": Sensor("position", 7.0, noise=0.1, latency=0.413)})


@pytest.fixture(scope="module")
def run(twin):
    return jax.jit(lambda key: fly(twin, key, 500))


@pytest.fixture(scope="module")
def flight(run):
    """Three vehicles, one after the other, 10 s each."""
    return [run(key) for key in KEYS]


def rows(slot):
    """Readings in order of arrival: value and t_valid of the valid ones, and the tick that brought each."""
    valid = np.asarray(slot.valid)
    tick = np.broadcast_to(np.arange(len(valid))[:, None], valid.shape)
    return np.asarray(slot.value)[valid], np.asarray(slot.t_valid)[valid], tick[valid]


@pytest.mark.system
def test_every_sensor_delivers_all_its_readings(twin, flight):
    for name, slot in flight[0][1].measurements.items():
        sensor = twin.sensors[name]
        value, t_valid, tick = rows(slot)
        assert slot.valid.shape[1] == sensor.capacity(10)
        ends = (np.flatnonzero(np.asarray(sensor.ticks(jnp.arange(5000)))) + 1) * DT / 10
        ends = ends[ends + sensor.latency_steps * DT / 10 <= 10.0 + 1e-9]
        np.testing.assert_allclose(t_valid, ends, rtol=1e-12)
        arrival = ends + sensor.latency_steps * DT / 10
        np.testing.assert_array_equal(tick, np.ceil(np.round(arrival / DT, 9)) - 1)
        assert len(np.unique(value[:, 0])) == len(value)
        assert np.isfinite(slot.value).all()


@pytest.mark.system
def test_ideal_sensors_read_the_truth_of_the_same_instant():
    """Without noise, what is valid at the end of a tick is the state that the tick returns, in waves and current."""
    kinds = {"position": 50.0, "pressure": 50.0, "accelerometer": 100.0, "gyro": 50.0, "attitude": 50.0, "dvl": 50.0}
    twin = Twin(vehicle(), SEA, {kind: Sensor(kind, rate) for kind, rate in kinds.items()})
    _, output = jax.jit(lambda key: fly(twin, key, 200))(KEYS[0])
    state, read = output.state, {name: np.asarray(slot.value)[:, -1] for name, slot in output.measurements.items()}
    np.testing.assert_allclose(output.measurements["gyro"].t_valid[:, 0], (np.arange(200) + 1) * DT, rtol=1e-12)
    np.testing.assert_allclose(read["position"], state.position[:, :2], atol=1e-14)
    np.testing.assert_allclose(read["pressure"][:, 0], state.position[:, 2], atol=1e-14)
    np.testing.assert_allclose(read["gyro"], state.nu[:, 3:], atol=1e-14)
    np.testing.assert_allclose(read["dvl"], state.nu[:, :3], atol=1e-14)
    np.testing.assert_allclose(read["attitude"], jax.vmap(euler_from_quaternion)(state.attitude), atol=1e-12)
    R = np.asarray(jax.vmap(rotation_from_quaternion)(state.attitude))
    nu, nu_dot = np.asarray(state.nu), np.asarray(output.nu_dot)
    inertial = nu_dot[:, :3] + np.cross(nu[:, 3:], nu[:, :3])
    np.testing.assert_allclose(read["accelerometer"], inertial - GRAVITY * R[:, 2], atol=1e-12)
    # And nu_dot is the rate of nu: differences over two ticks, of a motion with time scales of 0.2 s and more.
    middle = (nu[2:] - nu[:-2]) / (2 * DT)
    assert np.abs(middle - nu_dot[1:-1])[20:].max() < 0.02 * np.abs(nu_dot).max()


@pytest.mark.system
def test_calm_water_is_the_plant_alone():
    twin = Twin(vehicle(), World(), {})
    (memory, output) = jax.jit(lambda key: fly(twin, key, 100))(KEYS[0])
    u = jnp.repeat(jax.vmap(command)(jnp.arange(100)).u, 10, axis=0)
    begin = twin.init(KEYS[0], START).state
    states = jax.jit(lambda: rollout(twin.model, begin, Command(u), Environment.calm(), DT / 10))()
    for alone, here in zip(jax.tree.leaves(states), jax.tree.leaves(output.state), strict=True):
        np.testing.assert_allclose(here, np.asarray(alone)[9::10], atol=1e-12)
    assert output.measurements == {}


@pytest.mark.system
def test_same_seed_same_bits_other_seed_other_noise(run, flight):
    again = run(KEYS[0])
    for a, b in zip(jax.tree.leaves(again), jax.tree.leaves(flight[0]), strict=True):
        np.testing.assert_array_equal(a, b)
    for name in ("accelerometer", "late"):
        here, there = (rows(flight[i][1].measurements[name])[0] for i in (0, 1))
        assert np.all(here != there)
    assert np.abs(flight[0][1].environment.wrench - flight[1][1].environment.wrench).max() > 0.1


@pytest.mark.system
def test_tick_by_tick_is_the_scan(twin, flight):
    step = jax.jit(lambda memory, k: twin.step(memory, TwinInput(command(k), k), DT))
    memory = twin.init(KEYS[0], START)
    structure = jax.tree.structure(memory)
    for k in range(60):
        memory, output = step(memory, k)
        assert jax.tree.structure(memory) == structure
        for a, b in zip(jax.tree.leaves(output), jax.tree.leaves(flight[0][1]), strict=True):
            np.testing.assert_allclose(a, b[k], atol=1e-12)


@pytest.mark.slow
def test_a_crowd_flies_like_each_alone(twin, flight):
    def open_tcp_server(keys):
        tick = jax.vmap(twin.step, in_axes=(0, TwinInput(Command(None), None), None))
        memory = jax.vmap(lambda key: twin.init(key, START))(keys)
        return jax.lax.scan(lambda m, k: tick(m, TwinInput(command(k), k), DT), memory, jnp.arange(500))[1]

    together = jax.jit(open_tcp_server)(KEYS)
    for i in range(len(KEYS)):
        for a, b in zip(jax.tree.leaves(flight[i][1]), jax.tree.leaves(together), strict=True):
            np.testing.assert_allclose(np.asarray(b)[:, i].astype(float), np.asarray(a).astype(float), atol=1e-9)


@pytest.mark.slow
def test_a_crowd_of_different_vehicles(twin):
    models = [perturbed(twin.model, key) for key in KEYS]
    plants = jax.tree.map(lambda *leaves: jnp.stack(leaves), *models)

    def one(model, key):
        return fly(Twin(model, twin.world, twin.sensors), key, 50)[1].state.position

    together = eqx.filter_jit(eqx.filter_vmap(one))(plants, KEYS)
    alone = eqx.filter_jit(one)(models[2], KEYS[2])
    np.testing.assert_allclose(together[2], alone, atol=1e-12)
    assert np.abs(together[0, -1] - together[1, -1]).max() > 1e-4


@pytest.mark.system
def test_conditions_on_the_clock_survive_vmap(twin):
    """Were one turned into a select, a thousand vehicles would draw random numbers in every step."""

    def conditions(function, *arguments):
        return jax.jit(function).lower(*arguments).as_text().count("stablehlo.case")

    memory = twin.init(KEYS[0], START)
    memories = jax.vmap(lambda key: twin.init(key, START))(KEYS)
    single = conditions(lambda m, k: twin.step(m, TwinInput(command(0), k), DT), memory, 0)
    batch = jax.vmap(lambda m, k: twin.step(m, TwinInput(command(0), k), DT), in_axes=(0, None))
    assert single == conditions(batch, memories, 0) == len(twin.sensors) + 2  # nu_dot, and the late one's delivery


@pytest.mark.system
def test_one_sensor_more_changes_nothing_for_the_others(twin, flight):
    fewer = Twin(twin.model, twin.world, {name: twin.sensors[name] for name in ("pressure", "late")})
    _, output = jax.jit(lambda key: fly(fewer, key, 500))(KEYS[0])
    for name in fewer.sensors:
        np.testing.assert_allclose(
            output.measurements[name].value, flight[0][1].measurements[name].value, rtol=1e-9, atol=1e-9
        )


def test_empty_has_the_shape_of_what_is_measured(twin, flight):
    measured = jax.tree.map(lambda leaf: leaf[0], flight[0][1].measurements)
    assert jax.tree.map(jnp.shape, twin.empty()) == jax.tree.map(jnp.shape, measured)


@pytest.mark.system
def test_a_minute_of_calm_water_in_a_crowd_agrees_to_a_nanometre():
    twin = Twin(vehicle(), World(), table_5_7())
    state = jax.jit(lambda key: fly(twin, key, 3000)[1].state)(KEYS[1])
    open_tcp_server = jax.jit(jax.vmap(lambda key: fly(twin, key, 3000)[1].state))(KEYS)
    for a, b in zip(jax.tree.leaves(state), jax.tree.leaves(open_tcp_server), strict=True):
        np.testing.assert_allclose(b[1], a, atol=1e-9)


@pytest.mark.slow  # compiles for a minute: reverse mode through two scans
def test_gradient_through_a_flight_is_finite(twin):
    def reading(model):
        output = fly(Twin(model, twin.world, twin.sensors), KEYS[0], 3)[1]
        return (output.measurements["accelerometer"].value ** 2).sum()

    gradient = eqx.filter_jit(eqx.filter_grad(reading))(twin.model)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradient))
    assert np.abs(gradient.inertia_inverse).max() > 0 and np.abs(gradient.damping).max() > 0
