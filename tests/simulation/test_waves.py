"""The thesis's wave force: parameters from the spectrum, statistics of the filter, direction, encounter, drift."""

import numpy as np
import pytest
from scipy.linalg import expm
from tests.simulation.helper import mean_interval, state, variance_interval

from rovtwin.core.block import Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import jax, jnp
from rovtwin.simulation.environment.waves import (
    DAMPING_RATIO,
    SEAS,
    ThesisWaves,
    _transition,
    encounter_frequency,
    filter_parameters,
    spectrum,
)
from rovtwin.simulation.environment.world import World

START = Start.at()
STORM = ThesisWaves(*SEAS[3])


def along_track(waves, steps, dt, n, speed=0.0, seed=0):
    """Forces on n vehicles that run at a speed towards north, shape (n, steps, 3)."""
    moving = state(nu=(speed, 0.0, 0.0, 0.0, 0.0, 0.0))

    def run(key):
        memory = waves.init(key, START)
        return jax.lax.scan(lambda m, _: waves.step(m, moving, dt), memory, None, length=steps)[1].force

    return np.asarray(jax.jit(jax.vmap(run))(jax.random.split(jax.random.key(seed), n)))


@pytest.mark.parametrize("height, period", SEAS.values())
def test_spectrum_has_the_height_and_period_it_is_made_from(height, period):
    w = np.linspace(0.02, 60.0, 600_000)
    S = np.asarray(spectrum(jnp.array(w), jnp.array(height), jnp.array(period)))
    m0, m2 = np.trapezoid(S, w), np.trapezoid(S * w**2, w)
    assert 4 * np.sqrt(m0) == pytest.approx(height, rel=1e-3)
    # m2 converges slowly: beyond the last frequency there is the integral of A omega^-3.
    m2 += 0.5 * 4 * np.pi**3 * height**2 / period**4 / w[-1] ** 2
    assert 2 * np.pi * np.sqrt(m0 / m2) == pytest.approx(period, rel=1e-3)


@pytest.mark.parametrize("height, period", SEAS.values())
def test_filter_is_laid_on_the_peak_of_the_spectrum(height, period):
    w = np.linspace(0.05, 10.0, 400_000)
    S = np.asarray(spectrum(jnp.array(w), jnp.array(height), jnp.array(period)))
    omega, sigma = filter_parameters(jnp.array(height), jnp.array(period))
    assert float(omega) == pytest.approx(w[S.argmax()], abs=1e-4)
    assert float(sigma) == pytest.approx(np.sqrt(S.max()), rel=1e-6)


def test_printed_form_misses_the_peak():
    printed = filter_parameters(jnp.array(4.1), jnp.array(8.7), as_printed=True)
    corrected = filter_parameters(jnp.array(4.1), jnp.array(8.7))
    assert float(printed[0]) == pytest.approx(2 * np.pi / 8.7)
    assert float(corrected[0] / printed[0]) == pytest.approx(0.710, abs=5e-4)
    assert float(printed[1] / corrected[1]) == pytest.approx(0.68, abs=5e-3)


@pytest.mark.parametrize("as_printed, rms", [(True, 0.503), (False, 0.6255)])
def test_rms_in_the_largest_sea(as_printed, rms):
    waves = ThesisWaves(*SEAS[3], as_printed=as_printed)
    assert float(waves.rms()) == pytest.approx(rms, abs=5e-4)
    omega, sigma = filter_parameters(waves.height, waves.period, as_printed)
    assert float(waves.rms()) == pytest.approx(float(jnp.sqrt(DAMPING_RATIO * omega) * sigma))


