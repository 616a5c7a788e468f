"""The airy sea: statistics of the record, the equations of the water, and what a body does in it."""

import numpy as np
import pytest
from tests.simulation.helper import state, vehicle

from rovtwin.core.block import Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Command, Environment
from rovtwin.core.numerics import jax, jnp
from rovtwin.simulation.airy import AirySea, _cosine_sine
from rovtwin.simulation.sea import SeaState
from rovtwin.simulation.sensors import Sensor, SensorInput
from rovtwin.simulation.world import World
from rovtwin.vehicle.dynamics import acceleration, damping_wrench, plant_step
from rovtwin.vehicle.model import GRAVITY
from rovtwin.vehicle.thrusters import thrusters_from

START = Start.at()
SMALL = AirySea.of(SeaState.of(0.27, zero_crossing_period=3.0, gamma=3.3), direction=np.pi, depth=20.0)
SHORT_CRESTED = AirySea.of(
    SeaState.of(1.5, zero_crossing_period=5.7), direction=0.4, depth=12.0, spreading=2.0, count=24
)
DEEP = AirySea.of(SeaState.of(4.1, zero_crossing_period=8.7), direction=0.4, count=24)
SEAS = {"spread, finite depth": SHORT_CRESTED, "long-crested, deep": DEEP}
look = jax.jit(AirySea.at)


def one_wave(amplitude=1.0, omega=1.0, direction=0.0) -> AirySea:
    """A regular wave in deep water."""
    return AirySea([amplitude], [omega], [omega**2 / GRAVITY], [direction])


def phase_of(sea, seed=0):
    return sea.init(jax.random.key(seed), START).phase


def test_cosine_and_sine():
    angle = jnp.linspace(-60.0, 60.0, 20_001)
    cosine, sine = _cosine_sine(angle)
    np.testing.assert_allclose(cosine, np.cos(angle), atol=1e-14)
    np.testing.assert_allclose(sine, np.sin(angle), atol=1e-14)


# -- statistics


def record(sea, depths, seeds, dt=0.25, duration=1800.0):
    """Elevation (seeds, n) and northward velocity (seeds, depths, n) at the origin."""
    t = jnp.arange(0.0, duration, dt)

    def one(seed):
        phase = phase_of(sea, seed)
        at = jax.vmap(jax.vmap(lambda z, t: sea.at(phase, t, jnp.array([0.0, 0.0, z])), (None, 0)), (0, None))
        actions = at(jnp.asarray(depths), t)
        return actions.elevation[0], actions.velocity[..., 0]

    return jax.tree.map(np.asarray, jax.jit(jax.vmap(one))(jnp.arange(seeds)))


DEPTHS = (0.0, 1.0, 3.0, 5.0)


@pytest.fixture(scope="module")
def half_an_hour():
    return record(SMALL, DEPTHS, 6)


def analytic_velocity(sea: SeaState, depth: float, z: float, omega: np.ndarray) -> np.ndarray:
    """Spectrum of the velocity along the waves, from the wave number found by bisection."""
    low, high = np.zeros_like(omega), omega**2 / GRAVITY + 10.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        above = GRAVITY * middle * np.tanh(middle * depth) > omega**2
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    k = 0.5 * (low + high)
    decay = np.exp(-k * z) * (1 + np.exp(-2 * k * (depth - z))) / (1 - np.exp(-2 * k * depth))
    return sea.spectrum(omega) * (omega * decay) ** 2


def test_height_over_half_an_hour(half_an_hour):
    elevation, _ = half_an_hour
    np.testing.assert_allclose(4 * elevation.std(1), 0.27, rtol=0.03)


def test_orbital_velocity_decays_with_depth_as_theory_says(half_an_hour):
    _, velocity = half_an_hour
    omega = np.linspace(0.5, 12.0, 20_000)
    sea = SeaState.of(0.27, zero_crossing_period=3.0, gamma=3.3)
    exact = [np.sqrt(np.trapezoid(analytic_velocity(sea, 20.0, z, omega), omega)) for z in DEPTHS]
    simulated = np.sqrt((velocity**2).mean((0, 2)))
    np.testing.assert_allclose(simulated, exact, rtol=0.02)
    np.testing.assert_allclose(simulated[1:] / simulated[1], np.array(exact[1:]) / exact[1], rtol=0.01)


