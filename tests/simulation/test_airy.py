"""The airy sea: statistics of the record, and the equations of the water."""

import numpy as np
import pytest
from tests.simulation.helper import SHORT_CRESTED, SMALL_SEA, one_wave, state

from rovtwin.core.block import Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import jax, jnp
from rovtwin.simulation.environment.airy import AirySea, _cosine_sine
from rovtwin.simulation.environment.current import ConstantCurrent
from rovtwin.simulation.environment.sea import SeaState
from rovtwin.simulation.environment.world import World
from rovtwin.vehicle.physics.model import GRAVITY

START = Start.at()
DEEP = AirySea.of(SeaState.of(4.1, zero_crossing_period=8.7), direction=0.4, count=24)
SEAS = {"spread, finite depth": SHORT_CRESTED, "long-crested, deep": DEEP}
look = jax.jit(AirySea.at)


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
    return record(SMALL_SEA, DEPTHS, 6)


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
    omega = np.linspace(0.5, 100.0, 100_000)  # far beyond where the simulated waves end
    sea = SeaState.of(0.27, zero_crossing_period=3.0, gamma=3.3)
    exact = [np.sqrt(np.trapezoid(analytic_velocity(sea, 20.0, z, omega), omega)) for z in DEPTHS]
    simulated = np.sqrt((velocity**2).mean((0, 2)))
    np.testing.assert_allclose(simulated, exact, rtol=0.01)
    np.testing.assert_allclose(simulated / simulated[0], np.array(exact) / exact[0], rtol=0.01)


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


@pytest.mark.system
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


@pytest.mark.system
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


@pytest.mark.system
@pytest.mark.parametrize("sea", SEAS.values(), ids=SEAS)
def test_above_the_mean_surface_the_gradient_is_that_of_the_velocity_there(sea):
    """Nothing changes with height, so that neither divergence nor curl vanish."""
    phase, place = phase_of(sea), jnp.array([1.0, 2.0, -0.5])
    flow = look(sea, phase, 1.0, place)
    np.testing.assert_allclose(flow.gradient, jax.jacfwd(lambda x: sea.at(phase, 1.0, x).velocity)(place), atol=1e-13)
    assert not np.any(flow.gradient[:, 2]) and np.abs(flow.gradient[:, :2]).max() > 0.01


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


@pytest.mark.system
def test_a_moving_vehicle_meets_the_waves_at_the_frequency_of_encounter():
    sea, speed = one_wave(omega=1.5), -0.8
    t = jnp.linspace(0.0, 40.0, 4000)
    met = jax.vmap(lambda t: sea.at(jnp.zeros(1), t, jnp.array([speed * t, 0.0, 1.0])).elevation)(t)
    np.testing.assert_allclose(met, np.cos((1.5 - 1.5**2 / GRAVITY * speed) * t), atol=1e-9)


@pytest.mark.system
def test_waves_do_not_ride_on_a_current():
    """The stated limit: with a current U the water's acceleration is off from the pressure's by k U / omega."""
    omega, a, speed = np.pi, 1e-6, 0.3
    sea, at = one_wave(a, omega), state((0.0, 0.0, 0.5))
    world = World(ConstantCurrent([speed, 0.0, 0.0]), sea)
    memory = world.init(jax.random.key(0), START)
    _, environment = world.step(memory, at, 1e-6)
    particles = environment.rate + environment.gradient @ environment.velocity
    by_pressure = -GRAVITY * jax.jacfwd(lambda x: sea.at(memory.waves.phase, 0.0, x).head)(at.position)
    largest = a * omega**2 * np.exp(-0.5 * omega**2 / GRAVITY)
    error = np.linalg.norm(particles - by_pressure) / largest
    assert error == pytest.approx(omega * speed / GRAVITY, rel=1e-3) == pytest.approx(0.096, abs=1e-3)


def test_steps_count_time():
    memory = SMALL_SEA.init(jax.random.key(3), START)
    where = state((1.0, 2.0, 3.0))
    stepped = jax.lax.scan(lambda m, _: SMALL_SEA.step(m, where, 0.02), memory, None, length=500)[1]
    start, middle = (look(SMALL_SEA, memory.phase, k * 0.02, where.position) for k in (499, 499.5))
    np.testing.assert_allclose(stepped.elevation[-1], middle.elevation, atol=1e-12)
    np.testing.assert_allclose(stepped.flow.rate[-1], middle.rate, atol=1e-12)
    np.testing.assert_allclose(stepped.flow.velocity[-1], start.velocity, atol=1e-5)


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