@pytest.mark.parametrize("angle", [1e-3, 0.05, 0.7, 5.0])
def test_one_step_is_the_exact_solution(angle):
    A = np.array([[0.0, 1.0], [-1.0, -2 * DAMPING_RATIO]])
    Phi, L = _transition(jnp.array(angle), jnp.array(DAMPING_RATIO))
    np.testing.assert_allclose(Phi, expm(A * angle), atol=1e-14)
    np.testing.assert_allclose(L @ L.T, np.eye(2) - Phi @ Phi.T, atol=1e-15)
    # The covariance of the noise by van Loan's block exponential, with unit stationary variance: W = 4 lambda.
    W = np.diag([0.0, 4 * DAMPING_RATIO])
    M = expm(np.block([[-A, W], [np.zeros((2, 2)), A.T]]) * angle)
    np.testing.assert_allclose(L @ L.T, M[2:, 2:].T @ M[:2, 2:], rtol=2e-5, atol=1e-15)


def test_no_sequence_of_frequencies_makes_the_filter_grow():
    angles = jnp.array(np.random.default_rng(0).uniform(0, 6, 200))
    Phi, L = jax.vmap(lambda a: _transition(a, jnp.array(DAMPING_RATIO)))(angles)
    assert np.all(np.linalg.norm(Phi, ord=2, axis=(1, 2)) <= 1 + 1e-14)
    assert np.isfinite(L).all()


def test_statistics_over_an_ensemble():
    """Stationary from the first step at any step size; autocovariance that of the continuous filter."""
    n, dt = 4000, 0.5
    force = along_track(STORM, 41, dt, n)[:, :, 0] / float(STORM.rms())
    low, high = variance_interval(n)
    for step in (0, 1, 20, 40):
        assert abs(force[:, step].mean()) < mean_interval(n)
        assert low < force[:, step].var(ddof=1) < high
    omega = float(filter_parameters(STORM.height, STORM.period)[0])
    root = np.sqrt(1 - DAMPING_RATIO**2)
    for lag in (1, 4, 8, 13, 24):
        angle = omega * lag * dt
        cosine, sine = np.cos(root * angle), np.sin(root * angle)
        expected = np.exp(-DAMPING_RATIO * angle) * (cosine - DAMPING_RATIO / root * sine)
        assert (force[:, lag] * force[:, 0]).mean() == pytest.approx(expected, abs=4 * np.sqrt((1 + expected**2) / n))


