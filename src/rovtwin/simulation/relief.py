"""A floor that is not level: a slope with waves of sand upon it.

depth(x) = depth + slope . x + sum_i a_i sin(k_i . x)
"""

from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.core.types import Scalar, Vector2


class Relief(eqx.Module):
    """The depth of the floor by place, smooth.

    Attributes:
        depth: At the origin of n, without the waves [m].
        slope: By how much it gets deeper per metre north and east.
        amplitude: Half-height of each wave [m].
        wave_number: Of each, north and east [rad/m].
    """

    depth: Scalar = eqx.field(converter=as_array)
    slope: Vector2 = eqx.field(converter=as_array)
    amplitude: Float[Array, " k"] = eqx.field(converter=as_array)
    wave_number: Float[Array, "k 2"] = eqx.field(converter=as_array)

    @classmethod
    def of(
        cls, depth: float, slope: Sequence[float] = (0.0, 0.0), waves: Sequence[tuple[float, float, float]] = ()
    ) -> "Relief":
        """From waves of (amplitude [m], length [m], direction of their crests' normal [rad, from north])."""
        rows = [
            (2.0 * np.pi / length * np.cos(along), 2.0 * np.pi / length * np.sin(along)) for _, length, along in waves
        ]
        amplitude, number = [wave[0] for wave in waves], np.reshape(rows, (len(rows), 2))
        return cls(as_array(depth), as_array(slope), as_array(amplitude), as_array(number))

    def under(self, place: Vector2) -> tuple[Scalar, Vector2]:
        """Depth of the floor [m] below a place, north and east [m], and its slope there."""
        phase = self.wave_number @ place
        depth = self.depth + self.slope @ place + self.amplitude @ jnp.sin(phase)
        return depth, self.slope + (self.amplitude * jnp.cos(phase)) @ self.wave_number
