"""What the filter estimates, and its error.

The nominal state is held as it is (attitude as a quaternion); the covariance is that of a small error of 31 numbers,
in the order of the slices below. The error of the attitude is a small rotation seen from b: R_true = R exp(S(dtheta)).

Reference: Sola (2017), Quaternion Kinematics for the Error-State Kalman Filter, sec. 5 (local angular error).
"""

import equinox as eqx
from jaxtyping import Float

from rovtwin.core.block import Start
from rovtwin.core.frames import quaternion_multiply, quaternion_normalise
from rovtwin.core.numerics import Array, jnp
from rovtwin.core.types import Quaternion, Vector2, Vector3

POSITION, VELOCITY, ATTITUDE = slice(0, 3), slice(3, 6), slice(6, 9)
WAVE_PLACE, WAVE_VELOCITY = slice(9, 12), slice(12, 15)
GYRO_BIAS, ACCELEROMETER_BIAS = slice(15, 18), slice(18, 21)
FORCE_N, FORCE_B, CURRENT, DRAG = slice(21, 24), slice(24, 26), slice(26, 28), slice(28, 31)
MOVING, ERRORS = 15, 31  # the first rows of the error change by themselves, the rest only wander
HORIZONTAL = slice(0, 2)


FIELDS = (
    "position",
    "velocity",
    "attitude",
    "wave_place",
    "wave_velocity",
    "gyro_bias",
    "accelerometer_bias",
    "force_n",
    "force_b",
    "current",
    "drag",
)


def initial_covariance(std: Float[Array, "31"], start: Start) -> Float[Array, "31 31"]:
    """Covariance of the error at the start.

    What is known of the start is where CO is, waves and all: how much of it is the waves' displacement is not known, so
    that slow place and displacement err by the same, one up, one down. Depth is given by the pressure, which is blind
    to the waves.

    Args:
        std: Of each error [its unit]; that of north and east is the start's own.
        start: Its `position_std` is that of CO [m].
    """
    waves = std[WAVE_PLACE][HORIZONTAL] ** 2
    whole = jnp.diag(std**2)
    for axis in range(2):
        place, wave = POSITION.start + axis, WAVE_PLACE.start + axis
        whole = whole.at[place, place].set(start.position_std**2 + waves[axis])
        whole = whole.at[place, wave].set(-waves[axis]).at[wave, place].set(-waves[axis])
    return whole


class NavigationState(eqx.Module):
    """The nominal state.

    Attributes:
        position: CO in n without the motion of the waves [m].
        velocity: Of CO over ground, b, without the motion of the waves [m/s].
        attitude: Quaternion R_nb.
        wave_place: What waves add to the position, n [m].
        wave_velocity: What waves add to the velocity, n [m/s].
        gyro_bias: b [rad/s].
        accelerometer_bias: b [m/s2].
        force_n: Slow disturbance that stays put as the vehicle turns (drift, tether, buoyancy), n [N].
        force_b: Slow disturbance that turns with it (thrust that is not what it should be), surge and sway [N].
        current: Of the water, north and east [m/s].
        drag: Logarithm of what drag is times the model's, in surge, sway and heave.
    """

    position: Vector3
    velocity: Vector3
    attitude: Quaternion
    wave_place: Vector3
    wave_velocity: Vector3
    gyro_bias: Vector3
    accelerometer_bias: Vector3
    force_n: Vector3
    force_b: Vector2
    current: Vector2
    drag: Vector3

    @classmethod
    def at(cls, start: Start) -> "NavigationState":
        """At a place and attitude, at rest as far as is known."""
        zero, two = jnp.zeros(3), jnp.zeros(2)
        return cls(start.position, zero, start.attitude, zero, zero, zero, zero, zero, two, two, zero)

    def as_vector(self) -> Float[Array, "32"]:
        """All of it, in the order of the fields."""
        return jnp.concatenate([getattr(self, name) for name in FIELDS])

    def corrected(self, error: Float[Array, "31"]) -> "NavigationState":
        """The state with an error added."""
        half = 0.5 * error[ATTITUDE]
        turn = jnp.concatenate([jnp.sqrt(jnp.maximum(1.0 - half @ half, 0.0))[None], half])
        return NavigationState(
            self.position + error[POSITION],
            self.velocity + error[VELOCITY],
            quaternion_normalise(quaternion_multiply(self.attitude, turn)),
            self.wave_place + error[WAVE_PLACE],
            self.wave_velocity + error[WAVE_VELOCITY],
            self.gyro_bias + error[GYRO_BIAS],
            self.accelerometer_bias + error[ACCELEROMETER_BIAS],
            self.force_n + error[FORCE_N],
            self.force_b + error[FORCE_B],
            self.current + error[CURRENT],
            self.drag + error[DRAG],
        )
