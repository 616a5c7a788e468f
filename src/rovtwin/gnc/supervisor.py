"""Supervisor: whether the vehicle may act at all, and if not, why. It knows limits and requests, not way-points.

idle ── first tick without PAUSE ──> running <── RESUME / PAUSE ──> paused
any ── ABORT, a limit, or an estimate that is not a number ──> aborted, which latches
"""

import equinox as eqx

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import (
    ABORT,
    ATTITUDE_LIMIT,
    DEPTH_LIMIT,
    ESTIMATE_LOST,
    NO_REASON,
    NOT_A_NUMBER,
    OPERATOR,
    PAUSE,
    RESUME,
    Estimate,
)
from rovtwin.core.numerics import Array, as_array, jnp

MODES = ("idle", "running", "paused", "aborted")
MODE_IDLE, MODE_RUNNING, MODE_PAUSED, MODE_ABORTED = range(len(MODES))


class SupervisorInput(eqx.Module):
    """The estimate to judge and the operator's request (NO_REQUEST, PAUSE, RESUME, ABORT), int."""

    estimate: Estimate
    request: Array


class Mode(eqx.Module):
    """One of MODES, int, and one of core.flow.REASONS, int, that says why it was aborted."""

    mode: Array
    reason: Array

    @property
    def active(self) -> Array:
        """Whether thrusters may be used: running (also after the last way-point) or paused, holding station."""
        return (self.mode == MODE_RUNNING) | (self.mode == MODE_PAUSED)


class Supervisor(Block):
    """Watches limits and the operator; memory is the Mode.

    Attributes:
        depth_limit: Greatest depth [m].
        attitude_limit: Greatest size of roll and pitch [rad]; Euler angles and PIDs fail towards 90 degrees.
        position_limit: Standard deviation of any axis of the position at which the estimate counts as lost [m].
    """

    depth_limit: Array = eqx.field(converter=as_array, default=100.0)
    attitude_limit: Array = eqx.field(converter=as_array, default=1.0472)
    position_limit: Array = eqx.field(converter=as_array, default=10.0)

    def init(self, key: Array, start: Start) -> Mode:
        zero = jnp.zeros((), dtype=int)
        return Mode(zero + MODE_IDLE, zero + NO_REASON)

    def step(self, memory: Mode, input: SupervisorInput, dt: float) -> tuple[Mode, Mode]:
        request = input.request
        wanted = memory.mode
        wanted = jnp.where((memory.mode == MODE_IDLE) & (request != PAUSE), MODE_RUNNING, wanted)
        wanted = jnp.where((memory.mode == MODE_RUNNING) & (request == PAUSE), MODE_PAUSED, wanted)
        wanted = jnp.where((memory.mode == MODE_PAUSED) & (request == RESUME), MODE_RUNNING, wanted)

        reason = jnp.where(memory.reason != NO_REASON, memory.reason, self._reason(input))
        mode = Mode(jnp.where(reason != NO_REASON, MODE_ABORTED, wanted), reason)
        return mode, mode

    def _reason(self, input: SupervisorInput) -> Array:
        """Why to abort now, the gravest first; NO_REASON if all is well."""
        estimate = input.estimate
        # A comparison with NaN is false: what is not a number must be asked for by name.
        spread = jnp.sqrt(jnp.max(jnp.diagonal(estimate.covariance)[:3]))
        reason = jnp.where(spread > self.position_limit, ESTIMATE_LOST, NO_REASON)
        reason = jnp.where(jnp.max(jnp.abs(estimate.eta[3:5])) > self.attitude_limit, ATTITUDE_LIMIT, reason)
        reason = jnp.where(estimate.eta[2] > self.depth_limit, DEPTH_LIMIT, reason)
        reason = jnp.where(input.request == ABORT, OPERATOR, reason)
        return jnp.where(is_finite(estimate), reason, NOT_A_NUMBER)


def is_finite(estimate: Estimate) -> Array:
    """Whether pose, velocity, disturbance and covariance are all numbers, bool."""
    parts = (estimate.eta, estimate.nu, estimate.bias, estimate.covariance)
    return jnp.all(jnp.array([jnp.all(jnp.isfinite(part)) for part in parts]))
