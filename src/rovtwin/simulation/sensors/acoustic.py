"""Errors of an acoustic position as a real Underwater GPS has them: slow, larger with range, with gaps and bursts.

A short antenna hangs from a boat at n's origin. It measures the range well and the bearing badly, and errors of both
last for many fixes. At times no fix is valid; such gaps are more frequent and longer far away, and the bearing after
one may be off for a few seconds. Fitted on 24 minutes of a Water Linked G2 by docs/scripts/ugps_errors.py. An error
that lasts longer than half a minute cannot be distinguished from the vehicle's own motion there: a constant
misalignment of the antenna is not in the model.
"""

import equinox as eqx
import numpy as np

from rovtwin.core.numerics import as_array, jax, jnp
from rovtwin.core.types import Flag, PRNGKey, Scalar, ScalarLike, Vector2
from rovtwin.simulation.checks import require_not_negative, require_positive

LEAST_RANGE = 1.0  # nearer to the antenna the direction of the line of sight fades out [m]


class AcousticState(eqx.Module):
    """Of unit variance: slow errors across and along, and the burst; whether fixes are invalid."""

    across: Scalar
    along: Scalar
    burst: Scalar
    out: Flag


class AcousticErrors(eqx.Module):
    """What an acoustic fix errs by, beside the sensor's white noise, and whether it is valid.

    Attributes:
        across: Slow error across the line of sight, close by [m]; with `bearing` as the root of the sum of squares.
        bearing: The same per metre of range [rad].
        across_memory: Time constant of both, first-order [s].
        along: Slow error of the range [m].
        along_memory: Its time constant [s].
        burst: Error of the bearing of the first fix after a gap [rad].
        burst_memory: Its time constant [s].
        gap_rate: Gaps per second of valid fixes: close by, and more per metre of range.
        gap_length: Mean length [s]: close by, and more per metre of range.
    """

    across: Scalar = eqx.field(converter=as_array, default=0.45)
    bearing: Scalar = eqx.field(converter=as_array, default=0.041)
    across_memory: Scalar = eqx.field(converter=as_array, default=30.0)
    along: Scalar = eqx.field(converter=as_array, default=0.11)
    along_memory: Scalar = eqx.field(converter=as_array, default=8.0)
    burst: Scalar = eqx.field(converter=as_array, default=0.02)
    burst_memory: Scalar = eqx.field(converter=as_array, default=3.0)
    gap_rate: Vector2 = eqx.field(converter=as_array, default_factory=lambda: np.array([0.020, 0.0006]))
    gap_length: Vector2 = eqx.field(converter=as_array, default_factory=lambda: np.array([1.4, 0.03]))

    def __check_init__(self) -> None:
        """Refuse what is no error."""
        for name in ("across", "bearing", "along", "burst", "gap_rate", "gap_length"):
            require_not_negative(f"errors.{name}", getattr(self, name))
        for name in ("across_memory", "along_memory", "burst_memory"):
            require_positive(f"errors.{name}", getattr(self, name))

    def init(self, key: PRNGKey) -> AcousticState:
        """Fixes are valid, with errors as they usually are."""
        across, along = jax.random.normal(key, (2,))
        return AcousticState(across, along, jnp.zeros(()), jnp.zeros((), dtype=bool))

    def step(
        self, state: AcousticState, place: Vector2, key: PRNGKey, dt: ScalarLike
    ) -> tuple[AcousticState, Vector2, Flag]:
        """The next fix.

        Args:
            state: Since the last one.
            place: North and east of the locator, seen from the antenna [m].
            key: Of this fix.
            dt: Since the last fix [s].

        Returns:
            State, error (north, east) [m], and whether the fix is valid.
        """
        normal = jax.random.normal(key, (3,))
        chance = jax.random.uniform(jax.random.fold_in(key, 1))
        reach = jnp.sqrt(place @ place)
        rate, length = (scale[0] + scale[1] * reach for scale in (self.gap_rate, self.gap_length))
        change = jnp.where(state.out, dt / jnp.maximum(length, dt), -jnp.expm1(-dt * rate))
        out = jnp.where(chance < change, ~state.out, state.out)
        back = state.out & ~out
        next_state = AcousticState(
            _faded(state.across, normal[0], dt / self.across_memory),
            _faded(state.along, normal[1], dt / self.along_memory),
            jnp.where(back, normal[2], jnp.exp(-dt / self.burst_memory) * state.burst),
            out,
        )
        sight = place / jnp.maximum(reach, LEAST_RANGE)
        side = jnp.stack([-sight[1], sight[0]])
        across = jnp.sqrt(self.across**2 + (self.bearing * reach) ** 2) * next_state.across
        across = across + self.burst * reach * next_state.burst
        return next_state, across * side + self.along * next_state.along * sight, ~out


def _faded(value: Scalar, normal: Scalar, share: Scalar) -> Scalar:
    """A first-order process of unit variance after a share of its time constant."""
    kept = jnp.exp(-share)
    return kept * value + jnp.sqrt(1.0 - kept**2) * normal
