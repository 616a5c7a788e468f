"""How strong the waves are and how fast, from how model and accelerometer disagree.

The disagreement is smoothed over a fifth of a second and freed of its slow part. Its variance over the last half
minute, less what the noise of both leaves there, is that of the waves' acceleration; with the variance of its integral,
that of their velocity, it gives their frequency.
"""

import equinox as eqx

from rovtwin.core.numerics import jax, jnp
from rovtwin.core.types import Flag, Matrix3, Scalar, Vector3

SMOOTH, SLOW, REMEMBER = 0.2, 6.0, 40.0  # [s]
FIRST, GROWTH = 6.0, 0.25  # what is remembered at the start [s], and how much longer each second
ROUGH = 0.2, 0.15  # what is assumed at the start: acceleration [m/s2] and velocity [m/s], a choppy surface
FAINT = 1e-3  # acceleration below which nothing is said about the frequency [m/s2]
# A slower motion is control's: the drift that a lost thruster brings looked like a swell of 0.4 rad/s.
SLOWEST, FASTEST, USUAL = 0.6, 2.5, 1.0  # frequencies [rad/s]


class SeaState(eqx.Module):
    """What model and waves do not explain.

    Attributes:
        smooth: Acceleration, b [m/s2].
        slow: Its slow part.
        velocity: Integral of the rest, which forgets slowly [m/s].
        acceleration_variance: Of waves [m2/s4].
        velocity_variance: Of waves [m2/s2].
        memory: How far back the variances reach [s].
    """

    smooth: Vector3
    slow: Vector3
    velocity: Vector3
    acceleration_variance: Vector3
    velocity_variance: Vector3
    memory: Scalar

    @classmethod
    def unknown(cls) -> "SeaState":
        """Rough, but soon forgotten: waves taken for a force would throw the filter off, a force for waves does not."""
        zero, one = jnp.zeros(3), jnp.ones(3)
        return cls(zero, zero, zero, ROUGH[0] ** 2 * one, ROUGH[1] ** 2 * one, jnp.asarray(FIRST))

    def after(self, unexplained: Vector3, noise: Vector3, received: Flag, dt: float) -> "SeaState":
        """A tick later.

        Args:
            unexplained: Accelerometer's less model's acceleration [m/s2].
            noise: Its variance where there are no waves.
            received: Whether there was a reading.
            dt: Tick [s].
        """
        smooth = self.smooth + dt / SMOOTH * (unexplained - self.smooth)
        slow = self.slow + dt / SLOW * (smooth - self.slow)
        quick = smooth - slow
        velocity = self.velocity + dt * (quick - self.velocity / SLOW)
        # White noise of density noise * dt leaves noise * dt / (2 T) behind a lag, and noise * dt T / 4 behind both T.
        a = quick**2 - noise * dt / (2.0 * SMOOTH)
        v = velocity**2 - noise * dt * SLOW / 4.0
        keep = dt / self.memory
        new = SeaState(
            smooth,
            slow,
            velocity,
            self.acceleration_variance + keep * (a - self.acceleration_variance),
            self.velocity_variance + keep * (v - self.velocity_variance),
            jnp.minimum(self.memory + GROWTH * dt, REMEMBER),
        )
        return jax.tree.map(lambda a, b: jnp.where(received, a, b), new, self)

    @property
    def frequency(self) -> Scalar:
        """Of the waves [rad/s]; the usual one in calm water."""
        a = jnp.maximum(jnp.sum(self.acceleration_variance), 0.0) + FAINT**2
        v = jnp.maximum(jnp.sum(self.velocity_variance), 0.0) + (FAINT / USUAL) ** 2
        return jnp.clip(jnp.sqrt(a / v), SLOWEST, FASTEST)

    def heave(self, R_nb: Matrix3) -> Scalar:
        """Standard deviation of the waves' vertical displacement [m]."""
        a = (R_nb[2] * R_nb[2]) @ jnp.maximum(self.acceleration_variance, 0.0)
        return jnp.sqrt(a + 1e-12) / self.frequency**2

    def density(self, damping: Scalar, R_nb: Matrix3) -> Vector3:
        """Of the white noise that drives the waves along north, east and down [m2/s3]."""
        return (R_nb * R_nb) @ jnp.maximum(self.acceleration_variance, 0.0) * 4.0 * damping / self.frequency