def test_spectra_of_surface_and_of_velocity_at_depth(half_an_hour):
    """Energy in four bands, over all records; periodograms of 30 min."""
    elevation, velocity = half_an_hour
    sea = SeaState.of(0.27, zero_crossing_period=3.0, gamma=3.3)
    n = elevation.shape[1]
    omega = 2 * np.pi * np.fft.rfftfreq(n, 0.25)
    fine = np.linspace(0.5, 12.0, 20_000)
    for series, S in (
        (elevation, sea.spectrum(fine)),
        (velocity[:, 2], analytic_velocity(sea, 20.0, 3.0, fine)),
    ):
        power = 2 * (np.abs(np.fft.rfft(series * np.hanning(n) * np.sqrt(8 / 3))) ** 2).mean(0) / n**2
        whole = np.trapezoid(S, fine)
        for low, high in ((0.8, 1.4), (1.4, 1.8), (1.8, 2.5), (2.5, 5.0)):
            band = (fine >= low) & (fine < high)
            expected = np.trapezoid(S[band], fine[band])
            found = power[(omega >= low) & (omega < high)].sum()
            assert found == pytest.approx(expected, abs=0.02 * whole + 0.05 * expected)


# -- the equations of the water


@pytest.mark.parametrize("sea", SEAS.values(), ids=SEAS)
def test_gradient_and_rate_are_those_of_the_velocity(sea):
    phase, place, t = phase_of(sea), jnp.array([3.0, -4.0, 2.0]), jnp.array(7.0)
    flow = look(sea, phase, t, place)
    by_place = jax.jacfwd(lambda x: sea.at(phase, t, x).velocity)(place)
    by_time = jax.jacfwd(lambda s: sea.at(phase, s, place).velocity)(t)
    np.testing.assert_allclose(flow.gradient, by_place, atol=1e-13)
    np.testing.assert_allclose(flow.rate, by_time, atol=1e-13)
    step = 1e-5
    ahead = look(sea, phase, t, place + jnp.array([0.0, 0.0, step])).velocity
    np.testing.assert_allclose((ahead - flow.velocity) / step, flow.gradient[:, 2], atol=1e-4)
    assert abs(np.trace(flow.gradient)) < 1e-14, "water is not compressed"
    np.testing.assert_allclose(flow.gradient, flow.gradient.T, atol=1e-14, err_msg="nor does it turn")


@pytest.mark.parametrize("sea", SEAS.values(), ids=SEAS)
def test_pressure_drives_the_water_and_the_water_carries_the_surface(sea):
    """Linearised: dv/dt = -g grad(head); d(elevation)/dt is the velocity up at z = 0, and head is elevation there."""
    phase, place, t = phase_of(sea), jnp.array([3.0, -4.0, 2.0]), jnp.array(7.0)
    slope = jax.jacfwd(lambda x: sea.at(phase, t, x).head)(place)
    np.testing.assert_allclose(look(sea, phase, t, place).rate, -GRAVITY * slope, atol=1e-12)
    top = place.at[2].set(0.0)
    at_surface = look(sea, phase, t, top)
    rising = jax.jacfwd(lambda s: sea.at(phase, s, top).elevation)(t)
    np.testing.assert_allclose(-at_surface.velocity[2], rising, atol=1e-12)
    np.testing.assert_allclose(at_surface.head, at_surface.elevation, atol=1e-12)


def test_no_water_passes_the_floor():
    phase = phase_of(SHORT_CRESTED)
    for t in (0.0, 3.0):
        flow = look(SHORT_CRESTED, phase, t, jnp.array([1.0, 2.0, 12.0]))
        assert abs(float(flow.velocity[2])) < 1e-15 and abs(float(flow.rate[2])) < 1e-15
        assert np.abs(flow.velocity[:2]).max() > 0.01


def test_above_the_mean_surface_the_water_moves_as_at_it():
    phase = phase_of(DEEP)
    below, above = (look(DEEP, phase, 1.0, jnp.array([1.0, 2.0, z])) for z in (0.0, -1.5))
    np.testing.assert_array_equal(below.velocity, above.velocity)


