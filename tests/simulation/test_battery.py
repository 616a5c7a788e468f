"""Batteries: what is drawn, when they are empty, and what stops then."""

import numpy as np
import pytest
from tests.simulation.helper import vehicle

from rovtwin.core.block import Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Command
from rovtwin.core.numerics import jax, jnp
from rovtwin.simulation.battery import Battery, BatteryInput, thruster_power
from rovtwin.simulation.environment.world import World
from rovtwin.simulation.sensors.sensor import Sensor
from rovtwin.simulation.twin import Twin, TwinInput

DT = 0.02
START = Start.at((0.0, 0.0, 5.0))
FEEDS = np.array([[1, 1, 1, 0, 0, 0], [0, 0, 0, 1, 1, 0]])
SPECIFIC = np.tile([1.0, 1.45], (6, 1))


def battery(capacity_wh=(10.0, 10.0), hotel=(20.0, 5.0), start=1.0):
    return Battery(capacity_wh, hotel, FEEDS, SPECIFIC, start)


@jax.jit
def flown(block):
    """Five seconds with steady commands: battery after each tick, forces after each tick, readings of the gauge."""
    twin = Twin(vehicle(), World(), {"battery": Sensor("battery", 1.0)}, battery=block)
    u = jnp.array([0.9, -0.5, 0.3, 0.8, -0.8, 0.6])

    def tick(memory, k):
        memory, out = twin.step(memory, TwinInput(Command(u), k), DT)
        return memory, (memory.battery, out.state.thrust, out.measurements["battery"])

    return jax.lax.scan(tick, twin.init(jax.random.key(0), START), jnp.arange(250))[1]


def test_power_of_steady_forces():
    state, thrust, _ = flown(battery())
    c = np.where(np.asarray(thrust[-1]) > 0, 1.0, 1.45)
    each = c * np.abs(thrust[-1]) ** 1.5
    np.testing.assert_allclose(state.power[-1], FEEDS @ each + [20.0, 5.0], rtol=1e-6)
    np.testing.assert_allclose(thruster_power(jnp.ones(2), 2 * jnp.ones(2), jnp.array([4.0, -4.0])), [8.0, 16.0])


def test_charge_is_what_is_not_used():
    state, _, _ = flown(battery(start=[1.0, 0.5]))
    used, charge, power = map(np.asarray, (state.used, state.charge, state.power))
    np.testing.assert_allclose(charge, 1.0 - used / 36_000.0, rtol=1e-12)
    np.testing.assert_allclose(np.diff(used, axis=0), DT * power[1:], rtol=1e-9)
    assert charge[0] == pytest.approx([1.0, 0.5], abs=1e-4) and (np.diff(charge, axis=0) < 0).all()


def test_an_empty_battery_stops_its_thrusters_and_no_others():
    """60 J: gone within seconds. Its three thrusters die away; the others, and the one without a battery, go on."""
    state, thrust, gauge = flown(battery(capacity_wh=(60.0 / 3600, 10.0)))
    full, healthy, _ = flown(battery())
    charge, thrust = np.asarray(state.charge), np.asarray(thrust)
    gone = np.flatnonzero(charge[:, 0] <= 0.0)[0]
    assert 20 < gone < 200 and not charge[gone:, 0].any() and not np.asarray(state.power)[gone + 1 :, 0].any()
    assert float(state.used[-1, 0]) == pytest.approx(60.0)
    np.testing.assert_array_equal(thrust[: gone + 1], healthy[: gone + 1])
    np.testing.assert_array_equal(thrust[:, 3:], healthy[:, 3:])
    later = DT * np.arange(1, 30)
    decay = np.exp(-later / 0.2)[:, None] * thrust[gone, :3]
    np.testing.assert_allclose(thrust[gone + 1 : gone + 30, :3], decay, atol=1e-9)
    np.testing.assert_array_equal(np.asarray(state.charge)[:, 1], np.asarray(full.charge)[:, 1])
    assert not gauge.value[np.asarray(gauge.valid)][-1, 0]  # the gauge shows the emptiest


def test_the_gauge_reads_once_a_second():
    state, _, gauge = flown(battery())
    ticks = np.flatnonzero(np.asarray(gauge.valid)[:, 0])
    np.testing.assert_array_equal(ticks, [49, 99, 149, 199, 249])
    # What was known at the beginning of the tick.
    charge, power = np.asarray(state.charge)[ticks - 1], np.asarray(state.power)[ticks - 1]
    np.testing.assert_allclose(gauge.value[ticks, 0], np.stack([charge.min(1), power.sum(1)], axis=1), rtol=1e-12)


@pytest.mark.system
def test_a_crowd_with_batteries_of_its_own():
    pair = [battery(), battery(capacity_wh=(60.0 / 3600, 10.0))]
    together = jax.jit(jax.vmap(flown))(jax.tree.map(lambda *leaves: jnp.stack(leaves), *pair))
    for i, alone in enumerate(map(flown, pair)):
        for a, b in zip(jax.tree.leaves(alone), jax.tree.leaves(together), strict=True):
            np.testing.assert_allclose(np.asarray(b)[i].astype(float), np.asarray(a).astype(float), atol=1e-9)


@pytest.mark.system
def test_gradient_at_rest_is_finite():
    def used(force):
        block = battery()
        return block.step(block.init(jax.random.key(0), START), BatteryInput(force), DT)[1].used.sum()

    assert np.isfinite(jax.grad(used)(jnp.zeros((10, 3, 6)))).all()


BAD = {
    "capacity": lambda: battery(capacity_wh=(0.0, 1.0)),
    "hotel_load": lambda: battery(hotel=(-1.0, 0.0)),
    "charge": lambda: battery(start=1.5),
    "two batteries": lambda: Battery([1.0, 1.0], [0.0, 0.0], np.ones((2, 6)), SPECIFIC),
    "specific_power": lambda: Battery([1.0, 1.0], [0.0, 0.0], FEEDS, -SPECIFIC),
}


@pytest.mark.parametrize("message", BAD)
def test_batteries_that_cannot_be_are_refused(message):
    with pytest.raises(ConfigError, match=message):
        BAD[message]()
