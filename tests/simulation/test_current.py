"""Currents: values, slopes and statistics; and what the plant does in them."""

import numpy as np
import pytest
from tests.simulation.helper import mean_interval, state, variance_interval, vehicle

from rovtwin.core.block import Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Command
from rovtwin.core.numerics import jax, jnp
from rovtwin.simulation.environment.current import CombinedCurrent, ConstantCurrent, GaussMarkovCurrent, ShearedCurrent
from rovtwin.simulation.environment.world import World
from rovtwin.vehicle.physics.dynamics import State, plant_step

START = Start.at()
HERE = jnp.zeros(3)
LAYERS = ShearedCurrent([1.0, 3.0, 10.0], [[0.1, 0.0, 0.0], [0.2, -0.1, 0.02], [0.5, 0.3, 0.0]])
WANDERING = GaussMarkovCurrent([0.1, -0.2, 0.0], [0.05, 0.08, 0.01], 20.0, interval=0.5)


def series(current, steps, dt, key=0):
    def one(memory, _):
        return current.step(memory, HERE, dt)

    return jax.lax.scan(one, current.init(jax.random.key(key), START), None, length=steps)[1]


def test_constant_is_the_same_everywhere():
    current = ConstantCurrent([0.1, 0.2, -0.3])
    _, flow = current.step(None, jnp.array([5.0, -7.0, 30.0]), 0.002)
    np.testing.assert_array_equal(flow.velocity, [0.1, 0.2, -0.3])
    assert not flow.rate.any() and flow.gradient is None


def test_sheared_interpolates_and_stays_constant_outside():
    depths = np.concatenate([np.linspace(-2, 14, 61), [1.0, 3.0, 10.0]])
    flow = jax.vmap(lambda z: LAYERS.step(None, jnp.array([1.0, 2.0, z]), 0.002)[1])(jnp.array(depths))
    for axis in range(3):
        expected = np.interp(depths, LAYERS.depths, LAYERS.layers[:, axis])
        np.testing.assert_allclose(flow.velocity[:, axis], expected, atol=1e-15)


def test_shear_is_the_slope_of_the_velocity():
    depths = jnp.array([0.5, 1.7, 2.9, 3.1, 9.9, 11.0])

    def velocity(z):
        return LAYERS.step(None, jnp.array([0.0, 0.0, z]), 0.002)[1].velocity

    slopes = jax.jit(jax.vmap(jax.jacfwd(velocity)))(depths)
    shear = jax.vmap(lambda z: LAYERS.step(None, jnp.array([0.0, 0.0, z]), 0.002)[1].gradient[:, 2])(depths)
    np.testing.assert_allclose(shear, slopes, atol=1e-15)
    np.testing.assert_allclose(shear[1], [0.05, -0.05, 0.01], atol=1e-15)
    assert not shear[0].any() and not shear[-1].any()


def test_wandering_velocity_has_no_jumps():
    dt = 0.002
    flow = jax.jit(lambda: series(WANDERING, 5000, dt))()
    np.testing.assert_allclose(flow.velocity[:-1] + dt * flow.rate[:-1], flow.velocity[1:], atol=1e-12)
    # 0.5 s between nodes of 2 ms steps: the acceleration changes every 250 steps and not between.
    changes = np.flatnonzero(np.abs(np.diff(flow.rate[:, 0])) > 0) + 1
    np.testing.assert_array_equal(changes, np.arange(250, 5000, 250))


def test_wandering_statistics():
    """Ensemble of 4,000: mean and variance at all times, and the correlation exp(-lag/T)."""
    n, dt, T = 4000, 0.5, 20.0
    keys = jax.random.split(jax.random.key(7), n)

    def run(key):
        memory = WANDERING.init(key, START)
        return jax.lax.scan(lambda m, _: WANDERING.step(m, HERE, dt), memory, None, length=81)[1].velocity

    v = (np.asarray(jax.jit(jax.vmap(run))(keys)) - WANDERING.mean) / WANDERING.sigma
    low, high = variance_interval(n)
    for step in (0, 1, 40, 80):
        assert np.all(np.abs(v[:, step].mean(0)) < mean_interval(n))
        assert np.all((v[:, step].var(0, ddof=1) > low) & (v[:, step].var(0, ddof=1) < high))
    for lag in (1, 10, 40, 80):
        phi = np.exp(-lag * dt / T)
        residual = v[:, lag] - phi * v[:, 0]  # independent of v[:, 0], of variance 1 - phi^2
        variance = residual.var(0, ddof=1) / (1 - phi**2)
        assert np.all((variance > low) & (variance < high)), (lag, variance)
        assert np.all(np.abs((residual * v[:, 0]).mean(0)) < mean_interval(n) * np.sqrt(1 - phi**2) * 1.05)