@pytest.mark.parametrize("depth", [3.0, 4000.0])
def test_nothing_overflows(depth):
    sea = AirySea.of(SeaState.of(0.5, peak_period=4.0), depth=depth, count=8)
    for z in (0.0, 0.5 * depth, depth):
        action = look(sea, phase_of(sea), 1.0, jnp.array([0.0, 0.0, z]))
        assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(action))


def test_deep_water_is_the_limit_of_finite_depth():
    sea = SeaState.of(0.5, peak_period=4.0)
    deep, finite = AirySea.of(sea, count=8), AirySea.of(sea, depth=300.0, count=8)
    place = jnp.array([1.0, 0.0, 2.0])
    a, b = (look(s, phase_of(s), 5.0, place) for s in (deep, finite))
    np.testing.assert_allclose(a.velocity, b.velocity, atol=1e-9)
    np.testing.assert_allclose(a.gradient, b.gradient, atol=1e-9)


def test_waves_run_to_where_the_direction_says():
    """A crest that is here now is a quarter of a period later a quarter of a wave length to the south."""
    sea = one_wave(omega=1.2, direction=np.pi)
    now = sea.at(jnp.zeros(1), 0.0, jnp.zeros(3))
    later = sea.at(jnp.zeros(1), 0.5 * np.pi / 1.2, jnp.array([-0.5 * np.pi * GRAVITY / 1.2**2, 0.0, 0.0]))
    assert float(now.elevation) == pytest.approx(1.0) == pytest.approx(float(later.elevation))
    assert float(now.velocity[0]) == pytest.approx(-1.2), "under a crest the water runs with the waves"


def test_a_moving_vehicle_meets_the_waves_at_the_frequency_of_encounter():
    sea, speed = one_wave(omega=1.5), -0.8
    t = jnp.linspace(0.0, 40.0, 4000)
    met = jax.vmap(lambda t: sea.at(jnp.zeros(1), t, jnp.array([speed * t, 0.0, 1.0])).elevation)(t)
    np.testing.assert_allclose(met, np.cos((1.5 - 1.5**2 / GRAVITY * speed) * t), atol=1e-9)


def test_steps_count_time():
    memory = SMALL.init(jax.random.key(3), START)
    where = state((1.0, 2.0, 3.0))
    stepped = jax.lax.scan(lambda m, _: SMALL.step(m, where, 0.02), memory, None, length=500)[1]
    start, middle = (look(SMALL, memory.phase, k * 0.02, where.position) for k in (499, 499.5))
    np.testing.assert_allclose(stepped.elevation[-1], middle.elevation, atol=1e-12)
    np.testing.assert_allclose(stepped.flow.rate[-1], middle.rate, atol=1e-12)
    np.testing.assert_allclose(stepped.flow.velocity[-1], start.velocity, atol=1e-5)


# -- a body in it


def sphere(mass=30.0):
    """Neutral, without drag, and nothing in it that turns."""
    zero = np.zeros((6, 6))
    return vehicle(
        rigid_body_mass=np.diag([mass] * 3 + [1.0] * 3),
        added_mass=np.diag([0.5 * mass] * 3 + [0.0] * 3),
        linear_damping_ahead=zero,
        quadratic_damping_ahead=zero,
        center_of_gravity=(0.0, 0.0, 0.0),
        center_of_buoyancy=(0.0, 0.0, 0.0),
        thrusters=thrusters_from(jnp.zeros((6, 0)), jnp.zeros(0)),
    )


def drifted(sea, model, depth, duration, dt=0.02, moving=True):
    """Paths of a body let go at a depth, and of the water that was there, shape (n, 3) each."""
    world = World(waves=sea)
    memory = world.init(jax.random.key(1), START)
    v0 = sea.at(memory.waves.phase, 0.0, jnp.array([0.0, 0.0, depth])).velocity * moving
    body = state((0.0, 0.0, depth), nu=(*(float(v) for v in v0), 0.0, 0.0, 0.0))

    def particle(t, x):
        return sea.at(memory.waves.phase, t, x).velocity

    def step(carry, k):
        memory, body, x = carry
        memory, environment = world.step(memory, body, dt)
        body = plant_step(model, body, Command(jnp.zeros(0)), environment, dt)
        t = k * dt
        k1 = particle(t, x)
        k2 = particle(t + dt / 2, x + dt / 2 * k1)
        k3 = particle(t + dt / 2, x + dt / 2 * k2)
        x = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + particle(t + dt, x + dt * k3))
        return (memory, body, x), (body.position, x)

    run = jax.jit(lambda c: jax.lax.scan(step, c, jnp.arange(round(duration / dt)))[1])
    return jax.tree.map(np.asarray, run((memory, body, body.position)))


