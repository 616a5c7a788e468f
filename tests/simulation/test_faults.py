"""Faults of thrusters: what each does to the plant, alone and in a crowd."""

import numpy as np
import pytest
from tests.simulation.helper import vehicle

from rovtwin.core.block import Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Command
from rovtwin.core.numerics import jax, jnp
from rovtwin.simulation.environment.world import World
from rovtwin.simulation.events.faults import FaultInput, Faults, ThrusterFault
from rovtwin.simulation.twin import Twin, TwinInput

DT, TICKS = 0.02, 150
START = Start.at((0.0, 0.0, 5.0))
MODEL = vehicle()
ALL = (
    ThrusterFault("dead", [0], 1.0, 2.0),
    ThrusterFault("weak", [1], 1.0, share=0.3),
    ThrusterFault("reversed", [2], 1.0, 2.0),
    ThrusterFault("stuck", [3], 1.0, 2.0),
    ThrusterFault("stuck", [4], 0.5, command=-0.5),
)


def u_of(k):
    """Something that never repeats."""
    return 0.4 + 0.3 * jnp.sin(jnp.array([0.9, 1.1, 1.3, 1.7, 0.7, 1.9]) * (k * DT) + jnp.arange(6.0))


@jax.jit
def thrust(faults):
    """Force of each thruster after each tick, shape (TICKS, 6)."""
    twin = Twin(MODEL, World(), {}, faults=faults)

    def tick(memory, k):
        return twin.step(memory, TwinInput(Command(u_of(k)), k), DT)

    return jax.lax.scan(tick, twin.init(jax.random.key(0), START), jnp.arange(TICKS))[1].state.thrust


@pytest.fixture(scope="module")
def sound():
    return np.asarray(thrust(None))


@pytest.fixture(scope="module")
def faulty():
    return np.asarray(thrust(Faults(6, ALL)))


def obeyed(faults):
    """Command that the thrusters obey in each tick, shape (TICKS, n)."""

    def tick(memory, k):
        return faults.step(memory, FaultInput(Command(u_of(k)), k), DT)

    return np.asarray(jax.lax.scan(tick, faults.init(jax.random.key(0), START), jnp.arange(TICKS))[1].command.u)


def test_nothing_differs_before_a_fault_and_elsewhere(sound, faulty):
    np.testing.assert_array_equal(faulty[:25], sound[:25])
    np.testing.assert_array_equal(faulty[:, 5], sound[:, 5])


def test_a_dead_thruster_dies_away_with_its_lag_and_comes_back(sound, faulty):
    """Force after t seconds: F exp(-t / 0.2)."""
    t = DT * np.arange(1, 51)
    np.testing.assert_allclose(faulty[50:100, 0], sound[49, 0] * np.exp(-t / 0.2), rtol=1e-9)
    # Sound again: what was lost is forgotten with the same lag.
    gap = (faulty - sound)[99:, 0]
    np.testing.assert_allclose(gap, gap[0] * np.exp(-DT * np.arange(len(gap)) / 0.2), atol=1e-9)


def test_a_weak_thruster_settles_at_its_share(sound, faulty):
    np.testing.assert_allclose(faulty[140:, 1], 0.3 * sound[140:, 1], rtol=1e-3)


def test_a_reversed_thruster_pushes_the_other_way(sound, faulty):
    after = DT * np.arange(1, 51)
    both = (faulty + sound)[50:100, 2]
    np.testing.assert_allclose(both, 2 * sound[49, 2] * np.exp(-after / 0.2), rtol=1e-6)


def test_a_stuck_thruster_keeps_its_last_command_or_the_given_one(faulty):
    held = 10.0 * float(u_of(49)[3])
    assert faulty[99, 3] == pytest.approx(held, abs=0.02)
    assert np.ptp(np.diff(faulty[50:100, 3])) < 0.1
    assert faulty[140, 4] == pytest.approx(-5.0, rel=1e-3)
    u = obeyed(Faults(6, ALL))
    assert len(np.unique(u[49:100, 3])) == 1
    np.testing.assert_allclose(u[100:, 3], [u_of(k)[3] for k in range(100, TICKS)], rtol=1e-12)


