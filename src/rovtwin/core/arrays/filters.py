"""Recursive filters of a tick: an alpha-beta filter, and an integral that does not wind up.

Reference: Bar-Shalom, Li and Kirubarajan (2001), Estimation with Applications to Tracking and Navigation, sec. 6.5
(alpha-beta filter); Astrom and Hagglund (2006), Advanced PID Control, sec. 3.5 (conditional integration).
"""

from jaxtyping import Float

from rovtwin.core.numerics import Array, jnp
from rovtwin.core.types import ScalarLike

ROUNDING = 1e-6  # of an allocation [N, N m]: a shortfall that is smaller is none


def alpha_beta(
    value: Float[Array, "*axes"],
    rate: Float[Array, "*axes"],
    residual: Float[Array, "*axes"],
    alpha: Float[Array, "*axes"] | ScalarLike,
    beta: Float[Array, "*axes"] | ScalarLike,
) -> tuple[Float[Array, "*axes"], Float[Array, "*axes"]]:
    """Value and rate after a reading.

    Args:
        value: Predicted for the reading's time.
        rate: Of it.
        residual: Reading less prediction; zero where there is none.
        alpha: Share of the residual that the value takes.
        beta: Of the rate [1/s]: the filter's beta over the time between readings.
    """
    return value + alpha * residual, rate + beta * residual


def integrated(
    integral: Float[Array, "*axes"],
    growth: Float[Array, "*axes"],
    cut: Float[Array, "*axes"],
    shortfall: Float[Array, "*axes"] | None = None,
) -> Float[Array, "*axes"]:
    """The integral a tick later: an axis does not integrate further in the direction in which it is cut short.

    Args:
        integral: Before.
        growth: What the tick adds to it.
        cut: What the axis's own limit takes of its output now.
        shortfall: What the allocation took of it a tick ago, None where nobody tells.
    """
    winding = growth * cut > 0.0
    if shortfall is not None:
        lost = jnp.where(jnp.abs(shortfall) > ROUNDING, shortfall, 0.0)
        winding = winding | (growth * lost > 0.0)
    return jnp.where(winding, integral, integral + growth)