def test_a_neutral_body_without_drag_follows_the_water():
    """To 5 mm after a minute, at ten times the step of the scenarios; the error goes with the step squared."""
    body, water = drifted(SHORT_CRESTED, sphere(), 2.0, 60.0)
    assert np.abs(water - water[0]).max() > 0.5
    np.testing.assert_allclose(body, water, atol=5e-3)


def test_what_is_carried_round_drifts_with_the_waves():
    """Stokes (1847): a^2 omega k exp(-2 k z), over whole turns."""
    omega, a, depth = 1.2, 0.3, 1.5
    sea, k = one_wave(a, omega), omega**2 / GRAVITY
    turns = 20 * 2 * np.pi / omega
    body, _ = drifted(sea, sphere(), depth, turns)
    # About the middle of its orbit: it is let go in one place of it.
    middle = body[:, 2].mean()
    assert (body[-1, 0] - body[0, 0]) / turns == pytest.approx(a**2 * omega * k * np.exp(-2 * k * middle), rel=0.05)


def test_force_on_a_fixed_body_is_morisons():
    """Froude-Krylov, added mass and drag: rho V (1 + Ca) u_dot + D(u) u, in waves long against the body."""
    model, sea = vehicle(), one_wave(0.5, 0.6)
    phase, place = jnp.array([1.0]), jnp.array([0.0, 0.0, 3.0])
    for t in np.linspace(0.0, 10.0, 7):
        flow = sea.at(phase, t, place)
        environment = Environment.calm(velocity=flow.velocity, rate=flow.rate, gradient=flow.gradient, place=place)
        nu_dot = acceleration(model, place, jnp.array([1.0, 0, 0, 0]), jnp.zeros(6), jnp.zeros(6), environment)
        force = (model.mass @ nu_dot)[:3]
        inertia = model.displaced_mass * flow.rate + model.added_mass[:3, :3] @ flow.rate
        drag = -damping_wrench(model, -jnp.concatenate([flow.velocity, jnp.zeros(3)]))[:3]
        # Convective terms, which Morison leaves out, are k a = 2 % of the largest force.
        np.testing.assert_allclose(force, inertia + drag, atol=0.02 * float(jnp.abs(inertia).max()) + 0.05)


# -- in the world


def test_surface_and_pressure_follow_the_waves():
    world = World(waves=SMALL, surface=jnp.array(0.0))
    memory = world.init(jax.random.key(2), START)
    under = state((1.0, 0.0, 2.0))
    _, environment = world.step(memory, under, 0.002)
    action = look(SMALL, memory.waves.phase, 0.001, under.position)
    assert float(environment.surface) == pytest.approx(-float(action.elevation))
    assert float(environment.head) == pytest.approx(float(action.head))
    pressure = Sensor("pressure", 500.0)
    seen = SensorInput(under, jnp.zeros(6), jnp.asarray(0), environment)
    _, slot = pressure.step(pressure.init(jax.random.key(0), START), seen, 0.002)
    assert float(slot.value[0, 0]) == pytest.approx(2.0 + float(action.head))


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda sea: AirySea.of(sea, direction=45.0), "degrees"),
        (lambda sea: AirySea.of(sea, depth=0.0), "above 0"),
        (lambda sea: AirySea.of(sea, depth=1.0), "break"),
        (lambda sea: AirySea.of(sea, count=1), "2 or more"),
        (lambda sea: AirySea.of(sea, spreading=0.0), "spreading"),
        (lambda sea: AirySea([1.0], [1.0], [0.0], [0.0]), "wavenumber"),
        (lambda sea: AirySea([1.0], [1.0, 2.0], [0.1], [0.0]), "omega"),
        (lambda sea: AirySea([-1.0], [1.0], [0.1], [0.0]), "amplitude"),
    ],
)
def test_seas_that_cannot_be(make, words):
    with pytest.raises(ConfigError, match=words):
        make(SeaState.of(1.0, peak_period=6.0))