@pytest.mark.system
@pytest.mark.parametrize("speed", [0.0, 3.0])
def test_power_lies_where_the_filter_puts_it(speed):
    """Averaged periodograms against K_w^2 w^2 / |...|^2, at rest and running with the waves: the peak moves down."""
    n, steps, dt = 400, 2048, 0.25
    force = along_track(STORM, steps, dt, n, speed)[:, :, 0]
    window = np.hanning(steps)
    power = (np.abs(np.fft.rfft(force * window, axis=1)) ** 2).mean(0) * dt / (window**2).sum()
    w = 2 * np.pi * np.fft.rfftfreq(steps, dt)
    omega_0, sigma = (float(x) for x in filter_parameters(STORM.height, STORM.period))
    omega_e = abs(omega_0 - omega_0**2 * speed / 9.81)
    K_w = 2 * DAMPING_RATIO * omega_0 * sigma
    expected = (K_w * w) ** 2 / ((omega_e**2 - w**2) ** 2 + (2 * DAMPING_RATIO * omega_e * w) ** 2)
    band = (w > 0.2 * omega_e) & (w < 3 * omega_e)
    # Neighbouring frequencies are averaged too: each of the bands below holds some 400 x 8 / 1.5 independent values.
    measured, desired = (x[band][: band.sum() // 8 * 8].reshape(-1, 8).mean(1) for x in (power, expected))
    np.testing.assert_allclose(measured, desired, rtol=0.10)
    centre = w[band][: band.sum() // 8 * 8].reshape(-1, 8).mean(1)
    assert centre[measured.argmax()] == pytest.approx(omega_e, abs=0.11)


def test_encounter_frequency():
    omega, g = 0.513, 9.81
    assert float(encounter_frequency(omega, 0.0)) == omega
    assert float(encounter_frequency(omega, 0.3)) == pytest.approx(omega - omega**2 * 0.3 / g)
    assert float(encounter_frequency(omega, -0.3)) > omega  # against the waves they come more often
    assert float(encounter_frequency(1.0, 2 * g)) == pytest.approx(1.0)  # overtaking them: the absolute value


def test_encounter_depends_on_the_speed_along_the_waves_in_the_world():
    """Yawed by 90 degrees, a vehicle that goes ahead goes east: only waves towards east are met otherwise."""
    half = np.sqrt(0.5)
    still = state(attitude=(half, 0.0, 0.0, half))
    ahead = state(attitude=(half, 0.0, 0.0, half), nu=(2.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    for direction, differs in ((0.0, False), (np.pi / 2, True)):
        waves = ThesisWaves(4.1, 8.7, direction)
        memory = waves.init(jax.random.key(0), START)
        same = np.allclose(
            waves.step(memory, ahead, 0.5)[0].filter, waves.step(memory, still, 0.5)[0].filter, rtol=1e-9, atol=0
        )
        assert same != differs


def test_force_points_along_the_direction_and_nowhere_else():
    force = along_track(ThesisWaves(4.1, 8.7, np.deg2rad(30.0)), 50, 0.2, 3)
    np.testing.assert_allclose(force[..., 1], force[..., 0] * np.tan(np.deg2rad(30.0)), atol=1e-12)
    assert not force[..., 2].any() and np.abs(force).max() > 0.1


def test_world_turns_the_force_into_the_body():
    """A force towards north on a vehicle that heads east acts to port: -y."""
    half = np.sqrt(0.5)
    world = World(waves=STORM)
    memory = world.init(jax.random.key(0), START)
    _, action = STORM.step(memory.waves, state(), 0.002)
    _, environment = world.step(memory, state(attitude=(half, 0.0, 0.0, half)), 0.002)
    np.testing.assert_allclose(environment.wrench, [0, -action.force[0], 0, 0, 0, 0], atol=1e-12)
    assert not environment.velocity.any() and not environment.rate.any()


def test_drift_is_a_random_walk():
    n, steps, dt, intensity = 4000, 101, 0.5, np.array([0.03, 0.06])
    force = along_track(ThesisWaves(0.0, 8.7, drift_intensity=intensity), steps, dt, n)
    assert not force[:, 0].any()
    low, high = variance_interval(n)
    for step in (1, 10, 100):
        growth = force[:, step, :2].var(0, ddof=1) / (intensity**2 * step * dt)
        assert np.all((growth > low) & (growth < high))
    increments = np.diff(force[:, :, :2], axis=1)
    assert abs((increments[:, 3] * increments[:, 4]).mean() / increments.var()) < mean_interval(2 * n)


def test_gain_scales_the_force():
    weak, strong = along_track(STORM, 10, 0.1, 2), along_track(ThesisWaves(4.1, 8.7, gain=5.0), 10, 0.1, 2)
    np.testing.assert_allclose(strong, 5 * weak, rtol=1e-12)


def test_gradient_with_respect_to_every_parameter_is_finite():
    def work(waves):
        memory = waves.init(jax.random.key(0), START)
        moving = state(nu=(0.3, 0.0, 0.0, 0.0, 0.0, 0.0))
        forces = jax.lax.scan(lambda m, _: waves.step(m, moving, 0.002), memory, None, length=5)[1].force
        return (forces**2).sum()

    slope = jax.jit(lambda waves: jax.grad(work)(waves))
    for height in (0.0, 4.1):
        gradient = slope(ThesisWaves(height, 8.7, 0.3, (0.03, 0.03)))
        assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradient))


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: ThesisWaves(-1.0, 8.7), "height"),
        (lambda: ThesisWaves(1.0, 0.0), "period"),
        (lambda: ThesisWaves(1.0, 8.7, direction=45.0), "degrees"),
        (lambda: ThesisWaves(1.0, 8.7, drift_intensity=(0.1,)), "drift_intensity"),
        (lambda: ThesisWaves(1.0, 8.7, damping_ratio=1.0), "damping_ratio"),
        (lambda: ThesisWaves(np.nan, 8.7), "height"),
    ],
)
def test_waves_that_cannot_be(make, words):
    with pytest.raises(ConfigError, match=words):
        make()