def test_a_span_begins_and_ends_on_its_tick():
    """0.3 / 0.02 and 0.7 / 0.02 round below their ticks; the fault does not."""
    u = obeyed(Faults(6, [ThrusterFault("stuck", [0], 0.3, 0.7, command=0.9)]))
    np.testing.assert_array_equal(np.flatnonzero(u[:, 0] == 0.9), np.arange(15, 35))


def test_several_faults_of_one_thruster_add_up():
    two = [ThrusterFault("weak", [0, 1], share=0.5), ThrusterFault("weak", [0], share=0.4)]
    twice = [ThrusterFault("reversed", [2]), ThrusterFault("reversed", [2]), ThrusterFault("stuck", [3], command=0.1)]
    last = ThrusterFault("stuck", [3], command=0.2)
    faults = Faults(6, [*two, *twice, last])
    _, out = faults.step(jnp.zeros(6), FaultInput(Command(u_of(0)), 0), DT)
    np.testing.assert_allclose(out.share, [0.2, 0.5, 1, 1, 1, 1])
    np.testing.assert_allclose(out.command.u[2:4], [float(u_of(0)[2]), 0.2])


def test_leaks_come_and_go():
    faults = Faults(6, leaks=[(0.1, 0.2), (1.0, np.inf)])
    leak = [bool(faults.step(jnp.zeros(6), FaultInput(Command(u_of(0)), k), DT)[1].leak) for k in (0, 4, 5, 9, 10, 90)]
    assert leak == [False, False, True, True, False, True]


def test_tethers_are_caught_by_name():
    faults = Faults(6, snags={"port_tether": [(0.1, 0.2)], "starboard_tether": [(0.0, np.inf)]})
    texts = [faults.step(jnp.zeros(6), FaultInput(Command(u_of(0)), k), DT)[1].snagged for k in (4, 5, 10)]
    assert [bool(s["port_tether"]) for s in texts] == [False, True, False]
    assert all(bool(s["starboard_tether"]) for s in texts)
    with pytest.raises(ConfigError, match="port_tether"):
        Faults(6, snags={"port_tether": [(2.0, 1.0)]})


def test_a_crowd_of_vehicles_each_with_its_own_faults(sound, faulty):
    """Times and sizes are data: under vmap every vehicle has its own, and is as it is alone."""
    none = Faults(6, [ThrusterFault(f.kind, f.thrusters, 1e6, share=f.share, command=f.command) for f in ALL])
    pair = jax.tree.map(lambda *leaves: jnp.stack(leaves), Faults(6, ALL), none)
    together = np.asarray(jax.jit(jax.vmap(thrust))(pair))
    np.testing.assert_allclose(together[0], faulty, atol=1e-12)
    np.testing.assert_allclose(together[1], sound, atol=1e-12)


def test_other_times_compile_to_the_same_program():
    before = thrust._cache_size()
    for start in (0.1, 0.2, 2.9):
        thrust(Faults(6, [ThrusterFault(f.kind, f.thrusters, start, share=0.1, command=0.3) for f in ALL]))
    assert thrust._cache_size() <= before + 1


BAD = {
    "expected 0 to 5": ThrusterFault("dead", [6]),
    "a later one": ThrusterFault("dead", [0], 2.0, 1.0),
    "from 0 to 1": ThrusterFault("weak", [0], share=1.2),
    "from -1 to 1": ThrusterFault("stuck", [0], command=2.0),
    "dead, weak": ThrusterFault("broken", [0]),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("message", BAD)
def test_faults_that_cannot_be_are_refused(message):
    with pytest.raises(ConfigError, match=message):
        Faults(6, [BAD[message]])
    with pytest.raises(ConfigError, match="leaks"):
        Faults(6, leaks=[(2.0, 1.0)])
