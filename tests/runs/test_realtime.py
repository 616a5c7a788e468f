"""The autopilot stepped by a host does what the block does, and answers in time."""

import numpy as np
import pytest

from rovtwin.core.flow import (
    ABORT,
    ABORTED,
    DIVE,
    HELD,
    NO_REQUEST,
    SURFACING,
    AutopilotInput,
    Measurement,
    pack,
)
from rovtwin.core.numerics import jax, jnp
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.loop import start_loop
from rovtwin.runs.realtime import HostAutopilot


@pytest.fixture(scope="module")
def parts(short):
    run = compose(short)
    memory = start_loop(run.loop, run.key, run.start, control_dt=short.control_dt)
    return run.loop.autopilot, memory.autopilot, jax.device_get(memory.measurements), short.control_dt


def delivered(k: int) -> list[Measurement]:
    t = 0.02 * k
    readings = [Measurement(name, np.full(3, 1e-3 * k), t - 0.01) for name in ("gyro", "attitude", "gyro")]
    if k % 5 == 0:
        readings.append(Measurement("position", np.array([0.01, -0.02]), t))
    return [*readings, Measurement("pressure", np.array([0.5 + 0.001 * k]), t)]


@pytest.mark.system
def test_steps_are_those_of_the_block_and_so_is_what_is_left_for_the_log(parts):
    autopilot, memory, slots, dt = parts
    host = HostAutopilot(*parts)
    step = jax.jit(lambda m, readings: autopilot.step(m, AutopilotInput(readings, jnp.asarray(NO_REQUEST)), dt))
    taken, given, expected = [], [], []
    for k in range(20):
        packed = pack(delivered(k), slots)
        memory, output = step(memory, packed)
        command = host.step(delivered(k))
        np.testing.assert_allclose(command.u, output.command.u, atol=1e-12)
        assert host.phase == int(output.setpoint.phase)
        taken.append(host.taken)
        given.append(host.given)
        expected.append((packed, jax.device_get(output)))
    found = host.unpacked(taken, given)
    desired = jax.tree.map(lambda *leaves: np.stack(leaves), *expected)
    assert jax.tree.structure(found) == jax.tree.structure(desired)
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(desired), strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_allclose(one, other, atol=1e-10)


@pytest.mark.system
def test_an_operator_is_obeyed(parts):
    host = HostAutopilot(*parts)
    host.step(delivered(0))
    assert host.phase == DIVE
    command = host.step(delivered(1), request=ABORT)
    assert host.phase == ABORTED and not command.u.any()


@pytest.mark.system
@pytest.mark.parametrize(
    ("above", "phase"), [((6.0, 0.0, 0.0), SURFACING), ((0.0, 61.0, 0.0), HELD), ((0.0, 0.0, 6.0), SURFACING)]
)
def test_a_host_that_hears_nothing_or_comes_late_is_heeded(parts, above, phase):
    host = HostAutopilot(*parts)
    for k in range(60):
        host.step(delivered(k), host=(4.9, 59.0, 0.5))
    assert host.phase == DIVE
    for k in range(60, 120):
        host.step(delivered(k), host=above)
    assert host.phase == phase
