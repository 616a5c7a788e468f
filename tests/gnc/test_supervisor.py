import equinox as eqx
import numpy as np
import pytest
from tests.gnc.flying import estimate_of

from rovtwin.core.block import Start
from rovtwin.core.flow import (
    ABORT,
    ATTITUDE_LIMIT,
    DEPTH_LIMIT,
    ESTIMATE_LOST,
    NO_REASON,
    NO_REQUEST,
    NOT_A_NUMBER,
    OPERATOR,
    PAUSE,
    RESUME,
)
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.supervisor import (
    MODE_ABORTED,
    MODE_IDLE,
    MODE_PAUSED,
    MODE_RUNNING,
    Mode,
    Supervisor,
    SupervisorInput,
)

SUPERVISOR = Supervisor(depth_limit=20.0, attitude_limit=0.8, position_limit=3.0)
STEP = jax.jit(lambda memory, input: SUPERVISOR.step(memory, input, 0.02))
FINE = estimate_of([1, 2, 3, 0.1, -0.1, 3.0])


def ask(mode, request=NO_REQUEST, estimate=FINE, reason=NO_REASON):
    memory, output = STEP(Mode(jnp.asarray(mode), jnp.asarray(reason)), SupervisorInput(estimate, jnp.asarray(request)))
    assert int(memory.mode) == int(output.mode) and int(memory.reason) == int(output.reason)
    return int(output.mode), int(output.reason)


REQUESTS = (NO_REQUEST, PAUSE, RESUME, ABORT)
TABLE = {
    MODE_IDLE: (MODE_RUNNING, MODE_IDLE, MODE_RUNNING, MODE_ABORTED),
    MODE_RUNNING: (MODE_RUNNING, MODE_PAUSED, MODE_RUNNING, MODE_ABORTED),
    MODE_PAUSED: (MODE_PAUSED, MODE_PAUSED, MODE_RUNNING, MODE_ABORTED),
}


CASES = [(mode, request, after) for mode in TABLE for request, after in zip(REQUESTS, TABLE[mode], strict=True)]


@pytest.mark.parametrize(("mode", "request_", "after"), CASES)
def test_what_the_operator_may_do(mode, request_, after):
    assert ask(mode, request_) == (after, OPERATOR if after == MODE_ABORTED else NO_REASON)


@pytest.mark.parametrize("request_", REQUESTS)
@pytest.mark.parametrize("reason", [OPERATOR, DEPTH_LIMIT, NOT_A_NUMBER])
def test_abort_latches_with_its_first_reason(request_, reason):
    assert ask(MODE_ABORTED, request_, reason=reason) == (MODE_ABORTED, reason)
    assert ask(MODE_ABORTED, request_, estimate_of([0, 0, 99, 0, 0, 0]), reason) == (MODE_ABORTED, reason)


def at(**changes):
    eta = {"x": 0, "y": 0, "z": 3, "phi": 0, "theta": 0, "psi": 0} | changes
    return estimate_of(list(eta.values()))


@pytest.mark.parametrize("mode", list(TABLE))
@pytest.mark.parametrize(
    ("estimate", "reason"),
    [
        (at(z=20.1), DEPTH_LIMIT),
        (at(z=19.9), NO_REASON),
        (at(z=-1.0), NO_REASON),
        (at(phi=0.81), ATTITUDE_LIMIT),
        (at(phi=-0.81), ATTITUDE_LIMIT),
        (at(theta=-0.81), ATTITUDE_LIMIT),
        (at(psi=3.1), NO_REASON),
        (estimate_of(np.zeros(6), std=3.1), ESTIMATE_LOST),
        (estimate_of(np.zeros(6), std=2.9), NO_REASON),
        (at(z=20.1, phi=1.0), DEPTH_LIMIT),
    ],
)
def test_limits(mode, estimate, reason):
    after, why = ask(mode, RESUME, estimate)
    assert why == reason
    assert after == (MODE_RUNNING if reason == NO_REASON else MODE_ABORTED)


@pytest.mark.parametrize("part", ["eta", "nu", "bias", "covariance"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_a_number_aborts(part, value):
    broken = eqx.tree_at(lambda e: getattr(e, part), FINE, getattr(FINE, part).at[-1].set(value))
    assert ask(MODE_RUNNING, estimate=broken) == (MODE_ABORTED, NOT_A_NUMBER)


def test_begins_idle_and_thrusters_are_on_while_running_or_paused():
    memory = SUPERVISOR.init(jax.random.key(0), Start.at())
    assert int(memory.mode) == MODE_IDLE and not memory.active
    active = [bool(Mode(jnp.asarray(m), jnp.asarray(0)).active) for m in range(4)]
    assert active == [False, True, True, False]
