"""Terrain following: the floor that altimeter and estimate make, and the depths that follow from it."""

import dataclasses

import numpy as np
import pytest
from tests.gnc.flying import estimate_of

from rovtwin.core.block import Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Slot
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.guidance.mission import mission
from rovtwin.gnc.guidance.terrain_following import TerrainFollowing, TerrainInput

DT = 0.02
POINT = {"x": 5.0, "y": 0.0, "depth": 2.0}
MISSION = mission([POINT | {"altitude": 1.5}, POINT | {"x": 9.0}])
BLOCK = TerrainFollowing(jnp.zeros(3), jnp.array([0.0, 0.0, 1.0]))
STEP = jax.jit(lambda block, memory, ranges, eta: block.step(memory, seen(ranges, eta), DT))


def seen(ranges, eta):
    """An echo of a range [m]; none where it is 0."""
    echo = {"altimeter": Slot(ranges[None, None], (ranges > 0.0)[None], jnp.zeros(1))}
    return TerrainInput(echo, estimate_of(eta), MISSION)


def depths(ranges, eta=lambda k: (0.0, 0.0, 2.0, 0.0, 0.0, 0.0), block=BLOCK):
    """Depth asked for at the way-points, tick by tick, for ranges (n,); their noise makes all different."""
    memory, out = block.init(jax.random.key(0), Start.at((0.0, 0.0, 2.0))), []
    for k, one in enumerate(ranges):
        memory, reported = STEP(block, memory, jnp.asarray(float(one)), jnp.asarray(eta(k), dtype=float))
        out.append(np.asarray(reported.position[:, 2]))
    return np.array(out)


def every_fifth(values):
    """Ten echoes a second."""
    return np.where(np.arange(len(values)) % 5 == 0, values, 0.0)


def test_level_floor_gives_its_depth_less_the_altitude_and_leaves_other_way_points_alone():
    asked = depths(every_fifth(np.full(100, 3.0)))
    assert np.all(asked[:20, 0] == 2.0), "five echoes have to agree"
    assert np.allclose(asked[20:, 0], 5.0 - 1.5, atol=1e-9) and np.all(asked[:, 1] == 2.0)


def test_before_the_first_echo_and_long_after_the_last_the_own_depth_holds():
    ranges = np.concatenate([np.zeros(20), every_fifth(np.full(50, 3.0)), np.zeros(300)])
    asked = depths(ranges)[:, 0]
    assert np.all(asked[:40] == 2.0) and asked[45] == pytest.approx(3.5)
    silent = (np.arange(len(ranges)) - 65) * DT  # the last echo came at tick 65
    assert np.allclose(asked[(silent > 0) & (silent < 4.9)], 3.5, atol=1e-6) and np.all(asked[silent > 5.05] == 2.0)


def test_a_falling_floor_is_led_by_what_the_reference_lags():
    """0.1 m/s deeper: after a few time constants the depth asked for is that of two seconds ahead."""
    t = DT * np.arange(400)
    asked = depths(every_fifth(3.0 + 0.1 * t))[:, 0]
    assert np.allclose(asked[300:], 5.0 + 0.1 * (t[300:] + 2.0) - 1.5, atol=0.01)


def test_tilt_and_place_of_the_altimeter_count():
    """0.5 m ahead of CO on a vehicle pitched up by 0.3 rad, beam straight down in b: the echo is of a level floor."""
    block = dataclasses.replace(BLOCK, lever=jnp.array([0.5, 0.0, 0.1]))
    sensor = 2.0 - 0.5 * np.sin(0.3) + 0.1 * np.cos(0.3)
    reading = (5.0 - sensor) / np.cos(0.3)
    asked = depths(every_fifth(np.full(40, reading)), lambda k: (0.0, 0.0, 2.0, 0.0, 0.3, 0.0), block)
    assert np.allclose(asked[-1, 0], 3.5, atol=1e-9)


def test_a_fish_moves_the_floor_by_a_fraction_only():
    ranges = every_fifth(np.full(200, 3.0))
    ranges[100] = 0.4
    asked = depths(ranges)[:, 0]
    asked = np.where(np.arange(200) < 20, 3.5, asked)
    assert 0.02 < np.abs(asked - 3.5).max() < 0.2 and np.abs(asked[150:] - 3.5).max() < 0.02


def test_no_higher_than_afloat():
    asked = depths(every_fifth(np.full(40, 1.0)), lambda k: (0.0, 0.0, 0.3, 0.0, 0.0, 0.0))
    assert asked[-1, 0] == pytest.approx(0.2)


def test_a_frozen_altimeter_is_found_out_by_the_vehicle_that_sinks():
    """A range that stays the same while the vehicle dives would be a floor that flees from it."""
    asked = depths(every_fifth(np.full(400, 3.0)), lambda k: (0.0, 0.0, 2.0 + 0.004 * k, 0.0, 0.0, 0.0))
    assert asked[60, 0] > 3.0 and np.all(asked[80:, 0] == 2.0)


def test_no_altimeter_leads_deeper_than_the_band():
    asked = depths(every_fifth(10.0 + 1e-3 * np.arange(100)))
    assert np.all(asked[60:, 0] == 2.0 + 5.0)


def test_a_wrong_first_echo_begins_nothing():
    ranges = every_fifth(np.full(100, 3.0))
    ranges[0] = 13.0
    asked = depths(ranges)[:, 0]
    assert np.all(asked[:25] == 2.0) and np.allclose(asked[25:], 3.5, atol=1e-9)


def test_an_altitude_of_nothing_is_refused():
    with pytest.raises(ConfigError, match=r"altitude: 0 is out of range; expected more than 0"):
        mission([POINT | {"altitude": 0.0}])