def test_default_interval_is_a_hundredth_of_the_time_constant_and_at_least_a_step():
    current = GaussMarkovCurrent([0, 0, 0], [1, 1, 1], 100.0)
    assert float(current.interval) == 1.0
    quick = GaussMarkovCurrent([0, 0, 0], [1, 1, 1], 0.1)
    flow = jax.jit(lambda: series(quick, 50, 0.01))()
    assert np.all(np.diff(flow.rate[:, 0]) != 0)
    np.testing.assert_allclose(flow.velocity[:-1] + 0.01 * flow.rate[:-1], flow.velocity[1:], atol=1e-12)


def test_parts_add_up_and_draw_on_their_own():
    both = CombinedCurrent((LAYERS, WANDERING, WANDERING))
    memory = both.init(jax.random.key(1), START)
    position = jnp.array([0.0, 0.0, 2.0])
    _, flow = both.step(memory, position, 0.002)
    parts = [part.step(m, position, 0.002)[1] for part, m in zip(both.parts, memory, strict=True)]
    np.testing.assert_allclose(flow.velocity, sum(p.velocity for p in parts), atol=1e-15)
    np.testing.assert_allclose(flow.gradient, parts[0].gradient, atol=1e-15)
    assert np.all(parts[1].velocity != parts[2].velocity)


def test_a_current_is_the_same_at_co_and_elsewhere():
    """`velocities`, for tethers, agrees with `step`, for the vehicle, also between the nodes of a wandering current."""
    both = CombinedCurrent((LAYERS, WANDERING, ConstantCurrent([0.1, 0.0, 0.3])))
    memory, dt = both.init(jax.random.key(1), START), 0.1
    for _ in range(7):
        places = jnp.array([[0.0, 0.0, 0.5], [1.0, 2.0, 2.0], [0.0, -3.0, 7.0]])
        elsewhere = both.velocities(memory, places, dt)
        for place, velocity in zip(places, elsewhere, strict=True):
            np.testing.assert_allclose(both.step(memory, place, dt)[1].velocity, velocity, atol=1e-15)
        memory, _ = both.step(memory, places[0], dt)


def test_a_drag_free_neutral_body_goes_with_the_wandering_water():
    """It starts with the water and stays with it, through accelerations: nothing pushes it but the pressure."""
    none = jnp.zeros((6, 6))
    model = vehicle(
        rigid_body_mass=np.diag([30.0] * 3 + [1.0, 2.0, 3.0]),
        linear_damping_ahead=none,
        quadratic_damping_ahead=none,
        center_of_gravity=(0.0, 0.0, 0.0),
        center_of_buoyancy=(0.0, 0.0, 0.0),
    )
    world, dt = World(current=WANDERING), 0.002
    memory = world.init(jax.random.key(5), START)
    _, first = world.step(memory, state(), dt)
    begin = State(
        jnp.zeros(3), jnp.array([1.0, 0, 0, 0]), jnp.concatenate([first.velocity, jnp.zeros(3)]), jnp.zeros(6)
    )

    def one(carry, _):
        memory, vehicle_state = carry
        memory, environment = world.step(memory, vehicle_state, dt)
        after = plant_step(model, vehicle_state, Command(jnp.zeros(6)), environment, dt)
        gap = after.nu[:3] - (environment.velocity + dt * environment.rate)
        return (memory, after), (gap, environment.velocity)

    _, (gap, water) = jax.jit(lambda: jax.lax.scan(one, (memory, begin), None, length=5000))()
    assert np.abs(gap).max() < 1e-12
    assert np.abs(water[-1] - water[0]).max() > 0.01


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: ConstantCurrent([0.1, 0.2]), "ConstantCurrent.velocity"),
        (lambda: ConstantCurrent([0.1, 0.2, np.nan]), "finite"),
        (lambda: ShearedCurrent([1.0, 1.0], [[0, 0, 0], [1, 0, 0]]), "increase"),
        (lambda: ShearedCurrent([1.0], [[0, 0, 0]]), "two depths"),
        (lambda: ShearedCurrent([1.0, 2.0], [[0, 0, 0]]), "layers"),
        (lambda: GaussMarkovCurrent([0, 0, 0], [-1, 0, 0], 10.0), "sigma"),
        (lambda: GaussMarkovCurrent([0, 0, 0], [1, 0, 0], 0.0), "time_constant"),
    ],
)
def test_currents_that_cannot_be(make, words):
    with pytest.raises(ConfigError, match=words):
        make()
