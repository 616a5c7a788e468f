"""Acoustic positions that err like a real Underwater GPS: slow, more with range, with gaps and bursts."""

from functools import partial

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import jax, jnp
from rovtwin.simulation.sensors.acoustic import AcousticErrors
from rovtwin.simulation.sensors.sensor import Sensor


@partial(jax.jit, static_argnames="count")
def fixes(errors, key, place, dt, count=4000):
    """Errors, shape (count, 2), and validity, shape (count,), of a locator that stays where it is."""

    def fix(state, k):
        state, error, valid = errors.step(state, place, jax.random.fold_in(key, k), dt)
        return state, (error, valid)

    return jax.lax.scan(fix, errors.init(key), jnp.arange(count))[1]


@pytest.mark.parametrize("reach", [5.0, 80.0])
def test_the_spread_across_grows_with_range_and_that_along_does_not(reach):
    quiet = AcousticErrors(burst=0.0)
    runs = [fixes(quiet, jax.random.key(seed), jnp.array([0.0, reach]), 0.5)[0] for seed in range(20)]
    north, east = np.std(np.concatenate(runs), axis=0)
    assert north == pytest.approx(np.hypot(0.45, 0.041 * reach), rel=0.1)  # 20 x 2,000 s of an error that lasts 30 s
    assert east == pytest.approx(0.11, rel=0.1)


def test_errors_last_as_long_as_they_should():
    error = np.concatenate(
        [fixes(AcousticErrors(burst=0.0), jax.random.key(s), jnp.array([40.0, 0.0]), 0.5)[0] for s in range(20)]
    )
    along, across = error.T
    for values, memory in ((across, 30.0), (along, 8.0)):
        steps = int(memory / 0.5)
        kept = np.mean(values[:-steps] * values[steps:]) / np.mean(values**2)
        assert kept == pytest.approx(np.exp(-1.0), abs=0.12)


def test_gaps_are_more_and_longer_far_away():
    share, length = {}, {}
    for reach in (10.0, 90.0):
        valid = np.asarray(fixes(AcousticErrors(), jax.random.key(1), jnp.array([reach, 0.0]), 0.5, count=20_000)[1])
        begins = np.sum(valid[:-1] & ~valid[1:])
        share[reach], length[reach] = np.mean(~valid), 0.5 * np.sum(~valid) / begins
    assert length[10.0] == pytest.approx(1.7, rel=0.15) and length[90.0] == pytest.approx(4.1, rel=0.15)
    assert share[10.0] < 0.06 and 0.15 < share[90.0] < 0.35


def test_after_a_gap_the_bearing_is_off_for_a_few_seconds():
    place, bursts = jnp.array([80.0, 0.0]), AcousticErrors(across=0.0, bearing=0.0, along=0.0)
    error, valid = map(np.asarray, fixes(bursts, jax.random.key(3), place, 0.5, count=20_000))
    first = np.flatnonzero(valid[1:] & ~valid[:-1]) + 1
    assert np.std(error[first, 1]) == pytest.approx(0.02 * 80, rel=0.15)
    assert np.std(error[np.flatnonzero(valid[10:] & valid[:-10].astype(bool))[:1]]) < 1.0
    np.testing.assert_allclose(error[:, 0], 0.0, atol=1e-12)


def test_straight_above_the_locator_nothing_breaks():
    error, _ = fixes(AcousticErrors(), jax.random.key(0), jnp.zeros(2), 0.5, count=100)
    assert np.isfinite(np.asarray(error)).all()


def test_only_positions_err_so():
    with pytest.raises(ConfigError, match="expected acoustic, of a position"):
        Sensor("pressure", 10.0, errors="acoustic")
    with pytest.raises(ConfigError, match="errors.bearing"):
        AcousticErrors(bearing=-0.1)
