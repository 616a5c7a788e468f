"""How strong the waves are, from how model and accelerometer disagree within the band of waves.

The disagreement is smoothed over a quarter of a second and freed of its slow part; its variance over the last
half minute, less what the noise of both leaves there, is that of the waves' acceleration.
"""

import equinox as eqx

from rovtwin.core.numerics import Array, jnp

SMOOTH, SLOW, REMEMBER = 0.25, 15.0, 40.0  # [s]


class SeaState(eqx.Module):
    """Acceleration that the model does not explain, b [m/s2]: smoothed, its slow part, and the variance between them."""

    smooth: Array
    slow: Array
    variance: Array

    @classmethod
    def calm(cls) -> "SeaState":
        return cls(jnp.zeros(3), jnp.zeros(3), jnp.zeros(3))

    def after(self, unexplained: Array, noise: Array, heard: Array, dt: float) -> "SeaState":
        """A tick later.

        Args:
            unexplained: Accelerometer's less model's acceleration, without waves [m/s2], shape (3,).
            noise: Its variance where there are no waves, shape (3,).
            heard: Whether there was a reading, bool.
            dt: Tick [s].
        """
        smooth = self.smooth + dt / SMOOTH * (unexplained - self.smooth)
        slow = self.slow + dt / SLOW * (smooth - self.slow)
        excess = (smooth - slow) ** 2 - noise * dt / (2.0 * SMOOTH)
        variance = self.variance + dt / REMEMBER * (excess - self.variance)
        new = SeaState(smooth, slow, variance)
        return SeaState(
            *(
                jnp.where(heard, a, b)
                for a, b in zip(
                    (new.smooth, new.slow, new.variance), (self.smooth, self.slow, self.variance), strict=True
                )
            )
        )

    def force_variance(self, mass: Array, R_nb: Array) -> Array:
        """Of the wave force along north, east and down [N2], shape (3,)."""
        in_b = mass**2 * jnp.maximum(self.variance, 0.0)
        return (R_nb * R_nb) @ in_b
